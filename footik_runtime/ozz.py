"""ozz-animation's two-bone IK, aim IK and foot-IK frame, number for number, for comparison.

This is a peer, not the library's solver: `leg_ik` is. It keeps ozz's own choices, which differ
from ours: the chain is measured in the start joint's space (scale included), the soft reach starts
with slope 4/3 and overshoots, the angle to the pole's plane is taken without projecting, `reached`
trusts the given mid axis, and the foot looks at C + n from wherever the ankle came to rest.
The one departure: weights blend the short way, where ozz's aim may take the long way round.

A joint is four columns (x, y, z, origin) of three numbers, any affine map. Corrections are
quaternions wxyz in the joint's own frame and post-multiply: local' = local * correction.
Nothing here knows which way is up, but `pelvis_drop`, which is told.
"""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.math3d import (
    add,
    add_scaled,
    clamp,
    cross,
    dot,
    norm,
    quat_axis_angle,
    quat_between,
    quat_mul,
    quat_nlerp,
    rotate,
    scale,
    sub,
)

_SINGULAR = 1e-12  # determinant relative to the product of the columns' lengths


@compiled
def joint_from(rotation, origin):
    """The rigid joint with this rotation (wxyz) and origin."""
    return (
        rotate(rotation, (1.0, 0.0, 0.0)),
        rotate(rotation, (0.0, 1.0, 0.0)),
        rotate(rotation, (0.0, 0.0, 1.0)),
        origin,
    )


@compiled
def vector_from_joint(joint, v):
    """A vector of the joint's space, in the space around it."""
    return add_scaled(add_scaled(scale(joint[0], v[0]), joint[1], v[1]), joint[2], v[2])


@compiled
def point_from_joint(joint, p):
    """A point of the joint's space, in the space around it."""
    return add(joint[3], vector_from_joint(joint, p))


@compiled
def joint_mul(parent, child):
    """The child joint, given in the parent's space, in the space around the parent."""
    return (
        vector_from_joint(parent, child[0]),
        vector_from_joint(parent, child[1]),
        vector_from_joint(parent, child[2]),
        point_from_joint(parent, child[3]),
    )


@compiled
def inverse(joint):
    """Whether the joint can be inverted, and its inverse (the identity where it cannot)."""
    yz = cross(joint[1], joint[2])
    det = dot(joint[0], yz)
    if not abs(det) > _SINGULAR * norm(joint[0]) * norm(joint[1]) * norm(joint[2]):
        return False, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    a = scale(yz, 1.0 / det)
    b = scale(cross(joint[2], joint[0]), 1.0 / det)
    c = scale(cross(joint[0], joint[1]), 1.0 / det)
    t = joint[3]
    return True, (
        (a[0], b[0], c[0]),
        (a[1], b[1], c[1]),
        (a[2], b[2], c[2]),
        (-dot(a, t), -dot(b, t), -dot(c, t)),
    )


@compiled
def soften_distance(distance, near, far):
    """ozz's soft reach: `distance` up to `near`, then bent so that it tends to `far`."""
    width = far - near
    if distance <= near or width <= 0.0:
        return distance
    x3 = (distance - near) / width + 3.0
    return near + width * (1.0 - 81.0 / (x3 * x3 * x3 * x3))


@compiled
def _weighted(correction, weight):
    if weight <= 0.0:
        return (1.0, 0.0, 0.0, 0.0)
    return quat_nlerp((1.0, 0.0, 0.0, 0.0), correction, min(weight, 1.0))


@compiled
def _corner_angle(a, b, opposite):
    """Angle between sides a and b of a triangle, by the third; 0 where a or b is zero."""
    if not a * b > 0.0:
        return 0.0
    return math.acos(clamp((a * a + b * b - opposite * opposite) / (2.0 * a * b), -1.0, 1.0))


@compiled
def _onto_plane(normal, reference, axis, forwards):
    """Turn about +axis or -axis by the angle between two normals, as they are, unprojected."""
    lengths = norm(normal) * norm(reference)
    if not lengths > 0.0:
        return (1.0, 0.0, 0.0, 0.0)
    angle = math.acos(clamp(dot(normal, reference) / lengths, -1.0, 1.0))
    return quat_axis_angle(axis, angle if forwards else -angle)


@compiled
def _start_turn(bent_end, target, hinge, pole, twist):
    """The start joint's turn, in its space: shortest way to the target, then the pole's plane."""
    turn = quat_between(bent_end, target)
    length = norm(target)
    if not length > 0.0:
        return turn
    along = scale(target, 1.0 / length)
    normal = rotate(turn, hinge)
    plane = _onto_plane(normal, cross(target, pole), along, dot(normal, pole) >= 0.0)
    return quat_mul(quat_axis_angle(along, twist), quat_mul(plane, turn))


