from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from footik_runtime import gait
from footik_runtime.builtin import humanoid_rig
from footik_runtime.offline.root import place
from footik_runtime.offline.skate import working_of
from footik_runtime.offline.solve_legs import solve, usable_lengths
from footik_runtime.offline.stages import CleanSettings, FootPaths

RIG = humanoid_rig()
WALK = gait.walk(RIG)
WORK = working_of(WALK, RIG)
SETTINGS = CleanSettings()
ANKLES = [leg.ankle for leg in RIG.legs]
HIPS = [leg.hip for leg in RIG.legs]


def paths(moves, pinned=None):
    still = np.zeros_like(moves)
    pinned = moves.any(axis=-1) if pinned is None else pinned
    return FootPaths(moves=moves, turns=still, toe_turns=still, pinned=pinned)


def lacks(work, moves, root, chosen=SETTINGS):
    """(N, F) how much farther than its leg reaches each goal is, m."""
    hips = work.positions[:, HIPS] + root[:, None]
    goals = work.positions[:, ANKLES] + moves
    return np.linalg.norm(goals - hips, axis=-1) - usable_lengths(work, chosen)


def test_nothing_asked_moves_nothing():
    assert not place(WORK, paths(np.zeros((len(WALK), 2, 3))), SETTINGS).any()


def test_frames_far_from_all_that_is_asked_stay_exactly():
    long = working_of(replace(WALK, root_positions=WALK.root_positions), RIG)
    moves = np.zeros((len(WALK), 2, 3))
    moves[:3, 0] = [0.01, 0.0, 0.0]
    root = place(long, paths(moves), CleanSettings(root_window=0.03))
    assert root[:3].any()
    assert not root[30:].any()


@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.floats(0.0, 0.12),
    follow=st.floats(0.0, 1.0),
    window=st.floats(0.0, 0.4),
)
@settings(max_examples=60)
def test_every_foot_is_reached(seed, size, follow, window):
    rng = np.random.default_rng(seed)
    moves = np.zeros((len(WALK), 2, 3))
    for _ in range(4):
        start, foot = rng.integers(0, len(WALK) - 4), rng.integers(0, 2)
        moves[start : start + rng.integers(3, 25), foot] = rng.uniform(-size, size, 3)
    chosen = CleanSettings(root_follow=follow, root_window=window)
    root = place(WORK, paths(moves), chosen)
    assert np.isfinite(root).all()
    assert lacks(WORK, moves, root, chosen).max() < 2e-8
    assert solve(WORK, paths(moves), root, chosen)[2].all()


def test_the_root_follows_a_shared_move():
    moves = np.tile([0.03, -0.02, 0.01], (len(WALK), 2, 1))
    for follow in (0.25, 0.5, 1.0):
        chosen = CleanSettings(root_follow=follow, reach=1.0)
        root = place(WORK, paths(moves), chosen)
        assert np.median(np.abs(root - follow * moves[:, 0])) < 0.004
    root = place(WORK, paths(moves), CleanSettings(root_follow=1.0))
    assert np.abs(root - moves[:, 0]).max() < 1e-9


def test_the_root_moves_smoothly_where_a_foot_is_suddenly_far():
    moves = np.zeros((len(WALK), 2, 3))
    moves[20:26, 0] = [0.0, 0.0, -0.05]
    root = place(WORK, paths(moves), SETTINGS)
    assert lacks(WORK, moves, root).max() < 1e-9
    speed = np.abs(np.diff(root[:, 2])).max() * WALK.fps
    assert speed < 0.05 / 0.1


def test_feet_out_of_all_reach_leave_the_body_near():
    moves = np.zeros((len(WALK), 2, 3))
    moves[10:40, 0], moves[10:40, 1] = [3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]
    root = place(WORK, paths(moves), SETTINGS)
    assert np.isfinite(root).all()
    assert np.linalg.norm(root, axis=-1).max() < 0.5 * RIG.leg_lengths.mean()


def test_the_root_goes_where_the_feet_go_rather_than_down():
    moves = np.zeros((len(WALK), 2, 3))
    moves[10:50] = [0.0, 0.45, 0.0]
    root = place(WORK, paths(moves), CleanSettings(root_follow=0.0))
    assert root[20:40, 1].mean() > 0.02
    assert lacks(WORK, moves, root).max() < 1e-9


def test_stretch_spares_the_root():
    moves = np.zeros((len(WALK), 2, 3))
    moves[10:40] = [0.0, 0.0, -0.01]
    stiff = place(WORK, paths(moves), CleanSettings(root_follow=0.0))
    loose = place(WORK, paths(moves), CleanSettings(root_follow=0.0, stretch=0.03))
    assert np.abs(loose).max() < 0.5 * np.abs(stiff).max()


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_few_frames(frames):
    clip = WALK.cut(0, frames)
    moves = np.full((frames, 2, 3), 0.01)
    root = place(working_of(clip, RIG), paths(moves), SETTINGS)
    assert root.shape == (frames, 3)
    assert np.isfinite(root).all()


def test_a_giant_and_a_child_move_alike():
    moves = np.zeros((len(WALK), 2, 3))
    moves[10:40, 0] = [0.01, 0.02, -0.02]
    root = place(WORK, paths(moves), SETTINGS)
    for size in (0.5, 2.0):
        skeleton = replace(RIG.skeleton, offsets=RIG.skeleton.offsets * size)
        rig = replace(RIG, skeleton=skeleton)
        clip = replace(WALK, skeleton=skeleton, root_positions=WALK.root_positions * size)
        other = place(working_of(clip, rig), paths(moves * size), SETTINGS)
        assert np.abs(other - size * root).max() < 1e-6
