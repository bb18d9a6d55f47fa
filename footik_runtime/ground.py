"""Ground: casts probes into a MuJoCo scene, through libmujoco itself, and answers with hits.

The compiled path calls libmujoco's `mj_ray` from machine code. Where that library or its signature
is not what we know (checked once, at import), or kernels are off (NUMBA_DISABLE_JIT=1), the same
probes go through Python's `mujoco.mj_ray`, with the same answers.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Sequence
from copy import copy
from numbers import Real
from pathlib import Path
from typing import Any, Protocol

import llvmlite.binding
import mujoco
import numpy as np
from numba import types
from numpy.typing import ArrayLike, NDArray

from footik_runtime.compiled import compiled, jit_enabled
from footik_runtime.errors import FootIKError, listed, unknown_name
from footik_runtime.math3d import (
    TINY,
    add,
    add_scaled,
    dot,
    get3,
    get4,
    norm,
    rotate,
    set3,
    unrotate,
)
from footik_runtime.probes import HIT, PROBE, set_miss
from footik_runtime.settings import checked_groups

Array = NDArray[np.float64]

TERRAIN_GROUPS = (0,)
"""Geom groups that rays see by default; characters live in a group of their own."""

ABOVE, REACH = 0.5, 3.0
"""m over a point at which a ray down to its ground starts, and how far it goes; of a leg of 0.85 m.
"""

_OLDEST = 3_011_000  # mj_version() of 3.11.0, the first whose mj_ray returns the normal
_ARGUMENTS = ("m:", "d:", "pnt:", "vec:", "geomgroup:", "flg_static:", "bodyexclude:", "geomid:")
# m beyond a back face before the ray goes on. Ground that lies on that face, as a floor does under
# a box at rest, is passed with it where MuJoCo names the box first.
_PAST_BACK_FACE = 1e-5
_MOST_PASSED = 24  # back faces, and geoms that are no ground, that one ray passes
# A ray exactly on a grid line of a height field, or on a seam of a mesh, may fall through it in
# MuJoCo. Characters start at round numbers, where such lines are: rays are cast a hair beside.
_OFF_SEAM = (1.37e-7, 0.73e-7, 0.0)  # m


class Ground(Protocol):
    """Whatever answers probes: a scene, or a recording."""

    def cast(self, probes: NDArray[Any], hits: NDArray[Any]) -> None:
        """Answer each active probe (N,) PROBE in hits (N,) HIT; inactive ones keep their answer."""
        ...


def _load_native_ray() -> bool:
    """Make libmujoco's mj_ray callable from kernels; False where it is not the one we know."""
    text = mujoco.mj_ray.__doc__ or ""
    known = mujoco.mj_version() >= _OLDEST and all(name in text for name in (*_ARGUMENTS, "normal"))
    if not (jit_enabled() and known):
        return False
    folder = Path(mujoco.__file__).parent
    names = ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
    libraries = [str(path) for name in names for path in sorted(folder.glob(name))]
    if not libraries:
        return False
    llvmlite.binding.load_library_permanently(libraries[0])
    return bool(llvmlite.binding.address_of_symbol("mj_ray"))


NATIVE_RAYS = _load_native_ray()
"""Whether rays are cast from machine code here, or through Python's mujoco.mj_ray."""

_POINTER = types.intp
_mj_ray = types.ExternalFunction(
    "mj_ray",
    types.float64(
        _POINTER,  # model
        _POINTER,  # data
        _POINTER,  # pnt[3]
        _POINTER,  # vec[3]
        _POINTER,  # geomgroup[6]
        types.uint8,  # flg_static
        types.int32,  # bodyexclude
        _POINTER,  # geomid[1]
        _POINTER,  # normal[3]
    ),
)


Caster = namedtuple("Caster", "model data groups geom_body passed frame")
"""What `cast_native` needs of a scene: two addresses, the group mask, the geoms' bodies, 1 for
geoms that rays pass through, and the rotation (4,) of the probes' frame in the world."""


