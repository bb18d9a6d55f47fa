"""Belt: the velocity of what the feet stand on, for motion on a treadmill or in place."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

_STEP = 0.05  # s over which a velocity that belongs to a belt stays as it is
_CHANGE, _RISE = 0.35, 0.35  # m/s, of such a velocity over that time, and upwards
_WIDTH = 0.15  # m/s, of the mode's kernel
_LEAST = 0.3  # m/s: slower is drift
_SAMPLES = 400


def belt_velocity(height: Array, velocity: Array, missing: Bools, fps: float, left: float) -> Array:
    """(3,) velocity of what the feet stand on, m/s: zero but on a treadmill or in place.

    The mode of low points' slowly changing velocities, by mean shift. height (T, N), velocity (T,
    N, 3), missing (T, N); left: noise of the velocity, m/s an axis.
    """
    still = np.zeros(3)
    n = max(1, round(_STEP * fps))
    if len(height) <= 2 * n or missing.all():
        return still
    change = np.full(height.shape, np.inf)
    change[n:-n] = np.linalg.norm(velocity[2 * n :] - velocity[: -2 * n], axis=-1)
    known = np.where(missing, np.nan, height)[:, ~missing.all(axis=0)]
    low = np.zeros(height.shape, dtype=bool)
    low[:, ~missing.all(axis=0)] = known < np.nanmedian(known, axis=0)
    rising = np.abs(velocity[..., 2]) >= _RISE + 2.0 * left
    steady = low & (change < _CHANGE + 4.0 * left) & ~rising & ~missing
    samples = velocity[steady]
    if len(samples) < 20:
        return still
    samples = samples[:: max(len(samples) // _SAMPLES, 1)]
    width = math.hypot(_WIDTH, 1.5 * left)
    apart = np.sum((samples[:, None, :2] - samples[None, :, :2]) ** 2, axis=-1)
    density = np.exp(-0.5 * apart / width**2).sum(axis=1)
    at_rest = np.exp(-0.5 * np.sum(samples[:, :2] ** 2, axis=-1) / width**2).sum()
    peak = samples[int(density.argmax())]
    for _ in range(10):
        weight = np.exp(-0.5 * np.sum((samples[:, :2] - peak[:2]) ** 2, axis=-1) / width**2)
        peak = (weight[:, None] * samples).sum(axis=0) / weight.sum()
    if math.hypot(peak[0], peak[1]) < _LEAST or density.max() < 2.0 * at_rest:
        return still
    return peak
