"""The built-in motion of four legs: walk and trot, made from formulas, for any quadruped rig.

Each returns a looping `Clip` as the gaits of `gait` do: contacts are exact, and known by two
curves a leg. Lengths are told by the height of the hip joints, and pace by the Froude number
v² / (g hip height), so that a cat and a horse move alike (Alexander and Jayes 1983).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays as qa
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.gait import EASE, cycle_frames, made_clip
from footik_runtime.gait_feet import FootPath, Roll, bump, foot_shape, rolling_foot
from footik_runtime.gait_limbs import Limb, find_limb, pose_limb
from footik_runtime.gait_poses import RestShape, local_rotations, rest_shape
from footik_runtime.gait_trunk import Trunk, TrunkMotion, find_trunk, hip_places, trunk_turns
from footik_runtime.rig import Rig

Array = NDArray[np.float64]

WALK_FROUDE = (0.02, 0.6)
TROT_FROUDE = (0.3, 2.0)

_GRAVITY = 9.81
_REACH = 0.97  # part of a leg's length that may be used, so that knees never lock
_SWUNG_FARTHER = 0.035  # strides; a paw swings so much farther ahead than it strikes
_USUAL_HIPS = 0.55  # m: the hips' height for which lengths below are given
_FRONT, _HIND = 0, 2  # rig.legs: left before right, front before hind


@dataclass(frozen=True, kw_only=True)
class _Pace:
    """What tells one gait from another.

    Attributes:
        name: of the clip.
        strikes: when each leg strikes, cycles: left front, right front, left hind, right hind.
        stride: length of one at a Froude number of 1, hip heights.
        duty: share of the cycle in contact.
        ball_start: when a paw's heel leaves, parts of the contact.
        off: pitch of a paw at the end of contact, degrees.
        tuck: extra lift of a paw early in the swing, m.
        flex: of a wrist in the swing, degrees.
        narrow: how far a paw stands out, parts of its hip joint's distance from the middle.
        bob, sway: half the trunk's rise and fall, twice a cycle, and its swing aside, once, m.
        yaw, pitch, roll: half the trunk's swings, degrees.
    """

    name: str
    strikes: tuple[float, float, float, float]
    stride: float
    duty: float
    ball_start: float
    off: float
    tuck: float
    flex: float
    narrow: float
    bob: float
    sway: float
    yaw: float
    pitch: float
    roll: float


def quadruped_walk(rig: Rig, *, speed: float = 1.0, fps: float = 60.0) -> Clip:
    """One cycle of walking at `speed` m/s, 0.33 to 1.8 for hip joints 0.55 m over the ground.

    Lateral sequence: each front foot strikes a quarter of a cycle after the hind foot of its side,
    and two or three feet are down at any time (Hildebrand 1965). Stride length is 2.4 hip
    heights * Froude^.34 (Alexander and Jayes 1983).

    Raises:
        FootIKError: for a speed out of range, a bad rate, or a rig without four legs.
    """
    rest = rest_shape(rig, legs=4)
    froude = _froude("walking speed", speed, WALK_FROUDE, _hips_height(rig, rest))
    pace = _Pace(
        name="quadruped walk",
        strikes=(0.25, 0.75, 0.0, 0.5),
        stride=2.4,
        duty=0.77 - 0.25 * math.sqrt(froude),
        ball_start=0.78,
        off=42.0,
        tuck=0.035,
        flex=55.0,
        narrow=0.85,
        bob=0.006,
        sway=0.010,
        yaw=4.0,
        pitch=1.0,
        roll=2.0,
    )
    return _travel(rig, rest, pace, speed, froude, fps)


def trot(rig: Rig, *, speed: float = 2.0, fps: float = 60.0) -> Clip:
    """One cycle of trotting at `speed` m/s, 1.3 to 3.3 for hip joints 0.55 m over the ground.

    Feet strike in diagonal pairs, with a flight after each. Strides are an eighth shorter than
    those of the walk's formula: the shoulder blade, which swings too, is no joint here.

    Raises:
        FootIKError: for a speed out of range, a bad rate, or a rig without four legs.
    """
    rest = rest_shape(rig, legs=4)
    froude = _froude("trotting speed", speed, TROT_FROUDE, _hips_height(rig, rest))
    pace = _Pace(
        name="trot",
        strikes=(0.0, 0.5, 0.5, 0.0),
        stride=2.1,
        duty=0.52 - 0.12 * math.sqrt(froude),
        ball_start=0.7,
        off=48.0,
        tuck=0.06,
        flex=75.0,
        narrow=0.7,
        bob=0.014,
        sway=0.004,
        yaw=2.0,
        pitch=0.8,
        roll=1.0,
    )
    return _travel(rig, rest, pace, speed, froude, fps)


def _froude(what: str, speed: float, limits: tuple[float, float], height: float) -> float:
    low, high = (math.sqrt(limit * _GRAVITY * height) for limit in limits)
    if not (math.isfinite(speed) and low <= speed <= high):
        raise FootIKError(
            f"{what} must be {low:.3g} to {high:.3g} m/s for hip joints {height:.3g} m over the "
            f"ground, not {speed:g}."
        )
    return speed * speed / (_GRAVITY * height)


def _hips_height(rig: Rig, rest: RestShape) -> float:
    """Mean height of the hip joints over the soles, m."""
    return float(np.mean([leg.sole.height - rest.span(leg.hip, leg.ankle)[2] for leg in rig.legs]))


def _travel(
    rig: Rig, rest: RestShape, pace: _Pace, speed: float, froude: float, fps: float
) -> Clip:
    height = _hips_height(rig, rest)
    size = height / _USUAL_HIPS
    frames, period = cycle_frames(pace.stride * height * froude**0.34 / speed, fps)
    stride = speed * period
    t = np.arange(frames + 1) / frames
    p = np.append(t[:-1], 0.0)
    trunk, limbs = find_trunk(rig, rest), [find_limb(rig, rest, leg) for leg in rig.legs]
    feet = _feet(rig, rest, pace, stride, size, p, EASE / period)
    motion = _trunk_motion(pace, size, p)
    up = np.array([0.0, 0.0, _highest(rest, limbs, trunk, motion, feet)])
    motion = replace(motion, place=motion.place + up)
    travel = np.stack([stride * t, np.zeros_like(t)], axis=-1)
    roots, rotations = _pose(rig, rest, trunk, limbs, motion, feet, _flexions(pace, p), travel)
    return made_clip(rig, pace.name, roots, rotations, feet, fps)


def _feet(
    rig: Rig, rest: RestShape, pace: _Pace, stride: float, size: float, p: Array, ease: float
) -> tuple[FootPath, ...]:
    """The paws' paths: each goes about as far ahead of its hip joint as behind it."""
    paths = []
    for leg, strike in zip(rig.legs, pace.strikes, strict=True):
        hip = rest.span(rig.hips, leg.hip)
        roll = Roll(
            duty=pace.duty,
            heel_end=0.0,
            ball_start=pace.duty * pace.ball_start,
            strike=0.0,
            off=math.radians(pace.off),
            stride=stride,
            clearance=0.02 * size,
            tuck=pace.tuck * size,
            tuck_pitch=math.radians(20.0),
            toe_out=0.0,
            side=float(hip[1]) * pace.narrow,
        )
        path = rolling_foot(foot_shape(rig, leg), roll, p - strike, ease)
        ahead = float(hip[0]) + stride * (0.5 * pace.duty - _SWUNG_FARTHER)
        paths.append(replace(path, ankle=path.ankle + np.array([ahead, 0.0, 0.0])))
    return tuple(paths)


