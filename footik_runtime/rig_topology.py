"""Legs found without names: mirrored pairs of chains that end lowest in the rest pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]
Chain = tuple[int, int, int, int]

_MIRROR = 0.08  # of the body's size: how far two mirrored joints may lie from each other's image
_SAME_HEIGHT = 0.15  # of a leg's drop: how much higher a second pair of feet may stand
_SHORTEST = 0.3  # of the body's height: what a leg drops at least


def legs_by_shape(skeleton: Skeleton, positions: Array) -> dict[str, Chain]:
    """Left and right leg, or four legs, by shape alone; empty where no pair qualifies.

    Args:
        skeleton: the joints.
        positions: (J, 3) of a standing rest pose, z up, m. Left is +y where feet do not tell.
    """
    size = float(np.ptp(positions, axis=0).max())
    height = float(np.ptp(positions[:, 2]))
    if size <= 0.0:
        return {}
    limbs = [limb for limb in _limbs(skeleton) if len(limb) >= 3]
    pairs = []
    for i, a in enumerate(limbs):
        for b in limbs[i + 1 :]:
            mirrored = len(a) == len(b) and _mirrored(positions[a], positions[b], size)
            drop = positions[a[0], 2] - positions[a[-1], 2]
            if mirrored and drop > _SHORTEST * height:
                chains = [_as_leg(positions, limb, size) for limb in (a, b)]
                if all(chains):
                    pairs.append((float(positions[a[-1], 2]), drop, chains))
    if not pairs:
        return {}
    pairs.sort(key=lambda pair: pair[0])
    lowest, drop, _ = pairs[0]
    chosen = [chains for z, _, chains in pairs[:2] if z - lowest < _SAME_HEIGHT * drop]
    if lowest - positions[:, 2].min() > 0.1 * height:
        return {}  # something else reaches lower: these are not what it stands on
    return _named(positions, [[c for c in chains if c] for chains in chosen])


def _limbs(skeleton: Skeleton) -> list[list[int]]:
    """From each leaf up to, not including, the joint where it meets a chain of the other side."""
    children = np.bincount(skeleton.parents[1:], minlength=len(skeleton))
    limbs = []
    for leaf in np.flatnonzero(children == 0):
        line = skeleton.chain(int(leaf))
        limb = [line[0]]
        for joint in line[1:]:
            if children[joint] > 1 or joint == 0:
                break
            limb.append(joint)
        limbs.append(limb[::-1])
    return limbs


def _mirrored(a: Array, b: Array, size: float) -> bool:
    """Whether two chains (n, 3) are images of each other in a vertical plane."""
    across = a[-1] - b[-1]
    across[2] = 0.0
    length = float(np.linalg.norm(across))
    if length < 0.02 * size:
        return False
    across /= length
    middle = 0.5 * (a[-1] + b[-1])
    image = b - 2.0 * ((b - middle) @ across)[:, None] * across
    return bool(np.abs(image - a).max() < _MIRROR * size)


def _as_leg(positions: Array, limb: list[int], size: float) -> Chain | None:
    """Hip, knee, ankle and toe of a chain: the toe where the last bone lies rather than hangs."""
    distinct = [limb[0]]
    for joint in limb[1:]:
        if np.linalg.norm(positions[joint] - positions[distinct[-1]]) > 1e-3 * size:
            distinct.append(joint)
    if len(distinct) < 3:
        return None
    toe = -1
    last = positions[distinct[-1]] - positions[distinct[-2]]
    if len(distinct) > 3 and np.hypot(last[0], last[1]) > abs(last[2]):
        toe = distinct.pop()
    while len(distinct) > 3:  # a foot of several bones: they lie, the shin hangs
        bone = positions[distinct[-1]] - positions[distinct[-2]]
        if np.hypot(bone[0], bone[1]) <= abs(bone[2]):
            break
        toe = distinct.pop()
    hip, ankle = distinct[0], distinct[-1]
    ends = positions[[hip, ankle]]
    knee = max(
        distinct[1:-1], key=lambda j: float(np.linalg.norm(positions[j] - ends, axis=1).min())
    )
    return (hip, knee, ankle, toe)


def _named(positions: Array, pairs: list[list[Chain]]) -> dict[str, Chain]:
    forward = np.zeros(3)
    for a, b in pairs:
        for hip, _, ankle, toe in (a, b):
            forward += positions[toe] - positions[ankle] if toe >= 0 else 0.0 * positions[hip]
    if len(pairs) == 2 or np.hypot(forward[0], forward[1]) < 1e-9:
        forward = np.array([1.0, 0.0, 0.0])
    left = np.array([-forward[1], forward[0], 0.0])
    ordered = [sorted(pair, key=lambda c: -float(positions[c[0]] @ left)) for pair in pairs]
    if len(ordered) == 1:
        return dict(zip(("left", "right"), ordered[0], strict=True))
    ordered.sort(key=lambda pair: -float(positions[pair[0][0]] @ forward))
    return {
        f"{side}_{end}": chain
        for end, pair in zip(("front", "hind"), ordered, strict=True)
        for side, chain in zip(("left", "right"), pair, strict=True)
    }
