"""What the simulation tests share: ground made to measure, and soles as the character has them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from footik_runtime.builtin import HUMANOID
from footik_runtime.humanoid import HumanoidFootIK
from footik_runtime.motion import Motion
from footik_runtime.scene import Scene
from footik_runtime.settings import FootIKSettings
from footik_runtime.sole import all_sole_points
from footik_runtime.terrain import Terrain
from footik_runtime.terrain.piece import Piece

Array = NDArray[np.float64]
Taken = dict[str, NDArray[Any]]

DT = 1.0 / 60.0
FAR_AWAY = 100.0  # m


def stand_on(
    motion: Motion,
    *pieces: Piece,
    loose: Callable[[mujoco.MjSpec], None] = lambda spec: None,
    settings: FootIKSettings | None = None,
) -> HumanoidFootIK:
    """A controller of the built-in character at the origin, on pieces laid from x = -4 on."""
    terrain = Terrain(name="made to measure", pieces=pieces)
    scene = Scene.build(motion, terrain, body=HUMANOID, loose=loose)
    return HumanoidFootIK(scene, settings=settings)


def soles(ik: HumanoidFootIK) -> Array:
    """(legs, 3, 3) heel, ball and tip of each foot now, world, m."""
    rig = ik.scene.motion.rig
    pose = rig.skeleton.forward(ik.crowd.rotations[:1], ik.crowd.roots[:1])
    return all_sole_points(rig, *pose)[0]


def over_ground(ik: HumanoidFootIK) -> Array:
    """(legs, 3) height of each sole point over what a ray finds under it, m; NaN over nothing."""
    points = soles(ik)
    return points[..., 2] - ik.scene.ground().height(points, above=0.2)


def run(ik: HumanoidFootIK, seconds: float, dt: float = DT) -> Taken:
    """Step on, and return what was recorded: soles (T, legs, 3, 3), feet (T, legs), hips (T,)."""
    frames = round(seconds / dt)
    points, feet, drops = [], [], []
    for _ in range(frames):
        ik.step(dt)
        points.append(soles(ik))
        feet.append(ik.crowd.feet[0].copy())
        drops.append(ik.hip_drop)
    return {"soles": np.array(points), "feet": np.array(feet), "drops": np.array(drops)}


def largest_step(points: Array) -> float:
    """Longest way of any point between two frames, m; points (T, ..., 3)."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=-1).max())


def add_slab(spec: mujoco.MjSpec, name: str = "slab", top: float = 0.0) -> None:
    """A slab on a mocap body, 2 m by 2 m around the origin, that a test can move as it likes."""
    body = spec.worldbody.add_body(name=name, mocap=True, pos=[0.0, 0.0, top])
    body.add_geom(
        name=f"{name}/box",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[1.0, 1.0, 0.1],
        pos=[0.0, 0.0, -0.1],
    )
