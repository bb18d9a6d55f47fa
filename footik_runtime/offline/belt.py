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


def belt_velocity(height: Array, velocity: Array, missing: Bools, fps: float, left: float) -> Array:
    """(3,) velocity of what the feet stand on, m/s: zero but on a treadmill or in place.

    The mode of low points' slowly changing velocities, by mean shift, the lower the surer. height
    (T, N), velocity (T, N, 3), missing (T, N); left: noise of the velocity, m/s an axis.
    """
    still = np.zeros(3)
    n = max(1, round(_STEP * fps))
    if len(height) <= 2 * n or missing.all():
        return still
    change = np.full(height.shape, np.inf)
    change[n:-n] = np.linalg.norm((velocity[2 * n :] - velocity[: -2 * n])[..., :2], axis=-1)
    seen = ~missing.all(axis=0)
    known = np.where(missing, np.nan, height)[:, seen]
    over = np.full(height.shape, np.inf)
    over[:, seen] = known - np.nanpercentile(known, 2.0, axis=0)
    low = np.zeros(height.shape, dtype=bool)
    low[:, seen] = known < np.nanmedian(known, axis=0)
    uneven = _SHARE * np.linalg.norm(velocity[..., :2], axis=-1)
    rising = np.abs(velocity[..., 2]) >= np.maximum(_RISE, uneven) + 2.0 * left
    steady = low & (change < np.maximum(_CHANGE, uneven) + 4.0 * left) & ~rising & ~missing
    samples, weights = velocity[steady], np.exp(-np.maximum(over[steady], 0.0) / _LOW)
    if len(samples) < _FEWEST:
        return still
    apart = max(len(samples) // _SAMPLES, 1)
    samples, weights = samples[::apart], weights[::apart]
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
