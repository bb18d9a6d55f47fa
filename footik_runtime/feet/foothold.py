"""Footholds: look along a step before it is taken, and choose where the sole can lie.

A step is looked at once, as a profile of heights: a few rays between where the foot leaves and
where it lands, then a fine row of rays along the sole's direction around the landing. From the
profile come the place of the print, shifted along the foot where an edge is near, the tilt of the
plane under it, and how far the swing must be raised over what lies between.
"""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.inertia import smooth_bump, smooth_step
from footik_runtime.math3d import clamp, cross, quat_upright
from footik_runtime.probes import set_probe

PATH = 7
"""Rays between lift and landing."""

WINDOW = 20
"""Rays along the foot around the landing."""

_BACK, _SPACING = 0.25, 0.035  # m behind the ankle where the row begins, and between its rays
_SOLE_SAMPLES = 7
_EVEN = 0.008  # m of unevenness under a sole that is not worth a shift
_SHIFT_COST = 0.08  # m of unevenness that a shift of a metre is worth
_EDGE = 0.03  # m between two rays of the row that make an edge
_PIT = -0.5  # m, how a missing ray counts
_DOWN = (0.0, 0.0, -1.0)


def _easing_time(progress: float) -> float:
    """The t at which smooth_step(t) = progress."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if smooth_step(middle) < progress else (low, middle)
    return low


_PATH_BUMPS = tuple(smooth_bump(_easing_time((k + 1) / (PATH + 1))) for k in range(PATH))


@compiled
def most_climb(dx, dy, settings):
    """How much the ground may rise or fall over a step, m, on the largest slope."""
    return math.sqrt(dx * dx + dy * dy) * math.tan(settings["largest_slope"])


@compiled
def ask_for_foothold(probes, lift, place_x, place_y, yaw, ref_z, settings):
    """Write the probes (PATH + WINDOW,) of a step from `lift` (3,) to a print at place, yaw.

    `ref_z` is the height of the ground that the body walks on, about which rays are cast.
    """
    # The further the step, the higher and lower its ground may be.
    climb = most_climb(place_x - lift[0], place_y - lift[1], settings)
    top = max(ref_z, lift[2]) + settings["ground_above"] + climb
    length = top - min(ref_z, lift[2]) + settings["ground_below"] + climb
    for k in range(PATH):
        f = (k + 1.0) / (PATH + 1.0)
        x = lift[0] + (place_x - lift[0]) * f
        y = lift[1] + (place_y - lift[1]) * f
        set_probe(probes[k], (x, y, top), _DOWN, length)
    for k in range(WINDOW):
        along = (k * _SPACING - _BACK) * settings["size"]
        x = place_x + math.cos(yaw) * along
        y = place_y + math.sin(yaw) * along
        set_probe(probes[PATH + k], (x, y, top), _DOWN, length)


@compiled
def _height_at(hits, along, size, ref_z):
    """Height over ref_z of the landing's profile at a distance along the foot."""
    x = clamp((along / size + _BACK) / _SPACING, 0.0, WINDOW - 1.000001)
    k = int(x)
    a, b = hits[PATH + k], hits[PATH + k + 1]
    low = a["point"][2] - ref_z if a["hit"] else _PIT * size
    high = b["point"][2] - ref_z if b["hit"] else _PIT * size
    part = x - k
    if abs(high - low) > _EDGE * size:
        part = 1.0 if part > 0.5 else 0.0  # an edge is not a slope
    return low + (high - low) * part


