"""Hips: lowered so that every foot on the ground, or soon on it, can reach its print."""

from __future__ import annotations

from footik_runtime.compiled import compiled
from footik_runtime.feet.footprint import planted, to_world
from footik_runtime.feet.record import GROUNDED, PLANNED
from footik_runtime.inertia import smooth_step, spring
from footik_runtime.leg_ik import shortfall
from footik_runtime.legs import usable
from footik_runtime.math3d import add, clamp, get3, get4, norm, sub

_EARLY = 1.5  # the spring lags: the whole drop is asked for after 2/3 of the look-ahead


@compiled
def wanted_drop(foot, told, leg, hip, next_hip, shift, extension, settings, bodies_at, bodies_turn):
    """How far the hips must drop for one foot, m, times how much that foot counts.

    `hip` (3,) is the leg's animated hip joint now, `next_hip` at the next plant, when the
    animated leg has that `extension`; `shift` (3,) is where the body's lean takes both. A foot that
    swings counts more and more as its plant comes near, and one that will leave soon less and less:
    its heel lifts instead. One that found no ground never counts.
    """
    reach = usable(leg, norm(sub(get3(told["ankle"]), hip)), settings)
    hip, next_hip = add(hip, shift), add(next_hip, shift)
    if foot["state"] == GROUNDED:
        share = 1.0 if foot["bump"] else foot["weight"]
        if told["ahead"]:
            share *= smooth_step(told["to_release"] / settings["hip_let_go"])
        drop = share * shortfall(hip, get3(foot["goal"]), reach)
    else:
        drop = 0.0
    ahead = settings["hip_look_ahead"]
    if told["ahead"] and foot["plan"] == PLANNED and 0.0 < told["to_plant"] < ahead:
        land, turn = to_world(
            foot["land_body"], get3(foot["land"]), get4(foot["land_turn"]), bodies_at, bodies_turn
        )
        ankle, _ = planted(land, turn, told["pitch"], leg)
        share = smooth_step(_EARLY * (1.0 - told["to_plant"] / ahead))
        drop = max(drop, share * shortfall(next_hip, ankle, usable(leg, extension, settings)))
    return drop


@compiled
def move_hips(body, wanted, dt, settings):
    """Follow the wanted drop (m, 0 or more) by a spring; the drop is kept in the body's record."""
    target = min(wanted, settings["max_hip_drop"])
    half_life = 0.0 if body["fresh"] else settings["hip_half_life"]
    drop, speed = spring(body["hip_drop"], body["hip_speed"], target, half_life, dt)
    within = clamp(drop, 0.0, settings["max_hip_drop"])
    body["hip_drop"], body["hip_speed"] = within, speed if within == drop else 0.0
    body["fresh"] = 0
