"""The swing: the animation, carried over the line from where a foot lifts to where it lands."""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.feet.carry import carry_over
from footik_runtime.feet.footprint import UP, to_world
from footik_runtime.feet.record import PLANNED
from footik_runtime.inertia import smooth_bump, smooth_step
from footik_runtime.math3d import (
    add_scaled,
    clamp,
    get3,
    get4,
    quat_between,
    quat_mul,
    quat_nlerp,
    rotate,
    scale,
    sub,
)

_SPOT = 0.1  # m; a swing that goes no further is told by time, from twice that on by place


@compiled
def swing_progress(foot, told, settings):
    """How far the swing is from lift to landing: 0 to 1, eased."""
    if told["ahead"]:
        return 0.0 if foot["spent"] else told["progress"]
    return min(foot["air_age"] / max(settings["release_time"], 1e-3), 1.0)


@compiled
def progress_along(lift, land, ankle, otherwise, settings):
    """How far an ankle is from lift to landing, seen from above: 0 to 1; `otherwise` on a spot."""
    x, y = land[0] - lift[0], land[1] - lift[1]
    length2 = x * x + y * y
    far = clamp(math.sqrt(length2) / (_SPOT * settings["size"]) - 1.0, 0.0, 1.0)
    if far == 0.0:
        return otherwise
    along = clamp(((ankle[0] - lift[0]) * x + (ankle[1] - lift[1]) * y) / length2, 0.0, 1.0)
    return otherwise + (along - otherwise) * far


@compiled
def swinging(foot, ankle, turn, root_z, progress, settings, bodies_at, bodies_turn):
    """Ankle and sole rotation of a swinging foot: the animation over the line lift to landing."""
    s = smooth_step(progress)
    lift = get3(foot["lift"])
    land, land_turn = (ankle[0], ankle[1], root_z), (1.0, 0.0, 0.0, 0.0)
    if foot["plan"] == PLANNED:
        land, land_turn = to_world(
            foot["land_body"], get3(foot["land"]), get4(foot["land_turn"]), bodies_at, bodies_turn
        )
        shift = foot["plan_shift"]
        ankle = (ankle[0] + shift[0] * s, ankle[1] + shift[1] * s, ankle[2])
        s = progress_along(lift, land, ankle, s, settings)
    z = lift[2] * (1.0 - s) + land[2] * s + foot["arch"] * smooth_bump(progress)
    tilt = quat_nlerp(
        quat_between(UP, rotate(get4(foot["lift_turn"]), UP)),
        quat_between(UP, rotate(land_turn, UP)),
        s,
    )
    return (ankle[0], ankle[1], ankle[2] - root_z + z), quat_mul(tilt, turn)


@compiled
def follow_swing(foot, told, dt, settings, bodies_at, bodies_turn):
    """Carry over to the swing as it is now defined, from wherever the foot was last frame."""
    progress = swing_progress(foot, told, settings)
    now, _ = swinging(
        foot, get3(told["ankle"]), get4(told["turn"]), told["root_z"], progress, settings,
        bodies_at, bodies_turn,
    )  # fmt: skip
    if told["ahead"] and told["to_plant"] > 0.0:
        # After the plant it has come to its end, and has stayed there.
        progress = max(progress - dt / max(told["swing_time"], 1e-3), 0.0)
    base, base_turn = swinging(
        foot, get3(foot["anim"]), get4(foot["anim_turn"]), foot["root_z"], progress, settings,
        bodies_at, bodies_turn,
    )  # fmt: skip
    rate = 1.0 / dt if dt > 0.0 else 0.0
    speed = scale(sub(now, base), rate)
    start, start_speed, age = get3(foot["out"]), get3(foot["out_speed"]), dt
    if told["ahead"] and foot["air_age"] == 0.0 and foot["spent"] == 0:
        # It was free since the contact's end, not since the frame before: so any rate agrees.
        age = clamp(told["swing_time"] - told["to_plant"], 0.0, dt)
        base = add_scaled(now, speed, -age)
        start_speed = scale(get3(foot["rolled"]), rate)
        start = add_scaled(start, start_speed, dt - age)
    duration = settings["release_time"]
    if told["ahead"] and told["to_plant"] > 0.0:
        duration = min(duration, 0.8 * told["to_plant"])
    carry_over(foot, start, sub(start_speed, speed), base, base_turn, duration, age, settings)
