"""Where the points of a sole are: heel, ball and toe tip, from the ankle's and the toes' pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from footik_runtime.compiled import compiled
from footik_runtime.math3d import add, get3, get4, quat_mul, set3
from footik_runtime.math3d import rotate as turned
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
    soles = [leg.sole for leg in rig.legs]
    out = np.empty((len(positions), len(soles), 3, 3))
    _all_points(
        np.array([(leg.ankle, leg.toe) for leg in rig.legs]).reshape(-1, 2),
        np.array([(s.heel, s.ball, s.tip, s.height) for s in soles]).reshape(-1, 4),
        np.array([(s.frame, s.toe_frame) for s in soles]).reshape(-1, 2, 4),
        np.ascontiguousarray(positions, dtype=np.float64),
        np.ascontiguousarray(rotations, dtype=np.float64),
        out,
    )
    return out


@compiled
def _all_points(joints, lengths, frames, positions, rotations, out):
    for t in range(positions.shape[0]):
        for i in range(joints.shape[0]):
            heel, ball, tip, height = lengths[i, 0], lengths[i, 1], lengths[i, 2], lengths[i, 3]
            ankle = get3(positions[t, joints[i, 0]])
            turn = quat_mul(get4(rotations[t, joints[i, 0]]), get4(frames[i, 0]))
            toes = turn
            if joints[i, 1] >= 0:
                toes = quat_mul(get4(rotations[t, joints[i, 1]]), get4(frames[i, 1]))
            at = add(ankle, turned(turn, (ball, 0.0, -height)))
            set3(out[t, i, HEEL], add(ankle, turned(turn, (-heel, 0.0, -height))))
            set3(out[t, i, BALL], at)
            set3(out[t, i, TIP], add(at, turned(toes, (tip - ball, 0.0, 0.0))))
