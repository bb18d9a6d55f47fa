"""Baking: contacts become smooth weight curves of few keys, and a stepped phase, for every leg.

A contact that is told from frames k - 1 and k begins half-way between them. The weight crosses .5
there, so that `>= .5` at the frames is the contact again and no frame is ever at .5 itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.offline.curve_keys import CURVE_KEYS, Keys, sample
from footik_runtime.offline.stages import BakeSettings, Bools, Contacts
from footik_runtime.phases import heel_curve, phase_curve, toe_curve, weight_curve
from footik_runtime.rig import Rig

__all__ = ["BakeSettings", "Keys", "bake", "bake_openkcc", "curve_names", "curves", "sample"]

Array = NDArray[np.float64]
HeightTrack = Callable[[Array], Array] | tuple[Array, Array]

BAKE_NOTES = "bake_notes"
"""The entry of a baked clip's extras with a line for each thing worth telling."""

OPENKCC_CURVES = ("LeftFootIKWeight", "RightFootIKWeight")


def bake(
    clip: Clip, contacts: Contacts | None, rig: Rig, settings: BakeSettings | None = None
) -> Clip:
    """The clip with curves of its contacts, sampled at its frames; their keys are in its extras.

    Curves it has keep their values, with a note, unless `settings.replace`.

    Args:
        clip: any clip of the rig's skeleton.
        contacts: of the clip's own frames and the rig's legs; the preset "openkcc" needs none.
        rig: names the legs.
        settings: defaults where None.

    Raises:
        FootIKError: contacts of other frames or legs; with "openkcc", a clip without length.
    """
    settings = settings or BakeSettings()
    if settings.preset == "openkcc":
        made = _openkcc_curves(clip, rig, settings)
    elif contacts is None:
        raise FootIKError(f"{clip.name}: baking needs the contacts of the clip.")
    else:
        _require_match(clip, contacts, rig)
        made = curves(contacts, rig, settings, loop=clip.loop)
    kept = [] if settings.replace else [name for name in made if name in clip.curves]
    notes = [f"curve {name!r} was there already and stays as it is" for name in kept]
    made = {name: keys for name, keys in made.items() if name not in kept}
    times = clip.times
    sampled = clip.with_curves(**{name: sample(keys, times) for name, keys in made.items()})
    all_keys = {**clip.extras.get(CURVE_KEYS, {}), **made}
    return sampled.with_extras(**{CURVE_KEYS: all_keys, BAKE_NOTES: tuple(notes)})


def _require_match(clip: Clip, contacts: Contacts, rig: Rig) -> None:
    wanted = (len(clip), len(rig.legs), 2)
    if contacts.down.shape != wanted or contacts.fps != clip.fps:
        raise FootIKError(
            f"{clip.name}: contacts {contacts.down.shape} at {contacts.fps:g} fps are not of this "
            f"clip and rig, {wanted} at {clip.fps:g} fps."
        )


def curve_names(rig: Rig, settings: BakeSettings) -> list[str]:
    """The names of the curves that baking makes for a rig."""
    kinds = (weight_curve, heel_curve, toe_curve, phase_curve)
    if settings.preset == "openkcc":
        kinds = (weight_curve,)
    return [kind(leg.name) for leg in rig.legs for kind in kinds]


def curves(
    contacts: Contacts, rig: Rig, settings: BakeSettings | None = None, *, loop: bool = False
) -> dict[str, Keys]:
    """Keys of the weight, heel, toe and phase curve of every leg, by name.

    In a loop the ramps go over the seam, and the last frame has the value of the first.
    """
    settings = settings or BakeSettings()
    phases = contacts.phases()
    made: dict[str, Keys] = {}
    for i, leg in enumerate(rig.legs):
        heel, toe = contacts.down[:, i, 0], contacts.down[:, i, 1]
        for name, down in (
            (weight_curve(leg.name), heel | toe),
            (heel_curve(leg.name), heel),
            (toe_curve(leg.name), toe),
        ):
            made[name] = weight_keys(down, contacts.fps, settings, loop=loop)
        made[phase_curve(leg.name)] = _stepped(phases[:, i], contacts.fps, loop)
    return made


def weight_keys(down: Bools, fps: float, settings: BakeSettings, *, loop: bool = False) -> Keys:
    """Keys of a weight that is at least .5 exactly in the frames (T,) that are down.

    Each contact rises from 0 to 1 and falls again in smoothsteps, centred on its two events and
    shortened to what half of the swing or contact beside them leaves: four keys a contact.
    """
    frames = len(down)
    if not loop or frames < 2:
        return _ramps(np.asarray(down, dtype=bool), fps, settings)
    cycle = np.asarray(down[:-1], dtype=bool)
    if cycle.all() or not cycle.any():
        return _ramps(cycle, fps, settings)
    duration = (frames - 1) / fps
    # The ramps of the neighbouring cycles reach over the seam.
    keys = _ramps(np.tile(cycle, 3), fps, settings).part(duration, 2.0 * duration)
    return _closed(keys)


