"""Pieces of even faces: flat ground, ramps, stairs, a ledge and a gap."""

# ruff: noqa: D102 - what pieces override is documented on Piece

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from footik_runtime.terrain.look import EDGE, GROUND, GROUND_DARK, PIT
from footik_runtime.terrain.piece import Array, Piece, Range, Site

_RAMP_THICKNESS = 0.6
_SIDE_SLOPE = 2.0  # m to either side that a slope across the way reaches
_RAMP_OVERLAP = 0.02  # m that a ramp goes on below the ground at its lower end: no open crease
_RAMP_OVERHANG = 0.005  # m that a ramp is wider than its neighbours: no two coplanar side faces


@dataclass(frozen=True, kw_only=True)
class Flat(Piece):
    """Level ground, `length` m long."""

    RANGES: ClassVar[dict[str, Range]] = {"length": (0.05, 1000.0)}
    length: float = 2.0

    @property
    def span(self) -> float:
        return self.length

    def build(self, spec: mujoco.MjSpec, site: Site) -> None:
        site.ground(spec, "floor", x=(0.0, self.length), top=0.0, material=GROUND)

    def height(self, site: Site, x: Array, y: Array) -> Array:
        return np.zeros(np.broadcast_shapes(x.shape, y.shape))


@dataclass(frozen=True, kw_only=True)
class Ramp(Piece):
    """An even slope: up for a positive angle, down for a negative one.

    Built as a tilted slab whose upper end reaches some 15 cm, underground, into what follows; so
    next to a pit put a stretch of `Flat` between.

    Attributes:
        angle_deg: degrees from level.
        length: m, along x (not along the slope).
    """

    RANGES: ClassVar[dict[str, Range]] = {"angle_deg": (-45.0, 45.0), "length": (0.1, 100.0)}
    angle_deg: float = 15.0
    length: float = 3.0

    @property
    def span(self) -> float:
        return self.length

    @property
    def rise(self) -> float:
        return self.length * math.tan(math.radians(self.angle_deg))

    def build(self, spec: mujoco.MjSpec, site: Site) -> None:
        angle = math.radians(self.angle_deg)
        cos, sin = math.cos(angle), math.sin(angle)
        begin = -_RAMP_OVERLAP if angle >= 0.0 else 0.0
        end = self.length / cos + (0.0 if angle >= 0.0 else _RAMP_OVERLAP)
        along, half = 0.5 * (begin + end), 0.5 * _RAMP_THICKNESS
        centre = site.point_w(along * cos + half * sin, 0.0, along * sin - half * cos)
        site.block(
            spec.worldbody,
            "ramp",
            centre=centre,
            half_sizes=[0.5 * (end - begin), site.half_width + _RAMP_OVERHANG, half],
            quat=[math.cos(0.5 * angle), 0.0, -math.sin(0.5 * angle), 0.0],
            material=GROUND_DARK,
        )

    def height(self, site: Site, x: Array, y: Array) -> Array:
        slope = math.tan(math.radians(self.angle_deg))
        return np.broadcast_to(x * slope, np.broadcast_shapes(x.shape, y.shape)).copy()


@dataclass(frozen=True, kw_only=True)
class SideSlope(Piece):
    """A slope across the way: the left is high for a positive angle. At y = 0 it is level.

    Away from y = 0 it begins and ends with an edge.

    Attributes:
        angle_deg: degrees from level.
        length: m, along x.
    """

    RANGES: ClassVar[dict[str, Range]] = {"angle_deg": (-45.0, 45.0), "length": (0.1, 1000.0)}
    angle_deg: float = 15.0
    length: float = 6.0

    @property
    def span(self) -> float:
        return self.length

    @property
    def lowest(self) -> float:
        return -_SIDE_SLOPE * math.tan(math.radians(abs(self.angle_deg)))

    def build(self, spec: mujoco.MjSpec, site: Site) -> None:
        angle, half = math.radians(self.angle_deg), 0.5 * _RAMP_THICKNESS
        site.block(
            spec.worldbody,
            "side_slope",
            centre=site.point_w(0.5 * self.length, half * math.sin(angle), -half * math.cos(angle)),
            half_sizes=[
                0.5 * self.length,
                min(site.half_width, _SIDE_SLOPE) / math.cos(angle),
                half,
            ],
            quat=[math.cos(0.5 * angle), math.sin(0.5 * angle), 0.0, 0.0],
            material=GROUND_DARK,
        )

    def height(self, site: Site, x: Array, y: Array) -> Array:
        slope = math.tan(math.radians(self.angle_deg))
        within = np.abs(y) <= min(site.half_width, _SIDE_SLOPE)
        height = np.where(within, y * slope, np.nan)
        return np.broadcast_to(height, np.broadcast_shapes(x.shape, y.shape)).copy()