def _trunk_motion(pace: _Pace, size: float, p: Array) -> TrunkMotion:
    """How the trunk moves at times p (n,); its height is about 0."""
    once = 2.0 * np.pi * p
    load = once - np.pi * pace.duty  # 0 in the middle of the left hind leg's contact
    if pace.strikes[_HIND] != 0.0:
        load = load - 2.0 * np.pi * pace.strikes[_HIND]
    twice = 2.0 * load
    zero = np.zeros_like(p)
    bend = np.radians(pace.yaw) * np.sin(load)
    nod = np.radians(pace.pitch) * np.sin(twice)
    roll = np.radians(pace.roll) * np.cos(load)
    return TrunkMotion(
        place=size * np.stack([zero, pace.sway * np.cos(load), -pace.bob * np.cos(twice)], axis=-1),
        trunk=np.stack([zero, nod, 0.5 * roll], axis=-1),
        chest=np.stack([-bend, nod, 0.3 * roll], axis=-1),
        rump=np.stack([bend, nod, roll], axis=-1),
        head=np.stack([zero, -1.5 * nod, zero], axis=-1),
        tail=np.stack([2.5 * bend, 2.0 * nod, zero], axis=-1),
    )


def _flexions(pace: _Pace, p: Array) -> list[Array]:
    """How far the wrist of each leg is bent (n,), rad: in the swing alone."""
    out = []
    for strike in pace.strikes:
        t = p - strike - np.floor(p - strike)
        swing = np.clip((t - pace.duty) / (1.0 - pace.duty), 0.0, 1.0)
        out.append(math.radians(pace.flex) * bump(swing, early=0.3))
    return out


