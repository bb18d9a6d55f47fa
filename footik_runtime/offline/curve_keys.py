"""Curves by few keys: cubic, linear or stepped between them, as animation tools keep them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.compiled import compiled
from footik_runtime.errors import FootIKError, unknown_name

Array = NDArray[np.float64]
Interpolation = Literal["smooth", "linear", "step"]

CURVE_KEYS = "curve_keys"
"""The entry of a clip's extras that holds name -> `Keys` of its curves, where they have some."""

_KINDS = {name: kind for kind, name in enumerate(get_args(Interpolation))}
_LINEAR = _KINDS["linear"]
_INFINITY = float("inf")


@dataclass(frozen=True, kw_only=True, eq=False)
class Keys:
    """K keys of one curve; before the first and after the last it keeps their values.

    Attributes:
        times: (K,) s, increasing.
        values: (K,).
        interpolation: "smooth" is the cubic of Hermite, "linear" the straight line, "step" holds
            a key's value until the next.
        slopes: (K,) a second, of smooth keys; zeros by default, which makes smoothsteps.
    """

    times: Array
    values: Array
    interpolation: Interpolation = "smooth"
    slopes: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if self.interpolation not in _KINDS:
            raise unknown_name("interpolation", str(self.interpolation), _KINDS)
        set_field = object.__setattr__
        if np.size(self.slopes) == 0:
            set_field(self, "slopes", np.zeros(np.shape(self.times)))
        for name in ("times", "values", "slopes"):
            value = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            if value.ndim != 1 or len(value) == 0 or len(value) != np.size(self.times):
                raise FootIKError(
                    f"a curve needs as many {name} as times, at least one, "
                    f"not {np.shape(value)} for {np.shape(self.times)}."
                )
            if not np.isfinite(value).all():
                bad = int(np.flatnonzero(~np.isfinite(value))[0])
                raise FootIKError(f"the curve's {name} are not finite at key {bad}.")
            set_field(self, name, value)
        if (np.diff(self.times) <= 0.0).any():
            bad = int(np.flatnonzero(np.diff(self.times) <= 0.0)[0]) + 1
            raise FootIKError(
                f"the times of a curve's keys must increase, but key {bad} at "
                f"{self.times[bad]:g} s follows {self.times[bad - 1]:g} s."
            )

    def __len__(self) -> int:
        return len(self.times)

    def part(self, start: float, stop: float) -> Keys:
        """The keys from start to stop seconds, exactly the same curve there, moved to begin at 0.

        Where the curve is not constant at a cut, a key with its value and slope is put there.
        """
        inside = (self.times > start) & (self.times < stop)
        edges = np.array([start, stop])
        values, slopes = _with_slopes(self, edges)
        steady = slopes == 0.0
        if self.interpolation == "step":
            steady[:] = True
        first = self.values[inside][:1]
        keep_start = not inside.any() or not steady[0] or first[0] != values[0]
        last = self.values[inside][-1:]
        keep_stop = inside.any() and (not steady[1] or last[0] != values[1])
        keep_stop |= not inside.any() and (not steady.all() or values[0] != values[1])
        ends = [keep_start, *np.ones(inside.sum(), dtype=bool), keep_stop]
        return Keys(
            times=np.array([start, *self.times[inside], stop])[ends] - start,
            values=np.array([values[0], *self.values[inside], values[1]])[ends],
            slopes=np.array([slopes[0], *self.slopes[inside], slopes[1]])[ends],
            interpolation=self.interpolation,
        )


def sample(keys: Keys, times: Array) -> Array:
    """(N,) values of a curve at times in seconds, in any order."""
    return _with_slopes(keys, times)[0]


def _with_slopes(keys: Keys, times: Array) -> tuple[Array, Array]:
    times = np.ascontiguousarray(times, dtype=np.float64)
    values, slopes = np.empty(times.shape), np.empty(times.shape)
    kind = _KINDS[keys.interpolation]
    _sample(keys.times, keys.values, keys.slopes, kind, times, values, slopes)
    return values, slopes


@compiled
def _sample(key_times, key_values, key_slopes, kind, times, values, slopes):
    """Values and slopes (N,) at times (N,); quick where the times increase."""
    last = key_times.shape[0] - 1
    k = -1  # the key at or before the time
    for i in range(times.shape[0]):
        t = times[i]
        while k >= 0 and key_times[k] > t:
            k -= 1
        while k < last and key_times[k + 1] <= t:
            k += 1
        slopes[i] = 0.0
        if k < 0 or k == last or kind > _LINEAR:
            values[i] = key_values[max(k, 0)]
            continue
        length = key_times[k + 1] - key_times[k]
        rise = key_values[k + 1] - key_values[k]
        u = (t - key_times[k]) / length
        if kind == _LINEAR:
            values[i] = key_values[k] + u * rise
            slopes[i] = rise / length
            continue
        a = key_slopes[k] * length
        b = key_slopes[k + 1] * length
        # Hermite's cubic as value + u (a + u (...)), exact at both keys' ends of a constant.
        c2 = 3.0 * rise - 2.0 * a - b
        c3 = a + b - 2.0 * rise
        values[i] = key_values[k] + u * (a + u * (c2 + u * c3))
        slopes[i] = (a + u * (2.0 * c2 + u * 3.0 * c3)) / length


def keys_of(clip: Clip, name: str, tolerance: float = 0.005) -> Keys:
    """The keys of one of a clip's curves: those it came with or was baked with, else thinned ones.

    Keys that no longer give the clip's frames, as after a cut, are not used.
    """
    if name not in clip.curves:
        raise unknown_name("curve", name, clip.curves)
    values = np.asarray(clip.curves[name], dtype=np.float64)
    known = clip.extras.get(CURVE_KEYS, {}).get(name)
    if known is not None and np.abs(sample(known, clip.times) - values).max() < 1e-9:
        return known
    return thinned(values, clip.fps, tolerance)


def thinned(values: Array, fps: float, tolerance: float) -> Keys:
    """Few linear keys that stay within a tolerance of values (T,) at every frame.

    Stepped keys where all values are whole numbers that change within a frame, as phases do.
    """
    values = np.asarray(values, dtype=np.float64)
    changes = np.flatnonzero(np.diff(values) != 0.0) + 1
    if np.array_equal(values, np.round(values)) and len(changes) < 0.5 * len(values):
        frames = np.concatenate([[0], changes])
        # A change lies half-way between two frames, where the contact it tells of began or ended.
        times = np.concatenate([[0.0], (changes - 0.5) / fps])
        return Keys(times=times, values=values[frames], interpolation="step")
    kept = np.zeros(len(values), dtype=np.uint8)
    kept[0] = kept[-1] = 1
    _thin(values, float(tolerance), kept)
    frames = np.flatnonzero(kept)
    return Keys(times=frames / fps, values=values[frames], interpolation="linear")


@compiled
def _thin(values, tolerance, kept):
    """Mark the frames to keep, from the first on: each line as long as it stays in the tolerance.

    The line's slope is kept within the narrowest cone from its first key to the frames so far.
    """
    start, last = 0, values.shape[0] - 1
    while start < last:
        low, high = -_INFINITY, _INFINITY
        end = start + 1
        for i in range(start + 1, last + 1):
            slope = (values[i] - values[start]) / (i - start)
            if low <= slope <= high:
                end = i
            low = max(low, (values[i] - tolerance - values[start]) / (i - start))
            high = min(high, (values[i] + tolerance - values[start]) / (i - start))
            if low > high:
                break
        kept[end] = 1
        start = end
