"""OpenKCC's foot target: its settings, what a foot remembers, and the steps it can take.

A foot is released or grounded. Grounding it starts a stride: a bump travels to the new target on an
arc, and any other stride jumps there and lets the weight travel. All is in world space; rotations
are those of the sole: x forward, z along the ground's normal.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from footik_runtime.compiled import compiled
from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.math3d import (
    add_scaled,
    cross,
    get3,
    get4,
    lerp,
    norm,
    quat_between,
    quat_from_basis,
    quat_nlerp,
    scale,
    set3,
    set4,
)
from footik_runtime.smoothing import clamp_through, ease, smooth_damp, smooth_damp3

RELEASED, GROUNDED = 0, 1
NO_FLOOR = -1

GROUNDED_WEIGHT = 0.95
RELEASED_WEIGHT = 0.05
LOCKED_END = 0.15  # in this last part of a bump its target may no longer move

OPENKCC_SETTINGS = np.dtype(
    [
        ("ground_check_distance", "f8"),  # m, from knee height down
        ("step_height", "f8"),  # m, of a bump's arc
        ("stride_threshold_distance", "f8"),  # m, horizontal, beyond which a foot lets go
        ("stride_threshold_angle", "f8"),  # rad, beyond which it bumps
        ("stride_time", "f8"),  # s, of a bump, and the weights' smooth time
        ("foot_grounded_height", "f8"),  # m, of the ankle over the ground
        ("max_hip_foot_distance", "f8"),  # m, vertical, beyond which the hips lower
        ("max_hip_offset", "f8"),  # m, how far they may
        ("hip_smooth_time", "f8"),  # s
        ("overlap_blend_time", "f8"),  # s, to blend in the correction of a foot in an obstacle
        ("correct_for_overlap", "i4"),  # 0: no overlap rays
    ],
    align=True,
)
OPENKCC_FOOT = np.dtype(
    [
        ("state", "i4"),  # RELEASED or GROUNDED
        ("bump", "i4"),  # the last stride was a bump; a release keeps it
        ("floor", "i4"),  # geom id, or NO_FLOOR
        ("weight", "f8"),
        ("weight_velocity", "f8"),
        ("stride_start", "f8"),  # s, -inf before the first stride
        ("target_position", "f8", 3),  # on the ground
        ("target_rotation", "f8", 4),
        ("from_position", "f8", 3),  # the target before this stride
        ("from_rotation", "f8", 4),
        ("velocity", "f8", 3),  # of the target, while it is updated in a bump
        ("forward", "f8", 3),  # the hips' forward on the ground, not normalised
        ("normal", "f8", 3),
        ("overlap_time", "f8"),  # s, how far the overlap correction is blended in
        ("overlap_position", "f8", 3),
    ],
    align=True,
)
_DEFAULTS = {
    "ground_check_distance": 1.5,
    "step_height": 0.1,
    "stride_threshold_distance": 0.75,
    "stride_threshold_angle": math.radians(45.0),
    "stride_time": 0.25,
    "foot_grounded_height": 0.05,
    "max_hip_foot_distance": 0.85,
    "max_hip_offset": 0.45,
    "hip_smooth_time": 0.35,
    "overlap_blend_time": 0.05,
    "correct_for_overlap": 1,
}


def openkcc_settings(**changes: float) -> NDArray[np.void]:
    """(1,) OPENKCC_SETTINGS: OpenKCC's defaults with these fields changed.

    Raises FootIKError for an unknown name, and for a value that is negative or not finite.
    """
    settings = np.zeros(1, OPENKCC_SETTINGS)
    for name, value in {**_DEFAULTS, **changes}.items():
        if name not in _DEFAULTS:
            raise unknown_name("OpenKCC setting", name, _DEFAULTS)
        if not (np.isfinite(value) and value >= 0.0):
            raise FootIKError(f"OpenKCC setting {name} must be finite and >= 0, not {value}.")
        settings[name] = value
    return settings


def new_feet(shape: tuple[int, ...]) -> NDArray[np.void]:
    """Foot records of this shape, (rows, feet): released, no weight, no ground, never strode."""
    feet = np.zeros(shape, OPENKCC_FOOT)
    feet["floor"] = NO_FLOOR
    feet["stride_start"] = -np.inf
    feet["target_rotation"][..., 0] = 1.0
    feet["from_rotation"][..., 0] = 1.0
    return feet


@compiled
def look(forward, up):
    """Rotation that takes +x along forward and +z as near to up as it can.

    The identity where forward is zero; the shortest arc from +x where up is zero or parallel to it.
    """
    length = norm(forward)
    if length < 1e-6:  # what float32 leaves of a projection that is zero
        return (1.0, 0.0, 0.0, 0.0)
    x = scale(forward, 1.0 / length)
    y = cross(up, x)
    width = norm(y)
    if width <= 1e-6 * norm(up):
        return quat_between((1.0, 0.0, 0.0), x)
    y = scale(y, 1.0 / width)
    return quat_from_basis(x, y, cross(x, y))


# The foot target: what a foot remembers, and the questions asked of it.


@compiled
def remaining(foot, settings, now):
    """Seconds left of a bump, negative once it is over; 0 where the stride is not a bump."""
    if foot["bump"] == 0:
        return 0.0
    return foot["stride_start"] + settings["stride_time"] - now


@compiled
def mid_stride(foot, settings, now):
    """True while the foot is on its way: bumping, or its weight still settling."""
    if foot["state"] == RELEASED:
        return foot["weight"] >= RELEASED_WEIGHT
    if foot["bump"] != 0:
        return remaining(foot, settings, now) > 0.0
    return foot["weight"] <= GROUNDED_WEIGHT


@compiled
def can_update_target(foot, settings, now):
    """True while the target may still move."""
    if foot["state"] == RELEASED:
        return foot["weight"] <= RELEASED_WEIGHT
    if foot["bump"] != 0:
        return remaining(foot, settings, now) > LOCKED_END * settings["stride_time"]
    return False


@compiled
def bump_progress(foot, settings, now):
    """How far a bump is, 0 to 1; 1 where there is none."""
    left = remaining(foot, settings, now)
    if left <= 0.0:
        return 1.0
    return 1.0 - clamp_through(left / settings["stride_time"], 0.0, 1.0)


@compiled
def ik_position(foot, settings, now):
    """Where the target wants the ankle: over the target, or on a bump's arc towards it."""
    target = get3(foot["target_position"])
    if remaining(foot, settings, now) > 0.0:
        f = bump_progress(foot, settings, now)
        x, y, z = lerp(get3(foot["from_position"]), target, ease(f))
        target = (x, y, z + settings["step_height"] * math.sin(math.pi * f))
    return add_scaled(target, get3(foot["normal"]), settings["foot_grounded_height"])


