"""How the body rides on its feet: hips, torso and arms over a cycle, and how high the hips may be.

Frame: x the way of travel, y left, z up, of the root's own heading; time in cycles, left strike 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from footik_runtime.errors import FootIKError
from footik_runtime.gait_feet import FootPath, Roll
from footik_runtime.gait_poses import BodyMotion, RestShape, hip_joints
from footik_runtime.rig import Rig

Array = NDArray[np.float64]

MODEL_LEG = 0.9  # m; settings are for an adult's leg of this length
REACH = 0.985  # share of the leg's length that may be used, so that knees never lock


@dataclass(frozen=True, kw_only=True)
class BodyStyle:
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


def follow(style: BodyStyle, roll: Roll, rest: RestShape, p: Array) -> BodyMotion:
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


def best_place(
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


def lowered(
    rig: Rig, rest: RestShape, motion: BodyMotion, feet: tuple[FootPath, ...]
) -> BodyMotion:
    """The same with the hips at the height where the legs just reach."""
    height = _highest(rig, rest, motion, feet, 0.0)
    if not math.isfinite(height):
        raise FootIKError(f"the feet are out of reach of legs of {rest.leg_length:.3g} m.")
    return replace(motion, pelvis=motion.pelvis + np.array([0.0, 0.0, height]))


def stance_sides(rig: Rig, rest: RestShape, half: float) -> list[float]:
    """Each ankle's place to the left of the hips joint, `half` apart for MODEL_LEG, m."""
    spans = [rest.span(rig.hips, leg.hip)[1] for leg in rig.legs]
    middle = 0.5 * (spans[0] + spans[1])
    aside = [max(half * rest.leg_length / MODEL_LEG, 0.8 * leg.sole.half_width) for leg in rig.legs]
    return [middle + aside[0], middle - aside[1]]


def standing_ahead(rig: Rig, rest: RestShape) -> float:
    """Where a standing ankle belongs ahead of the hips joint: under the hip joints, m."""
    return float(np.mean([rest.span(rig.hips, leg.hip)[0] for leg in rig.legs]))
