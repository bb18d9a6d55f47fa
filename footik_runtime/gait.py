"""The built-in motion: idle, walk, run and turn in place, made from formulas, for any biped rig.

Each returns a looping `Clip` of one whole cycle on flat ground at z = 0, facing `rig.forward`; its
last frame is the first one a cycle later. Contacts are exact, and known by two curves a leg (see
`phases`). Lengths scale with the leg and times with its square root, as in pendulums, so a child
and a giant at the same Froude number v² / (g leg) move alike (Alexander 1976).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.gait_feet import (
    FootPath,
    Roll,
    foot_shape,
    rolling_foot,
    standing_foot,
    stepping_foot,
)
from footik_runtime.gait_poses import (
    Body,
    BodyMotion,
    RestShape,
    find_body,
    hip_joints,
    pose_body,
    rest_shape,
)
from footik_runtime.phases import phase_curve, weight_curve
from footik_runtime.rig import Rig

Array = NDArray[np.float64]

MODEL_LEG = 0.9  # m; settings below are for an adult's leg of this length
REACH = 0.98  # share of the leg's length that may be used, so that knees never lock
EASE = 0.04  # s, rise and fall of the IK weights
WALK_SPEEDS = (0.3, 2.2)  # m/s for MODEL_LEG
RUN_SPEEDS = (1.6, 5.5)
TURN_RATES = (5.0, 180.0)  # degrees a second, either way

_GRAVITY = 9.81


@dataclass(frozen=True, kw_only=True)
class _Style:
    """How the body follows the feet: lengths for MODEL_LEG in m, angles in degrees.

    Each is half the whole swing of its oscillation; `rise` is positive where the body is lowest
    in mid double support (or highest in mid-flight where `rise` is negative).
    """

    rise: float
    surge: float
    sway: float
    pelvis_yaw: float
    pelvis_list: float
    pelvis_tilt: float
    chest_yaw: float
    lean: float
    arm: float
    arm_back: float
    elbow: float
    elbow_swing: float


def walk(rig: Rig, *, speed: float = 1.3, fps: float = 60.0, body: Body | None = None) -> Clip:
    """One cycle of walking at `speed` m/s, 0.3 to 2.2 for a leg of 0.9 m.

    Stride length is 1.346 sqrt(speed) and double support .252 T - .143 s, both for lengths in legs
    (Boulic, Magnenat-Thalmann and Thalmann 1990, after Inman): cadence grows as speed^.5, near
    the ^.42 to ^.57 of Grieve and Gear 1966. The hips rise by about half of what a stiff-legged
    inverted pendulum would. `body` names the upper body; it is found by topology where None.

    Raises:
        FootIKError: for a speed out of range, a bad rate, or a rig without two legs.
    """
    rest = rest_shape(rig)
    size = rest.leg_length / MODEL_LEG
    speed = _checked("walking speed", speed, WALK_SPEEDS, size)
    pace = speed / math.sqrt(size)  # the same walk on a leg of MODEL_LEG
    stride = 1.346 * math.sqrt(pace / MODEL_LEG) * MODEL_LEG
    frames, period = _cycle(stride / pace * math.sqrt(size), fps)
    model_period = period / math.sqrt(size)
    duty = 0.752 - 0.143 / model_period
    quick = pace / 1.3
    half_step = 0.25 * pace * model_period
    pendulum = MODEL_LEG - math.sqrt(max(MODEL_LEG**2 - half_step**2, 0.0))
    roll = Roll(
        duty=duty,
        heel_end=duty * 0.15,
        ball_start=duty * (0.70 - 0.07 * quick),
        strike=math.radians(9.0 + 11.0 * quick),
        off=math.radians(24.0 + 26.0 * quick),
        stride=speed * period,
        clearance=0.025 * size,
        tuck=0.0,
        tuck_pitch=math.radians(4.0 * quick),
        toe_out=math.radians(6.0),
        side=0.055 * size,
    )
    style = _Style(
        rise=0.26 * pendulum,
        surge=0.008 * quick,
        sway=0.030 - 0.009 * quick,
        pelvis_yaw=5.0 * quick,
        pelvis_list=2.0 + 2.0 * quick,
        pelvis_tilt=1.0,
        chest_yaw=5.0 * quick,
        lean=1.0 + 1.5 * quick,
        arm=20.0 * quick**0.8,
        arm_back=3.0,
        elbow=16.0 + 6.0 * quick,
        elbow_swing=9.0 * quick,
    )
    return _travel(rig, rest, "walk", roll, style, frames, fps, body)


def run(rig: Rig, *, speed: float = 3.0, fps: float = 60.0, body: Body | None = None) -> Clip:
    """One cycle of running at `speed` m/s, 1.6 to 5.5 for a leg of 0.9 m, with two flights.

    Stride length is 2.3 legs * Froude^.3 (Alexander 1976, Nature 261); contact lasts .35 of the
    cycle at 3 m/s and less when faster; the top of the bounce is free fall.

    Raises:
        FootIKError: for a speed out of range, a bad rate, or a rig without two legs.
    """
    rest = rest_shape(rig)
    size = rest.leg_length / MODEL_LEG
    speed = _checked("running speed", speed, RUN_SPEEDS, size)
    pace = speed / math.sqrt(size)
    stride = 2.3 * MODEL_LEG * (pace * pace / (_GRAVITY * MODEL_LEG)) ** 0.3
    frames, period = _cycle(stride / pace * math.sqrt(size), fps)
    model_period = period / math.sqrt(size)
    quick = pace / 3.0
    duty = min(0.35 * quick**-0.4, 0.44)
    roll = Roll(
        duty=duty,
        heel_end=duty * 0.2,
        ball_start=duty * 0.45,
        strike=math.radians(9.0),
        off=math.radians(46.0 + 8.0 * quick),
        stride=speed * period,
        clearance=0.05 * size,
        tuck=0.17 * quick * size,
        tuck_pitch=math.radians(38.0 * quick),
        toe_out=math.radians(4.0),
        side=0.035 * size,
    )
    style = _Style(
        rise=-0.95 * _GRAVITY * (model_period / (4.0 * math.pi)) ** 2,
        surge=0.004,
        sway=0.010,
        pelvis_yaw=6.0,
        pelvis_list=4.0,
        pelvis_tilt=2.0,
        chest_yaw=10.0,
        lean=4.0 + 4.0 * quick,
        arm=30.0 * quick**0.5,
        arm_back=12.0,
        elbow=82.0,
        elbow_swing=12.0,
    )
    return _travel(rig, rest, "run", roll, style, frames, fps, body)


def turn_in_place(
    rig: Rig, *, rate_deg: float = 90.0, fps: float = 60.0, body: Body | None = None
) -> Clip:
    """One cycle (two small steps) of turning on the spot at `rate_deg` a second, left positive.

    The root turns evenly; each foot stands still, then steps round, one at a time.

    Raises:
        FootIKError: for a rate out of 5 to 180 degrees a second either way, or a bad rig.
    """
    rest = rest_shape(rig)
    size = rest.leg_length / MODEL_LEG
    fastest = TURN_RATES[1]
    if not (math.isfinite(rate_deg) and TURN_RATES[0] <= abs(rate_deg) <= fastest):
        raise FootIKError(
            f"rate_deg must be {TURN_RATES[0]:g} to {fastest:g} degrees a second either way, "
            f"not {rate_deg:g}."
        )
    seconds = float(np.clip(60.0 / abs(rate_deg), 0.6, 1.2)) * math.sqrt(size)
    frames, period = _cycle(seconds, fps)
    turn = math.radians(rate_deg) * period
    t = np.arange(frames + 1) / frames
    p = np.append(t[:-1], 0.0)
    duty, sides, x, toe_out = 0.66, _stance_width(rig, rest, 0.08), _foot_x(rig, rest), 6.0
    # The foot on the inside of the turn steps first, so that the toes never meet.
    offsets = (0.0, 0.5) if rate_deg > 0 else (0.5, 0.0)
    feet = tuple(
        stepping_foot(
            p - offset,
            duty=duty,
            turn=turn,
            place=(x, side),
            toe_out=math.copysign(math.radians(toe_out), side),
            height=leg.sole.height,
            lift=0.05 * size,
            ease=EASE / period,
        )
        for leg, side, offset in zip(rig.legs, sides, offsets, strict=True)
    )
    shift = np.cos(2.0 * np.pi * (p - offsets[0] - 0.5 * duty))
    zero = np.zeros_like(p)
    ahead = math.radians(8.0) * math.copysign(min(abs(rate_deg) / 90.0, 1.0), rate_deg)
    motion = BodyMotion(
        travel=np.zeros((len(p), 2)),
        heading=turn * t,
        pelvis=np.stack([zero, 0.022 * size * shift, zero], axis=-1),
        pelvis_turn=np.radians(np.stack([zero, zero, 1.5 * shift], axis=-1)),
        chest_turn=np.stack([zero + 0.5 * ahead, zero, np.radians(-0.5 * shift)], axis=-1),
        head_turn=np.stack([zero + 2.0 * ahead, zero, zero], axis=-1),
        arm_swing=np.radians(np.stack([2.0 - 5.0 * shift, 2.0 + 5.0 * shift], axis=-1)),
        elbow=np.radians(np.stack([18.0 + 3.0 * shift, 18.0 - 3.0 * shift], axis=-1)),
        arm_out=math.radians(9.0),
    )
    motion = _lowered(rig, rest, motion, feet)
    return _clip(rig, body, "turn_in_place", motion, feet, fps)


def idle(rig: Rig, *, seconds: float = 6.0, fps: float = 60.0, body: Body | None = None) -> Clip:
    """Standing for `seconds`: the weight shifts, the chest breathes, the feet do not move at all.

    Raises:
        FootIKError: for less than 1 second, a bad rate, or a rig without two legs.
    """
    rest = rest_shape(rig)
    size = rest.leg_length / MODEL_LEG
    if not (math.isfinite(seconds) and seconds >= 1.0):
        raise FootIKError(f"seconds must be at least 1 and finite, not {seconds:g}.")
    frames, _ = _cycle(seconds, fps)
    p = np.append(np.arange(frames) / frames, 0.0)
    feet = tuple(
        standing_foot(
            len(p),
            place=(_foot_x(rig, rest), side),
            toe_out=math.copysign(math.radians(9.0), side),
            height=leg.sole.height,
        )
        for leg, side in zip(rig.legs, _stance_width(rig, rest, 0.09), strict=True)
    )
    turn = 2.0 * np.pi * p
    shift = np.sin(turn + 0.25 * np.sin(turn))
    breath = np.sin(turn * max(1, round(seconds / 3.5)))
    zero = np.zeros_like(p)
    look = np.sin(turn + 1.0)
    motion = BodyMotion(
        travel=np.zeros((len(p), 2)),
        heading=zero,
        pelvis=np.stack(
            [0.004 * size * np.sin(2 * turn + 0.7), 0.02 * size * shift, 0.001 * size * breath],
            axis=-1,
        ),
        pelvis_turn=np.radians(np.stack([1.5 * look, zero, 1.5 * shift], axis=-1)),
        chest_turn=np.radians(np.stack([-look, 1.0 - 0.9 * breath, -0.8 * shift], axis=-1)),
        head_turn=np.radians(np.stack([3.0 * look, 0.5 * breath, zero], axis=-1)),
        arm_swing=np.radians(np.stack([1.5 + breath, 1.5 + breath], axis=-1)),
        elbow=np.radians(np.stack([16.0 + 1.5 * breath] * 2, axis=-1)),
        arm_out=math.radians(8.0),
    )
    motion = _lowered(rig, rest, motion, feet)
    return _clip(rig, body, "idle", motion, feet, fps)


def _checked(what: str, speed: float, limits: tuple[float, float], size: float) -> float:
    low, high = (limit * math.sqrt(size) for limit in limits)
    if not (math.isfinite(speed) and low <= speed <= high):
        raise FootIKError(
            f"{what} must be {low:.3g} to {high:.3g} m/s for legs of {size * MODEL_LEG:.3g} m, "
            f"not {speed:g}."
        )
    return float(speed)


def _cycle(seconds: float, fps: float) -> tuple[int, float]:
    """An even number of frames (so that both legs step alike) and the seconds they last."""
    if not (math.isfinite(fps) and fps >= 10.0):
        raise FootIKError(f"fps must be at least 10 and finite, not {fps:g}.")
    frames = 2 * max(2, round(0.5 * seconds * fps))
    return frames, frames / fps


def _travel(
    rig: Rig,
    rest: RestShape,
    name: str,
    roll: Roll,
    style: _Style,
    frames: int,
    fps: float,
    body: Body | None,
) -> Clip:
    """The clip of a walk or a run, its feet and hips placed so that the legs can reach."""
    ease = EASE * fps / frames
    sides = _stance_width(rig, rest, roll.side / rest.leg_length * MODEL_LEG)

    def feet_at(p: Array, ahead: float) -> tuple[FootPath, ...]:
        paths = []
        for leg, side, offset in zip(rig.legs, sides, (0.0, 0.5), strict=True):
            own = replace(roll, side=side, toe_out=math.copysign(roll.toe_out, side))
            path = rolling_foot(foot_shape(rig, leg), own, p - offset, ease)
            paths.append(replace(path, ankle=path.ankle + np.array([ahead, 0.0, 0.0])))
        return tuple(paths)

    dense = np.arange(240) / 240
    shape = _follow(style, roll, rest, dense)
    at_root = feet_at(dense, 0.0)
    ahead, height = _best_place(rig, rest, shape, at_root, roll)
    t = np.arange(frames + 1) / frames
    p = np.append(t[:-1], 0.0)
    motion = _follow(style, roll, rest, p)
    motion = replace(
        motion,
        travel=np.stack([roll.stride * t, np.zeros_like(t)], axis=-1),
        pelvis=motion.pelvis + np.array([0.0, 0.0, height]),
    )
    return _clip(rig, body, name, motion, feet_at(p, ahead), fps)


def _follow(style: _Style, roll: Roll, rest: RestShape, p: Array) -> BodyMotion:
    """How the body moves at times p (n,), for a left strike at 0; the height is about 0."""
    size = rest.leg_length / MODEL_LEG
    between = 0.5 * (roll.duty - 0.5)  # the middle of double support, or of the flight
    once = 2.0 * np.pi * p
    twice = 2.0 * (once - 2.0 * np.pi * between)
    stride = np.cos(once)  # 1 with the left leg ahead
    load = np.cos(once - np.pi * roll.duty)  # 1 with the weight on the left leg
    drop = np.cos(once - np.pi * (roll.duty - 0.12))  # the free side sinks early in its swing
    zero = np.zeros_like(p)

    def turned(yaw: Array, pitch: Array, side: Array) -> Array:
        return np.radians(np.stack([yaw, pitch, side], axis=-1))

    arm = -style.arm_back + style.arm * np.stack([-stride, stride], axis=-1)
    elbow = style.elbow + style.elbow_swing * np.stack([-stride, stride], axis=-1)
    return BodyMotion(
        travel=np.zeros((len(p), 2)),
        heading=zero,
        pelvis=size
        * np.stack(
            [style.surge * np.sin(twice), style.sway * load, -style.rise * np.cos(twice)], axis=-1
        ),
        pelvis_turn=turned(
            -style.pelvis_yaw * stride,
            0.6 * style.lean + style.pelvis_tilt * np.cos(twice),
            style.pelvis_list * drop,
        ),
        chest_turn=turned(
            style.chest_yaw * stride,
            style.lean + 0.8 * np.cos(twice),
            -0.4 * style.pelvis_list * drop,
        ),
        head_turn=turned(zero, 0.2 * style.lean - 0.3 * np.cos(twice), zero),
        arm_swing=np.radians(arm),
        elbow=np.radians(elbow),
        arm_out=math.radians(8.0),
    )


def _best_place(
    rig: Rig, rest: RestShape, motion: BodyMotion, feet: tuple[FootPath, ...], roll: Roll
) -> tuple[float, float]:
    """How far ahead of the root a foot strikes, and the hips' height: where they may be highest."""

    def height(ahead: float) -> float:
        return _highest(rig, rest, motion, feet, ahead)

    # The flat foot may strike anywhere from under the root to as far ahead as contact lasts.
    low, high = 0.0, roll.stride * roll.duty
    ahead = _peak(height, low, high)
    best = height(ahead)
    if not math.isfinite(best):
        raise FootIKError(
            f"a stride of {roll.stride:.3g} m is out of reach for legs of "
            f"{rest.leg_length:.3g} m; ask for a lower speed."
        )
    return ahead, best


