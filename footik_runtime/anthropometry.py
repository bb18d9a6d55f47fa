"""Which part of a body each joint of a skeleton carries, and how much that part weighs.

Found from the rig's legs and the shape of the tree, in the rest pose; only the head is looked for
by name first. Mass fractions are those of men in P. de Leva, "Adjustments to Zatsiorsky-Seluyanov's
segment inertia parameters", J. Biomechanics 29 (1996).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from footik_runtime.quat_arrays import rotate
from footik_runtime.rig import Leg, Rig
from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]


class Segment(StrEnum):
    """The part of a body that moves with a joint."""

    PELVIS = "pelvis"
    TRUNK = "trunk"
    CLAVICLE = "clavicle"
    NECK = "neck"
    HEAD = "head"
    UPPER_ARM = "upper_arm"
    FOREARM = "forearm"
    HAND = "hand"
    THIGH = "thigh"
    SHANK = "shank"
    FOOT = "foot"
    TOES = "toes"
    CARRIER = "carrier"
    """A joint above the hips: it carries the body and has no shape."""
    OTHER = "other"


MASS_FRACTIONS = {
    Segment.HEAD: 0.0694,
    Segment.TRUNK: 0.1596 + 0.1633,
    Segment.PELVIS: 0.1117,
    Segment.UPPER_ARM: 0.0271,
    Segment.FOREARM: 0.0162,
    Segment.HAND: 0.0061,
    Segment.THIGH: 0.1416,
    Segment.SHANK: 0.0433,
    Segment.FOOT: 0.0137,
}
"""Of the body's mass; limbs count once for each side. Together, both sides, exactly 1."""

MASS_PER_HEIGHT_SQUARED = 73.0 / 1.741**2
"""kg/m²: the same men weighed 73.0 kg at 1.741 m."""

WATER = 1000.0
"""kg/m³, the density of what no table lists."""

_COUNTED_IN = {
    Segment.NECK: Segment.HEAD,
    Segment.CLAVICLE: Segment.TRUNK,
    Segment.TOES: Segment.FOOT,
}
# A segment that this body does not have leaves its mass to the next one towards the pelvis.
_HEIRS = (
    (Segment.HAND, Segment.FOREARM),
    (Segment.FOREARM, Segment.UPPER_ARM),
    (Segment.UPPER_ARM, Segment.TRUNK),
    (Segment.HEAD, Segment.TRUNK),
    (Segment.FOOT, Segment.SHANK),
    (Segment.SHANK, Segment.THIGH),
    (Segment.THIGH, Segment.PELVIS),
    (Segment.TRUNK, Segment.PELVIS),
)
_MIDDLE = (Segment.TRUNK, Segment.PELVIS, Segment.HEAD)


@dataclass(frozen=True, kw_only=True, eq=False)
class Anatomy:
    """The parts of one body, by joint.

    Attributes:
        segments: of each joint.
        sides: (J,) int8: 1 left, -1 right, 0 in the middle.
        spine: joints from the hips up to the neck's base.
        head: joint index, -1 where there is none.
        positions: (J, 3) of the joints in the rest pose, model frame, m.
        rotations: (J, 4) of the joints in the rest pose, model frame, wxyz.
        stature: height of the body when it stands straight, m; for other than two legs, the
            height of a human with legs as long.
        biped: it has two legs.
    """

    segments: tuple[Segment, ...]
    sides: NDArray[np.int8]
    spine: tuple[int, ...]
    head: int
    positions: Array
    rotations: Array
    stature: float
    biped: bool


