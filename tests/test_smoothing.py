import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from footik_runtime.smoothing import clamp_through, ease, smooth_damp, smooth_damp3

numbers = st.floats(-100.0, 100.0)
smooth_times = st.floats(0.0, 5.0)
steps = st.floats(1e-4, 1.0)


def test_ease_rises_strictly_from_0_to_1_and_is_flat_beyond():
    values = [ease(float(f)) for f in np.linspace(0.0, 1.0, 101)]
    assert (np.diff(values) > 0.0).all()
    assert (ease(-1.0), ease(0.0), ease(0.5), ease(1.0), ease(2.0)) == (0.0, 0.0, 0.5, 1.0, 1.0)


def test_clamp_limits_and_lets_nan_through():
    assert (clamp_through(-1.0, 0.0, 1.0), clamp_through(2.0, 0.0, 1.0)) == (0.0, 1.0)
    assert math.isnan(clamp_through(math.nan, 0.0, 1.0))


@given(numbers, numbers, st.floats(0.01, 2.0), steps)
@settings(max_examples=100, deadline=None)
def test_a_follower_comes_nearer_each_step_never_passes_and_arrives(start, target, time, dt):
    value, velocity = start, 0.0
    for _ in range(int(20.0 * time / dt) + 20 if dt > 0.01 * time else 50):
        gap = target - value
        value, velocity = smooth_damp(value, target, velocity, time, dt)
        assert abs(target - value) <= abs(gap) + 1e-12
        assert (target - value) * gap >= 0.0
    if dt > 0.01 * time:
        assert value == pytest.approx(target, abs=1e-3)


@given(numbers, numbers, numbers, smooth_times, steps)
@settings(max_examples=100, deadline=None)
def test_no_start_makes_a_step_infinite_or_nan(start, target, velocity, time, dt):
    assert np.isfinite(smooth_damp(start, target, velocity, time, dt)).all()
    along = smooth_damp3((start, 0.0, 1.0), (target, 1.0, 1.0), (velocity, 0.0, 0.0), time, dt)
    assert np.isfinite(along).all()


@given(numbers, st.tuples(numbers, numbers, numbers), smooth_times, steps)
@settings(max_examples=50, deadline=None)
def test_a_vector_along_one_axis_moves_as_the_scalar_does(target, offset, time, dt):
    value, velocity = smooth_damp(0.0, target, 0.0, time, dt)
    vector, speeds = smooth_damp3((0.0, 0.0, 0.0), (0.0, target, 0.0), (0.0, 0.0, 0.0), time, dt)
    assert vector == pytest.approx((0.0, value, 0.0), abs=1e-12)
    assert speeds == pytest.approx((0.0, velocity, 0.0), abs=1e-9)


def test_a_step_that_would_pass_the_target_lands_on_it_at_rest():
    assert smooth_damp(0.9, 1.0, 50.0, 0.25, 0.1) == (1.0, 0.0)
    landed = smooth_damp3((0.9, 0.0, 0.0), (1.0, 0.0, 0.0), (50.0, 0.0, 0.0), 0.25, 0.1)
    assert landed == ((1.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@pytest.mark.parametrize("target", [-1.0, 1.0])
def test_a_step_of_no_time_keeps_value_and_velocity_away_from_the_target(target):
    assert smooth_damp(0.25, target, 0.5, 0.25, 0.0) == (0.25, 0.5)


def test_a_step_of_no_time_on_the_target_makes_the_velocity_nan():
    value, velocity = smooth_damp(1.0, 1.0, 0.0, 0.25, 0.0)
    assert value == 1.0
    assert math.isnan(velocity)


def test_after_a_nan_velocity_the_value_lands_at_once_or_one_step_later():
    assert smooth_damp(1.0, 0.0, math.nan, 0.25, 0.01) == (0.0, 0.0)
    value, velocity = smooth_damp(0.0, 1.0, math.nan, 0.25, 0.01)
    assert math.isnan(value)
    assert smooth_damp(value, 1.0, velocity, 0.25, 0.01) == (1.0, 0.0)
