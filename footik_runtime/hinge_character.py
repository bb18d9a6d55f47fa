"""HingeCharacter: a robot's joints in a MuJoCo model, and the hinges of each of its legs.

The root has a free joint. Between it and the feet there are hinges only; elsewhere there may be
ball joints, which take a pose's rotations, and slides, which stay where the model has them.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays as qa
from footik_runtime.errors import FootIKError, listed
from footik_runtime.hinge_ik import HINGE
from footik_runtime.model_skeleton import body_id
from footik_runtime.rig import Leg, Rig

Array = NDArray[np.float64]

_FREE, _BALL, _SLIDE, _HINGE = (
    int(kind)
    for kind in (
        mujoco.mjtJoint.mjJNT_FREE,
        mujoco.mjtJoint.mjJNT_BALL,
        mujoco.mjtJoint.mjJNT_SLIDE,
        mujoco.mjtJoint.mjJNT_HINGE,
    )
)
_AT_ANKLE = 1e-6  # m: a ball so near the ankle is about it

HINGE_LEG = np.dtype(
    [
        ("trunk", "i4"),
        ("count", "i4"),
        ("point", "i4"),
        ("tail", "f8", 3),
        ("tail_turn", "f8", 4),
        ("level", "f8", 4),
    ],
    align=True,
)
"""One leg of hinges.

count: of the hinges from the root to the ankle, the first `trunk` of which are not the leg's own.
point: the foot is a ball about the ankle, whose rotation changes nothing. tail, tail_turn: the
ankle's frame in that of the last hinge's body. level: rotation of the sole at rest, world.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class HingeCharacter:
    """Where a robot's joints live in a compiled model: J rig joints, N hinges, L legs.

    Attributes:
        rig: the skeleton and its legs.
        bodies: (J,) int32 body ids; -1 for a foot that the rig added to a shin.
        root_address: of the free joint in qpos.
        hinges: (N,) of `HINGE`, body by body, each body's in the frame of the one above.
        first: (J + 1,) int32: joint j's are hinges[first[j]:first[j + 1]].
        addresses: (N,) int32 of the hinges in qpos.
        balls: (B,) int32 rig joints that are ball joints; ball_addresses: (B,) int32 in qpos.
        legs: (L,) of `HINGE_LEG`; chains: (L, most) of `HINGE`, each leg's from the root on.
        dofs: (D,) int32, all the character's degrees of freedom.
    """

    rig: Rig
    bodies: NDArray[np.int32]
    root_address: int
    hinges: NDArray[np.void]
    first: NDArray[np.int32]
    addresses: NDArray[np.int32]
    balls: NDArray[np.int32]
    ball_addresses: NDArray[np.int32]
    legs: NDArray[np.void]
    chains: NDArray[np.void]
    dofs: NDArray[np.int32]

    @classmethod
    def bind(cls, model: mujoco.MjModel, rig: Rig, name: str = "") -> HingeCharacter:
        """The character whose bodies have the names of the rig's joints, after `name/` if any.

        Raises:
            FootIKError: a body is missing or hangs elsewhere than its joint, the root is not free,
                or something but hinges is between the root and a foot.
        """
        bodies = _bodies(model, rig, f"{name}/" if name else "")
        _require_same_tree(model, rig, bodies)
        own = [_joints(model, body) for body in bodies]
        _require_joints(model, rig, own)
        hinges = [[j for j in joints if model.jnt_type[j] == _HINGE] for joints in own]
        flat = [j for joints in hinges for j in joints]
        first = np.cumsum([0, *map(len, hinges)])
        balls = [k for k, joints in enumerate(own) if any(model.jnt_type[joints] == _BALL)]
        legs, chains = _legs(model, rig, bodies, hinges, first)
        there = bodies[bodies >= 0]
        dofs = [np.arange(model.body_dofnum[b]) + model.body_dofadr[b] for b in there]
        return cls(
            rig=rig,
            bodies=bodies,
            root_address=int(model.jnt_qposadr[own[0][0]]),
            hinges=_body_hinges(model, rig, hinges, first),
            first=first.astype(np.int32),
            addresses=model.jnt_qposadr[flat].astype(np.int32),
            balls=np.array(balls, dtype=np.int32),
            ball_addresses=np.array([model.jnt_qposadr[own[k][0]] for k in balls], dtype=np.int32),
            legs=legs,
            chains=chains,
            dofs=np.concatenate(dofs).astype(np.int32),
        )

    def world_pose(self, data: mujoco.MjData, point_turns: Array) -> tuple[Array, Array]:
        """Positions (J, 3), m, and rotations (J, 4) of all joints as MuJoCo has them now.

        Args:
            data: whose kinematics are up to date.
            point_turns: (L, 4) the soles' world rotations of feet that are points.
        """
        skeleton = self.rig.skeleton
        positions, rotations = data.xpos[self.bodies].copy(), data.xquat[self.bodies].copy()
        for j in np.flatnonzero(self.bodies < 0):
            above = int(skeleton.parents[j])
            positions[j] = positions[above] + qa.rotate(rotations[above], skeleton.offsets[j])
            rotations[j] = qa.mul(rotations[above], skeleton.rest_rotations[j])
        for leg, record, turn in zip(self.rig.legs, self.legs, point_turns, strict=True):
            if record["point"]:
                rotations[leg.ankle] = qa.mul(turn, qa.conj(leg.sole.frame))
        return positions, rotations

    def write_pose_velocity(
        self, model: mujoco.MjModel, data: mujoco.MjData, previous_qpos: Array, dt: float
    ) -> None:
        """Write to qvel what moves the character from `previous_qpos` to its qpos in dt, s.

        Other bodies keep their velocities. At a dt of 0 or below the velocity is zero. Raises
        FootIKError where previous_qpos (nq,) has another length than the model's qpos.
        """
        if previous_qpos.shape != (model.nq,):
            raise FootIKError(f"previous_qpos must be ({model.nq},), not {previous_qpos.shape}.")
        velocity = np.zeros(model.nv)
        if dt > 0.0:
            mujoco.mj_differentiatePos(model, velocity, dt, previous_qpos, data.qpos)
        data.qvel[self.dofs] = velocity[self.dofs]


