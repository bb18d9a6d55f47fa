"""Rig: which joints of a skeleton are the hips and the legs, and where each sole is."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from footik_runtime.errors import FootIKError, listed, unknown_name
from footik_runtime.rig_facing import facing_and_left, rests_on_zero, stands_upright
from footik_runtime.rig_names import (
    LEG_NAMES,
    Chain,
    arms_by_name,
    is_helper,
    legs_by_name,
    names_hips,
    nearest_guesses,
)
from footik_runtime.rig_sole import STEEPEST_FLAT, Sole, Stance, guess_sole, leg_length
from footik_runtime.rig_topology import legs_by_shape
from footik_runtime.skeleton import Skeleton

__all__ = ["Leg", "Rig", "Sole", "find_rig"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Leg:
    """One leg: joint indices from hip to toe (toe -1 where the foot has none), and its sole."""

    name: str
    hip: int
    knee: int
    ankle: int
    toe: int
    sole: Sole


@dataclass(frozen=True, kw_only=True, eq=False)
class Rig:
    """The parts of a skeleton that foot IK needs.

    Attributes:
        skeleton: the joints.
        hips: index of the joint that carries the body and is lowered, usually the root.
        legs: left before right, front before hind.
        forward: (3,) unit, horizontal: where the rest pose faces, in the model frame.
        notes: how each part was found, a line each, for people to read.
    """

    skeleton: Skeleton
    hips: int
    legs: tuple[Leg, ...]
    forward: Array
    notes: tuple[str, ...] = field(default=())

    @property
    def leg_lengths(self) -> Array:
        """(legs,) rest length hip-knee-ankle of each leg, m."""
        positions, _ = self.skeleton.rest_pose()
        chains = [(leg.hip, leg.knee, leg.ankle, leg.toe) for leg in self.legs]
        return np.array([leg_length(positions, chain) for chain in chains])

    def describe(self) -> str:
        """What was found, a line for the hips, each leg and each note."""
        names = self.skeleton.names
        x, y, z = self.forward
        lines = [f"hips    {names[self.hips]}", f"forward ({x:.2f}, {y:.2f}, {z:.2f})"]
        for leg, length in zip(self.legs, self.leg_lengths, strict=True):
            joints = [leg.hip, leg.knee, leg.ankle] + ([leg.toe] if leg.toe >= 0 else [])
            sole = leg.sole
            lines.append(
                f"{leg.name:7} {' > '.join(names[j] for j in joints)}, {100 * length:.1f} cm; "
                f"sole {100 * sole.height:.1f} cm under the ankle, heel {100 * sole.heel:.1f} "
                f"behind it, ball {100 * sole.ball:.1f} and tip {100 * sole.tip:.1f} ahead, "
                f"{200 * sole.half_width:.1f} wide"
            )
        return "\n".join(lines + [f"note    {note}" for note in self.notes])


def find_rig(
    skeleton: Skeleton,
    *,
    hips: str | None = None,
    legs: Mapping[str, Sequence[str | None]] | None = None,
    forward: Sequence[float] | Array | None = None,
    soles: Mapping[str, Sole] | None = None,
    stance: Array | None = None,
) -> Rig:
    """Find hips, legs and soles from joint names, else from shape; what is given wins.

    Args:
        skeleton: the joints, z up.
        hips: name of the joint that carries the body.
        legs: leg name -> names of hip, knee, ankle and (or None, or left out) toe joint.
        forward: (3,) where the rest pose faces; its horizontal part is taken.
        soles: leg name -> its sole, for the legs whose sole is known.
        stance: (J, 4) local rotations, wxyz, of a pose that stands with flat feet, for skeletons
            whose rest pose does not; the rest pose by default.

    Raises:
        FootIKError: no legs found (with the joints and the nearest guesses), an unknown name, a
            leg that is not a chain, a leg without length.
    """
    positions, rotations = _pose(skeleton, stance)
    notes: list[str] = []
    if legs is None:
        chains = chains_by_name(skeleton, skeleton.names, positions, notes)
        chains = on_their_toes(skeleton, chains, positions, notes)
        chains = chains or chains_by_shape(skeleton, positions, notes)
        if not chains:
            raise no_legs_error(skeleton)
    else:
        chains = _given_chains(skeleton, legs)
    return build_rig(
        skeleton, chains, (positions, rotations), notes, hips=hips, forward=forward, soles=soles
    )


def _pose(skeleton: Skeleton, stance: Array | None) -> tuple[Array, Array]:
    if stance is None:
        return skeleton.rest_pose()
    stance = np.asarray(stance, dtype=np.float64)
    if stance.shape != (len(skeleton), 4) or not np.isfinite(stance).all():
        raise FootIKError(
            f"stance must be finite local rotations ({len(skeleton)}, 4), not {stance.shape}."
        )
    positions, rotations = skeleton.forward(stance[None], skeleton.offsets[0][None])
    return positions[0], rotations[0]


def chains_by_name(
    skeleton: Skeleton, labels: Sequence[str], positions: Array, notes: list[str]
) -> dict[str, Chain]:
    """The legs that `labels` (J,) tell of, on both sides; empty where there are none."""
    chains = legs_by_name(labels, [int(p) for p in skeleton.parents])
    chains = {name: c for name, c in chains.items() if leg_length(positions, c) > 0.0}
    if {name.split("_")[0] for name in chains} != {"left", "right"}:
        return {}
    if set(chains) == {"left", "right"}:
        return _with_front_legs(skeleton, labels, positions, chains, notes)
    return chains


def chains_by_shape(skeleton: Skeleton, positions: Array, notes: list[str]) -> dict[str, Chain]:
    """The legs by the rest pose's shape alone, noted as a guess; empty where there are none."""
    chains = legs_by_shape(skeleton, positions)
    if chains:
        ends = ", ".join(f"{name} {skeleton.names[c[2]]!r}" for name, c in chains.items())
        notes.append(f"a guess: the names tell of no legs; by shape the ankles are {ends}")
    return chains


