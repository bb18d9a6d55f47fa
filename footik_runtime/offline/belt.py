"""Belt: the velocity of what the feet stand on, for motion on a treadmill or in place."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

_STEP = 0.033  # s to either side over which a velocity that belongs to a belt stays as it is
_CHANGE, _RISE = 0.25, 0.35  # m/s, of such a velocity over that time, and upwards
_SHARE = 0.12  # of its speed, where that is more: quick feet are less even
_LOW = 0.06  # m over the lowest of a point's path at which it says e times less
_WIDTH = 0.15  # m/s, of the mode's kernel
_LEAST = 0.3  # m/s: slower is drift
_FEWEST, _SAMPLES = 8, 400
_FRAMES = 2000  # of a long clip that tell


def belt_velocity(height: Array, velocity: Array, missing: Bools, fps: float, left: float) -> Array:
    """(3,) velocity of what the feet stand on, m/s: zero but on a treadmill or in place.

    The mode of low points' slowly changing velocities, by mean shift, the lower the surer. height
    (T, N), velocity (T, N, 3), missing (T, N); left: noise of the velocity, m/s an axis.
    """
    still = np.zeros(3)
    samples, weights = _steady(height, velocity, missing, max(1, round(_STEP * fps)), left)
    if len(samples) < _FEWEST:
        return still
    width = math.hypot(_WIDTH, 1.5 * left)
    apart = np.sum((samples[:, None, :2] - samples[None, :, :2]) ** 2, axis=-1)
    density = np.exp(-0.5 * apart / width**2) @ weights
    at_rest = np.exp(-0.5 * np.sum(samples[:, :2] ** 2, axis=-1) / width**2) @ weights
    peak = samples[int(density.argmax())]
    for _ in range(10):
        near = np.exp(-0.5 * np.sum((samples[:, :2] - peak[:2]) ** 2, axis=-1) / width**2)
        weight = near * weights
        peak = (weight[:, None] * samples).sum(axis=0) / weight.sum()
    if math.hypot(peak[0], peak[1]) < _LEAST or density.max() < 2.0 * at_rest:
        return still
    return peak


def _steady(
    height: Array, velocity: Array, missing: Bools, n: int, left: float
) -> tuple[Array, Array]:
    """(S, 3) velocities of low points that hardly change over n frames, and the weight of each."""
    frames = np.arange(n, len(height) - n, max(1, len(height) // _FRAMES))
    seen = ~missing[frames].all(axis=0)
    if not seen.any():
        return np.zeros((0, 3)), np.zeros(0)
    known = np.where(missing[frames], np.nan, height[frames])[:, seen]
    low = np.zeros((len(frames), height.shape[1]), dtype=bool)
    low[:, seen] = known < np.nanmedian(known, axis=0)
    t, i = np.nonzero(low)
    t = frames[t]
    samples = velocity[t, i]
    change = np.linalg.norm((velocity[t + n, i] - velocity[t - n, i])[:, :2], axis=-1)
    uneven = _SHARE * np.linalg.norm(samples[:, :2], axis=-1)
    level = np.abs(samples[:, 2]) < np.maximum(_RISE, uneven) + 2.0 * left
    steady = level & (change < np.maximum(_CHANGE, uneven) + 4.0 * left)
    lowest = np.zeros(height.shape[1])
    lowest[seen] = np.nanpercentile(known, 2.0, axis=0)
    over = np.maximum(height[t, i] - lowest[i], 0.0)[steady]
    apart = max(int(steady.sum()) // _SAMPLES, 1)
    return samples[steady][::apart], np.exp(-over / _LOW)[::apart]