def find_anatomy(rig: Rig) -> Anatomy:
    """The segment of every joint of a rig's skeleton."""
    skeleton = rig.skeleton
    positions, rotations = skeleton.rest_pose()
    leg_length = max(float(np.mean(rig.leg_lengths)) if rig.legs else 1.0, 1e-3)
    left = np.cross([0.0, 0.0, 1.0], rig.forward)
    lateral = (positions - positions[rig.hips]) @ left
    segments = [Segment.OTHER] * len(skeleton)
    biped = len(rig.legs) == 2

    in_leg = np.zeros(len(skeleton), dtype=bool)
    for leg in rig.legs:
        in_leg[_subtree(skeleton, leg.hip)] = True
        _label_leg(skeleton, leg, segments)
    for joint in skeleton.chain(rig.hips)[1:]:
        segments[joint] = Segment.CARRIER
    head = _find_head(skeleton, rig.hips, in_leg, positions, lateral, leg_length)
    spine = _up_from(skeleton, rig.hips, head) if head >= 0 else [rig.hips]
    to_legs = {j for leg in rig.legs for j in skeleton.chain(leg.hip)}
    arms = _find_arms(skeleton, spine, to_legs, lateral, leg_length)
    neck = 1 + max((spine.index(p) for p in (skeleton.parents[a[0]] for a in arms)), default=-1)
    neck = neck if 0 < neck < len(spine) else len(spine) - 1
    _label_spine(skeleton, spine, neck, head, segments)
    for leg in rig.legs:
        for joint in skeleton.chain(leg.hip)[1:]:
            if segments[joint] == Segment.OTHER:
                segments[joint] = Segment.PELVIS if biped else Segment.TRUNK
    for arm in arms:
        _label_arm(skeleton, arm, lateral, positions, leg_length, segments)

    reach = 0.03 * leg_length
    sides = np.where(lateral > reach, 1, np.where(lateral < -reach, -1, 0)).astype(np.int8)
    for limb in (*[leg.hip for leg in rig.legs], *[arm[0] for arm in arms]):
        joints = _subtree(skeleton, limb)
        sides[joints] = 1 if lateral[joints].sum() >= 0.0 else -1
    return Anatomy(
        segments=tuple(segments),
        sides=sides,
        spine=tuple(spine[: neck + 1]),
        head=head,
        positions=positions,
        rotations=rotations,
        stature=_stature(rig, positions, rotations, in_leg, segments, leg_length),
        biped=biped,
    )


def body_mass(stature: float) -> float:
    """Mass in kg of a human body that is `stature` m high, by the table's body-mass index."""
    return MASS_PER_HEIGHT_SQUARED * stature**2


def segment_masses(anatomy: Anatomy, volumes: Array, mass: float | None) -> Array:
    """Mass of each joint's segment, kg.

    Args:
        anatomy: of the body.
        volumes: (J,) of the shapes at each joint, m³; within one segment, mass goes by volume.
        mass: of the whole body, kg; None takes `body_mass` for a biped and the density of water
            for anything else.

    Returns:
        (J,) masses; zero where there is no volume. They sum to `mass`.
    """
    masses = WATER * volumes
    if anatomy.biped:
        whole = body_mass(anatomy.stature) if mass is None else mass
        groups = [(_COUNTED_IN.get(s, s), side) for s, side in _sided(anatomy)]
        room: dict[tuple[Segment, int], float] = {}
        for group, volume in zip(groups, volumes, strict=True):
            room[group] = room.get(group, 0.0) + float(volume)
        shares = _shares(room)
        for joint, group in enumerate(groups):
            if group in shares and volumes[joint] > 0.0:
                masses[joint] = whole * shares[group] * volumes[joint] / room[group]
        mass = whole
    total = float(masses.sum())
    return masses if mass is None or total <= 0.0 else masses * (mass / total)


def _sided(anatomy: Anatomy) -> list[tuple[Segment, int]]:
    pairs = zip(anatomy.segments, anatomy.sides, strict=True)
    return [(s, 0 if _COUNTED_IN.get(s, s) in _MIDDLE else int(side)) for s, side in pairs]


def _shares(room: dict[tuple[Segment, int], float]) -> dict[tuple[Segment, int], float]:
    """Fraction of each (segment, side) that has room; those without leave theirs to the heir."""
    shares = {
        (segment, side): fraction
        for segment, fraction in MASS_FRACTIONS.items()
        for side in ((0,) if segment in _MIDDLE else (1, -1))
    }
    for segment, heir in _HEIRS:
        for side in (0,) if segment in _MIDDLE else (1, -1):
            if room.get((segment, side), 0.0) <= 0.0:
                shares[heir, 0 if heir in _MIDDLE else side] += shares.pop((segment, side))
    return shares


def _subtree(skeleton: Skeleton, joint: int) -> list[int]:
    inside = {joint}
    for j in range(joint + 1, len(skeleton)):
        if int(skeleton.parents[j]) in inside:
            inside.add(j)
    return sorted(inside)


def _up_from(skeleton: Skeleton, start: int, end: int) -> list[int]:
    """Joints from `start` to its descendant `end`, both included."""
    line = skeleton.chain(end)
    return line[: line.index(start) + 1][::-1]


def _label_down(skeleton: Skeleton, root: int, marks: dict[int, Segment], into: list) -> None:
    """Give each joint below `root` its mark, or its parent's label where it has none."""
    for joint in _subtree(skeleton, root):
        into[joint] = marks.get(joint, into[skeleton.parents[joint]])


