"""Crowd: many characters that share a motion, settings and a ground, stepped together.

Rows are worked in blocks that fit the processor's cache. One character is a crowd of one.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from footik_runtime import quat_arrays
from footik_runtime.errors import FootIKError
from footik_runtime.feet.plan import PROBES
from footik_runtime.feet.record import FOOT, FOOT_INPUT, reset_foot, switch_on
from footik_runtime.ground import Ground, SceneGround
from footik_runtime.lean import FEWEST
from footik_runtime.legs import leg_records
from footik_runtime.locomotion import BODY
from footik_runtime.math3d import get4, quat_between, quat_conj, quat_mul, quat_unit, rotate
from footik_runtime.motion import Motion
from footik_runtime.openkcc_rooms import OpenKCCRooms
from footik_runtime.probes import HIT, PROBE
from footik_runtime.rooms import BLOCK, Block, Bodies, Tables, after_rays, before_rays, step_native
from footik_runtime.settings import FootIKSettings, body_size, settings_or_default
from footik_runtime.upright import turn_bodies, turn_memory, turn_poses

Array = NDArray[np.float64]


class Crowd:
    """Characters that share a motion, settings and a ground; all of them step at once.

    Attributes:
        motion, settings: as given.
        ground: as given; a `SceneGround` sees the settings' groups.
        bodies: (C,) of `BODY`: place the characters and command them here.
        feet: (C, legs) of `FOOT`.
        roots: (C, 3) where joint 0 of each is now, world, m.
        rotations: (C, J, 4) local joint rotations now; row 0 is joint 0's in the world.
        openkcc: OpenKCC's own state machines where the settings ask for that behaviour, else None.
    """

    def __init__(
        self,
        motion: Motion,
        ground: Ground,
        count: int = 1,
        *,
        settings: FootIKSettings | None = None,
        threads: int = 1,
    ) -> None:
        """Make characters that stand at the world's origin.

        Args:
            motion: that all of them play.
            ground: that all of them walk on.
            count: how many.
            settings: of all their feet.
            threads: that share the rows; their number changes no bit of any result. One thread
                does the work where Python has to: with the openkcc behaviour, and where rays are
                not native.

        Raises:
            FootIKError: no character, no thread, a ground made for other groups than the
                settings', or an argument that is something else.
        """
        if not isinstance(count, (int, np.integer)) or count < 1:
            raise FootIKError(f"a crowd needs at least one character, not {count}.")
        if not isinstance(threads, (int, np.integer)) or threads < 1:
            raise FootIKError(f"a crowd needs at least one thread, not {threads}.")
        if not isinstance(motion, Motion):
            raise FootIKError(f"a crowd needs a Motion, not {motion!r}.")
        if not callable(getattr(ground, "cast", None)):
            raise FootIKError(f"a crowd needs a ground that casts rays, not {ground!r}.")
        self.motion, self.settings = motion, settings_or_default(settings)
        seen = ground.seeing(self.settings.groups) if isinstance(ground, SceneGround) else ground
        self.ground: Ground = seen
        skeleton, legs = motion.rig.skeleton, motion.rig.legs
        joints = len(skeleton)
        self.tables = Tables(
            parents=skeleton.parents,
            offsets=skeleton.offsets,
            order=_joints_needed(motion),
            roots=motion.roots,
            rotations=motion.rotations,
            translations=motion.translations,
            timing=motion.timing,
            legs=leg_records(motion.rig),
            settings=_record(self.settings, motion),
            fps=float(motion.clip.fps),
            cycle=float(motion.clip.duration),
        )
        self.bodies = np.zeros(count, dtype=BODY)
        self.feet = np.zeros((count, len(legs)), dtype=FOOT)
        self.roots = np.zeros((count, 3))
        self.rotations = np.zeros((count, joints, 4))
        self.openkcc: OpenKCCRooms | None = None
        if self.settings.behaviour == "openkcc":
            self.openkcc = OpenKCCRooms(self.settings, motion.rig.hips, count, len(legs))
        self._parts = _shares(count, threads)
        self._blocks = [
            _new_block(min(part.stop - part.start, BLOCK), joints, len(legs))
            for part in self._parts[1:]
        ]
        # The first one also serves all rows in turn, where one thread must do the work.
        self.block = _new_block(min(count, BLOCK), joints, len(legs))
        self._blocks.insert(0, self.block)
        self._pool = ThreadPoolExecutor(len(self._parts)) if len(self._parts) > 1 else None
        self._frame = np.array([1.0, 0.0, 0.0, 0.0])
        self._upright = True
        self._around = _scene_bodies(self.ground)
        self._native = self._native_arguments()
        self.bodies["rate"], self.bodies["enabled"], self.bodies["hips"] = 1.0, 1, 1
        for foot in self.feet.reshape(-1):
            switch_on(foot)
        self.bodies["velocity"], self.bodies["turn_rate"] = motion.velocity, motion.yaw_rate
        self.reset()

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take a copy's state: it steps its own arrays, not those of the original."""
        self.__dict__.update(state)
        self._take_frame()

    def reset(self) -> None:
        """Forget all feet: the next frame places them where the animation has them."""
        for foot in self.feet.reshape(-1):
            reset_foot(foot)
        self.bodies["fresh"] = 1
        self.bodies["blend"] = self.bodies["enabled"]
        for name in (
            "hip_drop",
            "hip_speed",
            "climb",
            "slope",
            "sway",
            "sway_speed",
            "lean",
            "lean_speed",
        ):
            self.bodies[name] = 0.0
        if self.openkcc is not None:
            self.openkcc.reset()

    def place(self, at: ArrayLike, yaw: ArrayLike = 0.0) -> None:
        """Put the roots somewhere, (C, 3) or (3,) m, facing yaw, (C,) or one, rad.

        Feet are placed anew. Raises FootIKError for other shapes, and numbers that are not finite.
        """
        count = len(self.bodies)
        places, yaws = _checked("at", at, count, (3,)), _checked("yaw", yaw, count, ())
        if not self._upright:
            places = quat_arrays.rotate(quat_arrays.conj(self._frame), places)
        self.bodies["root"], self.bodies["yaw"] = places, yaws
        self.bodies["ground"], self.bodies["on_ground"] = self.bodies["root"][:, 2], 0
        self.reset()

    @property
    def up(self) -> Array:
        """(3,) what is up for these characters, unit, world. Settable at any time.

        Poses, and what `place` takes, stay in the world; `bodies` and `feet` are told in `frame`.
        Feet stay where they are; the bodies turn about their roots at once, so that a character
        that shall walk from floor to wall is told a little at a time.
        """
        return np.array(rotate(get4(self._frame), (0.0, 0.0, 1.0)))

    @up.setter
    def up(self, up_w: ArrayLike) -> None:
        try:
            wanted = np.asarray(up_w, dtype=np.float64)
        except (TypeError, ValueError):
            wanted = np.zeros(0)
        length = float(np.linalg.norm(wanted)) if wanted.shape == (3,) else math.nan
        if not 1e-9 < length < math.inf:
            raise FootIKError(f"up must be three finite numbers, not all 0, not {up_w}.")
        if not isinstance(self.ground, SceneGround) or self.openkcc is not None:
            raise FootIKError(
                "up can be changed on the ground of a MuJoCo scene alone, and not with the "
                "openkcc behaviour."
            )
        x, y, z = (wanted / length).tolist()
        before = get4(self._frame)
        now = quat_unit(quat_mul(quat_between(rotate(before, (0.0, 0.0, 1.0)), (x, y, z)), before))
        turn_memory(np.array(quat_mul(quat_conj(now), before)), self.bodies, self.feet)
        self._frame[:] = now
        self._take_frame()

    @property
    def around(self) -> Bodies:
        """Places (B, 3) and rotations (B, 4) of the scene's bodies, in `frame`."""
        return self._around

    @property
    def frame(self) -> Array:
        """(4,) rotation, in the world, of the frame whose z axis is up."""
        return self._frame.copy()

    def _take_frame(self) -> None:
        """See the ground, and the scene's bodies, in the frame."""
        self._upright = bool((self._frame == (1.0, 0.0, 0.0, 0.0)).all())
        self._around = _scene_bodies(self.ground)
        if isinstance(self.ground, SceneGround):
            self.ground = self.ground.turned(self._frame)
            if not self._upright:
                self._around = Bodies(self._around.at.copy(), self._around.turn.copy())
        self._native = self._native_arguments()

    def command(self, velocity: ArrayLike, turn_rate: ArrayLike = 0.0) -> None:
        """Tell characters where to go: (C, 2) or (2,) m/s in each root's frame; (C,) or one rad/s.

        The motion's rate follows the speed, or the turn rate where it turns in place, within
        half and twice its own.
        Raises FootIKError for other shapes, and numbers that are not finite.
        """
        count = len(self.bodies)
        velocities = _checked("velocity", velocity, count, (2,))
        turn_rates = _checked("turn_rate", turn_rate, count, ())
        self.bodies["velocity"], self.bodies["turn_rate"] = velocities, turn_rates
        if not stays_in_place(self.motion):
            speed = np.hypot(*self.bodies["velocity"].T)
            self.bodies["rate"] = np.clip(speed / self.motion.speed, *RATES)
        elif abs(self.motion.yaw_rate) > _TURNING:
            part = np.abs(self.bodies["turn_rate"] / self.motion.yaw_rate)
            self.bodies["rate"] = np.clip(part, *RATES)

    def step(self, dt: float) -> None:
        """Advance every character by dt seconds, 0 or more.

        The scene's bodies stand where the ground's data has them now. Raises FootIKError for a dt
        that is negative or not finite.
        """
        check_dt(dt)
        if not self._upright and isinstance(self.ground, SceneGround):
            data = self.ground.data
            turn_bodies(self._frame, data.xpos, data.xquat, *self._around)
        self._step(dt)
        if not self._upright:
            turn_poses(self._frame, self.roots, self.rotations)

    def _step(self, dt: float) -> None:
        if self.openkcc is not None:
            state = (self.bodies, self.feet, self.tables, self.roots, self.rotations, self.block)
            self.openkcc.step(*state, dt, self._around, self.ground)
        elif not self._native:
            self._step_through_python(dt)
        elif self._pool is None:
            step_native(dt, *self._native[0])
        else:
            jobs = [self._pool.submit(step_native, dt, *given) for given in self._native]
            for job in jobs:
                job.result()

    def _native_arguments(self) -> list[tuple]:
        """What `step_native` takes after dt, for each part of the rows; none without native rays.

        Made once: all of it stays where it is, and is written in place.
        """
        caster = self.ground.caster() if isinstance(self.ground, SceneGround) else None
        if caster is None:
            return []
        tables = tuple(self.tables._replace(settings=np.array([self.tables.settings])))
        shared = (tables, tuple(self._around), tuple(caster))
        return [
            (
                self.bodies[part], self.feet[part], self.roots[part], self.rotations[part],
                tuple(block), *shared,
            )
            for part, block in zip(self._parts, self._blocks, strict=True)
        ]  # fmt: skip

    def _step_through_python(self, dt: float) -> None:
        for first in range(0, len(self.bodies), BLOCK):
            here = slice(first, first + BLOCK)
            rows = (
                self.bodies[here], self.feet[here], self.tables, self.roots[here],
                self.rotations[here],
            )  # fmt: skip
            before_rays(*rows, self.block, dt, self._around)
            for row in range(len(self.bodies[here])):
                self.ground.cast(self.block.probes[row], self.block.hits[row])
            after_rays(*rows, self.block, dt, self._around)


