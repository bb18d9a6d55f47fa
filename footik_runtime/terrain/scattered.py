"""Pieces of many seeded blocks: rubble on a floor, and stepping stones over a pit.

Their blocks are turned and tilted, so they have no analytic height: cast rays.
"""

# ruff: noqa: D102 - what pieces override is documented on Piece

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from footik_runtime.terrain.look import GROUND, PIT, STONE, STONE_DARK
from footik_runtime.terrain.piece import Piece, Range, Site, check_pair


@dataclass(frozen=True, kw_only=True)
class Rubble(Piece):
    """Blocks strewn over a floor, one in each cell of a grid, so that none pile up.

    Attributes:
        length: m, along x; every block lies within it.
        band: m to either side of y = 0 that is strewn.
        cell: m, side of the cells.
        heights: m, least and most height of a block's middle over the floor.
        sizes: m, least and most side of a block.
        tilt_deg: degrees that a block's top tilts at most.
    """

    RANGES: ClassVar[dict[str, Range]] = {
        "length": (1.0, 1000.0),
        "band": (0.5, 100.0),
        "cell": (0.3, 5.0),
        "tilt_deg": (0.0, 20.0),
    }
    length: float = 10.0
    band: float = 1.5
    cell: float = 0.75
    heights: tuple[float, float] = (0.02, 0.12)
    sizes: tuple[float, float] = (0.25, 0.6)
    tilt_deg: float = 6.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_pair("Rubble heights", self.heights, (0.005, 0.5))
        check_pair("Rubble sizes", self.sizes, (0.05, 0.95 * self.length / math.sqrt(2.0)))

    @property
    def span(self) -> float:
        return self.length

    def build(self, spec: mujoco.MjSpec, site: Site) -> None:
        site.ground(spec, "floor", x=(0.0, self.length), top=0.0, material=GROUND)
        rng = site.rng()
        band = min(self.band, site.half_width)
        columns = max(1, round(self.length / self.cell))
        rows = max(1, round(2.0 * band / self.cell))
        for column in range(columns):
            for row in range(rows):
                x = (column + rng.uniform(0.25, 0.75)) * self.length / columns
                y = (row + rng.uniform(0.25, 0.75)) * 2.0 * band / rows - band
                self._add_block(spec, site, rng, f"block_{column:02d}_{row:02d}", x, y)

    def _add_block(
        self,
        spec: mujoco.MjSpec,
        site: Site,
        rng: np.random.Generator,
        part: str,
        x: float,
        y: float,
    ) -> None:
        side_x, side_y = rng.uniform(*self.sizes, size=2)
        top = rng.uniform(*self.heights)
        yaw, heading = rng.uniform(-math.pi, math.pi, size=2)
        tilt = math.radians(self.tilt_deg) * rng.uniform()
        reach = 0.5 * math.hypot(side_x, side_y)
        # Sunk far enough that no tilted corner hangs over the floor.
        depth = top + reach * math.sin(tilt) + 0.02
        site.block(
            spec.worldbody,
            part,
            centre=site.point_w(min(max(x, reach), self.length - reach), y, top - 0.5 * depth),
            half_sizes=[0.5 * side_x, 0.5 * side_y, 0.5 * depth],
            quat=_yawed_and_tilted(yaw, heading, tilt),
            material=STONE if rng.uniform() < 0.5 else STONE_DARK,
        )


@dataclass(frozen=True, kw_only=True)
class Stones(Piece):
    """Stepping stones in lanes over a pit, spaced along the way at about half a step.

    Attributes:
        length: m, along x; stones begin and end flush with it.
        lanes: how many abreast, evenly about y = 0; an odd number has stones in the middle.
        spacing: m between the middles of stones along x.
        lane_width: m between the middles of lanes.
        part_filled: part of spacing and lane width that the stones themselves take.
        height_change: m that a stone's top lies above or below the way at most.
        yaw_deg: degrees that a stone is turned at most.
        depth: m of the pit.
    """

    RANGES: ClassVar[dict[str, Range]] = {
        "length": (0.5, 1000.0),
        "lanes": (1, 20),
        "spacing": (0.1, 2.0),
        "lane_width": (0.1, 2.0),
        "part_filled": (0.2, 0.98),
        "height_change": (0.0, 0.3),
        "yaw_deg": (0.0, 45.0),
        "depth": (0.1, 10.0),
    }
    length: float = 5.0
    lanes: int = 3
    spacing: float = 0.4
    lane_width: float = 0.42
    part_filled: float = 0.86
    height_change: float = 0.04
    yaw_deg: float = 6.0
    depth: float = 0.5

    @property
    def span(self) -> float:
        return self.length

    @property
    def lowest(self) -> float:
        return -max(self.depth, self.height_change)

    def build(self, spec: mujoco.MjSpec, site: Site) -> None:
        site.ground(spec, "pit", x=(0.0, self.length), top=-self.depth, material=PIT)
        rng = site.rng()
        columns = max(1, round(self.length / self.spacing))
        pitch = self.length / columns
        for column in range(columns):
            for lane in range(self.lanes):
                top = rng.uniform(-self.height_change, self.height_change)
                yaw = math.radians(self.yaw_deg) * rng.uniform(-1.0, 1.0)
                depth = top + self.depth + 0.05
                y = (lane - 0.5 * (self.lanes - 1)) * self.lane_width
                half_x, half_y = 0.5 * self.part_filled * np.array([pitch, self.lane_width])
                site.block(
                    spec.worldbody,
                    f"stone_{column:02d}_{lane:02d}",
                    centre=site.point_w((column + 0.5) * pitch, y, top - 0.5 * depth),
                    half_sizes=[half_x, half_y, 0.5 * depth],
                    quat=_yawed_and_tilted(yaw, 0.0, 0.0),
                    material=STONE if (column + lane) % 2 else STONE_DARK,
                )


def _yawed_and_tilted(yaw: float, heading: float, tilt: float) -> np.ndarray:
    """The rotation that turns by `yaw` about z, then tilts about the level axis at `heading`."""
    turned = np.array([math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)])
    sin = math.sin(0.5 * tilt)
    tilted = np.array([math.cos(0.5 * tilt), sin * math.cos(heading), sin * math.sin(heading), 0.0])
    quat = np.zeros(4)
    mujoco.mju_mulQuat(quat, tilted, turned)
    return quat
