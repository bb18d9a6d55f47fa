"""Hinge legs: the solver against finite differences, the offline one, MuJoCo and random chains."""

import mujoco
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from qpos_robot import robot, trajectory

from footik_runtime import quat_arrays as qa
from footik_runtime.hinge_character import HingeCharacter
from footik_runtime.hinge_ik import (
    HINGE,
    clamp_hinges,
    forward_hinges,
    goal_weights,
    new_work,
    solve_hinges,
)
from footik_runtime.math3d import get3, get4, quat_angle
from footik_runtime.offline.hinge_legs import Hinge, Link
from footik_runtime.offline.hinge_legs import solve_hinges as solve_offline
from footik_runtime.rig_model import find_rig_in_model

HERE = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
MIDDLE = (0.0, 0.0, 0.0)
MOST = 9
BENT = [0.1, -0.1, -0.4, 0.9, -0.4, 0.1]  # yaw, roll and pitch of the hip, knee, ankle


def random_chain(rng, count, limit=1.5):
    hinges = np.zeros(count, dtype=HINGE)
    for hinge in hinges:
        hinge["place"], hinge["anchor"] = rng.normal(0.0, 0.2, 3), rng.normal(0.0, 0.03, 3)
        hinge["turn"], axis = qa.unit(rng.normal(size=4)), rng.normal(size=3)
        hinge["axis"], hinge["zero"] = axis / np.linalg.norm(axis), rng.normal(0.0, 0.2)
        hinge["low"], hinge["high"] = -limit, limit
    return hinges


def end_of(hinges, angles, base=HERE):
    work = new_work(MOST)
    at, turn = base
    return forward_hinges(hinges, np.array(angles, dtype=float), at, turn, work.axes, work.anchors)


def solved(hinges, start, goal, weights=(1.0, 0.02), base=HERE, point=MIDDLE):
    angles = np.array(start, dtype=float)
    missing = solve_hinges(hinges, angles, base, point, goal, weights, new_work(MOST))
    return angles, *missing


@pytest.fixture(scope="module")
def left_leg():
    """The hinges of the generated robot's left leg: six, with anchors off the bodies' origins."""
    model = robot()
    character = HingeCharacter.bind(model, find_rig_in_model(model))
    return character.chains[0][: character.legs[0]["count"]]


def test_forward_agrees_with_mujoco():
    model = robot()
    rig = find_rig_in_model(model)
    character = HingeCharacter.bind(model, rig)
    data = mujoco.MjData(model)
    for row in trajectory(model, 10):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        values = row[character.addresses]
        for leg, own, chain in zip(rig.legs, character.legs, character.chains, strict=True):
            hinges = chain[: own["count"]]
            base = (get3(data.xpos[1]), get4(data.xquat[1]))
            at, turn = end_of(hinges, values[hinges["column"]], base)
            body = model.body(rig.skeleton.names[leg.ankle]).id
            np.testing.assert_allclose(at, data.xpos[body], atol=1e-12)
            assert quat_angle(turn, get4(data.xquat[body])) < 1e-7


def test_axes_and_anchors_are_the_derivatives():
    hinges = random_chain(np.random.default_rng(3), 7)
    angles = np.linspace(-1.0, 1.0, 7)
    work = new_work(7)
    place, _ = forward_hinges(hinges, angles, *HERE, work.axes, work.anchors)
    axes, anchors = work.axes.copy(), work.anchors.copy()
    for h in range(7):
        ends = []
        for step in (-1e-6, 1e-6):
            moved = angles.copy()
            moved[h] += step
            ends.append(end_of(hinges, moved))
        slope = (np.array(ends[1][0]) - ends[0][0]) / 2e-6
        np.testing.assert_allclose(
            slope, np.cross(axes[h], np.array(place) - anchors[h]), atol=1e-8
        )
        turn = qa.to_rotvec(qa.mul(ends[1][1], qa.conj(np.array(ends[0][1])))) / 2e-6
        np.testing.assert_allclose(turn, axes[h], atol=1e-8)


def test_angles_are_those_of_the_offline_solver(left_leg):
    links = tuple(
        Link(
            offset=np.array(h["place"]),
            turn=np.array(h["turn"]),
            hinges=(
                Hinge(
                    column=i,
                    axis=np.array(h["axis"]),
                    anchor=np.array(h["anchor"]),
                    zero=float(h["zero"]),
                ),
            ),
        )
        for i, h in enumerate(left_leg)
    )
    rng = np.random.default_rng(1)
    for _ in range(20):
        goal = end_of(left_leg, BENT + rng.uniform(-0.1, 0.1, 6))
        ours, off, turned = solved(left_leg, BENT, goal)
        theirs = solve_offline(
            links,
            np.array(BENT)[None],
            (np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]])),
            (np.array(goal[0])[None], np.array(goal[1])[None]),
            (left_leg["low"], left_leg["high"]),
        )
        assert off < 1e-8
        assert turned < 1e-7
        np.testing.assert_allclose(ours, theirs.angles[0], atol=1e-6)


