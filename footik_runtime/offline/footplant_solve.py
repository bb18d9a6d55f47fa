"""FootPlant's leg solver: two bones turned to a target, and one plant held over its frames.

Any unit of length, any up. The knee stays in the plane it is bent in; lengths stay but for the
stretch that is asked.
"""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.math3d import (
    add,
    clamp,
    cross,
    get3,
    get4,
    norm,
    perpendicular,
    quat_axis_angle,
    quat_between,
    quat_conj,
    quat_from_rotvec,
    quat_mul,
    quat_to_rotvec,
    reject,
    rotate,
    scale,
    set3,
    set4,
    sub,
    unit,
)

_STRAIGHT = 1e-4  # sine at the hip below which a leg shows no plane of its own
_LONGEST = 1.0 - 1e-5  # of the two lengths: a knee is never quite straight
_THERE = 1e-9  # of the reach: an ankle so near its anchor is left to the last bit


@compiled
def softened(distance, full, soften):
    """A distance that approaches the full length ever more slowly over its last share `soften`."""
    free, room = full * (1.0 - soften), full * soften
    if room <= 0.0 or distance <= free:
        return distance
    return free + room * (1.0 - math.exp((free - distance) / room))


@compiled
def _angle(beside, other, opposite):
    """The angle between two sides of a triangle, rad, by the law of cosines."""
    cosine = (beside * beside + other * other - opposite * opposite) / (2.0 * beside * other)
    return math.acos(clamp(cosine, -1.0, 1.0))


@compiled
def leg_turns(hip, knee, ankle, target, axis, soften):
    """World rotations of the upper and the lower bone that bring the ankle to the target.

    The knee's place becomes hip + upper * (knee - hip), the ankle's that + lower * (ankle - knee).
    Where the target is out of reach, the leg points at it.

    Args:
        hip: (3,) joint, world; knee and ankle likewise.
        knee: see hip.
        ankle: see hip.
        target: (3,) of the ankle.
        axis: (3,) of a straight leg's bend: ankle - hip cross knee - hip of one bent the right way.
        soften: share of the length over which reaching is softened; 0 for none.
    """
    l1, l2 = norm(sub(knee, hip)), norm(sub(ankle, knee))
    along, wanted = sub(ankle, hip), sub(target, hip)
    turn = quat_between(along, wanted)
    full = l1 + l2
    if min(l1, l2) <= 1e-9 * full or full == 0.0:
        return turn, turn
    normal = cross(along, sub(knee, hip))
    before = norm(along)
    if norm(normal) <= _STRAIGHT * before * l1:
        normal = reject(axis, along)
        if norm(normal) <= 1e-6 * norm(axis):
            normal = perpendicular(along)
    normal = unit(normal, (0.0, 0.0, 1.0))
    least = max(abs(l1 - l2), 1e-9 * full)
    now = clamp(before, least, full)
    then = clamp(softened(norm(wanted), full, soften), least, full * _LONGEST)
    at_hip = _angle(l1, then, l2) - _angle(l1, now, l2)
    at_knee = _angle(l1, l2, then) - _angle(l1, l2, now)
    upper = quat_mul(turn, quat_axis_angle(normal, at_hip))
    lower = quat_mul(turn, quat_axis_angle(normal, at_hip + at_knee))
    return upper, lower


@compiled
def _part(turn, weight):
    """A true slerp from the identity."""
    return quat_from_rotvec(scale(quat_to_rotvec(turn), weight))


@compiled
def _forward(path, parents, moves, turns, positions, rotations):
    """World places and rotations of a path of joints in one frame, from the joint above it down."""
    for i in range(path.shape[0]):
        j, p = path[i], parents[path[i]]
        if p < 0:
            set3(positions[j], get3(moves[j]))
            set4(rotations[j], get4(turns[j]))
        else:
            above = get4(rotations[p])
            set3(positions[j], add(get3(positions[p]), rotate(above, get3(moves[j]))))
            set4(rotations[j], quat_mul(above, get4(turns[j])))