def on_their_toes(
    skeleton: Skeleton, chains: dict[str, Chain], positions: Array, notes: list[str]
) -> dict[str, Chain]:
    """The legs, with those of an animal that ends in a hanging foot made to end where that does.

    What its name calls a foot is a hock then: the sole is at the joint below, and the hock lies
    between knee and paw.
    """
    out = dict(chains)
    for name, (hip, knee, ankle, toe) in chains.items():
        if len(chains) != 4 or toe < 0:
            continue
        foot = positions[toe] - positions[ankle]
        if math.atan2(-float(foot[2]), float(np.hypot(foot[0], foot[1]))) > STEEPEST_FLAT:
            out[name] = (hip, knee, toe, -1)
            hock, paw = skeleton.names[ankle], skeleton.names[toe]
            notes.append(f"{name}: {hock!r} hangs, so it is the hock, and {paw!r} the paw")
    return out


def _with_front_legs(
    skeleton: Skeleton,
    labels: Sequence[str],
    positions: Array,
    chains: dict[str, Chain],
    notes: list[str],
) -> dict[str, Chain]:
    """The two legs, and the arms too where the rest pose stands on its hands."""
    arms = arms_by_name(labels, [int(p) for p in skeleton.parents])
    if set(arms) != {"left", "right"}:
        return chains
    leg = np.mean([leg_length(positions, c) for c in chains.values()])
    hand = np.mean([positions[c[2], 2] for c in arms.values()])
    foot = np.mean([positions[c[2], 2] for c in chains.values()])
    if not stands_upright(positions, chains) or hand > foot + 0.15 * leg:
        return chains
    notes.append("four legs: in the rest pose the hands are as low as the feet")
    ends = (("front", arms), ("hind", chains))
    return {f"{side}_{end}": c[side] for end, c in ends for side in ("left", "right")}


def no_legs_error(skeleton: Skeleton, what: str = "skeleton") -> FootIKError:
    """The error for a skeleton without legs: its joints, the nearest guesses, and the way out."""
    return FootIKError(
        f"no legs found in the {what} of {len(skeleton)} joints ({listed(skeleton.names)}); "
        f"nearest by name: {'; '.join(nearest_guesses(skeleton.names))}. Give them: "
        'find_rig(skeleton, legs={"left": ("thigh", "shin", "foot", "toes"), "right": (...)}), '
        "or --legs left=thigh,shin,foot,toes right=... on the command line."
    )