numbers = st.floats(-1e3, 1e3) | st.sampled_from([0.0, 1e-300, 1e5])


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, MOST),
    place=st.tuples(numbers, numbers, numbers),
    weight=st.sampled_from([0.0, 1e-3, 0.03, 1.0]),
)
def test_whatever_is_asked_angles_are_finite_and_within_limits(seed, count, place, weight):
    rng = np.random.default_rng(seed)
    hinges = random_chain(rng, count, limit=rng.uniform(0.0, 2.0))
    start = rng.uniform(-4.0, 4.0, count)
    goal = (place, tuple(qa.unit(rng.normal(size=4))))
    angles, off, turned = solved(hinges, start, goal, (1.0, weight))
    assert np.isfinite([*angles, off, turned]).all()
    assert (np.clip(angles, hinges["low"], hinges["high"]) == angles).all()
    # What is told to be missing is what is missing.
    at, turn = end_of(hinges, angles)
    assert off == pytest.approx(np.linalg.norm(np.array(place) - at), rel=1e-9, abs=1e-12)
    assert turned == pytest.approx(quat_angle(goal[1], turn), abs=1e-6)
    again = solved(hinges, start, goal, (1.0, weight))
    assert np.array_equal(angles, again[0])
    assert (off, turned) == again[1:]


bends = st.lists(st.floats(-0.4, 0.4), min_size=6, max_size=6)
nudges = st.lists(st.floats(-0.15, 0.15), min_size=6, max_size=6)


@given(bends, nudges)
def test_a_goal_in_reach_is_reached(left_leg, bend, nudge):
    there = np.array(BENT) + bend
    clamp_hinges(left_leg, there)
    assume(there[3] > 0.3)  # a straight knee says nothing of how to bend
    _, off, turned = solved(left_leg, there + nudge, end_of(left_leg, there))
    assert off < 1e-4
    assert turned < 1e-3


def test_with_too_few_hinges_the_place_goes_first():
    hinges = np.zeros(3, dtype=HINGE)
    hinges["turn"] = [1.0, 0.0, 0.0, 0.0]
    hinges["place"] = [[0.2, 0.1, 0.0], [0.0, 0.08, 0.0], [0.0, 0.0, -0.2]]
    hinges["axis"] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0]]
    hinges["low"], hinges["high"] = [-0.9, -0.7, -2.8], [0.9, 4.5, -0.8]
    end = (0.0, 0.0, -0.2)
    level = (1.0, 0.0, 0.0, 0.0)
    for place in ((0.15, 0.2, -0.3), (0.25, 0.15, -0.25), (0.2, 0.25, -0.32)):
        start = [0.0, 0.9, -1.8]
        goal = (place, level)
        weights = goal_weights(3, 0.4, False)
        _, off, turned = solved(hinges, start, goal, weights, point=end)
        assert off < 2e-6
        assert turned > 0.05
        _, off, _ = solved(hinges, start, goal, goal_weights(3, 0.4, True), point=end)
        assert off < 1e-9


def test_out_of_reach_it_comes_as_near_as_the_leg_is_long(left_leg):
    far = (0.3, 0.1, -2.0)
    angles, off, _ = solved(left_leg, BENT, (far, HERE[1]), (1.0, 0.0))
    tries = np.random.default_rng(0).uniform(left_leg["low"], left_leg["high"], (2000, 6))
    best = min(np.linalg.norm(np.array(far) - end_of(left_leg, row)[0]) for row in tries)
    assert off <= best
    again = solved(left_leg, angles, (far, HERE[1]), (1.0, 0.0))
    np.testing.assert_allclose(again[0], angles, atol=1e-3)


def test_a_goal_beyond_a_limit_stops_there_and_says_how_far_off_it_is(left_leg):
    hinges = left_leg.copy()
    beyond = [*BENT[:5], BENT[5] + 0.4]
    goal = end_of(hinges, beyond)
    hinges["high"][5] = 0.2
    angles, off, turned = solved(hinges, BENT, goal, goal_weights(6, 0.8, False))
    assert angles[5] == 0.2
    assert 0.2 < turned < 0.31
    assert off < 1e-3


def test_nothing_jumps_on_the_way_through_limits_and_out_of_reach(left_leg):
    base = np.array(end_of(left_leg, BENT)[0])
    angles, steps = np.array(BENT), []
    for t in np.linspace(0.0, 2.0 * np.pi, 400):
        away = (0.5 * np.sin(t), 0.2 * np.sin(2.0 * t), 0.2 * (1.0 - np.cos(t)) - 0.1)
        goal = (tuple(base + away), HERE[1])
        now, _, _ = solved(left_leg, angles, goal, goal_weights(6, 0.8, False))
        steps.append(np.abs(now - angles).max())
        angles = now
    assert max(steps[1:]) < 0.15


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e200])
def test_a_goal_that_is_no_number_leaves_the_leg_where_it_is(left_leg, bad):
    angles, off, turned = solved(left_leg, [*BENT[:5], 9.0], ((bad, 0.0, 0.0), HERE[1]))
    assert off == turned == np.inf
    np.testing.assert_array_equal(angles, [*BENT[:5], left_leg["high"][5]])
    angles, *_ = solved(left_leg, [np.nan, *BENT[1:]], end_of(left_leg, BENT))
    assert np.isfinite(angles).all()
