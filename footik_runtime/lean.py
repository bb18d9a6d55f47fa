"""Lean: the body of an animal pitches and rolls with the plane under its feet.

The plane is fitted to the prints of the feet that stand and to the footholds of those that swing,
so it turns before the body is over a slope. Feet of one pair stand so close together that their
heights say little of the roll: there the tilt of the prints themselves counts for most. A spring
follows the plane. The body turns about its root on the ground, so that legs stay square to a slope
and reach as far ahead as back. Two legs do not lean.
"""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.feet.footprint import UP, print_of, to_world
from footik_runtime.feet.record import GROUNDED, PLANNED
from footik_runtime.inertia import smooth_step, spring
from footik_runtime.math3d import (
    add,
    clamp,
    get3,
    get4,
    quat_axis_angle,
    quat_conj,
    quat_mul,
    quat_yaw,
    rotate,
    set3,
    set4,
    sub,
    unrotate,
)

FEWEST = 3
"""Feet that make a plane: a body with fewer does not lean."""

_LENGTHWISE = 0.08  # m from the middle at which a foot's height says as much as its tilt: pitch
_ACROSS = 0.25  # the same of the roll; both for a leg of 0.85 m
_STEEPEST = 0.2  # least upward part of a normal that is believed


@compiled
def lean_body(body, feet, dt, settings, bodies_at, bodies_turn):
    """Follow the plane under the feet by a spring; the lean is kept in the body's record."""
    if feet.shape[0] < FEWEST:
        return
    ahead, aside = plane_slopes(body, feet, settings, bodies_at, bodies_turn)
    most = settings["max_lean"]
    half_life = 0.0 if body["fresh"] else settings["lean_half_life"]
    for k in range(2):
        target = clamp(math.atan(ahead if k == 0 else aside), -most, most)
        lean, speed = spring(body["lean"][k], body["lean_speed"][k], target, half_life, dt)
        within = clamp(lean, -most, most)
        body["lean"][k], body["lean_speed"][k] = within, speed if within == lean else 0.0


@compiled
def plane_slopes(body, feet, settings, bodies_at, bodies_turn):
    """How steeply the plane under the feet rises ahead of the body, and to its left.

    Least squares over the feet that stand or know where they will; level where there are fewer
    than three.
    """
    heading = quat_yaw(body["yaw"])
    known = 0
    x1 = y1 = z1 = xx = xy = yy = xz = yz = tilt_x = tilt_y = 0.0
    for i in range(feet.shape[0]):
        foot = feet[i]
        if foot["state"] == GROUNDED:
            point, turn = print_of(foot, bodies_at, bodies_turn)
        elif foot["plan"] == PLANNED:
            point, turn = to_world(
                foot["land_body"], get3(foot["land"]), get4(foot["land_turn"]), bodies_at,
                bodies_turn,
            )  # fmt: skip
        else:
            continue
        x, y, z = unrotate(heading, sub(point, get3(body["root"])))
        normal = unrotate(heading, rotate(turn, UP))
        up = max(normal[2], _STEEPEST)
        known += 1
        x1, y1, z1 = x1 + x, y1 + y, z1 + z
        xx, xy, yy = xx + x * x, xy + x * y, yy + y * y
        xz, yz = xz + x * z, yz + y * z
        tilt_x, tilt_y = tilt_x - normal[0] / up, tilt_y - normal[1] / up
    if known < FEWEST:
        return 0.0, 0.0
    x1, y1, z1 = x1 / known, y1 / known, z1 / known
    by_x, by_y = (_LENGTHWISE * settings["size"]) ** 2, (_ACROSS * settings["size"]) ** 2
    xx, yy, xy = xx / known - x1 * x1 + by_x, yy / known - y1 * y1 + by_y, xy / known - x1 * y1
    xz = xz / known - x1 * z1 + by_x * tilt_x / known
    yz = yz / known - y1 * z1 + by_y * tilt_y / known
    whole = xx * yy - xy * xy
    return (yy * xz - xy * yz) / whole, (xx * yz - xy * xz) / whole


@compiled
def leans(body):
    """Whether there is any lean to be seen."""
    return body["blend"] > 0.0 and (body["lean"][0] != 0.0 or body["lean"][1] != 0.0)


@compiled
def lean_turn(body):
    """The body's lean as a world rotation, as far as foot IK is switched on."""
    share = smooth_step(body["blend"])
    yaw = quat_yaw(body["yaw"])
    pitch = quat_axis_angle((0.0, 1.0, 0.0), -share * body["lean"][0])
    roll = quat_axis_angle((1.0, 0.0, 0.0), share * body["lean"][1])
    return quat_mul(yaw, quat_mul(quat_mul(pitch, roll), quat_conj(yaw)))


@compiled
def lean_shift(body, point):
    """Where the lean takes a point (3,) of the pose, from where it is, m."""
    if not leans(body):
        return (0.0, 0.0, 0.0)
    arm = sub(point, get3(body["root"]))
    return sub(rotate(lean_turn(body), arm), arm)


@compiled
def lean_pose(body, order, root, local, at, turn):
    """Lean a pose: root (3,), local (J, 4), and world at (J, 3), turn (J, 4) of joints `order`."""
    if not leans(body):
        return
    by, pivot = lean_turn(body), get3(body["root"])
    for k in range(order.shape[0]):
        j = order[k]
        set3(at[j], add(pivot, rotate(by, sub(get3(at[j]), pivot))))
        set4(turn[j], quat_mul(by, get4(turn[j])))
    set3(root, add(pivot, rotate(by, sub(get3(root), pivot))))
    set4(local[0], quat_mul(by, get4(local[0])))