@compiled
def _lie(hits, shift, sole, size, ref_z, most_slope):
    """How a sole shifted along the foot lies: height of its plane at the ankle, slope, unevenness.

    The plane is the least-squares line under heel to tip, raised so that nothing sticks through.
    """
    # An edge lies somewhere between two rays: keep half their distance clear at either end.
    margin = 0.5 * _SPACING * size
    heel, tip = sole["heel"] + margin, sole["tip"] + margin
    step = (tip + heel) / (_SOLE_SAMPLES - 1)
    middle = 0.5 * (tip - heel)
    mean, moment, spread = 0.0, 0.0, 0.0
    for k in range(_SOLE_SAMPLES):
        along = k * step - heel
        h = _height_at(hits, shift + along, size, ref_z)
        mean += h / _SOLE_SAMPLES
        moment += h * (along - middle)
        spread += (along - middle) ** 2
    slope = clamp(moment / max(spread, 1e-9), -most_slope, most_slope)
    most, least = -1e9, 1e9
    for k in range(_SOLE_SAMPLES):
        along = k * step - heel
        over = _height_at(hits, shift + along, size, ref_z) - mean - slope * (along - middle)
        most, least = max(most, over), min(least, over)
    return mean - slope * middle + most, slope, most - least


@compiled
def _best_shift(hits, sole, settings, ref_z, most_slope):
    """The shift along the foot with the evenest ground, the smaller one of equals."""
    size, limit = settings["size"], settings["foothold_shift"]
    best, best_cost = 0.0, 1e9
    step = 0.5 * _SPACING * size
    count = int(limit / step + 1e-9)
    for i in range(2 * count + 1):
        # 0, +1, -1, +2, -2, ...: ties go to the smaller shift.
        shift = step * ((i + 1) // 2) * (1.0 if i % 2 else -1.0)
        _, _, uneven = _lie(hits, shift, sole, size, ref_z, most_slope)
        cost = max(uneven - _EVEN * size, 0.0) + _SHIFT_COST * abs(shift)
        if cost < best_cost - 1e-9:
            best, best_cost = shift, cost
    return best


@compiled
def _cross_slope(hits, shift, sole, size, yaw, most_slope):
    """Mean rise to the left of the surfaces under the sole, from their normals."""
    total, count = 0.0, 0
    for k in range(WINDOW):
        along = (k * _SPACING - _BACK) * size - shift
        n = hits[PATH + k]["normal"]
        if hits[PATH + k]["hit"] and -sole["heel"] <= along <= sole["tip"] and n[2] > 0.3:
            total += (math.sin(yaw) * n[0] - math.cos(yaw) * n[1]) / n[2]
            count += 1
    return clamp(total / count, -most_slope, most_slope) if count else 0.0


@compiled
def choose_foothold(hits, lift, place_x, place_y, yaw, ref_z, sole, settings):
    """Where the flat foot shall stand, from the answered probes of `ask_for_foothold`.

    Returns (found, point (3,) under the ankle, sole rotation, index of the hit it stands on).
    Not found where nothing is under the sole, or only what lies too far up or down.
    """
    size = settings["size"]
    most_slope = math.tan(settings["largest_slope"])
    shift = _best_shift(hits, sole, settings, ref_z, most_slope)
    height, slope, _ = _lie(hits, shift, sole, size, ref_z, most_slope)
    roll = _cross_slope(hits, shift, sole, size, yaw, most_slope)
    c, s = math.cos(yaw), math.sin(yaw)
    forward = (c, s, slope)
    turn = quat_upright(forward, cross(forward, (-s, c, roll)))
    point = (place_x + c * shift, place_y + s * shift, ref_z + height)
    under = int(clamp((shift / size + _BACK) / _SPACING + 0.5, 0.0, WINDOW - 1.0))
    far = settings["largest_step"] + most_climb(place_x - lift[0], place_y - lift[1], settings)
    found = hits[PATH + under]["hit"] == 1 and abs(height) <= far
    return found, point, turn, PATH + under


@compiled
def arch_over(hits, lift_z, land_z, settings):
    """How far to raise the middle of a swing so that it clears what lies between, m.

    The line from lift to landing is raised by a bump; the clip's own clearance is the margin.
    """
    most = 0.0
    for k in range(PATH):
        f = (k + 1.0) / (PATH + 1.0)
        ground = -1e9
        for j in range(max(k - 1, 0), min(k + 2, PATH)):
            if hits[j]["hit"]:
                ground = max(ground, hits[j]["point"][2])
        over = ground - (lift_z + (land_z - lift_z) * f)
        most = max(most, over / _PATH_BUMPS[k])
    return min(most + min(most, settings["clearance"]), settings["largest_step"])
