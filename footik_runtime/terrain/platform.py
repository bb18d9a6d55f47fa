"""Platform: a slab on a mocap body that travels, lifts, turns and tilts over a floor."""

# ruff: noqa: D102 - what pieces override is documented on Piece

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from footik_runtime.errors import FootIKError
from footik_runtime.terrain.look import GROUND, MOVING
from footik_runtime.terrain.piece import Array, Piece, Range, Site, check_setting

_SUNK = 0.5  # m that the slab reaches below the floor, so that no tilt shows its underside


@dataclass(frozen=True, kw_only=True)
class Platform(Piece):
    """A floor with a slab on it, low enough to step onto, that moves as a function of time.

    At time 0 it lies level, in line with the way and in the middle. Each motion is a sine of its
    own period, so that all combinations of them come by.

    Attributes:
        length: m, of the floor along x.
        size: m, of the slab along x and y.
        top: m of the slab's top over the floor at rest.
        travel: m, amplitude along x and y.
        lift: m that it rises at most over rest; it never sinks.
        turn_deg: degrees, amplitude about z.
        tilt_deg: degrees, amplitude of the tilt, about y and x in turn.
        period: s, of the travel; turning takes 1.5, tilting 0.8 and 1.2, lifting 2 times as long.
    """

    RANGES: ClassVar[dict[str, Range]] = {
        "length": (1.0, 100.0),
        "top": (0.01, 0.5),
        "lift": (0.0, 1.0),
        "turn_deg": (0.0, 180.0),
        "tilt_deg": (0.0, 15.0),
        "period": (0.5, 600.0),
    }
    length: float = 6.0
    size: tuple[float, float] = (3.6, 3.0)
    top: float = 0.08
    travel: tuple[float, float] = (0.3, 0.3)
    lift: float = 0.08
    turn_deg: float = 20.0
    tilt_deg: float = 3.0
    period: float = 6.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, bounds in (("size", (0.2, 50.0)), ("travel", (0.0, 10.0))):
            pair = getattr(self, name)
            if not (isinstance(pair, tuple) and len(pair) == 2):
                raise FootIKError(f"Platform {name} must be a pair (x, y), not {pair!r}.")
            check_setting(f"Platform {name}", pair, bounds)

    @property
    def span(self) -> float:
        return self.length

    @property
    def static(self) -> bool:
        return False

    def build(self, spec: mujoco.MjSpec, site: Site) -> None:
        site.ground(spec, "floor", x=(0.0, self.length), top=0.0, material=GROUND)
        position, quat = self.pose_w(site, 0.0)
        body = spec.worldbody.add_body(name=_body(site), mocap=True, pos=position, quat=quat)
        half = 0.5 * (self.top + _SUNK)
        site.block(
            body,
            "slab",
            centre=[0.0, 0.0, -half],
            half_sizes=[0.5 * self.size[0], 0.5 * self.size[1], half],
            material=MOVING,
        )

    def pose_w(self, site: Site, time: float) -> tuple[Array, Array]:
        """Where the middle of the slab's top is at `time` s: position (3,), quaternion (4,)."""
        rate = 2.0 * math.pi * time / self.period
        x = self.travel[0] * math.sin(rate)
        y = self.travel[1] * math.sin(0.5 * rate)
        z = self.lift * 0.5 * (1.0 - math.cos(0.5 * rate))
        position = np.array(site.point_w(0.5 * self.length + x, y, self.top + z))
        turn = math.radians(self.turn_deg) * math.sin(rate / 1.5)
        tilt = math.radians(self.tilt_deg)
        pitch, roll = tilt * math.sin(rate / 0.8), tilt * math.sin(rate / 1.2)
        quat = np.zeros(4)
        mujoco.mju_euler2Quat(quat, np.array([turn, pitch, roll]), "zyx")
        return position, quat

    def move(self, model: mujoco.MjModel, data: mujoco.MjData, site: Site, time: float) -> None:
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, _body(site))
        if body < 0:
            raise FootIKError(
                f"the model has no body {_body(site)!r}: it was compiled without this terrain."
            )
        mocap = model.body_mocapid[body]
        data.mocap_pos[mocap], data.mocap_quat[mocap] = self.pose_w(site, time)


def _body(site: Site) -> str:
    return f"{site.name}/platform"
