"""The built-in motion: idle, walk, run and turn in place, made from formulas, for any biped rig.

Each returns a looping `Clip` of one whole cycle on flat ground at z = 0, facing `rig.forward`; its
last frame is the first one a cycle later. Contacts are exact, and known by two curves a leg (see
`phases`). Lengths scale with the leg and times with its square root, as in pendulums, so a child
and a giant at the same Froude number v² / (g leg) move alike (Alexander 1976).
"""

from __future__ import annotations

import math
from dataclasses import replace

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
from footik_runtime.gait_hips import (
    MODEL_LEG,
    BodyStyle,
    best_place,
    follow,
    lowered,
    stance_sides,
    standing_ahead,
)
from footik_runtime.gait_poses import (
    Body,
    BodyMotion,
    RestShape,
    find_body,
    pose_body,
    rest_shape,
)
from footik_runtime.phases import phase_curve, weight_curve
from footik_runtime.rig import Rig

Array = NDArray[np.float64]

EASE = 0.04  # s, rise and fall of the IK weights
WALK_SPEEDS = (0.3, 2.2)  # m/s for MODEL_LEG
RUN_SPEEDS = (1.6, 5.5)
TURN_RATES = (5.0, 180.0)  # degrees a second, either way

_GRAVITY = 9.81


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
    frames, period = cycle_frames(stride / pace * math.sqrt(size), fps)
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
        off=math.radians(70.0 * (1.0 - math.exp(-2.1 * quick))),
        stride=speed * period,
        clearance=0.025 * size,
        tuck=0.0,
        tuck_pitch=0.0,
        toe_out=math.radians(6.0),
        side=0.055 * size,
    )
    style = BodyStyle(
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
    frames, period = cycle_frames(stride / pace * math.sqrt(size), fps)
    model_period = period / math.sqrt(size)
    quick = pace / 3.0
    duty = min(0.35 * quick**-0.4, 0.44)
    roll = Roll(
        duty=duty,
        heel_end=duty * 0.2,
        ball_start=duty * 0.45,
        strike=math.radians(9.0),
        off=math.radians(58.0 + 6.0 * min(quick, 1.5)),
        stride=speed * period,
        clearance=0.05 * size,
        tuck=0.17 * quick * size,
        tuck_pitch=math.radians(18.0 * quick),
        toe_out=math.radians(4.0),
        side=0.035 * size,
    )
    style = BodyStyle(
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
    frames, period = cycle_frames(seconds, fps)
    turn = math.radians(rate_deg) * period
    t = np.arange(frames + 1) / frames
    p = np.append(t[:-1], 0.0)
    duty, sides, x, toe_out = 0.66, stance_sides(rig, rest, 0.08), standing_ahead(rig, rest), 6.0
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
    motion = lowered(rig, rest, motion, feet)
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
    frames, _ = cycle_frames(seconds, fps)
    p = np.append(np.arange(frames) / frames, 0.0)
    feet = tuple(
        standing_foot(
            len(p),
            place=(standing_ahead(rig, rest), side),
            toe_out=math.copysign(math.radians(9.0), side),
            height=leg.sole.height,
        )
        for leg, side in zip(rig.legs, stance_sides(rig, rest, 0.09), strict=True)
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
    motion = lowered(rig, rest, motion, feet)
    return _clip(rig, body, "idle", motion, feet, fps)


def _checked(what: str, speed: float, limits: tuple[float, float], size: float) -> float:
    low, high = (limit * math.sqrt(size) for limit in limits)
    if not (math.isfinite(speed) and low <= speed <= high):
        raise FootIKError(
            f"{what} must be {low:.3g} to {high:.3g} m/s for legs of {size * MODEL_LEG:.3g} m, "
            f"not {speed:g}."
        )
    return float(speed)


def cycle_frames(seconds: float, fps: float) -> tuple[int, float]:
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
    style: BodyStyle,
    frames: int,
    fps: float,
    body: Body | None,
) -> Clip:
    """The clip of a walk or a run, its feet and hips placed so that the legs can reach."""
    ease = EASE * fps / frames
    sides = stance_sides(rig, rest, roll.side / rest.leg_length * MODEL_LEG)

    def feet_at(p: Array, ahead: float) -> tuple[FootPath, ...]:
        paths = []
        for leg, side, offset in zip(rig.legs, sides, (0.0, 0.5), strict=True):
            own = replace(roll, side=side, toe_out=math.copysign(roll.toe_out, side))
            path = rolling_foot(foot_shape(rig, leg), own, p - offset, ease)
            paths.append(replace(path, ankle=path.ankle + np.array([ahead, 0.0, 0.0])))
        return tuple(paths)

    dense = np.arange(240) / 240
    shape = follow(style, roll, rest, dense)
    at_root = feet_at(dense, 0.0)
    ahead, height = best_place(rig, rest, shape, at_root, roll)
    t = np.arange(frames + 1) / frames
    p = np.append(t[:-1], 0.0)
    motion = follow(style, roll, rest, p)
    motion = replace(
        motion,
        travel=np.stack([roll.stride * t, np.zeros_like(t)], axis=-1),
        pelvis=motion.pelvis + np.array([0.0, 0.0, height]),
    )
    return _clip(rig, body, name, motion, feet_at(p, ahead), fps)


def _clip(
    rig: Rig,
    body: Body | None,
    name: str,
    motion: BodyMotion,
    feet: tuple[FootPath, ...],
    fps: float,
) -> Clip:
    roots, rotations = pose_body(rig, body or find_body(rig), motion, feet)
    return made_clip(rig, name, roots, rotations, feet, fps)


def made_clip(
    rig: Rig, name: str, roots: Array, rotations: Array, feet: tuple[FootPath, ...], fps: float
) -> Clip:
    """The looping clip of roots (n, 3) and local rotations (n, J, 4), with its legs' curves."""
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
