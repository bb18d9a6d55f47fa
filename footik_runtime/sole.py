"""Where the points of a sole are: heel, ball and toe tip, from the ankle's and the toes' pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from footik_runtime.rig import Leg, Rig

Array = NDArray[np.float64]

POINTS = ("heel", "ball", "tip")
HEEL, BALL, TIP = range(3)


def rotate_many(q: Array, v: Array) -> Array:
    """Vectors v (..., 3) turned by unit quaternions q (..., 4); both broadcast."""
    w, u = q[..., :1], q[..., 1:]
    t = 2.0 * np.cross(u, v)
    return v + w * t + np.cross(u, t)


def multiply_many(a: Array, b: Array) -> Array:
    """Quaternion products a*b, (..., 4); both broadcast."""
    aw, av, bw, bv = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    w = aw * bw - np.sum(av * bv, axis=-1, keepdims=True)
    return np.concatenate([w, aw * bv + bw * av + np.cross(av, bv)], axis=-1)


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
    turn = multiply_many(rotations[:, leg.ankle], sole.frame)
    heel = ankle + rotate_many(turn, np.array([-sole.heel, 0.0, -sole.height]))
    ball = ankle + rotate_many(turn, np.array([sole.ball, 0.0, -sole.height]))
    toes = turn if leg.toe < 0 else multiply_many(rotations[:, leg.toe], sole.toe_frame)
    tip = ball + rotate_many(toes, np.array([sole.tip - sole.ball, 0.0, 0.0]))
    return np.stack([heel, ball, tip], axis=1)


def all_sole_points(rig: Rig, positions: Array, rotations: Array) -> Array:
    """(N, legs, 3, 3): `sole_points` of every leg."""
    return np.stack([sole_points(leg, positions, rotations) for leg in rig.legs], axis=1)