@compiled
def _record_hit(probe, travelled, geom, normal, geom_body, hit):
    hit["hit"] = 1
    hit["geom"] = geom
    hit["body"] = geom_body[geom]
    hit["distance"] = travelled
    set3(hit["point"], add_scaled(get3(probe["origin"]), get3(probe["direction"]), travelled))
    set3(hit["normal"], normal)


@compiled
def cast_native(model, data, groups, geom_body, passed, frame, probes, hits, numbers, geom_id):
    """Cast active probes (N,) into hits (N,); model and data are addresses, the rest `Caster`'s.

    `numbers` (9,) float64 and `geom_id` (1,) int32 are scratch. Faces that look along the ray are
    passed through: a ray that starts inside a box does not see that box. A ray without direction
    is a miss: MuJoCo would end the process.
    """
    origin, direction, normal = numbers[0:3], numbers[3:6], numbers[6:9]
    for i in range(probes.shape[0]):
        probe, hit = probes[i], hits[i]
        if probe["active"] == 0:
            continue
        set_miss(hit)
        set3(direction, rotate(get4(frame), get3(probe["direction"])))
        if not norm(get3(direction)) > TINY:
            continue
        travelled = 0.0
        for _ in range(_MOST_PASSED):
            start = add_scaled(get3(probe["origin"]), get3(probe["direction"]), travelled)
            set3(origin, rotate(get4(frame), add(start, _OFF_SEAM)))
            distance = _mj_ray(
                model,
                data,
                origin.ctypes.data,
                direction.ctypes.data,
                groups.ctypes.data,
                1,
                -1,
                geom_id.ctypes.data,
                normal.ctypes.data,
            )
            travelled += distance
            if geom_id[0] < 0 or distance < 0.0 or travelled > probe["length"]:
                break
            if dot(get3(normal), get3(direction)) <= 0.0 and passed[geom_id[0]] == 0:
                upright = unrotate(get4(frame), get3(normal))
                _record_hit(probe, travelled, geom_id[0], upright, geom_body, hit)
                break
            travelled += _PAST_BACK_FACE


def _cast_through_python(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    groups: NDArray[np.uint8],
    geom_body: NDArray[np.int32],
    passed: NDArray[np.uint8],
    frame: Array,
    probes: NDArray[Any],
    hits: NDArray[Any],
) -> None:
    """The same as `cast_native`, a call of mujoco.mj_ray at a time."""
    geom_id = np.zeros(1, dtype=np.int32)
    normal = np.zeros(3)
    for probe, hit in zip(probes, hits, strict=True):
        if not probe["active"]:
            continue
        set_miss(hit)
        if not norm(get3(probe["direction"])) > TINY:
            continue
        travelled = 0.0
        turn = get4(frame)
        direction = np.array(rotate(turn, get3(probe["direction"])))
        for _ in range(_MOST_PASSED):
            start = add_scaled(get3(probe["origin"]), get3(probe["direction"]), travelled)
            start = np.array(rotate(turn, add(start, _OFF_SEAM)))
            distance = mujoco.mj_ray(
                model, data, start, direction, groups, True, -1, geom_id, normal
            )
            travelled += distance
            if geom_id[0] < 0 or distance < 0.0 or travelled > probe["length"]:
                break
            if float(normal @ direction) <= 0.0 and passed[geom_id[0]] == 0:
                upright = unrotate(turn, get3(normal))
                _record_hit(probe, travelled, geom_id[0], upright, geom_body, hit)
                break
            travelled += _PAST_BACK_FACE


def group_mask(groups: Sequence[int]) -> NDArray[np.uint8]:
    """(6,) mask of the geom groups that rays see. Raises FootIKError for groups outside 0 to 5."""
    mask = np.zeros(mujoco.mjNGROUP, dtype=np.uint8)
    mask[list(checked_groups(groups))] = 1
    return mask


def _points(points: ArrayLike) -> Array:
    try:
        out = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError):
        out = np.zeros(0)
    if out.shape[-1:] != (3,):
        raise FootIKError(f"points must be numbers of shape (..., 3), not {points!r:.60}.")
    return out


