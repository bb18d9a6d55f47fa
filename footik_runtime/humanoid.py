"""HumanoidFootIK: one character in a MuJoCo scene, stepped, driven and looked at."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from footik_runtime import quat_arrays
from footik_runtime.balance import Balance, balance_over
from footik_runtime.character import Character
from footik_runtime.crowd import Crowd, check_dt
from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.feet.footprint import to_world
from footik_runtime.feet.record import GROUNDED, LOCKS
from footik_runtime.ground import SceneGround
from footik_runtime.probes import Ray, cast_rays
from footik_runtime.scene import Scene
from footik_runtime.settings import FootIKSettings, body_size, settings_or_default
from footik_runtime.sole import POINTS

Array = NDArray[np.float64]


@dataclass(eq=False)
class FootTarget:
    """One foot of one character: a live view of its record, for people to read.

    Attributes:
        name: of the leg.
    """

    name: str
    _record: NDArray[Any]
    _crowd: Crowd

    @property
    def active(self) -> bool:
        """Whether the foot is placed; without, it follows the animation. Settable at any time.

        A switch is faded over `FootIKSettings.blend_time`, from FK to IK or back.
        """
        return bool(self._record["active"])

    @active.setter
    def active(self, on: bool) -> None:
        self._record["active"] = int(bool(on))

    @property
    def plant_weight(self) -> float:
        """How much the planted foot keeps its place, 0 to 1; at 0 it only follows the ground.

        Settable: at once, where `fade_plant` gets there at a speed.
        """
        return float(self._record["plant"])

    @plant_weight.setter
    def plant_weight(self, weight: float) -> None:
        self.fade_plant(weight)
        self._record["plant"] = self._record["plant_to"]

    def fade_plant(self, weight: float, speed: float = 1.0) -> None:
        """Move the plant weight to another, 0 to 1, at a speed, more than 0, 1/s."""
        if not (isinstance(weight, Real) and 0.0 <= weight <= 1.0):
            raise FootIKError(f"a plant weight must be in [0, 1], not {weight!r}.")
        if not (isinstance(speed, Real) and 0.0 < speed < math.inf):
            raise FootIKError(f"a plant weight fades at more than 0 a second, not {speed!r}.")
        self._record["plant_to"], self._record["plant_speed"] = weight, speed

    @property
    def lock(self) -> str:
        """What it keeps while it is planted: one of `LOCKS`."""
        return LOCKS[max(int(self._record["lock"]), 0)]

    @property
    def state(self) -> str:
        """What it does: "released", "grounded", or "bump stride"."""
        if self._record["state"] != GROUNDED:
            return "released"
        return "bump stride" if self._record["bump"] else "grounded"

    @property
    def weight(self) -> float:
        """0 where the foot follows the animation, 1 where it is on its print."""
        return float(self._record["weight"])

    @property
    def locked(self) -> bool:
        """Whether a point of the sole is held still on the ground, and the leg reaches it."""
        return bool(self._record["locked"])

    @property
    def pinned(self) -> str | None:
        """The sole point that is held: "heel" or "ball"; None while the foot is on its way."""
        pin = int(self._record["pin"])
        return POINTS[pin] if pin >= 0 else None

    @property
    def reached(self) -> bool:
        """Whether the leg came to the goal, within 0.01 mm; a robot's within 0.1."""
        return bool(self._record["reached"])

    @property
    def stretch(self) -> float:
        """How many times its length the leg has: above 1 with `FootIKSettings.max_stretch` only."""
        return float(self._record["stretch"])

    @property
    def missing(self) -> float:
        """How far the foot is off its goal, m: where a point of its sole is held, that point."""
        return float(self._record["missing"])

    @property
    def turned_off(self) -> float:
        """By what angle the limits of a robot's joints keep the foot turned off its goal, rad."""
        return float(self._record["turned_off"])

    @property
    def goal_w(self) -> Array:
        """(3,) the ankle's goal, world, m."""
        return self._world(self._record["goal"])

    @property
    def goal_rotation_w(self) -> Array:
        """(4,) the sole's goal (x forward, z up), world, wxyz."""
        return quat_arrays.mul(self._crowd.frame, self._record["goal_turn"])

    @property
    def ankle_w(self) -> Array:
        """(3,) where the ankle is, world, m."""
        return self._world(self._record["out"])

    def _world(self, point: Array) -> Array:
        return quat_arrays.rotate(self._crowd.frame, point)

    @property
    def print_w(self) -> Array | None:
        """(3,) the print on the ground, under the ankle of a flat foot, world, m; or None."""
        if self._record["state"] != GROUNDED:
            return None
        point, _ = to_world(
            int(self._record["body"]),
            tuple(self._record["hold"]),
            tuple(self._record["hold_turn"]),
            *self._crowd.around,
        )
        return self._world(np.array(point))

    @property
    def ground(self) -> str | None:
        """The name of the geom it stands on ("geom 7" where it has none); None in the air."""
        geom = int(self._record["floor"])
        if self._record["state"] != GROUNDED or geom < 0:
            return None
        ground = self._crowd.ground
        named = ground.model.geom(geom).name if isinstance(ground, SceneGround) else ""
        return named or f"geom {geom}"

    def __str__(self) -> str:
        where = f" on {self.ground}" if self.ground else ""
        held = f", {self.pinned} held" if self.locked else ""
        return f"{self.name}: {self.state}{where}, weight {self.weight:.2f}{held}"


