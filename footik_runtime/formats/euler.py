"""Euler angles of any order to quaternions and back, for whole clips at once.

An order is a tuple of axis numbers (0 x, 1 y, 2 z), intrinsic: the first is the outermost turn.
The way back follows Bernardes and Viollet (2022): half sums and differences of the outer angles
come straight from the quaternion, so that nothing loses digits near gimbal lock.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from footik_runtime.compiled import compiled

Array = NDArray[np.float64]

LOCKED = 1e-13
"""Below this length the half sum (or difference) of the outer angles is rounding noise."""


def euler_to_quaternions(angles: Array, order: tuple[int, ...]) -> Array:
    """Unit quaternions (4, ...), component first, of turns about `order`'s axes.

    Args:
        angles: (len(order), ...) radians.
        order: axis numbers, intrinsic, any number of them; none gives identities.
    """
    shape = angles.shape[1:]
    w, v = np.ones(shape), [np.zeros(shape) for _ in range(3)]
    for turn, (half, axis) in enumerate(zip(angles * 0.5, order, strict=True)):
        c, s = np.cos(half), np.sin(half)
        a, b, d = v[axis], v[(axis + 1) % 3], v[(axis + 2) % 3]
        if turn == 0:  # multiplying the identity, spared
            w, v[axis] = c, s
            continue
        v[axis], v[(axis + 1) % 3], v[(axis + 2) % 3] = a * c + w * s, b * c + d * s, d * c - b * s
        w = w * c - a * s
    return np.stack([w, *v])


def is_complete(order: tuple[int, ...]) -> bool:
    """Whether three turns of this order can express every rotation."""
    return len(order) == 3 and order[0] != order[1] != order[2]


def quaternions_to_euler(
    rotations: Array, order: tuple[int, ...], keep: NDArray[np.bool_], known: Array
) -> Array:
    """Angles (T, G, 3), radians, of G joints, each frame's nearest to the one before it.

    Args:
        rotations: (T, G, 4) wxyz, unit.
        order: three axis numbers, intrinsic, neighbours unlike; the outer two may be alike.
        keep: (T, G) frames whose angles are `known` already and are passed through.
        known: (T, G, 3) radians; read where `keep` is set.
    """
    i, j, k = order[::-1]  # as extrinsic turns
    symmetric = i == k
    if symmetric:
        k = 3 - i - j
    sign = (i - j) * (j - k) * (k - i) // 2
    w, x, y, z = (
        rotations[..., 0],
        rotations[..., 1 + i],
        rotations[..., 1 + j],
        rotations[..., 1 + k],
    )
    z = z * sign
    a, b, c, d = (w, x, y, z) if symmetric else (w - y, x + z, y + w, z - x)
    sums, differences = np.hypot(a, b), np.hypot(c, d)
    out = np.empty((*rotations.shape[:2], 3))
    _follow(
        np.arctan2(b, a),
        np.arctan2(d, c),
        2.0 * np.arctan2(differences, sums),
        sums < LOCKED,
        differences < LOCKED,
        float(sign),
        symmetric,
        keep,
        np.ascontiguousarray(known[..., ::-1]),
        out,
    )
    return out[..., ::-1]


@compiled
def _near(angle, wanted):
    """The angle, whole turns away, that is nearest to `wanted`."""
    return angle + 2.0 * math.pi * np.round((wanted - angle) / (2.0 * math.pi))


@compiled
def _follow(
    half_sum, half_difference, middle, no_sum, no_difference, sign, symmetric, keep, known, out
):
    """Of each frame's two solutions take the one nearest the frame before; in lock, hold still."""
    for g in range(out.shape[1]):
        before = (0.0, 0.0, 0.0)
        for t in range(out.shape[0]):
            if keep[t, g]:
                before = (known[t, g, 0], known[t, g, 1], known[t, g, 2])
            else:
                hs, hd = half_sum[t, g], half_difference[t, g]
                if no_difference[t, g]:  # only the sum is known: the first angle stays
                    hd = hs - before[0]
                elif no_sum[t, g]:
                    hs = hd + before[0]
                third, second = hs + hd, middle[t, g]
                mirrored = -second
                if not symmetric:
                    third *= sign
                    second -= 0.5 * math.pi
                    mirrored = math.pi - second
                first = hs - hd
                one = (_near(first, before[0]), _near(second, before[1]), _near(third, before[2]))
                two = (
                    _near(first + math.pi, before[0]),
                    _near(mirrored, before[1]),
                    _near(third + math.pi, before[2]),
                )
                far_one = 0.0
                far_two = 0.0
                for n in range(3):
                    far_one += (one[n] - before[n]) ** 2
                    far_two += (two[n] - before[n]) ** 2
                before = one if far_one <= far_two else two
            for n in range(3):
                out[t, g, n] = before[n]