def _peak(value: Callable[[float], float], low: float, high: float) -> float:
    """Where a single-peaked function is largest, by narrowing a grid."""
    for _ in range(6):
        grid = np.linspace(low, high, 13)
        best = int(np.argmax([value(float(x)) for x in grid]))
        low, high = grid[max(best - 1, 0)], grid[min(best + 1, 12)]
    return 0.5 * (low + high)


def _highest(
    rig: Rig, rest: RestShape, motion: BodyMotion, feet: tuple[FootPath, ...], ahead: float
) -> float:
    """The most that may be added to the hips' height with every ankle in reach; -inf if nothing."""
    most = math.inf
    hips = hip_joints(rig, rest, motion)
    for hip, foot, length in zip(hips, feet, rig.leg_lengths, strict=True):
        gap = foot.ankle + np.array([ahead, 0.0, 0.0]) - hip
        room = (REACH * length) ** 2 - gap[:, 0] ** 2 - gap[:, 1] ** 2
        if room.min() < 0.0:
            return -math.inf
        most = min(most, float(np.min(gap[:, 2] + np.sqrt(room))))
    return most


def _lowered(
    rig: Rig, rest: RestShape, motion: BodyMotion, feet: tuple[FootPath, ...]
) -> BodyMotion:
    """The same with the hips at the height where the legs just reach."""
    height = _highest(rig, rest, motion, feet, 0.0)
    if not math.isfinite(height):
        raise FootIKError(f"the feet are out of reach of legs of {rest.leg_length:.3g} m.")
    return replace(motion, pelvis=motion.pelvis + np.array([0.0, 0.0, height]))


