"""Hinge legs: the hinge angles, within their limits, that bring a foot to its goal, compiled.

Damped least squares (Levenberg-Marquardt): a step is taken only where it brings the foot nearer,
and hinges at a limit that the step would pass stay there. It begins at the angles it is given, so
that the nearest solution is found and nothing flips. Where a leg has too few hinges for a place and
a rotation, or limits are in the way, the place goes first; what remains missing is returned.
"""

from __future__ import annotations

import math
from collections import namedtuple

import numpy as np

from footik_runtime.compiled import compiled
from footik_runtime.math3d import (
    add,
    clamp,
    cross,
    get3,
    get4,
    norm,
    quat_axis_angle,
    quat_conj,
    quat_mul,
    quat_to_rotvec,
    rotate,
    set3,
    sub,
)

ROUNDS = 40
_TURN_WEIGHT = 0.03
"""Of a leg's length: what a radian off weighs beside a metre off, where a leg has hinges enough. At
a limit, or out of reach, so much place is given up for the rotation: 0.1 mm for 10 degrees. Much
less would twist a straight leg around for a millimetre."""

_FEW_TURN_WEIGHT = 1e-3
"""The same where it has too few: the place goes first, to a micrometre."""

_ENOUGH = 6  # hinges for a place and a rotation

_LEAST_DAMPING, _MOST_DAMPING = 1e-9, 1e3  # of the largest square in the Jacobian
_LARGEST_STEP = 0.3  # rad a round: the nearest solution, not one around a corner
_NEAR = 1e-10  # m, and rad times its weight: nearer is there
_STILL = 1e-11  # rad: a smaller step ends the search
_BEYOND = 1e6  # m or rad: no pose has such numbers, and their squares may overflow

HINGE = np.dtype(
    [
        ("place", "f8", 3),
        ("turn", "f8", 4),
        ("axis", "f8", 3),
        ("anchor", "f8", 3),
        ("zero", "f8"),
        ("low", "f8"),
        ("high", "f8"),
        ("column", "i4"),
    ],
    align=True,
)
"""One hinge of a chain, outermost first.

place, turn: its body in the frame below the hinge before it (of the base, for the first), as
unturned; a second hinge of one body has none. axis (unit), anchor: in its body's frame, m.
zero: angle at which it is unturned; low, high: its limits, rad, infinite where it has none.
column: which joint value of the character it is.
"""

Work = namedtuple("Work", "axes anchors jacobian squares pull step trial stuck")
"""Work space of `solve_hinges` for chains of up to H hinges: see `new_work`."""


def new_work(hinges: int) -> Work:
    """Work space for chains of up to this many hinges."""
    most = max(hinges, 1)
    return Work(
        axes=np.zeros((most, 3)),
        anchors=np.zeros((most, 3)),
        jacobian=np.zeros((most, 6)),
        squares=np.zeros((most, most)),
        pull=np.zeros(most),
        step=np.zeros(most),
        trial=np.zeros(most),
        stuck=np.zeros(most, dtype=np.int32),
    )


@compiled
def goal_weights(hinges, length, point):
    """What a metre off its place and a radian off its rotation weigh for the foot of a leg.

    Args:
        hinges: how many the leg has.
        length: of the leg, m.
        point: whether the foot is a point, whose rotation is nothing to ask for.
    """
    if point:
        return (1.0, 0.0)
    return (1.0, length * (_TURN_WEIGHT if hinges >= _ENOUGH else _FEW_TURN_WEIGHT))


@compiled
def forward_hinges(hinges, angles, place, turn, axes, anchors):
    """Place and rotation of a chain's last body, world.

    Args:
        hinges: (H,) of `HINGE`.
        angles: (H,) rad.
        place, turn: of the body above the first hinge, world.
        axes, anchors: (H, 3) written: each hinge's axis and a point of it, world.
    """
    for h in range(hinges.shape[0]):
        hinge = hinges[h]
        place = add(place, rotate(turn, get3(hinge["place"])))
        turn = quat_mul(turn, get4(hinge["turn"]))
        axis = get3(hinge["axis"])
        anchor = add(place, rotate(turn, get3(hinge["anchor"])))
        set3(axes[h], rotate(turn, axis))
        set3(anchors[h], anchor)
        turn = quat_mul(turn, quat_axis_angle(axis, angles[h] - hinge["zero"]))
        place = sub(anchor, rotate(turn, get3(hinge["anchor"])))
    return place, turn


@compiled
def _error(hinges, angles, base, point, goal, weights, work):
    """How far the point is off its place, and the body turned off, weighted; and where it is."""
    place, turn = forward_hinges(hinges, angles, base[0], base[1], work.axes, work.anchors)
    at = add(place, rotate(turn, point))
    off = sub(goal[0], at)
    turned = quat_to_rotvec(quat_mul(goal[1], quat_conj(turn)))
    m, r = weights
    return (
        (m * off[0], m * off[1], m * off[2], r * turned[0], r * turned[1], r * turned[2]),
        at,
        norm(off),
        norm(turned),
    )


@compiled
def _cost(error):
    total = 0.0
    for k in range(6):
        total += error[k] * error[k]
    return total


