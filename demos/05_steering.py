"""Send the character along a path, and push a loose ball that lies in its way."""

import mujoco
import numpy as np

import footik_runtime as footik
from footik_runtime.builtin import HUMANOID, builtin_motion


def ball(spec: mujoco.MjSpec) -> None:
    """A ball on the way."""
    body = spec.worldbody.add_body(name="ball", pos=[1.5, 0.1, 0.12])
    body.add_freejoint()
    body.add_geom(size=[0.12, 0, 0], mass=0.4, group=3)


scene = footik.Scene.build(builtin_motion("walk"), "flat", body=HUMANOID, loose=ball)
walker = footik.HumanoidFootIK(scene)
path = np.array([[0.0, 0.0], [2.5, 0.0], [4.0, 1.5], [4.0, 3.0]])
steps = 0
while walker.follow(path, speed=1.2) and steps < 600:
    walker.step(1 / 60)
    for _ in range(8):
        mujoco.mj_step(scene.model, scene.data)
    steps += 1
print(f"arrived at {walker.root_w[:2].round(2)} after {steps / 60:.1f} s")
print("the ball lies at", scene.data.body("ball").xpos.round(2))
