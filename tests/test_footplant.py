"""FootPlant's rules, each by itself, and the pass on a clip in metres."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footik_runtime import quat_arrays as qa
from footik_runtime.builtin import builtin_motion
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.offline.footplant import (
    FootPlantOptions,
    LegJoints,
    clean,
    clean_frames,
    detect,
    ground_height,
    weights,
)
from footik_runtime.offline.footplant_solve import leg_turns, softened
from footik_runtime.phases import Phase
from footik_runtime.rig import Rig

UP = np.array([0.0, 0.0, 1.0])
FPS = 30.0
coordinate = st.floats(-1.0, 1.0)
vector = st.tuples(coordinate, coordinate, coordinate)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return builtin_motion("idle").rig


def sliding(speeds, heights=None):
    """An ankle (T, 3) that moves along x at these speeds (T - 1,), cm/s."""
    x = np.concatenate([[0.0], np.cumsum(np.asarray(speeds) / FPS)])
    z = np.zeros(len(x)) if heights is None else np.asarray(heights, dtype=float)
    return np.stack([x, 0 * x, z], axis=-1)


def crouched(rig, frames, slide=0.0, knee=0.6, away=0.6):
    """The rest pose with bent knees; it slides by so much a second, then `away` a second."""
    rotations = np.tile(rig.skeleton.rest_rotations, (frames, 1, 1))
    for leg in rig.legs:
        for joint, angle in ((leg.hip, -0.5 * knee), (leg.knee, knee), (leg.ankle, -0.5 * knee)):
            rotations[:, joint] = qa.mul(rotations[:, joint], qa.about([0.0, 1.0, 0.0], angle))
    place = np.tile(rig.skeleton.offsets[0], (frames, 1))
    speed = np.where(np.arange(frames) < 3 * frames // 4, slide, away)
    place[1:, 0] += np.cumsum(speed[1:]) / FPS
    return Clip(skeleton=rig.skeleton, fps=FPS, root_positions=place, rotations=rotations)


def ankle_paths(clip, rig):
    return clip.model_pose()[0][:, [leg.ankle for leg in rig.legs]]


def test_the_ground_is_what_a_twentieth_of_the_lower_ankles_reach():
    heights = np.arange(41.0)
    ankles = np.zeros((41, 2, 3))
    ankles[:, 0, 2], ankles[:, 1, 2] = heights[::-1], 100.0
    assert ground_height(ankles, UP) == 2.0  # floor(.05 * 40)
    assert ground_height(ankles[:, :, [0, 2, 1]], np.array([0.0, 1.0, 0.0])) == 2.0
    assert ground_height(ankles[:0], UP) == 0.0


def test_a_plant_is_entered_low_and_slow_and_lasts_until_1_5_times_that():
    speeds = np.array([20.0, 11.0, 11.0, 7.0, 7.0, 7.0, 11.0, 11.0, 11.0, 20.0, 11.0, 11.0])
    # Central differences: frame i has the mean of its two neighbours' steps.
    assert detect(sliding(speeds), 0.0, FPS, UP) == [(4, 8)]
    high = np.where(np.arange(13) == 6, 5.9, 0.0)
    assert detect(sliding(np.zeros(12), high)[:, :], 0.0, 1.0, UP) == [(0, 12)]
    assert detect(sliding(np.zeros(12), np.full(13, 4.1)), 0.0, FPS, UP) == []
    assert detect(sliding(np.zeros(12), np.full(13, 4.1)), 0.2, FPS, UP) == [(0, 12)]


def test_what_only_stays_before_any_entry_is_no_plant():
    speeds = np.array([11.0] * 5 + [20.0] * 3)
    assert detect(sliding(speeds), 0.0, FPS, UP) == []


def test_short_plants_and_short_clips_have_none():
    speeds = np.array([50.0, 50.0, 0.0, 0.0, 0.0, 50.0, 50.0])
    assert detect(sliding(speeds), 0.0, FPS, UP) == []  # two frames are slow
    speeds = np.array([50.0, 50.0, 0.0, 0.0, 0.0, 0.0, 50.0, 50.0])
    assert detect(sliding(speeds), 0.0, FPS, UP) == [(3, 5)]
    assert detect(sliding([0.0]), 0.0, FPS, UP) == []


def test_weights_fade_over_the_blend_and_leave_other_plants_alone():
    fade = weights([(5, 8)], 0, 14, 3)
    np.testing.assert_allclose(fade[5:9], 1.0)
    for k in (1, 2, 3):
        t = 1.0 - k / 4.0
        assert fade[5 - k] == fade[8 + k] == pytest.approx(t * t * (3 - 2 * t))
    assert fade[0] == fade[1] == fade[12] == 0.0
    near = weights([(0, 3), (6, 9)], 1, 12, 3)
    assert near[3] == 0.0
    assert near[4] > 0.0


@given(vector, vector, vector, vector, vector, st.sampled_from([0.0, 0.02, 0.2]))
def test_a_leg_reaches_what_it_can_and_keeps_its_lengths(hip, knee, ankle, target, axis, soften):
    upper, lower = leg_turns(hip, knee, ankle, target, axis, soften)
    a, b, c, goal = (np.array(v) for v in (hip, knee, ankle, target))
    l1, l2 = np.linalg.norm(b - a), np.linalg.norm(c - b)
    assert np.isfinite([*upper, *lower]).all()
    assert np.linalg.norm(upper) == pytest.approx(1.0)
    assert np.linalg.norm(lower) == pytest.approx(1.0)
    if min(l1, l2) < 0.05 or np.linalg.norm(c - a) < 0.05:
        return
    end = a + qa.rotate(upper, b - a) + qa.rotate(lower, c - b)
    distance = np.linalg.norm(goal - a)
    if abs(l1 - l2) + 1e-6 < distance < (l1 + l2) * (1 - max(soften, 1e-4)):
        np.testing.assert_allclose(end, goal, atol=1e-6)
    elif distance > l1 + l2 and not soften:
        straight = (l1 + l2) * (1 - 1e-5)
        np.testing.assert_allclose(end, a + (goal - a) / distance * straight, atol=1e-6)


def test_softening_begins_with_slope_one_and_never_reaches_the_length():
    assert softened(0.89, 1.0, 0.1) == 0.89
    assert softened(0.9 + 1e-6, 1.0, 0.1) == pytest.approx(0.9 + 1e-6, abs=1e-10)
    assert 0.999 < softened(5.0, 1.0, 0.1) <= 1.0
    assert softened(5.0, 1.0, 0.0) == 5.0


def test_planted_ankles_are_held_and_the_other_frames_are_left(rig):
    clip = crouched(rig, 40, slide=0.05)
    done = clean(clip, rig)
    before, after = ankle_paths(clip, rig), ankle_paths(done.clip, rig)
    assert [p["plants"] for p in done.report["feet"].values()] == [[[0, 28]], [[0, 28]]]
    held = after[:29]
    assert np.abs(held - held[0]).max() < 1e-6
    np.testing.assert_allclose(held[0], before[:29].mean(axis=0), atol=1e-6)
    assert np.array_equal(done.clip.rotations[32:], clip.rotations[32:])
    assert np.array_equal(done.clip.root_positions, clip.root_positions)
    feet = [leg.ankle for leg in rig.legs]
    turned = qa.mul(qa.conj(clip.model_pose()[1]), done.clip.model_pose()[1])[:, feet]
    assert np.linalg.norm(qa.to_rotvec(turned), axis=-1).max() < 1e-7
    others = [
        j for j in range(len(rig.skeleton)) if j not in {
            i for leg in rig.legs for i in (leg.hip, leg.knee, leg.ankle)
        }
    ]  # fmt: skip
    assert np.array_equal(done.clip.rotations[:, others], clip.rotations[:, others])
    assert done.clip.translations is None
    assert done.phases[10, 0] == Phase.FLAT
    assert done.phases[35, 0] == Phase.SWING


def test_a_perfect_plant_is_left_to_the_last_bit(rig):
    clip = crouched(rig, 30, away=0.0)
    done = clean(clip, rig)
    assert done.plants
    assert np.array_equal(done.clip.rotations, clip.rotations)
    assert done.report["feet"]["left"]["largest_move"] == 0.0


def test_a_leg_that_cannot_reach_is_stretched_by_at_most_the_share(rig):
    clip = crouched(rig, 40, slide=0.25, knee=0.05, away=0.25)
    for stretch in (0.0, 0.02):
        done = clean(clip, rig, FootPlantOptions(speed=0.4, height=0.04, stretch=stretch))
        if not stretch:
            assert done.clip.translations is None
            continue
        assert done.clip.translations is not None
        share = np.linalg.norm(done.clip.translations, axis=-1) / np.maximum(
            np.linalg.norm(rig.skeleton.offsets, axis=-1), 1e-12
        )
        leg = rig.legs[0]
        assert 1.0005 < share[:, [leg.knee, leg.ankle]].max() <= 1.02 + 1e-12
        others = [j for j in range(1, len(rig.skeleton)) if np.ptp(share[:, j]) > 0]
        assert set(others) == {j for each in rig.legs for j in (each.knee, each.ankle)}


def test_thresholds_grow_with_the_body(rig):
    clip = crouched(rig, 40, slide=0.05)
    large = replace(rig.skeleton, offsets=rig.skeleton.offsets * 3.0)
    giant = replace(
        clip, skeleton=large, root_positions=clip.root_positions * 3.0, rotations=clip.rotations
    )
    ours, theirs = clean(clip, rig), clean(giant)
    assert [p.start for p in ours.plants] == [p.start for p in theirs.plants]
    assert [p.stop for p in ours.plants] == [p.stop for p in theirs.plants]


def test_clips_of_a_frame_or_two_are_left_alone(rig):
    for frames in (1, 2):
        clip = crouched(rig, 40, slide=1.0).cut(0, frames)
        done = clean(clip, rig)
        assert np.array_equal(done.clip.rotations, clip.rotations)
        assert done.plants == ()


def test_twist_bones_between_hip_and_ankle_turn_with_their_bone():
    """A chain root, hip, twist, knee, twist, ankle: held like one without twist bones."""
    parents = [-1, 0, 1, 2, 3, 4]
    frames = 20
    moves = np.tile(
        [[0, 0, 0.8], [0, 0, 0], [0, 0, -0.2], [0.02, 0, -0.2], [0, 0, -0.2], [-0.02, 0, -0.18]],
        (frames, 1, 1),
    ).astype(float)
    moves[:, 0, 0] = 0.002 * np.arange(frames)
    turns = np.tile([1.0, 0, 0, 0], (frames, 6, 1))
    leg = LegJoints(hip=1, knee=3, ankle=5, bend_axis=np.array([0.0, -1.0, 0.0]))
    done = clean_frames(
        moves, turns, parents, [leg], fps=FPS, options=FootPlantOptions().scaled(0.01)
    )
    assert np.abs(done.ankles[:, 0] - done.ankles[0, 0]).max() < 1e-6
    assert np.array_equal(done.local_rotations[:, [2, 4]], turns[:, [2, 4]])


def test_what_is_no_leg_or_no_threshold_is_refused():
    leg = LegJoints(hip=2, knee=1, ankle=0, bend_axis=UP)
    with pytest.raises(FootIKError, match="not a leg"):
        clean_frames(
            np.zeros((4, 3, 3)), np.tile([1.0, 0, 0, 0], (4, 3, 1)), [-1, 0, 1], [leg], fps=FPS
        )
    for bad in (math.nan, -1.0, math.inf):
        with pytest.raises(FootIKError, match="FootPlant's speed"):
            FootPlantOptions(speed=bad)
