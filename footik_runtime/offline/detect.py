"""Detect: which heels and toes are on the ground, told from their motion alone.

A point surely stands where it is slow: a core. From each core the contact grows to both sides while
the point is slow enough and near the height of its own core, so that stairs, slopes and a drifting
root need no notion of a floor. Smoothing follows the noise that is measured, and thresholds follow
the smoothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays
from footik_runtime.compiled import compiled
from footik_runtime.errors import FootIKError
from footik_runtime.offline.belt import belt_velocity
from footik_runtime.offline.filters import (
    contact_spans,
    fill_gaps,
    gaussian,
    hold_last,
    latched,
    median_of,
    noise_sd,
    runs,
    sliding_mean,
    span_means,
    span_medians,
)
from footik_runtime.offline.stages import CleanSettings, Contacts, ContactSettings, Working
from footik_runtime.phases import Phase, phase_curve, weight_curve

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

HEEL, TOE = 0, 1

_KERNEL = 4.0 * math.sqrt(math.pi)  # white noise through a differentiated Gaussian
_STEP = math.sqrt(2.0 * math.pi)  # slope of a smoothed step: its height over sigma and this
_TRAVEL = 0.5  # s to either side in which the body's speed is averaged
_SUREST = 0.3  # width of the confidence's slope, in parts of a threshold, on clean motion
_ONE_FLOOR = 0.05  # m: balls that stand within it stand on one level floor
_LEVEL, _ROLLED = math.radians(3.0), math.radians(6.0)  # pitch of a flat sole, of one that rolls


@dataclass(frozen=True, kw_only=True, eq=False)
class _Motion:
    """Points of one body as the thresholds see them, lengths for a leg of 0.85 m.

    speed, height: (T, F, 2). travel: (T,) speed of the body. missing: (T, F, 2). sigma: s. sd: m
    and left: m/s of noise, before smoothing and in each axis of the velocity after it. raw: (T, F,
    2) speed with the noise's share in it. belt: (3,) m/s.
    """

    fps: float
    speed: Array
    raw: Array
    height: Array
    travel: Array
    missing: Bools
    sigma: float
    sd: float
    left: float
    belt: Array


def contacts(
    points: Array, fps: float, *, scale: float = 1.0, settings: ContactSettings | None = None
) -> Contacts:
    """Contacts of heel and toe of every foot.

    Args:
        points: (T, F, 2, 3) heel and toe (the ball) of each foot, m, z up; NaN where missing.
        fps: frames a second.
        scale: leg length over 0.85 m; thresholds grow with it.
        settings: thresholds.

    Raises:
        FootIKError: points of another shape, or fps or scale that are not positive.
    """
    settings = ContactSettings() if settings is None else settings
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 4 or points.shape[2:] != (2, 3):
        raise FootIKError(f"points must have shape (T, F, 2, 3), not {points.shape}.")
    if not (math.isfinite(fps) and fps > 0.0 and math.isfinite(scale) and scale > 0.0):
        raise FootIKError(f"fps and scale must be positive and finite, not {fps} and {scale}.")
    if len(points) < 2:
        return _too_short(points, fps)
    seen = _look(points / scale, fps, settings)
    cores = _cores(seen, settings)
    down, excess, ground = _grown(seen, cores, settings)
    _drop_short(down, fps, settings)
    down &= ~_long_gaps(seen.missing, fps, settings)
    width = _SUREST + min(seen.left / 0.05, 1.0)
    confidence = 1.0 / (1.0 + np.exp((np.minimum(excess, 9.0) - 1.0) / width))
    confidence[_long_gaps(seen.missing, fps, settings)] = 0.0
    return Contacts(
        fps=fps,
        down=down,
        confidence=confidence,
        ground=ground * scale,
        belt=seen.belt * scale,
        noise=seen.sd * scale,
        sigma=seen.sigma,
    )


def of_clip(work: Working, settings: CleanSettings) -> Contacts:
    """Contacts of a working clip: from its curves, and where it has none from its soles' motion.

    A phase curve tells heel and toe, a weight curve the contact, of which the sole's pitch tells
    the rest. Its belt is out already. Raises FootIKError for a phase that is no `Phase`.
    """
    phases = {} if settings.redetect else given_phases(work)
    weights = {} if settings.redetect else _given_weights(work)
    if len(phases) == len(work.rig.legs):
        return _told(work, phases)
    found = work.contacts
    if found is None:
        still = replace(settings.contact, belt="none")
        found = contacts(work.soles[:, :, :2], work.clip.fps, scale=work.scale, settings=still)
    down = found.down.copy()
    for foot, held in weights.items():
        down[:, foot] = held[:, None]
    _roll(down, work.soles, _pitch(work), work.scale)
    for foot, phase in phases.items():
        down[:, foot] = _down(phase)
    return replace(found, down=down, belt=work.belt)


def given_phases(work: Working) -> dict[int, NDArray[np.int8]]:
    """Leg -> (N,) the phase its curve gives; a blend of two (2.5) counts as the frame before.

    Raises FootIKError for a value that is no `Phase`.
    """
    given = {}
    for i, leg in enumerate(work.rig.legs):
        curve = phase_curve(leg.name)
        if curve in work.clip.curves:
            given[i] = _whole_phases(work, curve)
    return given


def _whole_phases(work: Working, curve: str) -> NDArray[np.int8]:
    values = np.asarray(work.clip.curves[curve], dtype=np.float64)
    bad = np.flatnonzero((values < Phase.SWING) | (values > Phase.BALL))
    if len(bad):
        own = bad[bad >= work.pad][0]
        raise FootIKError(
            f"{work.clip.name}: curve {curve!r} is {values[own]:g} at frame {own - work.pad}; a "
            f"phase is {', '.join(f'{p.value} ({p.name.lower()})' for p in Phase)}."
        )
    whole = np.abs(values - np.round(values)) < 1e-6
    whole[0] = True
    last = np.maximum.accumulate(np.where(whole, np.arange(len(values)), 0))
    return np.round(values[last]).astype(np.int8)


def _given_weights(work: Working) -> dict[int, Bools]:
    """Leg -> (N,) whether its weight curve says that it is in contact."""
    names = {i: weight_curve(leg.name) for i, leg in enumerate(work.rig.legs)}
    curves = work.clip.curves
    return {i: np.asarray(curves[name]) >= 0.5 for i, name in names.items() if name in curves}


def _too_short(points: Array, fps: float) -> Contacts:
    height = np.nan_to_num(points[..., 2])
    return Contacts(
        fps=fps,
        down=np.zeros(height.shape, dtype=bool),
        confidence=np.zeros(height.shape),
        ground=height,
        belt=np.zeros(3),
    )


# --- what is seen -------------------------------------------------------------------------------


def _look(points: Array, fps: float, settings: ContactSettings) -> _Motion:
    """Smooth as the noise asks, take the velocity, and take what the feet ride out of it."""
    frames, feet = points.shape[:2]
    flat = points.reshape(frames, -1, 3)
    sd = noise_sd(flat)
    flat, missing = fill_gaps(flat)
    sigma = (sd / settings.velocity_noise) ** 2 / fps / _KERNEL if settings.velocity_noise else 0.0
    sigma = max(settings.least_smoothing, sigma ** (1.0 / 3.0), 1e-6)
    left = sd * math.sqrt(1.0 / fps / (_KERNEL * sigma**3))
    smooth = gaussian(flat, sigma * fps)
    velocity = np.gradient(smooth, axis=0) * fps
    belt = np.zeros(3)
    if settings.belt == "auto":
        belt = belt_velocity(smooth[..., 2], velocity, missing, fps, left)
        velocity = velocity - belt
        smooth = smooth - belt * (np.arange(frames) / fps)[:, None, None]
    shape = (frames, feet, 2)
    squared = np.sum(velocity**2, axis=-1).reshape(shape)
    toes = velocity.reshape(*shape, 3)[:, :, TOE, :2]
    return _Motion(
        fps=fps,
        # The noise's own share of the speed is taken out: thresholds need not grow with it.
        speed=np.sqrt(np.maximum(squared - 3.0 * left * left, 0.0)),
        raw=np.sqrt(squared),
        height=smooth[..., 2].reshape(shape),
        travel=sliding_mean(np.hypot(toes[..., 0], toes[..., 1]).mean(axis=1), int(_TRAVEL * fps)),
        missing=missing.reshape(shape),
        sigma=sigma,
        sd=sd,
        left=left,
        belt=belt,
    )


# --- cores --------------------------------------------------------------------------------------


def _cores(seen: _Motion, settings: ContactSettings) -> Bools:
    """(T, F, 2) frames in which a point surely stands."""
    slow = seen.speed < np.array(settings.core_speed)
    frames, feet = slow.shape[:2]
    spans = contact_spans(slow.reshape(frames, -1))
    starts, stops = spans[:, 1], spans[:, 2]
    inside = (starts > 0) & (stops < frames)
    short = inside & (stops - starts < settings.shortest_core * seen.fps)
    for point, start, stop in spans[short]:
        slow[start:stop, *divmod(point, 2)] = False
    spans = spans[~short]
    heights = span_medians(seen.height.reshape(frames, 2 * feet), spans)
    standing = slow.copy()
    over = _over_neighbours(spans[:, 0], heights)
    for k in np.flatnonzero(over > settings.hover):
        (foot, point), (start, stop) = divmod(spans[k, 0], 2), spans[k, 1:]
        most = settings.hover if np.isfinite(over[k]) else settings.hover_alone
        if _another_lower(seen, slow, foot, start, stop, heights[k] - most):
            standing[start:stop, foot, point] = False
    return standing


def _over_neighbours(points: Ints, heights: Array) -> Array:
    """(K,) height of each core over the higher of the same point's before and after, m.

    Infinite where there is neither.
    """
    if not len(heights):
        return heights
    lone = np.full(1, -np.inf)
    same = points[1:] == points[:-1]
    before = np.concatenate([lone, np.where(same, heights[:-1], -np.inf)])
    after = np.concatenate([np.where(same, heights[1:], -np.inf), lone])
    return heights - np.maximum(before, after)


def _another_lower(
    seen: _Motion, slow: Bools, foot: int, start: int, stop: int, height: float
) -> bool:
    """Whether another foot stands all the while, under this height: this one is held up."""
    for other in range(slow.shape[1]):
        stands = other != foot and slow[start:stop, other].any(axis=-1).all()
        if stands and np.median(seen.height[start:stop, other].min(axis=-1)) < height:
            return True
    return False


def _strictness(seen: _Motion, cores: Bools, settings: ContactSettings) -> float:
    """The part of the thresholds that holds here: feet made by formulas stand quite still."""
    raw = seen.raw[cores & ~seen.missing]
    if raw.size == 0 or settings.captured <= 0.0:
        return 1.0
    return float(np.clip(np.median(raw) / settings.captured, settings.strictest, 1.0))


# --- growing ------------------------------------------------------------------------------------


def _grown(seen: _Motion, cores: Bools, settings: ContactSettings) -> tuple[Bools, Array, Array]:
    """Contacts (T, F, 2), how near each frame is to the thresholds (1: on them), and its ground."""
    strict = _strictness(seen, cores, settings)
    # A kink that is blurred is seen early and fast.
    blur = settings.blur_speed * (seen.sigma - settings.least_smoothing) / _STEP
    rise = settings.blur_height * seen.sigma
    # The heel of a runner strikes while it still moves.
    run = strict * settings.run_gain * np.maximum(seen.travel - settings.run_from, 0.0)
    down = np.zeros(cores.shape, dtype=bool)
    excess, ground = np.zeros(cores.shape), np.zeros(cores.shape)
    for foot in range(cores.shape[1]):
        for point in (HEEL, TOE):
            at = (slice(None), foot, point)
            strike = strict * settings.strike_speed[point] + blur + (run if point == HEEL else 0.0)
            off = strict * settings.off_speed[point] + blur
            near = strict * settings.strike_height[point] + rise
            away = strict * settings.off_height[point] + rise
            core, speed, height = cores[at], seen.speed[at], seen.height[at]
            before = hold_last(core, height)
            after = hold_last(core[::-1], height[::-1])[::-1]
            over_before, over_after = np.abs(height - before), np.abs(height - after)
            leaving = latched(core, (speed < off) & (over_before < away))
            striking = latched(core[::-1], ((speed < strike) & (over_after < near))[::-1])[::-1]
            down[at] = leaving | striking
            excess[at] = np.minimum(
                np.maximum(speed / np.maximum(off, 1e-9), over_before / max(away, 1e-9)),
                np.maximum(speed / np.maximum(strike, 1e-9), over_after / max(near, 1e-9)),
            )
            nearest = np.where(over_before < over_after, before, after)
            ground[at] = np.where(np.isfinite(nearest), nearest, height)
    return down, excess, ground


def _drop_short(down: Bools, fps: float, settings: ContactSettings) -> None:
    """Fill short swings and drop short contacts of whole feet, in place; cut ones at the ends stay.

    A filled frame repeats the one before it.
    """
    frames = len(down)
    for foot in range(down.shape[1]):
        for state, least in ((False, settings.shortest_swing), (True, settings.shortest_contact)):
            for start, stop in runs(np.asarray(down[:, foot].any(axis=-1) == state)):
                if start == 0 or stop == frames or stop - start >= least * fps - 1e-9:
                    continue
                down[start:stop, foot] = False if state else down[start - 1, foot]


def _long_gaps(missing: Bools, fps: float, settings: ContactSettings) -> Bools:
    """(T, F, 2) frames of gaps too long to be bridged."""
    out = np.zeros(missing.shape, dtype=bool)
    for foot, point in np.argwhere(missing.any(axis=0)):
        for start, stop in runs(missing[:, foot, point]):
            if stop - start > settings.longest_gap * fps:
                out[start:stop, foot, point] = True
    return out


# --- clips --------------------------------------------------------------------------------------


def _told(work: Working, phases: Mapping[int, NDArray[np.int8]]) -> Contacts:
    """What the phase curves of a working clip say."""
    down = np.stack([_down(phase) for _, phase in sorted(phases.items())], axis=1)
    height = work.soles[:, :, :2, 2]
    return Contacts(
        fps=work.clip.fps,
        down=down,
        confidence=down.astype(np.float64),
        ground=_held(down, height),
        belt=np.zeros(3),
    )


def _down(phase: NDArray[np.int8]) -> Bools:
    """(N, 2) whether heel and toe carry in each phase (N,)."""
    heel = (phase == Phase.HEEL) | (phase == Phase.FLAT)
    toe = (phase == Phase.BALL) | (phase == Phase.FLAT)
    return np.stack([heel, toe], axis=-1)


def _held(down: Bools, height: Array) -> Array:
    """(T, F, 2) the height of the contact that holds a frame, or of the nearest in time."""
    out = height.copy()
    for foot, point in np.ndindex(*down.shape[1:]):
        spans = runs(down[:, foot, point])
        if len(spans) == 0:
            continue
        levels = np.array([np.median(height[a:b, foot, point]) for a, b in spans])
        middles = 0.5 * (spans[1:, 0] + spans[:-1, 1])
        out[:, foot, point] = levels[np.searchsorted(middles, np.arange(len(down)))]
    return out


def _pitch(work: Working) -> Array:
    """(T, F) how far each sole's nose points up, rad."""
    pitch = np.zeros(work.soles.shape[:2])
    for i, leg in enumerate(work.rig.legs):
        ahead = quat_arrays.rotate(leg.sole.frame, np.array([1.0, 0.0, 0.0]))
        ahead = quat_arrays.rotate(work.rotations[:, leg.ankle], ahead)
        pitch[:, i] = np.arcsin(np.clip(ahead[:, 2], -1.0, 1.0))
    return pitch


