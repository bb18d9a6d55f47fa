"""A crowd's frame with a clock between its rooms: what `rooms.step_native` does, room by room.

Compiled code reads the system's clock itself (POSIX), so that a room's time holds no Python.
"""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import types
from numpy.typing import NDArray

from footik_runtime.character import write_qpos
from footik_runtime.compiled import compiled
from footik_runtime.crowd import Crowd
from footik_runtime.errors import FootIKError
from footik_runtime.ground import SceneGround
from footik_runtime.locomotion import root_rows
from footik_runtime.probes import PROBE
from footik_runtime.rooms import (
    BLOCK,
    Block,
    Bodies,
    ask_rows,
    cast_rows,
    leg_rows,
    pose_rows,
    settle_rows,
)
from footik_runtime.scene import Scene

ROOMS = ("sample + FK", "ask", "rays", "settle + hips", "legs", "write")
"""What is timed, in order. sample + FK: the root moved, the pose sampled and placed. ask: what else
comes before the rays. settle + hips: hits heard, goals, hips. write: the pose to a row of qpos."""

_clock_gettime = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.intp))
_CLOCK_ID = time.CLOCK_MONOTONIC
_RAYS = len(ROOMS)  # where the casts are counted, behind the rooms' times


@compiled
def _now(clock):
    _clock_gettime(_CLOCK_ID, clock.ctypes.data)
    return clock[0] * 1_000_000_000 + clock[1]


@compiled
def _lap(spent, room, begun, clock):
    now = _now(clock)
    spent[room] += now - begun
    return now


@compiled
def _keep_probes(probes, kept, spent):
    """Copy the active probes behind those that are kept already, and count them."""
    for c in range(probes.shape[0]):
        for k in range(probes.shape[1]):
            if probes[c, k]["active"]:
                if spent[_RAYS] < kept.shape[0]:
                    kept[spent[_RAYS]] = probes[c, k]
                spent[_RAYS] += 1


@compiled
def write_rows(qpos, address, roots, rotations, rest):
    """Write the poses of all rows to qpos (C, nq)."""
    for c in range(qpos.shape[0]):
        write_qpos(qpos[c], address, roots[c], rotations[c], rest)


@compiled
def timed_frames(
    frames, bodies, feet, tables, roots, locals_, block, dt, scene, caster,
    qpos, address, rest, spent, clock, kept,
):  # fmt: skip
    """Frames of these rows; adds ns to spent (rooms + 1,), and keeps the probes that were cast."""
    rows = bodies.shape[0]
    for _ in range(frames):
        for first in range(0, rows, BLOCK):
            last = min(first + BLOCK, rows)
            here, theirs = bodies[first:last], feet[first:last]
            root, local = roots[first:last], locals_[first:last]
            t = _now(clock)
            root_rows(here, dt, tables.cycle, tables.settings)
            pose_rows(here, tables, root, local, block)
            t = _lap(spent, 0, t, clock)
            ask_rows(here, theirs, tables, block, dt, scene)
            t = _lap(spent, 1, t, clock)
            cast_rows(block, last - first, caster)
            t = _lap(spent, 2, t, clock)
            settle_rows(here, theirs, tables, block, dt, scene)
            t = _lap(spent, 3, t, clock)
            leg_rows(here, theirs, tables, root, local, block, dt)
            t = _lap(spent, 4, t, clock)
            write_rows(qpos[first:last], address, root, local, rest)
            _lap(spent, 5, t, clock)
            _keep_probes(block.probes[: last - first], kept, spent)


class TimedCrowd:
    """Frames of a crowd with its rooms timed, its rows shared by threads as `Crowd` does.

    Attributes:
        crowd: what is stepped; it must have the threads asked for.
        qpos: (C, nq) the poses.
    """

    def __init__(self, crowd: Crowd, scene: Scene, keep: int) -> None:
        assert isinstance(crowd.ground, SceneGround)
        caster = crowd.ground.caster()
        if caster is None:
            raise FootIKError("rooms are timed with native rays only, and this MuJoCo has none.")
        self.crowd = crowd
        self._around, self._caster = Bodies(scene.data.xpos, scene.data.xquat), caster
        self._character = scene.character
        self.qpos = np.tile(scene.data.qpos, (len(crowd.bodies), 1))
        threads = len(crowd._parts)
        self._pool = ThreadPoolExecutor(threads)
        self._spent = np.zeros((threads, len(ROOMS) + 1), np.int64)
        self._clock = np.zeros((threads, 2), np.int64)
        self._kept = np.zeros((threads, keep), PROBE)

    def clear(self) -> None:
        """Forget times and rays."""
        self._spent[:] = 0

    def run(self, frames: int, dt: float) -> None:
        """Step some frames."""
        jobs = [
            self._pool.submit(self._run_part, i, part, block, frames, dt)
            for i, (part, block) in enumerate(
                zip(self.crowd._parts, self.crowd._blocks, strict=True)
            )
        ]
        for job in jobs:
            job.result()

    def _run_part(self, i: int, part: slice, block: Block, frames: int, dt: float) -> None:
        crowd, character = self.crowd, self._character
        timed_frames(
            frames, crowd.bodies[part], crowd.feet[part], crowd.tables, crowd.roots[part],
            crowd.rotations[part], block, dt, self._around, self._caster, self.qpos[part],
            character.qpos_address, character.rest, self._spent[i], self._clock[i], self._kept[i],
        )  # fmt: skip

    @property
    def cast(self) -> int:
        """How many rays were cast since `clear`."""
        return int(self._spent[:, _RAYS].sum())

    @property
    def rays(self) -> NDArray[np.void]:
        """(N,) `PROBE`: those rays, as many as `keep` of each thread."""
        kept = zip(self._kept, self._spent[:, _RAYS], strict=True)
        return np.concatenate([rays[:count] for rays, count in kept])

    @property
    def seconds(self) -> NDArray[np.float64]:
        """(rooms,) spent since `clear`, the mean of the threads."""
        return self._spent[:, :_RAYS].mean(axis=0) * 1e-9