@compiled
def _set_world(joint, parents, turns, rotations, world):
    """Write a joint's world rotation, and the local one that gives it."""
    p = parents[joint]
    above = (1.0, 0.0, 0.0, 0.0) if p < 0 else get4(rotations[p])
    set4(turns[joint], quat_mul(quat_conj(above), world))
    set4(rotations[joint], world)


@compiled
def _hold_frame(
    path, knee_at, parents, moves, turns, positions, rotations, anchor, weight, axis, most
):
    """One frame's correction of one leg; returns its largest turn (rad) and the ankle's move."""
    last = path.shape[0] - 1
    hip_joint, knee_joint, ankle_joint = path[0], path[knee_at], path[last]
    hip, knee = get3(positions[hip_joint]), get3(positions[knee_joint])
    ankle = get3(positions[ankle_joint])
    reach = norm(sub(knee, hip)) + norm(sub(ankle, knee))
    distance = norm(sub(anchor, hip))
    if norm(sub(anchor, ankle)) <= _THERE * reach:
        return 0.0, 0.0
    foot = get4(rotations[ankle_joint])
    if distance > reach > 0.0:
        longer = 1.0 + (min(distance / reach, most) - 1.0) * weight
        if longer > 1.0:
            for i in range(1, last + 1):
                set3(moves[path[i]], scale(get3(moves[path[i]]), longer))
            _forward(path, parents, moves, turns, positions, rotations)
    upper, lower = leg_turns(
        hip,
        get3(positions[knee_joint]),
        get3(positions[ankle_joint]),
        anchor,
        rotate(get4(rotations[hip_joint]), axis),
        0.0,
    )
    upper, lower = _part(upper, weight), _part(lower, weight)
    knee_world = quat_mul(lower, get4(rotations[knee_joint]))
    _set_world(hip_joint, parents, turns, rotations, quat_mul(upper, get4(rotations[hip_joint])))
    _forward(path[1:knee_at], parents, moves, turns, positions, rotations)
    _set_world(knee_joint, parents, turns, rotations, knee_world)
    _forward(path[knee_at + 1 : last], parents, moves, turns, positions, rotations)
    _set_world(ankle_joint, parents, turns, rotations, foot)
    _forward(path, parents, moves, turns, positions, rotations)
    turned = max(norm(quat_to_rotvec(upper)), norm(quat_to_rotvec(lower)))
    return turned, norm(sub(get3(positions[ankle_joint]), ankle))


@compiled
def hold(
    path,
    knee_at,
    parents,
    moves,
    turns,
    positions,
    rotations,
    anchor,
    weights,
    axis,
    most,
    largest,
):
    """Hold one leg's ankle at an anchor over the frames that have a weight, in place.

    Args:
        path: (N,) joints from hip to ankle; knee_at is the knee's place in it.
        knee_at: see path.
        parents: (J,), -1 for the root.
        moves: (T, J, 3) local translations, written where a leg is stretched.
        turns: (T, J, 4) local rotations, written for hip, knee and ankle.
        positions: (T, J, 3) world, kept true for the joints of the path alone.
        rotations: (T, J, 4) likewise.
        anchor: (3,).
        weights: (T,) 0 to 1.
        axis: (3,) of a straight leg's bend, in the hip joint's frame.
        most: largest factor of the leg's length.
        largest: (2,) raised to the largest turn (rad) and the largest ankle move so far.
    """
    for t in range(weights.shape[0]):
        if weights[t] <= 0.0:
            continue
        turned, moved = _hold_frame(
            path,
            knee_at,
            parents,
            moves[t],
            turns[t],
            positions[t],
            rotations[t],
            anchor,
            weights[t],
            axis,
            most,
        )
        largest[0] = max(largest[0], turned)
        largest[1] = max(largest[1], moved)
