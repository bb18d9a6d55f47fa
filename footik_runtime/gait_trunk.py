"""Trunk of a quadruped's gait: root, chest, rump, neck and tail, found by topology, and turned.

Turns are world rotations on top of the rest pose: yaw, pitch (nose down) and roll, rad. Frame: x
the way of travel, y left, z up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays as qa
from footik_runtime.gait_limbs import Limb
from footik_runtime.gait_poses import RestShape
from footik_runtime.rig import Leg, Rig
from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]

_MIDDLE = 0.06  # leg lengths: a joint so near the middle plane is central


@dataclass(frozen=True, kw_only=True)
class Trunk:
    """The joints that carry the legs, and what hangs on them, by index.

    Attributes:
        root: the rig's hips.
        chest, rump: what carries the front and the hind legs; the root where nothing else does.
        neck: from the chest to the head, chest excluded.
        tail: from the rump to the tail's end, rump excluded.
    """

    root: int
    chest: int
    rump: int
    neck: tuple[int, ...] = ()
    tail: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class TrunkMotion:
    """How the trunk moves over n frames.

    Attributes:
        place: (n, 3) of the root joint from its mean travel, z over ground, m.
        trunk, chest, rump, head, tail: (n, 3) yaw, pitch, roll, rad.
    """

    place: Array
    trunk: Array
    chest: Array
    rump: Array
    head: Array
    tail: Array


def find_trunk(rig: Rig, rest: RestShape) -> Trunk:
    """The trunk of a rig whose legs are two in front and two behind."""
    chest = _carrier(rig.skeleton, rig.hips, rig.legs[:2])
    rump = _carrier(rig.skeleton, rig.hips, rig.legs[2:])
    return Trunk(
        root=rig.hips,
        chest=chest,
        rump=rump,
        neck=_central(rig, rest, chest, 1.0),
        tail=_central(rig, rest, rump, -1.0),
    )


def _carrier(skeleton: Skeleton, root: int, legs: tuple[Leg, ...]) -> int:
    """The last joint above both legs, not above the root."""
    chains = [skeleton.chain(leg.hip)[1:] for leg in legs]
    common = [joint for joint in chains[0] if joint in chains[1]]
    return common[0] if common and root in skeleton.chain(common[0]) else root


def _central(rig: Rig, rest: RestShape, carrier: int, way: float) -> tuple[int, ...]:
    """The central chain from a carrier, itself excluded, that leads farthest ahead or back."""
    middle = np.mean([rest.positions[leg.hip, 1] for leg in rig.legs])
    near = np.abs(rest.positions[:, 1] - middle) < _MIDDLE * rest.leg_length
    best: list[int] = []
    farthest = way * rest.positions[carrier, 0] + 0.1 * rest.leg_length
    for joint in range(len(rig.skeleton)):
        chain = rig.skeleton.chain(joint)
        if carrier not in chain[1:]:
            continue
        chain = chain[: chain.index(carrier)]
        if near[chain].all() and way * rest.positions[joint, 0] > farthest:
            best, farthest = chain[::-1], way * rest.positions[joint, 0]
    return tuple(best)


def trunk_turns(trunk: Trunk, motion: TrunkMotion) -> dict[int, Array]:
    """World turns (n, 4) of the root and all that moves on it, by joint."""
    turns = {trunk.root: qa.euler(*motion.trunk.T)}
    parts = (
        (trunk.chest, motion.chest, trunk.neck, motion.head),
        (trunk.rump, motion.rump, trunk.tail, motion.tail),
    )
    for carrier, turn, chain, end in parts:
        if carrier != trunk.root:
            turns[carrier] = qa.euler(*turn.T)
        begin = turn if carrier != trunk.root else motion.trunk
        for i, joint in enumerate(chain):
            share = (i + 1) / len(chain)
            if joint not in turns:
                turns[joint] = qa.euler(*(begin * (1.0 - share) + end * share).T)
    return turns


def hip_places(
    rest: RestShape, trunk: Trunk, limbs: list[Limb], motion: TrunkMotion
) -> list[Array]:
    """Places (n, 3) of each limb's hip joint, from the mean travel."""
    turns = trunk_turns(trunk, motion)
    places = []
    for i, limb in enumerate(limbs):
        carrier = trunk.chest if i < 2 else trunk.rump
        at = motion.place + qa.rotate(turns[trunk.root], rest.span(trunk.root, carrier))
        places.append(at + qa.rotate(turns[carrier], rest.span(carrier, limb.leg.hip)))
    return places
