"""Limbs of a quadruped's gait: the angles of three bones that put a paw on its path.

Behind, the last bone stays parallel to the thigh, as far as it is at rest; in front it goes with
the lower leg and flexes in the swing (Fischer and Blickhan 2006). Either way two bones of known
length are left, solved by the law of cosines. Frame: x the way of travel, y left, z up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays as qa
from footik_runtime.gait_feet import FootPath
from footik_runtime.gait_poses import LEFT, RestShape, bone_turn
from footik_runtime.hock import folding_hock, middle_joint
from footik_runtime.rig import Leg, Rig

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Limb:
    """One leg as its gait sees it.

    Attributes:
        leg: of the rig.
        middle: the joint between knee and ankle; -1 where there is none.
        folds: the last bone follows the thigh; else the lower leg.
        bones: (3, 3) hip to knee, to the middle joint (or ankle), to the ankle, at rest, m.
        slant: rad about the left, from the bone that the last one follows to the last one.
        knee_way: 1 where the knee points ahead, -1 where it points back.
        length: the most that the bones span while the last one follows, m.
    """

    leg: Leg
    middle: int
    folds: bool
    bones: Array
    slant: float
    knee_way: float
    length: float


def find_limb(rig: Rig, rest: RestShape, leg: Leg) -> Limb:
    """Measure a leg in the rest pose."""
    middle = middle_joint(rig, leg)
    folds = middle >= 0 and folding_hock(rig, leg) == middle
    lower_end = middle if middle >= 0 else leg.ankle
    bones = np.stack(
        [
            rest.span(leg.hip, leg.knee),
            rest.span(leg.knee, lower_end),
            rest.span(lower_end, leg.ankle),
        ]
    )
    followed = bones[0] if folds else bones[1]
    slant = _about_left(followed, bones[2]) if middle >= 0 else 0.0
    line = qa.unit(rest.span(leg.hip, leg.ankle))
    off = bones[0] - line * (bones[0] @ line)
    thigh, shin, last = (float(length) for length in np.linalg.norm(bones, axis=1))
    pair = _joined(thigh if folds else shin, last, np.array(slant))[0]
    return Limb(
        leg=leg,
        middle=middle,
        folds=folds,
        bones=bones,
        slant=slant,
        knee_way=-1.0 if off[0] < 0.0 else 1.0,
        length=float(pair) + (shin if folds else thigh),
    )


def pose_limb(
    rest: RestShape, limb: Limb, hip: Array, foot: FootPath, flex: Array
) -> dict[int, Array]:
    """World rotations (n, 4) of the leg's joints, hip (n, 3) to toe; flex (n,) of a wrist, rad."""
    leg = limb.leg
    thigh, shin, last, hinge = _directions(limb, foot.ankle - hip, flex)
    sole = qa.euler(foot.yaw, foot.pitch, np.zeros_like(foot.yaw))
    ankle = qa.mul(sole, qa.conj(leg.sole.frame))
    wanted = {
        leg.hip: bone_turn(limb.bones[0], thigh, hinge, rest.rotations[leg.hip]),
        leg.knee: bone_turn(limb.bones[1], shin, hinge, rest.rotations[leg.knee]),
        leg.ankle: ankle,
    }
    if limb.middle >= 0:
        wanted[limb.middle] = bone_turn(limb.bones[2], last, hinge, rest.rotations[limb.middle])
    if leg.toe >= 0:
        flat = qa.mul(qa.conj(rest.rotations[leg.ankle]), rest.rotations[leg.toe])
        bend = qa.mul(qa.mul(sole, qa.about(LEFT, foot.toe)), qa.conj(sole))
        wanted[leg.toe] = qa.mul(bend, qa.mul(ankle, flat))
    return wanted


def _directions(limb: Limb, reach: Array, flex: Array) -> tuple[Array, Array, Array, Array]:
    """Unit directions (n, 3) of the three bones that span `reach` (n, 3), and the hinge, leftward.

    A reach that is too long or too short is taken at its limit.
    """
    thigh, shin, last = np.linalg.norm(limb.bones, axis=1)
    if limb.folds:
        slant = np.full(len(reach), limb.slant)
        pair, apart = _joined(thigh, last, slant)
        upper, lower = pair, np.full(len(reach), shin)
    else:
        slant = limb.slant + flex
        pair, apart = _joined(shin, last, slant)
        upper, lower = np.full(len(reach), thigh), pair
    way = qa.unit(reach)
    d = np.linalg.norm(reach, axis=-1)
    d = np.clip(d, np.abs(upper - lower) + 1e-6, upper + lower - 1e-6)
    hinge = qa.unit(np.cross(np.cross(way, LEFT), way))
    at_hip = np.arccos(np.clip((upper**2 + d**2 - lower**2) / (2.0 * upper * d), -1.0, 1.0))
    at_end = np.arccos(np.clip((lower**2 + d**2 - upper**2) / (2.0 * lower * d), -1.0, 1.0))
    # About the left, a positive angle turns what hangs down backwards.
    first = _turned(way, hinge, -limb.knee_way * at_hip)
    second = _turned(way, hinge, limb.knee_way * at_end)
    if limb.folds:
        first = _turned(first, hinge, -apart)
        return first, second, _turned(first, hinge, slant), hinge
    second = _turned(second, hinge, -apart)
    return first, second, _turned(second, hinge, slant), hinge


def _joined(first: float, last: float, slant: Array) -> tuple[Array, Array]:
    """Length of two bones laid end to end, the last slanted, and its angle from the first, rad."""
    along, aside = first + last * np.cos(slant), last * np.sin(slant)
    return np.hypot(along, aside), np.arctan2(aside, along)


def _about_left(a: Array, b: Array) -> float:
    """The angle about the left from a (3,) to b (3,), rad."""
    return math.atan2(float(b[0] * a[2] - b[2] * a[0]), float(a[0] * b[0] + a[2] * b[2]))


def _turned(v: Array, axis: Array, angle: Array) -> Array:
    """Vectors (n, 3) turned about unit axes (n, 3) by angles (n,), rad."""
    return qa.rotate(qa.from_rotvec(axis * angle[:, None]), v)
