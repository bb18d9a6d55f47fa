"""The shapes of a character: capsules, ellipsoids and boxes around the bones of a skeleton.

Sizes are fractions of the stature, so that a child and a giant look like people. Every shape is
given in the frame of the joint that carries it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from footik_runtime.anthropometry import Anatomy, Segment
from footik_runtime.quat_arrays import conj, mul, rotate
from footik_runtime.rig import Leg, Rig

Array = NDArray[np.float64]

CAPSULE = int(mujoco.mjtGeom.mjGEOM_CAPSULE)
ELLIPSOID = int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)
BOX = int(mujoco.mjtGeom.mjGEOM_BOX)

# Limbs are two capsules: a full one near the body and a slender one to the far end.
# (from, to) are fractions of the bone, radii fractions of the stature.
_LIMBS: dict[Segment, tuple[tuple[float, float, float], ...]] = {
    Segment.THIGH: ((0.08, 0.50, 0.047), (0.30, 0.93, 0.038)),
    Segment.SHANK: ((0.10, 0.42, 0.035), (0.20, 0.93, 0.025)),
    Segment.UPPER_ARM: ((0.05, 0.50, 0.029), (0.30, 0.92, 0.024)),
    Segment.FOREARM: ((0.08, 0.45, 0.024), (0.20, 0.95, 0.018)),
    Segment.CLAVICLE: ((0.15, 0.95, 0.030),),
    Segment.PELVIS: ((0.30, 0.90, 0.048),),
    Segment.NECK: ((0.0, 1.0, 0.030),),
    Segment.HAND: ((0.05, 0.95, 0.015),),
    Segment.OTHER: ((0.0, 1.0, 0.012),),
}
# Dark spheres where limbs bend: radius as a fraction of the stature.
_KNOBS = {
    Segment.UPPER_ARM: 0.034,
    Segment.FOREARM: 0.0245,
    Segment.HAND: 0.0175,
    Segment.THIGH: 0.046,
    Segment.SHANK: 0.036,
    Segment.FOOT: 0.026,
}
# How long the last part of an arm is whose far end the skeleton does not tell.
_STUMPS = {Segment.FOREARM: 0.155, Segment.HAND: 0.085}
# Half width and half depth of the torso along the spine, from the hips (0) to the neck's base (1).
_TORSO = np.array([0.0, 0.25, 0.6, 0.85, 1.0])
_WIDTH = np.array([0.082, 0.075, 0.092, 0.096, 0.075])
_DEPTH = np.array([0.062, 0.058, 0.066, 0.064, 0.050])


@dataclass(frozen=True, kw_only=True, eq=False)
class Shape:
    """One primitive, in the frame of its joint.

    Attributes:
        joint: index of the joint that carries it.
        kind: CAPSULE, ELLIPSOID or BOX (MuJoCo's geom types).
        position: (3,) of the centre, m.
        rotation: (4,) wxyz.
        size: (3,) as MuJoCo has it: radius and half length, or half sizes, m.
        tone: "body", "left", "right" or "dark".
        solid: it has mass and touches things; else it is there to be seen only.
    """

    joint: int
    kind: int
    position: Array
    rotation: Array
    size: Array
    tone: str
    solid: bool = True

    @property
    def volume(self) -> float:
        """m³."""
        a, b, c = (float(s) for s in self.size)
        if self.kind == CAPSULE:
            return math.pi * a * a * (2.0 * b + 4.0 / 3.0 * a)
        return 8.0 * a * b * c if self.kind == BOX else 4.0 / 3.0 * math.pi * a * b * c


def body_shapes(rig: Rig, anatomy: Anatomy) -> list[Shape]:
    """All shapes of a character, joint by joint; bones of zero length have none."""
    artist = _Artist(rig, anatomy)
    shapes = []
    for joint in range(len(rig.skeleton)):
        shapes += artist.joint(joint)
    if anatomy.biped:
        shapes += artist.torso()
        shapes += artist.head()
    for leg in rig.legs:
        shapes += artist.foot(leg)
    return shapes


class _Artist:
    """What all the shapes of one body need to know; `h` is its stature."""

    def __init__(self, rig: Rig, anatomy: Anatomy) -> None:
        self.rig, self.anatomy, self.h = rig, anatomy, anatomy.stature
        self.up = np.array([0.0, 0.0, 1.0])
        self.forward = np.asarray(rig.forward, dtype=np.float64)
        self.left = np.cross(self.up, self.forward)

    def local(self, joint: int, vector: Array) -> Array:
        """A model-frame direction of the rest pose, in the joint's frame."""
        return rotate(conj(self.anatomy.rotations[joint]), vector)

    def tone(self, joint: int) -> str:
        segment = self.anatomy.segments[joint]
        if segment in (Segment.THIGH, Segment.SHANK, Segment.FOOT, Segment.TOES):
            return "left" if self.anatomy.sides[joint] > 0 else "right"
        return "body"

    def bones(self, joint: int) -> list[Array]:
        """Where the joint's bones lead, in its frame; only the longest where it is a limb."""
        skeleton, segment = self.rig.skeleton, self.anatomy.segments[joint]
        ends = [skeleton.offsets[c] for c in skeleton.children(joint)]
        if joint in skeleton.tips:
            ends.append(np.asarray(skeleton.tips[joint], dtype=np.float64))
        ends = [end for end in ends if np.linalg.norm(end) > 0.005 * self.h]
        if segment in _STUMPS and not skeleton.children(joint) and self.first_of_segment(joint):
            ends = ends or self.stump(joint)
        if segment in (Segment.HAND, Segment.OTHER, Segment.PELVIS):
            return ends
        return sorted(ends, key=np.linalg.norm)[-1:]

    def joint(self, joint: int) -> list[Shape]:
        """Capsules along the bones of one joint, and the knob it turns on."""
        segment = self.anatomy.segments[joint]
        own = joint == self.rig.hips or joint in self.anatomy.spine[:-1]
        shapes: list[Shape] = []
        limbs = () if own and self.anatomy.biped else _LIMBS.get(segment, ())
        thick = 4.0 if segment == Segment.TRUNK else 1.0
        if not self.anatomy.biped and segment in (Segment.TRUNK, Segment.PELVIS):
            limbs, thick = _LIMBS[Segment.OTHER], 6.0
        for bone in self.bones(joint):
            length = float(np.linalg.norm(bone))
            for start, stop, radius in limbs:
                r = min(radius * thick * self.h, 0.45 * length)
                shapes.append(self.capsule(joint, start * bone, stop * bone, r))
        if shapes and self.first_of_segment(joint) and segment in _KNOBS:
            r = min(_KNOBS[segment] * self.h, 0.45 * float(np.linalg.norm(self.bones(joint)[0])))
            shapes.append(self.ball(joint, np.zeros(3), np.full(3, r), "dark", solid=False))
        return shapes

    def first_of_segment(self, joint: int) -> bool:
        parent = self.rig.skeleton.parents[joint]
        return parent < 0 or self.anatomy.segments[parent] != self.anatomy.segments[joint]

    def capsule(self, joint: int, start: Array, stop: Array, radius: float) -> Shape:
        along = stop - start
        rotation = np.array([1.0, 0.0, 0.0, 0.0])
        mujoco.mju_quatZ2Vec(rotation, along)
        size = np.array([radius, 0.5 * float(np.linalg.norm(along)), 0.0])
        return Shape(
            joint=joint,
            kind=CAPSULE,
            position=0.5 * (start + stop),
            rotation=rotation,
            size=size,
            tone=self.tone(joint),
        )

    def ball(
        self,
        joint: int,
        centre: Array,
        size: Array,
        tone: str,
        *,
        axis: Array | None = None,
        solid: bool = True,
    ) -> Shape:
        """An ellipsoid: half sizes forward, left and along `axis` (joint frame; up by default)."""
        axis = self.local(joint, self.up) if axis is None else axis
        rotation = basis(axis, self.local(joint, self.left))
        return Shape(
            joint=joint,
            kind=ELLIPSOID,
            position=centre,
            rotation=rotation,
            size=size,
            tone=tone,
            solid=solid,
        )

    def stump(self, joint: int) -> list[Array]:
        """Where a part of the arm ends that is a leaf without a tip: on along its parent's bone."""
        skeleton = self.rig.skeleton
        bone = skeleton.offsets[joint]
        along = rotate(self.anatomy.rotations[skeleton.parents[joint]], bone)
        length = _STUMPS[self.anatomy.segments[joint]] * self.h
        reach = float(np.linalg.norm(bone))
        return [self.local(joint, along) * (length / reach)] if reach > 1e-9 else []

    def torso(self) -> list[Shape]:
        """Pelvis, and one ellipsoid around each bone of the spine, wide as a body is there."""
        spine, positions, h = self.anatomy.spine, self.anatomy.positions, self.h
        hips = [positions[leg.hip] for leg in self.rig.legs]
        centre = 0.5 * (hips[0] + hips[1]) + 0.012 * h * self.up - positions[spine[0]]
        width = 0.5 * abs(float((hips[0] - hips[1]) @ self.left)) + 0.042 * h
        size = np.array([0.062 * h, max(width, 0.06 * h), 0.058 * h])
        shapes = [self.ball(spine[0], self.local(spine[0], centre), size, "dark")]
        lengths = [float(np.linalg.norm(self.rig.skeleton.offsets[j])) for j in spine[1:]]
        along, whole = 0.0, max(sum(lengths), 1e-9)
        for joint, child, length in zip(spine[:-1], spine[1:], lengths, strict=True):
            middle = (along + 0.5 * length) / whole
            along += length
            if length < 0.01 * h:
                continue
            bone = self.rig.skeleton.offsets[child]
            half = [np.interp(middle, _TORSO, _DEPTH) * h, np.interp(middle, _TORSO, _WIDTH) * h]
            size = np.array([*half, 0.5 * length + 0.060 * h])
            shapes.append(self.ball(joint, 0.5 * bone, size, "body", axis=bone))
        return shapes

    def head(self) -> list[Shape]:
        """An ellipsoid under the vertex, and a dark visor that shows where the face looks."""
        head, h, positions = self.anatomy.head, self.h, self.anatomy.positions
        if head < 0:
            return []
        tip = np.asarray(self.rig.skeleton.tips.get(head, np.zeros(3)), dtype=np.float64)
        above = float(rotate(self.anatomy.rotations[head], tip) @ self.up)
        base = float((positions[self.anatomy.spine[-1]] - positions[head]) @ self.up)
        vertex = max(above, base + 0.142 * h)
        up, forward = self.local(head, self.up), self.local(head, self.forward)
        centre = (vertex - 0.066 * h) * up + 0.012 * h * forward
        size = np.array([0.056, 0.045, 0.066]) * h
        visor = centre + 0.016 * h * forward + 0.006 * h * up
        return [
            self.ball(head, centre, size, "body"),
            self.ball(head, visor, np.array([0.044, 0.040, 0.022]) * h, "dark", solid=False),
        ]

    def foot(self, leg: Leg) -> list[Shape]:
        """Boxes on the sole, heel to ball and ball to tip, and an instep above them."""
        sole, ankle, h = leg.sole, leg.ankle, self.h
        thick = min(0.5 * sole.height, 0.018 * h) if sole.height > 0.0 else 0.01 * h
        front = sole.ball if leg.toe >= 0 else sole.tip
        frame = np.asarray(sole.frame, dtype=np.float64)
        shapes = [self.slab(ankle, sole.frame, -sole.heel, front, (-sole.height, thick), leg)]
        if leg.toe >= 0:
            shapes.append(self.toes(leg, 0.8 * thick))
        # The instep stays above the sole, which alone meets the ground.
        radius = max(min(0.75 * sole.half_width, 0.024 * h, 0.45 * sole.height), 0.004 * h)
        rise = max(radius + 0.1 * thick, thick) - sole.height
        back = rotate(frame, np.array([-0.35 * sole.heel, 0.0, 0.6 * rise]))
        to = rotate(frame, np.array([0.9 * sole.ball, 0.0, rise]))
        if np.linalg.norm(to - back) > 0.01 * h:
            shapes.append(self.capsule(ankle, back, to, radius))
        return [s for s in shapes if (s.size[: 2 if s.kind == CAPSULE else 3] > 0.0).all()]

    def toes(self, leg: Leg, thick: float) -> Shape:
        """The box from ball to tip: it turns with the toes, so it lies along their own frame."""
        sole, anatomy = leg.sole, self.anatomy
        turn = mul(anatomy.rotations[leg.ankle], sole.frame)
        under = rotate(turn, np.array([sole.ball, 0.0, -sole.height]))
        ball = anatomy.positions[leg.ankle] + under - anatomy.positions[leg.toe]
        ball = rotate(mul(conj(sole.toe_frame), conj(anatomy.rotations[leg.toe])), ball)
        span = (float(ball[0]), float(ball[0]) + sole.tip - sole.ball)
        return self.slab(leg.toe, sole.toe_frame, *span, (float(ball[2]), thick), leg)

    def slab(
        self,
        joint: int,
        frame: Array,
        back: float,
        front: float,
        stack: tuple[float, float],
        leg: Leg,
    ) -> Shape:
        """A box on the sole, in a frame at the joint: from `back` to `front` along its x.

        `stack` holds the height of its underside and its thickness, m.
        """
        under, thick = stack
        centre = np.array([0.5 * (back + front), 0.0, under + 0.5 * thick])
        return Shape(
            joint=joint,
            kind=BOX,
            position=rotate(frame, centre),
            rotation=np.asarray(frame, dtype=np.float64),
            size=np.array([0.5 * (front - back), leg.sole.half_width, 0.5 * thick]),
            tone=self.tone(leg.ankle),
        )


def basis(axis: Array, left: Array) -> Array:
    """Rotation (4,) with z along `axis` and y as near to `left` as can be; axis is not zero."""
    z = axis / np.linalg.norm(axis)
    y = left - (left @ z) * z
    if np.linalg.norm(y) < 1e-6:
        y = np.cross(z, [1.0, 0.0, 0.0] if abs(z[0]) < 0.9 else [0.0, 1.0, 0.0])
    y = y / np.linalg.norm(y)
    rotation = np.empty(4)
    mujoco.mju_mat2Quat(rotation, np.stack([np.cross(y, z), y, z], axis=1).ravel())
    return rotation
