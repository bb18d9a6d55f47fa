"""Where the points of a sole are: heel, ball and toe tip, from the ankle's and the toes' pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from footik_runtime.quat_arrays import mul, rotate
from footik_runtime.rig import Leg, Rig

Array = NDArray[np.float64]

POINTS = ("heel", "ball", "tip")
HEEL, BALL, TIP = range(3)


def sole_points(leg: Leg, positions: Array, rotations: Array) -> Array:
    """Heel, ball and tip of one foot in N poses.

    Args:
        leg: whose sole.
        positions: (N, J, 3) of all joints, m.
        rotations: (N, J, 4) of all joints, in the same frame.

    Returns:
        (N, 3, 3): the points in the order of `POINTS`, m, in that frame. The tip turns with the
        toes where there is a toe joint.
    """
    sole = leg.sole
    ankle = positions[:, leg.ankle]
    turn = mul(rotations[:, leg.ankle], sole.frame)
    heel = ankle + rotate(turn, np.array([-sole.heel, 0.0, -sole.height]))
    ball = ankle + rotate(turn, np.array([sole.ball, 0.0, -sole.height]))
    toes = turn if leg.toe < 0 else mul(rotations[:, leg.toe], sole.toe_frame)
    tip = ball + rotate(toes, np.array([sole.tip - sole.ball, 0.0, 0.0]))
    return np.stack([heel, ball, tip], axis=1)


def all_sole_points(rig: Rig, positions: Array, rotations: Array) -> Array:
    """(N, legs, 3, 3): `sole_points` of every leg."""
    return np.stack([sole_points(leg, positions, rotations) for leg in rig.legs], axis=1)