def _closed(keys: Keys) -> Keys:
    """Keys whose last value and slope are those of the first to the last bit, on one curve."""
    values, slopes = keys.values.copy(), keys.slopes.copy()
    values[-1], slopes[-1] = values[0], slopes[0]
    return replace(keys, values=values, slopes=slopes)


def _ramps(down: Bools, fps: float, settings: BakeSettings) -> Keys:
    changes = np.flatnonzero(down[1:] != down[:-1]) + 1
    start = np.array([0.0])
    if len(changes) == 0:
        return Keys(times=start, values=down[:1].astype(np.float64))
    events = (changes - 0.5) / fps
    bounds = np.concatenate([start, events, [(len(down) - 1) / fps]])
    room = 0.5 * np.diff(bounds)
    room[[0, -1]] *= 2.0  # the stretches at the ends have one ramp only
    rises = down[changes]
    ease = np.where(rises, settings.ease_in, settings.ease_out)
    half = np.minimum(0.5 * ease, np.minimum(room[:-1], room[1:]))
    half = np.maximum(half, 0.5 / fps)  # a curve of frames can be no steeper
    times = np.stack([events - half, events + half], axis=-1).ravel().clip(0.0, bounds[-1])
    values = np.stack([~rises, rises], axis=-1).ravel().astype(np.float64)
    # Ramps that meet share a key.
    apart = np.concatenate([[True], np.diff(times) > 1e-3 / fps])
    return Keys(times=times[apart], values=values[apart])


def _stepped(phases: NDArray[np.int8], fps: float, loop: bool) -> Keys:
    values = phases.astype(np.float64)
    if loop and len(values) > 1:
        values[-1] = values[0]
    changes = np.flatnonzero(values[1:] != values[:-1]) + 1
    times = np.concatenate([[0.0], (changes - 0.5) / fps])
    return Keys(times=times, values=values[np.concatenate([[0], changes])], interpolation="step")


def _openkcc_curves(clip: Clip, rig: Rig, settings: BakeSettings) -> dict[str, Keys]:
    """The weight of each leg as OpenKCC bakes it; its keys are flat, as Unity makes them."""
    positions, _ = clip.model_pose()
    made = {}
    for leg in rig.legs:
        keys = bake_openkcc(
            (clip.times, positions[:, leg.ankle, 2]),
            length_s=clip.duration,
            rate=settings.rate,
            foot_grounded_height=settings.grounded_height,
        )
        made[weight_curve(leg.name)] = Keys(times=keys[:, 0] * clip.duration, values=keys[:, 1])
    return made


def bake_openkcc(
    heights: HeightTrack,
    *,
    length_s: float,
    rate: float = 30.0,
    foot_grounded_height: float = 0.05,
) -> Array:
    """One foot's IK weight curve as OpenKCC bakes it: 1 where the foot is low, else 0.

    It inherits two faults. Keys are sampled `1 / rate` apart but stored `1 / keys` apart, so time
    is skewed unless length * rate is whole; and only world height counts, so a foot on a stair is
    in the air.

    Args:
        heights: world height of the foot's joint, m: a function of times (N,) in seconds, or
            samples (times (K,) increasing, heights (K,)), read linearly.
        length_s: of the clip, s.
        rate: keys a second, before those that say nothing are dropped.
        foot_grounded_height: the joint's height, m, up to which the foot counts as grounded.

    Returns:
        (K, 2): normalised time 0 to 1, and value.

    Raises:
        FootIKError: the clip has no length, a rate is not positive, or a height is not finite.
    """
    if not (np.isfinite(rate) and rate > 0.0):
        raise FootIKError(f"the baking rate must be positive and finite, not {rate}.")
    if not (np.isfinite(length_s) and length_s > 0.0):
        raise FootIKError(f"cannot bake a clip of {length_s} s; its length must be positive.")
    # The count is rounded up in float32, as it was where these curves were first made.
    keys = int(np.ceil(np.float32(length_s) * np.float32(rate)))
    sampled_at = np.arange(keys) / rate
    stored_at = np.arange(keys) / keys
    sampled_at[-1], stored_at[-1] = length_s, 1.0
    track = _read(heights, sampled_at)
    bad = np.flatnonzero(~np.isfinite(track))
    if len(bad):
        raise FootIKError(f"the foot's height is not finite at {sampled_at[bad[0]]:.4g} s.")
    return _without_repeats(stored_at, np.where(track <= foot_grounded_height, 1.0, 0.0))


def _read(heights: HeightTrack, times: Array) -> Array:
    if callable(heights):
        return np.asarray(heights(times), dtype=np.float64)
    at, values = (np.asarray(part, dtype=np.float64) for part in heights)
    if at.ndim != 1 or at.shape != values.shape or len(at) == 0 or (np.diff(at) <= 0.0).any():
        raise FootIKError(
            f"a height track needs increasing times (K,) and heights (K,), "
            f"not {at.shape} and {values.shape}."
        )
    return np.interp(times, at, values)


def _without_repeats(times: Array, values: Array) -> Array:
    """Keys (K, 2) without those equal to both neighbours."""
    kept = np.ones(len(values), dtype=bool)
    kept[1:-1] = (values[1:-1] != values[:-2]) | (values[1:-1] != values[2:])
    return np.column_stack([times[kept], values[kept]])
