"""Scene: terrain and a character compiled into one MuJoCo model, ready to be walked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from footik_runtime.character import CHARACTER_GROUP, Character, build_character
from footik_runtime.errors import FootIKError, listed
from footik_runtime.ground import SceneGround
from footik_runtime.hinge_character import HingeCharacter, has_hinges
from footik_runtime.hinge_pose import HingePose
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
        character: where its joints are in qpos; of a robot, its hinges.
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    terrain: Terrain
    motion: Motion
    character: Character | HingeCharacter

    @classmethod
    def build(
        cls,
        motion: Motion,
        terrain: Terrain | str = "flat",
        *,
        seed: int = 0,
        body: str | Path | None = None,
        loose: Callable[[mujoco.MjSpec], None] = lambda spec: None,
    ) -> Scene:
        """Compile a terrain, or one by name, with a character of the motion's skeleton on it.

        Args:
            motion: what the character does.
            terrain: one, or the name of one in `TERRAINS`.
            seed: of a terrain by name.
            body: an MJCF file of a character whose bodies have the names of the skeleton's joints,
                such as the built-in one's, or of a robot with legs of hinges, whose motion
                `hinge_motion` makes; otherwise one of capsules is made. Of a robot's file its
                first body is taken, and its geoms are put where rays do not see them.
            loose: adds whatever else shall be in the scene, before it is compiled.

        Raises:
            FootIKError: no terrain of that name, a body that does not fit the skeleton, or a scene
                that MuJoCo cannot compile.
        """
        if not isinstance(terrain, Terrain):
            terrain = make_terrain(terrain, seed=seed)
        if not isinstance(motion, Motion):
            raise FootIKError(f"a scene needs a Motion, not {motion!r}.")
        spec = mujoco.MjSpec()
        terrain.add_to(spec)
        if body is None:
            build_character(spec, motion.rig)
        else:
            _attach(spec, Path(body), motion.rig.skeleton.names[0])
        loose(spec)
        try:
            model = spec.compile()
        except ValueError as error:
            raise FootIKError(f"MuJoCo cannot compile this scene: {error}.") from None
        data = mujoco.MjData(model)
        terrain.move(model, data, 0.0)
        mujoco.mj_kinematics(model, data)
        return cls(
            model=model,
            data=data,
            terrain=terrain,
            motion=motion,
            character=_bound(model, motion),
        )

    def hinge_pose(self) -> HingePose | None:
        """What writes a robot's pose, with nothing known of its feet; None for other characters."""
        if isinstance(self.character, HingeCharacter):
            return HingePose(self.character, self.motion)
        return None

    def pose_terrain(self, time: float) -> None:
        """Put what moves by itself where it is at a time, s, and update the scene's geometry."""
        if not self.terrain.static:
            self.terrain.move(self.model, self.data, time)
            mujoco.mj_kinematics(self.model, self.data)

    def ground(
        self, groups: tuple[int, ...] | None = None, *, passed: Sequence[str | int] = ()
    ) -> SceneGround:
        """What rays see of this scene: these geom groups, or those of a crowd's settings.

        Never the character itself, nor the geoms in `passed`, by name or id. Raises FootIKError
        where nothing else has geoms in these groups, or for a geom that there is not.
        """
        theirs = np.isin(self.model.geom_bodyid, self.character.bodies)
        passed = [*passed, *(int(geom) for geom in np.flatnonzero(theirs))]
        seen = SceneGround(self.model, self.data, groups=groups, passed=passed)
        there = self.model.geom_group[~theirs]
        if not np.isin(there, seen.groups).any():
            names = [f"{group} ({(there == group).sum()})" for group in np.unique(there)]
            raise FootIKError(
                f"there is no ground in the geom groups {listed(map(str, seen.groups))}: what is "
                f"not the character's is in {listed(names) or 'none'}."
            )
        return seen


def _bound(model: mujoco.MjModel, motion: Motion) -> Character | HingeCharacter:
    if has_hinges(model, motion.rig, "character"):
        return HingeCharacter.bind(model, motion.rig, "character")
    return Character.bind(model, motion.rig)


def _attach(spec: mujoco.MjSpec, file: Path, root: str) -> None:
    """Add the body of that name, with all below it; a character of balls with its whole file."""
    try:
        child = mujoco.MjSpec.from_file(str(file))
        body = child.body(root)
        if body is None or not _on_hinges(body):
            spec.attach(child, prefix="character/", frame=spec.worldbody.add_frame())
            return
        for geom in body.find_all(mujoco.mjtObj.mjOBJ_GEOM):
            geom.group = CHARACTER_GROUP
        child.option, child.visual = spec.option, spec.visual  # the scene's count
        spec.worldbody.add_frame().attach_body(body, "character/", "")
    except ValueError as error:
        raise FootIKError(f"{file}: MuJoCo cannot read this model: {error}.") from None


def _on_hinges(body: mujoco.MjsBody) -> bool:
    kinds = {joint.type for joint in body.find_all(mujoco.mjtObj.mjOBJ_JOINT)}
    return mujoco.mjtJoint.mjJNT_HINGE in kinds
