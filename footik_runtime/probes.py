"""Probes and hits: rays are data. Rooms write where to look; the ground answers, or a recording."""

from __future__ import annotations

import numpy as np

from footik_runtime.compiled import compiled
from footik_runtime.math3d import set3

PROBE = np.dtype(
    [("origin", "f8", 3), ("direction", "f8", 3), ("length", "f8"), ("active", "i4")], align=True
)
"""One ray: origin_w (m), unit direction_w, length (m); not cast where `active` is 0."""

HIT = np.dtype(
    [
        ("hit", "i4"),
        ("geom", "i4"),
        ("body", "i4"),
        ("distance", "f8"),
        ("point", "f8", 3),
        ("normal", "f8", 3),
    ],
    align=True,
)
"""One answer: `hit` 0 or 1, geom and body ids (-1 on a miss), distance (m), point_w, unit normal_w.

A miss has zero point and normal. The normal always faces the ray.
"""


@compiled
def set_probe(probe, origin, direction, length):
    """Ask for one ray: unit direction, length in metres."""
    set3(probe["origin"], origin)
    set3(probe["direction"], direction)
    probe["length"] = length
    probe["active"] = 1


@compiled
def set_miss(hit):
    """Write the answer of a ray that meets nothing."""
    hit["hit"] = 0
    hit["geom"] = -1
    hit["body"] = -1
    hit["distance"] = 0.0
    set3(hit["point"], (0.0, 0.0, 0.0))
    set3(hit["normal"], (0.0, 0.0, 0.0))
