"""Character: a skeleton as the bodies of a MuJoCo model, and poses written to its qpos.

Every joint is a body: the root has a free joint, the others a ball joint at their origin. A body
built here has no rest rotation of its own, so a ball joint's qpos is the clip's local rotation.
A clip's local translations are not written: bodies keep the skeleton's offsets.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from footik_runtime.anthropometry import find_anatomy, segment_masses
from footik_runtime.body_shapes import CAPSULE, Shape, body_shapes
from footik_runtime.compiled import compiled
from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.math3d import get3, get4, quat_conj, quat_mul, quat_to_rotvec, set3, set4
from footik_runtime.model_skeleton import (
    body_id,
    require_drivable,
    require_same_tree,
    skeleton_from_model,
)
from footik_runtime.rig import Leg, Rig
from footik_runtime.sole import all_sole_points

Array = NDArray[np.float64]
Color = tuple[float, float, float, float]

__all__ = [
    "CHARACTER_GROUP",
    "Character",
    "CharacterLook",
    "build_character",
    "model_path",
    "skeleton_from_model",
    "write_qpos",
]

CHARACTER_GROUP = 2
"""The geom group of characters: rays that look for ground leave it out."""

# Characters touch whatever has MuJoCo's default contype 1, but neither themselves nor each other.
_CONTYPE, _CONAFFINITY = 2, 1
# A joint without a shape, such as a bone of zero length: light, yet nothing that cannot move.
_BARE_MASS = 1e-3
_BARE_INERTIA = 1e-5
_IDENTITY = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class CharacterLook:
    """Colours, rgba from 0 to 1."""

    body: Color = (0.80, 0.80, 0.77, 1.0)
    left: Color = (0.52, 0.66, 0.72, 1.0)
    right: Color = (0.80, 0.67, 0.55, 1.0)
    dark: Color = (0.17, 0.21, 0.26, 1.0)


def model_path(name: str = "humanoid") -> Path:
    """Where one of the shipped models lies, in an installed wheel or a source checkout."""
    package = Path(__file__).resolve().parent
    folders = [package / "models", package.parent / "models"]
    found = {file.stem: file for folder in reversed(folders) for file in folder.glob("*.xml")}
    if name not in found:
        raise unknown_name("model", name, sorted(found))
    return found[name]


def build_character(
    spec: mujoco.MjSpec,
    rig: Rig,
    *,
    name: str = "character",
    mass: float | None = None,
    look: CharacterLook | None = None,
    afloat: bool = True,
) -> None:
    """Add a character to a scene: bodies, joints, shapes and masses, standing at the origin.

    Bodies, joints and materials are called `name/joint`, so that several fit one scene.

    Args:
        spec: the scene, not yet compiled.
        rig: the skeleton, and the legs that tell which way up its body is.
        name: of this character in the scene.
        mass: kg; for a biped by default 24.1 kg/m² times the square of its stature, else the
            density of water.
        look: its colours.
        afloat: gravity does not pull it, as suits a body whose pose is written every frame.

    Raises:
        FootIKError: the scene has a character of this name, or the mass is not positive.
    """
    if mass is not None and not (np.isfinite(mass) and mass > 0.0):
        raise FootIKError(f"{name}: mass must be positive and finite, not {mass} kg.")
    prefix = f"{name}/" if name else ""
    root = prefix + rig.skeleton.names[0]
    if spec.body(root) is not None:
        raise FootIKError(f"the scene has a body {root!r} already: name this character otherwise.")
    anatomy = find_anatomy(rig)
    shapes = body_shapes(rig, anatomy)
    volumes = np.zeros(len(rig.skeleton))
    for shape in shapes:
        volumes[shape.joint] += shape.volume if shape.solid else 0.0
    bare = (volumes <= 0.0).sum() * _BARE_MASS
    if mass is not None and mass <= bare:
        raise FootIKError(
            f"{name}: mass must be more than {bare:g} kg for this skeleton, not {mass}."
        )
    masses = segment_masses(anatomy, volumes, None if mass is None else mass - bare)
    bodies = _add_bodies(spec, rig, anatomy.positions, anatomy.rotations, prefix, afloat)
    for body, own_mass in zip(bodies, masses, strict=True):
        if own_mass <= 0.0:
            body.explicitinertial = True
            body.mass, body.inertia = _BARE_MASS, [_BARE_INERTIA] * 3
    _add_materials(spec, prefix, look or CharacterLook())
    for shape in shapes:
        share = shape.volume / volumes[shape.joint] if shape.solid else 0.0
        _add_geom(bodies[shape.joint], shape, prefix, float(masses[shape.joint] * share))


def _add_bodies(
    spec: mujoco.MjSpec, rig: Rig, positions: Array, rotations: Array, prefix: str, afloat: bool
) -> list:
    """A body with its joint for each joint of the skeleton; the rest pose's soles are at z = 0."""
    bodies = []
    heights = all_sole_points(rig, positions[None], rotations[None])[..., 2] if rig.legs else 0.0
    start = positions[0] - [0.0, 0.0, float(np.min(heights))]
    for joint, joint_name in enumerate(rig.skeleton.names):
        parent = int(rig.skeleton.parents[joint])
        above = spec.worldbody if parent < 0 else bodies[parent]
        at = start if parent < 0 else rig.skeleton.offsets[joint]
        body = above.add_body(name=prefix + joint_name, pos=at, gravcomp=float(afloat))
        if parent < 0:
            body.add_freejoint(name=prefix + joint_name)
        else:
            ball = body.add_joint(name=prefix + joint_name, type=mujoco.mjtJoint.mjJNT_BALL)
            ball.armature, ball.damping = 0.01, _damping(0.2)
        bodies.append(body)
    return bodies


