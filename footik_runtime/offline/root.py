"""Root: where the body must be so that every foot can be where its path says.

The body follows its planted feet in part, smoothly; where a leg still cannot reach, it is moved the
least that lets all reach; what smoothing spoils of that is made good by lowering it, under a
smooth curve that is nowhere above the need. Where nothing is asked it stays to the last bit.
"""

from __future__ import annotations

import math

import numpy as np

from footik_runtime.compiled import compiled
from footik_runtime.leg_ik import shortfall
from footik_runtime.math3d import add, add_scaled, clamp, get3, norm, scale, set3, sub
from footik_runtime.offline.filters import envelope, gaussian
from footik_runtime.offline.solve_legs import leg_spans, usable_lengths
from footik_runtime.offline.stages import Array, CleanSettings, FootPaths, Working

_ROUNDS = 8  # of projection onto the reach of each leg in turn
_EASE = 0.12  # s, half width of the curve that lowers the body
_FARTHEST = 0.25  # of the leg: the body is moved no farther
_NOTHING = 1e-8  # m
_SPARE = 1e-9  # of the leg's reach: what rounding may take


def place(work: Working, paths: FootPaths, settings: CleanSettings) -> Array:
    """(N, 3) offsets of the root, m; exactly 0 in frames far from all that is asked.

    Every foot whose goal lies within a leg's reach of where the body may go is reached. Hips do not
    turn.
    """
    frames = len(work.positions)
    if not paths.moves.any():
        return np.zeros((frames, 3))
    fps = work.clip.fps
    hips = np.ascontiguousarray(work.positions[:, [leg.hip for leg in work.rig.legs]])
    goals = work.positions[:, [leg.ankle for leg in work.rig.legs]] + paths.moves
    reach = usable_lengths(work, settings) * (1.0 + settings.stretch) * (1.0 - _SPARE)
    moves = _smooth(_common_move(paths) * settings.root_follow, settings.root_window * fps)
    moves[np.linalg.norm(moves, axis=-1) < _NOTHING] = 0.0
    scratch = np.empty((len(work.rig.legs), 3))
    for _ in range(2):
        change = np.zeros((frames, 3))
        _nearest_in_reach(hips, goals, reach, moves, scratch, change)
        change[np.linalg.norm(change, axis=-1) < _NOTHING] = 0.0
        moves = moves + _smooth(change, 0.5 * settings.root_window * fps)
    length, _ = leg_spans(work.rig, work.positions)
    moves = _limited(moves, _FARTHEST * float(length.mean()))
    drop = np.zeros(frames)
    _drops(hips, goals, reach, moves, drop)
    if drop.max(initial=0.0) > _NOTHING:
        moves[:, 2] -= envelope(drop, math.ceil(_EASE * fps))
    moves[np.linalg.norm(moves, axis=-1) < _NOTHING] = 0.0
    return moves


def _smooth(values: Array, sigma: float) -> Array:
    """Values (N, 3) smoothed; at its ends a clip goes on as its mirror image, at rest.

    Reflected oddly they would keep the first and last value, however lonely.
    """
    wide = math.ceil(4.0 * sigma)
    around = np.pad(values, ((wide, wide), (0, 0)), mode="symmetric")
    return gaussian(around, sigma)[wide : wide + len(values)]


def _common_move(paths: FootPaths) -> Array:
    """(N, 3) the mean move of the planted feet."""
    planted = paths.pinned[..., None]
    count = np.maximum(paths.pinned.sum(axis=1), 1)[:, None]
    return np.where(planted, paths.moves, 0.0).sum(axis=1) / count


def _limited(moves: Array, most: float) -> Array:
    far = np.linalg.norm(moves, axis=-1, keepdims=True)
    return np.where(far > most, moves * (most / np.maximum(far, most)), moves)


@compiled
def _nearest_in_reach(hips, goals, reach, moves, scratch, change):
    """Write the least change of each move that brings all goals within reach (Dykstra 1983).

    Where no place is within reach of all, a place between.
    """
    for t in range(hips.shape[0]):
        start = get3(moves[t])
        if not _lacks(hips[t], goals[t], reach[t], start):
            continue
        at = start
        for f in range(hips.shape[1]):
            set3(scratch[f], (0.0, 0.0, 0.0))
        for _ in range(_ROUNDS):
            for f in range(hips.shape[1]):
                tried = add(at, get3(scratch[f]))
                away = sub(add(get3(hips[t, f]), tried), get3(goals[t, f]))
                far = norm(away)
                over = 0.0 if far <= reach[t, f] else 1.0 - reach[t, f] / far
                at = add_scaled(tried, away, -over)
                set3(scratch[f], scale(away, over))
        set3(change[t], sub(at, start))


@compiled
def _lacks(hips, goals, reach, move):
    """Whether some goal is out of reach of a body moved so."""
    for f in range(hips.shape[0]):
        if norm(sub(add(get3(hips[f]), move), get3(goals[f]))) > reach[f]:
            return True
    return False


@compiled
def _drops(hips, goals, reach, moves, drop):
    """Write how far each frame's body must still be lowered for all legs to reach, m."""
    for t in range(hips.shape[0]):
        for f in range(hips.shape[1]):
            hip = add(get3(hips[t, f]), get3(moves[t]))
            goal = get3(goals[t, f])
            if norm(sub(hip, goal)) > reach[t, f]:
                lack = shortfall(hip, goal, reach[t, f])
                drop[t] = max(drop[t], clamp(lack, 0.0, 0.25 * reach[t, f]))
