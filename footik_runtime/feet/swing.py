"""The swing: the animation, carried over the line from where a foot lifts to where it lands."""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.feet.carry import carry_over
from footik_runtime.feet.clearance import arched, climbed
from footik_runtime.feet.footprint import UP, to_world
from footik_runtime.feet.record import PLANNED
from footik_runtime.inertia import smooth_step
from footik_runtime.math3d import (
    add_scaled,
    clamp,
    get3,
    get4,
    lerp,
    quat_between,
    quat_mul,
    quat_nlerp,
    quat_slerp,
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
def landing(foot, bodies_at, bodies_turn):
    """The planned foothold, in the world."""
    return to_world(
        foot["land_body"], get3(foot["land"]), get4(foot["land_turn"]), bodies_at, bodies_turn
    )


@compiled
def swing_line(foot, land, part):
    """Height of the bent line from lift to landing (3,) at a part of the way."""
    lift = foot["lift"][2]
    up = climbed(part, foot["bend"], land[2] > lift)
    return lift * (1.0 - up) + land[2] * up + foot["arch"] * arched(part)


@compiled
def set_down(
    foot, leg, start, start_turn, base, base_turn, share, progress, settings, bodies_at, bodies_turn
):
    """The foot on its way from the swing's pose to its print's, by a share: ankle and rotation.

    It stays over the swing's line, wherever between the two it is.
    """
    lift, s = get3(foot["lift"]), smooth_step(progress)
    land, _ = landing(foot, bodies_at, bodies_turn)
    place, turn = lerp(start, base, share), quat_slerp(start_turn, base_turn, share)
    # What goes along the line is the place of the sole, not that of the ankle.
    high = (0.0, 0.0, leg["height"])
    before = progress_along(lift, land, sub(start, rotate(start_turn, high)), s, settings)
    # Told by time alone the way ends with the share.
    s += (1.0 - s) * share
    here = progress_along(lift, land, sub(place, rotate(turn, high)), s, settings)
    last = progress_along(lift, land, sub(base, rotate(base_turn, high)), 1.0, settings)
    before, here = swing_line(foot, land, before), swing_line(foot, land, here)
    last = swing_line(foot, land, last)
    over = (start[2] - before) * (1.0 - share) + (base[2] - last) * share
    return (place[0], place[1], here + over), turn


@compiled
def swinging(foot, leg, ankle, turn, root_z, progress, settings, bodies_at, bodies_turn):
    """Ankle and sole rotation of a swinging foot: the animation over the line lift to landing."""
    s = smooth_step(progress)
    land, land_turn = (ankle[0], ankle[1], root_z), (1.0, 0.0, 0.0, 0.0)
    if foot["plan"] == PLANNED:
        land, land_turn = landing(foot, bodies_at, bodies_turn)
        shift = foot["plan_shift"]
        ankle = (ankle[0] + shift[0] * s, ankle[1] + shift[1] * s, ankle[2])
        s = progress_along(get3(foot["lift"]), land, ankle, s, settings)
    z = swing_line(foot, land, s)
    tilt = quat_nlerp(
        quat_between(UP, rotate(get4(foot["lift_turn"]), UP)),
        quat_between(UP, rotate(land_turn, UP)),
        s,
    )
    # The foot tilts about the ground under its ankle, and not about the ankle.
    over = rotate(tilt, (0.0, 0.0, leg["height"]))
    z += over[2] - leg["height"] + ankle[2] - root_z
    return (ankle[0] + over[0], ankle[1] + over[1], z), quat_mul(tilt, turn)


@compiled
def follow_swing(foot, told, leg, dt, settings, bodies_at, bodies_turn):
    """Carry over to the swing as it is now defined, from wherever the foot was last frame."""
    progress = swing_progress(foot, told, settings)
    now, _ = swinging(
        foot, leg, get3(told["ankle"]), get4(told["turn"]), told["root_z"], progress, settings,
        bodies_at, bodies_turn,
    )  # fmt: skip
    if told["ahead"] and told["to_plant"] > 0.0:
        # After the plant it has come to its end, and has stayed there.
        progress = max(progress - dt / max(told["swing_time"], 1e-3), 0.0)
    base, base_turn = swinging(
        foot, leg, get3(foot["anim"]), get4(foot["anim_turn"]), foot["root_z"], progress, settings,
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
