"""Hinge values: the joint values with which a robot comes nearest to a clip of its bodies.

Every body's hinges are turned as the clip turns it; then each leg's bring the foot where the clip
has it. A clip that was read from the robot's own joint values gives them back.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays as qa
from footik_runtime.clip import Clip
from footik_runtime.compiled import compiled
from footik_runtime.errors import FootIKError
from footik_runtime.hinge_character import HingeCharacter
from footik_runtime.hinge_ik import (
    clamp_hinges,
    forward_hinges,
    goal_weights,
    new_work,
    solve_hinges,
)
from footik_runtime.math3d import get3, get4, quat_conj, quat_mul
from footik_runtime.motion import Motion
from footik_runtime.rig_model import find_rig_in_model

Array = NDArray[np.float64]

_NOWHERE, _UNTURNED = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)


@compiled
def _fit_bodies(hinges, first, local, values, work):
    """Turn each body's own hinges as near to its local rotation as they come."""
    for j in range(first.shape[0] - 1):
        low, high = first[j], first[j + 1]
        if high > low:
            solve_hinges(
                hinges[low:high], values[low:high], (_NOWHERE, _UNTURNED), _NOWHERE,
                (_NOWHERE, get4(local[j])), (0.0, 1.0), work,
            )  # fmt: skip


@compiled
def _fit_leg(leg, chain, length, root, root_turn, ankle, ankle_turn, angles, values, work):
    """Bring one leg's foot to an ankle's place and rotation, world."""
    trunk, count = leg["trunk"], leg["count"]
    for h in range(count):
        angles[h] = values[chain[h]["column"]]
    base = forward_hinges(chain[:trunk], angles[:trunk], root, root_turn, work.axes, work.anchors)
    goal = (ankle, quat_mul(ankle_turn, quat_conj(get4(leg["tail_turn"]))))
    weights = goal_weights(count - trunk, length, leg["point"])
    own = angles[trunk:count]
    solve_hinges(chain[trunk:count], own, base, get3(leg["tail"]), goal, weights, work)
    for h in range(trunk, count):
        values[chain[h]["column"]] = angles[h]


@compiled
def _fit_row(character, ankles, lengths, local, at, turn, angles, values, work):
    hinges, first, legs, chains = character
    _fit_bodies(hinges, first, local, values, work)
    for i in range(legs.shape[0]):
        ankle = ankles[i]
        _fit_leg(
            legs[i], chains[i], lengths[i], get3(at[0]), get4(turn[0]), get3(at[ankle]),
            get4(turn[ankle]), angles, values, work,
        )  # fmt: skip


def joint_values(character: HingeCharacter, clip: Clip) -> Array:
    """(T, N) rad: the character's hinges in each frame of a clip, each nearest the frame before.

    Raises FootIKError for a clip of another skeleton.
    """
    skeleton, rig = clip.skeleton, character.rig
    if skeleton.names != rig.skeleton.names:
        raise FootIKError(
            f"{clip.name}: its {len(skeleton)} joints are not the robot's "
            f"{len(rig.skeleton)} bodies."
        )
    at, turn = clip.model_pose()
    values = character.hinges["zero"].copy()
    clamp_hinges(character.hinges, values)
    most = max(character.chains.shape[1], int(np.diff(character.first).max()))
    angles, work = np.zeros(most), new_work(most)
    tables = (character.hinges, character.first, character.legs, character.chains)
    ankles = np.array([leg.ankle for leg in rig.legs])
    out = np.empty((len(clip), len(values)))
    # The first frame also settles the angles from which the others are the nearest.
    for frame in (0, *range(len(clip))):
        _fit_row(
            tables, ankles, rig.leg_lengths, clip.rotations[frame], at[frame], turn[frame],
            angles, values, work,
        )  # fmt: skip
        out[frame] = values
    return out


def posed_by_hinges(clip: Clip, model: mujoco.MjModel, character: HingeCharacter) -> Clip:
    """The clip with every body where the robot's joints, within their limits, can bring it.

    Feet that are points are level: how a ball is turned changes nothing.

    Args:
        clip: of the robot's bodies, whatever turns them.
        model: whose kinematics say where they come to.
        character: of that model.
    """
    values, data = joint_values(character, clip), mujoco.MjData(model)
    skeleton, start = clip.skeleton, character.root_address
    rest = skeleton.rest_rotations
    rotations, moves = clip.rotations.copy(), np.tile(skeleton.offsets, (len(clip), 1, 1))
    for frame, row in enumerate(values):
        data.qpos[start : start + 3] = clip.root_positions[frame]
        data.qpos[start + 3 : start + 7] = clip.rotations[frame, 0]
        data.qpos[character.addresses] = row
        for joint, address in zip(character.balls, character.ball_addresses, strict=True):
            data.qpos[address : address + 4] = qa.mul(qa.conj(rest[joint]), rotations[frame, joint])
        mujoco.mj_kinematics(model, data)
        heading = _heading(qa.mul(clip.rotations[frame, 0], qa.conj(rest[0])))
        turns = qa.mul(heading, character.legs["level"])
        at, turn = character.world_pose(data, turns)
        above = skeleton.parents[1:]
        rotations[frame, 1:] = qa.mul(qa.conj(turn[above]), turn[1:])
        moves[frame, 1:] = qa.rotate(qa.conj(turn[above]), at[1:] - at[above])
    still = np.abs(moves - skeleton.offsets).max(initial=0.0) < 1e-9
    return replace(clip, rotations=rotations, translations=None if still else moves)


def _heading(turn: Array) -> Array:
    ahead = qa.rotate(turn, np.array([1.0, 0.0, 0.0]))
    return qa.about(np.array([0.0, 0.0, 1.0]), np.arctan2(ahead[1], ahead[0]))


def hinge_motion(clip: Clip, model: mujoco.MjModel) -> Motion:
    """A clip of a robot's bodies as a motion that the robot's own joints can play.

    Args:
        clip: read from joint values of the model, or made for its bodies in any other way, as by
            `gait.walk`.
        model: compiled; its root is free and its legs are hinges.

    Raises:
        FootIKError: a model without legs of hinges, or a clip of another skeleton.
    """
    rig = find_rig_in_model(model)
    character = HingeCharacter.bind(model, rig)
    return Motion.prepare(posed_by_hinges(clip, model, character), rig)
