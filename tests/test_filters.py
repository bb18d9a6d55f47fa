"""Filters of point paths: noise, gaps, smoothing, runs and envelopes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footik_runtime.offline.filters import (
    envelope,
    fill_gaps,
    gaussian,
    hold_last,
    latched,
    noise_sd,
    runs,
    sliding_mean,
)

masks = st.lists(st.booleans(), max_size=40).map(lambda values: np.array(values, dtype=bool))


def waving(frames: int = 400, fps: float = 100.0) -> np.ndarray:
    time = np.arange(frames)[:, None, None] / fps
    return np.sin(2.0 * np.pi * time * np.array([0.7, 1.1, 1.3])) * np.ones((1, 3, 1))


@pytest.mark.parametrize("sd", [1e-3, 1e-2, 3e-2])
def test_noise_is_measured_on_moving_points(sd):
    noise = np.random.default_rng(1).normal(0.0, sd, (400, 3, 3))
    assert noise_sd(waving() + noise) == pytest.approx(sd, rel=0.1)
    assert noise_sd(waving()) < 1e-4


def test_noise_is_measured_around_gaps():
    points = waving() + np.random.default_rng(1).normal(0.0, 0.01, (400, 3, 3))
    points[100:150, 1] = np.nan
    points[:, 2] = np.nan
    assert noise_sd(points) == pytest.approx(0.01, rel=0.15)
    assert noise_sd(points[:4]) == noise_sd(np.full((9, 2, 3), np.nan)) == 0.0


def test_gaps_are_bridged_by_lines_and_held_at_the_ends():
    points = np.tile(np.arange(10.0)[:, None, None], (1, 2, 3))
    points[[0, 4, 5, 9], 0] = np.nan
    points[:, 1] = np.nan
    filled, missing = fill_gaps(points)
    np.testing.assert_allclose(filled[:, 0, 0], [1, 1, 2, 3, 4, 5, 6, 7, 8, 8])
    assert (filled[:, 1] == 0.0).all()
    assert missing[:, 0].sum() == 4
    assert missing[:, 1].all()


def test_a_smoothed_line_stays_the_line_to_its_ends():
    line = np.linspace(0.0, 3.0, 50)[:, None] * np.array([1.0, -2.0])
    np.testing.assert_allclose(gaussian(line, 4.0), line, atol=1e-12)
    assert gaussian(line, 0.1) is line
    assert gaussian(line[:1], 4.0).shape == (1, 2)
    assert np.isfinite(gaussian(line[:3], 50.0)).all()


def test_smoothing_takes_as_much_noise_away_as_its_width_says():
    noise = np.random.default_rng(2).normal(0.0, 1.0, (20000, 1))
    left = gaussian(noise, 5.0).std()
    assert left == pytest.approx(1.0 / np.sqrt(2.0 * np.sqrt(np.pi) * 5.0), rel=0.05)


@given(masks)
def test_runs_are_the_frames_of_the_mask(mask):
    rebuilt = np.zeros(len(mask), dtype=bool)
    for start, stop in runs(mask):
        assert start < stop
        assert not rebuilt[start:stop].any()
        rebuilt[start:stop] = True
    assert (rebuilt == mask).all()


@given(masks, masks)
def test_a_latch_stays_until_it_may_not(enters, stays):
    frames = min(len(enters), len(stays))
    enters, stays = enters[:frames], stays[:frames]
    on, expected = False, []
    for enter, stay in zip(enters, stays, strict=True):
        on = bool(enter or (on and stay))
        expected.append(on)
    assert latched(enters, stays).tolist() == expected


def test_the_last_value_is_held():
    mask = np.array([False, True, False, False, True])
    held = hold_last(mask, np.arange(5.0))
    assert held.tolist() == [np.inf, 1.0, 1.0, 1.0, 4.0]


def test_a_sliding_mean_has_fewer_frames_at_the_ends():
    np.testing.assert_allclose(sliding_mean(np.array([0.0, 1.0, 2.0, 3.0]), 1), [0.5, 1, 2, 2.5])


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=60), st.integers(0, 12))
def test_an_envelope_is_never_under_what_is_needed(need, frames):
    need = np.array(need)
    over = envelope(need, frames)
    assert (over >= need).all()
    assert over.max() <= need.max() + 1e-12


def test_an_envelope_of_a_spike_is_smooth():
    need = np.zeros(101)
    need[50] = 1.0
    over = envelope(need, 10)
    assert np.abs(np.diff(over)).max() < 0.12
    assert over[20] == 0.0