def _roll(down: Bools, soles: Array, pitch: Array, scale: float) -> None:
    """Let a sole's pitch tell heel-off and toe-down in contacts (T, F, 2), in place.

    Points are slow about the moment they leave the ground; the sole's angle is not. It is told
    against the foot's pitch when flat: its usual one on a level floor, else the contact's own. A
    foot that stands on its ball for a while is as still as a flat one.
    """
    spans = contact_spans(np.asarray(down.any(axis=-1)))
    if not len(spans):
        return
    scratch, own = np.empty(len(down) * down.shape[1]), np.empty(len(spans))
    _flat_pitches(down, pitch, spans, scratch, own)
    if np.ptp(span_means(soles[:, :, TOE], spans)[:, 2]) < _ONE_FLOOR * scale:
        for foot in range(down.shape[1]):
            flat = np.asarray(down[:, foot].all(axis=-1))
            if flat.any():
                own[spans[:, 0] == foot] = np.median(pitch[flat, foot])
    _roll_spans(down, pitch, spans, own)


@compiled
def _flat_pitches(down, pitch, spans, scratch, out):
    """Write each contact's median pitch while both ends are down; 0 where they never are."""
    for k in range(spans.shape[0]):
        foot, start, stop = spans[k, 0], spans[k, 1], spans[k, 2]
        flats = 0
        for t in range(start, stop):
            if down[t, foot, HEEL] and down[t, foot, TOE]:
                scratch[flats] = pitch[t, foot]
                flats += 1
        out[k] = median_of(scratch, flats) if flats else 0.0


@compiled
def _roll_spans(down, pitch, spans, flats):
    for k in range(spans.shape[0]):
        foot, start, stop = spans[k, 0], spans[k, 1], spans[k, 2]
        lifted, raised = False, False
        for t in range(start, stop):
            angle = pitch[t, foot] - flats[k]
            lifted = angle < -_ROLLED or (lifted and angle < -_LEVEL)
            raised = angle > _ROLLED or (raised and angle > _LEVEL)
            down[t, foot, HEEL] = (down[t, foot, HEEL] and not lifted) or raised
            down[t, foot, TOE] = (down[t, foot, TOE] and not raised) or lifted
