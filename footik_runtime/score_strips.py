"""Score strips: the feet of a score scene close up, frame by frame, without foot IK and with it."""

from __future__ import annotations

import io
import re
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from footik_runtime.errors import FootIKError
from footik_runtime.files import write_whole
from footik_runtime.humanoid import HumanoidFootIK
from footik_runtime.plot import require_plot
from footik_runtime.scene import Scene
from footik_runtime.score_scenes import ScoreScene
from footik_runtime.settings import body_size

Pixels = NDArray[np.uint8]

SHOTS = 6
"""Pictures of one strip, over one cycle of the motion."""

_SIZE = (320, 240)  # pixels of one picture
_BEGIN = 4.0  # s into the walk
_HZ = 60.0


def strip_name(scene: ScoreScene) -> str:
    """The file's name of a scene's strip."""
    return re.sub(r"[^a-z0-9]+", "-", scene.name.lower()).strip("-") + ".png"


def write_strip(folder: Path, scene: ScoreScene) -> Path:
    """Render one scene's strip into a folder: above without foot IK, below with it.

    Returns the file. Raises FootIKError where MuJoCo finds no GL, or there is no matplotlib.
    """
    path = folder / strip_name(scene)
    require_plot(path)
    import matplotlib.image

    rows = [np.hstack(_shots(scene, ik)) for ik in (False, True)]
    image = io.BytesIO()
    matplotlib.image.imsave(image, np.vstack(rows), format="png")
    write_whole(path, image.getvalue())
    return path


def _shots(scene: ScoreScene, ik: bool) -> list[Pixels]:
    """The pictures of one cycle."""
    motion = scene.motion()
    built = Scene.build(motion, scene.terrain(), body=scene.body)
    walker = HumanoidFootIK(built)
    walker.enabled = ik
    built.model.vis.global_.offwidth, built.model.vis.global_.offheight = _SIZE
    every = max(motion.clip.duration / SHOTS, 2.0 / _HZ)
    times = [_BEGIN + k * every for k in range(SHOTS)]
    out: list[Pixels] = []
    with _renderer(built.model) as renderer:
        for frame in range(round(times[-1] * _HZ) + 1):
            if scene.drive is not None:
                walker.command(*scene.drive(frame / _HZ))
            walker.step(1.0 / _HZ)
            if len(out) < SHOTS and frame / _HZ >= times[len(out)] - 0.5 / _HZ:
                mujoco.mj_forward(built.model, built.data)
                renderer.update_scene(built.data, _camera(walker))
                out.append(renderer.render().copy())
    return out


def _renderer(model: mujoco.MjModel) -> mujoco.Renderer:
    try:
        return mujoco.Renderer(model, _SIZE[1], _SIZE[0])
    except Exception as error:  # each GL fails in its own way
        raise FootIKError(
            f"MuJoCo cannot render here: {error}. Without a display, set MUJOCO_GL to egl or "
            "osmesa."
        ) from None


def _camera(walker: HumanoidFootIK) -> mujoco.MjvCamera:
    """A view of the feet from the side and a little above."""
    size = body_size(walker.scene.motion.rig)
    camera = mujoco.MjvCamera()
    camera.lookat = walker.root_w + np.array([0.0, 0.0, 0.22 * size])
    camera.distance, camera.elevation = 1.9 * size, -8.0
    camera.azimuth = 100.0 + np.degrees(walker.yaw)
    return camera
