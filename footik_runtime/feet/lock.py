"""Locks: what a planted foot keeps of its print, and what it gives to the animation.

A full lock keeps place and heading; a ball or ankle lock keeps a point, over which the foot turns
with the animated one; an unlocked foot goes with the animation over the ground under it. The plant
weight blends from the last to the others.
"""

from __future__ import annotations

from footik_runtime.compiled import compiled
from footik_runtime.feet.footprint import UP, planted, print_of, stance_pitch
from footik_runtime.feet.record import ANKLE_LOCK, BALL_LOCK, UNLOCKED
from footik_runtime.math3d import (
    add,
    clamp,
    dot,
    get3,
    get4,
    lerp,
    quat_between,
    quat_heading,
    quat_mul,
    quat_slerp,
    quat_yaw,
    rotate,
    sub,
    wrap_angle,
)


@compiled
def loose(foot):
    """How much a planted foot goes with the animation, 0 to 1."""
    return 1.0 if foot["lock"] == UNLOCKED else 1.0 - foot["plant"]


@compiled
def kept_print(foot, anim_turn, leg, settings, bodies_at, bodies_turn):
    """The print in the world, turned as its lock and the largest twist allow."""
    point, turn = print_of(foot, bodies_at, bodies_turn)
    twist = wrap_angle(quat_heading(anim_turn) - quat_heading(turn))
    within = clamp(twist, -settings["max_twist"], settings["max_twist"])
    follows = foot["lock"] == BALL_LOCK or foot["lock"] == ANKLE_LOCK
    by = within if follows else twist - within
    if by == 0.0:
        return point, turn
    over = rotate(turn, UP)
    half = quat_mul(quat_between(UP, over), quat_yaw(by))
    turned = quat_mul(quat_mul(half, quat_between(over, UP)), turn)
    ahead = 0.0 if foot["lock"] == ANKLE_LOCK else leg["ball"]
    pivot = add(point, rotate(turn, (ahead, 0.0, 0.0)))
    return sub(pivot, rotate(turned, (ahead, 0.0, 0.0))), turned


@compiled
def loose_print(foot, anim, anim_turn, bodies_at, bodies_turn):
    """Where the animated foot would stand on the plane of its print: under its ankle, its way."""
    point, turn = print_of(foot, bodies_at, bodies_turn)
    n = rotate(turn, UP)
    away = sub((anim[0], anim[1], point[2]), point)
    z = point[2] - dot(n, away) / max(n[2], 0.1)
    heading = quat_yaw(quat_heading(anim_turn))
    return (anim[0], anim[1], z), quat_mul(quat_between(UP, n), heading)


@compiled
def stance(foot, anim, anim_turn, leg, settings, bodies_at, bodies_turn):
    """Ankle and sole rotation of a foot on its print, for an animated ankle (3,) and sole (4,)."""
    pitch = stance_pitch(foot, get4(anim_turn), settings)
    turn = get4(anim_turn)
    point, print_turn = kept_print(foot, turn, leg, settings, bodies_at, bodies_turn)
    base, base_turn = planted(point, print_turn, pitch, leg)
    share = loose(foot)
    if share == 0.0:
        return base, base_turn
    point, print_turn = loose_print(foot, get3(anim), turn, bodies_at, bodies_turn)
    free, free_turn = planted(point, print_turn, pitch, leg)
    return lerp(base, free, share), quat_slerp(base_turn, free_turn, share)
