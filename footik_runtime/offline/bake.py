"""Baking: weight curves for foot IK, made from a clip's own motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from footik_runtime.errors import FootIKError

Array = NDArray[np.float64]
HeightTrack = Callable[[Array], Array] | tuple[Array, Array]

OPENKCC_CURVES = ("LeftFootIKWeight", "RightFootIKWeight")


def bake_openkcc(
    heights: HeightTrack,
    *,
    length_s: float,
    rate: float = 30.0,
    foot_grounded_height: float = 0.05,
) -> Array:
    """One foot's IK weight curve as OpenKCC bakes it: 1 where the foot is low, else 0.

    It inherits two faults. Keys are sampled `1 / rate` apart but stored `1 / keys` apart, so time
    is skewed unless length * rate is whole; and only world height counts, so a foot on a stair is
    in the air.

    Args:
        heights: world height of the foot's joint, m: a function of times (N,) in seconds, or
            samples (times (K,) increasing, heights (K,)), read linearly.
        length_s: of the clip, s.
        rate: keys a second, before those that say nothing are dropped.
        foot_grounded_height: the joint's height, m, up to which the foot counts as grounded.

    Returns:
        (K, 2): normalised time 0 to 1, and value.

    Raises:
        FootIKError: the clip has no length, a rate is not positive, or a height is not finite.
    """
    if not (np.isfinite(rate) and rate > 0.0):
        raise FootIKError(f"the baking rate must be positive and finite, not {rate}.")
    if not (np.isfinite(length_s) and length_s > 0.0):
        raise FootIKError(f"cannot bake a clip of {length_s} s; its length must be positive.")
    # The count is rounded up in float32, as it was where these curves were first made.
    keys = int(np.ceil(np.float32(length_s) * np.float32(rate)))
    sampled_at = np.arange(keys) / rate
    stored_at = np.arange(keys) / keys
    sampled_at[-1], stored_at[-1] = length_s, 1.0
    track = _read(heights, sampled_at)
    bad = np.flatnonzero(~np.isfinite(track))
    if len(bad):
        raise FootIKError(f"the foot's height is not finite at {sampled_at[bad[0]]:.4g} s.")
    return _without_repeats(stored_at, np.where(track <= foot_grounded_height, 1.0, 0.0))


def _read(heights: HeightTrack, times: Array) -> Array:
    if callable(heights):
        return np.asarray(heights(times), dtype=np.float64)
    at, values = (np.asarray(part, dtype=np.float64) for part in heights)
    if at.ndim != 1 or at.shape != values.shape or len(at) == 0 or (np.diff(at) <= 0.0).any():
        raise FootIKError(
            f"a height track needs increasing times (K,) and heights (K,), "
            f"not {at.shape} and {values.shape}."
        )
    return np.interp(times, at, values)


def _without_repeats(times: Array, values: Array) -> Array:
    """Keys (K, 2) without those equal to both neighbours."""
    kept = np.ones(len(values), dtype=bool)
    kept[1:-1] = (values[1:-1] != values[:-2]) | (values[1:-1] != values[2:])
    return np.column_stack([times[kept], values[kept]])
