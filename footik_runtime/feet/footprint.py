"""Footprints: places on the ground that live in the frame of the body they lie on, so that feet
ride whatever moves; and the pose of a foot that stands on one.
"""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.feet.record import ON_HEEL
from footik_runtime.math3d import (
    add,
    get3,
    get4,
    quat_axis_angle,
    quat_conj,
    quat_mul,
    rotate,
    sub,
    unrotate,
)

UP = (0.0, 0.0, 1.0)


@compiled
def to_world(body, point, turn, bodies_at, bodies_turn):
    """A print in a body's frame, in the world; bodies_at (B, 3), bodies_turn (B, 4)."""
    if body <= 0 or body >= bodies_at.shape[0]:
        return point, turn
    at, by = get3(bodies_at[body]), get4(bodies_turn[body])
    return add(at, rotate(by, point)), quat_mul(by, turn)


@compiled
def to_body(body, point, turn, bodies_at, bodies_turn):
    """A print in the world, in a body's frame."""
    if body <= 0 or body >= bodies_at.shape[0]:
        return point, turn
    at, by = get3(bodies_at[body]), get4(bodies_turn[body])
    return unrotate(by, sub(point, at)), quat_mul(quat_conj(by), turn)


@compiled
def print_of(foot, bodies_at, bodies_turn):
    """The foot's own print, in the world."""
    return to_world(
        foot["body"], get3(foot["hold"]), get4(foot["hold_turn"]), bodies_at, bodies_turn
    )


@compiled
def sole_pitch(turn, flat):
    """How far the sole's nose points up, rad; what is less than about `flat` fades to zero."""
    ahead = rotate(turn, (1.0, 0.0, 0.0))
    pitch = math.atan2(ahead[2], math.sqrt(ahead[0] * ahead[0] + ahead[1] * ahead[1]))
    over = abs(pitch) - flat
    if over <= 0.0:
        return 0.0
    over = over * over / (over + flat)
    return over if pitch > 0.0 else -over


@compiled
def stance_pitch(foot, turn, settings):
    """The pitch of an animated sole (4,) that its print takes: none over a heel without ground."""
    pitch = sole_pitch(turn, settings["flat_angle"])
    return min(pitch, 0.0) if foot["landed"] != ON_HEEL else pitch


@compiled
def planted(point, turn, pitch, leg):
    """Ankle and sole rotation of a foot on its print, rolled by `pitch` over heel or ball."""
    rolled = quat_mul(turn, quat_axis_angle((0.0, 1.0, 0.0), -pitch))
    x = -leg["heel"] if pitch > 0.0 else leg["ball"]
    pinned = add(point, rotate(turn, (x, 0.0, 0.0)))
    return sub(pinned, rotate(rolled, (x, 0.0, -leg["height"]))), rolled