def _damping(value: float) -> float | list[float]:
    """Joint damping as this MuJoCo's MjSpec has it: one number, or a polynomial's coefficients."""
    sample = mujoco.MjSpec().worldbody.add_body().add_joint().damping
    return value if np.ndim(sample) == 0 else [value] + [0.0] * (np.size(sample) - 1)


def _add_materials(spec: mujoco.MjSpec, prefix: str, look: CharacterLook) -> None:
    for tone in ("body", "left", "right", "dark"):
        spec.add_material(
            name=prefix + tone, rgba=getattr(look, tone), specular=0.25, shininess=0.35
        )


def _add_geom(body, shape: Shape, prefix: str, mass: float) -> None:
    kind = mujoco.mjtGeom(shape.kind)
    geom = body.add_geom(type=kind, pos=shape.position, quat=shape.rotation, mass=mass)
    geom.size = [*shape.size[:2], 0.0] if shape.kind == CAPSULE else shape.size
    geom.material = prefix + shape.tone
    geom.group = CHARACTER_GROUP
    geom.contype, geom.conaffinity = (_CONTYPE, _CONAFFINITY) if shape.solid else (0, 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Character:
    """Where a rig's joints live in a compiled model.

    Attributes:
        rig: the skeleton and its legs, J joints.
        bodies: (J,) int32 body ids.
        qpos_address: (J,) int32 of the free joint, then of each ball joint; -1 where a body is
            welded to its parent.
        dofs: (D,) int32, all the character's degrees of freedom.
        rest: (J, 4) the bodies' own rotations, wxyz, which their ball joints turn on top of;
            (0, 4) where all are identities.
    """

    rig: Rig
    bodies: NDArray[np.int32]
    qpos_address: NDArray[np.int32]
    dofs: NDArray[np.int32]
    rest: Array = field(default_factory=lambda: np.zeros((0, 4)))

    @classmethod
    def bind(cls, model: mujoco.MjModel, rig: Rig, name: str = "character") -> Character:
        """The character that `build_character` added under this name.

        Raises:
            FootIKError: a body is missing, or is not jointed as the skeleton is.
        """
        return cls._bound(model, rig, f"{name}/" if name else "")

    @classmethod
    def from_model(cls, model: mujoco.MjModel, rig: Rig) -> Character:
        """A character whose bodies have the names of the rig's joints, as of `models/`.

        Raises:
            FootIKError: a body is missing, or has other joints than a free root and balls.
        """
        return cls._bound(model, rig, "")

    @classmethod
    def _bound(cls, model: mujoco.MjModel, rig: Rig, prefix: str) -> Character:
        bodies = [body_id(model, prefix + joint_name) for joint_name in rig.skeleton.names]
        require_same_tree(model, rig.skeleton, bodies)
        require_drivable(model, bodies)
        joints = [int(model.body_jntadr[b]) for b in bodies]
        dofs = [np.arange(model.body_dofnum[b]) + model.body_dofadr[b] for b in bodies]
        rest = np.array([_IDENTITY, *(model.body_quat[b] for b in bodies[1:])])
        return cls(
            rig=rig,
            bodies=np.array(bodies, dtype=np.int32),
            qpos_address=np.array(
                [-1 if j < 0 else model.jnt_qposadr[j] for j in joints], dtype=np.int32
            ),
            dofs=np.concatenate(dofs).astype(np.int32),
            rest=np.zeros((0, 4)) if (rest == _IDENTITY).all() else rest,
        )

    def write_pose(self, data: mujoco.MjData, root_position_w: Array, rotations: Array) -> None:
        """Write one pose to qpos; call `mj_forward` or `mj_step` next.

        Args:
            data: whose qpos is written.
            root_position_w: (3,) of joint 0, m.
            rotations: (J, 4) local, wxyz, unit; row 0 is the root's world rotation.

        Raises:
            FootIKError: the pose is of another skeleton.
        """
        if rotations.shape != (len(self.qpos_address), 4) or root_position_w.shape != (3,):
            raise FootIKError(
                f"a pose of this character is ({len(self.qpos_address)}, 4) rotations and a (3,) "
                f"root, not {rotations.shape} and {root_position_w.shape}."
            )
        write_qpos(data.qpos, self.qpos_address, root_position_w, rotations, self.rest)

    def write_stretch(self, model: mujoco.MjModel, stretches: Array) -> None:
        """Make each leg's bones, from hip to ankle, as many times their length; kinematics next.

        Args:
            model: of the scene: its body_pos is written.
            stretches: (L,) of each leg.
        """
        offsets = stretched_offsets(self.rig, stretches)
        for leg in self.rig.legs:
            for joint in between(self.rig, leg):
                model.body_pos[self.bodies[joint]] = offsets[joint]

    def write_pose_velocity(
        self, model: mujoco.MjModel, data: mujoco.MjData, previous_qpos: Array, dt: float
    ) -> None:
        """Write to qvel what moves the character from `previous_qpos` to its qpos in dt.

        Other bodies keep their velocities.

        Args:
            model: of the scene.
            data: whose qvel is written.
            previous_qpos: (nq,) of the whole scene one frame ago.
            dt: seconds between the two poses; at 0 or below the velocity is zero.

        Raises:
            FootIKError: previous_qpos has another length than the model's qpos.
        """
        if previous_qpos.shape != (model.nq,):
            raise FootIKError(f"previous_qpos must be ({model.nq},), not {previous_qpos.shape}.")
        if not dt > 0.0:
            data.qvel[self.dofs] = 0.0
            return
        write_qvel(data.qvel, self.dofs, self.qpos_address, previous_qpos, data.qpos, dt)


def between(rig: Rig, leg: Leg) -> list[int]:
    """The joints below a leg's hip down to its ankle."""
    chain = rig.skeleton.chain(leg.ankle)
    return [joint for joint in chain if joint > leg.hip and leg.hip in rig.skeleton.chain(joint)]


def stretched_offsets(rig: Rig, stretches: Array) -> Array:
    """(J, 3) the skeleton's offsets, those of each leg's bones times its stretch (L,)."""
    offsets = rig.skeleton.offsets.copy()
    for leg, stretch in zip(rig.legs, stretches, strict=True):
        offsets[between(rig, leg)] *= stretch
    return offsets


@compiled
def write_qpos(qpos_row, address, root_position, rotations, rest):
    """Write one pose into one row of qpos.

    Args:
        qpos_row: (nq,) written in place.
        address: (J,) as `Character.qpos_address`.
        root_position: (3,) or a tuple, world, m.
        rotations: (J, 4) local, wxyz.
        rest: (J, 4) or (0, 4), as `Character.rest`.
    """
    set3(qpos_row[address[0] :], get3(root_position))
    set4(qpos_row[address[0] + 3 :], get4(rotations[0]))
    for j in range(1, address.shape[0]):
        if address[j] >= 0:
            q = get4(rotations[j])
            if rest.shape[0] > 0:
                q = quat_mul(quat_conj(get4(rest[j])), q)
            set4(qpos_row[address[j] :], q)


@compiled
def write_qvel(qvel_row, dofs, address, before, now, dt):
    """Write the velocity that leads from one row of qpos to another into one row of qvel.

    Args:
        qvel_row: (nv,) written in place.
        dofs, address: (D,) and (J,) as `Character.dofs` and `Character.qpos_address`.
        before, now: (nq,).
        dt: seconds between them, above 0.
    """
    for k in range(3):
        qvel_row[dofs[k]] = (now[address[0] + k] - before[address[0] + k]) / dt
    dof = 3
    for j in range(address.shape[0]):
        at = address[j] + 3 if j == 0 else address[j]
        if at >= 0:
            turn = quat_to_rotvec(quat_mul(quat_conj(get4(before[at:])), get4(now[at:])))
            for k in range(3):
                qvel_row[dofs[dof + k]] = turn[k] / dt
            dof += 3