def _stance_width(rig: Rig, rest: RestShape, half: float) -> list[float]:
    """Each ankle's place to the left of the hips joint, `half` apart for MODEL_LEG, m."""
    spans = [rest.span(rig.hips, leg.hip)[1] for leg in rig.legs]
    middle = 0.5 * (spans[0] + spans[1])
    aside = [max(half * rest.leg_length / MODEL_LEG, 0.8 * leg.sole.half_width) for leg in rig.legs]
    return [middle + aside[0], middle - aside[1]]


def _foot_x(rig: Rig, rest: RestShape) -> float:
    """Where a standing ankle belongs ahead of the hips joint: under the hip joints, m."""
    return float(np.mean([rest.span(rig.hips, leg.hip)[0] for leg in rig.legs]))


def _clip(
    rig: Rig,
    body: Body | None,
    name: str,
    motion: BodyMotion,
    feet: tuple[FootPath, ...],
    fps: float,
) -> Clip:
    roots, rotations = pose_body(rig, body or find_body(rig), motion, feet)
    curves: dict[str, Array] = {}
    for leg, foot in zip(rig.legs, feet, strict=True):
        curves[weight_curve(leg.name)] = foot.weight
        curves[phase_curve(leg.name)] = foot.phase
    return Clip(
        skeleton=rig.skeleton,
        fps=fps,
        root_positions=roots,
        rotations=rotations,
        curves=curves,
        loop=True,
        name=name,
    )