def _highest(
    rest: RestShape,
    limbs: list[Limb],
    trunk: Trunk,
    motion: TrunkMotion,
    feet: tuple[FootPath, ...],
) -> float:
    """The trunk's height: as in the rest pose, or where every paw can just be reached."""
    lowest_paw = min(rest.positions[limb.leg.ankle][2] - limb.leg.sole.height for limb in limbs)
    best = float(rest.positions[trunk.root][2]) - lowest_paw
    for hip, limb, foot in zip(hip_places(rest, trunk, limbs, motion), limbs, feet, strict=True):
        gap = foot.ankle - hip
        room = (_REACH * limb.length) ** 2 - gap[:, 0] ** 2 - gap[:, 1] ** 2
        if room.min() < 0.0:
            raise FootIKError(
                f"a paw of leg {limb.leg.name!r} would be {math.sqrt(-room.min()):.3g} m out of "
                "its reach; ask for a lower speed."
            )
        best = min(best, float(np.min(gap[:, 2] + np.sqrt(room))))
    return best


def _pose(
    rig: Rig,
    rest: RestShape,
    trunk: Trunk,
    limbs: list[Limb],
    motion: TrunkMotion,
    feet: tuple[FootPath, ...],
    flexions: list[Array],
    travel: Array,
) -> tuple[Array, Array]:
    """Root positions (n, 3) and local rotations (n, J, 4) in the model frame."""
    turns = trunk_turns(trunk, motion)
    wanted = {joint: qa.mul(turn, rest.rotations[joint]) for joint, turn in turns.items()}
    hips = hip_places(rest, trunk, limbs, motion)
    for limb, hip, foot, flex in zip(limbs, hips, feet, flexions, strict=True):
        wanted.update(pose_limb(rest, limb, hip, foot, flex))
    place = motion.place + np.concatenate([travel, np.zeros((len(travel), 1))], axis=1)
    root = place - (rest.span(0, trunk.root) if trunk.root else np.zeros(3))
    if trunk.root:
        wanted[0] = np.broadcast_to(rest.rotations[0], (len(root), 4))
    wanted = {joint: qa.mul(rest.facing, rotation) for joint, rotation in wanted.items()}
    return qa.rotate(rest.facing, root), local_rotations(rig.skeleton, wanted, len(root))
