"""Hock: the joint between knee and paw of a three-joint leg.

Knee and hock of a mammal bend together: the muscles between them keep thigh and hock nearly
parallel (Fischer and Blickhan 2006). So where a leg must become shorter or longer than the
animation has it, its lower part, from knee to paw, does so in the same proportion (or its upper
one, from hip to hock, where the hock is what stands out); the rest is solved as any leg. A joint
that hardly bends at rest, such as a wrist or a twist bone, rides along.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from footik_runtime.compiled import compiled
from footik_runtime.leg_ik import two_bone
from footik_runtime.math3d import (
    add,
    clamp,
    cross,
    norm,
    perpendicular,
    quat_axis_angle,
    quat_mul,
    rotate,
    sub,
    unit,
)
from footik_runtime.rig import Leg, Rig

Array = NDArray[np.float64]

FOLDS = math.radians(150.0)
"""A joint whose bones enclose less than this at rest bends with the knee."""

_LONGEST = 0.995  # part of the two lower bones: a hock never quite straightens
_SHORTEST = 1.02  # part of what a folded hock leaves of them


def middle_joint(rig: Rig, leg: Leg) -> int:
    """The joint between knee and ankle that is bent most at rest; -1 where there is none.

    A joint in the same place as the knee or the ankle is none.
    """
    at, _ = rig.skeleton.rest_pose()
    line = rig.skeleton.chain(leg.ankle)
    between = line[1 : line.index(leg.knee)]
    shortest = 0.02 * float(np.linalg.norm(at[leg.ankle] - at[leg.hip]))
    ends = at[[leg.knee, leg.ankle]]
    apart = [j for j in between if np.linalg.norm(ends - at[j], axis=1).min() > shortest]
    return min(apart, key=lambda j: _enclosed(at[j], ends), default=-1)


def folding_hock(rig: Rig, leg: Leg) -> int:
    """The joint between knee and ankle that bends with the knee; -1 for a leg without one."""
    joint = middle_joint(rig, leg)
    if joint < 0:
        return -1
    at, _ = rig.skeleton.rest_pose()
    return joint if _enclosed(at[joint], at[[leg.knee, leg.ankle]]) < FOLDS else -1


def unfolded_length(rig: Rig, leg: Leg) -> float:
    """Hip to ankle of a leg with a folding hock that is open as far as `FOLDS`, its knee straight.

    In metres.
    """
    at, _ = rig.skeleton.rest_pose()
    hock = at[folding_hock(rig, leg)]
    upper, lower = (float(np.linalg.norm(end - hock)) for end in at[[leg.knee, leg.ankle]])
    thigh = float(np.linalg.norm(at[leg.knee] - at[leg.hip]))
    return thigh + math.sqrt(upper**2 + lower**2 - 2.0 * upper * lower * math.cos(FOLDS))


def turns_at_hock(rig: Rig, leg: Leg) -> bool:
    """Whether the hock lies farther off the line from hip to ankle at rest than the knee does.

    The knee of such a leg may come to lie on that line, where its bend says nothing.
    """
    hock = folding_hock(rig, leg)
    if hock < 0:
        return False
    at, _ = rig.skeleton.rest_pose()
    line = at[leg.ankle] - at[leg.hip]
    knee, hock = (np.linalg.norm(np.cross(at[j] - at[leg.hip], line)) for j in (leg.knee, hock))
    return bool(hock > knee)


def _enclosed(joint: Array, ends: Array) -> float:
    """The angle at a joint (3,) between the ways to two ends (2, 3), rad."""
    a, b = ends - joint
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


@compiled
def three_bone(hip, knee, hock, ankle, goal, hinge, usable, turns_hock):
    """Turn thigh, shin and the bone below the hock so that the ankle comes to a goal.

    The part of the leg above or below the joint it turns at folds first, then two bones remain.

    Args:
        hip, knee, hock, ankle: (3,) the joints as they are, m.
        goal: (3,) for the ankle.
        hinge: (3,) the knee's axis, for a straight leg; need not be unit.
        usable: as in `two_bone`.
        turns_hock: whether the two parts meet at the hock; at the knee otherwise.

    Returns:
        The world rotations to apply to thigh, shin and the bone below the hock (each to the bone
        as it was), where the ankle comes to, and whether that is the goal.
    """
    whole = norm(sub(ankle, hip))
    ratio = norm(sub(goal, hip)) / whole if whole > 1e-9 else 1.0
    if turns_hock:
        bend, folded = fold(hip, knee, hock, ratio, hinge)
        foot = add(folded, sub(ankle, hock))
        thigh, below, came_to, reached = two_bone(
            hip, folded, foot, goal, (-hinge[0], -hinge[1], -hinge[2]), usable
        )
        return thigh, quat_mul(thigh, bend), below, came_to, reached
    bend, foot = fold(knee, hock, ankle, ratio, hinge)
    thigh, shin, came_to, reached = two_bone(hip, knee, foot, goal, hinge, usable)
    return thigh, shin, quat_mul(shin, bend), came_to, reached


@compiled
def fold(start, joint, end, ratio, hinge):
    """Bend two bones so that from start to end they span `ratio` times what they do.

    Args:
        start, joint, end: (3,) of the bones, m.
        ratio: 1 bends nothing.
        hinge: (3,) about which a straight pair bends; need not be unit.

    Returns:
        The world rotation to apply to the second bone, and where its end is then.
    """
    first, second = sub(start, joint), sub(end, joint)
    upper, lower = norm(first), norm(second)
    if upper < 1e-9 or lower < 1e-9:
        return (1.0, 0.0, 0.0, 0.0), end
    now = norm(sub(end, start))
    longest = max(_LONGEST * (upper + lower), now)
    shortest = min(_SHORTEST * abs(upper - lower), now)
    length = clamp(now * ratio, shortest, longest)
    bend = _corner(upper, lower, length) - _corner(upper, lower, now)
    axis = unit(cross(first, second), unit(hinge, perpendicular(unit(first, (0.0, 0.0, 1.0)))))
    turn = quat_axis_angle(axis, bend)
    return turn, add(joint, rotate(turn, second))


@compiled
def _corner(a, b, opposite):
    """The angle between two sides of a triangle, by the law of cosines, rad."""
    return math.acos(clamp((a * a + b * b - opposite * opposite) / (2.0 * a * b), -1.0, 1.0))
