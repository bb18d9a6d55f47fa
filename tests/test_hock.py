"""The hock: knee and hock fold together, and nothing happens where the leg is as long as it was."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footik_runtime import quat_arrays as qa
from footik_runtime.builtin import humanoid_rig, quadruped_rig
from footik_runtime.hock import fold_hock, folding_hock, unfolded_length
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
def test_the_lower_part_keeps_its_share_of_the_leg(ratio):
    goal = tuple(np.add(HIP, ratio * np.subtract(PAW, HIP)))
    turn, paw = fold_hock(HIP, KNEE, HOCK, PAW, goal, LEFT)
    assert length(KNEE, paw) == pytest.approx(ratio * length(KNEE, PAW), rel=1e-9)
    assert length(HOCK, paw) == pytest.approx(length(HOCK, PAW), rel=1e-12)
    moved = qa.rotate(np.array(turn), np.subtract(PAW, HOCK))
    np.testing.assert_allclose(np.add(HOCK, moved), paw, atol=1e-12)


@pytest.mark.parametrize("goal", [PAW, (0.2, 0.0, 0.44)])
def test_a_goal_as_far_off_as_the_paw_bends_nothing(goal):
    far = length(PAW, HIP) / length(goal, HIP)
    goal = tuple(np.add(HIP, far * np.subtract(goal, HIP)))
    turn, paw = fold_hock(HIP, KNEE, HOCK, PAW, goal, LEFT)
    np.testing.assert_allclose(turn, [1.0, 0.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(paw, PAW, atol=1e-12)


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_any_goal_leaves_a_leg_of_the_same_bones(goal):
    turn, paw = fold_hock(HIP, KNEE, HOCK, PAW, goal, LEFT)
    assert np.isfinite(turn).all()
    assert length(HOCK, paw) == pytest.approx(length(HOCK, PAW), rel=1e-9)


def test_bones_of_no_length_and_straight_ones_do_no_harm():
    for hock in (KNEE, PAW, tuple(np.add(KNEE, PAW) / 2.0)):
        turn, paw = fold_hock(HIP, KNEE, hock, PAW, (-0.3, 0.0, 0.2), (0.0, 0.0, 0.0))
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
