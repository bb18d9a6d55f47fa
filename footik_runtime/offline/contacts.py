"""Contacts of a clip for the runtime: what its curves tell, and from its motion what not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.offline import detect, plants
from footik_runtime.offline.filters import runs
from footik_runtime.offline.low_feet import with_low_feet
from footik_runtime.offline.stages import CleanSettings
from footik_runtime.offline.working import as_worked, fitted_rig, unpad, working
from footik_runtime.phases import Phase, phase_curve, weight_curve
from footik_runtime.rig import Rig

Array = NDArray[np.float64]

_SHORTEST_CONTACT, _SHORTEST_SWING = 0.10, 0.08  # s


def with_contacts(clip: Clip, rig: Rig) -> tuple[Clip, Rig]:
    """A clip as the runtime wants it, and the rig with the soles that fit it.

    It has weight and phase curves, stands level on z = 0, and travels where it walked on a belt.
    Curves that it has are kept: a phase is in contact where it says so, a weight where it is at
    least .5, and what is missing is told from the motion. A clip with a curve for every leg keeps
    its floor, and with a phase for every leg its soles too. Raises FootIKError for a phase that is
    no `Phase`.
    """
    settings = CleanSettings()
    work = working(clip, rig, settings=settings)
    contacts = detect.of_clip(work, settings)
    found = plants.find(work, contacts, settings)
    held = unpad(work, with_low_feet(plants.phases_of(found, contacts.foot.shape), work))
    touching, given = unpad(work, contacts.phases()), detect.given_phases(work)
    placed = as_worked(clip, work)
    curves: dict[str, Array] = {}
    for i, leg in enumerate(rig.legs):
        weight, phase = weight_curve(leg.name), phase_curve(leg.name)
        # What a weight says lasts as long as it says, and so does a pose that stands throughout,
        # however short; else a contact lasts as long as the foot can be held.
        throughout = bool((touching[:, i] != Phase.SWING).all())
        told = touching[:, i] if weight in clip.curves or throughout else held[:, i]
        told = unpad(work, given[i]) if i in given else told
        curves[phase] = told.astype(np.float64)
        if weight not in clip.curves:
            curves[weight] = (told != Phase.SWING).astype(np.float64)
    return placed.with_curves(**curves), fitted_rig(rig, work)


def mend_seam(clip: Clip, rig: Rig) -> Clip:
    """A cycle cut from a clip, without the contacts and swings too short to be true at its cut.

    Where the phases of the first frame and the last disagree, a step could begin and end within
    some frames. Both curves of a leg are mended; the last frame gets the values of the first.
    """
    curves: dict[str, Array] = {}
    near = _SHORTEST_CONTACT * clip.fps
    frames = len(clip) - 1
    to_seam = np.minimum(np.arange(frames), frames - np.arange(frames))
    for leg in rig.legs:
        weight, phase = (
            np.array(clip.curves[curve(leg.name)]) for curve in (weight_curve, phase_curve)
        )
        contact = phase[:frames] != Phase.SWING
        longer = _without_short(np.tile(contact, 3), clip.fps)[frames : 2 * frames]
        for frame in np.flatnonzero((longer != contact) & (to_seam <= near)):
            weight[frame] = float(longer[frame])
            phase[frame] = Phase.FLAT if longer[frame] else Phase.SWING
        weight[-1], phase[-1] = weight[0], phase[0]
        curves |= {weight_curve(leg.name): weight, phase_curve(leg.name): phase}
    return clip.with_curves(**curves)


def _without_short(contact: NDArray[np.bool_], fps: float) -> NDArray[np.bool_]:
    """Short swings filled, then short contacts dropped; those cut off by an end are kept."""
    out = contact.copy()
    for value, shortest in ((False, _SHORTEST_SWING), (True, _SHORTEST_CONTACT)):
        for start, stop in runs(out == value):
            if start > 0 and stop < len(out) and stop - start < shortest * fps:
                out[start:stop] = not value
    return out