@dataclass(frozen=True, kw_only=True)
class Stairs(Piece):
    """A flight of stairs across the whole width; its first riser is at its entry edge.

    Attributes:
        steps: how many.
        step_height: m.
        step_depth: m, along x.
        down: whether it leads down instead of up.
    """

    RANGES: ClassVar[dict[str, Range]] = {
        "steps": (1, 200),
        "step_height": (0.01, 1.0),
        "step_depth": (0.05, 10.0),
    }
    steps: int = 12
    step_height: float = 0.17
    step_depth: float = 0.30
    down: bool = False

    @property
    def span(self) -> float:
        return self.steps * self.step_depth

    @property
    def rise(self) -> float:
        return self.steps * self._step

    @property
    def _step(self) -> float:
        return -self.step_height if self.down else self.step_height

    def build(self, spec: mujoco.MjSpec, site: Site) -> None:
        for i in range(self.steps):
            begin, end = i * self.step_depth, (i + 1) * self.step_depth
            material = EDGE if i % 2 else GROUND_DARK
            site.ground(
                spec, f"step_{i:02d}", x=(begin, end), top=(i + 1) * self._step, material=material
            )

    def height(self, site: Site, x: Array, y: Array) -> Array:
        step = np.clip(np.floor(x / self.step_depth), 0, self.steps - 1) + 1.0
        return np.broadcast_to(step * self._step, np.broadcast_shapes(x.shape, y.shape)).copy()


@dataclass(frozen=True, kw_only=True)
class Step(Piece):
    """A single riser across the way: no length, just a change of height, up or down.

    Attributes:
        height_change: m, negative for a step down.
    """

    RANGES: ClassVar[dict[str, Range]] = {"height_change": (-1.0, 1.0)}
    height_change: float = 0.2

    @property
    def span(self) -> float:
        return 0.0

    @property
    def rise(self) -> float:
        return self.height_change

    def build(self, spec: mujoco.MjSpec, site: Site) -> None:
        """Nothing: the ground before and after it reaches down far enough."""


@dataclass(frozen=True, kw_only=True)
class Ledge(Piece):
    """A step edge along the way, at y = 0: the left stays high, the right lies `drop` lower.

    It ends on the lower ground, so what follows begins with a step down for the left foot.

    Attributes:
        drop: m.
        length: m, along x.
    """

    RANGES: ClassVar[dict[str, Range]] = {"drop": (0.01, 1.0), "length": (0.1, 1000.0)}
    drop: float = 0.20
    length: float = 6.0

    @property
    def span(self) -> float:
        return self.length

    @property
    def rise(self) -> float:
        return -self.drop

    def build(self, spec: mujoco.MjSpec, site: Site) -> None:
        x, wide = (0.0, self.length), site.half_width
        site.ground(spec, "high", x=x, y=(0.0, wide), top=0.0, material=EDGE)
        site.ground(spec, "low", x=x, y=(-wide, 0.0), top=-self.drop, material=GROUND_DARK)

    def height(self, site: Site, x: Array, y: Array) -> Array:
        height = np.where(y >= 0.0, 0.0, -self.drop)
        return np.broadcast_to(height, np.broadcast_shapes(x.shape, y.shape)).copy()


@dataclass(frozen=True, kw_only=True)
class Gap(Piece):
    """A gap across the whole way, with a floor at the bottom of it.

    Attributes:
        width: m, along x.
        depth: m.
    """

    RANGES: ClassVar[dict[str, Range]] = {"width": (0.02, 5.0), "depth": (0.02, 10.0)}
    width: float = 0.25
    depth: float = 0.6

    @property
    def span(self) -> float:
        return self.width

    @property
    def lowest(self) -> float:
        return -self.depth

    def build(self, spec: mujoco.MjSpec, site: Site) -> None:
        site.ground(spec, "pit", x=(0.0, self.width), top=-self.depth, material=PIT)

    def height(self, site: Site, x: Array, y: Array) -> Array:
        return np.full(np.broadcast_shapes(x.shape, y.shape), -self.depth)
