"""Vectors and quaternions as small tuples, compiled: no allocation, value in, value out.

A vector is (x, y, z). A quaternion is (w, x, y, z), unit, and `quat_mul(a, b)` applies b first.
Every function is total: zero lengths give the stated fallback, never NaN.
"""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled

Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]

TINY = 1e-12
IDENTITY: Quat = (1.0, 0.0, 0.0, 0.0)
ZERO: Vec3 = (0.0, 0.0, 0.0)
UP: Vec3 = (0.0, 0.0, 1.0)
FORWARD: Vec3 = (1.0, 0.0, 0.0)


@compiled
def get3(a):
    """The first three numbers of an array, as a vector."""
    return (float(a[0]), float(a[1]), float(a[2]))


@compiled
def set3(a, v):
    """Write a vector into the first three places of an array."""
    a[0] = v[0]
    a[1] = v[1]
    a[2] = v[2]


@compiled
def get4(a):
    """The first four numbers of an array, as a quaternion."""
    return (float(a[0]), float(a[1]), float(a[2]), float(a[3]))


@compiled
def set4(a, q):
    """Write a quaternion into the first four places of an array."""
    a[0] = q[0]
    a[1] = q[1]
    a[2] = q[2]
    a[3] = q[3]


@compiled
def clamp(x, low, high):
    """x limited to [low, high]."""
    return min(max(x, low), high)


@compiled
def add(a, b):
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@compiled
def sub(a, b):
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@compiled
def scale(v, s):
    """v * s."""
    return (v[0] * s, v[1] * s, v[2] * s)


@compiled
def add_scaled(a, b, s):
    """a + b * s."""
    return (a[0] + b[0] * s, a[1] + b[1] * s, a[2] + b[2] * s)


@compiled
def lerp(a, b, t):
    """a at t = 0, b at t = 1, linear between; exact at both ends."""
    u = 1.0 - t
    return (a[0] * u + b[0] * t, a[1] * u + b[1] * t, a[2] * u + b[2] * t)


@compiled
def dot(a, b):
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def cross(a, b):
    """Right-handed vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@compiled
def norm(v):
    """Length."""
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@compiled
def unit(v, fallback):
    """v at length 1; `fallback` where v is (nearly) zero."""
    length = norm(v)
    if length < TINY:
        return fallback
    return (v[0] / length, v[1] / length, v[2] / length)


@compiled
def reject(v, n):
    """v without its part along n; n need not be unit, and a zero n returns v."""
    length2 = dot(n, n)
    if length2 < TINY * TINY:
        return v
    return add_scaled(v, n, -dot(v, n) / length2)


@compiled
def perpendicular(v):
    """Some unit vector perpendicular to v."""
    axis = (1.0, 0.0, 0.0) if abs(v[0]) <= 0.6 * norm(v) else (0.0, 1.0, 0.0)
    return unit(cross(v, axis), (0.0, 0.0, 1.0))


@compiled
def angle_between(a, b):
    """Angle between two vectors in radians, accurate near 0 and pi; 0 where one is zero."""
    return math.atan2(norm(cross(a, b)), dot(a, b))


@compiled
def quat_mul(a, b):
    """The rotation that applies b, then a."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@compiled
def quat_conj(q):
    """The inverse of a unit quaternion."""
    return (q[0], -q[1], -q[2], -q[3])


@compiled
def quat_unit(q):
    """q at length 1; the identity where it is (nearly) zero."""
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if length < TINY:
        return (1.0, 0.0, 0.0, 0.0)
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)


@compiled
def rotate(q, v):
    """v turned by the unit quaternion q."""
    tx = 2.0 * (q[2] * v[2] - q[3] * v[1])
    ty = 2.0 * (q[3] * v[0] - q[1] * v[2])
    tz = 2.0 * (q[1] * v[1] - q[2] * v[0])
    return (
        v[0] + q[0] * tx + q[2] * tz - q[3] * ty,
        v[1] + q[0] * ty + q[3] * tx - q[1] * tz,
        v[2] + q[0] * tz + q[1] * ty - q[2] * tx,
    )


@compiled
def unrotate(q, v):
    """v turned back by the unit quaternion q."""
    return rotate(quat_conj(q), v)


@compiled
def quat_axis_angle(axis, angle):
    """Rotation by `angle` radians about a unit axis."""
    s = math.sin(0.5 * angle)
    return (math.cos(0.5 * angle), axis[0] * s, axis[1] * s, axis[2] * s)


