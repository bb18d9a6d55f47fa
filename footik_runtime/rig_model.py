"""The rig of a MuJoCo model: legs found from its bodies, soles measured from its geoms."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.rig import (
    Leg,
    Rig,
    build_rig,
    chains_by_name,
    chains_by_shape,
    no_legs_error,
)
from footik_runtime.rig_names import SHIN_WORDS, read_name
from footik_runtime.rig_sole import TIP_PER_BALL, Sole
from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]


def find_rig_in_model(model: mujoco.MjModel, root_body: str | None = None) -> Rig:
    """The rig of a character among a model's bodies.

    The rig's skeleton has the bodies of one tree as joints, with their names and, as the rest
    pose, their places at qpos0. Where a robot's shin ends in a foot without a body of its own, a
    joint is added at the end of the list, at the shin's lowest geom, and noted.

    Args:
        model: a compiled model.
        root_body: name of the character's first body; by default the first child of the world
            whose tree has legs.

    Raises:
        FootIKError: unknown root_body, or no legs in the model.
    """
    roots = _roots(model, root_body)
    first_error: FootIKError | None = None
    for root in roots:
        bodies = _tree(model, root)
        skeleton = _skeleton(model, bodies)
        rig = _rig_of(model, skeleton, bodies)
        if rig is not None:
            return rig
        first_error = first_error or no_legs_error(skeleton, "MuJoCo model's body tree")
    raise first_error or FootIKError("the MuJoCo model has no bodies, so no legs.")


def _name(model: mujoco.MjModel, body: int) -> str:
    return model.body(body).name or f"body{body}"


def _roots(model: mujoco.MjModel, root_body: str | None) -> list[int]:
    names = [_name(model, b) for b in range(1, model.nbody)]
    if root_body is not None:
        if root_body not in names:
            raise unknown_name("body", root_body, names)
        return [names.index(root_body) + 1]
    children = [b for b in range(1, model.nbody) if model.body_parentid[b] == 0]
    return sorted(children, key=lambda b: -len(_tree(model, b)))


def _tree(model: mujoco.MjModel, root: int) -> list[int]:
    """The body and all below it, parents first."""
    inside = [root]
    for body in range(root + 1, model.nbody):
        if model.body_parentid[body] in inside:
            inside.append(body)
    return inside


def _skeleton(model: mujoco.MjModel, bodies: list[int]) -> Skeleton:
    index = {body: joint for joint, body in enumerate(bodies)}
    return Skeleton(
        names=tuple(_name(model, b) for b in bodies),
        parents=np.array([-1] + [index[int(model.body_parentid[b])] for b in bodies[1:]]),
        offsets=np.array(model.body_pos[bodies]),
        rest_rotations=np.array(model.body_quat[bodies]),
    )


def _rig_of(model: mujoco.MjModel, skeleton: Skeleton, bodies: list[int]) -> Rig | None:
    for labels in (list(skeleton.names), [_joint_label(model, b) for b in bodies]):
        notes: list[str] = []
        grown, grown_labels, added = _with_feet(model, skeleton, bodies, labels, notes)
        pose = grown.rest_pose()
        chains = chains_by_name(grown, grown_labels, pose[0], notes)
        if chains:
            break
    else:
        notes = []
        grown, added, pose = skeleton, {}, skeleton.rest_pose()
        chains = chains_by_shape(grown, pose[0], notes)
    if not chains:
        return None
    rig = build_rig(grown, chains, pose, notes)
    return _with_measured_soles(model, rig, pose, bodies, added)


def _joint_label(model: mujoco.MjModel, body: int) -> str:
    """The name of a body's first joint; its own where it has none."""
    if model.body_jntnum[body] == 0:
        return _name(model, body)
    return model.joint(int(model.body_jntadr[body])).name or _name(model, body)


def _geoms(model: mujoco.MjModel, bodies: list[int]) -> list[int]:
    """The geoms of these bodies that can touch; all of them where none can."""
    geoms = [g for g in range(model.ngeom) if int(model.geom_bodyid[g]) in bodies]
    touching = [g for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g]]
    return touching or geoms


def _with_feet(
    model: mujoco.MjModel,
    skeleton: Skeleton,
    bodies: list[int],
    labels: list[str],
    notes: list[str],
) -> tuple[Skeleton, list[str], dict[int, int]]:
    """The skeleton with a foot joint below each shin that ends its tree, and joint -> its geom."""
    positions, rotations = skeleton.rest_pose()
    names, parents = list(skeleton.names), list(skeleton.parents)
    offsets, labels = list(skeleton.offsets), list(labels)
    added: dict[int, int] = {}
    for joint, body in enumerate(bodies):
        label = read_name(labels[joint])
        geoms = _geoms(model, [body])
        if label.word not in SHIN_WORDS or not label.side or skeleton.children(joint) or not geoms:
            continue
        turn = _matrix(rotations[joint])
        lowest = min(geoms, key=lambda g: _lowest_end(model, g, turn, positions[joint]))
        added[len(names)] = lowest
        parents.append(joint)
        offsets.append(_lower_centre(model, lowest, turn))
        names.append(f"{names[joint]}_foot")
        labels.append(f"{label.side}_{label.end}_foot")
        notes.append(f"{names[joint]!r} ends in a foot without a body; joint {names[-1]!r} added")
    rest = np.vstack([skeleton.rest_rotations, np.tile([1.0, 0.0, 0.0, 0.0], (len(added), 1))])
    grown = Skeleton(
        names=tuple(names),
        parents=np.array(parents),
        offsets=np.array(offsets),
        rest_rotations=rest,
    )
    return grown, labels, added


