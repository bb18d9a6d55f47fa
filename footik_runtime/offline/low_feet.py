"""Low feet: the contacts of an animal whose paws never stand still, told from height and way.

Game animations of four legs are often walked in place by eye: in what is meant as contact a paw
slides against the ground it stands on. The detector rightly finds little of that to be standing.
What is meant is plain all the same: the paw is low, and goes back under a body that goes ahead.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from footik_runtime.offline.filters import runs
from footik_runtime.offline.stages import Working
from footik_runtime.phases import Phase
from footik_runtime.sole import BALL, HEEL

Array = NDArray[np.float64]
Phases = NDArray[np.int8]

_LOW = 0.3  # of a paw's own lift: lower is on the ground
_LEAST_LIFT = 0.05  # legs: a paw that is lifted less tells nothing
_GOES_ALONG = 0.9  # of the body's speed: a paw that is slower than it goes back under it
_LEAST_SPEED = 0.3  # legs a second: a slower body goes nowhere
_POOR = 0.7  # of the low frames: where fewer are found standing, height and way tell
_ROLLED = math.sin(math.radians(3.0))  # of the sole's pitch: less is flat
_SHORTEST = 0.06  # s of a contact, and of a gap in one


def with_low_feet(phases: Phases, work: Working) -> Phases:
    """Phases (N, F) with the contacts of low paws where the found ones say too little.

    Only for four legs or more that travel; all legs are told in one way, so that they agree.
    """
    if work.soles.shape[1] < 4:
        return phases
    low = low_feet(work)
    own = slice(work.pad, work.pad + work.frames)
    meant, found = low[own], phases[own] != Phase.SWING
    if not meant.any() or found[meant].mean() > _POOR:
        return phases
    heel, ball = work.soles[:, :, HEEL], work.soles[:, :, BALL]
    pitch = (ball - heel)[..., 2] / np.maximum(np.linalg.norm(ball - heel, axis=-1), 1e-9)
    rolled = np.select([pitch > _ROLLED, pitch < -_ROLLED], [Phase.HEEL, Phase.BALL], Phase.FLAT)
    return np.where(low, rolled, Phase.SWING).astype(np.int8)


def low_feet(work: Working) -> NDArray[np.bool_]:
    """(N, F) whether a paw is low in its own path, and goes back under the body."""
    leg = float(work.rig.leg_lengths.mean())
    (frames, paws), fps = work.soles.shape[:2], work.clip.fps
    out = np.zeros((frames, paws), dtype=bool)
    gone = work.positions[-1, work.rig.hips] - work.positions[0, work.rig.hips]
    body = gone[:2] * (fps / max(frames - 1, 1))
    speed = float(np.linalg.norm(body))
    if frames < 3 or speed < _LEAST_SPEED * leg:
        return out
    for i in range(paws):
        height = work.soles[:, i, :, 2].min(axis=1)
        lowest, lift = float(height.min()), float(np.ptp(height))
        if lift < _LEAST_LIFT * leg:
            continue
        steps = np.diff(work.soles[:, i, BALL, :2], axis=0, append=work.soles[-1:, i, BALL, :2])
        along = steps @ body * fps / speed
        out[:, i] = (height < lowest + _LOW * lift) & (along < _GOES_ALONG * speed)
        _drop_short(out[:, i], _SHORTEST * fps)
    return out


def _drop_short(down: NDArray[np.bool_], least: float) -> None:
    """Fill short gaps, then drop short contacts, in place; those cut off by an end stay."""
    for state in (False, True):
        for start, stop in runs(down == state):
            if start > 0 and stop < len(down) and stop - start < least:
                down[start:stop] = not state
