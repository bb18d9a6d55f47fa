"""The contact detector: on recorded trials, on generated gaits, disturbed, and on nothing."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from footik_runtime import gait
from footik_runtime.builtin import humanoid_rig
from footik_runtime.contact_scores import contact_f1
from footik_runtime.errors import FootIKError
from footik_runtime.offline.contact_bench import (
    Trial,
    ours,
    read_trial,
    read_trials,
    score_trials,
    with_drift,
    with_noise,
)
from footik_runtime.offline.detect import contacts
from footik_runtime.phases import Phase, phase_curve
from footik_runtime.sole import all_sole_points

FOLDER = Path(os.environ.get("FOOTIK_SHARED", "../shared")) / "peers" / "contacts"
shared = pytest.mark.skipif(
    not FOLDER.is_dir(), reason="the recorded contact trials are absent (FOOTIK_SHARED)"
)


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    return read_trials(FOLDER)


def overall(trials: list[Trial]) -> float:
    return score_trials(trials, ours)["all"]["F1 at 0 ms"]


@shared
def test_contacts_of_recorded_trials_are_found(trials):
    rows = score_trials(trials, ours)
    assert rows["all"]["F1 at 0 ms"] >= 0.985
    assert min(row["F1 at 0 ms"] for row in rows.values()) >= 0.93


@shared
def test_noise_of_three_centimetres_costs_little(trials):
    noisy = [overall([with_noise(t, 0.03, seed) for t in trials]) for seed in range(3)]
    assert overall(trials) - np.mean(noisy) <= 0.03


@shared
def test_a_root_that_drifts_by_eight_centimetres_costs_little(trials):
    assert overall(trials) - overall([with_drift(t, 0.08) for t in trials]) <= 0.02


@shared
def test_gaps_and_low_rates_cost_little(trials):
    rng = np.random.default_rng(0)
    for trial in trials:
        for points in (trial.heel, trial.toe):
            for start in rng.integers(0, len(points), 2 * int(len(points) / trial.fps)):
                points[start : start + round(0.06 * trial.fps), rng.integers(0, 2)] = np.nan
    assert overall(trials) >= 0.98


# --- generated gaits ----------------------------------------------------------------------------

RIG = humanoid_rig()
SCALE = float(RIG.leg_lengths.mean()) / 0.85


def walked(clip, cycles: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Heels and balls (T, F, 2, 3) of a few cycles, and their phases (T, F)."""
    times = np.arange(int(cycles * clip.duration * clip.fps)) / clip.fps
    poses = [clip.sample(time) for time in times]
    turns = np.array([pose.rotations for pose in poses])
    roots = np.array([pose.root_position for pose in poses])
    soles = all_sole_points(RIG, *clip.skeleton.forward(turns, roots))
    frames = np.arange(len(times)) % (len(clip) - 1)
    phases = [clip.curves[phase_curve(leg.name)][frames] for leg in RIG.legs]
    return soles[:, :, :2], np.stack(phases, axis=1).round().astype(int)


def agreement(points, phases, fps, scale=SCALE) -> float:
    inner = slice(10, -10)
    found = contacts(points, fps, scale=scale).foot
    return contact_f1(found[inner], (phases != Phase.SWING)[inner])


@pytest.mark.parametrize("speed", [0.5, 0.9, 1.3, 1.8])
def test_walks_are_found_on_the_flat_on_slopes_and_on_stairs(speed):
    clip = gait.walk(RIG, speed=speed)
    points, phases = walked(clip)
    assert agreement(points, phases, clip.fps) >= 0.95
    slope = points + points[..., :1] * np.array([0.0, 0.0, 0.27])
    assert agreement(slope, phases, clip.fps) >= 0.95
    moved = points - clip.stride()[0] * (np.arange(len(points)) / clip.fps / clip.duration)[
        :, None, None, None
    ]  # fmt: skip
    assert agreement(moved, phases, clip.fps) >= 0.93, "in place, as on a treadmill"


