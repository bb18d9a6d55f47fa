"""Scene: terrain and a character compiled into one MuJoCo model, ready to be walked."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from footik_runtime.character import Character, build_character
from footik_runtime.ground import SceneGround
from footik_runtime.motion import Motion
from footik_runtime.terrain import Terrain, make_terrain


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """A MuJoCo model with a terrain and one character, and what moves in it.

    Attributes:
        model: compiled.
        data: of that model; its qpos is written every frame.
        terrain: whose `move` poses what moves by itself.
        motion: what the character does.
        character: where its joints are in qpos.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    terrain: Terrain
    motion: Motion
    character: Character

    @classmethod
    def build(cls, motion: Motion, terrain: Terrain | str = "flat", *, seed: int = 0) -> Scene:
        """Compile a terrain, or one by name, with a character of the motion's skeleton on it.

        Raises FootIKError for the name of a terrain there is not.
        """
        if isinstance(terrain, str):
            terrain = make_terrain(terrain, seed=seed)
        spec = mujoco.MjSpec()
        terrain.add_to(spec)
        build_character(spec, motion.rig)
        model = spec.compile()
        data = mujoco.MjData(model)
        terrain.move(model, data, 0.0)
        mujoco.mj_kinematics(model, data)
        return cls(
            model=model,
            data=data,
            terrain=terrain,
            motion=motion,
            character=Character.bind(model, motion.rig),
        )

    def pose_terrain(self, time: float) -> None:
        """Put what moves by itself where it is at a time, s, and update the scene's geometry."""
        if not self.terrain.static:
            self.terrain.move(self.model, self.data, time)
            mujoco.mj_kinematics(self.model, self.data)

    def ground(self, groups: tuple[int, ...] = (0,)) -> SceneGround:
        """What rays see of this scene."""
        return SceneGround(self.model, self.data, groups=groups)