def _given_chains(skeleton: Skeleton, legs: Mapping[str, Sequence[str | None]]) -> dict[str, Chain]:
    if not legs:
        raise FootIKError("legs must name at least one leg, such as 'left'.")
    chains: dict[str, Chain] = {}
    for name, joints in legs.items():
        named = [joint for joint in joints if joint is not None]
        if isinstance(joints, str) or len(named) not in (3, 4) or None in joints[:3]:
            raise FootIKError(
                f"leg {name!r} needs the names of hip, knee, ankle and, where it has one, toe "
                f"joint, not {joints!r}."
            )
        chain = [skeleton.index(joint) for joint in named]
        for above, below in pairwise(chain):
            if above == below or above not in skeleton.chain(below):
                raise FootIKError(
                    f"leg {name!r} is not a chain: {skeleton.names[below]!r} does not descend "
                    f"from {skeleton.names[above]!r}; its ancestors are "
                    f"{listed(skeleton.names[j] for j in skeleton.chain(below)[1:]) or 'none'}."
                )
        chains[name] = (chain[0], chain[1], chain[2], chain[3] if len(chain) == 4 else -1)
    return chains


def build_rig(
    skeleton: Skeleton,
    chains: Mapping[str, Chain],
    pose: tuple[Array, Array],
    notes: list[str],
    *,
    hips: str | None = None,
    forward: Sequence[float] | Array | None = None,
    soles: Mapping[str, Sole] | None = None,
) -> Rig:
    """The rig of known legs: directions, hips and the soles that are not given.

    Args:
        skeleton: the joints.
        chains: leg name -> hip, knee, ankle, toe (or -1) joint.
        pose: model-frame positions (J, 3) and rotations (J, 4) of a standing pose.
        notes: lines to begin with.
        hips: as in `find_rig`.
        forward: as in `find_rig`.
        soles: as in `find_rig`.
    """
    positions, rotations = pose
    notes = list(notes)
    for name, chain in chains.items():
        if leg_length(positions, chain) <= 0.0:
            raise FootIKError(
                f"leg {name!r} has no length: {skeleton.names[chain[0]]!r} and "
                f"{skeleton.names[chain[2]]!r} lie in one place in the rest pose."
            )
    given = dict(soles or {})
    for name in given:
        if name not in chains:
            raise unknown_name("leg", name, chains)
    stands = stands_upright(positions, chains)
    if not stands:
        notes.append(
            "the rest pose does not stand (its legs do not point down): forward and soles are "
            "guesses; a standing pose can be given as stance"
        )
    facing, left = facing_and_left(positions, chains, stands, forward, notes)
    grounded = stands and rests_on_zero(skeleton, positions, chains)
    at = Stance(
        positions=positions,
        rotations=rotations,
        forward=facing,
        left=left,
        stands=stands,
        grounded=grounded,
        animal=len(chains) == 4,
    )
    found = []
    for name in sorted(chains, key=lambda n: LEG_NAMES.index(n) if n in LEG_NAMES else 99):
        hip, knee, ankle, toe = chains[name]
        sole = given.get(name)
        if sole is None:
            sole, guesses = guess_sole(skeleton, chains[name], at, name)
            notes += guesses
        found.append(Leg(name=name, hip=hip, knee=knee, ankle=ankle, toe=toe, sole=sole))
    carrier = _hips(skeleton, positions, chains, stands) if hips is None else skeleton.index(hips)
    return Rig(
        skeleton=skeleton, hips=carrier, legs=tuple(found), forward=facing, notes=tuple(notes)
    )


def _hips(skeleton: Skeleton, positions: Array, chains: Mapping[str, Chain], stands: bool) -> int:
    """The joint that carries the body: above all legs, and above what is highest."""
    above = [skeleton.chain(c[0])[1:] or [c[0]] for c in chains.values()]
    common = next(j for j in above[0] if all(j in line for line in above))
    line = skeleton.chain(common)
    named = [j for j in line if names_hips(skeleton.names[j])]
    carrier = named[-1] if named else common
    if stands:
        body = [j for j in range(len(skeleton)) if not is_helper(skeleton.names[j])]
        highest = max(body or [common], key=lambda j: float(positions[j, 2]))
        carrier = next(j for j in skeleton.chain(carrier) if j in skeleton.chain(highest))
    return carrier