@compiled
def ik_rotation(foot, settings, now):
    """How the target wants the sole turned."""
    target = get4(foot["target_rotation"])
    if remaining(foot, settings, now) <= 0.0:
        return target
    return quat_nlerp(get4(foot["from_rotation"]), target, ease(bump_progress(foot, settings, now)))


@compiled
def smooth_weight(foot, settings, dt):
    """Let the weight follow the state."""
    goal = 1.0 if foot["state"] == GROUNDED else 0.0
    weight, velocity = smooth_damp(
        foot["weight"], goal, foot["weight_velocity"], settings["stride_time"], dt
    )
    foot["weight"] = clamp_through(weight, 0.0, 1.0)
    foot["weight_velocity"] = velocity


@compiled
def start_stride(foot, now, position, rotation, floor, forward, normal, bump):
    """Ground the foot on a new target; a bump travels there, else only the weight does."""
    set3(foot["from_position"], get3(foot["target_position"]))
    set4(foot["from_rotation"], get4(foot["target_rotation"]))
    set3(foot["target_position"], position)
    set4(foot["target_rotation"], rotation)
    set3(foot["forward"], forward)
    set3(foot["normal"], normal)
    foot["floor"] = floor
    foot["bump"] = bump
    foot["state"] = GROUNDED
    foot["stride_start"] = now


@compiled
def update_target(foot, settings, position, rotation, normal, dt):
    """Let the target follow a place smoothly; its normal and rotation are taken at once."""
    target, velocity = smooth_damp3(
        get3(foot["target_position"]),
        position,
        get3(foot["velocity"]),
        settings["stride_time"],
        dt,
    )
    set3(foot["target_position"], target)
    set3(foot["velocity"], velocity)
    set4(foot["target_rotation"], rotation)
    set3(foot["normal"], normal)


@compiled
def force_target(foot, position, rotation, normal):
    """Put the target in a place exactly, at rest."""
    set3(foot["target_position"], position)
    set3(foot["velocity"], (0.0, 0.0, 0.0))
    set4(foot["target_rotation"], rotation)
    set3(foot["normal"], normal)


@compiled
def release(foot):
    """Let go of the ground."""
    foot["state"] = RELEASED
    foot["floor"] = NO_FLOOR
