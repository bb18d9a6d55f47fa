"""A changed clip as rows of qpos: free and ball joints directly, hinges by solving for the pose."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays as qa
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.formats.qpos_tree import BALL, FREE, HINGE, SLIDE, ModelJoint, Tree
from footik_runtime.offline.hinge_legs import Hinge, Link, solve_hinges

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

_UNREACHED = 1e-3  # m: a foot farther off than this is reported
_UNTURNED = 1e-3  # rad


def qpos_of(clip: Clip, before: Clip, tree: Tree, qpos: Array) -> tuple[Array, dict[str, Any]]:
    """Rows of qpos that pose the model as a clip does, and what they do not reach.

    Args:
        clip: changed from `before`, frame by frame.
        before: the clip that `qpos` poses.
        tree: of both.
        qpos: (T, nq); values of what did not change are taken from it to the last bit.

    Returns:
        (T, nq), and {"legs": {name: {"hinges": number, "largest_off": m, "largest_turned_off": rad,
        "unreached_frames": frames in which it is more than 1 mm off}}, "unreached_frames": those in
        which some foot is, "stiff": joints whose change the model has no joint for}.

    Raises:
        FootIKError: a clip of other joints or frames.
    """
    if clip.skeleton.names != tree.skeleton.names or len(clip) != len(before):
        raise FootIKError(
            f"{clip.name}: its joints or frames ({len(clip)}) are no longer those of the joint "
            f"values it came from ({len(before)} frames)."
        )
    out = qpos.copy()
    turned = _turned(clip.rotations, before.rotations)
    moved = (clip.root_positions != before.root_positions).any(axis=-1)
    _set_root(clip, before, tree, out, moved, turned[:, 0])
    report: dict[str, Any] = {"legs": {}, "unreached_frames": 0, "stiff": []}
    done = {0}
    if tree.rig is not None and turned[:, 1:].any():
        done |= _set_legs(clip, before, tree, out, turned, report)
    for j in sorted(set(range(len(tree.skeleton))) - done):
        if turned[:, j].any() and not _set_joint(clip, tree, j, out, turned[:, j]):
            report["stiff"].append(tree.skeleton.names[j])
    return out, report


def qvel_of(tree: Tree, qvel: Array, change: Array, fps: float) -> Array:
    """Velocities (T, nv) of rows of qpos that changed by (T, nq): of places, slides and hinges.

    Those of ball joints and of a free root's rotation are left as they are.
    """
    out = qvel.astype(np.float64)
    if len(change) < 2:
        return out
    for joint in (joint for joints in tree.joints for joint in joints):
        width = {FREE: 3, SLIDE: 1, HINGE: 1}.get(joint.kind, 0)
        own = change[:, joint.column : joint.column + width]
        if own.any():
            rate = np.gradient(own, axis=0) * fps
            out[:, joint.speed_column : joint.speed_column + width] += rate
    return out


def _turned(a: Array, b: Array) -> Bools:
    """(T, J) where rotations differ, by more than their sign."""
    return ~((a == b).all(axis=-1) | (a == -b).all(axis=-1))


def _set_root(
    clip: Clip, before: Clip, tree: Tree, out: Array, moved: Bools, turned: Bools
) -> None:
    joints = tree.joints[0]
    if joints and joints[0].kind == FREE:
        start = joints[0].column
        out[moved, start : start + 3] = clip.root_positions[moved]
        change = qa.mul(clip.rotations[turned, 0], qa.conj(before.rotations[turned, 0]))
        out[turned, start + 3 : start + 7] = qa.unit(
            qa.mul(change, out[turned, start + 3 : start + 7])
        )
        return
    if turned.any():
        _set_hinges(tree, 0, out, turned, clip.rotations[:, 0])
    rest = tree.skeleton.rest_rotations[0]
    for joint in joints:
        if joint.kind == SLIDE:
            step = clip.root_positions[moved] - before.root_positions[moved]
            out[moved, joint.column] += step @ qa.rotate(rest, joint.axis)


def _set_legs(
    clip: Clip, before: Clip, tree: Tree, out: Array, turned: Bools, report: dict[str, Any]
) -> set[int]:
    """Solve every leg made of hinges where it changed; returns the joints that are done."""
    rig = tree.rig
    assert rig is not None
    positions, rotations = clip.model_pose()
    off = np.zeros(len(clip), dtype=bool)
    done: set[int] = set()
    for leg in rig.legs:
        chain = _own_chain(tree, leg.ankle, [each.ankle for each in rig.legs if each is not leg])
        joints = [joint for j in chain for joint in tree.joints[j]]
        if not joints or any(joint.kind != HINGE for joint in joints):
            continue
        done |= set(chain)
        frames = np.flatnonzero(turned[:, chain].any(axis=-1))
        if len(frames) == 0:
            continue
        above = int(tree.skeleton.parents[chain[0]])
        cells = np.ix_(frames, np.array([joint.column for joint in joints]))
        solved = solve_hinges(
            _links(tree, chain, joints),
            out[cells],
            (positions[frames, above], rotations[frames, above]),
            (positions[frames, leg.ankle], rotations[frames, leg.ankle]),
            _limits(joints),
        )
        out[cells] = solved.angles
        off[frames] |= solved.off > _UNREACHED
        report["legs"][leg.name] = {
            "hinges": len(joints),
            "largest_off": float(solved.off.max()),
            "largest_turned_off": float(solved.turned_off.max()),
            "unreached_frames": int((solved.off > _UNREACHED).sum()),
        }
    report["unreached_frames"] = int(off.sum())
    return done


def _own_chain(tree: Tree, ankle: int, others: list[int]) -> list[int]:
    """The joints from below the first one that another leg shares down to the ankle."""
    shared = {j for other in others for j in tree.skeleton.chain(other)} | {0}
    return [j for j in tree.skeleton.chain(ankle) if j not in shared][::-1]


def _links(tree: Tree, chain: list[int], joints: list[ModelJoint]) -> tuple[Link, ...]:
    return tuple(
        Link(
            offset=tree.skeleton.offsets[j],
            turn=tree.skeleton.rest_rotations[j],
            hinges=tuple(
                Hinge(column=joints.index(m), axis=m.axis, anchor=m.anchor, zero=m.zero)
                for m in tree.joints[j]
                if m.kind == HINGE
            ),
        )
        for j in chain
    )


def _limits(joints: list[ModelJoint]) -> tuple[Array, Array]:
    return np.array([j.low for j in joints]), np.array([j.high for j in joints])


def _set_joint(clip: Clip, tree: Tree, j: int, out: Array, turned: Bools) -> bool:
    """Write one body's rotation where it changed; False where its joints cannot have it."""
    joints = tree.joints[j]
    rest = tree.skeleton.rest_rotations[j]
    if len(joints) == 1 and joints[0].kind == BALL:
        column = joints[0].column
        wanted = qa.mul(qa.conj(rest), clip.rotations[turned, j])
        near = np.sum(wanted * out[turned, column : column + 4], axis=-1, keepdims=True) >= 0.0
        out[turned, column : column + 4] = qa.unit(wanted * np.where(near, 1.0, -1.0))
        return True
    return _set_hinges(tree, j, out, turned, clip.rotations[:, j])


def _set_hinges(tree: Tree, j: int, out: Array, turned: Bools, rotations: Array) -> bool:
    """Turn one body's own hinges as near to its local rotations (T, 4) as they can come."""
    hinges = [joint for joint in tree.joints[j] if joint.kind == HINGE]
    if not hinges:
        return False
    frames = np.flatnonzero(turned)
    cells = np.ix_(frames, np.array([joint.column for joint in hinges]))
    nowhere = np.zeros((len(frames), 3))
    solved = solve_hinges(
        _links(tree, [j], hinges),
        out[cells],
        (nowhere, np.tile([1.0, 0.0, 0.0, 0.0], (len(frames), 1))),
        (nowhere, rotations[frames]),
        _limits(hinges),
        turn_only=True,
    )
    out[cells] = solved.angles
    return bool(solved.turned_off.max() <= _UNTURNED)
