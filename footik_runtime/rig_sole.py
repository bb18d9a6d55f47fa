"""Sole: the underside of a foot, and how it is guessed from a rest pose.

Proportions are those of adults: Winter, Biomechanics and Motor Control of Human Movement
(segment lengths as fractions of stature, after Drillis and Contini), and ANSUR foot breadths.
All scale with the leg, so a child and a giant get soles of their own size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from footik_runtime.math3d import quat_conj, quat_from_basis, quat_mul
from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]

_UP = np.array([0.0, 0.0, 1.0])
# Fractions of stature: thigh 0.245, shank 0.246, foot length 0.152, ankle height 0.039.
FOOT_PER_LEG = 0.152 / (0.245 + 0.246)
ANKLE_PER_FOOT = 0.039 / 0.152
# Fractions of the foot's length, heel to tip.
HEEL_PER_FOOT = 0.25
TIP_PER_FOOT = 1.0 - HEEL_PER_FOOT
HALF_WIDTH_PER_FOOT = 0.5 * 0.055 / 0.152
TOE_JOINT_PER_FOOT = 0.13  # the joint's height over the sole
TOE_TIP_PER_FOOT = 0.04
TIP_PER_BALL = 1.45
PAW_PER_FOOT = 0.5  # a paw's length, in parts of a human foot's on a leg as long
# Ankle to toe joint falls by this angle in a flat foot of those proportions, radians.
USUAL_SLOPE = math.atan2(ANKLE_PER_FOOT - TOE_JOINT_PER_FOOT, TIP_PER_FOOT / TIP_PER_BALL)
STEEPEST_FLAT = math.radians(50.0)
_SPLAYED = math.radians(8.0)
_ALONG_SHIN = math.radians(6.0)
_SHORTEST_BALL = 0.08  # of the leg's length, half the usual
_HEIGHT_RANGE = (0.02, 0.45)  # of the leg's length
_ANIMAL_HEIGHT_RANGE = (0.02, 0.9)  # which stand on their toes


@dataclass(frozen=True, kw_only=True, eq=False)
class Sole:
    """The underside of one foot, in its sole frame: at the ankle joint, x forward, y left, z up.

    The frame is fixed to the foot: `frame` is its rotation in the ankle joint's own frame, so
    (world rotation of the joint) * frame is the sole's world rotation. On flat ground a flat
    foot has its z axis up, and its sole lies `height` below the ankle.

    Attributes:
        frame: (4,) wxyz.
        height: of the ankle joint over the sole, m.
        heel: how far the heel lies behind the ankle, m, positive.
        ball: how far the ball (where the toes bend) lies ahead of the ankle, m.
        tip: how far the toe tip lies ahead of the ankle, m; at least `ball`.
        half_width: half the sole's width at the ball, m.
        toe_frame: (4,) wxyz, the sole frame's rotation in the toe joint's frame when the toes lie
            flat with the foot; without a toe joint it has no meaning.
    """

    frame: Array
    height: float
    heel: float
    ball: float
    tip: float
    half_width: float
    toe_frame: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Stance:
    """A pose in which the soles are guessed, and the directions found in it.

    Attributes:
        positions: (J, 3) in the model frame, m.
        rotations: (J, 4) in the model frame, wxyz.
        forward: (3,) unit, horizontal.
        left: (3,) unit: from the right legs to the left ones; up x forward where it stands.
        stands: the legs point down; else the pose says nothing of what is up.
        grounded: the feet rest on the plane z = 0.
        animal: there are four legs.
    """

    positions: Array
    rotations: Array
    forward: Array
    left: Array
    stands: bool
    grounded: bool
    animal: bool


def guess_sole(
    skeleton: Skeleton, chain: tuple[int, int, int, int], stance: Stance, name: str
) -> tuple[Sole, list[str]]:
    """The sole of the leg (hip, knee, ankle, toe or -1), and notes on what had to be guessed."""
    at = stance.positions
    _, knee, ankle, toe = chain
    leg = leg_length(at, chain)
    notes: list[str] = []
    toe_offset = at[toe] - at[ankle] if toe >= 0 else None
    if toe_offset is not None and np.linalg.norm(toe_offset) < 0.02 * leg:
        notes.append(f"{name}: the toe joint lies in the ankle; the foot's length is guessed")
        toe_offset = None
    basis, how = _sole_basis(toe_offset, at[ankle] - at[knee], stance)
    if how:
        notes.append(f"{name}: {how}")
    end = _end_offset(skeleton, stance, ankle, toe)
    hangs = "not flat" in how
    points = [basis @ p if p is not None else None for p in (toe_offset, end)]
    usual = FOOT_PER_LEG * leg * (PAW_PER_FOOT if stance.animal else 1.0)
    ball, tip = _ball_and_tip(points[0], points[1], (leg, usual), name, notes)
    if stance.animal and toe_offset is None:
        ball = tip  # a paw in one piece turns over its tip
    foot = tip / TIP_PER_FOOT
    height = _height(points[0], points[1], foot, name, notes)
    upright = basis[2, 2] > 0.99
    if stance.grounded and upright:
        height = float(at[ankle][2])
        notes = [note for note in notes if "height" not in note]
        notes.append(f"{name}: sole height measured, the rest pose stands on z = 0")
    lowest, highest = _ANIMAL_HEIGHT_RANGE if stance.animal else _HEIGHT_RANGE
    clamped = min(max(height, lowest * leg), highest * leg)
    if clamped != height:
        notes.append(f"{name}: a sole height of {100 * height:.1f} cm is not plausible, limited")
    sole = Sole(
        frame=_in_joint(stance, ankle, basis),
        toe_frame=_in_joint(stance, toe, _toe_basis(toe_offset, basis, hangs)),
        height=clamped,
        heel=HEEL_PER_FOOT * foot,
        ball=ball,
        tip=tip,
        half_width=HALF_WIDTH_PER_FOOT * foot,
    )
    return sole, notes


def leg_length(positions: Array, chain: tuple[int, int, int, int]) -> float:
    """Hip to knee to ankle, m, of positions (J, 3)."""
    hip, knee, ankle, _ = chain
    upper = np.linalg.norm(positions[knee] - positions[hip])
    return float(upper + np.linalg.norm(positions[ankle] - positions[knee]))


def _in_joint(stance: Stance, joint: int, basis: Array) -> Array:
    """The rotation (4,) of axes, rows x, y, z in the model frame, in a joint's frame."""
    world = quat_from_basis(*(tuple(float(c) for c in axis) for axis in basis))
    if joint < 0:
        return np.array([1.0, 0.0, 0.0, 0.0])
    turn = tuple(float(c) for c in stance.rotations[joint])
    return np.array(quat_mul(quat_conj(turn), world))


