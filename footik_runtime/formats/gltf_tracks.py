"""glTF's animation channels: their keys, the frames all of them fall on, and values there.

Values stay in the file's axes and units, to the last bit where a key lies on a frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footik_runtime.errors import FootIKError
from footik_runtime.formats.glb_container import Gltf

Array = NDArray[np.float64]

WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
INTERPOLATIONS = ("LINEAR", "STEP", "CUBICSPLINE")
ON_FRAME = 0.01  # frames: a key so near to a frame is on it; float32 seconds are no finer
USUAL_RATES = (24.0, 25.0, 30.0, 48.0, 50.0, 60.0, 90.0, 100.0, 120.0)
_BROADCAST = (24000 / 1001, 30000 / 1001, 60000 / 1001, 120000 / 1001)
# What a file may unfold to: frames a key of its densest channel, and cells (a joint in
# a frame) a byte. Few are always read; many where the frame rate is asked for.
FRAMES_PER_KEY, FEW_FRAMES = 16, 600
BYTES_PER_CELL, FEW_CELLS, MANY_CELLS = 16, 400_000, 10_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """One channel of an animation.

    Attributes:
        channel, sampler: its indices in the animation.
        node, path: what it moves.
        interpolation: one of INTERPOLATIONS.
        input, output: accessor indices.
        times: (K,) s, growing.
    """

    channel: int
    sampler: int
    node: int
    path: str
    interpolation: str
    input: int
    output: int
    times: Array


@dataclass(frozen=True, kw_only=True)
class Grid:
    """T frames: frame i is at start + i / fps seconds of the file. exact: every key is on one."""

    start: float
    fps: float
    frames: int
    exact: bool


def read_tracks(gltf: Gltf, animation: int) -> list[Track]:
    """The channels that move nodes; those of morph weights, and of no node, are left alone."""
    owner, where = gltf.item("animations", animation), f"animations[{animation}]"
    samplers = gltf.get(owner, "samplers", list, where)
    times: dict[int, Array] = {}
    tracks: list[Track] = []
    seen = set()
    for c, channel in enumerate(gltf.get(owner, "channels", list, where)):
        own = f"channels[{c}] of {where}"
        target = gltf.get(channel, "target", dict, own)
        path = gltf.get(target, "path", str, own)
        if path not in WIDTHS or "node" not in target:
            continue
        node = gltf.get(target, "node", int, own)
        gltf.item("nodes", node)
        if (node, path) in seen:
            gltf.fail(f"{own} is a second one for the {path} of nodes[{node}]")
        seen.add((node, path))
        s = gltf.get(channel, "sampler", int, own)
        if not 0 <= s < len(samplers):
            gltf.fail(f"{own} has sampler {s}; the animation has {len(samplers)}")
        own = f"samplers[{s}] of {where}"
        kind = gltf.get(samplers[s], "interpolation", str, own, "LINEAR")
        if kind not in INTERPOLATIONS:
            gltf.fail(f"the interpolation of {own} is {kind[:20]!r}, not {INTERPOLATIONS}")
        keys = gltf.get(samplers[s], "input", int, own)
        if keys not in times:
            times[keys] = _key_times(gltf, keys, own)
        tracks.append(
            Track(
                channel=c,
                sampler=s,
                node=node,
                path=path,
                interpolation=kind,
                input=keys,
                output=gltf.get(samplers[s], "output", int, own),
                times=times[keys],
            )
        )
    return tracks


def _key_times(gltf: Gltf, accessor: int, where: str) -> Array:
    times = gltf.accessor(accessor, ("SCALAR",), where)[:, 0]
    if not len(times):
        gltf.fail(f"{where} has no keys")
    if (np.diff(times) <= 0.0).any() or times[0] < 0.0:
        late = int(np.argmax(np.diff(times, prepend=-1e-30) <= 0.0))
        gltf.fail(f"the times of {where} must grow from 0 on; key {late} is at {times[late]:g} s")
    return times


def key_values(gltf: Gltf, track: Track) -> Array:
    """(K, width) values of a track, or (K, 3, width) with tangents around, as the file has them."""
    kind = "VEC4" if track.path == "rotation" else "VEC3"
    where = f"the {track.path} of nodes[{track.node}]"
    values = gltf.accessor(track.output, (kind,), where)
    per_key = 3 if track.interpolation == "CUBICSPLINE" else 1
    if len(values) != per_key * len(track.times):
        gltf.fail(f"{where} has {len(track.times)} times, but {len(values)} values")
    if per_key == 3:
        values = values.reshape(len(track.times), 3, -1)
    if kind == "VEC4":
        lengths = np.linalg.norm(values[:, 1] if per_key == 3 else values, axis=-1)
        if (lengths < 1e-6).any():
            gltf.fail(f"{where} has zero length at key {int(np.argmin(lengths))}")
    return values


def find_grid(gltf: Gltf, tracks: list[Track], joints: int, fps: float | None) -> Grid:
    """The frames of tracks: of the rate on which all keys fall, if one does.

    Raises FootIKError where so few bytes would become a clip out of all proportion.
    """
    start = min(float(track.times[0]) for track in tracks)
    end = max(float(track.times[-1]) for track in tracks)
    if end <= start:
        return Grid(start=start, fps=fps or 30.0, frames=1, exact=True)
    distinct = {track.input: track.times for track in tracks}
    densest = max(distinct.values(), key=len)
    steps = np.diff(densest) if len(densest) > 1 else np.array([end - start])
    rate = fps or _snapped(1.0 / max(float(np.median(steps)), 1e-9))
    keys = [times - start for times in distinct.values()]
    if fps is None and not _fits(keys, rate):
        better = (_snapped(2.0 * rate), *(r for r in USUAL_RATES if r > rate))
        rate = next((r for r in better if _fits(keys, r)), rate)
    frames = round((end - start) * rate) + 1
    most = max(len(gltf.raw) // BYTES_PER_CELL, FEW_CELLS if fps is None else MANY_CELLS) // joints
    if fps is None:
        most = min(most, FRAMES_PER_KEY * len(densest) + FEW_FRAMES)
    if frames > most:
        gltf.fail(
            f"the keys lie from {start:g} s to {end:g} s, which at {rate:g} frames a second makes "
            f"{frames} frames of {joints} joints; at most {most} are read: give a lower fps"
        )
    exact = _fits(keys, rate)
    if not exact and frames > 1:  # the last frame is the last key in any case
        rate = (frames - 1) / (end - start)
    return Grid(start=start, fps=rate, frames=max(frames, 1), exact=exact)


def _snapped(rate: float) -> float:
    """The whole or broadcast rate that float32 seconds must mean, if one is near."""
    for known in (*_BROADCAST, float(round(rate))):
        if abs(rate - known) <= 2e-4 * known:
            return known
    return rate


def _fits(keys: list[Array], rate: float) -> bool:
    return all(_places(times * rate) is not None for times in keys)


def _places(frames: Array) -> Array | None:
    """The whole frames that key times, in frames, lie on; None where one lies between."""
    whole = np.round(frames)
    near = np.abs(frames - whole) <= ON_FRAME + 1e-6 * np.abs(frames)
    return whole if near.all() and (np.diff(whole) > 0.0).all() else None


def is_dense(track: Track, grid: Grid) -> bool:
    """Whether a track has exactly one key on each frame."""
    places = _places((track.times - grid.start) * grid.fps)
    return places is not None and len(places) == grid.frames and places[0] == 0.0


def sample(track: Track, values: Array, grid: Grid) -> Array:
    """(T, width) of a track on the grid; before its first and after its last key it holds.

    Args:
        track: the channel.
        values: from `key_values`.
        grid: the frames.
    """
    cubic = track.interpolation == "CUBICSPLINE"
    points = values[:, 1] if cubic else values
    if len(points) == 1:
        return np.repeat(points, grid.frames, axis=0)
    at = (track.times - grid.start) * grid.fps
    places = _places(at)
    at = at if places is None else places
    x = np.arange(grid.frames, dtype=np.float64)
    k = np.clip(np.searchsorted(at, x, side="right") - 1, 0, len(at) - 2)
    u = np.clip((x - at[k]) / (at[k + 1] - at[k]), 0.0, 1.0)[:, None]
    a, b = points[k], points[k + 1]
    if track.interpolation == "STEP":
        return np.where(u < 1.0, a, b)
    if cubic:
        span = (track.times[k + 1] - track.times[k])[:, None]
        between = _hermite(a, values[k, 2] * span, b, values[k + 1, 0] * span, u)
    elif track.path == "rotation":
        between = _slerp(a, b, u)
    else:
        between = a + (b - a) * u
    return np.where(u <= 0.0, a, np.where(u >= 1.0, b, between))


def _hermite(a: Array, leaving: Array, b: Array, arriving: Array, u: Array) -> Array:
    """Cubic spline interpolation of appendix C of the specification."""
    u2, u3 = u * u, u * u * u
    return (
        (2 * u3 - 3 * u2 + 1) * a
        + (u3 - 2 * u2 + u) * leaving
        + (3 * u2 - 2 * u3) * b
        + (u3 - u2) * arriving
    )


def _slerp(a: Array, b: Array, u: Array) -> Array:
    a = a / np.linalg.norm(a, axis=-1, keepdims=True)
    b = b / np.linalg.norm(b, axis=-1, keepdims=True)
    cosine = np.sum(a * b, axis=-1, keepdims=True)
    b, cosine = np.where(cosine < 0.0, -b, b), np.minimum(np.abs(cosine), 1.0)
    angle = np.arccos(cosine)
    sine = np.sin(angle)
    small = sine < 1e-6
    safe = np.where(small, 1.0, sine)
    near = np.where(small, 1.0 - u, np.sin((1.0 - u) * angle) / safe)
    far = np.where(small, u, np.sin(u * angle) / safe)
    return near * a + far * b


def require_rate(fps: float | None) -> None:
    """Raise FootIKError for a frame rate that is none."""
    if fps is not None and not (math.isfinite(fps) and 0.0 < fps <= 1e6):
        raise FootIKError(f"fps must be positive and at most 1e6, not {fps}.")
