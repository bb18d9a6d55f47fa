"""Flush ground: what lies on the very face by which a ray leaves a body, as a floor under a crate.

A ray that starts inside a crate passes the crate's bottom. A floor at the same height, to the last
digits, is met there as well, and which of the two MuJoCo names is up to rounding and the order of
geoms. So where a ray leaves a geom, the others are asked one by one.
"""

from __future__ import annotations

from collections import namedtuple
from typing import Any

import mujoco
import numpy as np
from numba import types
from numpy.typing import NDArray

from footik_runtime.compiled import compiled
from footik_runtime.math3d import add_scaled, dot, get3, norm, set3, sub

NEAR = 1e-5
"""m to either side of a face in which ground is flush with it."""

FUNCTIONS = ("mju_rayGeom", "mj_rayMesh", "mj_rayHfield")
"""Of libmujoco, which this needs; all of them tell the normal."""

_PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
_HFIELD = int(mujoco.mjtGeom.mjGEOM_HFIELD)
_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)

_POINTER = types.intp
_ray_geom = types.ExternalFunction(
    "mju_rayGeom",
    types.float64(
        _POINTER,  # pos[3]
        _POINTER,  # mat[9]
        _POINTER,  # size[3]
        _POINTER,  # pnt[3]
        _POINTER,  # vec[3]
        types.int32,  # geomtype
        _POINTER,  # normal[3]
    ),
)
# model, data, geomid, pnt[3], vec[3], normal[3]
_of_one = types.float64(_POINTER, _POINTER, types.int32, _POINTER, _POINTER, _POINTER)
_ray_mesh = types.ExternalFunction("mj_rayMesh", _of_one)
_ray_hfield = types.ExternalFunction("mj_rayHfield", _of_one)


Geoms = namedtuple("Geoms", "body kind group material radius at turn size rgba material_rgba")
"""The geoms of a scene, G of them: MuJoCo's own arrays, which change as the scene does.

body, kind, group, material: (G,) ids. radius: (G,) of the sphere around each, 0 for a plane, m.
at: (G, 3) m and turn: (G, 9), world. size: (G, 3). rgba: (G, 4). material_rgba: (materials, 4).
"""


def geoms_of(model: mujoco.MjModel, data: mujoco.MjData) -> Geoms:
    """The geoms of a model, posed as its data stands."""
    return Geoms(
        body=model.geom_bodyid,
        kind=model.geom_type,
        group=model.geom_group,
        material=model.geom_matid,
        radius=model.geom_rbound,
        at=data.geom_xpos,
        turn=data.geom_xmat,
        size=model.geom_size,
        rgba=model.geom_rgba,
        material_rgba=model.mat_rgba,
    )


@compiled
def _is_seen(geoms, groups, geom):
    """Whether mj_ray sees a geom: of a group that is asked for, and not transparent."""
    group = min(max(geoms.group[geom], 0), groups.shape[0] - 1)
    material = geoms.material[geom]
    alpha = geoms.rgba[geom, 3] if material < 0 else geoms.material_rgba[material, 3]
    return groups[group] != 0 and alpha != 0.0


@compiled
def _may_be_at(geoms, geom, point):
    """Whether a point is within a geom's bounds, or the geom has none."""
    radius = geoms.radius[geom]
    if geoms.kind[geom] == _PLANE or radius <= 0.0:
        return True
    return norm(sub(get3(geoms.at[geom]), point)) <= radius + 10.0 * NEAR


@compiled
def find_flush(model, data, groups, geoms, passed, face, origin, direction, normal):
    """The ground that begins where a ray leaves the geom `passed`, at the point `face`.

    Returns its geom, -1 where there is none, how far past the face it is, m within `NEAR`, and its
    normal. Model and data are addresses; origin, direction and normal (3,) are scratch, of which
    the direction is the ray's.
    """
    found, nearest, facing = -1, 2.0 * NEAR, (0.0, 0.0, 0.0)
    set3(origin, add_scaled(face, get3(direction), -NEAR))
    for geom in range(geoms.body.shape[0]):
        if geom == passed or not _is_seen(geoms, groups, geom):
            continue
        kind = geoms.kind[geom]
        if kind > _MESH or not _may_be_at(geoms, geom, face):
            continue
        if kind == _MESH:
            distance = _ray_mesh(
                model, data, geom, origin.ctypes.data, direction.ctypes.data, normal.ctypes.data
            )
        elif kind == _HFIELD:
            distance = _ray_hfield(
                model, data, geom, origin.ctypes.data, direction.ctypes.data, normal.ctypes.data
            )
        else:
            distance = _ray_geom(
                geoms.at[geom].ctypes.data,
                geoms.turn[geom].ctypes.data,
                geoms.size[geom].ctypes.data,
                origin.ctypes.data,
                direction.ctypes.data,
                kind,
                normal.ctypes.data,
            )
        if 0.0 <= distance < nearest and dot(get3(normal), get3(direction)) < 0.0:
            found, nearest, facing = geom, distance, get3(normal)
    return found, nearest - NEAR, facing


def find_flush_through_python(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    groups: NDArray[np.uint8],
    passed: int,
    face: tuple[float, float, float],
    direction: NDArray[np.float64],
) -> tuple[int, float, Any]:
    """The same as `find_flush`, a call of MuJoCo's Python functions at a time."""
    geoms, normal = geoms_of(model, data), np.zeros(3)
    found, nearest, facing = -1, 2.0 * NEAR, (0.0, 0.0, 0.0)
    origin = np.array(add_scaled(face, get3(direction), -NEAR))
    for geom in range(model.ngeom):
        if geom == passed or not _is_seen(geoms, groups, geom):
            continue
        kind = int(geoms.kind[geom])
        if kind > _MESH or not _may_be_at(geoms, geom, face):
            continue
        if kind == _MESH:
            distance = mujoco.mj_rayMesh(model, data, geom, origin, direction, normal)
        elif kind == _HFIELD:
            distance = mujoco.mj_rayHfield(model, data, geom, origin, direction, normal)
        else:
            posed = (geoms.at[geom], geoms.turn[geom], geoms.size[geom])
            distance = mujoco.mju_rayGeom(*posed, origin, direction, kind, normal)
        if 0.0 <= distance < nearest and float(normal @ direction) < 0.0:
            found, nearest, facing = geom, distance, get3(normal)
    return found, nearest - NEAR, facing
