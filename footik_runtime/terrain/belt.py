"""Belt: ground that runs across the way, as a conveyor does."""

# ruff: noqa: D102 - what pieces override is documented on Piece

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from footik_runtime.errors import FootIKError
from footik_runtime.terrain.look import MOVING
from footik_runtime.terrain.piece import Array, Piece, Range, Site

_RUNS = 120.0  # s from time 0 on; then it stands
_THICK = 0.3  # m


@dataclass(frozen=True, kw_only=True)
class Belt(Piece):
    """A slab, level with what is before and after it, that goes to the left at an even speed.

    Attributes:
        length: m, along x.
        speed: m/s to the left; negative to the right.
    """

    RANGES: ClassVar[dict[str, Range]] = {"length": (0.2, 100.0), "speed": (-2.0, 2.0)}
    length: float = 6.0
    speed: float = 0.3

    @property
    def span(self) -> float:
        return self.length

    @property
    def static(self) -> bool:
        return False

    def build(self, spec: mujoco.MjSpec, site: Site) -> None:
        body = spec.worldbody.add_body(name=_body(site), mocap=True, pos=self._place_w(site, 0.0))
        half_width = site.half_width + abs(self.speed) * _RUNS
        site.block(
            body,
            "belt",
            centre=[0.0, 0.0, -0.5 * _THICK],
            half_sizes=[0.5 * self.length, half_width, 0.5 * _THICK],
            material=MOVING,
        )

    def height(self, site: Site, x: Array, y: Array) -> Array:
        return np.zeros(np.broadcast_shapes(x.shape, y.shape))

    def move(self, model: mujoco.MjModel, data: mujoco.MjData, site: Site, time: float) -> None:
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, _body(site))
        if body < 0:
            raise FootIKError(
                f"the model has no body {_body(site)!r}: it was compiled without this terrain."
            )
        data.mocap_pos[model.body_mocapid[body]] = self._place_w(site, time)

    def _place_w(self, site: Site, time: float) -> list[float]:
        gone = self.speed * min(max(time, 0.0), _RUNS)
        return site.point_w(0.5 * self.length, gone, 0.0)


def _body(site: Site) -> str:
    return f"{site.name}/belt"
