"""Leg IK: two bones and a goal, by the law of cosines; and what a leg lacks to reach one.

World space throughout. The solver turns bones and returns those turns; it moves nothing. The
knee points to the pole; without one it stays in the plane it is bent in, carried along as the leg
swings, so that it cannot flip; a straight leg bends about its hinge. Beyond its usable length a leg
extends ever more slowly and never overshoots, and `reached` tells the truth about the goal it was
given, whatever the weight.
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
    quat_conj,
    quat_from_basis,
    quat_from_rotvec,
    quat_mul,
    quat_to_rotvec,
    reject,
    rotate,
    scale,
    sub,
    unit,
)

_BENT = (
    0.02  # part of the leg: a knee that is further off the line from hip to ankle sets the plane
)
_POLE_SURE = 0.2  # sine between pole and leg: below it the plane of the bent leg takes over
_REACHED = 1e-5  # part of the leg's length
_LONGEST = 1.0 - 1e-7  # part of the leg's length: a knee is never quite straight
_FARTHEST = 1e100  # m: squares of anything below are finite
_MOST_STRETCH = 1e3


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
def soft_stretch(distance, usable, full, most=1.0):
    """The length of a leg that may stretch up to `most` times, and how much it stretches.

    Bones stretch before the soft range begins, so that the length keeps to the rule of
    `soft_length` with the stretched `usable` and `full`; the length includes the stretch.
    """
    most = clamp(most, 1.0, _MOST_STRETCH)
    length = soft_length(distance, most * usable, most * full)
    return length, clamp(length / max(usable, 1e-12), 1.0, most)


@compiled
def knee_direction(hip, knee, ankle, hinge):
    """Where the knee points: off the line from hip to ankle, or for a straight leg by its hinge.

    `hinge` is the axis about which the knee bends, pointing left on a leg that bends as a man's.
    """
    line = unit(sub(ankle, hip), unit(sub(knee, hip), (0.0, 0.0, -1.0)))
    off = reject(sub(knee, hip), line)
    length = norm(sub(knee, hip)) + norm(sub(ankle, knee))
    by_hinge = unit(cross(line, unit(hinge, (0.0, 0.0, 0.0))), perpendicular(line))
    share = smooth_step(norm(off) / max(_BENT * length, 1e-12))
    return unit(lerp(by_hinge, unit(off, by_hinge), share), by_hinge)


@compiled
def turned_knee(bent, toward, toes, settings, side):
    """The pole of a knee that points to `bent` (3,) unit, across the way `toward` the goal.

    It is turned about the leg to where the toes (3,) point, by `knee_toe`, and outward by
    `knee_out`, at most by `max_knee_twist`; side: 1 left, -1 right. Unit.
    """
    over = reject(toes, toward)
    turn = 0.0
    # Toes that point along the leg say nothing; the nearer they come to that, the less.
    sure = smooth_step(norm(over) / _POLE_SURE)
    if sure > 0.0:
        turn = math.atan2(dot(cross(bent, over), toward), dot(bent, over))
    turn = settings["knee_toe"] * sure * turn - side * settings["knee_out"]
    turn = clamp(turn, -settings["max_knee_twist"], settings["max_knee_twist"])
    return add(scale(bent, math.cos(turn)), scale(cross(toward, bent), math.sin(turn)))


@compiled
def knee_toward(pole, toward, carried):
    """Where the knee shall point, across the direction `toward` of the goal.

    To the pole. As the pole comes to lie along the leg, where it says nothing, the carried
    direction takes over, smoothly; only a pole that passes exactly through the leg towards the
    opposite side can still turn the knee over.
    """
    across = reject(unit(pole, (0.0, 0.0, 0.0)), toward)
    doubt = _POLE_SURE * (1.0 - smooth_step(norm(across) / _POLE_SURE))
    side = reject(add_scaled(across, carried, doubt), toward)
    return unit(side, unit(reject(carried, toward), perpendicular(toward)))


@compiled
def _bone_turn(before, normal, after, new_normal):
    """The turn that takes a unit bone, and the plane its leg is bent in, to new ones.

    `new_normal` is unit and across the new bone; `normal` need not quite be across the old.
    """
    n = unit(reject(normal, before), perpendicular(before))
    side, new_side = cross(n, before), cross(new_normal, after)
    # The columns of (new frame) * (old frame) transposed.
    return quat_from_basis(
        add_scaled(add_scaled(scale(after, before[0]), new_side, side[0]), new_normal, n[0]),
        add_scaled(add_scaled(scale(after, before[1]), new_side, side[1]), new_normal, n[1]),
        add_scaled(add_scaled(scale(after, before[2]), new_side, side[2]), new_normal, n[2]),
    )


@compiled
def _part(turn, weight):
    """A part of a turn, by the short way."""
    return quat_from_rotvec(scale(quat_to_rotvec(turn), weight))


@compiled
def _knee_place(upper, lower, length):
    """How far along the line to the goal the knee lies, and how far off it, m."""
    if length <= 1e-12:
        return 0.0, upper  # folded onto the hip: the knee points straight at the pole
    along = 0.5 * ((upper - lower) * (upper + lower) / length + length)
    along = clamp(along, -upper, upper)
    return along, math.sqrt(max((upper - along) * (upper + along), 0.0))


@compiled
def two_bone(
    hip, knee, ankle, goal, hinge, usable, pole=(0.0, 0.0, 0.0), most_stretch=1.0, weight=1.0
):
    """Turn thigh and shin so that the ankle comes to a goal.

    Args:
        hip, knee, ankle: (3,) the joints as they are, m.
        goal: (3,) for the ankle.
        hinge: (3,) the knee's axis, for a straight leg; need not be unit.
        usable: length up to which the goal is reached exactly, m; see `soft_length`.
        pole: (3,) direction the knee shall point in; zero keeps the plane of the bent leg.
        most_stretch: how many times its length the leg may have; `soft_stretch` of the distance
            from hip to goal says by how much it does, and the bones are the caller's to stretch.
        weight: 0 to 1, how much of the turns is taken, by hip and by knee.

    Returns:
        The world rotations to apply to the thigh and to the shin (each to the bone as it was),
        where the ankle comes to, and whether that is the goal, within 1e-5 of the leg's length.
    """
    thigh, shin = sub(knee, hip), sub(ankle, knee)
    upper, lower = norm(thigh), norm(shin)
    distance = norm(sub(goal, hip))
    if not upper + lower + distance < _FARTHEST:
        return (1.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), ankle, False
    line = unit(sub(ankle, hip), unit(thigh, (0.0, 0.0, -1.0)))
    toward = unit(sub(goal, hip), line)
    full = _LONGEST * (upper + lower)
    length, stretch = soft_stretch(distance, clamp(usable, 0.0, full), full, most_stretch)
    # Without a thigh or a shin there is one length only, over `full` by a hair.
    length = max(min(length / stretch, full), abs(upper - lower))

    bent = knee_direction(hip, knee, ankle, hinge)
    side = knee_toward(pole, toward, rotate(quat_between(line, toward), bent))
    along, off = _knee_place(upper, lower, length)
    knee_at = add(scale(toward, along), scale(side, off))
    normal, new_normal = cross(bent, line), cross(side, toward)
    thigh_turn = _bone_turn(unit(thigh, line), normal, unit(knee_at, toward), new_normal)
    new_shin = unit(sub(scale(toward, length), knee_at), toward)
    shin_turn = _bone_turn(unit(shin, line), normal, new_shin, new_normal)
    if weight < 1.0:
        # Hip and knee blend each by itself, so that the knee stays a hinge on the way.
        bend = _part(quat_mul(quat_conj(thigh_turn), shin_turn), max(weight, 0.0))
        thigh_turn = _part(thigh_turn, max(weight, 0.0))
        shin_turn = quat_mul(thigh_turn, bend)
        stretch = 1.0 + (stretch - 1.0) * max(weight, 0.0)
        reach = scale(add(rotate(thigh_turn, thigh), rotate(shin_turn, shin)), stretch)
    else:
        reach = scale(toward, length * stretch)
    new_ankle = add(hip, reach)
    reached = norm(sub(new_ankle, goal)) <= _REACHED * (upper + lower)
    return thigh_turn, shin_turn, new_ankle, reached


@compiled
def aim(rotation, goal, weight=1.0):
    """The world rotation to apply to an ankle, so that it turns towards a goal by a weight.

    `rotation` and `goal` are world rotations of the ankle, as the turned leg carries it and as
    it shall be; the blend takes the short way at constant speed, and weight 1 is the goal exactly.
    """
    turn = quat_mul(goal, quat_conj(rotation))
    return turn if weight >= 1.0 else _part(turn, max(weight, 0.0))


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
