"""Probes and hits: rays are data. Rooms write where to look; the ground answers, or a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footik_runtime.compiled import compiled
from footik_runtime.math3d import set3
from footik_runtime.quat_arrays import rotate

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


@dataclass(frozen=True, kw_only=True, eq=False)
class Ray:
    """One ray that was cast, and what it met.

    Attributes:
        foot: the name of the leg that asked.
        origin_w, end_w: (3,) where it begins, and where it ends or meets something, m.
        normal_w: (3,) unit, of what it met; None where it met nothing.
    """

    foot: str
    origin_w: NDArray[np.float64]
    end_w: NDArray[np.float64]
    normal_w: NDArray[np.float64] | None


def cast_rays(
    probes: NDArray[Any], hits: NDArray[Any], feet: Sequence[str], frame: NDArray[np.float64]
) -> list[Ray]:
    """The active rays of one character: its root's first, then as many for each of its feet.

    `frame` (4,) is the rotation of the probes' frame in the world.
    """
    out = []
    each = (len(probes) - 1) // max(len(feet), 1)
    for k in range(1, len(probes)):
        probe, hit = probes[k], hits[k]
        if not probe["active"]:
            continue
        end = hit["point"] if hit["hit"] else probe["origin"] + probe["direction"] * probe["length"]
        out.append(
            Ray(
                foot=feet[(k - 1) // each],
                origin_w=rotate(frame, probe["origin"]),
                end_w=rotate(frame, end),
                normal_w=rotate(frame, hit["normal"]) if hit["hit"] else None,
            )
        )
    return out
