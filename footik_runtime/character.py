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

from footik_runtime.anthropometry import find_anatomy, segment_masses, turned
from footik_runtime.body_shapes import CAPSULE, Shape, body_shapes
from footik_runtime.compiled import compiled
from footik_runtime.errors import FootIKError, listed, unknown_name
from footik_runtime.math3d import get3, get4, quat_conj, quat_mul, set3, set4
from footik_runtime.rig import Rig
from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]
Color = tuple[float, float, float, float]

CHARACTER_GROUP = 2
"""The geom group of characters: rays that look for ground leave it out."""

# Characters touch whatever has MuJoCo's default contype 1, but neither themselves nor each other.
_CONTYPE, _CONAFFINITY = 2, 1
# A joint without a shape, such as a bone of zero length: light, yet nothing that cannot move.
_BARE_MASS = 1e-3
_BARE_INERTIA = 1e-5
_IDENTITY = (1.0, 0.0, 0.0, 0.0)
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_BALL = int(mujoco.mjtJoint.mjJNT_BALL)


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
    soles = [
        (positions[leg.ankle] + turned(_times(rotations[leg.ankle], leg.sole.frame), down))[2]
        for leg in rig.legs
        for down in (np.array([0.0, 0.0, -leg.sole.height]),)
    ]
    start = positions[0] - [0.0, 0.0, min(soles, default=0.0)]
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


def _times(a: Array, b: Array) -> Array:
    product = np.empty(4)
    mujoco.mju_mulQuat(product, np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64))
    return product


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
        bodies = [_body_id(model, prefix + joint_name) for joint_name in rig.skeleton.names]
        _require_same_tree(model, rig.skeleton, bodies)
        _require_drivable(model, bodies)
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
        if np.shape(rotations) != (len(self.qpos_address), 4) or np.shape(root_position_w) != (3,):
            raise FootIKError(
                f"a pose of this character is ({len(self.qpos_address)}, 4) rotations and a (3,) "
                f"root, not {np.shape(rotations)} and {np.shape(root_position_w)}."
            )
        write_qpos(data.qpos, self.qpos_address, root_position_w, rotations, self.rest)

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
        if np.shape(previous_qpos) != (model.nq,):
            raise FootIKError(
                f"previous_qpos must be ({model.nq},), not {np.shape(previous_qpos)}."
            )
        if not dt > 0.0:
            data.qvel[self.dofs] = 0.0
            return
        velocity = np.empty(model.nv)
        mujoco.mj_differentiatePos(model, velocity, dt, previous_qpos, data.qpos)
        data.qvel[self.dofs] = velocity[self.dofs]


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


def skeleton_from_model(model: mujoco.MjModel, root_body: str | None = None) -> Skeleton:
    """The skeleton of a model's bodies: a free root, and at most one ball joint each below it.

    The bodies' own rotations become rest rotations. A leaf's tip is guessed as twice the way to
    its centre of mass.

    Args:
        model: compiled.
        root_body: name of the body with the free joint; by default the one that carries most.

    Raises:
        FootIKError: no such body, no free joint, or joints that this cannot drive.
    """
    free = [b for b in range(1, model.nbody) if _joint_types(model, b) == [_FREE]]
    if root_body is not None:
        root = _body_id(model, root_body)
    elif free:
        root = max(free, key=lambda b: (len(_descendants(model, b)), -b))
    else:
        raise FootIKError("the model has no body with a free joint, so no character to drive.")
    bodies = _descendants(model, root)
    _require_drivable(model, bodies)
    place = {body: i for i, body in enumerate(bodies)}
    parents = [-1] + [place[int(model.body_parentid[b])] for b in bodies[1:]]
    leaves = [i for i in range(len(bodies)) if i not in parents]
    tips = {i: 2.0 * model.body_ipos[bodies[i]] for i in leaves}
    # A free joint's qpos replaces the root body's own rotation, as row 0 of a pose does.
    rest = model.body_quat[bodies].copy()
    return Skeleton(
        names=tuple(model.body(b).name or f"body{b}" for b in bodies),
        parents=np.array(parents, dtype=np.int32),
        offsets=model.body_pos[bodies].copy(),
        rest_rotations=rest,
        tips={i: tip for i, tip in tips.items() if np.linalg.norm(tip) > 1e-6},
    )


def _descendants(model: mujoco.MjModel, root: int) -> list[int]:
    inside = {root}
    for body in range(root + 1, model.nbody):
        if int(model.body_parentid[body]) in inside:
            inside.add(body)
    return sorted(inside)


def _joint_types(model: mujoco.MjModel, body: int) -> list[int]:
    first = int(model.body_jntadr[body])
    return [int(model.jnt_type[first + i]) for i in range(model.body_jntnum[body])]


def _body_id(model: mujoco.MjModel, name: str) -> int:
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    if body < 0:
        names = (model.body(b).name or f"body{b}" for b in range(1, model.nbody))
        raise unknown_name("body", name, names)
    return body


def _require_same_tree(model: mujoco.MjModel, skeleton: Skeleton, bodies: list[int]) -> None:
    for joint, parent in enumerate(skeleton.parents):
        above = int(model.body_parentid[bodies[joint]])
        if parent >= 0 and above != bodies[parent]:
            raise FootIKError(
                f"the rig is not this model's: joint {skeleton.names[joint]!r} hangs on "
                f"{skeleton.names[parent]!r}, its body on {model.body(above).name!r}."
            )


def _require_drivable(model: mujoco.MjModel, bodies: list[int]) -> None:
    """A free root, and below it no joint or one ball joint at each body's origin."""
    root, others = bodies[0], bodies[1:]
    if _joint_types(model, root) != [_FREE]:
        raise FootIKError(f"body {model.body(root).name!r} must have a free joint: it is the root.")
    bad = [b for b in others if _joint_types(model, b) not in ([], [_BALL])]
    if bad:
        joints = [
            model.joint(int(model.body_jntadr[b]) + i).name or f"a joint of {model.body(b).name!r}"
            for b in bad
            for i in range(model.body_jntnum[b])
        ]
        raise FootIKError(
            "hinge-jointed robots are not driven yet: below the root each body may have one ball "
            f"joint or none, but these are others: {listed(joints)}."
        )
    balls = {int(model.body_jntadr[b]) for b in others if model.body_jntadr[b] >= 0}
    away = [model.joint(j).name for j in sorted(balls) if model.jnt_pos[j].any()]
    if away:
        raise FootIKError(f"ball joints must be at their body's origin: {listed(away)} are not.")