def _toe_basis(toe: Array | None, basis: Array, hangs: bool) -> Array:
    """Where the toes of the stance point: with the sole, but along the bones of a hanging foot."""
    if toe is None or not hangs:
        return basis
    along = _unit(toe - basis[1] * (toe @ basis[1]), basis[0])
    return np.stack([along, basis[1], np.cross(along, basis[1]).astype(np.float64)])


def _sole_basis(toe: Array | None, shin: Array, stance: Stance) -> tuple[Array, str]:
    """Rows x, y, z of the sole in the model frame, and how they were found where not plainly."""
    up = _UP
    if toe is None:
        if stance.stands:
            return _basis(stance.forward, up), ""
        up = -_unit(shin, -up)
        return _basis(np.cross(stance.left, up), up), "sole guessed square to the shin"
    if stance.stands and stance.animal:
        return _basis(stance.forward, up), ""  # an animal's foot may stand on its toe like a stilt
    if not stance.stands:  # then the shin tells what would be down, standing
        up = -_unit(shin, -up)
    falls = -float(toe @ up)
    steepness = math.atan2(falls, float(np.linalg.norm(toe + falls * up)))
    if not stance.stands and abs(steepness) <= STEEPEST_FLAT:
        return _basis(toe, up), "sole guessed square to the shin"
    if steepness > STEEPEST_FLAT and not stance.grounded:
        return _sloped_basis(toe, stance), (
            "the foot is not flat in the rest pose; its sole is guessed from ankle to toe, "
            f"falling by {math.degrees(USUAL_SLOPE):.0f} deg"
        )
    # Some rest poses splay the legs and roll the feet with them, as if they had been splayed
    # standing: then the foot falls along the shin, and the sole is square to that.
    sideways_shin = shin - stance.forward * (shin @ stance.forward)
    sideways_toe = toe - stance.forward * (toe @ stance.forward)
    if (
        _angle(sideways_shin, -up) > _SPLAYED
        and np.linalg.norm(sideways_toe) > 0.1 * np.linalg.norm(toe)
        and _angle(sideways_shin, sideways_toe) < _ALONG_SHIN
    ):
        splay = math.degrees(_angle(sideways_shin, -up))
        return _basis(toe, -sideways_shin), f"the foot is rolled with the leg, by {splay:.0f} deg"
    return _basis(toe, up), ""


