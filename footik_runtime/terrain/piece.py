"""Piece: one stretch of terrain along x that builds itself on an MjSpec; Site: where it lies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from footik_runtime.errors import FootIKError

Array = NDArray[np.float64]
Range = tuple[float, float]

TERRAIN_GROUP = 0
"""Geom group of every terrain geom: rays see it, and characters live in one of their own."""

FRICTION = (1.0, 0.005, 0.0001)
"""Sliding, torsional and rolling friction of every terrain geom: dry stone under rubber."""

_SEAM = 1e-7  # m that ground reaches over its edges: no ray falls through a rounding of neighbours


@dataclass(frozen=True, kw_only=True)
class Site:
    """Where a piece lies. Its own frame has the origin at the entry edge, at y = 0, on the ground.

    Attributes:
        name: prefix of the names of its geoms and bodies.
        x: m, world x of its entry edge.
        z: m, world height of the ground there.
        base: m, world height to which solid ground reaches down.
        half_width: m, the ground spans y from -half_width to half_width.
        seed: what its random parts are made from.
    """

    name: str
    x: float
    z: float
    base: float
    half_width: float
    seed: tuple[int, ...]

    def rng(self) -> np.random.Generator:
        """A new generator, always of the same numbers."""
        return np.random.default_rng(self.seed)

    def point_w(self, x: float, y: float, z: float) -> list[float]:
        """A point of the site's own frame in the world."""
        return [self.x + x, y, self.z + z]

    def ground(
        self,
        spec: mujoco.MjSpec,
        part: str,
        *,
        x: Range,
        top: float,
        material: str,
        y: Range | None = None,
    ) -> None:
        """Add solid ground: a box over x and y (default: the whole width), from `top` to base."""
        low, high = y or (-self.half_width, self.half_width)
        depth = top - (self.base - self.z)
        self.block(
            spec.worldbody,
            part,
            centre=self.point_w(0.5 * (x[0] + x[1]), 0.5 * (low + high), top - 0.5 * depth),
            half_sizes=[0.5 * (x[1] - x[0]) + _SEAM, 0.5 * (high - low) + _SEAM, 0.5 * depth],
            material=material,
        )

    def block(
        self,
        body: mujoco.MjsBody,
        part: str,
        *,
        centre: ArrayLike,
        half_sizes: ArrayLike,
        material: str,
        quat: ArrayLike = (1.0, 0.0, 0.0, 0.0),
    ) -> None:
        """Add one box to `body`: centre and quaternion in the body's frame, half sizes in m."""
        body.add_geom(
            name=f"{self.name}/{part}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=np.asarray(centre, dtype=np.float64),
            quat=np.asarray(quat, dtype=np.float64),
            size=np.asarray(half_sizes, dtype=np.float64),
            group=TERRAIN_GROUP,
            contype=1,
            conaffinity=1,
            friction=FRICTION,
            material=material,
        )


@dataclass(frozen=True, kw_only=True)
class Piece:
    """One stretch of terrain. Subclasses add settings, their ranges, and how they are built.

    Each setting in RANGES must be finite and within its range, or FootIKError names it; a range
    of ints takes ints only, and a tuple has every number of it in the range.
    """

    RANGES: ClassVar[dict[str, Range]] = {}

    def __post_init__(self) -> None:
        for name, bounds in self.RANGES.items():
            check_setting(f"{type(self).__name__} {name}", getattr(self, name), bounds)

    @property
    def span(self) -> float:
        """How far the piece reaches along x, m."""
        raise NotImplementedError

    @property
    def rise(self) -> float:
        """Height of the ground where the piece ends over where it begins, m."""
        return 0.0

    @property
    def lowest(self) -> float:
        """Height of the lowest ground of the piece over where it begins, m, at most 0."""
        return min(self.rise, 0.0)

    @property
    def static(self) -> bool:
        """Whether nothing of it ever moves."""
        return True

    def build(self, spec: mujoco.MjSpec, site: Site) -> None:
        """Add the piece's geoms, at this site."""
        raise NotImplementedError

    def height(self, site: Site, x: Array, y: Array) -> Array:
        """Ground height over the entry's at x, y of the site's frame; NaN where only rays know."""
        return np.full(np.broadcast_shapes(x.shape, y.shape), np.nan)

    def move(self, model: mujoco.MjModel, data: mujoco.MjData, site: Site, time: float) -> None:
        """Put moving parts where they are at `time` s."""


def check_setting(name: str, value: object, bounds: Range) -> None:
    """Raise FootIKError unless `value` (or each number of a tuple) is within `bounds`."""
    low, high = bounds
    whole = isinstance(low, int) and isinstance(high, int)
    numbers = value if isinstance(value, tuple) and value else (value,)
    kinds = (int, np.integer) if whole else (int, float, np.integer, np.floating)
    for number in numbers:
        right_kind = isinstance(number, kinds) and not isinstance(number, bool)
        if not (right_kind and math.isfinite(number) and low <= number <= high):  # type: ignore
            what = "a whole number" if whole else "a number"
            raise FootIKError(f"{name} must be {what} in [{low:g}, {high:g}], not {value!r}.")


def check_pair(name: str, pair: object, bounds: Range) -> None:
    """Raise FootIKError unless `pair` is (least, most) within `bounds`, in that order."""
    if not (isinstance(pair, tuple) and len(pair) == 2):
        raise FootIKError(f"{name} must be a pair (least, most), not {pair!r}.")
    check_setting(name, pair, bounds)
    if pair[0] > pair[1]:
        raise FootIKError(f"{name} must be (least, most) in that order, not {pair!r}.")
