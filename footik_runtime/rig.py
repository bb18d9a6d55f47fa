"""Rig: which joints of a skeleton are the hips and the legs, and where each sole is."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sole:
    """The underside of one foot, in its sole frame: at the ankle joint, x forward, y left, z up.

    The frame is fixed to the foot: `frame` is its rotation in the ankle joint's own frame, so
    (world rotation of the joint) * frame is the sole's world rotation. On flat ground a flat
    foot has its z axis up, and its sole lies `height` below the ankle.

    Attributes:
        frame: (4,) wxyz.
        height: of the ankle joint over the sole, m.
        heel: how far the heel lies behind the ankle, m, positive.
        ball: how far the ball (where the toes bend) lies ahead of the ankle, m.
        tip: how far the toe tip lies ahead of the ankle, m; at least `ball`.
        half_width: half the sole's width at the ball, m.
        toe_frame: (4,) wxyz, the sole frame's rotation in the toe joint's frame when the toes lie
            flat with the foot; without a toe joint it has no meaning.
    """

    frame: Array
    height: float
    heel: float
    ball: float
    tip: float
    half_width: float
    toe_frame: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Leg:
    """One leg: joint indices from hip to toe (toe -1 where the foot has none), and its sole."""

    name: str
    hip: int
    knee: int
    ankle: int
    toe: int
    sole: Sole


@dataclass(frozen=True, kw_only=True, eq=False)
class Rig:
    """The parts of a skeleton that foot IK needs.

    Attributes:
        skeleton: the joints.
        hips: index of the joint that carries the body and is lowered, usually the root.
        legs: left before right, front before hind.
        forward: (3,) unit, horizontal: where the rest pose faces, in the model frame.
        notes: how each part was found, a line each, for people to read.
    """

    skeleton: Skeleton
    hips: int
    legs: tuple[Leg, ...]
    forward: Array
    notes: tuple[str, ...] = field(default=())

    @property
    def leg_lengths(self) -> Array:
        """(legs,) rest length hip-knee-ankle of each leg, m."""
        offsets = self.skeleton.offsets
        spans = [(leg.hip, leg.knee, leg.ankle) for leg in self.legs]
        return np.array([_chain_length(self.skeleton, offsets, *span) for span in spans])


def _chain_length(skeleton: Skeleton, offsets: Array, hip: int, knee: int, ankle: int) -> float:
    positions, _ = skeleton.rest_pose()
    return float(
        np.linalg.norm(positions[knee] - positions[hip])
        + np.linalg.norm(positions[ankle] - positions[knee])
    )
