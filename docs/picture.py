"""Make docs/walk.png, the picture of the README: `python docs/picture.py [FILE]`.

The same walk over the same stairs and hills, without foot IK on the left and with it on the right.
Renders through MuJoCo, so it needs a GL: MUJOCO_GL=egl (or osmesa) where there is no display.
"""

from __future__ import annotations

import sys
from pathlib import Path

import mujoco
import numpy as np

from footik_runtime import HumanoidFootIK, Motion, Scene, find_rig, load_clip
from footik_runtime.builtin import HUMANOID, builtin_motion

SIZE = (640, 400)  # pixels of one panel
SHOTS = (("stairs", 2.62), ("slope", 5.2), ("hills", 4.4))  # terrain, seconds


def shot(terrain: str, seconds: float, ik: bool, clip: Path | None = None) -> np.ndarray:
    """One panel: the feet, close up, at a time of the walk."""
    if clip is None:
        scene = Scene.build(builtin_motion("walk"), terrain, body=HUMANOID)
    else:
        loaded = load_clip(clip)
        scene = Scene.build(Motion.prepare(loaded, find_rig(loaded.skeleton)), terrain)
    walker = HumanoidFootIK(scene)
    walker.enabled = ik
    for _ in range(round(seconds * 60)):
        walker.step(1.0 / 60.0)
    mujoco.mj_forward(scene.model, scene.data)
    camera = mujoco.MjvCamera()
    camera.lookat = walker.root_w + np.array([0.1, 0.0, 0.42])
    camera.distance, camera.azimuth, camera.elevation = 2.3, 118.0, -12.0
    scene.model.vis.global_.offwidth, scene.model.vis.global_.offheight = SIZE
    with mujoco.Renderer(scene.model, SIZE[1], SIZE[0]) as renderer:
        renderer.update_scene(scene.data, camera)
        return renderer.render().copy()


def main(target: Path, clip: Path | None = None) -> None:
    """Render every shot twice and put them into one image."""
    import matplotlib.image

    rows = [
        np.hstack([shot(terrain, at, ik, clip) for ik in (False, True)]) for terrain, at in SHOTS
    ]
    matplotlib.image.imsave(target, np.vstack(rows))


if __name__ == "__main__":
    given = [Path(argument) for argument in sys.argv[1:]]
    main(given[0] if given else Path(__file__).with_name("walk.png"), *given[1:2])