def _label_leg(skeleton: Skeleton, leg: Leg, into: list[Segment]) -> None:
    marks = {leg.hip: Segment.THIGH, leg.knee: Segment.SHANK, leg.ankle: Segment.FOOT}
    if leg.toe >= 0:
        marks[leg.toe] = Segment.TOES
    _label_down(skeleton, leg.hip, marks, into)


def _find_head(
    skeleton: Skeleton, hips: int, in_leg: NDArray, positions: Array, lateral: Array, length: float
) -> int:
    """The joint named head nearest the root, else the highest leaf in the body's middle; or -1."""
    free = [j for j in _subtree(skeleton, hips) if j != hips and not in_leg[j]]
    named = [j for j in free if "head" in skeleton.names[j].casefold()]
    if named:
        return min(named, key=lambda j: (len(skeleton.chain(j)), j))
    middle = [j for j in free if abs(lateral[j]) < 0.1 * length and not skeleton.children(j)]
    above = [j for j in middle if positions[j, 2] > positions[hips, 2] + 0.3 * length]
    return max(above, key=lambda j: (positions[j, 2], -j), default=-1)


def _find_arms(
    skeleton: Skeleton, spine: list[int], to_legs: set[int], lateral: Array, length: float
) -> list[list[int]]:
    """For each side at most one arm: its joints from where it leaves the spine to its far end."""
    best: dict[int, tuple[float, list[int]]] = {}
    for joint in spine[:-1]:
        for child in skeleton.children(joint):
            if child in spine or child in to_legs:
                continue
            along = {child: 0.0}
            for j in _subtree(skeleton, child)[1:]:
                step = float(np.linalg.norm(skeleton.offsets[j]))
                along[j] = along[int(skeleton.parents[j])] + step
            end = max(along, key=lambda j: along[j])
            if along[end] < 0.3 * length or abs(lateral[end]) < 0.12 * length:
                continue
            side = 1 if lateral[end] > 0.0 else -1
            if along[end] > best.get(side, (0.0, []))[0]:
                best[side] = (along[end], _up_from(skeleton, child, end))
    return [best[side][1] for side in (1, -1) if side in best]


def _label_arm(
    skeleton: Skeleton,
    arm: list[int],
    lateral: Array,
    positions: Array,
    length: float,
    into: list[Segment],
) -> None:
    """Shoulder, elbow and wrist: the first joints far enough along; the rest follows its parent."""
    marks = {arm[0]: Segment.CLAVICLE}
    base = lateral[skeleton.parents[arm[0]]]
    # A collar bone begins near the middle of the body, a shoulder at least a hand's width out.
    at = next((j for j in arm if abs(lateral[j] - base) >= 0.12 * length), arm[0])
    marks[at] = Segment.UPPER_ARM
    for segment, nearest in ((Segment.FOREARM, 0.2), (Segment.HAND, 0.15)):
        rest = arm[arm.index(at) + 1 :]
        far = [j for j in rest if np.linalg.norm(positions[j] - positions[at]) >= nearest * length]
        if not far:
            break
        at = far[0]
        marks[at] = segment
    _label_down(skeleton, arm[0], marks, into)


def _label_spine(
    skeleton: Skeleton, spine: list[int], neck: int, head: int, into: list[Segment]
) -> None:
    for at, joint in enumerate(spine):
        into[joint] = Segment.TRUNK if at < neck else Segment.NECK
    if head >= 0:
        for joint in _subtree(skeleton, head):
            into[joint] = Segment.HEAD
    into[spine[0]] = Segment.PELVIS


def _stature(
    rig: Rig,
    positions: Array,
    rotations: Array,
    in_leg: NDArray,
    segments: list[Segment],
    leg_length: float,
) -> float:
    """Leg, sole and what rises above the hip joints: so bent or spread legs do not shorten it."""
    human = leg_length / 0.49
    if len(rig.legs) != 2:
        return human
    hip_height = float(np.mean([positions[leg.hip, 2] for leg in rig.legs]))
    middle = (Segment.PELVIS, Segment.TRUNK, Segment.NECK, Segment.HEAD)
    tops = [positions[j, 2] for j, s in enumerate(segments) if s in middle and not in_leg[j]]
    for joint, tip in rig.skeleton.tips.items():
        if segments[joint] == Segment.HEAD:
            tops.append((positions[joint] + rotate(rotations[joint], tip))[2])
    sole = float(np.mean([leg.sole.height for leg in rig.legs]))
    return float(np.clip(leg_length + sole + max(tops) - hip_height, 0.8 * human, 1.3 * human))