def check_dt(dt: float) -> None:
    """Raise FootIKError unless dt, s, is finite and 0 or more."""
    # float is asked first: it answers at once, where the abstract Real looks its kinds up.
    if not (isinstance(dt, (float, Real)) and math.isfinite(dt) and dt >= 0.0):
        raise FootIKError(f"a step's dt must be 0 or more and finite, not {dt!r}.")


def stays_in_place(motion: Motion) -> bool:
    """Whether a motion goes too slowly for its rate to follow a speed: idle, or a turn."""
    return motion.speed <= _STILL * body_size(motion.rig)


RATES = (0.5, 2.0)
"""How slow and how fast a motion is played to match a speed, in parts of its own rate."""

_TURNING = 0.1  # rad/s: slower is drift
_STILL = 0.05  # m/s, for a leg of 0.85 m: slower is drift, not a gait

_WORLD = Bodies(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]))


def _checked(name: str, value: ArrayLike, count: int, shape: tuple[int, ...]) -> Array:
    """The value as numbers of this shape, or of this shape for each of the characters."""
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise FootIKError(f"{name} must be numbers, not {value!r}.") from None
    if numbers.shape not in (shape, (count, *shape)):
        one = f"shape {shape}" if shape else "one number"
        raise FootIKError(
            f"{name} must be {one}, or shape {(count, *shape)} for {count} characters, "
            f"not shape {numbers.shape}."
        )
    wrong = ~np.isfinite(numbers)
    if wrong.any():
        who, told = "every character", numbers
        if numbers.shape != shape:
            row = int(np.argwhere(wrong)[0, 0])
            who, told = f"character {row}", numbers[row]
        raise FootIKError(f"{name} must be finite, not {told} for {who}.")
    return numbers


