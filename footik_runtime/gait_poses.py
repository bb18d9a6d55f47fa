"""Whole-body poses for a gait: the body's parts found by topology, and joints turned to follow.

All turns are written as world rotations on top of the rest pose, so any rest pose (T, A or arms
down, legs apart) gives the same motion. Frame: x the way of travel, y left, z up; radians.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays as qa
from footik_runtime.errors import FootIKError
from footik_runtime.gait_feet import FootPath
from footik_runtime.rig import Leg, Rig
from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]

LEFT = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, kw_only=True)
class Arm:
    """Joint indices of one arm; `side` is 1 for the left and -1 for the right."""

    side: int
    shoulder: int
    elbow: int
    wrist: int


@dataclass(frozen=True, kw_only=True)
class Body:
    """The joints above the hips that a gait moves, by index; each part may be missing.

    Attributes:
        torso: from the hips up to where the arms leave, hips excluded.
        neck: from there up to the head.
        arms: at most one of each side.
    """

    torso: tuple[int, ...] = ()
    neck: tuple[int, ...] = ()
    arms: tuple[Arm, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyMotion:
    """How the body moves over n frames.

    Attributes:
        travel: (n, 2) the root's mean place on the ground, m.
        heading: (n,) the root's mean yaw, rad.
        pelvis: (n, 3) of the hips joint from `travel`, in the heading's frame, z over ground, m.
        pelvis_turn, chest_turn, head_turn: (n, 3) yaw, pitch, roll in the heading's frame, rad.
        arm_swing: (n, 2) of the left and right upper arm, forward positive, rad.
        elbow: (n, 2) how far each elbow is bent, rad.
        arm_out: how far the upper arms stand off the body, rad.
    """

    travel: Array
    heading: Array
    pelvis: Array
    pelvis_turn: Array
    chest_turn: Array
    head_turn: Array
    arm_swing: Array
    elbow: Array
    arm_out: float


@dataclass(frozen=True, kw_only=True, eq=False)
class RestShape:
    """The rest pose seen in the travel frame.

    Attributes:
        facing: (4,) from the travel frame to the model frame.
        positions: (J, 3) m.
        rotations: (J, 4).
        leg_length: mean of all legs, m.
    """

    facing: Array
    positions: Array
    rotations: Array
    leg_length: float

    def span(self, start: int, end: int) -> Array:
        """(3,) from one joint to another."""
        return self.positions[end] - self.positions[start]


def rest_shape(rig: Rig, *, legs: int = 2) -> RestShape:
    """Measure a rig. Raises FootIKError unless it has this many legs, each of some length."""
    names = rig.skeleton.names
    if len(rig.legs) != legs:
        needed = {2: "two", 4: "four"}.get(legs, str(legs))
        raise FootIKError(f"a gait needs a rig with {needed} legs, this one has {len(rig.legs)}.")
    for leg, length in zip(rig.legs, rig.leg_lengths, strict=True):
        if not length > 1e-6:
            raise FootIKError(
                f"the {leg.name} leg ({names[leg.hip]!r} to {names[leg.ankle]!r}) is {length:g} m "
                "long; a gait needs legs longer than 0."
            )
        chain = rig.skeleton.chain(leg.ankle)
        if rig.hips not in chain or leg.knee not in chain or leg.hip not in chain:
            raise FootIKError(
                f"the {leg.name} leg must run from the hips {names[rig.hips]!r} through "
                f"{names[leg.hip]!r} and {names[leg.knee]!r} to {names[leg.ankle]!r}."
            )
    facing = qa.about([0.0, 0.0, 1.0], np.arctan2(rig.forward[1], rig.forward[0]))
    positions, rotations = rig.skeleton.rest_pose()
    back = qa.conj(facing)
    return RestShape(
        facing=facing,
        positions=qa.rotate(back, positions),
        rotations=qa.mul(back, rotations),
        leg_length=float(np.mean(rig.leg_lengths)),
    )


def find_body(rig: Rig) -> Body:
    """Torso, neck and arms by topology: central chains above the hips, and chains that leave them.

    An arm starts at the first joint that stands off the middle, so clavicles stay with the torso.
    """
    rest, skeleton = rest_shape(rig), rig.skeleton
    middle = rest.positions[[leg.hip for leg in rig.legs], 1].mean()
    aside = rest.positions[:, 1] - middle
    spine = _spine(rig, rest, aside)
    arms: dict[int, tuple[float, int, Arm]] = {}
    for depth, joint in enumerate(spine):
        for child in skeleton.children(joint):
            if child in spine or any(child in skeleton.chain(leg.ankle) for leg in rig.legs):
                continue
            chain, length = _longest_chain(skeleton, child)
            arm = _arm(chain, rest, aside)
            if arm and length > arms.get(arm.side, (0.0,))[0]:
                arms[arm.side] = (length, depth, arm)
    top = max((depth for _, depth, _ in arms.values()), default=len(spine) - 1)
    return Body(
        torso=tuple(spine[1 : top + 1]),
        neck=tuple(spine[top + 1 :]),
        arms=tuple(arms[side][2] for side in (1, -1) if side in arms),
    )


def name_body(
    skeleton: Skeleton,
    *,
    torso: tuple[str, ...] = (),
    neck: tuple[str, ...] = (),
    left_arm: tuple[str, str, str] | None = None,
    right_arm: tuple[str, str, str] | None = None,
) -> Body:
    """A body given by joint names; an arm is its shoulder, elbow and wrist."""
    arms = []
    for side, names in ((1, left_arm), (-1, right_arm)):
        if names is not None:
            shoulder, elbow, wrist = (skeleton.index(name) for name in names)
            arms.append(Arm(side=side, shoulder=shoulder, elbow=elbow, wrist=wrist))
    return Body(
        torso=tuple(skeleton.index(name) for name in torso),
        neck=tuple(skeleton.index(name) for name in neck),
        arms=tuple(arms),
    )


def _spine(rig: Rig, rest: RestShape, aside: Array) -> list[int]:
    """The highest chain of central joints from the hips up, hips first."""
    central = np.abs(aside) < 0.06 * rest.leg_length
    best = [rig.hips]
    for joint in range(len(rig.skeleton)):
        chain = rig.skeleton.chain(joint)
        if rig.hips not in chain:
            continue
        chain = chain[: chain.index(rig.hips) + 1][::-1]
        higher = rest.positions[joint, 2] > rest.positions[best[-1], 2] + 1e-9
        if higher and central[chain[1:]].all():
            best = chain
    return best


def _longest_chain(skeleton: Skeleton, start: int) -> tuple[list[int], float]:
    best, best_length = [start], 0.0
    for child in skeleton.children(start):
        chain, length = _longest_chain(skeleton, child)
        length += float(np.linalg.norm(skeleton.offsets[child]))
        if length > best_length:
            best, best_length = [start, *chain], length
    return best, best_length


def _arm(chain: list[int], rest: RestShape, aside: Array) -> Arm | None:
    off = [i for i, joint in enumerate(chain) if abs(aside[joint]) > 0.12 * rest.leg_length]
    if not off:
        return None
    shoulder = chain[off[0]]
    elbow = _next_far(chain[off[0] :], rest, 0.15)
    if elbow == shoulder:
        return None
    wrist = _next_far(chain[chain.index(elbow) :], rest, 0.12)
    return Arm(side=1 if aside[shoulder] > 0 else -1, shoulder=shoulder, elbow=elbow, wrist=wrist)


def _next_far(chain: list[int], rest: RestShape, legs: float) -> int:
    far = [j for j in chain if np.linalg.norm(rest.span(chain[0], j)) > legs * rest.leg_length]
    return far[0] if far else chain[-1]


def hip_joints(rig: Rig, rest: RestShape, motion: BodyMotion) -> Array:
    """Places (2, n, 3) of the hip joints in the heading's frame, from `travel`."""
    turn = qa.euler(*motion.pelvis_turn.T)
    spans = [rest.span(rig.hips, leg.hip) for leg in rig.legs]
    return np.stack([motion.pelvis + qa.rotate(turn, span) for span in spans])


