"""The skeleton of bodies in a MuJoCo model, and whether poses can be written to their joints."""

from __future__ import annotations

import mujoco
import numpy as np

from footik_runtime.errors import FootIKError, listed, unknown_name
from footik_runtime.skeleton import Skeleton

_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_BALL = int(mujoco.mjtJoint.mjJNT_BALL)


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
        root = body_id(model, root_body)
    elif free:
        root = max(free, key=lambda b: (len(_descendants(model, b)), -b))
    else:
        raise FootIKError("the model has no body with a free joint, so no character to drive.")
    bodies = _descendants(model, root)
    require_drivable(model, bodies)
    place = {body: i for i, body in enumerate(bodies)}
    parents = [-1] + [place[int(model.body_parentid[b])] for b in bodies[1:]]
    leaves = [i for i in range(len(bodies)) if i not in parents]
    tips = {i: 2.0 * model.body_ipos[bodies[i]] for i in leaves}
    return Skeleton(
        names=tuple(model.body(b).name or f"body{b}" for b in bodies),
        parents=np.array(parents, dtype=np.int32),
        offsets=model.body_pos[bodies].copy(),
        rest_rotations=model.body_quat[bodies].copy(),
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


def body_id(model: mujoco.MjModel, name: str) -> int:
    """The id of a body by name. Raises FootIKError, with the nearest name, where there is none."""
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    if body < 0:
        names = (model.body(b).name or f"body{b}" for b in range(1, model.nbody))
        raise unknown_name("body", name, names)
    return body


def require_same_tree(model: mujoco.MjModel, skeleton: Skeleton, bodies: list[int]) -> None:
    """Raise FootIKError unless each joint's body hangs on its parent's body."""
    for joint, parent in enumerate(skeleton.parents):
        above = int(model.body_parentid[bodies[joint]])
        if parent >= 0 and above != bodies[parent]:
            raise FootIKError(
                f"the rig is not this model's: joint {skeleton.names[joint]!r} hangs on "
                f"{skeleton.names[parent]!r}, its body on {model.body(above).name!r}."
            )


def require_drivable(model: mujoco.MjModel, bodies: list[int]) -> None:
    """Raise FootIKError unless the root is free and every body below has one ball joint or none."""
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
            "below the root each body may have one ball joint or none, but these are others: "
            f"{listed(joints)}. A robot with legs of hinges is driven by hinge_motion's motion."
        )
    balls = {int(model.body_jntadr[b]) for b in others if model.body_jntadr[b] >= 0}
    away = [model.joint(j).name for j in sorted(balls) if model.jnt_pos[j].any()]
    if away:
        raise FootIKError(f"ball joints must be at their body's origin: {listed(away)} are not.")