def _geom_id(model: mujoco.MjModel, geom: str | int) -> int:
    """The id of a geom by name or id. Raises FootIKError for one that there is not."""
    if isinstance(geom, str):
        found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, geom)
        if found < 0:
            names = [model.geom(g).name for g in range(model.ngeom)]
            raise unknown_name("geom", geom, [name for name in names if name])
        return found
    if isinstance(geom, bool) or not (
        isinstance(geom, (int, np.integer)) and 0 <= geom < model.ngeom
    ):
        raise FootIKError(f"a geom is a name or an id from 0 to {model.ngeom - 1}, not {geom!r}.")
    return int(geom)


def _shown(groups: Sequence[int]) -> str:
    return listed(str(group) for group in groups)


def _require_same(model: mujoco.MjModel, theirs: mujoco.MjModel) -> None:
    """Raise FootIKError unless `theirs`, which data was made from, is the model or a copy of it."""
    if theirs is model:
        return
    if (theirs.ngeom, theirs.nbody, theirs.nq) != (model.ngeom, model.nbody, model.nq):
        raise FootIKError(
            f"data does not belong to model: it has {theirs.ngeom} geoms, {theirs.nbody} bodies "
            f"and {theirs.nq} coordinates, the model {model.ngeom}, {model.nbody} and {model.nq}."
        )
    parts = ("names", "body_pos", "body_parentid", "geom_bodyid", "geom_type", "geom_pos")
    for part in (*parts, "geom_size"):
        if not np.array_equal(getattr(theirs, part), getattr(model, part)):
            raise FootIKError(
                f"data does not belong to model: it was made from another, with other {part}."
            )