def pose_body(
    rig: Rig, body: Body, motion: BodyMotion, feet: tuple[FootPath, ...]
) -> tuple[Array, Array]:
    """Root positions (n, 3) and local rotations (n, J, 4) in the model frame.

    `feet` are in the heading's frame, from `travel`, left before right.
    """
    rest = rest_shape(rig)
    turns = _upper_turns(body, motion, rest)
    turns[rig.hips] = qa.euler(*motion.pelvis_turn.T)
    wanted = {joint: qa.mul(turn, rest.rotations[joint]) for joint, turn in turns.items()}
    for leg, hip, foot in zip(rig.legs, hip_joints(rig, rest, motion), feet, strict=True):
        wanted.update(_leg(rig, rest, leg, hip, foot, motion.pelvis_turn[:, 0]))
    yaw = qa.about([0.0, 0.0, 1.0], motion.heading)
    turn = qa.mul(rest.facing, yaw)
    root_up = rest.span(0, rig.hips) if rig.hips else np.zeros(3)
    place = np.concatenate([motion.travel, np.zeros((len(yaw), 1))], axis=1)
    root = place + qa.rotate(yaw, motion.pelvis - root_up)
    if rig.hips:
        wanted[0] = np.broadcast_to(rest.rotations[0], yaw.shape)
    wanted = {joint: qa.mul(turn, rotation) for joint, rotation in wanted.items()}
    return qa.rotate(rest.facing, root), local_rotations(rig.skeleton, wanted, len(yaw))


