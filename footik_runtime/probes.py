"""Probes and hits: the records that say where to look, and what was found there.

A probe is a ray; whoever answers it, a MuJoCo scene or a recording, writes the hit of the same
place in the array. A probe that is not active is not cast, and its hit is a miss.
"""

from __future__ import annotations

import numpy as np

PROBE = np.dtype(
    [("origin", "f8", 3), ("direction", "f8", 3), ("length", "f8"), ("active", "i4")], align=True
)
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
