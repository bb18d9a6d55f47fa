"""Filters over frames: smooth curves, curves that are nowhere under a need, runs of a mask."""

from __future__ import annotations

import math

import numpy as np

from footik_runtime.offline.stages import Array, Bools, Ints

_WIDTH = 3.5  # sigmas on either side
_NARROWEST = 0.3  # frames: a narrower Gaussian is none


def gaussian(values: Array, sigma_frames: float) -> Array:
    """Values (N, ...) smoothed along frames; ends are reflected oddly, so that they stay.

    x[-k] = 2 x[0] - x[k]: a slope goes on, where an even reflection would end at rest.
    """
    if sigma_frames < _NARROWEST or len(values) < 2:
        return values.copy()
    # No farther than the reflection reaches.
    half = min(math.ceil(_WIDTH * sigma_frames), len(values) - 1)
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / sigma_frames) ** 2)
    kernel /= kernel.sum()
    last = len(values) - 1
    frames = np.arange(-half, last + half + 1)
    inside = np.clip(frames, 0, last)
    flat = values.reshape(len(values), -1)
    padded = flat[inside]
    for beyond, end in ((frames < 0, 0), (frames > last, last)):
        padded[beyond] = 2.0 * flat[end] - flat[2 * end - frames[beyond]]
    out = np.stack([np.convolve(column, kernel, "valid") for column in padded.T], axis=-1)
    return out.reshape(values.shape)


def envelope(need: Array, frames: int) -> Array:
    """(N,) a smooth curve that is nowhere under need (N,): its maximum around, then a Hann mean.

    Both reach as far, so the mean of the maxima cannot fall below any of what they are of.
    """
    if frames < 1 or len(need) == 0:
        return need.copy()
    padded = np.concatenate([np.full(2 * frames, need[0]), need, np.full(2 * frames, need[-1])])
    highest = np.lib.stride_tricks.sliding_window_view(padded, 2 * frames + 1).max(axis=-1)
    window = np.hanning(2 * frames + 3)[1:-1]
    return np.convolve(highest, window / window.sum(), "valid")


def runs(mask: Bools) -> Ints:
    """(R, 2) first frame and frame after the last of each run of True in (N,)."""
    edges = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0))
    return edges.reshape(-1, 2).astype(np.int64)
