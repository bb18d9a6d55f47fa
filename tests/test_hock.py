"""The hock: knee and hock fold together, and nothing turns where the paw stays."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footik_runtime import quat_arrays as qa
from footik_runtime.builtin import humanoid_rig, quadruped_rig
from footik_runtime.hock import fold, folding_hock, three_bone, unfolded_length
from footik_runtime.legs import leg_records

HIP, KNEE, HOCK, PAW = (
    (-0.30, 0.0, 0.56),
    (-0.22, 0.01, 0.33),
    (-0.41, 0.0, 0.16),
    (-0.37, 0.0, 0.036),
)
LEFT = (0.0, 1.0, 0.0)


def length(a, b) -> float:
    return float(np.linalg.norm(np.subtract(a, b)))


@given(st.floats(0.75, 1.1))
def test_two_bones_fold_to_a_part_of_their_span(ratio):
    turn, paw = fold(KNEE, HOCK, PAW, ratio, LEFT)
    assert length(KNEE, paw) == pytest.approx(ratio * length(KNEE, PAW), rel=1e-9)
    assert length(HOCK, paw) == pytest.approx(length(HOCK, PAW), rel=1e-12)
    moved = qa.rotate(np.array(turn), np.subtract(PAW, HOCK))
    np.testing.assert_allclose(np.add(HOCK, moved), paw, atol=1e-12)


def solved(goal, turns_hock, usable=0.62):
    """Knee, hock and ankle that the turns lead to, and what `three_bone` says of the ankle."""
    turns = three_bone(HIP, KNEE, HOCK, PAW, goal, LEFT, usable, turns_hock)
    at = [np.array(HIP)]
    bones = (np.subtract(KNEE, HIP), np.subtract(HOCK, KNEE), np.subtract(PAW, HOCK))
    for turn, bone in zip(turns[:3], bones, strict=True):
        at.append(at[-1] + qa.rotate(np.array(turn), bone))
    return at[1:], turns[3], turns[4]


@pytest.mark.parametrize("turns_hock", [False, True])
@given(st.floats(-0.2, 0.2), st.floats(-0.1, 0.1), st.floats(0.0, 0.12))
def test_the_paw_comes_to_its_goal_and_the_bones_to_the_paw(turns_hock, x, y, z):
    goal = (PAW[0] + x, PAW[1] + y, PAW[2] + z)
    (knee, hock, paw), said, reached = solved(goal, turns_hock)
    np.testing.assert_allclose(paw, said, atol=1e-9)
    assert reached == (length(paw, goal) < 1e-5)
    if length(goal, HIP) < 0.58:
        np.testing.assert_allclose(paw, goal, atol=1e-6)
        # Knee ahead of the hock, as it was: nothing has turned over.
        assert (hock - knee) @ np.subtract(HOCK, KNEE) > 0.0


@pytest.mark.parametrize("turns_hock", [False, True])
def test_a_goal_where_the_paw_is_turns_nothing(turns_hock):
    turns = three_bone(HIP, KNEE, HOCK, PAW, PAW, LEFT, 0.62, turns_hock)
    for turn in turns[:3]:
        np.testing.assert_allclose(turn, [1.0, 0.0, 0.0, 0.0], atol=1e-7)
    assert turns[4]


@pytest.mark.parametrize("turns_hock", [False, True])
@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_any_goal_leaves_finite_turns(turns_hock, goal):
    (_, _, paw), said, _ = solved(goal, turns_hock)
    assert np.isfinite(paw).all()
    np.testing.assert_allclose(paw, said, atol=1e-9)


def test_bones_of_no_length_and_straight_ones_do_no_harm():
    for hock in (KNEE, PAW, tuple(np.add(KNEE, PAW) / 2.0)):
        turn, paw = fold(KNEE, hock, PAW, 0.8, (0.0, 0.0, 0.0))
        assert np.isfinite([*turn, *paw]).all()


def test_legs_know_their_hock_and_which_way_their_knee_points():
    rig = quadruped_rig()
    for leg, record in zip(rig.legs, leg_records(rig), strict=True):
        hind = leg.name.endswith("hind")
        assert record["hock"] == folding_hock(rig, leg)
        assert (record["hock"] >= 0) == hind
        # An elbow bends about the right.
        np.testing.assert_allclose(record["hinge"], [0.0, 1.0 if hind else -1.0, 0.0], atol=1e-9)
        if hind:
            assert record["length"] == pytest.approx(unfolded_length(rig, leg))
    for leg, record in zip(humanoid_rig().legs, leg_records(humanoid_rig()), strict=True):
        assert record["hock"] == -1, leg.name
        np.testing.assert_allclose(record["hinge"], [0.0, 1.0, 0.0], atol=1e-9)
