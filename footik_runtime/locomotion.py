"""Locomotion: the kinematic character controller that moves the root over the ground.

A character is told a velocity and a turn rate. Its root goes there, and a spring carries it up and
down over the ground that its own ray saw; that ray is cast ahead, where the root will be by the
time the spring has caught up, so that a constant slope is followed without lag at any frame rate.
"""

from __future__ import annotations

import math

import numpy as np

from footik_runtime.compiled import compiled
from footik_runtime.inertia import spring
from footik_runtime.math3d import clamp, quat_yaw, rotate
from footik_runtime.probes import set_probe

_SLOPE_HALF_LIFE = 0.2  # s; on stairs the root climbs by fits and starts
_UNDER_FEET = 0.05  # m that the root may be under the lowest of its feet
_CRAWL = 0.3  # m/s below which a climb says less and less of the slope

BODY = np.dtype(
    [
        ("time", "f8"),
        ("rate", "f8"),
        ("velocity", "f8", 2),
        ("turn_rate", "f8"),
        ("root", "f8", 3),
        ("climb", "f8"),
        ("slope", "f8"),
        ("yaw", "f8"),
        ("ground", "f8"),
        ("on_ground", "i4"),
        ("frame", "i4"),
        ("part", "f8"),
        ("hip_drop", "f8"),
        ("hip_speed", "f8"),
        ("hips", "i4"),
        ("sway", "f8", 2),
        ("sway_speed", "f8", 2),
        ("lean", "f8", 2),
        ("lean_speed", "f8", 2),
        ("fresh", "i4"),
        ("enabled", "i4"),
        ("blend", "f8"),
    ],
    align=True,
)
"""One character: where its root is and what it was told.

time: in the motion's cycle, s; rate: its playback rate. velocity (2,): commanded, m/s in the root's
frame; turn_rate: rad/s. root (3,), yaw: world; climb: vertical speed; slope: rise per metre of the
way, smoothed. ground: height the root tends to, from its own ray; on_ground: whether that ray hit.
frame, part: of the motion's cycle. hip_drop, hip_speed: how far the hips are lowered, m, m/s; hips:
whether they move; sway, sway_speed: how far sideways, world; lean, lean_speed (2,): how far the
body is pitched, nose up, and rolled, left side up, rad, rad/s; fresh: 1 until they are placed for
the first time. enabled: 0 leaves the animation alone; blend: 0 to 1, how much of what the feet are
given the pose takes.
"""


@compiled
def root_rows(bodies, dt, cycle, settings):
    """Advance the clocks and the roots of these rows."""
    for c in range(bodies.shape[0]):
        body = bodies[c]
        time = body["time"] + dt * body["rate"]
        body["time"] = time - math.floor(time / cycle) * cycle
        move_root(body, dt, settings)


@compiled
def move_root(body, dt, settings):
    """The kinematic character controller: go where it was told, over the ground as it was seen."""
    turn = body["turn_rate"] * dt
    yaw = body["yaw"] + 0.5 * turn  # the chord of the arc
    c, s = math.cos(yaw), math.sin(yaw)
    vx, vy = body["velocity"][0], body["velocity"][1]
    body["root"][0] += (c * vx - s * vy) * dt
    body["root"][1] += (s * vx + c * vy) * dt
    body["yaw"] += turn
    if body["on_ground"]:
        z, climb = spring(
            body["root"][2], body["climb"], body["ground"], settings["root_half_life"], dt
        )
        body["root"][2], body["climb"] = z, climb
    else:
        body["climb"] = 0.0
    speed = math.sqrt(vx * vx + vy * vy)
    slope = clamp(body["climb"] / max(speed, _CRAWL * settings["size"]), -1.0, 1.0)
    body["slope"] = slope + (body["slope"] - slope) * 0.5 ** (dt / _SLOPE_HALF_LIFE)


@compiled
def ask_root(body, dt, probe, settings):
    """Ask for the ground ahead: where the root will be when its spring has caught up."""
    lag = settings["root_half_life"] * 2.0 / 1.67835 + dt
    c, s = math.cos(body["yaw"]), math.sin(body["yaw"])
    vx, vy = body["velocity"][0] * lag, body["velocity"][1] * lag
    z = body["root"][2] + settings["ground_above"]
    origin = (body["root"][0] + c * vx - s * vy, body["root"][1] + s * vx + c * vy, z)
    set_probe(probe, origin, (0.0, 0.0, -1.0), settings["ground_above"] + settings["ground_below"])


@compiled
def hear_root(body, hit):
    """Take what the root's ray met as the height to tend to; over nothing, keep the height."""
    body["on_ground"] = hit["hit"]
    if hit["hit"]:
        body["ground"] = hit["point"][2]


@compiled
def support_root(body, lowest, settings):
    """Hold the root up by the lowest ground its feet have or will have, over pits that they pass.

    Feet without any ground let it fall: then `lowest` is infinite.
    """
    # Uphill all of them may be ahead of the root, and so above it.
    lowest -= (_UNDER_FEET + settings["foothold_lead"] * abs(body["slope"])) * settings["size"]
    if math.isfinite(lowest):
        body["ground"] = max(body["ground"], lowest) if body["on_ground"] else lowest
        body["on_ground"] = 1


@compiled
def uphill_lead(body, leg_length, settings):
    """How far uphill prints are moved, m in the root's frame: (forward, left).

    With feet a and b ahead of hips at height h, a leg is as long at the plant as at the release
    where a + b = 2 h g / (1 + g^2) on a slope of g: so much further ahead of level ground's
    prints must they lie that neither the plant nor the release draws the hips down.
    """
    vx, vy = body["velocity"][0], body["velocity"][1]
    speed = max(math.sqrt(vx * vx + vy * vy), _CRAWL * settings["size"])
    g = body["slope"]
    lead = settings["uphill_lead"] * leg_length * g / (1.0 + g * g)
    lead = clamp(lead, -settings["foothold_lead"], settings["foothold_lead"])
    return lead * vx / speed, lead * vy / speed


@compiled
def ahead_of(body, point, seconds):
    """A point of the root's frame (3,) as it will lie in the world, `seconds` from now."""
    turn = body["turn_rate"] * seconds
    yaw = body["yaw"] + 0.5 * turn
    c, s = math.cos(yaw), math.sin(yaw)
    # The chord of an arc is shorter than the arc.
    chord = seconds if abs(turn) < 1e-6 else seconds * math.sin(0.5 * turn) / (0.5 * turn)
    vx, vy = body["velocity"][0] * chord, body["velocity"][1] * chord
    place = rotate(quat_yaw(body["yaw"] + turn), point)
    return (
        body["root"][0] + c * vx - s * vy + place[0],
        body["root"][1] + s * vx + c * vy + place[1],
        body["root"][2] + body["climb"] * max(seconds, 0.0) + place[2],
    )
