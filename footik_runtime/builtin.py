"""The built-in characters: our own humanoid and quadruped, and their gaits, ready to walk."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import mujoco

from footik_runtime import gait, gait_quadruped
from footik_runtime.character import model_path
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.motion import Motion
from footik_runtime.rig import Rig
from footik_runtime.rig_model import find_rig_in_model

HUMANOID = model_path("humanoid")
"""The MJCF file of the built-in humanoid."""

QUADRUPED = model_path("quadruped")
"""The MJCF file of the built-in quadruped."""


@cache
def humanoid_rig() -> Rig:
    """The rig of `models/humanoid.xml`."""
    return find_rig_in_model(mujoco.MjModel.from_xml_path(str(HUMANOID)))


@cache
def quadruped_rig() -> Rig:
    """The rig of `models/quadruped.xml`."""
    return find_rig_in_model(mujoco.MjModel.from_xml_path(str(QUADRUPED)))


def _idle(rig: Rig, speed: float | None) -> Clip:
    if speed:
        raise FootIKError(f"idle goes nowhere: its speed is 0, not {speed} m/s.")
    return gait.idle(rig)


def _turn(rig: Rig, speed: float | None) -> Clip:
    if speed:
        raise FootIKError(f"turn goes nowhere: its speed is 0, not {speed} m/s.")
    return gait.turn_in_place(rig)


_BIPED: dict[str, Callable[[Rig, float | None], Clip]] = {
    "walk": lambda rig, speed: gait.walk(rig, speed=1.3 if speed is None else speed),
    "run": lambda rig, speed: gait.run(rig, speed=3.0 if speed is None else speed),
    "idle": _idle,
    "turn": _turn,
}
_QUADRUPED: dict[str, Callable[[Rig, float | None], Clip]] = {
    "quadruped walk": lambda rig, speed: gait_quadruped.quadruped_walk(
        rig, speed=1.0 if speed is None else speed
    ),
    "trot": lambda rig, speed: gait_quadruped.trot(rig, speed=2.0 if speed is None else speed),
}

GAITS: dict[str, Callable[[Rig, float | None], Clip]] = _BIPED | _QUADRUPED
"""Name -> the clip of a rig at a speed, m/s; None for its usual one."""


def builtin_motion(name: str = "walk", *, speed: float | None = None) -> Motion:
    """A gait by name, of the built-in character that has it.

    Raises FootIKError for a name there is not.
    """
    rig = quadruped_rig() if builtin_body(name) == QUADRUPED else humanoid_rig()
    return Motion.prepare(GAITS[name](rig, speed), rig)


def builtin_body(name: str = "walk") -> Path:
    """The MJCF file of the built-in character that has a gait, for `Scene.build`.

    Raises FootIKError for a name there is not.
    """
    if name not in GAITS:
        raise unknown_name("gait", name, GAITS)
    return QUADRUPED if name in _QUADRUPED else HUMANOID
