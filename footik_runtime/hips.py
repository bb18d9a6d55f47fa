"""Hips: lowered so that every foot on the ground, or soon on it, can reach its print."""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.feet.footprint import planted, print_of, to_world
from footik_runtime.feet.record import GROUNDED, ON_HEEL, PLANNED, TOES_DOWN
from footik_runtime.inertia import damped_spring, smooth_step, spring
from footik_runtime.leg_ik import shortfall
from footik_runtime.legs import lifted, usable
from footik_runtime.locomotion import ahead_of
from footik_runtime.math3d import add, clamp, get3, get4, norm, sub

_DEEP = 0.7  # part of the hips' largest drop from which a foot lands on its ball instead
_MOST_SWAY = 0.15  # m that the hips go sideways at most
_EARLY = 1.5  # the spring lags: the whole drop is asked for after 2/3 of the look-ahead


@compiled
def wanted_drop(body, foot, told, leg, hip, shift, timing, settings, bodies_at, bodies_turn):
    """How far the hips must drop for one foot, m, times how much that foot counts.

    `hip` (3,) is the leg's animated hip joint now, `shift` (3,) where the body's lean takes it;
    `timing` of the motion says where it is at the next plant, and how far the animated leg is
    extended then. A foot on the ground counts as it is, and as its leg will be stretched when
    the contact ends; one that swings counts more and more as its plant comes near. One that
    found no ground never counts.
    """
    drop = 0.0
    if foot["state"] == GROUNDED:
        drop = held_drop(
            body, foot, told, leg, hip, shift, timing, settings, bodies_at, bodies_turn
        )
    ahead = settings["hip_look_ahead"]
    if told["ahead"] and foot["plan"] == PLANNED and 0.0 < told["to_plant"] < ahead:
        land, turn = to_world(
            foot["land_body"], get3(foot["land"]), get4(foot["land_turn"]), bodies_at, bodies_turn
        )
        share = smooth_step(_EARLY * (1.0 - told["to_plant"] / ahead))
        next_hip = add(shift, ahead_of(body, get3(timing["hip"]), told["to_plant"]))
        reach = usable(leg, timing["extension"], settings)
        ankle, _ = planted(land, turn, told["pitch"], leg)
        needed = shortfall(next_hip, ankle, reach)
        if foot["state"] != GROUNDED and needed > _DEEP * settings["max_stride_drop"]:
            foot["landing"] = TOES_DOWN
        if foot["landing"] != ON_HEEL:
            ankle, turn = planted(land, turn, 0.0, leg)
            first = settings["heel_first"]
            ankle, _, _ = lifted(leg, next_hip, ankle, turn, reach, first, settings)
            needed = shortfall(next_hip, ankle, reach)
        drop = max(drop, min(share * needed, settings["max_stride_drop"]))
    return drop


@compiled
def held_drop(body, foot, told, leg, hip, shift, timing, settings, bodies_at, bodies_turn):
    """How far the hips must drop for a foot on the ground, now and by the end of its contact.

    Of a foot that will leave the heel lifts before the hips must sink; one that stays stands flat.
    """
    reach = usable(leg, norm(sub(get3(told["ankle"]), hip)), settings)
    hip = add(hip, shift)
    goal, turn, first = get3(foot["goal"]), get4(foot["goal_turn"]), settings["heel_first"]
    share, left, ahead = foot["weight"], told["to_release"], settings["hip_look_ahead"]
    if foot["bump"] or told["ahead"] == 0 or not math.isfinite(left):
        return (1.0 if foot["bump"] else share) * shortfall(hip, goal, reach)
    goal, _, _ = lifted(leg, hip, goal, turn, reach, first * foot["heel_lift"], settings)
    drop = min(share * shortfall(hip, goal, reach), settings["max_stride_drop"])
    if told["to_plant"] > 0.0 or left >= ahead:
        return drop
    hip = add(shift, ahead_of(body, get3(timing["off_hip"]), left))
    reach = usable(leg, timing["off_extension"], settings)
    point, turn = print_of(foot, bodies_at, bodies_turn)
    goal, turn = planted(point, turn, min(timing["off_pitch"], 0.0), leg)
    goal, _, _ = lifted(leg, hip, goal, turn, reach, first, settings)
    share = smooth_step(_EARLY * (1.0 - left / ahead))
    return max(drop, min(share * shortfall(hip, goal, reach), settings["max_stride_drop"]))


@compiled
def wanted_raise(foot, leg, hip, settings):
    """How far the hips must rise so that a leg on the ground is not shorter than it may be, m."""
    if foot["state"] != GROUNDED:
        return 0.0
    goal = get3(foot["goal"])
    dx, dy = goal[0] - hip[0], goal[1] - hip[1]
    least = settings["min_leg"] * leg["length"]
    upright = math.sqrt(max(least * least - dx * dx - dy * dy, 0.0))
    return foot["weight"] * max(goal[2] + upright - hip[2], 0.0)


@compiled
def move_hips(body, wanted, dt, settings):
    """Follow the wanted drop (m, below 0 a rise) by a spring; kept in the body's record.

    Down in time for the foot, up again at leisure: so on stairs the hips do not bounce.
    """
    lowest, highest = settings["max_hip_drop"], -settings["max_hip_raise"]
    target = clamp(wanted, highest, lowest) if body["hips"] and settings["hips"] else 0.0
    half_life = settings["hip_half_life"]
    if target < body["hip_drop"]:
        half_life = settings["hip_rise_half_life"]
    before, speed = body["hip_drop"], body["hip_speed"]
    half_life = 0.0 if body["fresh"] else half_life
    drop, speed = damped_spring(before, speed, target, half_life, settings["hip_damping"], dt)
    if body["fresh"] == 0:
        most = settings["max_hip_speed"]
        drop, speed = clamp(drop, before - most * dt, before + most * dt), clamp(speed, -most, most)
    within = clamp(drop, highest, lowest)
    body["hip_drop"], body["hip_speed"] = within, speed if within == drop else 0.0
    body["fresh"] = 0


@compiled
def sway_hips(body, x, y, dt, settings):
    """Follow the support sideways: (x, y) m, world, is how far it is from the animation's."""
    share = settings["hip_balance"] if body["hips"] and settings["hips"] else 0.0
    far = math.sqrt(x * x + y * y)
    most = _MOST_SWAY * settings["size"]
    share *= min(1.0, most / max(far, 1e-9))
    for k in range(2):
        value, speed = spring(
            body["sway"][k], body["sway_speed"][k], share * (x if k == 0 else y),
            settings["hip_rise_half_life"], dt,
        )  # fmt: skip
        body["sway"][k], body["sway_speed"][k] = value, speed