@compiled
def _linearise(count, at, error, weights, work):
    """Fill Jacobian, squares and pull where the axes stand now; returns the largest square."""
    for h in range(count):
        axis = get3(work.axes[h])
        moved = cross(axis, sub(at, get3(work.anchors[h])))
        for k in range(3):
            work.jacobian[h, k] = weights[0] * moved[k]
            work.jacobian[h, 3 + k] = weights[1] * axis[k]
    largest = 1e-12
    for h in range(count):
        pull = 0.0
        for k in range(6):
            pull += work.jacobian[h, k] * error[k]
        work.pull[h] = pull
        for i in range(h + 1):
            square = 0.0
            for k in range(6):
                square += work.jacobian[h, k] * work.jacobian[i, k]
            work.squares[h, i] = work.squares[i, h] = square
        largest = max(largest, work.squares[h, h])
    return largest


@compiled
def _damped_step(count, damping, work):
    """Solve (squares + damping) step = pull for the hinges that are not stuck, by Cholesky.

    The factor is written below the diagonal of `squares`, whose upper half stays as it was; the
    diagonal is the pivots' in `trial`.
    """
    squares, step, pivots = work.squares, work.step, work.trial
    for i in range(count):
        step[i] = 0.0
        if work.stuck[i]:
            continue
        for j in range(i):
            if work.stuck[j]:
                continue
            value = squares[j, i]
            for k in range(j):
                if not work.stuck[k]:
                    value -= squares[i, k] * squares[j, k]
            squares[i, j] = value / pivots[j]
        value = squares[i, i] + damping
        for k in range(i):
            if not work.stuck[k]:
                value -= squares[i, k] * squares[i, k]
        pivots[i] = math.sqrt(max(value, damping))
        value = work.pull[i]
        for k in range(i):
            if not work.stuck[k]:
                value -= squares[i, k] * step[k]
        step[i] = value / pivots[i]
    for i in range(count - 1, -1, -1):
        if work.stuck[i]:
            continue
        value = step[i]
        for k in range(i + 1, count):
            if not work.stuck[k]:
                value -= squares[k, i] * step[k]
        step[i] = value / pivots[i]


@compiled
def _free_step(hinges, angles, damping, work):
    """The damped step of the hinges that may take it: at a limit that it would pass, they stay."""
    count = hinges.shape[0]
    for h in range(count):
        work.stuck[h] = 0
    for _ in range(count + 1):
        _damped_step(count, damping, work)
        more = False
        for h in range(count):
            passes = (angles[h] <= hinges[h]["low"] and work.step[h] < 0.0) or (
                angles[h] >= hinges[h]["high"] and work.step[h] > 0.0
            )
            if passes and not work.stuck[h]:
                work.stuck[h], more = 1, True
        if not more:
            break
    largest = 0.0
    for h in range(count):
        largest = max(largest, abs(work.step[h]))
    return largest


@compiled
def clamp_hinges(hinges, angles):
    """Bring angles (H,) within the limits of their hinges; one that is no number becomes zero."""
    for h in range(hinges.shape[0]):
        angle = angles[h] if abs(angles[h]) < _BEYOND else hinges[h]["zero"]
        angles[h] = clamp(angle, hinges[h]["low"], hinges[h]["high"])


@compiled
def solve_hinges(hinges, angles, base, point, goal, weights, work):
    """Angles that bring a point of a chain's last body to a place, and the body to a rotation.

    Args:
        hinges: (H,) of `HINGE`.
        angles: (H,) rad, where to begin; written. Brought within the limits first.
        base: place and rotation of the body above the first hinge, world.
        point: (3,) of the last body, in its frame, m.
        goal: place of that point and rotation of that body, world.
        weights: of a metre off, and of a radian off; either may be 0.
        work: `Work` for H hinges or more.

    Returns:
        How far the point is off its place, m, and by what angle the body is turned off, rad,
        whether or not they have a weight. A goal that is not finite leaves the angles as they are
        within their limits, and infinitely much missing.
    """
    count = hinges.shape[0]
    clamp_hinges(hinges, angles)
    error, at, off, turned = _error(hinges, angles, base, point, goal, weights, work)
    cost = _cost(error)
    if not (cost < _BEYOND * _BEYOND and off < _BEYOND):
        return math.inf, math.inf
    damping = _LEAST_DAMPING
    for _ in range(ROUNDS):
        if cost <= _NEAR * _NEAR:
            break
        largest_square = _linearise(count, at, error, weights, work)
        better = False
        while not better and damping <= _MOST_DAMPING:
            largest = _free_step(hinges, angles, damping * largest_square, work)
            if largest < _STILL:
                break
            part = min(1.0, _LARGEST_STEP / largest)
            for h in range(count):
                work.trial[h] = clamp(
                    angles[h] + part * work.step[h], hinges[h]["low"], hinges[h]["high"]
                )
            new_error, new_at, new_off, new_turned = _error(
                hinges, work.trial, base, point, goal, weights, work
            )
            new_cost = _cost(new_error)
            if new_cost < cost:
                better = True
                for h in range(count):
                    angles[h] = work.trial[h]
                error, at, off, turned, cost = new_error, new_at, new_off, new_turned, new_cost
                damping = max(0.1 * damping, _LEAST_DAMPING)
            else:
                damping *= 10.0
        if not better:
            break
    return off, turned