def _matrix(rotation: Array) -> Array:
    out = np.zeros(9)
    mujoco.mju_quat2Mat(out, np.asarray(rotation, dtype=np.float64))
    return out.reshape(3, 3)


def _lowest_end(model: mujoco.MjModel, geom: int, turn: Array, place: Array) -> float:
    """Height of a geom's lowest point, for a body turned by `turn` (3, 3) at `place`."""
    down = np.array([[0.0, 0.0, -1.0]])
    return -float(_reach(model, geom, turn, place, down)[0])


def _lower_centre(model: mujoco.MjModel, geom: int, turn: Array) -> Array:
    """Centre of a geom, or of a capsule's lower cap, in its body's frame, m."""
    centre = np.array(model.geom_pos[geom])
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE:
        axis = _matrix(model.geom_quat[geom])[:, 2] * model.geom_size[geom, 1]
        centre += axis if (turn @ axis)[2] < 0.0 else -axis
    return centre


def _reach(model: mujoco.MjModel, geom: int, turn: Array, place: Array, directions: Array) -> Array:
    """How far a geom reaches along each unit direction (D, 3), from the origin, m: (D,)."""
    kind = model.geom_type[geom]
    size = model.geom_size[geom]
    centre = place + turn @ model.geom_pos[geom]
    local = directions @ (turn @ _matrix(model.geom_quat[geom]))
    types = mujoco.mjtGeom
    if kind == types.mjGEOM_SPHERE:
        extent = np.full(len(local), size[0])
    elif kind == types.mjGEOM_CAPSULE:
        extent = size[0] + size[1] * np.abs(local[:, 2])
    elif kind == types.mjGEOM_CYLINDER:
        extent = size[0] * np.hypot(local[:, 0], local[:, 1]) + size[1] * np.abs(local[:, 2])
    elif kind == types.mjGEOM_ELLIPSOID:
        extent = np.linalg.norm(local * size, axis=1)
    elif kind == types.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        extent = (local @ model.mesh_vert[start : start + count].astype(np.float64).T).max(axis=1)
    else:  # a box, or whatever has half sizes
        extent = np.abs(local) @ size
    return directions @ centre + extent


def _with_measured_soles(
    model: mujoco.MjModel,
    rig: Rig,
    pose: tuple[Array, Array],
    bodies: list[int],
    added: dict[int, int],
) -> Rig:
    """The rig with each sole's numbers taken from the foot's geoms, where it has some."""
    legs, measured = [], []
    for leg in rig.legs:
        foot = leg.ankle
        if foot in added:
            geoms = {added[foot]: int(rig.skeleton.parents[foot])}
        else:
            below = [j for j in range(len(bodies)) if foot in rig.skeleton.chain(j)]
            touching = _geoms(model, [bodies[j] for j in below])
            geoms = {g: bodies.index(int(model.geom_bodyid[g])) for g in touching}
        if geoms:
            sole = _measured_sole(model, leg, pose, geoms, pose[0][foot])
            leg = replace(leg, sole=sole)
            measured.append(leg.name)
        legs.append(leg)
    guesses = tuple(f"{name}: " for name in measured)
    notes = [note for note in rig.notes if not note.startswith(guesses)]
    if measured:
        notes.append(f"soles of {', '.join(measured)} measured from the geoms of the feet")
    return replace(rig, legs=tuple(legs), notes=tuple(notes))


def _measured_sole(
    model: mujoco.MjModel,
    leg: Leg,
    pose: tuple[Array, Array],
    geoms: dict[int, int],
    origin: Array,
) -> Sole:
    """The sole whose extents are those of the geoms (geom -> joint) in the leg's sole frame."""
    positions, rotations = pose
    axes = (_matrix(rotations[leg.ankle]) @ _matrix(leg.sole.frame)).T
    directions = np.vstack([axes, -axes])
    reach = np.max(
        [
            _reach(model, g, _matrix(rotations[j]), positions[j] - origin, directions)
            for g, j in geoms.items()
        ],
        axis=0,
    )
    tip, left, _, heel, right, height = (float(r) for r in reach)
    tip = max(tip, 0.0)
    ball = tip / TIP_PER_BALL
    if leg.toe >= 0:
        ahead = float(axes[0] @ (positions[leg.toe] - origin))
        ball = ahead if 0.0 < ahead <= tip else ball
    return replace(
        leg.sole,
        height=max(height, 0.0),
        heel=max(heel, 0.0),
        ball=ball,
        tip=tip,
        half_width=max(0.5 * (left + right), 0.0),
    )