def has_hinges(model: mujoco.MjModel, rig: Rig, name: str = "") -> bool:
    """Whether the bodies named as the rig's joints, after `name/` if any, are on hinges."""
    bodies = _bodies(model, rig, f"{name}/" if name else "")
    return any(_HINGE in model.jnt_type[_joints(model, body)] for body in bodies[1:])


def _bodies(model: mujoco.MjModel, rig: Rig, prefix: str) -> NDArray[np.int32]:
    """Body ids; -1 for the joints that `rig_model` adds, which come last and end their tree."""
    names, found = rig.skeleton.names, []
    for joint, name in enumerate(names):
        id_ = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, prefix + name)
        above = int(rig.skeleton.parents[joint])
        added = id_ < 0 and above >= 0 and name == f"{names[above]}_foot"
        found.append(-1 if added else body_id(model, prefix + name))
    return np.array(found, dtype=np.int32)


def _joints(model: mujoco.MjModel, body: int) -> list[int]:
    if body < 0:
        return []
    first = int(model.body_jntadr[body])
    return list(range(first, first + int(model.body_jntnum[body])))


def _named(model: mujoco.MjModel, joints: list[int]) -> str:
    return listed(model.joint(j).name or f"joint{j}" for j in joints)


def _require_same_tree(model: mujoco.MjModel, rig: Rig, bodies: NDArray[np.int32]) -> None:
    for joint, above in enumerate(rig.skeleton.parents):
        if above < 0 or bodies[joint] < 0:
            continue
        theirs = int(model.body_parentid[bodies[joint]])
        if theirs != bodies[above]:
            raise FootIKError(
                f"the rig is not this model's: joint {rig.skeleton.names[joint]!r} hangs on "
                f"{rig.skeleton.names[above]!r}, its body on {model.body(theirs).name!r}."
            )


def _require_joints(model: mujoco.MjModel, rig: Rig, own: list[list[int]]) -> None:
    names = rig.skeleton.names
    if [int(model.jnt_type[j]) for j in own[0]] != [_FREE]:
        raise FootIKError(f"body {names[0]!r} must have a free joint: it is the robot's root.")
    for joints in own[1:]:
        kinds = model.jnt_type[joints]
        if _BALL in kinds and len(kinds) > 1:
            raise FootIKError(
                f"a ball joint must be its body's only joint: {_named(model, joints)} are together."
            )
    for leg in rig.legs:
        path = [j for k in rig.skeleton.chain(leg.ankle) if k > 0 for j in own[k]]
        other = [j for j in path if model.jnt_type[j] != _HINGE]
        if other or not path:
            raise FootIKError(
                f"the {leg.name} leg must be moved by hinges alone, from the root to the foot: "
                + (f"{_named(model, other)} are not." if other else "it has no joint.")
            )


