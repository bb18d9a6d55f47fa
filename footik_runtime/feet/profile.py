"""Profiles: what rays find along a step before it is taken, as heights under the way and the sole.

A few rays between where the foot leaves and where it lands, then three rows along the sole's
direction around the landing: a fine one under the middle of the foot, a coarse one under each edge.
Between two rays that differ by an edge the ground is anything between the two: a sole must not sink
into the higher one, and must not count on being carried by it.
"""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.math3d import clamp
from footik_runtime.probes import set_probe

PATH = 9
"""Rays between lift and landing."""

WINDOW = 28
"""Rays of the row under the middle of the foot."""

SIDE = 10
"""Rays of the row under each edge."""

STEP_PROBES = PATH + WINDOW + 2 * SIDE
"""Rays of a whole step."""

SPACING = 0.025
"""m between two rays of the middle row, for a leg of 0.85 m."""

MIDDLE, LEFT, RIGHT = 0, 1, -1

_BACK = 0.25  # m behind the ankle where the rows begin
_COARSE = SPACING * (WINDOW - 1) / (SIDE - 1)
_EDGE = 0.03  # m between two rays of the middle row that make an edge
_PIT = -0.5  # m, how a missing ray counts
_DOWN = (0.0, 0.0, -1.0)


@compiled
def most_climb(dx, dy, settings):
    """How much the ground may rise or fall over a step, m, on the largest slope."""
    return math.sqrt(dx * dx + dy * dy) * math.tan(settings["largest_slope"])


@compiled
def ask_for_step(probes, lift, place_x, place_y, yaw, ref_z, below, half_width, settings):
    """Write the probes (STEP_PROBES,) of a step from `lift` (3,) to a print at place, yaw.

    `ref_z` is the height of the ground that the body walks on, about which rays are cast; they
    reach `below` under it, m.
    """
    # The further the step, the higher and lower its ground may be.
    climb = most_climb(place_x - lift[0], place_y - lift[1], settings)
    top = max(ref_z, lift[2]) + settings["ground_above"] + climb
    length = top - min(ref_z, lift[2]) + below + climb
    for k in range(PATH):
        f = (k + 1.0) / (PATH + 1.0)
        x = lift[0] + (place_x - lift[0]) * f
        y = lift[1] + (place_y - lift[1]) * f
        set_probe(probes[k], (x, y, top), _DOWN, length)
    c, s = math.cos(yaw), math.sin(yaw)
    for k in range(STEP_PROBES - PATH):
        side, along = row_place(k, settings["size"])
        x = place_x + c * along - s * side * half_width
        y = place_y + s * along + c * side * half_width
        set_probe(probes[PATH + k], (x, y, top), _DOWN, length)


@compiled
def row_place(k, size):
    """The row of the k-th ray after the path's, and how far along the foot it is cast, m."""
    if k < WINDOW:
        return MIDDLE, (k * SPACING - _BACK) * size
    k -= WINDOW
    return (LEFT, (k * _COARSE - _BACK) * size) if k < SIDE else (
        RIGHT, ((k - SIDE) * _COARSE - _BACK) * size
    )  # fmt: skip


@compiled
def row_height(hits, row, along, at_most, size, ref_z):
    """Height over ref_z of one row's ground at a distance along the foot, m.

    Beside an edge what it is `at_most`, or else at least.
    """
    first, last, spacing = PATH, WINDOW - 1, SPACING
    if row != MIDDLE:
        first = PATH + WINDOW + (SIDE if row == RIGHT else 0)
        last, spacing = SIDE - 1, _COARSE
    x = clamp((along / size + _BACK) / spacing, 0.0, last - 1e-6)
    k = int(x)
    a, b = hits[first + k], hits[first + k + 1]
    low = a["point"][2] - ref_z if a["hit"] else _PIT * size
    high = b["point"][2] - ref_z if b["hit"] else _PIT * size
    if abs(high - low) > _EDGE * size * spacing / SPACING:
        return max(low, high) if at_most else min(low, high)
    return low + (high - low) * (x - k)


@compiled
def under_ankle(along, size):
    """Index among a step's hits of the one nearest to a distance along the middle row."""
    return PATH + int(clamp((along / size + _BACK) / SPACING + 0.5, 0.0, WINDOW - 1.0))
