"""Spread: what plants ask of a foot fades into the swings around, which stay over ground."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays
from footik_runtime.compiled import compiled
from footik_runtime.inertia import decayed
from footik_runtime.math3d import (
    add,
    add_scaled,
    clamp,
    dot,
    get3,
    norm,
    quat_from_rotvec,
    rotate,
    scale,
    set3,
    sub,
)
from footik_runtime.offline import filters
from footik_runtime.offline.stages import Bools, CleanSettings, FootPaths, Ground, Plant, Working
from footik_runtime.sole import BALL, TIP

Array = NDArray[np.float64]

# Of a body whose legs are 0.85 m long; lengths scale with the leg.
_DEEPER, _DEEPEST = 0.001, 0.003  # m: a swing may be this much deeper than it was, or this deep
_ANOTHER = 0.03  # m under a plant's plane from which a foot is over other ground, surely
_PER_CHANGE = 4.0  # and what its plant changes, times this: a foot that stands well swings well
_LIFT = 0.06  # s either side over which a foot is lifted out of the ground
_INWARD, _OUTWARD, _SIDEWAYS = 4.0, 0.9, 1.0  # times |offset| / duration: overshoots by a tenth


def spread(
    paths: FootPaths,
    work: Working,
    plants: tuple[Plant, ...],
    settings: CleanSettings,
    ground: Ground | None = None,
) -> FootPaths:
    """The offsets of planted feet with their way to nothing in the swings between.

    Each fades within `ease`, with the velocity it has at the plant's end as far as that does not
    swing out; in a swing too short for two such fades it goes over from one plant to the next. A
    foot that then swings deeper in the ground than it did is lifted.
    """
    ease = settings.ease * work.clip.fps
    out = [v.copy() for v in (paths.moves, paths.turns, paths.toe_turns)]
    for values in out:
        if values.any():
            _fade(values, paths.pinned, ease)
    faded = replace(paths, moves=out[0], turns=out[1], toe_turns=out[2])
    return _clear(faded, work, plants, ground)


def moved_soles(work: Working, paths: FootPaths) -> Array:
    """(N, F, 3, 3) heel, ball and tip of every foot where `paths` put them, m."""
    ankles = np.array([leg.ankle for leg in work.rig.legs])
    points = np.empty(work.soles.shape)
    _move_soles(
        ankles, work.positions, work.soles, paths.moves, paths.turns, paths.toe_turns, points
    )
    return points


def heights_on(ground: Ground, points: Array, shift: Array) -> Array:
    """(N, F, P) height of the given ground under points (N, F, P, 3) of the working clip, m.

    shift: (N, 3) m, by which the working clip is off the clip whose ground it is. -inf where there
    is no ground.
    """
    at = (points - shift[:, None, None]).reshape(-1, 3)
    heights = ground.height(at).reshape(points.shape[:-1]) + shift[:, None, None, 2]
    return np.where(np.isfinite(heights), heights, -np.inf)


def heights_under(points: Array, plants: tuple[Plant, ...], lowest: Array | None = None) -> Array:
    """(N, F, P) height of the ground under points (N, F, P, 3) of each foot, told by the plants, m.

    It is that of the plant the foot is in, and in a swing the lower of the plants before and after;
    -inf for a foot that never stands. No higher than `lowest` (N, F), from `lowest_in_swing`.
    """
    heights = np.full(points.shape[:-1], np.inf)
    for foot in range(points.shape[1]):
        own = [p for p in plants if p.foot == foot]
        if not own:
            heights[:, foot] = -np.inf
            continue
        spans = np.array([(p.start, p.stop) for p in own])
        planes = np.array([(p.heel, p.normal) for p in own])
        _plane_heights(points[:, foot], spans, planes, heights[:, foot])
    return heights if lowest is None else np.minimum(heights, lowest[..., None])


def lowest_in_swing(soles: Array, plants: tuple[Plant, ...], scale: float) -> Array:
    """(N, F) m, how low the ground may be in each swing; infinite where nothing says so.

    What lies between two plants, or before the first and after the last, is not known: where soles
    (N, F, 3, 3) come so low that they cannot be in the ground of the plants beside, the ground is
    no higher than they are. Next to a plant that changes little a foot is not deep.
    """
    lowest = np.full(soles.shape[:2], np.inf)
    heights = soles[..., 2].min(axis=-1)
    under = (heights_under(soles, plants) - soles[..., 2])[..., :TIP].max(axis=-1)
    for foot in range(soles.shape[1]):
        for swing, change in _swings([p for p in plants if p.foot == foot], len(soles)):
            elsewhere = under[swing, foot] > min(_ANOTHER * scale, _PER_CHANGE * change)
            if elsewhere.any():
                lowest[swing, foot] = heights[swing, foot][elsewhere].min()
    return lowest


def _swings(own: list[Plant], frames: int) -> Iterator[tuple[slice, float]]:
    """The swings of one foot, and what the plants beside them change at most, m."""
    for before, after in itertools.pairwise([None, *own, None]):
        start, stop = before.stop if before else 0, after.start if after else frames
        if start < stop and (before or after):
            yield slice(start, stop), max(p.change for p in (before, after) if p)


def _clear(
    paths: FootPaths,
    work: Working,
    plants: tuple[Plant, ...],
    ground: Ground | None,
) -> FootPaths:
    """The same with swinging feet lifted, and toes bent, out of the ground."""
    swing = ~paths.pinned
    if not plants or not swing.any():
        return paths
    soles = moved_soles(work, paths)
    depths, was = (_depths(points, work, plants, ground) for points in (soles, work.soles))
    least = _DEEPER * work.scale
    if not (depths[swing] > least).any():
        return paths
    allowed = np.minimum(np.maximum(was, 0.0) + least, _DEEPEST * work.scale)
    need = np.where(swing[..., None], np.maximum(depths - allowed, 0.0), 0.0)
    bends = np.array([leg.toe >= 0 and leg.sole.tip > leg.sole.ball for leg in work.rig.legs])
    stiff = np.where(bends[:, None], need[..., :TIP].max(axis=-1)[..., None], need).max(axis=-1)
    lift = _smooth_lift(stiff, swing, max(1, math.ceil(_LIFT * work.clip.fps)))
    toe_turns = paths.toe_turns.copy()
    for foot in np.flatnonzero(bends):
        deep = np.flatnonzero(need[:, foot, TIP] > lift[:, foot])
        if len(deep):
            more = need[deep, foot, TIP] - lift[deep, foot]
            toe_turns[deep, foot] = _bent_up(toe_turns[deep, foot], soles[deep, foot], more)
    moves = paths.moves.copy()
    moves[..., 2] += lift
    return replace(paths, moves=moves, toe_turns=toe_turns)


def _depths(
    points: Array, work: Working, plants: tuple[Plant, ...], ground: Ground | None
) -> Array:
    """(N, F, P) how deep points (N, F, P, 3) are in the ground, m."""
    if ground is not None:
        return heights_on(ground, points, work.shift) - points[..., 2]
    lowest = lowest_in_swing(work.soles, plants, work.scale)
    return heights_under(points, plants, lowest) - points[..., 2]


def _smooth_lift(need: Array, swing: Bools, frames: int) -> Array:
    """(N, F) a smooth lift no less than needed in swing, and none in plants, m."""
    lift = np.zeros_like(need)
    for foot in np.flatnonzero(need.any(axis=0)):
        smooth = filters.envelope(need[:, foot], frames)
        away = _frames_to(~swing[:, foot])
        share = np.clip(away / (2.0 * frames), 0.0, 1.0)
        smooth = smooth * share * share * (3.0 - 2.0 * share)
        lift[:, foot] = np.where(swing[:, foot], np.maximum(smooth, need[:, foot]), 0.0)
    return lift


def _bent_up(turns: Array, soles: Array, more: Array) -> Array:
    """Toe turns (K, 3) that raise the tip of soles (K, 3, 3) by (K,) more, m."""
    along = soles[:, TIP] - soles[:, BALL]
    length = np.linalg.norm(along, axis=-1)
    now = np.clip(along[:, 2] / length, -1.0, 1.0)
    then = np.clip(now + more / length, -1.0, 1.0)
    axis = quat_arrays.unit(np.cross(along, [0.0, 0.0, 1.0]))
    bend = quat_arrays.from_rotvec(axis * (np.arcsin(then) - np.arcsin(now))[:, None])
    return quat_arrays.to_rotvec(quat_arrays.mul(bend, quat_arrays.from_rotvec(turns)))


def _frames_to(marked: Bools) -> Array:
    """(N,) frames from each to the nearest that is marked, inf where none is."""
    frames = np.arange(len(marked), dtype=np.float64)
    before = np.maximum.accumulate(np.where(marked, frames, -np.inf))
    after = np.minimum.accumulate(np.where(marked, frames, np.inf)[::-1])[::-1]
    return np.minimum(frames - before, after - frames)


@compiled
def _plane_heights(points, spans, planes, out):
    """Lower out (N, P) to the planes of the plants at, before and after each frame."""
    p = 0
    count = spans.shape[0]
    for t in range(points.shape[0]):
        while p + 1 < count and t >= spans[p, 1]:
            p += 1
        first = p if p == 0 or t >= spans[p, 0] else p - 1
        for q in range(first, p + 1):
            place, normal = get3(planes[q, 0]), get3(planes[q, 1])
            for i in range(points.shape[1]):
                away = sub(get3(points[t, i]), place)
                height = points[t, i, 2] - dot(away, normal) / normal[2]
                out[t, i] = min(out[t, i], height)


@compiled
def _fade(values, pinned, ease):
    """Fill values (N, F, 3) between the pinned frames (N, F)."""
    frames = values.shape[0]
    for foot in range(values.shape[1]):
        a = -1
        for b in range(frames + 1):
            if b < frames and not pinned[b, foot]:
                continue
            if b - a > 1:
                _fill(values, pinned, foot, a, b, ease)
            a = b


@compiled
def _move_soles(ankles, positions, soles, moves, turns, toe_turns, out):
    for t in range(soles.shape[0]):
        for f in range(soles.shape[1]):
            ankle = get3(positions[t, ankles[f]])
            goal = add(ankle, get3(moves[t, f]))
            turn = quat_from_rotvec(get3(turns[t, f]))
            for p in range(3):
                point = sub(get3(soles[t, f, p]), ankle)
                set3(out[t, f, p], add(goal, rotate(turn, point)))
            ball = get3(out[t, f, BALL])
            toes = sub(get3(out[t, f, TIP]), ball)
            bent = rotate(quat_from_rotvec(get3(toe_turns[t, f])), toes)
            set3(out[t, f, TIP], add(ball, bent))


@compiled
def _fill(values, pinned, foot, a, b, ease):
    """One swing, from after frame a (-1: the clip's start) to before b (N: its end)."""
    gap = float(b - a)
    start, leaving = _edge(values, pinned, foot, a, -1)
    stop, coming = _edge(values, pinned, foot, b, 1)
    both = norm(start) > 0.0 and norm(stop) > 0.0
    if not both and norm(start) + norm(stop) == 0.0:
        return
    reach = (
        gap if both and gap < 2.0 * ease else min(ease, gap) if a >= 0 and b < len(values) else ease
    )
    leaving = _limited(start, leaving, reach)
    coming = _limited(stop, coming, reach)
    for t in range(a + 1, b):
        here = decayed(start, leaving, float(t - a), reach)
        there = decayed(stop, coming, float(b - t), reach)
        set3(values[t, foot], add(here, there))


@compiled
def _edge(values, pinned, foot, t, way):
    """The offset at a plant's edge and how it grows, per frame, on into the swing."""
    frames = values.shape[0]
    if t < 0 or t >= frames:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    offset = get3(values[t, foot])
    p, q = t + way, t + 2 * way
    if not (0 <= q < frames and pinned[p, foot] and pinned[q, foot]):
        return offset, (0.0, 0.0, 0.0)
    # The slope at the end of the parabola through three frames.
    slope = scale(offset, 1.5)
    slope = add_scaled(slope, get3(values[p, foot]), -2.0)
    return offset, add_scaled(slope, get3(values[q, foot]), 0.5)


@compiled
def _limited(offset, velocity, duration):
    """A velocity under which the offset fades without swinging out by more than about a tenth."""
    size = norm(offset)
    if size < 1e-12 or duration <= 0.0:
        return (0.0, 0.0, 0.0)
    out = scale(offset, 1.0 / size)
    along = dot(velocity, out)
    aside = add_scaled(velocity, out, -along)
    speed = norm(aside)
    most = size / duration
    if speed > _SIDEWAYS * most:
        aside = scale(aside, _SIDEWAYS * most / speed)
    return add_scaled(aside, out, clamp(along, -_INWARD * most, _OUTWARD * most))
