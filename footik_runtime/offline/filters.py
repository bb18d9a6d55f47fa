"""Filters: noise measured, gaps filled, paths smoothed, and runs of frames found."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from footik_runtime.compiled import compiled

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

_ORDER = 4  # of the difference that leaves noise and takes motion out
_GAIN = math.sqrt(70.0)  # of white noise through it: sqrt of the sum of squares of 1 4 6 4 1
_NORMAL = 0.6745  # median of |x| of a standard normal
_WIDTH = 3.5  # sigmas on either side that a Gaussian is cut at
_NARROW = 0.3  # frames: a narrower Gaussian changes nothing


def noise_sd(points: Array) -> float:
    """Standard deviation of white noise on points (T, N, 3), m, NaN where missing.

    The median of fourth differences, which slow motion does not reach. 0 where too little is known.
    """
    if len(points) <= _ORDER:
        return 0.0
    change = np.abs(np.diff(points, _ORDER, axis=0))
    known = np.asarray(np.isfinite(change).all(axis=-1))
    medians = [
        np.median(change[known[:, i], i]) for i in range(points.shape[1]) if known[:, i].sum() >= 5
    ]
    return float(np.median(medians)) / _NORMAL / _GAIN if medians else 0.0


def fill_gaps(points: Array) -> tuple[Array, Bools]:
    """Points (T, N, 3) with straight lines over what is missing, and (T, N) what was.

    Ends are held; a point that is never known is zero.
    """
    missing = np.asarray(~np.isfinite(points).all(axis=-1))
    if not missing.any():
        return points, missing
    filled, frames = points.copy(), np.arange(len(points))
    for i in np.flatnonzero(missing.any(axis=0)):
        gone = missing[:, i]
        for axis in range(3):
            known = points[~gone, i, axis]
            filled[gone, i, axis] = (
                np.interp(frames[gone], frames[~gone], known) if len(known) else 0.0
            )
    return filled, missing


def gaussian(values: Array, sigma: float) -> Array:
    """Values (T, ...) smoothed along T by a Gaussian, sigma in frames.

    Continued at the ends by odd reflection, so that a velocity there stays what it is: an even one
    would make it zero, which looks like contact.
    """
    reach = min(math.ceil(_WIDTH * sigma), len(values) - 1)
    if sigma < _NARROW or reach < 1:
        return values
    at = np.arange(-reach, reach + 1) / sigma
    kernel = np.exp(-0.5 * at * at)
    flat = values.reshape(len(values), -1)
    before = 2.0 * flat[:1] - flat[reach:0:-1]
    after = 2.0 * flat[-1:] - flat[-2 : -reach - 2 : -1]
    out = np.empty_like(flat)
    _convolve(np.concatenate([before, flat, after]), kernel / kernel.sum(), out)
    return out.reshape(values.shape)


@compiled
def _convolve(padded, kernel, out):
    """Rows of `out` (T, N): the kernel (2R + 1,) laid on rows of `padded` (T + 2R, N)."""
    for t in range(out.shape[0]):
        for i in range(out.shape[1]):
            total = 0.0
            for k in range(kernel.shape[0]):
                total += kernel[k] * padded[t + k, i]
            out[t, i] = total


def envelope(need: Array, frames: int) -> Array:
    """A smooth curve over `need` (T,), nowhere under it: what lies within `frames` is foreseen.

    The largest value within that distance, averaged by a Hann window of the same width.
    """
    if frames < 1 or len(need) == 0:
        return need.copy()
    padded = np.pad(need, 2 * frames, mode="edge")
    largest = np.lib.stride_tricks.sliding_window_view(padded, 2 * frames + 1).max(axis=-1)
    window = np.hanning(2 * frames + 3)[1:-1]
    return np.maximum(np.convolve(largest, window / window.sum(), "valid"), need)


def sliding_mean(values: Array, frames: int) -> Array:
    """Values (T,) averaged over `frames` to either side, fewer at the ends."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    at = np.arange(len(values))
    low, high = np.maximum(at - frames, 0), np.minimum(at + frames + 1, len(values))
    return (sums[high] - sums[low]) / (high - low)


def runs(mask: Bools) -> Ints:
    """(R, 2) start and stop of each run of True in (T,)."""
    edges = np.diff(np.concatenate([[0], np.asarray(mask, np.int8), [0]]))
    return np.flatnonzero(edges).reshape(-1, 2)


def latched(enters: Bools, stays: Bools) -> Bools:
    """(T,) True from where a frame enters for as long as the frames stay."""
    decides = enters | ~stays
    last = np.maximum.accumulate(np.where(decides, np.arange(len(enters)), -1))
    return (last >= 0) & enters[np.maximum(last, 0)]


def hold_last(mask: Bools, values: Array) -> Array:
    """(T,) the value at the last frame of the mask; infinite before the first."""
    last = np.maximum.accumulate(np.where(mask, np.arange(len(mask)), -1))
    return np.where(last >= 0, values[np.maximum(last, 0)], np.inf)


def contact_spans(mask: Bools) -> Ints:
    """(K, 3) column, start and stop of each run of True in (T, N), by column."""
    frames, columns = mask.shape
    padded = np.zeros((columns, frames + 2), dtype=bool)
    padded[:, 1:-1] = mask.T
    column, edge = np.nonzero(padded[:, 1:] != padded[:, :-1])
    return np.stack([column[::2], edge[::2], edge[1::2]], axis=1).astype(np.int64)


def span_medians(values: Array, spans: Ints) -> Array:
    """(K,) medians of values (T, N) within spans (K, 3), as of `contact_spans`."""
    out = np.empty(len(spans))
    _span_medians(np.ascontiguousarray(values), spans, np.empty(len(values)), out)
    return out


def span_means(points: Array, spans: Ints) -> Array:
    """(K, 3) means of points (T, N, 3) within spans (K, 3), as of `contact_spans`."""
    out = np.zeros((len(spans), 3))
    _span_means(points, spans, out)
    return out


@compiled
def _span_medians(values, spans, scratch, out):
    for k in range(spans.shape[0]):
        column, start, stop = spans[k, 0], spans[k, 1], spans[k, 2]
        for t in range(start, stop):
            scratch[t - start] = values[t, column]
        out[k] = median_of(scratch, stop - start)


@compiled
def _span_means(points, spans, out):
    for k in range(spans.shape[0]):
        column, start, stop = spans[k, 0], spans[k, 1], spans[k, 2]
        for t in range(start, stop):
            for c in range(3):
                out[k, c] += points[t, column, c] / (stop - start)


@compiled
def median_of(scratch, count):
    """The median of the first `count` of scratch, which are put out of order (Hoare's select)."""
    upper = _selected(scratch, count, count // 2)
    if count % 2 == 1:
        return upper
    # What is left of the place is no larger.
    lower = scratch[0]
    for i in range(1, count // 2):
        lower = max(lower, scratch[i])
    return 0.5 * (lower + upper)


@compiled
def _selected(scratch, count, place):
    """The value that sorting would put at `place`; smaller ones end up left of it."""
    low, high = 0, count - 1
    while low < high:
        pivot = scratch[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while scratch[i] < pivot:
                i += 1
            while scratch[j] > pivot:
                j -= 1
            if i <= j:
                scratch[i], scratch[j] = scratch[j], scratch[i]
                i += 1
                j -= 1
        if place <= j:
            high = j
        elif place >= i:
            low = i
        else:
            break
    return scratch[place]
