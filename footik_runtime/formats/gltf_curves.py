"""A clip's curves in the extras of a glTF animation, as in a curve file: keys and how to join them.

glTF has channels for nodes only; extras are what it keeps for everything else.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.formats.glb_container import Gltf
from footik_runtime.formats.gltf_tracks import Grid

Array = NDArray[np.float64]

CURVES, LOOP, TIP = "footik_curves", "footik_loop", "footik_tip"
KINDS = ("linear", "smooth", "step")


def with_curves(extras: dict[str, Any], clip: Clip) -> dict[str, Any]:
    """An animation's extras with a clip's curves and loop mark in place of those it had."""
    extras = {name: value for name, value in extras.items() if name not in (CURVES, LOOP)}
    if clip.curves:
        extras[CURVES] = {
            "footik_curves": 1,
            "fps": clip.fps,
            "frames": len(clip),
            "clip": clip.name,
            "curves": {name: _keys(np.asarray(v), clip.fps) for name, v in clip.curves.items()},
        }
    if clip.loop:
        extras[LOOP] = True
    return extras


def _keys(values: Array, fps: float) -> dict[str, Any]:
    """One key a frame, without those whose value both neighbours have: linear, and exact."""
    kept = np.ones(len(values), dtype=bool)
    kept[1:-1] = (values[1:-1] != values[:-2]) | (values[1:-1] != values[2:])
    frames = np.flatnonzero(kept)
    return {
        "times": (frames / fps).tolist(),
        "values": values[frames].astype(np.float64).tolist(),
        "interpolation": "linear",
    }


def read_curves(gltf: Gltf, held: Any, grid: Grid) -> dict[str, Array]:
    """Curves (T,) of an animation's extras: "smooth" eases between keys, "step" holds."""
    if held is None:
        return {}
    where = f"extras.{CURVES}"
    frames = np.arange(grid.frames) / grid.fps
    found: dict[str, Array] = {}
    for name, curve in gltf.get(held, "curves", dict, where).items():
        own = f"the curve {name[:60]!r} of {where}"
        count = len(gltf.get(curve, "times", list, own))
        times, values = (gltf.numbers(curve, key, count, own) for key in ("times", "values"))
        if not count or times is None or values is None or (np.diff(times) < 0.0).any():
            gltf.fail(f"{own} needs as many values as times, and times that grow")
        kind = gltf.get(curve, "interpolation", str, own, "linear")
        if kind not in KINDS:
            gltf.fail(f"the interpolation of {own} is {kind[:20]!r}, not {KINDS}")
        found[name] = _sampled(times, values, kind, frames, 1e-3 / grid.fps)
    return found


def _sampled(times: Array, values: Array, kind: str, at: Array, near: float) -> Array:
    """A curve's keys at times (T,), s; a frame as near to a key as `near` has its value exactly."""
    if len(times) == 1:
        return np.full(len(at), values[0])
    k = np.clip(np.searchsorted(times, at + near, side="right") - 1, 0, len(times) - 2)
    span = times[k + 1] - times[k]
    u = np.clip((at - times[k]) / np.where(span > 0.0, span, 1.0), 0.0, 1.0)
    u = np.where(at - times[k] <= near, 0.0, np.where(times[k + 1] - at <= near, 1.0, u))
    if kind == "step":
        return np.where(u < 1.0, values[k], values[k + 1])
    if kind == "smooth":
        u = u * u * (3.0 - 2.0 * u)
    mixed = values[k] + (values[k + 1] - values[k]) * u
    return np.where(u >= 1.0, values[k + 1], mixed)