def _upper_turns(body: Body, motion: BodyMotion, rest: RestShape) -> dict[int, Array]:
    """World turns of the torso, neck and arms."""
    turns: dict[int, Array] = {}
    for i, joint in enumerate(body.torso):
        share = (i + 1) / len(body.torso)
        angles = motion.pelvis_turn * (1.0 - share) + motion.chest_turn * share
        turns[joint] = qa.euler(*angles.T)
    for i, joint in enumerate(body.neck):
        share = (i + 1) / len(body.neck)
        angles = motion.chest_turn * (1.0 - share) + motion.head_turn * share
        turns[joint] = qa.euler(*angles.T)
    chest = qa.euler(*(motion.chest_turn if body.torso else motion.pelvis_turn).T)
    for arm in body.arms:
        which = 0 if arm.side > 0 else 1
        out = np.sin(motion.arm_out) * arm.side
        down = np.array([0.0, out, -np.cos(motion.arm_out)])
        hang = qa.between(rest.span(arm.shoulder, arm.elbow), down)
        swing = qa.mul(chest, qa.about(LEFT, -motion.arm_swing[:, which]))
        turns[arm.shoulder] = qa.mul(swing, hang)
        if arm.wrist != arm.elbow:
            # A little inwards, as a relaxed forearm is.
            fore = np.array([0.0, -0.3 * out, -1.0])
            straight = qa.between(rest.span(arm.elbow, arm.wrist), fore)
            bent = qa.mul(qa.about(LEFT, -motion.elbow[:, which]), straight)
            turns[arm.elbow] = qa.mul(swing, bent)
    return turns


def _leg(
    rig: Rig, rest: RestShape, leg: Leg, hip: Array, foot: FootPath, pelvis_yaw: Array
) -> dict[int, Array]:
    """World rotations of hip, knee, ankle and toe joints that put the foot on its path."""
    thigh, shin = rest.span(leg.hip, leg.knee), rest.span(leg.knee, leg.ankle)
    half = 0.5 * (pelvis_yaw + foot.yaw)
    knee_way = np.stack([np.cos(half), np.sin(half), np.zeros_like(half)], axis=-1)
    upper, lower, hinge = _two_bones(
        foot.ankle - hip, float(np.linalg.norm(thigh)), float(np.linalg.norm(shin)), knee_way
    )
    sole = qa.euler(foot.yaw, foot.pitch, np.zeros_like(foot.yaw))
    ankle = qa.mul(sole, qa.conj(leg.sole.frame))
    wanted = {
        leg.hip: bone_turn(thigh, upper, hinge, rest.rotations[leg.hip]),
        leg.knee: bone_turn(shin, lower, hinge, rest.rotations[leg.knee]),
        leg.ankle: ankle,
    }
    if leg.toe >= 0:
        flat = qa.mul(qa.conj(rest.rotations[leg.ankle]), rest.rotations[leg.toe])
        bend = qa.mul(qa.mul(sole, qa.about(LEFT, foot.toe)), qa.conj(sole))
        wanted[leg.toe] = qa.mul(bend, qa.mul(ankle, flat))
    return wanted


def _two_bones(reach: Array, upper: float, lower: float, pole: Array) -> tuple[Array, ...]:
    """Directions (n, 3) of both bones and the hinge (leftward) that reach `reach` (n, 3).

    Law of cosines; a reach that is too long or too short is taken at its limit.
    """
    distance = np.linalg.norm(reach, axis=-1)
    way = qa.unit(reach)
    d = np.clip(distance, abs(upper - lower) + 1e-9, upper + lower)
    cosine = (upper * upper + d * d - lower * lower) / (2.0 * max(upper, 1e-9) * d)
    side = qa.unit(pole - way * np.sum(pole * way, axis=-1, keepdims=True))
    along = upper * np.clip(cosine, -1.0, 1.0)
    out = np.sqrt(np.maximum(upper * upper - along * along, 0.0))
    knee = way * along[:, None] + side * out[:, None]
    hinge = np.cross(side, way)
    return qa.unit(knee), qa.unit(way * d[:, None] - knee), hinge


def bone_turn(rest_bone: Array, bone: Array, hinge: Array, rest_rotation: Array) -> Array:
    """World rotation of a joint whose bone points along `bone` and hinges about `hinge`."""
    if not rest_bone.any():
        return np.broadcast_to(rest_rotation, (len(bone), 4))
    turn = qa.mul(qa.from_bone(bone, hinge), qa.conj(qa.from_bone(rest_bone, LEFT)))
    return qa.mul(turn, rest_rotation)


def local_rotations(skeleton: Skeleton, wanted: dict[int, Array], frames: int) -> Array:
    """Local rotations (n, J, 4) from world rotations of some joints; the others keep their rest."""
    world = np.empty((frames, len(skeleton), 4))
    local = np.empty_like(world)
    for joint, parent in enumerate(skeleton.parents):
        rest = np.broadcast_to(skeleton.rest_rotations[joint], (frames, 4))
        above = world[:, parent] if parent >= 0 else np.broadcast_to([1.0, 0, 0, 0], (frames, 4))
        if joint in wanted:
            local[:, joint] = qa.mul(qa.conj(above), wanted[joint])
        else:
            local[:, joint] = rest
        world[:, joint] = qa.mul(above, local[:, joint])
    return local