def _sloped_basis(toe: Array, stance: Stance) -> Array:
    """The sole over which ankle to toe falls by the usual slope, its y nearest to the left."""
    along = _unit(toe, stance.forward)
    left = stance.left - along * (stance.left @ along)
    if np.linalg.norm(left) < 1e-6:
        left = np.cross([0.0, 0.0, 1.0], along)
    left = _unit(left, np.array([0.0, 1.0, 0.0]))
    above = np.cross(along, left)
    cosine, sine = math.cos(USUAL_SLOPE), math.sin(USUAL_SLOPE)
    return np.stack([cosine * along + sine * above, left, cosine * above - sine * along])


def _basis(forward: Array, up: Array) -> Array:
    z = _unit(up, np.array([0.0, 0.0, 1.0]))
    x = _unit(forward - z * (forward @ z), np.array([1.0, 0.0, 0.0]))
    return np.stack([x, np.cross(z, x), z])


def _end_offset(skeleton: Skeleton, stance: Stance, ankle: int, toe: int) -> Array | None:
    """Ankle to the far end of the toes (or of the foot where it has none), model frame, m."""
    last = toe if toe >= 0 else ankle
    ends = [stance.positions[c] for c in skeleton.children(last)]
    if last in skeleton.tips:
        turn = tuple(float(c) for c in stance.rotations[last])
        w, v = turn[0], np.array(turn[1:])
        tip = np.asarray(skeleton.tips[last], dtype=np.float64)
        cross = 2.0 * np.cross(v, tip)
        ends.append(stance.positions[last] + tip + w * cross + np.cross(v, cross))
    if not ends:
        return None
    offsets = [end - stance.positions[ankle] for end in ends]
    return max(offsets, key=lambda offset: float(np.linalg.norm(offset)))


def _ball_and_tip(
    toe: Array | None,
    end: Array | None,
    lengths: tuple[float, float],
    name: str,
    notes: list[str],
) -> tuple[float, float]:
    """Where ball and tip lie, m; `lengths` are the leg's, and the foot's where nothing tells."""
    leg, usual = lengths
    usual_tip = TIP_PER_FOOT * usual
    if toe is not None and toe[0] > _SHORTEST_BALL * leg:
        ball = float(toe[0])
        if end is not None and 1.1 * ball <= end[0] <= 2.2 * ball:
            return ball, float(end[0])
        notes.append(f"{name}: toe tip guessed at {TIP_PER_BALL} times the ball")
        return ball, TIP_PER_BALL * ball
    if toe is None and end is not None and 0.3 * usual_tip <= end[0] <= 2.0 * usual_tip:
        notes.append(f"{name}: no toe joint, ball guessed from the tip")
        return float(end[0]) / TIP_PER_BALL, float(end[0])
    notes.append(f"{name}: no toe joint ahead of the ankle, foot length guessed from the leg's")
    return usual_tip / TIP_PER_BALL, usual_tip


def _height(
    toe: Array | None, end: Array | None, foot: float, name: str, notes: list[str]
) -> float:
    below = []
    if toe is not None:
        below.append(TOE_JOINT_PER_FOOT * foot - float(toe[2]))
        if end is not None:
            below.append(TOE_TIP_PER_FOOT * foot - float(end[2]))
        notes.append(f"{name}: sole height from the toe joint and a usual toe's thickness")
        return max(below)
    notes.append(f"{name}: sole height guessed from the foot's length")
    return ANKLE_PER_FOOT * foot


def _unit(v: Array, fallback: Array) -> Array:
    length = float(np.linalg.norm(v))
    return v / length if length > 1e-12 else fallback


def _angle(a: Array, b: Array) -> float:
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))
