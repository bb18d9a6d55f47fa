import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from footik_runtime.offline.filters import envelope, gaussian, runs

NUMBERS = st.floats(-100.0, 100.0)


@given(arrays(float, st.integers(1, 60), elements=NUMBERS), st.integers(0, 20))
def test_an_envelope_is_nowhere_under_the_need(need, frames):
    curve = envelope(need, frames)
    assert curve.shape == need.shape
    assert (curve >= need - 1e-9).all()
    assert curve.max() <= need.max() + 1e-9


def test_an_envelope_is_zero_where_no_need_is_near():
    need = np.zeros(100)
    need[50] = 1.0
    curve = envelope(need, 5)
    assert curve[50] == pytest.approx(1.0)
    assert not curve[:40].any()
    assert not curve[61:].any()
    assert np.abs(np.diff(curve)).max() < 0.25


@given(st.floats(0.0, 30.0), st.integers(1, 80), NUMBERS, NUMBERS)
def test_straight_lines_stay_under_a_gaussian(sigma, frames, start, slope):
    line = start + slope * np.arange(frames)
    assert np.abs(gaussian(line[:, None], sigma)[:, 0] - line).max() < 1e-6 * (1 + frames)


def test_a_gaussian_has_its_width():
    spike = np.zeros((201, 2, 3))
    spike[100] = 1.0
    smooth = gaussian(spike, 6.0)[:, 1, 2]
    frames = np.arange(201) - 100
    assert smooth.sum() == pytest.approx(1.0)
    assert np.sqrt((smooth * frames**2).sum()) == pytest.approx(6.0, rel=0.02)


@given(arrays(bool, st.integers(0, 40)))
def test_runs_rebuild_their_mask(mask):
    rebuilt = np.zeros(len(mask), dtype=bool)
    for start, stop in runs(mask):
        assert stop > start
        rebuilt[start:stop] = True
    assert (rebuilt == mask).all()
    assert len(runs(mask)) == np.sum(np.diff(mask.astype(int), prepend=0) == 1)
