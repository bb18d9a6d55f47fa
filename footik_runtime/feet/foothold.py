"""Footholds: where a rigid sole can lie on a profile, and how it rests there.

A sole is a plate that is let down onto the ground under its own weight: it comes to rest on the
edge of the ground's upper hull that lies under the weight. Of the places that a print may be
shifted to, along the foot and by half its width to either side, the one is taken where least of
the sole hangs over nothing.
"""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.feet.profile import (
    LEFT,
    MIDDLE,
    RIGHT,
    SPACING,
    most_climb,
    row_height,
    under_ankle,
)
from footik_runtime.feet.record import HEEL_HANGS, ON_HEEL, TOES_DOWN
from footik_runtime.math3d import clamp, cross, quat_upright

_BEHIND, _BALL, _AHEAD = 4, 3, 5  # samples of the sole: the heel, the ball and the tip's number
_TOES = 0.4  # what a sample beyond the ball counts, which may hang over an edge
_HANGING = 0.06  # m over the ground from which a sample hangs over nothing
_EVEN = 0.004  # m of mean hanging that is not worth a shift
_SHIFT_COST = 0.06  # m of mean hanging that a shift of a metre is worth
_SIDE_SHIFT_WORTH = 0.008  # m of mean hanging from which places to either side are looked at
_WALL = 0.12  # m between an edge and the middle that is a wall, and nothing to lie on
_UNSURE_ROLL = 0.3  # how much more than a sole may roll an edge may still count for its roll
_PIVOTS = 3.0  # what heel and ball count among the samples
_STEP = 0.05  # m that a step must lead up or down for an edge beside the sole to count
_ROOM = 0.06  # m before the toes, or behind the heel, where that edge is looked for
_NEAR_EDGE = 0.5  # what its height counts
_FALL = 0.1  # m down over an edge from which a foot lands on its ball
_FREE_HEEL = 0.02  # m under a heel from which it hangs


@compiled
def _sample_at(k, sole):
    """Where the k-th sample of a sole lies along the foot, m from the ankle; 0: at the weight."""
    middle = 0.5 * (sole["ball"] - sole["heel"])
    if k < 0:
        return middle + (middle + sole["heel"]) * k / _BEHIND
    if k <= _BALL:
        return middle + (sole["ball"] - middle) * k / _BALL
    return sole["ball"] + (sole["tip"] - sole["ball"]) * (k - _BALL) / (_AHEAD - _BALL)


@compiled
def _height(hits, row, side, along, at_most, size, ref_z):
    """Height under one row of a foot that is shifted by `side` half widths to the left."""
    return row_height(hits, min(max(row + side, RIGHT), LEFT), along, at_most, size, ref_z)


@compiled
def cross_slope(hits, shift, side, sole, settings, ref_z):
    """Rise to the left of the ground under a sole, from its edges against its middle.

    An edge that hangs over nothing, or stands against a wall, says nothing.
    """
    size, wide = settings["size"], max(sole["half_width"], 1e-6)
    most = math.tan(settings["largest_roll"])
    total, count = 0.0, 0.0
    for k in range(-_BEHIND, _AHEAD + 1, 3):
        along = shift + _sample_at(k, sole)
        middle = _height(hits, MIDDLE, side, along, True, size, ref_z)
        for row in (LEFT, RIGHT):
            rise = (_height(hits, row, side, along, True, size, ref_z) - middle) / wide
            if abs(rise) <= most + _UNSURE_ROLL:
                total += row * rise
                count += 1.0
    return clamp(total / count, -most, most) if count > 0.0 else 0.0


@compiled
def _top(hits, k, shift, side, roll, sole, size, ref_z):
    """The highest ground under one sample of the sole, its roll taken out; walls beside it not."""
    along = shift + _sample_at(k, sole)
    middle = _height(hits, MIDDLE, side, along, True, size, ref_z)
    most, rise = middle, roll * sole["half_width"]
    for row in (LEFT, RIGHT):
        height = _height(hits, row, side, along, True, size, ref_z) - row * rise
        if height - middle < _WALL * size:
            most = max(most, height)
    return most


@compiled
def rest(hits, shift, side, roll, sole, settings, ref_z):
    """How a sole let down at a shift rests: height of its plane under the ankle, and its slope.

    The plane goes through the edge of the upper hull under the weight; where that is steeper than
    a sole may tilt, it is tilted as far, and raised until nothing sticks through.
    """
    size, most_slope = settings["size"], math.tan(settings["largest_slope"])
    top = (
        _top(hits, -4, shift, side, roll, sole, size, ref_z),
        _top(hits, -3, shift, side, roll, sole, size, ref_z),
        _top(hits, -2, shift, side, roll, sole, size, ref_z),
        _top(hits, -1, shift, side, roll, sole, size, ref_z),
        _top(hits, 0, shift, side, roll, sole, size, ref_z),
        _top(hits, 1, shift, side, roll, sole, size, ref_z),
        _top(hits, 2, shift, side, roll, sole, size, ref_z),
        _top(hits, 3, shift, side, roll, sole, size, ref_z),
        _top(hits, 4, shift, side, roll, sole, size, ref_z),
        _top(hits, 5, shift, side, roll, sole, size, ref_z),
    )
    weight = _sample_at(0, sole)
    highest, slope, longest = top[_BEHIND], 0.0, -1.0
    for i in range(_BEHIND):
        x = _sample_at(i - _BEHIND, sole)
        for j in range(_BEHIND + 1, _BEHIND + _AHEAD + 1):
            along = _sample_at(j - _BEHIND, sole) - x
            rise = (top[j] - top[i]) / along
            height = top[i] + rise * (weight - x)
            # Of edges on one line the longest says its slope best.
            if height > highest + 1e-9 or (height > highest - 1e-9 and along > longest):
                highest, slope, longest = max(height, highest), rise, along
    slope = clamp(slope, -most_slope, most_slope)
    plane = -1e9
    for i in range(_BEHIND + _AHEAD + 1):
        plane = max(plane, top[i] - slope * _sample_at(i - _BEHIND, sole))
    return plane, slope


