"""Offsets that end, and springs that any frame rate drives alike."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footik_runtime.inertia import decayed, limited_velocity, smooth_bump, smooth_step, spring

coordinate = st.floats(-2, 2)
vector = st.tuples(coordinate, coordinate, coordinate)
duration = st.floats(0.05, 2.0)


def slope(f, t, h=1e-6):
    return (np.array(f(t + h)) - np.array(f(t - h))) / (2 * h)


@given(vector, vector, duration)
def test_offset_starts_where_and_as_fast_as_it_is_told(offset, velocity, time):
    assert decayed(offset, velocity, 0.0, time) == pytest.approx(offset)
    moving = slope(lambda t: decayed(offset, velocity, max(t, 0.0), time), 1e-6)
    np.testing.assert_allclose(moving, velocity, atol=1e-3)


@given(vector, vector, duration, st.floats(0, 10))
def test_offset_is_exactly_zero_from_its_end_on(offset, velocity, time, later):
    assert decayed(offset, velocity, time + later, time) == (0.0, 0.0, 0.0)


@given(vector, vector, duration)
def test_offset_ends_at_rest_without_a_kick(offset, velocity, time):
    def near(t):
        return decayed(offset, velocity, t, time)

    for part in (1e-3, 2e-3):
        # Position, velocity and acceleration vanish there: what is left is of third order.
        left = np.linalg.norm(near(time * (1 - part)))
        assert left <= 20.0 * part**3 * (np.linalg.norm(offset) + time * np.linalg.norm(velocity))


def test_offset_of_no_duration_is_zero():
    assert decayed((1.0, 1.0, 1.0), (5.0, 0.0, 0.0), 0.0, 0.0) == (0.0, 0.0, 0.0)


@given(vector, vector, duration)
def test_limited_velocity_keeps_its_direction_and_never_grows(offset, velocity, time):
    limited = np.array(limited_velocity(offset, velocity, time, 1.0))
    assert np.linalg.norm(limited) <= np.linalg.norm(velocity) + 1e-12
    assert np.linalg.norm(np.cross(limited, velocity)) < 1e-9


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3), st.floats(0.01, 2), st.integers(2, 50))
def test_spring_does_not_care_how_time_is_cut(value, speed, target, half_life, parts):
    whole = spring(value, speed, target, half_life, 0.1)
    now = value, speed
    for _ in range(parts):
        now = spring(*now, target, half_life, 0.1 / parts)
    np.testing.assert_allclose(now, whole, atol=1e-9, rtol=1e-9)


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3))
def test_spring_is_safe_at_any_step(value, speed, target):
    assert spring(value, speed, target, 0.1, 0.0) == pytest.approx((value, speed))
    after = spring(value, speed, target, 0.1, 1e3)
    assert after == pytest.approx((target, 0.0), abs=1e-9)
    assert spring(value, speed, target, 0.0, 0.01) == (target, 0.0)


def test_resting_spring_is_half_way_after_its_half_life():
    assert spring(1.0, 0.0, 0.0, 0.2, 0.2)[0] == pytest.approx(0.5, abs=0.002)


def test_easing_is_monotone_and_rests_at_both_ends():
    steps = [smooth_step(t) for t in np.linspace(-0.5, 1.5, 401)]
    assert steps[0] == 0.0
    assert steps[-1] == 1.0
    assert (np.diff(steps) >= 0.0).all()
    for end in (0.0, 1.0):
        assert abs(slope(smooth_step, end)) < 1e-5


def test_bump_is_one_in_the_middle_and_rests_at_its_ends():
    assert smooth_bump(0.5) == 1.0
    for outside in (-1.0, 0.0, 1.0, 2.0):
        assert smooth_bump(outside) == 0.0
    for t in (0.0, 0.5, 1.0):
        assert abs(slope(smooth_bump, t)) < 1e-4
    assert not math.isnan(smooth_bump(1e300))


@given(vector, vector, duration)
def test_offset_starts_without_acceleration(offset, velocity, time):
    for h in (1e-2, 5e-3):
        t = h * time
        left = np.array(decayed(offset, velocity, t, time))
        straight = np.array(offset) + np.array(velocity) * t
        size = np.linalg.norm(offset) + time * np.linalg.norm(velocity)
        assert np.linalg.norm(left - straight) <= 20.0 * h**3 * size + 1e-12


@given(vector, duration, st.floats(0, 1))
def test_offset_at_rest_shrinks_along_a_straight_line_and_never_passes_zero(offset, time, part):
    now = np.array(decayed(offset, (0.0, 0.0, 0.0), part * time, time))
    np.testing.assert_allclose(now, np.array(offset) * (1 - smooth_step(part)), atol=1e-12)


@given(vector, vector, duration)
def test_limited_offset_overshoots_by_no_more_than_its_size_and_a_little(offset, velocity, time):
    limited = limited_velocity(offset, velocity, time, 1.0)
    size = np.linalg.norm(offset)
    assert np.linalg.norm(limited) <= 4.0 * size / time + 1.5 + 1e-9
    if np.linalg.norm(velocity) <= 1.5:
        assert limited == velocity
    for part in np.linspace(0, 1, 21):
        reach = np.linalg.norm(decayed(offset, limited, part * time, time))
        assert reach <= 1.5 * size + 0.25 * 1.5 * time


def test_limit_of_no_duration_is_finite():
    limited = limited_velocity((1.0, 0.0, 0.0), (1e300, 0.0, 0.0), 0.0, 1.0)
    assert np.isfinite(limited).all()


@given(
    st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3),
    st.floats(0, 1e6), st.sampled_from([0.0, 5e-324, 1e-9, 1e-3, 1.0, 1e3, 1e300, math.inf]),
)  # fmt: skip
def test_spring_is_finite_at_any_half_life_and_step(value, speed, target, half_life, dt):
    if half_life > 1.0 and math.isinf(dt):
        dt = 1e9
    assert np.isfinite(spring(value, speed, target, half_life, dt)).all()


@pytest.mark.parametrize("dt", [1e3, 1e300, math.inf])
@pytest.mark.parametrize("half_life", [1e-9, 1e-6, 0.1])
def test_spring_of_far_and_fast_is_at_rest_on_its_target_after_ages(half_life, dt):
    assert spring(1e9, 1e9, 3.0, half_life, dt) == pytest.approx((3.0, 0.0))


@pytest.mark.parametrize("half_life", [5e-324, 1e-300, 1e-160, 1e-12, 0.0])
def test_spring_too_short_to_be_seen_jumps(half_life):
    for dt in (0.0, 1e-3, 1e3):
        assert spring(1.0, 5.0, 3.0, half_life, dt) == (3.0, 0.0)


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(0.02, 1))
def test_spring_moves_as_fast_as_it_says(value, speed, half_life):
    _, after = spring(value, speed, 0.5, half_life, 0.03)
    moved = slope(lambda t: spring(value, speed, 0.5, half_life, t)[0], 0.03)
    assert moved == pytest.approx(after, rel=1e-4, abs=1e-4)


def test_resting_spring_never_passes_its_target():
    steps = [spring(1.0, 0.0, 0.0, 0.1, t)[0] for t in np.linspace(0, 2, 300)]
    assert (np.diff(steps) <= 0.0).all()
    assert steps[-1] >= 0.0


def test_easing_ends_without_acceleration():
    h = 1e-4
    assert smooth_step(h) / h**3 == pytest.approx(10.0, rel=1e-2)
    assert (1.0 - smooth_step(1.0 - h)) / h**3 == pytest.approx(10.0, rel=1e-2)
    assert smooth_step(0.5) == 0.5
