"""Clearance: how a swing is bent so that the sole passes over what lies between lift and landing.

The line from lift to landing climbs early where the ground does, as on stairs, and sinks late where
it falls; what still stands above that is cleared by an arch over the whole swing.
"""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.feet.profile import PATH, WINDOW
from footik_runtime.inertia import smooth_step
from footik_runtime.math3d import clamp

_BENDS = (1.0, 1.25, 1.5, 2.0, 2.5)
_BEND_COST = 0.04  # m of arch that a bend of one more is worth
_NEAREST = 0.04  # m of a way that is too short to clear anything
_EARLIEST, _LATEST = 0.06, 0.92  # part of the way outside which an arch has no height to speak of
_TOES_BACK = 0.65  # part of its length by which the hanging foot is shorter as it leaves the ground
_LEVEL_FROM, _LEVEL_AT = 0.1, 0.4  # parts of the way between which the foot comes up to level


@compiled
def climbed(part, bend, up):
    """How much of its way up or down a swing has made at a part of its way along: 0 to 1."""
    return 1.0 - (1.0 - part) ** bend if up else part**bend


@compiled
def arched(part):
    """0 at both ends of the way, 1 in its middle."""
    x = 2.0 * clamp(part, 0.0, 1.0) - 1.0
    return 1.0 - x * x * x * x


@compiled
def bend_over(hits, lift, lift_up, land, land_up, sole, settings):
    """How to bend a swing from lift (3,) to land (3,): the exponent of `climbed`, and its arch, m.

    `lift_up`, `land_up` (3,) are the soles' normals there, between which the foot is tilted.
    `hits` (STEP_PROBES,) are those of the step; the arch is added as `arched` of the way.
    """
    best, arch, least = 1.0, 0.0, 1e9
    for bend in _BENDS:
        needed = _arch(hits, lift, lift_up, land, land_up, sole, bend, settings)
        cost = needed + _BEND_COST * settings["size"] * (bend - 1.0)
        if cost < least:
            best, arch, least = bend, needed, cost
        if needed <= 0.0:
            break
    return best, min(arch + min(arch, settings["clearance"]), settings["largest_step"])


@compiled
def _tip_ahead(part, sole):
    """How far the toe tip is ahead of the ankle at a part of the way: it hangs down at first."""
    level = smooth_step((part - _LEVEL_FROM) / (_LEVEL_AT - _LEVEL_FROM))
    return sole["tip"] * (1.0 - _TOES_BACK * (1.0 - level))


@compiled
def _slope_along(up, x, y):
    """Rise per metre towards (x, y), unit, of the plane whose normal is `up`."""
    return -(up[0] * x + up[1] * y) / max(up[2], 0.1)


@compiled
def _arch(hits, lift, lift_up, land, land_up, sole, bend, settings):
    """The arch that carries a sole over every hit between lift and landing, m, 0 or more."""
    x, y = land[0] - lift[0], land[1] - lift[1]
    way = math.sqrt(x * x + y * y)
    if way < _NEAREST * settings["size"]:
        return 0.0
    up = land[2] > lift[2]
    first = _slope_along(lift_up, x / way, y / way)
    last = _slope_along(land_up, x / way, y / way)
    most = 0.0
    for k in range(PATH + WINDOW):
        hit = hits[k]
        at = ((hit["point"][0] - lift[0]) * x + (hit["point"][1] - lift[1]) * y) / way
        if hit["hit"] == 0 or (k >= PATH and at > way - sole["heel"]):
            continue  # nothing, or under the landing itself
        # The sole is over this place from when its tip comes to it until its heel has left it.
        tip = (at - _tip_ahead(at / way, sole)) / way
        for part in (tip, at / way, (at + sole["heel"]) / way):
            if _EARLIEST < part < _LATEST:
                line = lift[2] + (land[2] - lift[2]) * climbed(part, bend, up)
                line += (first + (last - first) * part) * (at - part * way)
                most = max(most, (hit["point"][2] - line) / arched(part))
    return clamp(most, 0.0, settings["largest_step"])
