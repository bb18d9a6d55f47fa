"""Leg IK: bones keep their lengths, ends come where they should, and nothing jumps or breaks."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from footik_runtime.compiled import compiled
from footik_runtime.leg_ik import (
    aim,
    heel_lift,
    knee_toward,
    shortfall,
    soft_length,
    soft_stretch,
    two_bone,
)
from footik_runtime.math3d import (
    add,
    angle_between,
    dot,
    norm,
    quat_angle,
    quat_axis_angle,
    quat_mul,
    quat_unit,
    rotate,
    sub,
)

LEFT, AHEAD, NONE = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)
IDENTITY = (1.0, 0.0, 0.0, 0.0)
HIP, KNEE, ANKLE = (0.0, 0.0, 0.9), (0.06, 0.0, 0.5), (-0.02, 0.0, 0.08)
UPPER, LOWER = norm(sub(KNEE, HIP)), norm(sub(ANKLE, KNEE))
FULL = UPPER + LOWER

coordinate = st.floats(-2.0, 2.0)
point = st.tuples(coordinate, coordinate, coordinate)
any_number = st.floats(allow_nan=False, allow_infinity=False)
any_point = st.tuples(any_number, any_number, any_number)
odd_point = st.one_of(st.just(NONE), point, any_point)
direction = point.filter(lambda v: norm(v) > 0.1)
weight = st.floats(0.0, 1.0)
rotation = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


def solved(hip, knee, ankle, goal, usable, pole=NONE, stretch=1.0, w=1.0, hinge=LEFT):
    """The new knee and ankle by the bones as they were turned, without stretch, and the answer."""
    answer = two_bone(hip, knee, ankle, goal, hinge, usable, pole, stretch, w)
    new_knee = add(hip, rotate(answer[0], sub(knee, hip)))
    return new_knee, add(new_knee, rotate(answer[1], sub(ankle, knee))), answer


@settings(max_examples=300, deadline=None)
@example(NONE, NONE, (0.0, 0.0, 1.0), NONE, NONE, 1.0)
@example(NONE, (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), AHEAD, NONE, 1.0)
@given(point, point, point, point, st.one_of(st.just(NONE), direction), weight)
def test_bones_keep_their_lengths_and_the_ankle_told_is_where_they_end(h, k, a, goal, pole, w):
    usable = 0.97 * (norm(sub(k, h)) + norm(sub(a, k)))
    knee, ankle, (thigh, shin, told, _) = solved(h, k, a, goal, usable, pole, w=w)
    for turn in (thigh, shin):
        assert np.linalg.norm(turn) == pytest.approx(1.0, abs=1e-12)
    assert norm(sub(knee, h)) == pytest.approx(norm(sub(k, h)), abs=1e-12)
    assert norm(sub(ankle, knee)) == pytest.approx(norm(sub(a, k)), abs=1e-12)
    assert np.allclose(ankle, told, rtol=0.0, atol=1e-9)


@settings(max_examples=300, deadline=None)
@given(point, point, point, point, direction, st.sampled_from([0.0, 0.3, 1.0, 1.0, 1.0]))
def test_reached_tells_the_truth(h, k, a, goal, pole, w):
    full = norm(sub(k, h)) + norm(sub(a, k))
    _, ankle, (_, _, _, reached) = solved(h, k, a, goal, 0.97 * full, pole, w=w)
    miss = norm(sub(ankle, goal))
    assume(abs(miss - 1e-5 * full) > 1e-8)
    assert reached == (miss <= 1e-5 * full)


@settings(max_examples=200, deadline=None)
@given(direction, st.floats(0.0, 1.0), direction)
def test_any_goal_between_the_folded_and_the_usable_leg_is_reached_exactly(way, share, pole):
    usable = 0.97 * FULL
    distance = abs(UPPER - LOWER) + share * (usable - abs(UPPER - LOWER))
    goal = tuple(np.add(HIP, np.multiply(way, distance / norm(way))).tolist())
    _, ankle, (*_, reached) = solved(HIP, KNEE, ANKLE, goal, usable, pole)
    assert reached
    assert np.allclose(ankle, goal, rtol=0.0, atol=1e-9)


def test_a_goal_too_near_leaves_the_leg_folded_towards_it():
    hip, knee, ankle = (0.0, 0.0, 0.0), (0.1, 0.0, -0.6), (0.0, 0.0, -0.9)
    shortest = norm(sub(knee, hip)) - norm(sub(ankle, knee))
    _, end, (*_, reached) = solved(hip, knee, ankle, (0.0, 0.0, -0.05), 0.85)
    assert not reached
    assert np.allclose(end, (0.0, 0.0, -shortest), rtol=0.0, atol=1e-9)


def test_the_pose_is_left_alone_where_the_ankle_is_at_its_goal():
    for pole in (NONE, AHEAD):
        thigh, shin, _, reached = two_bone(HIP, KNEE, ANKLE, ANKLE, LEFT, FULL, pole)
        assert reached
        assert max(quat_angle(thigh, IDENTITY), quat_angle(shin, IDENTITY)) < 1e-7


def test_weight_zero_is_no_turn_and_half_a_weight_turns_hip_and_knee_half_the_way():
    goal = (0.2, 0.1, 0.3)
    thigh, shin, _, _ = two_bone(HIP, KNEE, ANKLE, goal, LEFT, FULL, AHEAD)
    none = two_bone(HIP, KNEE, ANKLE, goal, LEFT, FULL, AHEAD, 1.0, 0.0)
    assert none[0] == none[1] == IDENTITY
    assert np.allclose(none[2], ANKLE)
    assert not none[3]
    half_thigh, half_shin, _, _ = two_bone(HIP, KNEE, ANKLE, goal, LEFT, FULL, AHEAD, 1.0, 0.5)
    assert quat_angle(half_thigh, IDENTITY) == pytest.approx(0.5 * quat_angle(thigh, IDENTITY))
    assert quat_angle(half_thigh, half_shin) == pytest.approx(0.5 * quat_angle(thigh, shin))


@settings(deadline=None)
@given(st.floats(0.0, 3.0), st.floats(1e-4, 0.5), st.floats(0.5, 1.0))
def test_soft_reach_rises_overshoots_nowhere_and_leaves_the_diagonal_with_slope_one(d, step, near):
    here, further = soft_length(d, near, 1.0), soft_length(d + step, near, 1.0)
    assert here <= further <= 1.0
    assert here <= d
    assert further - here <= step + 1e-12  # never faster than the goal
    if near < 0.99:
        start = (soft_length(near + 1e-6, near, 1.0) - near) / 1e-6
        assert start == pytest.approx(1.0, abs=1e-3)


def test_soft_reach_leaves_goals_within_the_usable_length_alone():
    for d in np.linspace(0.0, 0.97, 50):
        assert soft_length(float(d), 0.97, 1.0) == d


@settings(deadline=None)
@given(st.floats(0.0, 3.0), st.floats(1.0, 1.5))
def test_a_leg_stretches_no_more_than_allowed_and_not_before_it_must(distance, most):
    length, stretch = soft_stretch(distance, 0.97, 1.0, most)
    assert 1.0 <= stretch <= most
    assert length / stretch <= 1.0 + 1e-12
    if distance <= 0.97:
        assert (length, stretch) == (distance, 1.0)
    elif distance <= 0.97 * most:
        assert length == distance


def test_stretched_bones_end_at_the_goal_and_rigid_ones_do_not():
    goal, usable = (0.2, 0.0, 0.02), 0.97 * FULL
    rigid = two_bone(HIP, KNEE, ANKLE, goal, LEFT, usable)
    assert not rigid[3]
    knee, end, (_, _, told, reached) = solved(HIP, KNEE, ANKLE, goal, usable, AHEAD, 1.2)
    _, stretch = soft_stretch(norm(sub(goal, HIP)), usable, FULL, 1.2)
    assert 1.0 < stretch < 1.2
    assert reached
    assert np.allclose(told, goal, rtol=0.0, atol=1e-9)
    assert np.allclose(np.add(HIP, np.multiply(stretch, sub(end, HIP))), goal, atol=1e-9)
    assert knee[0] > 0.0


def test_a_straight_leg_bends_to_the_pole_or_else_by_its_hinge():
    hip, knee, ankle, goal = (0.0, 0.0, 0.9), (0.0, 0.0, 0.5), (0.0, 0.0, 0.1), (0.0, 0.0, 0.3)
    by_hinge, _, _ = solved(hip, knee, ankle, goal, 0.8)
    assert by_hinge[0] > 0.1
    assert by_hinge[1] == pytest.approx(0.0, abs=1e-12)
    by_pole, _, _ = solved(hip, knee, ankle, goal, 0.8, pole=(0.0, -1.0, 0.0))
    assert by_pole[1] < -0.1
    assert by_pole[0] == pytest.approx(0.0, abs=1e-12)


@settings(max_examples=300, deadline=None)
@given(direction, st.floats(0.3, 0.96), direction, st.integers(0, 5))
def test_a_small_move_of_the_goal_moves_the_knee_little(way, share, pole, axis):
    toward = np.array(way) / norm(way)
    pole_way = np.array(pole) / norm(pole)
    # Where a pole points along the leg and the knee carried there points against it, it must turn.
    assume(np.linalg.norm(np.cross(pole_way, toward)) > 0.25)
    goal = np.add(HIP, toward * share * FULL)
    step = np.zeros(3)
    step[axis // 2] = 1e-5 * (-1.0) ** axis
    before, _, one = solved(HIP, KNEE, ANKLE, tuple(goal.tolist()), 0.97 * FULL, pole)
    after, _, two = solved(HIP, KNEE, ANKLE, tuple((goal + step).tolist()), 0.97 * FULL, pole)
    assert norm(sub(before, after)) < 2e-4
    assert max(quat_angle(one[0], two[0]), quat_angle(one[1], two[1])) < 2e-3


def _largest_turn_of_knee(poles, goal) -> float:
    """Largest jump between neighbours of the direction the knee points in, rad."""
    knees = [solved(HIP, KNEE, ANKLE, goal, 0.97 * FULL, pole)[0] for pole in poles]
    line = np.subtract(goal, HIP)
    line /= np.linalg.norm(line)
    off = [np.subtract(k, HIP) - np.dot(np.subtract(k, HIP), line) * line for k in knees]
    return max(angle_between(tuple(a), tuple(b)) for a, b in pairwise(off))


def test_a_pole_swept_close_past_the_leg_turns_the_knee_without_a_jump():
    goal = (0.0, 0.0, 0.2)
    angles = np.linspace(-0.8, 0.8, 4001)
    for aside in (0.3, -0.3, 0.05):
        sweep = [(math.sin(a), aside, -math.cos(a)) for a in angles.tolist()]
        assert _largest_turn_of_knee(sweep, goal) < 0.05
    through = [(math.sin(a), 0.0, -math.cos(a)) for a in angles.tolist() if a >= 0.0]
    assert _largest_turn_of_knee(through, goal) < 1e-6  # the pole on the leg is no pole at all


def test_a_pole_that_trembles_about_the_leg_leaves_the_knee_where_it_is_bent():
    goal = (0.0, 0.0, 0.2)
    for tremble in ((1e-3, 0.0), (-1e-3, 0.0), (0.0, 1e-3), (0.0, -1e-3), (0.0, 0.0)):
        knee, _, _ = solved(HIP, KNEE, ANKLE, goal, 0.97 * FULL, (*tremble, -1.0))
        assert math.atan2(knee[1], knee[0]) == pytest.approx(0.0, abs=0.01)


def test_the_knee_never_flips_while_a_foot_circles_through_a_stride():
    last = None
    for t in np.linspace(0.0, 2.0 * math.pi, 500).tolist():
        goal = (0.35 * math.cos(t), 0.05 * math.sin(2.0 * t), 0.25 + 0.2 * math.sin(t))
        knee, _, _ = solved(HIP, KNEE, ANKLE, goal, 0.97 * FULL, AHEAD)
        leg = sub(goal, HIP)
        assert dot((-leg[2], 0.0, leg[0]), sub(knee, HIP)) >= 0.0
        assert last is None or norm(sub(knee, last)) < 0.02
        last = knee


@settings(deadline=None)
@given(direction, direction, direction)
def test_a_pole_across_the_leg_is_followed_whatever_the_bend(pole, toward, carried):
    unit_toward = tuple((np.array(toward) / norm(toward)).tolist())
    across = np.array(pole) / norm(pole)
    across = across - np.dot(across, unit_toward) * np.array(unit_toward)
    assume(np.linalg.norm(across) > 0.21)
    side = knee_toward(pole, unit_toward, carried)
    assert np.allclose(side, across / np.linalg.norm(across), atol=1e-9)


@settings(max_examples=500, deadline=None)
@example(NONE, NONE, NONE, NONE, NONE, NONE, 0.0, 1.0, 1.0)
@example(HIP, HIP, ANKLE, ANKLE, LEFT, AHEAD, 0.8, 1.0, 1.0)  # no thigh
@example(HIP, KNEE, KNEE, ANKLE, LEFT, AHEAD, 0.8, 1.0, 0.5)  # no shin
@example(HIP, KNEE, HIP, HIP, LEFT, AHEAD, 0.8, 1.2, 1.0)  # folded, and the goal at the hip
@given(
    odd_point, odd_point, odd_point, odd_point, odd_point, odd_point, any_number, any_number,
    any_number,
)  # fmt: skip
def test_nothing_finite_makes_a_leg_infinite(hip, knee, ankle, goal, hinge, pole, usable, most, w):
    thigh, shin, end, _ = two_bone(hip, knee, ankle, goal, hinge, usable, pole, most, w)
    for q in (thigh, shin):
        assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-9)
    assert np.isfinite(end).all()


def test_compiled_callers_may_leave_out_pole_stretch_and_weight():
    @compiled
    def call(goal):
        return two_bone(HIP, KNEE, ANKLE, goal, LEFT, 0.8)

    goal = (0.1, 0.0, 0.2)
    assert call(goal) == two_bone(HIP, KNEE, ANKLE, goal, LEFT, 0.8)


@settings(deadline=None)
@given(rotation, rotation, weight)
def test_aim_turns_by_the_weight_of_the_short_way_and_exactly_at_one(now, goal, w):
    now, goal = quat_unit(now), quat_unit(goal)
    whole = quat_angle(now, goal)
    assert quat_angle(quat_mul(aim(now, goal), now), goal) < 1e-7
    assert quat_angle(quat_mul(aim(now, goal, 0.0), now), now) < 1e-7
    assume(whole < 3.1)  # half a turn has two short ways
    part = quat_mul(aim(now, goal, w), now)
    assert quat_angle(now, part) == pytest.approx(w * whole, abs=1e-7)
    assert quat_angle(part, goal) == pytest.approx((1.0 - w) * whole, abs=1e-7)
    negative = (-goal[0], -goal[1], -goal[2], -goal[3])
    again = quat_mul(aim(now, negative, w), now)
    assert quat_angle(part, again) < 1e-7


@settings(deadline=None)
@given(point, point, st.floats(0.1, 1.5))
def test_shortfall_is_the_least_drop_that_brings_the_goal_in_reach(hip, goal, reach):
    drop = shortfall(hip, goal, reach)
    assert drop >= 0.0
    lowered = (hip[0], hip[1], hip[2] - drop)
    aside = math.hypot(goal[0] - hip[0], goal[1] - hip[1])
    if drop > 0.0 and aside < reach:
        assert norm(sub(goal, lowered)) == pytest.approx(reach, abs=1e-7)
    elif drop > 0.0:
        assert lowered[2] == pytest.approx(goal[2])
    elif hip[2] >= goal[2] and aside <= reach:
        assert norm(sub(goal, hip)) <= reach + 1e-12


BALL, GOAL = (0.14, 0.0, 0.02), (0.0, 0.0, 0.1)


def _lifted(angle):
    return add(BALL, rotate(quat_axis_angle(LEFT, angle), sub(GOAL, BALL)))


@settings(deadline=None)
@given(st.floats(-0.2, 0.5), st.floats(0.85, 1.05), st.floats(0.7, 1.0))
def test_a_heel_lifts_by_the_least_angle_that_brings_it_in_reach(ahead, height, reach):
    hip = (ahead, 0.1, height)
    angle = heel_lift(hip, GOAL, BALL, LEFT, reach)
    if norm(sub(GOAL, hip)) <= reach:
        assert angle == 0.0
        return
    assert 0.0 <= angle <= math.pi
    gaps = [norm(sub(_lifted(a), hip)) for a in np.linspace(0.0, angle, 20).tolist()]
    assert gaps[-1] == min(gaps)  # it comes nearer all the way
    nearest = min(norm(sub(_lifted(a), hip)) for a in np.linspace(0.0, 1.6, 200).tolist())
    assert gaps[-1] <= max(reach, nearest) + 1e-9
    if angle > 0.0 and nearest < reach:
        assert gaps[-1] == pytest.approx(reach, abs=1e-7)


@settings(deadline=None)
@given(st.floats(0.8, 1.1), st.floats(-1e-6, 1e-6), st.floats(0.75, 0.95))
def test_a_small_rise_of_the_hip_lifts_the_heel_little(height, rise, reach):
    low = heel_lift((0.05, 0.0, height), GOAL, BALL, LEFT, reach)
    high = heel_lift((0.05, 0.0, height + rise), GOAL, BALL, LEFT, reach)
    assert abs(high - low) < 0.02


def test_a_foot_without_length_and_a_hip_on_the_axis_lift_no_heel():
    assert heel_lift((0.0, 0.0, 2.0), BALL, BALL, LEFT, 0.5) == 0.0
    assert heel_lift(add(BALL, (0.0, 2.0, 0.0)), GOAL, BALL, LEFT, 0.5) == 0.0


@settings(max_examples=200, deadline=None)
@given(point, point, point)
def test_any_bent_leg_whose_ankle_is_at_its_goal_is_left_alone(hip, knee, ankle):
    thigh, shin = sub(knee, hip), sub(ankle, knee)
    full = norm(thigh) + norm(shin)
    assume(min(norm(thigh), norm(shin), norm(sub(ankle, hip))) > 0.05)
    # Bent enough that its own plane holds, not its hinge's.
    assume(norm(np.cross(thigh, sub(ankle, hip))) / norm(sub(ankle, hip)) > 0.021 * full)
    turned, bent, end, reached = two_bone(hip, knee, ankle, ankle, LEFT, full)
    assert reached
    assert np.allclose(end, ankle, rtol=0.0, atol=1e-9)
    assert max(quat_angle(turned, IDENTITY), quat_angle(bent, IDENTITY)) < 1e-6


@settings(max_examples=200, deadline=None)
@given(direction, st.floats(0.3, 0.96), direction)
def test_without_a_pole_small_moves_of_the_goal_turn_the_bones_little(way, share, step):
    toward = np.array(way) / norm(way)
    assume(toward[2] < 0.9)  # straight up, opposite the leg, any swing is as short
    goal = np.add(HIP, toward * share * FULL)
    near = goal + 1e-5 * np.array(step) / norm(step)
    one = two_bone(HIP, KNEE, ANKLE, tuple(goal.tolist()), LEFT, 0.97 * FULL)
    other = two_bone(HIP, KNEE, ANKLE, tuple(near.tolist()), LEFT, 0.97 * FULL)
    assert norm(sub(one[2], other[2])) < 2e-5
    assert max(quat_angle(one[0], other[0]), quat_angle(one[1], other[1])) < 2e-3


@settings(deadline=None)
@given(rotation, st.floats(0.2, 0.95))
def test_a_straight_leg_bends_to_its_hinges_side_however_it_stands(turn, share):
    turn = quat_unit(turn)
    down, hinge, ahead = (rotate(turn, v) for v in ((0.0, 0.0, -1.0), LEFT, AHEAD))
    knee, ankle = (tuple(np.multiply(down, d).tolist()) for d in (0.4, 0.8))
    goal = tuple(np.multiply(down, 0.8 * share).tolist())
    for way in (1.0, -1.0):
        axis = tuple(np.multiply(hinge, way).tolist())
        bent, end, _ = solved(NONE, knee, ankle, goal, 0.8, hinge=axis)
        assert way * dot(bent, ahead) > 0.05
        assert abs(dot(bent, hinge)) < 1e-9
        assert np.allclose(end, goal, atol=1e-9)


def test_the_hinge_takes_over_smoothly_from_a_knee_bent_aside():
    hip, ankle, goal = (0.0, 0.0, 0.84), NONE, (0.0, 0.0, 0.3)
    last = None
    for off in np.linspace(0.0, 0.03 * 0.84, 1001).tolist():
        knee, _, _ = solved(hip, (0.0, off, 0.42), ankle, goal, 0.83)
        assert last is None or angle_between((knee[0], knee[1], 0.0), last) < 0.01
        last = (knee[0], knee[1], 0.0)
    assert last is not None
    assert angle_between(last, LEFT) < 1e-6  # bent well, it keeps to its own plane


def test_a_leg_straightens_and_bends_again_without_a_jump():
    hips = np.linspace(0.80, 0.84, 2001)  # through the length at which the hinge takes over
    last = None
    for height in hips.tolist():
        knee = (math.sqrt(max(0.42**2 - (0.5 * height) ** 2, 0.0)), 0.0, 0.5 * height)
        turns = two_bone((0.0, 0.0, height), knee, NONE, (0.1, 0.1, 0.1), LEFT, 0.82)
        knee_at = add((0.0, 0.0, height), rotate(turns[0], sub(knee, (0.0, 0.0, height))))
        assert last is None or norm(sub(knee_at, last)) < 2e-3
        last = knee_at


@settings(deadline=None)
@given(direction, st.floats(1.0, 1e6))
def test_a_goal_too_far_pulls_the_leg_towards_it_and_never_quite_straight(way, times):
    toward = np.array(way) / norm(way)
    goal = tuple(np.add(HIP, toward * times * FULL).tolist())
    _, end, (_, _, _, reached) = solved(HIP, KNEE, ANKLE, goal, 0.97 * FULL)
    assert not reached
    assert norm(sub(end, HIP)) < FULL
    assert angle_between(sub(end, HIP), tuple(toward.tolist())) < 1e-6


def test_soft_reach_without_room_is_a_clamp():
    assert soft_length(0.5, 1.0, 1.0) == 0.5
    assert soft_length(7.0, 1.0, 1.0) == 1.0
    assert soft_length(0.0, 0.0, 0.0) == 0.0


def test_shortfall_is_exact():
    assert shortfall((0.0, 0.0, 1.0), (0.3, 0.0, 0.0), 0.5) == pytest.approx(0.6)
    assert shortfall((0.0, 0.0, 0.4), (0.3, 0.0, 0.0), 0.5) == pytest.approx(0.0, abs=1e-12)
    assert shortfall((0.0, 0.0, 0.2), (0.0, 0.0, 0.9), 0.5) == 0.0  # a goal over the hip
    assert shortfall((0.0, 0.0, 1.0), (9.0, 0.0, 0.25), 0.5) == 0.75  # too far aside


@settings(deadline=None)
@given(st.floats(-0.08, 0.08), st.floats(0.86, 1.0), st.floats(0.8, 0.95))
def test_a_heel_lift_about_an_axis_askew_brings_the_ankle_in_reach(aside, height, reach):
    hip, goal = (0.1, 0.1, height), (0.0, aside, 0.1)
    angle = heel_lift(hip, goal, BALL, LEFT, reach)
    lifted = [
        norm(sub(add(BALL, rotate(quat_axis_angle(LEFT, a), sub(goal, BALL))), hip))
        for a in (angle, *np.linspace(0.0, math.pi, 400).tolist())
    ]
    assert lifted[0] <= max(reach, min(lifted[1:])) + 1e-9
    if angle > 0.0 and min(lifted[1:]) < reach:
        assert lifted[0] == pytest.approx(reach, abs=1e-7)


@settings(deadline=None)
@given(rotation, st.floats(0.95, 1.3))
def test_a_heel_lift_does_not_depend_on_where_the_world_points(turn, height):
    turn, hip = quat_unit(turn), (0.05, 0.02, height)
    here = heel_lift(hip, GOAL, BALL, LEFT, 0.85)
    hip_t, goal_t, ball_t, left_t = (rotate(turn, v) for v in (hip, GOAL, BALL, LEFT))
    there = heel_lift(hip_t, goal_t, ball_t, left_t, 0.85)
    assert there == pytest.approx(here, abs=1e-6)


@settings(deadline=None)
@given(point, point, point, direction, st.floats(0.0, 3.0))
def test_a_heel_lift_is_never_negative_or_over_a_turn_and_always_finite(h, goal, ball, axis, reach):
    left = tuple((np.array(axis) / norm(axis)).tolist())
    assert 0.0 <= heel_lift(h, goal, ball, left, reach) <= 2.0 * math.pi
    assert heel_lift(h, goal, goal, left, reach) == 0.0
