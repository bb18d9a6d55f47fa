"""A MuJoCo model's bodies as a skeleton, and rows of qpos as its local transforms."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays as qa
from footik_runtime.errors import FootIKError
from footik_runtime.rig import Rig
from footik_runtime.rig_model import find_rig_in_model
from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]

FREE, BALL, SLIDE, HINGE = (
    int(kind)
    for kind in (
        mujoco.mjtJoint.mjJNT_FREE,
        mujoco.mjtJoint.mjJNT_BALL,
        mujoco.mjtJoint.mjJNT_SLIDE,
        mujoco.mjtJoint.mjJNT_HINGE,
    )
)
WIDTHS = {FREE: 7, BALL: 4, SLIDE: 1, HINGE: 1}
"""Joint kind -> numbers it has in qpos."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelJoint:
    """One joint of a model.

    column: its first number's place in qpos; speed_column: in qvel. axis, anchor: (3,) in its
    body's frame. low, high: rad or m, infinite where it has no limits. zero: the value at which the
    body is as the model says.
    """

    name: str
    kind: int
    column: int
    speed_column: int
    axis: Array
    anchor: Array
    low: float
    high: float
    zero: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Tree:
    """One tree of a model's bodies.

    Attributes:
        skeleton: its bodies, and foot joints that the rig added below shins that end it.
        rig: its legs, or None where it has none.
        joints: (J,) the joints of each skeleton joint's body, outermost first.
        rest: (nq,) the model's qpos0.
        speeds: numbers in a row of qvel.
    """

    skeleton: Skeleton
    rig: Rig | None
    joints: tuple[tuple[ModelJoint, ...], ...]
    rest: Array
    speeds: int

    @property
    def width(self) -> int:
        """Numbers in a row of qpos."""
        return len(self.rest)

    def named(self) -> dict[str, ModelJoint]:
        """Name -> joint of the tree."""
        return {joint.name: joint for joints in self.joints for joint in joints}


def tree_of(model: mujoco.MjModel) -> Tree:
    """The tree with legs; else the largest. Raises FootIKError for a model without bodies."""
    rig: Rig | None
    try:
        rig = find_rig_in_model(model)
        skeleton = rig.skeleton
    except FootIKError:
        rig, skeleton = None, _largest(model)
    joints = tuple(_joints(model, name) for name in skeleton.names)
    return Tree(
        skeleton=skeleton, rig=rig, joints=joints, rest=np.array(model.qpos0), speeds=int(model.nv)
    )


def _body_name(model: mujoco.MjModel, body: int) -> str:
    return model.body(body).name or f"body{body}"


def _largest(model: mujoco.MjModel) -> Skeleton:
    trees: dict[int, list[int]] = {}
    for body in range(1, model.nbody):
        trees.setdefault(int(model.body_rootid[body]), []).append(body)
    if not trees:
        raise FootIKError("the MuJoCo model has no bodies, so nothing that qpos could move.")
    bodies = max(trees.values(), key=len)
    place = {body: i for i, body in enumerate(bodies)}
    return Skeleton(
        names=tuple(_body_name(model, b) for b in bodies),
        parents=np.array([-1] + [place[int(model.body_parentid[b])] for b in bodies[1:]]),
        offsets=np.array(model.body_pos[bodies]),
        rest_rotations=np.array(model.body_quat[bodies]),
    )


def _joints(model: mujoco.MjModel, name: str) -> tuple[ModelJoint, ...]:
    """The joints of the body of that name; none for one that the rig added."""
    names = {_body_name(model, body): body for body in range(1, model.nbody)}
    if name not in names:
        return ()
    first, count = (int(model.body_jntadr[names[name]]), int(model.body_jntnum[names[name]]))
    return tuple(_joint(model, first + i) for i in range(count))


def _joint(model: mujoco.MjModel, j: int) -> ModelJoint:
    limited = bool(model.jnt_limited[j])
    low, high = model.jnt_range[j] if limited else (-np.inf, np.inf)
    column = int(model.jnt_qposadr[j])
    return ModelJoint(
        name=model.joint(j).name or f"joint{j}",
        kind=int(model.jnt_type[j]),
        column=column,
        speed_column=int(model.jnt_dofadr[j]),
        axis=np.array(model.jnt_axis[j]),
        anchor=np.array(model.jnt_pos[j]),
        low=float(low),
        high=float(high),
        zero=float(model.qpos0[column]),
    )


def locals_of(tree: Tree, qpos: Array) -> tuple[Array, Array, Array | None]:
    """Root positions (T, 3), local rotations (T, J, 4), and translations (T, J, 3) if they move.

    As MuJoCo has it: a body's joints act one after the other, each about its own anchor.
    """
    skeleton = tree.skeleton
    moves = np.tile(skeleton.offsets, (len(qpos), 1, 1))
    turns = np.tile(skeleton.rest_rotations, (len(qpos), 1, 1))
    for j, joints in enumerate(tree.joints):
        if joints:
            moves[:, j], turns[:, j] = body_pose(joints, qpos, moves[:, j], turns[:, j])
    still = np.abs(moves[:, 1:] - skeleton.offsets[1:]).max(initial=0.0) < 1e-12
    return moves[:, 0], turns, None if still else moves


def body_pose(
    joints: tuple[ModelJoint, ...], qpos: Array, place: Array, turn: Array
) -> tuple[Array, Array]:
    """Place (T, 3) and rotation (T, 4) of a body whose joints have these values (T, nq)."""
    for joint in joints:
        value = qpos[:, joint.column : joint.column + WIDTHS[joint.kind]]
        if joint.kind == FREE:
            place, turn = value[:, :3], qa.unit(value[:, 3:])
        elif joint.kind == SLIDE:
            place = place + qa.rotate(turn, joint.axis * (value - joint.zero))
        else:
            anchor = place + qa.rotate(turn, joint.anchor)
            own = (
                qa.unit(value)
                if joint.kind == BALL
                else qa.about(joint.axis, value[:, 0] - joint.zero)
            )
            turn = qa.mul(turn, own)
            place = anchor - qa.rotate(turn, joint.anchor)
    return place, turn