class HumanoidFootIK:
    """Walks a scene's character over its ground and writes its pose to MuJoCo, frame by frame.

    Attributes:
        scene: the model and data that are driven.
        settings: as given; make a new controller to change them.
        feet: one `FootTarget` a leg, live.
        crowd: the crowd of one that does the work.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        settings: FootIKSettings | None = None,
        passed: Sequence[str | int] = (),
    ) -> None:
        """Put the scene's character on its start.

        Args:
            scene: with a motion and a terrain.
            settings: of its feet.
            passed: geoms that are no ground, by name or id, whatever their group.
        """
        self.scene = scene
        self.settings = settings_or_default(settings)
        ground = scene.ground(self.settings.groups, passed=passed)
        self.crowd = Crowd(scene.motion, ground, settings=self.settings)
        legs = scene.motion.rig.legs
        self.feet = tuple(
            FootTarget(leg.name, self.crowd.feet[0, i : i + 1].reshape(()), self.crowd)
            for i, leg in enumerate(legs)
        )
        self._hinges = scene.hinge_pose()
        self._time = 0.0
        self._qpos = scene.data.qpos.copy()
        self.place(np.asarray(scene.terrain.start_w))

    @property
    def enabled(self) -> bool:
        """Whether feet are placed; without, the animation stays as it is.

        A switch is faded over `FootIKSettings.blend_time`; at once where `place` follows it.
        """
        return bool(self.crowd.bodies["enabled"][0])

    @enabled.setter
    def enabled(self, on: bool) -> None:
        self.crowd.bodies["enabled"] = int(bool(on))

    @property
    def time(self) -> float:
        """Seconds stepped so far."""
        return self._time

    @property
    def root_w(self) -> Array:
        """(3,) where the root is, on the ground, world, m."""
        return quat_arrays.rotate(self.crowd.frame, self.crowd.bodies["root"][0])

    @property
    def up(self) -> Array:
        """(3,) what is up, unit, world: settable at any time, as `Crowd.up`."""
        return self.crowd.up

    @up.setter
    def up(self, up_w: ArrayLike) -> None:
        if self._hinges is not None:
            raise FootIKError("up cannot be changed for a robot: its hinges are solved upright.")
        self.crowd.up = up_w

    @property
    def hips_move(self) -> bool:
        """Whether the hips are lowered, raised and balanced; settable, faded by their springs."""
        return bool(self.crowd.bodies["hips"][0])

    @hips_move.setter
    def hips_move(self, on: bool) -> None:
        self.crowd.bodies["hips"] = int(bool(on))

    @property
    def yaw(self) -> float:
        """Where the root faces, rad from +x, about what is up."""
        return float(self.crowd.bodies["yaw"][0])

    @property
    def hip_drop(self) -> float:
        """How far the hips are lowered, m; below 0, raised."""
        return float(self.crowd.bodies["hip_drop"][0])

    def foot(self, name: str) -> FootTarget:
        """The foot of a leg by name. Raises FootIKError, with the names there are."""
        for foot in self.feet:
            if foot.name == name:
                return foot
        raise unknown_name("foot", str(name), [foot.name for foot in self.feet])

    @property
    def rays(self) -> list[Ray]:
        """The rays of the last step that belong to feet, for drawing."""
        block, names = self.crowd.block, [foot.name for foot in self.feet]
        return cast_rays(block.probes[0], block.hits[0], names, self.crowd.frame)

    def balance(self) -> Balance:
        """Where the centre of mass is over the feet that stand, now."""
        return balance_over(self.scene, self.crowd)

    def place(self, at_w: ArrayLike, yaw: float = 0.0) -> None:
        """Put the character somewhere, (3,) m, facing yaw, rad; its feet are placed anew."""
        at, turned = _numbers(at_w), _numbers(yaw)
        if not (_are(at, (3,)) and _are(turned, ())):
            raise FootIKError(f"a place must be three finite numbers and a yaw, not {at_w}, {yaw}.")
        self.crowd.place(at, turned)
        self.crowd.step(0.0)  # a pose to write, and from which the first velocities are
        self._write(0.0)

    def command(self, velocity: ArrayLike, turn_rate: float = 0.0) -> None:
        """Where to go from now on: (forward, left) m/s in the root's frame, and rad/s."""
        way, turning = _numbers(velocity), _numbers(turn_rate)
        if not (_are(way, (2,)) and _are(turning, ())):
            raise FootIKError(
                "a command must be finite, (forward, left) and a turn rate, "
                f"not {velocity}, {turn_rate}."
            )
        self.crowd.command(way, turning)

    def follow(
        self, path_w: ArrayLike, *, speed: float | None = None, ahead: float | None = None
    ) -> bool:
        """Command what leads along a path (N, 2) of points on the ground, m, for the next step.

        Aims at the point of the path `ahead` metres on from the nearest one, by default 0.5 for a
        leg of 0.85 m and in proportion for others. Returns False, and commands a stop, once the
        end is nearer than half of that. Raises FootIKError as `steer_along` does.
        """
        motion = self.scene.motion
        pace = motion.speed if speed is None else speed
        sight = 0.5 * body_size(motion.rig) if ahead is None else ahead
        velocity, turn_rate = steer_along(path_w, self.root_w, self.yaw, pace, sight)
        self.command(velocity, turn_rate)
        return velocity != (0.0, 0.0) or turn_rate != 0.0

    def step(self, dt: float) -> None:
        """Advance by dt seconds, 0 or more: terrain, character, then qpos and a qvel to match.

        Kinematics are brought up to date; call `mujoco.mj_step` as well for loose objects.
        """
        check_dt(dt)
        self._time += dt
        self.scene.pose_terrain(self._time)
        self.crowd.step(dt)
        self._write(dt)

    def _write(self, dt: float) -> None:
        model, data, character = self.scene.model, self.scene.data, self.scene.character
        if self._hinges is not None:
            self._hinges.write(data, self.crowd, dt)
        elif isinstance(character, Character):
            if self.settings.max_stretch > 1.0:
                character.write_stretch(model, self.crowd.feet[0]["stretch"])
            character.write_pose(data, self.crowd.roots[0], self.crowd.rotations[0])
        # From the pose written last, not from what mj_step made of it since.
        character.write_pose_velocity(model, data, self._qpos, dt)
        self._qpos[:] = data.qpos
        mujoco.mj_kinematics(model, data)


