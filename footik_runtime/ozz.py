"""ozz-animation's two-bone and aim kernels and its foot_ik sample's frame, exactly.

This is a peer to compare with, faults included (its pelvis is unlimited, its foot aims at the
target and not at the ankle, its softening overshoots). The library's own solver is `leg_ik`.

It stays in ozz's frame: y up, metres, radians, column vectors, (4, 4) matrices from joint to model
space. Quaternions are wxyz as everywhere here. Corrections post-multiply: local' = local * q.

Where ozz divides by zero (a zero bone, a pole along the target) this turns by nothing instead. A
weighted aim always goes the short way round; ozz, asked to twist, sometimes goes the long way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from footik_runtime.errors import FootIKError
from footik_runtime.quat_arrays import about, between, mul, rotate, unit

Array = NDArray[np.float64]
Cast = Callable[[Array], tuple[ArrayLike, ArrayLike] | None]
"""From a ray's start, straight down: the nearest hit's point and unit normal, or None."""

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
UP = np.array([0.0, 1.0, 0.0])
ROOT_RAY_HEIGHT = 10.0
ANKLE_RAY_HEIGHT = 0.5
KNEE_AXIS = np.array([0.0, 0.0, 1.0])
FOOT_FORWARD = np.array([-1.0, 0.0, 0.0])
FOOT_UP = np.array([0.0, 1.0, 0.0])
_TINY = 1e-12


# -- the two kernels -----------------------------------------------------------------------------


def two_bone(
    start: ArrayLike,
    mid: ArrayLike,
    end: ArrayLike,
    target: ArrayLike,
    mid_axis: ArrayLike,
    pole: ArrayLike,
    twist: float = 0.0,
    soften: float = 1.0,
    weight: float = 1.0,
) -> tuple[Array, Array, bool]:
    """Bring the end joint to the target by turning the start and the mid joint.

    start, mid, end: (4, 4) joint matrices. target, pole: (3,), model space. mid_axis: (3,), unit,
    mid joint's space; a positive turn about it opens the joint. twist: radians about the line to
    the target. soften: share of the full length from which the approach slows. Raises FootIKError.

    Returns the corrections (4,) of the start and of the mid joint, and ozz's `reached`.
    """
    start, mid, end = _matrix("start", start), _matrix("mid", mid), _matrix("end", end)
    target, pole = _vector("target", target), _vector("pole", pole)
    mid_axis = _axis("mid_axis", mid_axis)
    _check_finite(twist=twist, soften=soften, weight=weight)
    if weight <= 0.0 or _singular(start) or _singular(mid):
        return IDENTITY.copy(), IDENTITY.copy(), False

    to_start, to_mid = _inverse(start), _inverse(mid)
    mid_to_start = to_start @ mid
    knee = mid_to_start[:3, 3]
    tip = _point(to_start, end[:3, 3])
    upper, lower = _length(knee), _length(tip - knee)
    goal, pole = _point(to_start, target), to_start[:3, :3] @ pole
    distance = _length(goal)
    soft_start = (upper + lower) * min(max(soften, 0.0), 1.0)
    reached = abs(upper - lower) < distance <= soft_start and weight >= 1.0
    softened = _softened(distance, soft_start, upper + lower)

    initial = _interior_angle(upper, lower, _length(tip))
    tip_in_mid = _point(to_mid, end[:3, 3])
    if np.cross(-_point(to_mid, start[:3, 3]), mid_axis) @ tip_in_mid < 0.0:
        initial = -initial
    mid_turn = about(mid_axis, _interior_angle(upper, lower, softened) - initial)

    bent_tip = _point(mid_to_start, rotate(mid_turn, tip_in_mid))
    start_turn = between(bent_tip, goal)
    if distance > 0.0:
        towards = goal / distance
        leg_normal = rotate(start_turn, mid_to_start[:3, :3] @ mid_axis)
        plane = _turn_to(leg_normal, np.cross(goal, pole), towards, float(leg_normal @ pole))
        start_turn = mul(about(towards, twist), mul(plane, start_turn))
    return _weighted(start_turn, weight), _weighted(mid_turn, weight), reached


def aim(
    joint: ArrayLike,
    target: ArrayLike,
    forward: ArrayLike,
    offset: ArrayLike,
    up: ArrayLike,
    pole: ArrayLike,
    twist: float = 0.0,
    weight: float = 1.0,
) -> tuple[Array, bool]:
    """Turn a joint so that a ray from `offset` along `forward` meets the target.

    joint: (4, 4) matrix. target, pole: (3,), model space. forward (unit), offset, up: (3,), joint
    space; up is turned towards the pole. twist: radians about the line to the target. Raises
    FootIKError.

    Returns the joint's correction (4,), and whether the target was far enough to be aimed at.
    """
    joint, target, pole = _matrix("joint", joint), _vector("target", target), _vector("pole", pole)
    forward = _axis("forward", forward)
    offset, up = _vector("offset", offset), _vector("up", up)
    _check_finite(twist=twist, weight=weight)
    to_joint = _inverse(joint)
    goal, pole = _point(to_joint, target), to_joint[:3, :3] @ pole
    distance = _length(goal)
    along = float(forward @ offset)
    aside2 = float(offset @ offset) - along * along
    if aside2 > distance * distance:
        return IDENTITY.copy(), False
    if weight <= 0.0 or distance == 0.0:
        return IDENTITY.copy(), True

    ray_end = offset + forward * (math.sqrt(distance * distance - max(aside2, 0.0)) - along)
    turn = between(ray_end, goal)
    turned_up, reference = rotate(turn, up), np.cross(pole, goal)
    towards = goal / distance
    side = np.cross(turned_up, goal)
    roll = _turn_to(side, reference, towards, float(reference @ turned_up))
    return _weighted(mul(about(towards, twist), mul(roll, turn)), weight), True


def _softened(distance: float, soft_start: float, full: float) -> float:
    """The distance the chain goes to, metres: the asked one up to soft_start, then ever less."""
    room = full - soft_start
    if distance <= soft_start or room <= 0.0:
        return distance
    x = (distance - soft_start) / room
    return soft_start + room * (1.0 - 81.0 / (x + 3.0) ** 4)


def _interior_angle(a: float, b: float, across: float) -> float:
    """Angle between sides a and b of the triangle whose third side is `across`; pi is straight."""
    if 2.0 * a * b < _TINY:
        return math.pi
    return _acos((a * a + b * b - across * across) / (2.0 * a * b))


def _turn_to(normal: Array, reference: Array, axis: Array, sense: float) -> Array:
    """The turn about the axis by the angle between two normals, with the sign of `sense`.

    None where a normal is zero. ozz measures the angle as it is, not in the plane it turns in.
    """
    normal, reference = unit(normal), unit(reference)
    if not normal.any() or not reference.any():
        return IDENTITY
    return about(axis if sense >= 0.0 else -axis, _acos(float(normal @ reference)))


def _weighted(turn: Array, weight: float) -> Array:
    """The turn with w >= 0, blended from the identity below weight 1, unit length."""
    turn = -turn if turn[0] < 0.0 else turn
    return unit(IDENTITY + (turn - IDENTITY) * weight if weight < 1.0 else turn)


# -- the sample's frame --------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class LocalPose:
    """A sampled pose of J joints, parents before children: each joint relative to its parent."""

    parents: Sequence[int]
    """(J,), -1 for a root."""
    translations: Array
    """(J, 3) metres."""
    rotations: Array
    """(J, 4) wxyz."""
    scales: Array
    """(J, 3)."""

    def local_matrices(self, joints: ArrayLike, corrections: ArrayLike = IDENTITY) -> Array:
        """(N, 4, 4) of N joints, their rotations post-multiplied by corrections (N, 4)."""
        joints = np.asarray(joints)
        turns = mul(self.rotations[joints], corrections)
        axes = rotate(turns[:, None, :], np.eye(3)) * self.scales[joints][:, :, None]
        matrices = np.zeros((len(joints), 4, 4))
        matrices[:, :3, :3] = np.swapaxes(axes, 1, 2)
        matrices[:, :3, 3] = self.translations[joints]
        matrices[:, 3, 3] = 1.0
        return matrices

    def model_matrices(self) -> Array:
        """(J, 4, 4), joint to model space."""
        matrices = self.local_matrices(np.arange(len(self.parents)))
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                matrices[joint] = matrices[parent] @ matrices[joint]
        return matrices


@dataclass(frozen=True, kw_only=True)
class LegFrame:
    """One leg after the frame; hit, target and ankle start are zero where its ray met nothing."""

    hit: bool
    ankle_initial_w: Array
    """(3,), before the pelvis moved."""
    hit_point_w: Array
    hit_normal_w: Array
    ankle_target_w: Array
    rotations_l: Array
    """(3, 4) wxyz: hip, knee, ankle, corrected."""
    knee_m: Array
    """(3,)."""
    ankle_m: Array
    """(4, 4)."""


@dataclass(frozen=True, kw_only=True)
class CharacterFrame:
    """What the sample makes of one frame of one character."""

    root_w: Array
    """(3,), on the ground."""
    pelvis_offset_w: Array
    """(3,), added to the root; it may raise."""
    legs: tuple[LegFrame, ...]


def foot_ik(
    pose: LocalPose,
    legs: Sequence[tuple[int, int, int]],
    position: ArrayLike,
    yaw: float,
    cast: Cast,
    *,
    foot_height: float = 0.12,
    weight: float = 1.0,
    soften: float = 1.0,
) -> CharacterFrame:
    """One frame of ozz's foot_ik sample.

    legs: (hip, knee, ankle) joints, left first. position: (3,) world, set onto the ground below.
    yaw: radians about +y. foot_height: metres, ankle above the sole. Knee and foot axes are those
    of the sample's skeleton: the knee bends about its z, the foot's -x looks along the ground's
    normal. Raises FootIKError.
    """
    _check_finite(yaw=yaw, foot_height=foot_height)
    root = _vector("position", position)
    if (ground := _ground(cast, root + UP * ROOT_RAY_HEIGHT)) is not None:
        root = ground[0]
    matrices = pose.model_matrices()
    to_world = _placed(root, yaw)
    ankles = [_point(to_world, matrices[ankle][:3, 3]) for _, _, ankle in legs]
    hits = [_ground(cast, ankle + UP * ANKLE_RAY_HEIGHT) for ankle in ankles]
    targets = [hit and hit[0] + UP * (foot_height / hit[1][1]) for hit in hits]
    pelvis = -UP * _pelvis_drop(ankles, targets)
    to_model = _inverse(_placed(root + pelvis, yaw))
    frames = []
    for joints, ankle, hit, target in zip(legs, ankles, hits, targets, strict=True):
        corrections = (IDENTITY, IDENTITY, IDENTITY)
        if hit is not None and target is not None:
            aimed = _point(to_model, target + hit[1])
            wanted = _point(to_model, target)
            corrections = _leg_turns(pose, matrices, joints, wanted, aimed, soften, weight)
        _, knee, foot = _chain(pose, matrices, joints, corrections)
        frames.append(
            LegFrame(
                hit=hit is not None,
                ankle_initial_w=ankle,
                hit_point_w=hit[0] if hit else np.zeros(3),
                hit_normal_w=hit[1] if hit else np.zeros(3),
                ankle_target_w=target if target is not None else np.zeros(3),
                rotations_l=mul(pose.rotations[list(joints)], np.array(corrections)),
                knee_m=knee[:3, 3],
                ankle_m=foot,
            )
        )
    return CharacterFrame(root_w=root, pelvis_offset_w=pelvis, legs=tuple(frames))


def _leg_turns(
    pose: LocalPose,
    matrices: Array,
    joints: tuple[int, int, int],
    target: Array,
    aimed: Array,
    soften: float,
    weight: float,
) -> tuple[Array, Array, Array]:
    """Corrections of hip, knee and ankle: reach the target, then look at `aimed`; model space."""
    hip, knee, ankle = joints
    pole = matrices[knee][:3, 1]
    hip_turn, knee_turn, _ = two_bone(
        matrices[hip],
        matrices[knee],
        matrices[ankle],
        target,
        KNEE_AXIS,
        pole,
        soften=soften,
        weight=weight,
    )
    foot = _chain(pose, matrices, joints, (hip_turn, knee_turn, IDENTITY))[2]
    foot_turn, _ = aim(foot, aimed, FOOT_FORWARD, np.zeros(3), FOOT_UP, foot[:3, 1], weight=weight)
    return hip_turn, knee_turn, foot_turn


def _chain(
    pose: LocalPose, matrices: Array, joints: Sequence[int], corrections: Sequence[Array]
) -> list[Array]:
    """Model matrices of the three joints of a leg with their corrections."""
    parent = pose.parents[joints[0]]
    at = matrices[parent] if parent >= 0 else np.eye(4)
    chain = []
    for local in pose.local_matrices(joints, np.array(corrections)):
        at = at @ local
        chain.append(at)
    return chain


def _pelvis_drop(ankles: Sequence[Array], targets: Sequence[Array | None]) -> float:
    """Metres the lowest leg has to sink, negative where all must rise; 0 where none has ground."""
    drops = [float(a[1] - t[1]) for a, t in zip(ankles, targets, strict=True) if t is not None]
    return max(drops, default=0.0)


def _ground(cast: Cast, origin: Array) -> tuple[Array, Array] | None:
    """A cast's answer as arrays; a wall, on which no foot can stand, counts as no ground."""
    found = cast(origin)
    if found is None:
        return None
    point, normal = _vector("hit point", found[0]), _vector("hit normal", found[1])
    return None if abs(normal[1]) < _TINY else (point, normal)