def test_runs_and_turns_are_found():
    for clip, least in ((gait.run(RIG, speed=3.0), 0.9), (gait.turn_in_place(RIG), 0.93)):
        assert agreement(*walked(clip), clip.fps) >= least


def test_one_who_stands_is_in_contact_always():
    clip = gait.idle(RIG)
    points, _ = walked(clip, 1)
    assert contacts(points, clip.fps, scale=SCALE).foot.all()


def test_a_foot_held_up_beside_a_standing_one_is_not_in_contact():
    points = np.zeros((300, 2, 2, 3))
    points[:, 1, :, 1] = 0.2
    lifted = np.interp(np.arange(300), [80, 100, 200, 220], [0.0, 0.25, 0.25, 0.0])
    points[:, 0, :, 2] = lifted[:, None]
    found = contacts(points, 100.0).foot
    assert found[:70].all()
    assert found[:, 1].all()
    assert not found[105:195, 0].any()
    assert found[230:].all()


def test_twice_the_body_at_twice_the_scale_is_the_same_to_the_bit():
    clip = gait.walk(RIG, speed=1.2)
    points, _ = walked(clip, 2)
    small, large = contacts(points, 60.0), contacts(2.0 * points, 60.0, scale=2.0)
    assert (small.down == large.down).all()
    assert (small.confidence == large.confidence).all()
    np.testing.assert_array_equal(2.0 * small.ground, large.ground)


def test_ground_is_the_height_of_the_contact_that_holds_a_frame():
    clip = gait.walk(RIG, speed=1.2)
    points, _ = walked(clip)
    points[..., 2] += 0.7
    found = contacts(points, clip.fps, scale=SCALE)
    assert np.abs(found.ground[found.down] - 0.7).max() < 0.03
    assert found.confidence[found.down].mean() > 0.7
    assert found.confidence[~found.down].mean() < 0.3


@pytest.mark.parametrize("frames", [0, 1, 2, 3, 7])
def test_few_frames_and_points_never_seen_are_finite(frames):
    for points in (np.zeros((frames, 2, 2, 3)), np.full((frames, 2, 2, 3), np.nan)):
        found = contacts(points, 30.0)
        assert found.down.shape == (frames, 2, 2)
        assert np.isfinite(found.confidence).all()
        assert np.isfinite(found.ground).all()


def test_a_long_gap_is_no_contact_and_a_short_one_is_bridged():
    points = np.zeros((200, 1, 2, 3))
    points[50:55] = np.nan
    points[100:160] = np.nan
    found = contacts(points, 100.0)
    assert found.foot[:99].all()
    assert not found.foot[101:159].any()
    assert (found.confidence[110:150] == 0.0).all()


@pytest.mark.parametrize(
    ("points", "fps", "scale", "words"),
    [
        (np.zeros((5, 2, 3)), 30.0, 1.0, r"must have shape \(T, F, 2, 3\)"),
        (np.zeros((5, 2, 2, 3)), 0.0, 1.0, "fps and scale must be positive"),
        (np.zeros((5, 2, 2, 3)), 30.0, np.nan, "fps and scale must be positive"),
    ],
)
def test_what_cannot_be_looked_at_is_an_error(points, fps, scale, words):
    with pytest.raises(FootIKError, match=words):
        contacts(points, fps, scale=scale)


def test_a_file_that_is_no_trial_is_one_error(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"PK no")
    np.savez(tmp_path / "b.npz", fps=100.0, heel=np.zeros((4, 2, 3)))
    flat = {name: np.zeros((4, 2)) for name in ("heel", "ankle", "toe", "contact", "known")}
    np.savez(tmp_path / "c.npz", fps=100.0, **flat)  # pyright: ignore[reportArgumentType]
    for name, words in (("a", "no trial"), ("b", "a trial needs"), ("c", "heel must have shape")):
        with pytest.raises(FootIKError, match=words):
            read_trial(tmp_path / f"{name}.npz")
    with pytest.raises(FootIKError, match="there are no trials"):
        read_trials(tmp_path / "nowhere")