def _numbers(value: ArrayLike) -> Array:
    """The value as numbers; one NaN where it holds anything else."""
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        return np.array(np.nan)


def _are(numbers: Array, shape: tuple[int, ...]) -> bool:
    return numbers.shape == shape and bool(np.isfinite(numbers).all())


def steer_along(
    path_w: ArrayLike, root_w: Array, yaw: float, speed: float, ahead: float
) -> tuple[tuple[float, float], float]:
    """Velocity in the root's frame, m/s, and turn rate, rad/s, that lead along a path (N, 2).

    Raises FootIKError unless the path's points are finite, two at least, speed is finite and 0 or
    more, and ahead, m, finite and more than 0.
    """
    path = _numbers(path_w)
    if path.ndim != 2 or path.shape[1] != 2 or len(path) < 2 or not np.isfinite(path).all():
        raise FootIKError(f"a path must be (N, 2) finite points, N at least 2, not {path.shape}.")
    if not (isinstance(speed, Real) and 0.0 <= speed < math.inf):
        raise FootIKError(f"speed must be 0 or more and finite, not {speed} m/s.")
    if not (isinstance(ahead, Real) and 0.0 < ahead < math.inf):
        raise FootIKError(f"ahead must be more than 0 and finite, not {ahead} m.")
    here = np.asarray(root_w)[:2]
    steps = np.diff(path, axis=0)
    lengths = np.maximum(np.hypot(*steps.T), 1e-9)
    along = np.clip(np.sum((here - path[:-1]) * steps, axis=1) / lengths**2, 0.0, 1.0)
    nearest = path[:-1] + along[:, None] * steps
    segment = int(np.argmin(np.hypot(*(nearest - here).T)))
    begins = np.concatenate([[0.0], np.cumsum(lengths)])
    at = begins[segment] + along[segment] * lengths[segment]
    if begins[-1] - at < 0.5 * ahead:
        return (0.0, 0.0), 0.0
    target = [np.interp(at + ahead, begins, path[:, k]) for k in range(2)]
    wanted = math.atan2(target[1] - here[1], target[0] - here[0])
    off = math.atan2(math.sin(wanted - yaw), math.cos(wanted - yaw))
    # Turn in place first where the way leads back.
    forward = speed * max(math.cos(off), 0.0)
    return (forward, 0.0), max(min(3.0 * off, 2.5), -2.5)