@compiled
def quat_yaw(yaw):
    """Rotation by `yaw` radians about +z."""
    return (math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw))


@compiled
def quat_from_rotvec(v):
    """Rotation by |v| radians about v."""
    angle = norm(v)
    k = 0.5 - angle * angle / 48.0 if angle < 1e-4 else math.sin(0.5 * angle) / angle
    return quat_unit((math.cos(0.5 * angle), v[0] * k, v[1] * k, v[2] * k))


@compiled
def quat_to_rotvec(q):
    """Axis times angle, radians, by the short way: length at most pi."""
    w, x, y, z = q if q[0] >= 0.0 else (-q[0], -q[1], -q[2], -q[3])
    s = math.sqrt(x * x + y * y + z * z)
    k = 2.0 / max(w, TINY) if s < 1e-9 else 2.0 * math.atan2(s, w) / s
    return (x * k, y * k, z * k)


@compiled
def quat_between(a, b):
    """The shortest rotation that turns direction a into direction b; the identity where one is 0.

    Opposite directions turn by pi about some perpendicular axis.
    """
    a = unit(a, (0.0, 0.0, 0.0))
    b = unit(b, (0.0, 0.0, 0.0))
    if dot(a, a) == 0.0 or dot(b, b) == 0.0:
        return (1.0, 0.0, 0.0, 0.0)
    cosine = dot(a, b)
    if cosine < -1.0 + 1e-12:
        axis = perpendicular(a)
        return (0.0, axis[0], axis[1], axis[2])
    c = cross(a, b)
    return quat_unit((1.0 + cosine, c[0], c[1], c[2]))


@compiled
def quat_angle(a, b):
    """Angle between two rotations, radians in [0, pi]."""
    return norm(quat_to_rotvec(quat_mul(quat_conj(a), b)))


@compiled
def quat_nlerp(a, b, t):
    """Normalised linear blend by the short way."""
    sign = 1.0 if a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] >= 0.0 else -1.0
    u, s = 1.0 - t, sign * t
    return quat_unit(
        (a[0] * u + b[0] * s, a[1] * u + b[1] * s, a[2] * u + b[2] * s, a[3] * u + b[3] * s)
    )


@compiled
def quat_slerp(a, b, t):
    """Constant-speed blend by the short way."""
    return quat_mul(a, quat_from_rotvec(scale(quat_to_rotvec(quat_mul(quat_conj(a), b)), t)))


@compiled
def quat_from_basis(x, y, z):
    """The rotation whose columns are the orthonormal right-handed x, y, z (Shepperd's method)."""
    trace = x[0] + y[1] + z[2]
    if trace > 0.0:
        q = (1.0 + trace, y[2] - z[1], z[0] - x[2], x[1] - y[0])
    elif x[0] >= y[1] and x[0] >= z[2]:
        q = (y[2] - z[1], 1.0 + x[0] - y[1] - z[2], y[0] + x[1], z[0] + x[2])
    elif y[1] >= z[2]:
        q = (z[0] - x[2], y[0] + x[1], 1.0 + y[1] - x[0] - z[2], z[1] + y[2])
    else:
        q = (x[1] - y[0], z[0] + x[2], z[1] + y[2], 1.0 + z[2] - x[0] - y[1])
    return quat_unit(q)


@compiled
def quat_upright(forward, up):
    """Rotation that takes +z to `up` exactly and +x as near to `forward` as it can.

    Where forward is zero or parallel to up, the shortest rotation from +z to up.
    """
    z = unit(up, (0.0, 0.0, 1.0))
    x = reject(forward, z)
    if norm(x) < 1e-9 * max(1.0, norm(forward)):
        return quat_between((0.0, 0.0, 1.0), z)
    x = unit(x, (1.0, 0.0, 0.0))
    return quat_from_basis(x, cross(z, x), z)


@compiled
def quat_twist(q, axis):
    """The part of q that turns about the unit axis: q = swing * twist."""
    along = q[1] * axis[0] + q[2] * axis[1] + q[3] * axis[2]
    return quat_unit((q[0], axis[0] * along, axis[1] * along, axis[2] * along))


@compiled
def quat_heading(q):
    """Yaw in radians of the rotated +x axis, by its horizontal part; 0 where vertical."""
    f = rotate(q, (1.0, 0.0, 0.0))
    return math.atan2(f[1], f[0]) if f[0] * f[0] + f[1] * f[1] > TINY else 0.0


@compiled
def wrap_angle(angle):
    """The same angle in [-pi, pi]."""
    return math.atan2(math.sin(angle), math.cos(angle))
