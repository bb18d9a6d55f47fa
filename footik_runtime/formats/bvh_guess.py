"""What a BVH file does not say: which axis is up, and how long its unit is.

Both are read off the rest pose. Where that says nothing, as in files whose bones all lie along
one axis until they are posed, a few frames of the motion are looked at instead.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]

UNITS = {1.0: "metres", 0.01: "centimetres", 0.0254: "inches", 0.001: "millimetres"}
CMU_UNIT = 0.056444
HUMAN_HEIGHT = 1.7  # of the joints and tips of a grown person, m
CLEAR = 0.6  # share of the bones' common direction that one axis must have


def bone_ends(skeleton: Skeleton, rotations: Array) -> tuple[Array, Array]:
    """Ends of all bones of N poses: from (N, B, 3) and to (N, B, 3), tips included."""
    positions, turns = skeleton.forward(rotations, np.zeros((len(rotations), 3)))
    tips = list(skeleton.tips)
    held = np.array([skeleton.tips[j] for j in tips]).reshape(-1, 3)
    w, v = turns[:, tips, :1], turns[:, tips, 1:]
    across = 2.0 * np.cross(v, held)
    ends = positions[:, tips] + held + w * across + np.cross(v, across)
    starts = np.concatenate([positions[:, skeleton.parents[1:]], positions[:, tips]], axis=1)
    return starts, np.concatenate([positions[:, 1:], ends], axis=1)


def guess_up(starts: Array, ends: Array) -> str | None:
    """The axis, "y" or "z", against which most bone length runs: legs hang down and are long.

    Arms cancel each other, spine and head are shorter than two legs. None where it is not clear.
    """
    up = np.sum(starts - ends, axis=(0, 1))
    with np.errstate(all="ignore"):
        share = up / np.linalg.norm(up)
    best = int(np.argmax(share))
    return "xyz"[best] if best and share[best] > CLEAR else None


def guess_scale(starts: Array, ends: Array, up: str | None) -> float:
    """Metres a unit, among the usual ones: that which makes the pose most like a human's height."""
    points = np.concatenate([starts, ends], axis=1)
    if not points.size:
        return 1.0
    spans = np.median(np.ptp(points, axis=1), axis=0)
    height = float(spans["xyz".index(up)] if up else spans.max())
    if not (0.0 < height < math.inf):
        return 1.0
    usual = [*UNITS, CMU_UNIT]
    return min(usual, key=lambda unit: abs(math.log(height) + math.log(unit / HUMAN_HEIGHT)))


def guess(
    skeleton: Skeleton, rotations: Array, known_up: str | None = None
) -> tuple[str, float, list[str]]:
    """Up axis, metres a unit, and what was guessed in words.

    Args:
        skeleton: in the file's own axes and units.
        rotations: (N, J, 4) of a few frames, in the file's own axes.
        known_up: the up axis, where it need not be guessed.
    """
    notes = []
    with np.errstate(all="ignore"):  # huge numbers overflow to "not clear"
        starts, ends = bone_ends(skeleton, skeleton.rest_rotations[None])
        up, where = guess_up(starts, ends), "the rest pose"
        if up is None:
            starts, ends = bone_ends(skeleton, rotations)
            up, where = guess_up(starts, ends), "the motion"
        scale = guess_scale(starts, ends, known_up or up)
    if up is None:
        notes.append("Up axis not clear from the rest pose or the motion: y taken.")
    else:
        notes.append(f"Up axis {up}, seen in {where}.")
    unit = UNITS.get(scale, "CMU's 5.64 cm")
    notes.append(f"Scale {scale:g} m a unit ({unit}), guessed from the size of the skeleton.")
    return up or "y", scale, notes