def _placed(position: Array, yaw: float) -> Array:
    """(4, 4), model to world: a turn about +y, then a move."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotate(about(UP, yaw), np.eye(3)).T
    matrix[:3, 3] = position
    return matrix


# -- small parts ---------------------------------------------------------------------------------


def _point(matrix: Array, point: Array) -> Array:
    return matrix[:3, :3] @ point + matrix[:3, 3]


def _length(v: Array) -> float:
    return math.sqrt(float(v @ v))


def _acos(cosine: float) -> float:
    return math.acos(min(max(cosine, -1.0), 1.0))


def _singular(matrix: Array) -> bool:
    """True where the axes are (nearly) flat, whatever their scale."""
    axes = matrix[:3, :3]
    size = float(np.prod(np.linalg.norm(axes, axis=0)))
    return abs(float(np.linalg.det(axes))) <= _TINY * size


def _inverse(matrix: Array) -> Array:
    """ozz takes zero for the inverse of a singular matrix: all is at the joint, nothing turns."""
    return np.zeros((4, 4)) if _singular(matrix) else np.asarray(np.linalg.inv(matrix), np.float64)


def _matrix(name: str, value: ArrayLike) -> Array:
    return _array(name, value, (4, 4))


def _vector(name: str, value: ArrayLike) -> Array:
    return _array(name, value, (3,))


def _axis(name: str, value: ArrayLike) -> Array:
    axis = _vector(name, value)
    if abs(_length(axis) - 1.0) > 1e-3:
        raise FootIKError(f"ozz {name} has length {_length(axis):.6g}; it must be a unit vector.")
    return axis


def _array(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = np.asarray(value, dtype=np.float64)
    if array.shape != shape:
        raise FootIKError(f"ozz {name} has shape {array.shape}; it must be {shape}.")
    if not np.isfinite(array).all():
        raise FootIKError(f"ozz {name} holds NaN or infinity; all {array.size} must be finite.")
    return array


def _check_finite(**numbers: float) -> None:
    for name, number in numbers.items():
        if not math.isfinite(number):
            raise FootIKError(f"ozz {name} is {number}; it must be a finite number.")
