"""Whether a pose stands, on what, and where it faces."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from footik_runtime.errors import FootIKError
from footik_runtime.rig_names import Chain
from footik_runtime.rig_sole import FOOT_PER_LEG, leg_length
from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]

_UP = np.array([0.0, 0.0, 1.0])
_STANDING = math.cos(math.radians(60.0))  # hip to ankle is at most this far from straight down
_DISAGREE = math.cos(math.radians(30.0))


def stands_upright(positions: Array, chains: Mapping[str, Chain]) -> bool:
    """Whether the legs of positions (J, 3), taken together, point down."""
    down = sum(positions[c[2]] - positions[c[0]] for c in chains.values())
    return float(-np.asarray(down)[2]) > _STANDING * float(np.linalg.norm(down))


def _mean(positions: Array, chains: Mapping[str, Chain], word: str) -> Array | None:
    """Mean hip place (3,) of the legs with a word in their name, m."""
    hips = [positions[c[0]] for name, c in chains.items() if word in name.split("_")]
    return np.mean(hips, axis=0) if hips else None


def _horizontal(v: Array) -> Array | None:
    flat = np.array([v[0], v[1], 0.0])
    length = float(np.linalg.norm(flat))
    return flat / length if length > 1e-9 else None


def facing_and_left(
    positions: Array,
    chains: Mapping[str, Chain],
    stands: bool,
    forward: Sequence[float] | Array | None,
    notes: list[str],
) -> tuple[Array, Array]:
    """Where the pose faces and its left, both (3,) unit; doubts are added to `notes`.

    Raises:
        FootIKError: the given forward is not three numbers, or vertical.
    """
    sides = [_mean(positions, chains, side) for side in ("left", "right")]
    across = sides[0] - sides[1] if sides[0] is not None and sides[1] is not None else None
    level = _horizontal(across) if across is not None else None
    by_hips = np.cross(level, _UP) if level is not None else None
    by_feet = _facing_of_feet(positions, chains) if stands else None
    if forward is not None:
        given = np.asarray(forward, dtype=np.float64)
        facing = _horizontal(given) if given.shape == (3,) and np.isfinite(given).all() else None
        if facing is None:
            raise FootIKError(f"forward must be 3 numbers, not vertical, not {forward!r}.")
    elif by_feet is not None:
        facing = by_feet
    elif by_hips is not None:
        facing = by_hips
        notes.append("forward from the hips' left and right: the feet do not tell")
    else:
        facing = np.array([1.0, 0.0, 0.0])
        notes.append("forward guessed as +x")
    if by_hips is not None and facing @ by_hips < -0.5:
        notes.append("mirrored: the legs named left lie right of where the feet point")
    elif by_hips is not None and facing @ by_hips < _DISAGREE:
        apart = math.degrees(math.acos(max(-1.0, min(1.0, float(facing @ by_hips)))))
        notes.append(f"the feet point {apart:.0f} deg away from where the hips face")
    if stands or across is None or np.linalg.norm(across) < 1e-9:
        return facing, np.cross(_UP, facing)
    return facing, across / np.linalg.norm(across)


def _facing_of_feet(positions: Array, chains: Mapping[str, Chain]) -> Array | None:
    front, hind = (_mean(positions, chains, end) for end in ("front", "hind"))
    if front is not None and hind is not None:
        return _horizontal(front - hind)
    toes = [positions[c[3]] - positions[c[2]] for c in chains.values() if c[3] >= 0]
    legs = np.mean([leg_length(positions, c) for c in chains.values()])
    if not toes or np.hypot(*np.mean(toes, axis=0)[:2]) < 0.02 * legs:
        return None
    return _horizontal(np.mean(toes, axis=0))


def rests_on_zero(skeleton: Skeleton, positions: Array, chains: Mapping[str, Chain]) -> bool:
    """Whether the pose rests on z = 0: every foot ends a toe's thickness or less above it."""
    for chain in chains.values():
        leg = leg_length(positions, chain)
        last = chain[3] if chain[3] >= 0 else chain[2]
        low = min(positions[j, 2] for j in [chain[2], last, *skeleton.children(last)])
        usual = 0.3 if chain[3] >= 0 else 0.4 if len(chains) < 4 else 0.8
        thickest = usual * FOOT_PER_LEG * leg
        if not -0.02 * leg <= low <= thickest or positions[chain[2], 2] <= 0.02 * leg:
            return False
    return True
