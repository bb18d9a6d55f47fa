"""Hills: smooth seeded ground, a sum of sine waves on a height field."""

# ruff: noqa: D102 - what pieces override is documented on Piece

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from footik_runtime.errors import FootIKError
from footik_runtime.terrain.look import GRASS
from footik_runtime.terrain.piece import FRICTION, TERRAIN_GROUP, Array, Piece, Range, Site

_WAVES = 8
_SEAM = 0.001  # m that the field goes on beyond the piece at either end: no ray falls through
_LEVEL_EDGE = 0.12  # m of level ground at either end: over a cell, so that the seam is level


@dataclass(frozen=True, kw_only=True)
class Hills(Piece):
    """Rolling ground that begins and ends level, with two continuous derivatives.

    Its geom is a height field of triangles: their surface differs from `height` by at most
    cell**2 / 4 times the largest second derivative, under 1 mm at the default settings.

    Attributes:
        length: m, along x.
        amplitude: m, the largest height above or below level.
        wavelength: m, of the middle wave; the others are up to a third shorter or longer.
        blend: m over which the hills rise from level at the entry, and sink back at the end.
        cell: m, the largest side of a cell of the height field.
    """

    RANGES: ClassVar[dict[str, Range]] = {
        "length": (1.0, 200.0),
        "amplitude": (0.005, 2.0),
        "wavelength": (0.5, 100.0),
        "blend": (0.2, 50.0),
        "cell": (0.02, 0.1),
    }
    length: float = 10.0
    amplitude: float = 0.25
    wavelength: float = 6.0
    blend: float = 2.5
    cell: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        most = 0.5 * self.length - _LEVEL_EDGE
        if self.blend > most:
            raise FootIKError(
                f"Hills blend must be at most {most:g}, half the length less its level edge, "
                f"not {self.blend!r}."
            )

    @property
    def span(self) -> float:
        return self.length

    @property
    def lowest(self) -> float:
        return -self.amplitude

    def build(self, spec: mujoco.MjSpec, site: Site) -> None:
        x, y = self._grid(site.half_width)
        heights = self.height(site, x[None, :], y[:, None])
        low, high = float(heights.min()), float(heights.max())
        half_x = 0.5 * (x[-1] - x[0])
        spec.add_hfield(
            name=f"{site.name}/field",
            nrow=len(y),
            ncol=len(x),
            size=[half_x, site.half_width, high - low, site.z + low - site.base],
            userdata=((heights - low) / (high - low)).ravel(),
        )
        spec.worldbody.add_geom(
            name=f"{site.name}/hills",
            type=mujoco.mjtGeom.mjGEOM_HFIELD,
            hfieldname=f"{site.name}/field",
            pos=site.point_w(0.5 * self.length, 0.0, low),
            group=TERRAIN_GROUP,
            contype=1,
            conaffinity=1,
            friction=FRICTION,
            material=GRASS,
        )

    def height(self, site: Site, x: Array, y: Array) -> Array:
        scale = self.amplitude / self._crest(site.seed, site.half_width)
        return scale * self._shape(site.seed, x, y)

    def _grid(self, half_width: float) -> tuple[Array, Array]:
        """The x (columns,) and y (rows,) of the field's samples, in the site's frame."""
        span = self.length + 2.0 * _SEAM
        columns = math.ceil(span / self.cell) + 1
        rows = math.ceil(2.0 * half_width / self.cell) + 1
        return (
            np.linspace(-_SEAM, self.length + _SEAM, columns),
            np.linspace(-half_width, half_width, rows),
        )

    def _shape(self, seed: tuple[int, ...], x: Array, y: Array) -> Array:
        """The hills before they are scaled to their amplitude."""
        along, across, phase, weight = _waves(seed, self.wavelength)
        waves = np.sin(x[..., None] * along + y[..., None] * across + phase) @ weight
        distance = np.minimum(x, self.length - x) - _LEVEL_EDGE
        return waves * _smootherstep(distance / self.blend)

    @functools.lru_cache(maxsize=64)  # noqa: B019 - a frozen value of few numbers
    def _crest(self, seed: tuple[int, ...], half_width: float) -> float:
        """The largest magnitude of the unscaled hills on the grid."""
        x, y = self._grid(half_width)
        return float(np.abs(self._shape(seed, x[None, :], y[:, None])).max())


def _waves(seed: tuple[int, ...], wavelength: float) -> tuple[Array, Array, Array, Array]:
    """Wave numbers along and across (rad/m), phases and weights of the waves, each (waves,)."""
    rng = np.random.default_rng(seed)
    number = 2.0 * math.pi / (wavelength * rng.uniform(2.0 / 3.0, 4.0 / 3.0, _WAVES))
    # Spread over all directions, so that the hills are no furrows.
    heading = (np.arange(_WAVES) + rng.uniform(0.0, 1.0, _WAVES)) * math.pi / _WAVES
    weight = 1.0 / number  # the longer, the higher: slopes alike
    phase = rng.uniform(-math.pi, math.pi, _WAVES)
    return number * np.cos(heading), number * np.sin(heading), phase, weight


def _smootherstep(t: Array) -> Array:
    """0 up to t = 0, 1 from t = 1, with two continuous derivatives between."""
    t = np.clip(t, 0.0, 1.0)
    return t * t * t * (t * (6.0 * t - 15.0) + 10.0)