@compiled
def _hanging(hits, shift, side, way, plane, slope, roll, sole, size, ref_z):
    """How much of a sole that rests on a plane hangs over nothing, and is in walls, m.

    The mean height over the ground, each sample's up to `_HANGING`; heel and ball, over which the
    foot will turn, count most, the toes least. On the way up (`way` 1) the heel may hang.
    """
    total, counted = 0.0, 0.0
    for k in range(-_BEHIND, _AHEAD + 1):
        x = _sample_at(k, sole)
        share = _PIVOTS if k == _BALL or (k == -_BEHIND and way <= 0) else 1.0
        if k > _BALL or (k < 0 and way > 0):
            share = _TOES
        counted += 2.0 * share
        for row in (MIDDLE, MIDDLE, LEFT, RIGHT):
            below = _height(hits, row, side, shift + x, False, size, ref_z)
            tilt = roll * sole["half_width"] * row
            total += 0.5 * share * clamp(plane + slope * x + tilt - below, 0.0, _HANGING * size)
            above = _height(hits, row, side, shift + x, True, size, ref_z)
            if row != MIDDLE and above - (plane + slope * x) >= _WALL * size:
                total += share * _HANGING * size
    return total / counted


@compiled
def _cost(hits, shift, side, way, sole, settings, ref_z):
    """What a place costs: how much of the sole hangs, is in a wall, and how far it is off, m.

    On the way down (`way` -1) the heel would pass through an edge right behind it as it comes, on
    the way up the toes through one right before them as they leave.
    """
    size = settings["size"]
    roll = cross_slope(hits, shift, side, sole, settings, ref_z)
    plane, slope = rest(hits, shift, side, roll, sole, settings, ref_z)
    cost = _hanging(hits, shift, side, way, plane, slope, roll, sole, size, ref_z)
    if way != 0:
        x = sole["tip"] + _ROOM * size if way > 0 else -sole["heel"] - _ROOM * size
        near = _height(hits, MIDDLE, side, shift + x, True, size, ref_z)
        cost += _NEAR_EDGE * clamp(near - (plane + slope * x), 0.0, _HANGING * size)
    off = abs(shift) + abs(side) * sole["half_width"]
    return max(cost - _EVEN * size, 0.0) + _SHIFT_COST * off


@compiled
def best_place(hits, way, sole, settings, ref_z):
    """The cheapest place: its shift along the foot, m, and to the left, in half widths.

    `way`: 1 where the step leads up, -1 down, else 0.
    """
    best, best_side = 0.0, 0
    least = _cost(hits, 0.0, 0, way, sole, settings, ref_z)
    step = 0.5 * SPACING * settings["size"]
    count = int(settings["foothold_shift"] / step + 1e-9)
    for side in (0, 1, -1):
        if side and least < _SIDE_SHIFT_WORTH * settings["size"]:
            break
        for i in range(2 * count + 1):
            # 0, +1, -1, +2, -2, ...: ties go to the smaller shift, whose cost alone may be enough.
            shift = step * ((i + 1) // 2) * (1.0 if i % 2 else -1.0)
            if _SHIFT_COST * abs(shift) >= least:
                break
            cost = _cost(hits, shift, side, way, sole, settings, ref_z)
            if cost < least - 1e-9:
                best, best_side, least = shift, side, cost
    return best, best_side


@compiled
def choose_foothold(hits, lift, place_x, place_y, yaw, ref_z, sole, settings):
    """Where the flat foot shall stand, from the answered probes of `ask_for_step`.

    Returns (found, point (3,) under the ankle, sole rotation, index of the hit it stands on,
    and how it is landed on).
    Not found where nothing is under the sole, or only what lies too far up or down.
    """
    middle = row_height(hits, MIDDLE, 0.0, True, settings["size"], ref_z)
    climb = (middle - (lift[2] - ref_z)) / (_STEP * settings["size"])
    way = 1 if climb > 1.0 else (-1 if climb < -1.0 else 0)
    shift, side = best_place(hits, way, sole, settings, ref_z)
    roll = cross_slope(hits, shift, side, sole, settings, ref_z)
    height, slope = rest(hits, shift, side, roll, sole, settings, ref_z)
    c, s = math.cos(yaw), math.sin(yaw)
    forward = (c, s, slope)
    turn = quat_upright(forward, cross(forward, (-s, c, roll)))
    left = side * sole["half_width"]
    point = (place_x + c * shift - s * left, place_y + s * shift + c * left, ref_z + height)
    under = under_ankle(shift, settings["size"])
    far = settings["largest_step"] + most_climb(place_x - lift[0], place_y - lift[1], settings)
    found = hits[under]["hit"] == 1 and abs(height) <= far
    at_heel = row_height(hits, MIDDLE, shift - sole["heel"], False, settings["size"], ref_z)
    hangs = height - slope * sole["heel"] - at_heel > _FREE_HEEL * settings["size"]
    landing = HEEL_HANGS if hangs else ON_HEEL
    if steps_down(lift, point, slope, settings):
        landing = TOES_DOWN
    return found, point, turn, under, landing


@compiled
def steps_down(lift, land, slope, settings):
    """Whether a step leads down over an edge, and not down a slope: it lands on the ball."""
    x, y = land[0] - lift[0], land[1] - lift[1]
    fall = lift[2] - land[2] + min(slope, 0.0) * math.sqrt(x * x + y * y)
    return fall > _FALL * settings["size"]
