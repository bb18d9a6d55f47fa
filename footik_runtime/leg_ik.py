"""Leg IK: two bones and a goal, by the law of cosines; and what a leg lacks to reach one.

World space throughout. The solver turns bones and returns those turns; it moves nothing. The
knee stays in the plane it is bent in, carried along as the leg swings, so that it cannot flip; a
straight leg bends about its hinge. Beyond its usable length a leg extends ever more slowly and
never overshoots, and `reached` tells the truth about the goal it was given.
"""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.inertia import smooth_step
from footik_runtime.math3d import (
    add,
    add_scaled,
    clamp,
    cross,
    dot,
    lerp,
    norm,
    perpendicular,
    quat_between,
    quat_mul,
    reject,
    rotate,
    scale,
    sub,
    unit,
)

_BENT = (
    0.02  # part of the leg: a knee that is further off the line from hip to ankle sets the plane
)
_REACHED = 1e-5  # m
_LONGEST = 1.0 - 1e-7  # part of the leg's length: a knee is never quite straight


@compiled
def soft_length(distance, usable, full):
    """How long to make a leg for a goal at a distance: all of it up to `usable`, never `full`.

    The curve leaves the diagonal with slope 1 and tends to `full` from below, so it rises
    everywhere and overshoots nowhere. Metres.
    """
    room = full - usable
    if distance <= usable:
        return distance
    if room <= 1e-9 * full:
        return full
    return usable + room * (1.0 - math.exp((usable - distance) / room))


@compiled
def knee_direction(hip, knee, ankle, hinge):
    """Where the knee points: off the line from hip to ankle, or for a straight leg by its hinge.

    `hinge` is the axis about which the knee bends, pointing left on a leg that bends as a man's.
    """
    line = unit(sub(ankle, hip), unit(sub(knee, hip), (0.0, 0.0, -1.0)))
    off = reject(sub(knee, hip), line)
    length = norm(sub(knee, hip)) + norm(sub(ankle, knee))
    by_hinge = unit(cross(line, hinge), perpendicular(line))
    share = smooth_step(norm(off) / max(_BENT * length, 1e-12))
    return unit(lerp(by_hinge, unit(off, by_hinge), share), by_hinge)


@compiled
def two_bone(hip, knee, ankle, goal, hinge, usable):
    """Turn thigh and shin so that the ankle comes to a goal.

    Args:
        hip, knee, ankle: (3,) the joints as they are, m.
        goal: (3,) for the ankle.
        hinge: (3,) the knee's axis, for a straight leg; need not be unit.
        usable: length up to which the goal is reached exactly, m; see `soft_length`.

    Returns:
        The world rotations to apply to the thigh and to the shin (each to the bone as it was),
        where the ankle comes to, and whether that is the goal.
    """
    thigh, shin = sub(knee, hip), sub(ankle, knee)
    upper, lower = norm(thigh), norm(shin)
    full = _LONGEST * (upper + lower)
    line = unit(sub(ankle, hip), unit(thigh, (0.0, 0.0, -1.0)))
    toward = unit(sub(goal, hip), line)
    length = soft_length(norm(sub(goal, hip)), min(usable, full), full)
    length = clamp(length, min(abs(upper - lower), full), full)
    swing = quat_between(line, toward)
    pole = rotate(swing, knee_direction(hip, knee, ankle, hinge))
    pole = unit(reject(pole, toward), perpendicular(toward))
    along, off = 0.0, 0.0
    if length > 1e-12:
        along = clamp(
            (upper * upper + length * length - lower * lower) / (2.0 * length), -upper, upper
        )
        off = math.sqrt(max(upper * upper - along * along, 0.0))
    elif upper > 0.0:
        off = upper  # folded onto the hip: the knee points straight at the pole
    new_knee = add(hip, add(scale(toward, along), scale(pole, off)))
    new_ankle = add_scaled(hip, toward, length)
    thigh_turn = quat_mul(quat_between(rotate(swing, thigh), sub(new_knee, hip)), swing)
    shin_turn = quat_mul(quat_between(rotate(swing, shin), sub(new_ankle, new_knee)), swing)
    return thigh_turn, shin_turn, new_ankle, norm(sub(new_ankle, goal)) <= _REACHED


@compiled
def shortfall(hip, goal, reach):
    """How far a hip must drop so that a goal is within reach, m; 0 where it is.

    Where the goal is further off sideways than the leg is long, the drop to the goal's height:
    that is as near as dropping brings it.
    """
    dx, dy = goal[0] - hip[0], goal[1] - hip[1]
    upright = math.sqrt(max(reach * reach - dx * dx - dy * dy, 0.0))
    return max(hip[2] - goal[2] - upright, 0.0)


@compiled
def heel_lift(hip, goal, ball, axis, reach):
    """The least angle about the ball that brings an ankle goal within reach of the hip, rad.

    `axis` is unit and points left, so that a positive angle lifts the heel. 0 where the goal is
    in reach; where none is enough, the angle that comes nearest. On its circle about the ball the
    squared distance to the hip is k - 2 (a cos t + b sin t), solved for t.
    """
    arm, to_hip = sub(goal, ball), sub(hip, ball)
    if norm(sub(goal, hip)) <= reach:
        return 0.0
    turning = reject(arm, axis)
    a, b = dot(to_hip, turning), dot(to_hip, cross(axis, turning))
    size = math.sqrt(a * a + b * b)
    if size < 1e-12:
        return 0.0
    still = sub(arm, turning)
    needed = 0.5 * (dot(to_hip, to_hip) + dot(arm, arm) - reach * reach) - dot(to_hip, still)
    nearest = math.atan2(b, a)
    return max(nearest - math.acos(clamp(needed / size, -1.0, 1.0)), 0.0)