def _record(settings: FootIKSettings, motion: Motion) -> Any:
    """The settings for compiled code, for the legs of this motion."""
    record = settings.record(float(motion.rig.leg_lengths.mean()))
    if len(motion.rig.legs) >= FEWEST:
        record["uphill_lead"] = 0.0  # a body that leans has its legs square to the slope
    return record


def _joints_needed(motion: Motion) -> NDArray[np.int32]:
    """Joints whose world pose the feet need: hips, legs and all above them, parents first."""
    skeleton = motion.rig.skeleton
    ends = [leg.toe if leg.toe >= 0 else leg.ankle for leg in motion.rig.legs]
    ends.append(motion.rig.hips)
    return np.array(sorted({j for end in ends for j in skeleton.chain(end)}), dtype=np.int32)


def _scene_bodies(ground: Ground) -> Bodies:
    """Live views of a scene's bodies, which stay valid; the world's alone for other grounds."""
    if isinstance(ground, SceneGround):
        return Bodies(ground.data.xpos, ground.data.xquat)
    return _WORLD


def _shares(count: int, threads: int) -> list[slice]:
    """The rows of each thread: as even as they can be, and none without a row."""
    threads = min(threads, count)
    ends = [count * i // threads for i in range(threads + 1)]
    return [slice(first, last) for first, last in pairwise(ends)]


def _new_block(rows: int, joints: int, legs: int) -> Block:
    probes = 1 + legs * PROBES
    return Block(
        moves=np.zeros((rows, joints, 3)),
        at=np.zeros((rows, joints, 3)),
        turn=np.zeros((rows, joints, 4)),
        told=np.zeros((rows, legs), dtype=FOOT_INPUT),
        probes=np.zeros((rows, probes), dtype=PROBE),
        hits=np.zeros((rows, probes), dtype=HIT),
        ray=np.zeros(9),
        geom_id=np.zeros(1, dtype=np.int32),
    )