def _hinge(model: mujoco.MjModel, j: int, column: int, place: Array, turn: Array) -> NDArray:
    """The record of a model's joint, its body unturned at a place in the frame before it."""
    out = np.zeros((), dtype=HINGE)
    out["place"], out["turn"] = place, turn
    out["axis"], out["anchor"] = model.jnt_axis[j], model.jnt_pos[j]
    out["zero"], out["column"] = model.qpos0[model.jnt_qposadr[j]], column
    limits = model.jnt_range[j] if model.jnt_limited[j] else (-np.inf, np.inf)
    out["low"], out["high"] = limits
    return out


_NOWHERE, _UNTURNED = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])


def _body_hinges(
    model: mujoco.MjModel, rig: Rig, hinges: list[list[int]], first: NDArray
) -> NDArray[np.void]:
    out = np.zeros(int(first[-1]), dtype=HINGE)
    for k, joints in enumerate(hinges):
        rest = (rig.skeleton.offsets[k], rig.skeleton.rest_rotations[k])
        for n, j in enumerate(joints):
            frame = rest if n == 0 else (_NOWHERE, _UNTURNED)
            out[first[k] + n] = _hinge(model, j, int(first[k]) + n, *frame)
    return out


def _legs(
    model: mujoco.MjModel,
    rig: Rig,
    bodies: NDArray[np.int32],
    hinges: list[list[int]],
    first: NDArray,
) -> tuple[NDArray[np.void], NDArray[np.void]]:
    skeleton = rig.skeleton
    chains = [skeleton.chain(leg.ankle) for leg in rig.legs]
    most = max(sum(len(hinges[k]) for k in chain) for chain in chains)
    legs, out = np.zeros(len(chains), dtype=HINGE_LEG), np.zeros((len(chains), most), dtype=HINGE)
    positions, rotations = skeleton.rest_pose()
    for i, leg in enumerate(rig.legs):
        shared = {k for chain in chains[:i] + chains[i + 1 :] for k in chain} | {0}
        count, place, turn = 0, _NOWHERE, _UNTURNED
        for k in sorted(set(chains[i]) - {0}):
            place = place + qa.rotate(turn, skeleton.offsets[k])
            turn = qa.mul(turn, skeleton.rest_rotations[k])
            for n, j in enumerate(hinges[k]):
                out[i, count] = _hinge(model, j, int(first[k]) + n, place, turn)
                count, place, turn = count + 1, _NOWHERE, _UNTURNED
        legs[i]["count"], legs[i]["tail"], legs[i]["tail_turn"] = count, place, turn
        legs[i]["trunk"] = sum(len(hinges[k]) for k in chains[i] if k in shared)
        legs[i]["point"] = _is_point(model, leg, rig, bodies, positions)
        legs[i]["level"] = qa.mul(rotations[leg.ankle], leg.sole.frame)
    return legs, out


def _is_point(
    model: mujoco.MjModel, leg: Leg, rig: Rig, bodies: NDArray[np.int32], positions: Array
) -> bool:
    """Whether the foot is a ball, or a capsule's round end, about the ankle joint."""
    skeleton = rig.skeleton
    added = bodies[leg.ankle] < 0
    joint = int(skeleton.parents[leg.ankle]) if added else leg.ankle
    centre = skeleton.offsets[leg.ankle] if added else np.zeros(3)
    round_, other = False, False
    for g in np.flatnonzero(model.geom_bodyid == bodies[joint]):
        if not (model.geom_contype[g] or model.geom_conaffinity[g]):
            continue
        about = bool(np.linalg.norm(_ends(model, int(g)) - centre, axis=-1).min() < _AT_ANKLE)
        round_, other = round_ or about, other or not about
    below = [k for k in range(len(positions)) if k != joint and joint in skeleton.chain(k)]
    return round_ and (added or not (other or below))


def _ends(model: mujoco.MjModel, geom: int) -> Array:
    """(N, 3) centres of a sphere or of a capsule's ends, in its body's frame; none of others."""
    kind, at = model.geom_type[geom], np.array(model.geom_pos[geom])
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return at[None]
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        along = qa.rotate(model.geom_quat[geom], np.array([0.0, 0.0, model.geom_size[geom, 1]]))
        return np.stack([at + along, at - along])
    return np.full((1, 3), np.inf)
