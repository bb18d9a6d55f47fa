"""Clips measured before and after cleanup, with the same contacts and the same ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.measures import pinned_point_speed
from footik_runtime.metrics import score
from footik_runtime.offline.spread import heights_on, heights_under, lowest_in_swing
from footik_runtime.offline.stages import Cleaned
from footik_runtime.offline.working import as_worked, unpad
from footik_runtime.recorded import Run
from footik_runtime.sole import BALL, all_sole_points

Array = NDArray[np.float64]

BEFORE, AFTER = "before", "after"
PINNED = "pinned_point_speed"


def runs(before: Clip, cleaned: Cleaned) -> dict[str, Run]:
    """The clip before and after cleanup as runs on the ground that was found, levelled."""
    clips = as_seen(before, cleaned)
    return {name: run_of(clip, cleaned) for name, clip in clips.items()}


def compare(before: Clip, cleaned: Cleaned) -> dict[str, dict[str, float]]:
    """Every measure that applies, before and after; what compares, compares with before.

    The pinned point's speed is that between the clip's own frames: no resampling rounds its stops.
    """
    made = runs(before, cleaned)
    return {
        name: score(run, made[BEFORE]) | {PINNED: pinned_point_speed(run)}
        for name, run in made.items()
    }


def as_seen(before: Clip, cleaned: Cleaned) -> dict[str, Clip]:
    """The clip before and after as cleanup saw it: level, off its belt, on its floor."""
    work = cleaned.work
    if work is None:
        return {BEFORE: before, AFTER: cleaned.clip}
    after = as_worked(cleaned.clip, work, level=cleaned.levelled)
    return {BEFORE: as_worked(before, work), AFTER: after}


def ground_of(cleaned: Cleaned, soles: Array) -> Array:
    """(T, F, 3) height under sole points (T, F, 3, 3): of the true ground, or of the plants'.

    Under a foot that never stands it is that of the lowest plant of the others, or 0.
    """
    work, plants = cleaned.work, cleaned.plants
    if work is None:
        heights = heights_under(soles, plants)
    elif cleaned.ground is not None:
        heights = heights_on(cleaned.ground, soles, unpad(work, work.shift))
    else:
        lowest = lowest_in_swing(unpad(work, work.soles), plants, work.scale)
        heights = heights_under(soles, plants, lowest)
    known = np.isfinite(heights)
    return np.where(known, heights, heights[known].min() if known.any() else 0.0)


def run_of(clip: Clip, cleaned: Cleaned) -> Run:
    """A clip as a `Run`, with the contacts and the ground that cleanup found."""
    rig = cleaned.rig
    positions, turns = clip.model_pose()
    soles = all_sole_points(rig, positions, turns)
    has_toes = all(leg.toe >= 0 for leg in rig.legs)
    parts = ("hip", "knee", "ankle", "toe") if has_toes else ("hip", "knee", "ankle")
    chains = np.array([[getattr(leg, part) for part in parts] for leg in rig.legs])
    return Run(
        fps=clip.fps,
        times=clip.times,
        hips=positions[:, rig.hips],
        leg_rotations=clip.rotations[:, chains],
        ankle=positions[:, chains[:, 2]],
        toe=positions[:, chains[:, 3]] if has_toes else soles[:, :, BALL],
        sole=soles,
        ground=ground_of(cleaned, soles),
        phase=cleaned.phases.astype(np.int64),
        joints=positions,
        stretch=_stretch(clip, positions, chains),
    )


def _stretch(clip: Clip, positions: Array, chains: NDArray) -> Array | None:
    """(T, F) by how much the longest-drawn segment of each leg exceeds its rest length."""
    if clip.translations is None:
        return None
    rest, _ = clip.skeleton.rest_pose()
    longest = np.zeros((len(clip), len(chains)))
    for upper, lower in ((0, 1), (1, 2)):
        a, b = chains[:, upper], chains[:, lower]
        length = np.linalg.norm(positions[:, b] - positions[:, a], axis=-1)
        usual = np.maximum(np.linalg.norm(rest[b] - rest[a], axis=-1), 1e-9)
        longest = np.maximum(longest, length / usual - 1.0)
    return longest