class SceneGround:
    """The ground of one MuJoCo scene: what rays hit in its geom groups, as `data` stands now.

    Geoms with alpha 0 are invisible to rays. `data` must have been through mj_kinematics (or any
    step) since bodies moved.

    Attributes:
        model, data: as given.
        groups: geom groups that rays see.
        passed: (P,) ids of the geoms in them that rays pass through.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        *,
        groups: Sequence[int] | None = None,
        passed: Sequence[str | int] = (),
        native: bool = NATIVE_RAYS,
    ) -> None:
        """Look at a scene.

        Args:
            model: compiled.
            data: of that model.
            groups: geom groups that rays see. By default those of the settings of the crowd that
                walks here, and `TERRAIN_GROUPS` for rays that are cast without a crowd.
            passed: names or ids of geoms that are no ground, whatever their group.
            native: cast rays from machine code.

        Raises:
            FootIKError: data of another model, groups that are none, a geom that there is not, or
                no native rays here.
        """
        if native and not NATIVE_RAYS:
            raise FootIKError("native rays are not available with this MuJoCo or without kernels.")
        if not (isinstance(model, mujoco.MjModel) and isinstance(data, mujoco.MjData)):
            raise FootIKError(f"a ground needs an MjModel and its MjData, not {model}, {data}.")
        _require_same(model, data.model)
        self.model = model
        self.data = data
        self.groups = checked_groups(TERRAIN_GROUPS if groups is None else groups)
        self._asked = groups is not None
        self._mask = group_mask(self.groups)
        self.passed = np.array([_geom_id(model, geom) for geom in passed], dtype=np.int32)
        self._frame = np.array([1.0, 0.0, 0.0, 0.0])
        self._native = native
        self._known: Caster | None = None

    def seeing(self, groups: Sequence[int]) -> SceneGround:
        """Give a ground to a crowd whose settings ask for these groups: this one where it does.

        Raises FootIKError where it was made for others.
        """
        groups = checked_groups(groups)
        if set(groups) == set(self.groups):
            return self
        if self._asked:
            raise FootIKError(
                f"the ground was made for the geom groups {_shown(self.groups)}, but the settings "
                f"ask for {_shown(groups)}: leave them out where the ground is made."
            )
        other = copy(self)
        other.groups, other._asked, other._known = groups, True, None
        other._mask = group_mask(groups)
        return other

    def turned(self, frame: ArrayLike) -> SceneGround:
        """The same ground for probes, and hits, in a frame with this rotation (4,) in the world."""
        other = copy(self)
        other._frame, other._known = np.array(frame, dtype=np.float64), None
        return other

    def cast(self, probes: NDArray[Any], hits: NDArray[Any]) -> None:
        """Answer the active probes; see `Ground.cast`. May be called from several threads."""
        if not self._native:
            caster = self._new_caster()
            seen = (caster.groups, caster.geom_body, caster.passed, caster.frame)
            _cast_through_python(self.model, self.data, *seen, probes, hits)
            return
        cast_native(*self._new_caster(), probes, hits, np.empty(9), np.empty(1, dtype=np.int32))

    def caster(self) -> Caster | None:
        """What compiled code needs to cast here by itself; None where rays go through Python."""
        return self._new_caster() if self._native else None

    def _new_caster(self) -> Caster:
        # Addresses are asked anew: MuJoCo may have rebuilt a model in place, its arrays with it.
        model, data = self.model._address, self.data._address
        known = self._known
        if known is None or (known.model, known.data) != (model, data):
            passed = np.zeros(self.model.ngeom, dtype=np.uint8)
            passed[self.passed] = 1
            bodies = self.model.geom_bodyid  # as it is: a geom may be given to another body
            self._known = known = Caster(model, data, self._mask, bodies, passed, self._frame)
        return known

    def under(
        self, points: ArrayLike, *, above: float = ABOVE, reach: float = REACH
    ) -> tuple[Array, NDArray[np.int32]]:
        """Terrain height under each of the points (N, 3), and the geom it is; NaN and -1 on a miss.

        Rays start `above` metres over each point, and end `reach` metres lower: absolute, for a
        ground does not know how large the bodies on it are.
        """
        points = _points(points)
        if points.ndim != 2:
            raise FootIKError(f"points must have shape (N, 3), not {points.shape}.")
        numbers = isinstance(above, Real) and isinstance(reach, Real)
        if not (numbers and np.isfinite(above) and 0.0 < reach < np.inf):
            raise FootIKError(f"above and reach must be finite, reach positive: {above}, {reach}.")
        probes, hits = np.zeros(len(points), dtype=PROBE), np.zeros(len(points), dtype=HIT)
        probes["origin"] = points + np.array([0.0, 0.0, above])
        probes["direction"] = [0.0, 0.0, -1.0]
        probes["length"] = reach
        probes["active"] = 1
        self.cast(probes, hits)
        return np.where(hits["hit"] == 1, hits["point"][:, 2], np.nan), hits["geom"].copy()

    def height(self, points: ArrayLike, *, above: float = ABOVE, reach: float = REACH) -> Array:
        """Terrain height under each of the points (..., 3), as of `under`."""
        places = _points(points)
        heights, _ = self.under(places.reshape(-1, 3), above=above, reach=reach)
        return heights.reshape(places.shape[:-1])


class RecordedGround:
    """Plays recorded hits back, one per active probe, in the order they were asked."""

    def __init__(self, hits: Sequence[NDArray[Any]] | NDArray[Any]) -> None:
        told = np.asarray(hits)
        if told.size and told.dtype != HIT:
            raise FootIKError(f"recorded hits must be of HIT, not of {told.dtype}.")
        self._hits = told.astype(HIT).reshape(-1)
        self._next = 0

    def cast(self, probes: NDArray[Any], hits: NDArray[Any]) -> None:
        """Answer the active probes from the recording. Raises FootIKError when it has run out."""
        active = np.flatnonzero(probes["active"])
        end = self._next + len(active)
        if end > len(self._hits):
            raise FootIKError(
                f"the recording holds {len(self._hits)} hits, but ray {len(self._hits) + 1} "
                "was asked for."
            )
        hits[active] = self._hits[self._next : end]
        self._next = end
