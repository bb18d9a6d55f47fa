"""Footing: the poses of planted feet, as offsets from the poses they have."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from footik_runtime.compiled import compiled
from footik_runtime.inertia import smooth_step
from footik_runtime.math3d import (
    UP,
    add,
    add_scaled,
    clamp,
    cross,
    dot,
    get3,
    get4,
    norm,
    quat_conj,
    quat_from_rotvec,
    quat_mul,
    quat_to_rotvec,
    rotate,
    scale,
    set3,
    sub,
    unit,
)
from footik_runtime.offline.footprints import HOVERS
from footik_runtime.offline.stages import CleanSettings, FootPaths, Plant, Working
from footik_runtime.sole import BALL, HEEL

Array = NDArray[np.float64]

_FADE = 0.12  # s, at most, over which a foot turns back to its own pitch after lying flat
_NOTHING = 1e-9  # m and rad: smaller offsets are none
# Of a body whose legs are 0.85 m long.
_PEELS = 0.008  # m over its lowest from which a ball leaves the ground as it did
_TOUCHES = 0.002  # m: toes are this near the ground while the ball peels off it


def poses(work: Working, plants: tuple[Plant, ...], settings: CleanSettings) -> FootPaths:
    """Offsets that put planted feet where their plants hold them; nothing in between.

    The pinned point does not move at all: a flat foot is still, one on its heel or ball turns over
    it as it did, over no more than the ground lets it. The whole contact has the yaw of its
    footprint. Plants that change less than `keep_below` ask nothing.
    """
    frames, feet = work.soles.shape[:2]
    moves, turns, toe_turns = (np.zeros((frames, feet, 3)) for _ in range(3))
    pinned = np.zeros((frames, feet), dtype=np.bool_)
    for plant in plants:
        pinned[plant.start : plant.stop, plant.foot] = True
    asked = [p for p in plants if p.change >= settings.keep_below * work.scale]
    if asked:
        legs = work.rig.legs
        fade = max(1.0, _FADE * work.clip.fps)
        _pose_plants(
            np.array([(p.foot, p.start, p.flat, p.roll, p.stop) for p in asked]),
            np.array([(p.heel, p.ball, p.normal) for p in asked]),
            np.array([p.turn for p in asked]),
            np.array([(leg.ankle, leg.toe) for leg in legs]),
            np.array([
                (leg.sole.heel, leg.sole.ball, leg.sole.height, leg.sole.tip - leg.sole.ball)
                for leg in legs
            ]),
            np.array([(leg.sole.frame, leg.sole.toe_frame) for leg in legs]),
            fade, work.scale, work.positions, work.rotations, work.soles, moves, turns, toe_turns,
        )  # fmt: skip
    return FootPaths(moves=moves, turns=turns, toe_turns=toe_turns, pinned=pinned)


@compiled
def _pose_plants(
    spans, places, holds, joints, lengths, frames, fade, size,
    positions, rotations, soles, moves, turns, toe_turns,
):  # fmt: skip
    """Write the offsets of all plants: spans (S, 5) foot, start, flat, roll, stop."""
    for s in range(spans.shape[0]):
        foot, start, flat = spans[s, 0], spans[s, 1], spans[s, 2]
        roll, stop = spans[s, 3], spans[s, 4]
        ankle, toe = joints[foot, 0], joints[foot, 1]
        heel, ball, normal = get3(places[s, 0]), get3(places[s, 1]), get3(places[s, 2])
        frame, held = get4(frames[foot, 0]), get4(holds[s])
        back, front, height = lengths[foot, 0], lengths[foot, 1], lengths[foot, 2]
        under_heel, under_ball = (-back, 0.0, -height), (front, 0.0, -height)
        before, after = _flat_before(spans, s), _flat_after(spans, s)
        lands = after and not before and flat == roll
        leaves = before and flat == stop
        lowest = np.inf
        for i in range(start, stop):
            # What lands comes down as what leaves peels off: from the flat foot backwards.
            t = i
            if i < flat and not leaves:
                t = start + flat - 1 - i
            elif i >= roll and lands:
                t = roll + stop - 1 - i
            if i == roll:
                lowest = np.inf
            given = quat_mul(get4(rotations[t, ankle]), frame)
            if flat <= t < roll:
                wanted = held
            else:
                low, high = (start, flat) if t < flat else (roll, stop)
                left = low - 1 if (before if t < flat else flat < roll) else -1
                right = high if (flat < roll if t < flat else after) else -1
                offset = _faded(t, low, high, left, right, fade, held, normal, frame,
                                rotations, ankle)  # fmt: skip
                wanted = quat_mul(quat_from_rotvec(offset), given)
                wanted = _over_ground(wanted, normal, 1.0 if t < flat else -1.0)
            peeled = 0.0
            if t < flat or t >= roll:
                point, pin = (HEEL, heel) if t < flat else (BALL, ball)
                over = dot(sub(get3(soles[t, foot, point]), pin), normal) / normal[2]
                lowest = min(lowest, over)
                peeled = _peeled(over - lowest, _PEELS * size)
                if t >= roll:
                    # Over toes that stay on the ground: no higher than they take it.
                    steep = -dot(rotate(wanted, (1.0, 0.0, 0.0)), normal)
                    peeled = min(peeled, lengths[foot, 3] * max(steep, 0.0))
                if t < flat:
                    # Nothing else of the foot is down yet.
                    most = HOVERS * size
                    peeled = most * (1.0 - math.exp(-peeled / most))
            if t < roll:
                goal = sub(add_scaled(heel, UP, peeled), rotate(wanted, under_heel))
            else:
                goal = sub(add_scaled(ball, UP, peeled), rotate(wanted, under_ball))
            set3(moves[t, foot], _or_nothing(sub(goal, get3(positions[t, ankle]))))
            turn = _or_nothing(quat_to_rotvec(quat_mul(wanted, quat_conj(given))))
            set3(turns[t, foot], turn)
            if toe >= 0 and lengths[foot, 3] > 0.0:
                rise = dot(sub(add(goal, rotate(wanted, under_ball)), ball), normal)
                toes = quat_mul(get4(rotations[t, toe]), get4(frames[foot, 1]))
                pointing = rotate(toes, (1.0, 0.0, 0.0))
                least = -max(rise, 0.0) / lengths[foot, 3]
                highest = np.inf
                if t >= roll:
                    highest = _highest(max(rise, 0.0), _TOUCHES * size) / lengths[foot, 3]
                set3(toe_turns[t, foot], _toes_up(pointing, turn, normal, least, highest))


@compiled
def _flat_before(spans, s):
    """Whether the frame before a plant is one in which the same contact is flat."""
    return (
        s > 0
        and spans[s - 1, 0] == spans[s, 0]
        and spans[s - 1, 4] == spans[s, 1]
        and spans[s - 1, 2] < spans[s - 1, 3] == spans[s - 1, 4]
    )


@compiled
def _flat_after(spans, s):
    """Whether the frame after a plant is one in which the same contact is flat."""
    return (
        s + 1 < spans.shape[0]
        and spans[s + 1, 0] == spans[s, 0]
        and spans[s + 1, 1] == spans[s, 4]
        and spans[s + 1, 1] == spans[s + 1, 2] < spans[s + 1, 3]
    )


@compiled
def _turn_at(t, held, frame, rotations, ankle):
    """The rotation vector that lays the foot of a frame flat."""
    given = quat_mul(get4(rotations[t, ankle]), frame)
    return quat_to_rotvec(quat_mul(held, quat_conj(given)))


@compiled
def _faded(t, low, high, left, right, fade, held, normal, frame, rotations, ankle):
    """The turn, as a rotation vector, of a foot on its heel or ball in frames low <= t < high.

    That of the flat frames `left` and `right` of it (-1: none), of which the turn about the
    ground's normal lasts and the rest is gone after `fade` frames.
    """
    offset = (0.0, 0.0, 0.0)
    length = high - low
    reach = min(float(length), fade) + 1.0
    for side in range(2):
        flat = left if side == 0 else right
        if flat < 0:
            continue
        k = t - low + 1 if side == 0 else high - t
        full = _turn_at(flat, held, frame, rotations, ankle)
        yaw = scale(normal, dot(full, normal))
        lasts = 1.0 - smooth_step(k / (length + 1.0)) if left >= 0 and right >= 0 else 1.0
        offset = add_scaled(offset, yaw, lasts)
        offset = add_scaled(offset, sub(full, yaw), 1.0 - smooth_step(k / reach))
    return offset


@compiled
def _raised(direction, normal, angle):
    """The rotation vector that turns a unit direction by `angle` towards the normal."""
    axis = cross(direction, normal)
    size = norm(axis)
    return (0.0, 0.0, 0.0) if size < 1e-9 else scale(axis, angle / size)


@compiled
def _over_ground(wanted, normal, side):
    """A sole's rotation with the nose not under the ground (side 1), or the heel not (side -1)."""
    along = rotate(wanted, (1.0, 0.0, 0.0))
    pitch = np.arcsin(clamp(dot(along, normal), -1.0, 1.0))
    if pitch * side >= 0.0:
        return wanted
    return quat_mul(quat_from_rotvec(_raised(along, normal, -pitch)), wanted)


@compiled
def _peeled(rise, soft):
    """How far a ball is let off the ground that rises so: not at first, then all but soft / 2."""
    rise = max(rise, 0.0)
    return 0.5 * rise * rise / soft if rise < soft else rise - 0.5 * soft


@compiled
def _highest(rise, touches):
    """How far over their ball toes may point, m, that is `rise` off the ground: they stay on it.

    Toes of a ball on the ground may point up; their way down is over before it is off by `touches`.
    """
    return touches - rise + 20.0 * touches * (1.0 - smooth_step(rise / touches))


@compiled
def _toes_up(pointing, turn, normal, lowest, highest):
    """The toes' own turn after the foot's: as steep over the ground as before, and not under it."""
    carried = unit(rotate(quat_from_rotvec(turn), pointing), (1.0, 0.0, 0.0))
    wanted = clamp(max(min(dot(pointing, normal), highest), lowest), -1.0, 1.0)
    now = clamp(dot(carried, normal), -1.0, 1.0)
    return _or_nothing(_raised(carried, normal, np.arcsin(wanted) - np.arcsin(now)))


@compiled
def _or_nothing(v):
    return v if norm(v) >= _NOTHING else (0.0, 0.0, 0.0)
