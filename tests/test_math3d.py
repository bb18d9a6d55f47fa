"""Vectors and quaternions against SciPy, and at the places where they could fail."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from footik_runtime import math3d as m

number = st.floats(-10, 10).map(lambda x: round(x, 6))
vector = st.tuples(number, number, number)
angle = st.floats(-20, 20)


@st.composite
def rotation(draw):
    v = np.array(draw(st.tuples(*[st.floats(-1, 1)] * 4)))
    assume(np.linalg.norm(v) > 0.1)
    return tuple(v / np.linalg.norm(v))


def oracle(q) -> Rotation:
    return Rotation.from_quat([q[1], q[2], q[3], q[0]])


def same_rotation(a, b, tolerance=1e-9) -> bool:
    return (oracle(a).inv() * oracle(b)).magnitude() < tolerance


@given(rotation(), rotation(), vector)
def test_product_applies_the_right_factor_first(a, b, v):
    both = m.rotate(m.quat_mul(a, b), v)
    np.testing.assert_allclose(both, m.rotate(a, m.rotate(b, v)), atol=1e-9)
    np.testing.assert_allclose(both, (oracle(a) * oracle(b)).apply(v), atol=1e-9)


@given(rotation(), vector)
def test_unrotate_undoes_rotate(q, v):
    np.testing.assert_allclose(m.unrotate(q, m.rotate(q, v)), v, atol=1e-9)


@given(st.tuples(*[st.floats(-3, 3)] * 3))
def test_rotation_vector_goes_there_and_back(v):
    q = m.quat_from_rotvec(v)
    assert same_rotation(q, tuple(np.roll(Rotation.from_rotvec(v).as_quat(), 1)))
    back = m.quat_to_rotvec(q)
    assert np.linalg.norm(back) <= math.pi + 1e-9
    assert same_rotation(m.quat_from_rotvec(back), q)


@given(st.floats(1e-100, 1e-7))
def test_tiny_rotation_vectors_keep_their_precision(x):
    v = (x, -x, 2.0 * x)
    np.testing.assert_allclose(m.quat_to_rotvec(m.quat_from_rotvec(v)), v, rtol=1e-7)


@given(vector, vector)
def test_shortest_arc_turns_one_direction_into_the_other(a, b):
    assume(np.linalg.norm(a) > 1e-3)
    assume(np.linalg.norm(b) > 1e-3)
    q = m.quat_between(a, b)
    turned = np.array(m.rotate(q, a)) / np.linalg.norm(a)
    # Within 1.4e-6 rad of half a turn it is half a turn.
    np.testing.assert_allclose(turned, np.array(b) / np.linalg.norm(b), atol=2e-6)
    assert np.linalg.norm(m.quat_to_rotvec(q)) == pytest.approx(m.angle_between(a, b), abs=2e-6)


@given(vector)
def test_opposite_directions_turn_by_half_a_turn(a):
    assume(np.linalg.norm(a) > 1e-3)
    q = m.quat_between(a, m.scale(a, -2.0))
    np.testing.assert_allclose(m.rotate(q, a), m.scale(a, -1.0), atol=1e-6)


@pytest.mark.parametrize("other", [(0.0, 0.0, 0.0), (1.0, 2.0, 3.0)])
def test_zero_directions_do_not_turn(other):
    assert m.quat_between((0.0, 0.0, 0.0), other) == m.IDENTITY
    assert m.quat_between(other, (0.0, 0.0, 0.0)) == m.IDENTITY


@given(rotation(), rotation(), st.floats(0, 1))
def test_slerp_is_scipys(a, b, t):
    between = oracle(a) * Rotation.from_rotvec((oracle(a).inv() * oracle(b)).as_rotvec() * t)
    assume((oracle(a).inv() * oracle(b)).magnitude() < math.pi - 1e-3)
    assert same_rotation(m.quat_slerp(a, b, t), np.roll(between.as_quat(), 1), 1e-6)


@given(rotation(), rotation())
def test_blends_meet_both_ends_by_the_short_way(a, b):
    opposite = tuple(-x for x in b)
    for blend in (m.quat_nlerp, m.quat_slerp):
        assert same_rotation(blend(a, b, 0.0), a, 1e-6)
        assert same_rotation(blend(a, b, 1.0), b, 1e-6)
        assert same_rotation(blend(a, b, 0.3), blend(a, opposite, 0.3), 1e-6)


@given(rotation())
def test_basis_gives_the_rotation_back(q):
    columns = [m.rotate(q, axis) for axis in ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0))]
    assert same_rotation(m.quat_from_basis(*columns), q, 1e-7)


@given(vector, vector)
def test_upright_keeps_up_exactly_and_forward_as_near_as_it_can(forward, up):
    assume(np.linalg.norm(up) > 1e-2)
    q = m.quat_upright(forward, up)
    unit_up = np.array(up) / np.linalg.norm(up)
    np.testing.assert_allclose(m.rotate(q, (0.0, 0.0, 1.0)), unit_up, atol=1e-7)
    flat = np.array(forward) - unit_up * (np.array(forward) @ unit_up)
    if np.linalg.norm(flat) > 1e-3 * max(1.0, np.linalg.norm(forward)):
        ahead = np.array(m.rotate(q, (1.0, 0.0, 0.0)))
        np.testing.assert_allclose(ahead, flat / np.linalg.norm(flat), atol=1e-5)


@given(rotation(), st.sampled_from([(1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)]))
def test_twist_leaves_a_swing_without_turn_about_the_axis(q, axis):
    twist = m.quat_twist(q, axis)
    assume(abs(q[0]) + abs(np.dot(q[1:], axis)) > 1e-3)
    swing = m.quat_mul(q, m.quat_conj(twist))
    assert abs(np.dot(swing[1:], axis)) < 1e-6


@given(st.floats(-3.1, 3.1))
def test_heading_is_the_yaw(yaw):
    assert m.quat_heading(m.quat_yaw(yaw)) == pytest.approx(yaw, abs=1e-9)


def test_heading_of_a_vertical_forward_is_zero():
    assert m.quat_heading(m.quat_axis_angle((0.0, 1.0, 0.0), math.pi / 2)) == 0.0


@given(angle)
def test_wrapped_angle_is_the_same_angle_in_one_turn(a):
    w = m.wrap_angle(a)
    assert -math.pi - 1e-9 <= w <= math.pi + 1e-9
    assert math.cos(w) == pytest.approx(math.cos(a), abs=1e-9)
    assert math.sin(w) == pytest.approx(math.sin(a), abs=1e-9)


@given(vector, vector)
def test_rejection_is_perpendicular_and_a_zero_normal_changes_nothing(v, n):
    assert m.reject(v, (0.0, 0.0, 0.0)) == v
    assume(np.linalg.norm(n) > 1e-2)
    assert abs(np.dot(m.reject(v, n), n)) < 1e-6


@given(vector)
def test_perpendicular_is_a_unit_vector_at_right_angles(v):
    p = m.perpendicular(v)
    assert np.linalg.norm(p) == pytest.approx(1.0)
    assert abs(np.dot(p, v)) < 1e-9 * max(1.0, np.linalg.norm(v))


@given(vector, vector)
def test_lerp_is_exact_at_both_ends(a, b):
    assert m.lerp(a, b, 0.0) == a
    assert m.lerp(a, b, 1.0) == b


ANY = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e150, max_value=1e150)
ODD = st.one_of(st.just((0.0, 0.0, 0.0)), vector, st.tuples(ANY, ANY, ANY))
ODD_QUAT = st.one_of(st.just((0.0,) * 4), rotation(), st.tuples(ANY, ANY, ANY, ANY))


@given(ODD, ODD)
def test_every_function_of_two_vectors_is_finite_on_anything(a, b):
    for v in (
        m.unit(a, m.UP), m.reject(a, m.unit(b, m.ZERO)), m.perpendicular(a), m.cross(a, b),
        m.quat_between(a, b), m.quat_between(a, m.scale(a, -1.0)), m.quat_upright(a, b),
        m.quat_upright(a, a), m.lerp(a, b, 0.3), m.quat_from_basis(a, b, a),
    ):  # fmt: skip
        assert np.isfinite(v).all()
    assert math.isfinite(m.norm(a))
    assert 0.0 <= m.angle_between(a, b) <= math.pi


@given(ODD_QUAT, ODD_QUAT, st.floats(0, 1))
def test_every_quaternion_made_unit_is_finite_in_every_function(a, b, t):
    a, b = m.quat_unit(a), m.quat_unit(b)
    for q in (a, m.quat_nlerp(a, b, t), m.quat_slerp(a, b, t), m.quat_twist(a, m.UP)):
        assert np.linalg.norm(q) == pytest.approx(1.0)
    assert np.isfinite(m.quat_to_rotvec(a)).all()
    assert 0.0 <= m.quat_angle(a, b) <= math.pi + 1e-12
    assert math.isfinite(m.quat_heading(a))


def test_what_zero_gives_is_what_is_said():
    assert m.unit(m.ZERO, m.FORWARD) == m.FORWARD
    assert m.unit((1e-13, 0.0, 0.0), m.UP) == m.UP
    assert m.quat_unit((0.0, 0.0, 0.0, 0.0)) == m.IDENTITY
    assert m.angle_between(m.ZERO, m.UP) == 0.0
    assert m.quat_from_rotvec(m.ZERO) == m.IDENTITY
    assert m.quat_to_rotvec(m.IDENTITY) == m.ZERO
    assert m.quat_twist((0.0, 1.0, 0.0, 0.0), m.UP) == m.IDENTITY  # half a turn across: no twist
    assert m.quat_nlerp((0.0,) * 4, (0.0,) * 4, 0.5) == m.IDENTITY


@given(vector, vector, number)
def test_vector_arithmetic_is_numpys(a, b, s):
    x, y = np.array(a), np.array(b)
    np.testing.assert_array_equal(m.add(a, b), x + y)
    np.testing.assert_array_equal(m.sub(a, b), x - y)
    np.testing.assert_array_equal(m.scale(a, s), x * s)
    np.testing.assert_allclose(m.add_scaled(a, b, s), x + y * s, atol=1e-12)
    np.testing.assert_allclose(m.lerp(a, b, 0.25), 0.75 * x + 0.25 * y, atol=1e-12)
    np.testing.assert_allclose(m.cross(a, b), np.cross(x, y), atol=1e-12)
    assert m.dot(a, b) == pytest.approx(x @ y, abs=1e-9)
    assert m.norm(a) == pytest.approx(np.linalg.norm(x))


def test_arrays_are_read_and_written_in_their_first_places():
    row = np.arange(6.0)
    assert m.get3(row) == (0.0, 1.0, 2.0)
    assert m.get4(row) == (0.0, 1.0, 2.0, 3.0)
    m.set4(row, (9.0, 8.0, 7.0, 6.0))
    assert row.tolist() == [9.0, 8.0, 7.0, 6.0, 4.0, 5.0]
    m.set3(row, (1.0, 2.0, 3.0))
    assert row.tolist() == [1.0, 2.0, 3.0, 6.0, 4.0, 5.0]


@given(number, number, number)
def test_clamp_is_numpys(x, one, other):
    low, high = min(one, other), max(one, other)
    assert m.clamp(x, low, high) == np.clip(x, low, high)


@given(st.floats(-3.14, 3.14), rotation())
def test_axis_and_angle_make_scipys_rotation(angle, q):
    axis = m.rotate(q, m.FORWARD)
    expected = Rotation.from_rotvec(np.array(axis) * angle)
    assert same_rotation(m.quat_axis_angle(axis, angle), np.roll(expected.as_quat(), 1), 1e-7)
    assert same_rotation(m.quat_yaw(angle), m.quat_axis_angle(m.UP, angle))


@given(rotation(), rotation())
def test_angle_of_two_rotations_is_scipys_and_knows_no_sign(a, b):
    expected = (oracle(a).inv() * oracle(b)).magnitude()
    assert m.quat_angle(a, b) == pytest.approx(expected, abs=1e-6)
    assert m.quat_angle(a, tuple(-x for x in b)) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("true", [1e-9, 1e-6, 1.0, math.pi - 1e-6, math.pi])
def test_angle_between_keeps_its_precision_near_0_and_pi(true):
    b = (3.0 * math.cos(true), 3.0 * math.sin(true), 0.0)
    assert m.angle_between(m.FORWARD, b) == pytest.approx(true, rel=1e-9)


@given(rotation(), st.floats(1e-5, 1.0))
def test_shortest_arc_stays_exact_close_to_half_a_turn(q, short):
    a = m.rotate(q, m.FORWARD)
    b = m.rotate(q, (-math.cos(short), math.sin(short), 0.0))
    np.testing.assert_allclose(m.rotate(m.quat_between(a, b), a), b, atol=1e-8)


def test_upright_conventions():
    level = m.quat_upright(m.FORWARD, m.UP)
    np.testing.assert_allclose(level, m.IDENTITY, atol=1e-12)
    left = m.quat_upright((0.0, 5.0, 0.0), (0.0, 0.0, 3.0))
    np.testing.assert_allclose(m.rotate(left, m.FORWARD), (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(m.rotate(left, (0.0, 1.0, 0.0)), (-1, 0, 0), atol=1e-12)
    slope = (-math.sin(0.3), 0.0, math.cos(0.3))  # rises ahead: x climbs
    assert m.rotate(m.quat_upright(m.FORWARD, slope), m.FORWARD)[2] == pytest.approx(math.sin(0.3))


def test_upright_without_a_forward_is_the_shortest_turn_of_up():
    up = (0.6, 0.0, 0.8)
    for forward in (m.ZERO, up, m.scale(up, -4.0)):
        assert m.quat_upright(forward, up) == m.quat_between(m.UP, up)
    assert m.quat_upright(m.ZERO, m.ZERO) == m.IDENTITY


@given(rotation(), st.floats(-3, 3))
def test_twist_of_a_turn_about_its_axis_is_all_of_it(q, angle):
    axis = m.rotate(q, m.UP)
    turn = m.quat_axis_angle(axis, angle)
    assert same_rotation(m.quat_twist(turn, axis), turn, 1e-6)


@given(st.floats(-3.1, 3.1), st.floats(-1.4, 1.4), st.floats(-3, 3))
def test_heading_is_the_yaw_whatever_pitch_and_roll(yaw, pitch, roll):
    q = np.roll(Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat(), 1)
    assert m.quat_heading(tuple(q)) == pytest.approx(yaw, abs=1e-9)


@given(rotation(), rotation(), st.floats(0, 1))
def test_nlerp_stays_on_the_arc_of_slerp(a, b, t):
    between, whole = m.quat_nlerp(a, b, t), m.quat_angle(a, b)
    there, on = m.quat_angle(a, between), m.quat_angle(between, b)
    assert there + on == pytest.approx(whole, abs=1e-6)