@compiled
def two_bone(start, mid, end, target, mid_axis, pole, twist, soften, weight):
    """ozz's IKTwoBoneJob.

    Args:
        start, mid, end: joints, in one model space.
        target: where the end should go, model space.
        mid_axis: unit hinge axis in the mid joint's space; a positive turn opens the knee.
        pole: direction the knee should point in, model space.
        twist: extra turn about start-to-target, radians.
        soften: share of the chain's length at which the soft reach starts, clamped to [0, 1].
        weight: 0 none, 1 all of the correction.

    Returns:
        Corrections of the start and of the mid joint, and whether the target was reached. A joint
        that cannot be inverted gives identities and False.
    """
    identity = (1.0, 0.0, 0.0, 0.0)
    start_ok, to_start = inverse(start)
    mid_ok, to_mid = inverse(mid)
    if not (start_ok and mid_ok):
        return identity, identity, False
    mid_s = point_from_joint(to_start, mid[3])
    end_s = point_from_joint(to_start, end[3])
    goal = point_from_joint(to_start, target)
    a, b, length = norm(mid_s), norm(sub(end_s, mid_s)), norm(goal)
    near = (a + b) * clamp(soften, 0.0, 1.0)
    reached = length <= near and length > abs(a - b) and weight >= 1.0

    soft = soften_distance(length, near, a + b)
    if length > 0.0:
        goal = scale(goal, soft / length)
    upper = scale(point_from_joint(to_mid, start[3]), -1.0)
    end_m = point_from_joint(to_mid, end[3])
    before = _corner_angle(a, b, norm(end_s))
    if dot(cross(upper, mid_axis), end_m) < 0.0:
        before = -before
    bend = quat_axis_angle(mid_axis, _corner_angle(a, b, soft) - before)

    bent_end = point_from_joint(to_start, point_from_joint(mid, rotate(bend, end_m)))
    hinge = vector_from_joint(to_start, vector_from_joint(mid, mid_axis))
    pole_s = vector_from_joint(to_start, pole)
    turn = _start_turn(bent_end, goal, hinge, pole_s, twist)
    return _weighted(turn, weight), _weighted(bend, weight), reached


@compiled
def aim(joint, target, forward, offset, up, pole, twist, weight):
    """ozz's IKAimJob: turn a joint until the line `offset + s * forward` passes through the target.

    Args:
        joint: the joint to turn, model space.
        target: where to look, model space.
        forward, up: axes in the joint's space, unit; `up` is turned towards the pole's plane.
        offset: where the line starts, joint space.
        pole: model space.
        twist: extra turn about the direction of the target, radians.
        weight: 0 none, 1 all of the correction.

    Returns:
        The correction, and whether the target can be looked at (whatever the weight). A joint that
        cannot be inverted, or is at its target, gives the identity.
    """
    identity = (1.0, 0.0, 0.0, 0.0)
    ok, to_joint = inverse(joint)
    goal = point_from_joint(to_joint, target) if ok else (0.0, 0.0, 0.0)
    along = dot(forward, offset)
    aside2 = dot(offset, offset) - along * along
    length2 = dot(goal, goal)
    if aside2 > length2:
        return identity, False
    if not length2 > 0.0:
        return identity, True
    look = add_scaled(offset, forward, math.sqrt(length2 - aside2) - along)
    turn = quat_between(look, goal)
    turned_up = rotate(turn, up)
    reference = cross(vector_from_joint(to_joint, pole), goal)
    axis = scale(goal, 1.0 / math.sqrt(length2))
    plane = _onto_plane(cross(turned_up, goal), reference, axis, dot(reference, turned_up) >= 0.0)
    turn = quat_mul(quat_axis_angle(axis, twist), quat_mul(plane, turn))
    return _weighted(turn, weight), True


@compiled
def ankle_target(ray_start, hit, normal, foot_height):
    """Where the sample puts an ankle: on the ray, `foot_height` m off the plane that was hit.

    For a vertical ray that is hit + up * foot_height / (normal . up). A ray along the plane, which
    no plane can answer, gives the hit itself.
    """
    back = sub(ray_start, hit)
    rise = dot(back, normal)
    if rise == 0.0:
        return hit
    return add_scaled(hit, back, foot_height / rise)


@compiled
def pelvis_drop(lowest, ankle, target, up):
    """How far down the pelvis goes, m: the largest drop of any leg that was hit.

    Fold it over these legs, from -inf; unclamped, it may be negative.
    """
    return max(lowest, dot(sub(ankle, target), up))


@compiled
def foot_ik_leg(hip, knee, ankle, target, normal, axes, soften, weight):
    """The sample's leg: two-bone IK to the target, then the ankle aimed at target + normal.

    Args:
        hip, knee, ankle: joints in model space, as sampled.
        target, normal: model space; the normal is unit.
        axes: (knee hinge, knee pole, ankle forward, ankle up), in the knee's and the ankle's own
            spaces. The sample's skeleton has (+z, +y, -x, +y).
        soften: of the two-bone step.
        weight: of both steps.

    Returns:
        Corrections of hip, knee and ankle, and whether the two-bone step reached the target.
    """
    hinge, knee_pole, forward, up = axes
    no_offset = (0.0, 0.0, 0.0)
    origin = (0.0, 0.0, 0.0)
    pole = vector_from_joint(knee, knee_pole)
    hip_turn, knee_turn, reached = two_bone(
        hip, knee, ankle, target, hinge, pole, 0.0, soften, weight
    )
    hip_ok, to_hip = inverse(hip)
    knee_ok, to_knee = inverse(knee)
    if not (hip_ok and knee_ok):
        return hip_turn, knee_turn, (1.0, 0.0, 0.0, 0.0), False
    new_hip = joint_mul(hip, joint_from(hip_turn, origin))
    new_knee = joint_mul(joint_mul(new_hip, joint_mul(to_hip, knee)), joint_from(knee_turn, origin))
    new_ankle = joint_mul(new_knee, joint_mul(to_knee, ankle))
    ankle_pole = vector_from_joint(new_ankle, up)
    look_at = add(target, normal)
    ankle_turn, _ = aim(new_ankle, look_at, forward, no_offset, up, ankle_pole, 0.0, weight)
    return hip_turn, knee_turn, ankle_turn, reached
