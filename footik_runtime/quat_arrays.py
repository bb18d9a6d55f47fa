"""Quaternions as arrays (..., 4), wxyz, vectorised: the offline counterpart of `math3d`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def mul(a: ArrayLike, b: ArrayLike) -> Array:
    """The rotations that apply b, then a; shapes broadcast."""
    aw, ax, ay, az = np.moveaxis(np.asarray(a, dtype=np.float64), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(b, dtype=np.float64), -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def conj(q: ArrayLike) -> Array:
    """The inverse of unit quaternions."""
    return np.asarray(q, dtype=np.float64) * [1.0, -1.0, -1.0, -1.0]


def rotate(q: ArrayLike, v: ArrayLike) -> Array:
    """Vectors (..., 3) turned by quaternions (..., 4)."""
    q = np.asarray(q, dtype=np.float64)
    v = np.asarray(v, dtype=np.float64)
    twice = 2.0 * np.cross(q[..., 1:], v)
    return v + q[..., :1] * twice + np.cross(q[..., 1:], twice)


def about(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Rotations by `angle` (...) radians about one unit axis (3,)."""
    half = 0.5 * np.asarray(angle, dtype=np.float64)[..., None]
    return np.concatenate([np.cos(half), np.sin(half) * np.asarray(axis)], axis=-1)


def euler(yaw: ArrayLike, pitch: ArrayLike, roll: ArrayLike) -> Array:
    """Roll about x, then pitch about y (positive nose down), then yaw about z, radians."""
    turn = mul(about([0.0, 0.0, 1.0], yaw), about([0.0, 1.0, 0.0], pitch))
    return mul(turn, about([1.0, 0.0, 0.0], roll))


def between(a: ArrayLike, b: ArrayLike) -> Array:
    """The shortest rotation (4,) of direction a onto direction b; identity where one is zero."""
    a, b = unit(a), unit(b)
    if not a.any() or not b.any():
        return np.array([1.0, 0.0, 0.0, 0.0])
    cosine = float(a @ b)
    if cosine < -1.0 + 1e-12:
        axis = np.cross(a, [1.0, 0.0, 0.0] if abs(a[0]) < 0.6 else [0.0, 1.0, 0.0])
        return np.array([0.0, *unit(axis)])
    return unit(np.array([1.0 + cosine, *np.cross(a, b)]))


def unit(v: ArrayLike) -> Array:
    """Vectors at length 1; zeros stay zeros."""
    v = np.asarray(v, dtype=np.float64)
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return v / np.where(length < 1e-12, 1.0, length) * (length >= 1e-12)


def from_bone(along: ArrayLike, hinge: ArrayLike) -> Array:
    """The rotation whose z is `along` and whose y is as near to `hinge` as it can be; (..., 4).

    `hinge` must not be parallel to `along`; for continuous input the output is continuous up to
    sign.
    """
    z = unit(along)
    hinge = np.broadcast_to(np.asarray(hinge, dtype=np.float64), z.shape)
    y = unit(hinge - z * np.sum(hinge * z, axis=-1, keepdims=True))
    x = np.cross(y, z)
    m = np.stack([x, y, z], axis=-1)
    return _from_matrix(m)


def _from_matrix(m: Array) -> Array:
    """Bar-Itzhack's four candidates, the longest taken."""
    d0, d1, d2 = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    a, b, c = (
        m[..., 2, 1] - m[..., 1, 2],
        m[..., 0, 2] - m[..., 2, 0],
        m[..., 1, 0] - m[..., 0, 1],
    )
    d, e, f = (
        m[..., 1, 0] + m[..., 0, 1],
        m[..., 0, 2] + m[..., 2, 0],
        m[..., 2, 1] + m[..., 1, 2],
    )
    candidates = np.stack(
        [
            np.stack([1 + d0 + d1 + d2, a, b, c], axis=-1),
            np.stack([a, 1 + d0 - d1 - d2, d, e], axis=-1),
            np.stack([b, d, 1 - d0 + d1 - d2, f], axis=-1),
            np.stack([c, e, f, 1 - d0 - d1 + d2], axis=-1),
        ],
        axis=-2,
    )
    squares = np.sum(candidates * candidates, axis=-1)
    best = np.argmax(squares, axis=-1)
    return unit(np.take_along_axis(candidates, best[..., None, None], axis=-2)[..., 0, :])


def to_rotvec(q: ArrayLike) -> Array:
    """Axis times angle (..., 3), radians, by the short way, of unit quaternions."""
    q = np.asarray(q, dtype=np.float64)
    short = q * np.where(q[..., :1] < 0.0, -1.0, 1.0)
    sine = np.linalg.norm(short[..., 1:], axis=-1, keepdims=True)
    small = sine < 1e-9
    angle = 2.0 * np.arctan2(sine, short[..., :1])
    return short[..., 1:] * np.where(small, 2.0, angle / np.where(small, 1.0, sine))


def from_rotvec(v: ArrayLike) -> Array:
    """The rotations by |v| radians about v."""
    v = np.asarray(v, dtype=np.float64)
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * v], axis=-1)
