"""A clip's curves in the extras of a glTF animation, as in a curve file: keys and how to join them.

glTF has channels for nodes only; extras are what it keeps for everything else.
"""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.formats.glb_container import Gltf
from footik_runtime.formats.gltf_tracks import Grid
from footik_runtime.offline.curve_keys import CURVE_KEYS, Interpolation, Keys

Array = NDArray[np.float64]

CURVES, LOOP, TIP = "footik_curves", "footik_loop", "footik_tip"
KINDS = get_args(Interpolation)


def with_curves(extras: dict[str, Any], clip: Clip) -> dict[str, Any]:
    """An animation's extras with a clip's curves and loop mark in place of those it had."""
    extras = {name: value for name, value in extras.items() if name not in (CURVES, LOOP)}
    if clip.curves:
        extras[CURVES] = {
            "footik_curves": 1,
            "fps": clip.fps,
            "frames": len(clip),
            "clip": clip.name,
            "curves": {name: _keys(clip, name) for name in clip.curves},
        }
    if clip.loop:
        extras[LOOP] = True
    return extras


def _keys(clip: Clip, name: str) -> dict[str, Any]:
    """A curve's own keys, where they give its frames to the last bit; else one key a frame.

    Of the latter, those whose value both neighbours have are left out: linear, and still exact.
    """
    values = np.asarray(clip.curves[name], dtype=np.float64)
    known = clip.extras.get(CURVE_KEYS, {}).get(name)
    if known is not None:
        given = (known.times, known.values, known.slopes)
        if np.array_equal(_sampled(*given, known.interpolation, clip.times), values):
            return _written(*given, known.interpolation)
    kept = np.ones(len(values), dtype=bool)
    kept[1:-1] = (values[1:-1] != values[:-2]) | (values[1:-1] != values[2:])
    frames = np.flatnonzero(kept)
    return _written(frames / clip.fps, values[frames], np.zeros(len(frames)), "linear")


def _written(times: Array, values: Array, slopes: Array, kind: str) -> dict[str, Any]:
    keys = {"times": times.tolist(), "values": values.tolist(), "interpolation": kind}
    if kind == "smooth" and slopes.any():
        keys["slopes"] = slopes.tolist()
    return keys


def read_curves(gltf: Gltf, held: Any, grid: Grid) -> tuple[dict[str, Array], dict[str, Keys]]:
    """Curves (T,) of an animation's extras, on its frames, and the keys of those that have some.

    "smooth" is Hermite's cubic with the slopes that are there, or zero; "step" holds.
    """
    if held is None:
        return {}, {}
    where = f"extras.{CURVES}"
    frames = np.arange(grid.frames) / grid.fps
    found: dict[str, Array] = {}
    made: dict[str, Keys] = {}
    for name, curve in gltf.get(held, "curves", dict, where).items():
        own = f"the curve {name[:60]!r} of {where}"
        count = len(gltf.get(curve, "times", list, own))
        times, values, slopes = (
            gltf.numbers(curve, key, count, own) for key in ("times", "values", "slopes")
        )
        if not count or times is None or values is None or (np.diff(times) <= 0.0).any():
            gltf.fail(f"{own} needs as many values as times, and times that grow")
        kind = gltf.get(curve, "interpolation", str, own, "linear")
        if kind not in KINDS:
            gltf.fail(f"the interpolation of {own} is {kind[:20]!r}, not {KINDS}")
        slopes = np.zeros(count) if slopes is None else slopes
        found[name] = _sampled(times, values, slopes, kind, frames)
        if kind != "linear":  # lines through every frame are no keys that anyone made
            made[name] = Keys(times=times, values=values, slopes=slopes, interpolation=kind)
    return found, made


def _sampled(times: Array, values: Array, slopes: Array, kind: str, at: Array) -> Array:
    """(T,) a curve's keys at times, s; before the first and after the last key it holds."""
    if len(times) == 1:
        return np.full(len(at), values[0])
    near = 1e-9 * max(1.0, float(times[-1]))  # a frame rate read from float32 is off by a hair
    k = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    span, rise = times[k + 1] - times[k], values[k + 1] - values[k]
    u = np.clip((at - times[k]) / span, 0.0, 1.0)
    if kind == "step":
        return np.where(u < 1.0, values[k], values[k + 1])
    a, b = slopes[k] * span, slopes[k + 1] * span
    if kind == "smooth":
        mixed = values[k] + u * (a + u * ((3.0 * rise - 2.0 * a - b) + u * (a + b - 2.0 * rise)))
    else:
        mixed = values[k] + u * rise
    late, early = times[k + 1] - at <= near, at - times[k] <= near
    return np.where(early, values[k], np.where(late, values[k + 1], mixed))
