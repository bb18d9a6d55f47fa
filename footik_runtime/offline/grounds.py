"""Grounds that a user can name for cleanup: a level floor, or one of the named terrains."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from footik_runtime.errors import FootIKError
from footik_runtime.ground import SceneGround
from footik_runtime.probes import HIT, PROBE
from footik_runtime.terrain import make_terrain

Array = NDArray[np.float64]

_ABOVE, _REACH = 1.0, 5.0  # m over a point at which its ray starts, and how far it goes
_UP = np.array([0.0, 0.0, 1.0])


class LevelGround:
    """A level floor at a height z, m, everywhere."""

    def __init__(self, z: float) -> None:
        if not math.isfinite(z):
            raise FootIKError(f"the floor's height must be finite, not {z}.")
        self._z = z

    def height(self, points: Array) -> Array:
        """(N,) the floor's height under points (N, 3)."""
        return np.full(len(points), self._z)

    def normal(self, points: Array) -> Array:
        """(N, 3) straight up."""
        return np.tile(_UP, (len(points), 1))


class TerrainGround:
    """A named terrain of this library, where it lies in a walk: the origin is its start."""

    def __init__(self, name: str, seed: int = 0) -> None:
        """Raises FootIKError for an unknown name, with those there are."""
        spec = mujoco.MjSpec()
        make_terrain(name, seed=seed).add_to(spec)
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        self._ground = SceneGround(model, data)

    def height(self, points: Array) -> Array:
        """(N,) height under points (N, 3), m; NaN beside the terrain."""
        hits = self._hits(points)
        return np.where(hits["hit"] == 1, hits["point"][:, 2], np.nan)

    def normal(self, points: Array) -> Array:
        """(N, 3) unit normal under points (N, 3); up beside the terrain."""
        hits = self._hits(points)
        return np.where(hits["hit"][:, None] == 1, hits["normal"], _UP)

    def _hits(self, points: Array) -> NDArray[np.void]:
        probes, hits = np.zeros(len(points), dtype=PROBE), np.zeros(len(points), dtype=HIT)
        probes["origin"] = points + _ABOVE * _UP
        probes["direction"] = -_UP
        probes["length"] = _REACH
        probes["active"] = 1
        self._ground.cast(probes, hits)
        return hits
