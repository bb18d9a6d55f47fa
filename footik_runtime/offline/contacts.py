"""Contacts found from motion alone: level the captured floor, fit the soles, tell the phases."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.math3d import quat_between, quat_upright, rotate
from footik_runtime.phases import Phase, phase_curve, weight_curve
from footik_runtime.rig import Leg, Rig, Sole
from footik_runtime.sole import BALL, HEEL, all_sole_points

Array = NDArray[np.float64]

_UP = np.array([0.0, 0.0, 1.0])

# Thresholds of a body whose legs are 0.85 m long; lengths and speeds scale with the leg.
_LEG = 0.85
_STILL = 0.25  # m/s, of a point that surely stands
_ENTER_SPEED, _LEAVE_SPEED = 0.45, 0.70  # m/s
_ENTER_HEIGHT, _LEAVE_HEIGHT = 0.035, 0.055  # m over the floor
_CAPTURED = 0.06  # m/s: a median speed in contact of at least this is that of a capture
_STRICTEST = 0.4  # of the speed thresholds, for feet that stand quite still
_SHORTEST_CONTACT, _SHORTEST_SWING = 0.10, 0.08  # s
_LEVEL, _ROLLED = (
    math.radians(3.0),
    math.radians(6.0),
)  # pitch of a flat sole, and of one that rolls
_MOST_TILT = math.radians(4.0)
_FLAT_RESIDUAL = 0.03  # m: a floor less even than this is no tilted plane
_ONE_FLOOR = 0.06  # m: feet that stand farther apart in height stand on different floors


def point_speed(points: Array, fps: float) -> Array:
    """Speed (T, ...) of points (T, ..., 3) in m/s, by central differences."""
    if len(points) < 2:
        return np.zeros(points.shape[:-1])
    return np.linalg.norm(np.gradient(points, axis=0), axis=-1) * fps


def level(clip: Clip, rig: Rig) -> Clip:
    """The clip with its floor's tilt taken out, where the feet stood on one nearly level plane.

    A captured floor is off by about a degree, which is centimetres over a few steps.
    """
    positions, rotations = clip.model_pose()
    scale = float(rig.leg_lengths.mean()) / _LEG
    balls = all_sole_points(rig, positions, rotations)[:, :, BALL]
    still = point_speed(balls, clip.fps) < _STILL * scale
    stood = balls[still]
    if len(stood) < 10:
        return clip
    normal = _plane_normal(stood, scale)
    if normal is None:
        return clip
    upright = np.array(quat_between(tuple(normal), (0.0, 0.0, 1.0)))
    turned = clip.rotations.copy()
    turned[:, 0] = quat_arrays.mul(upright, turned[:, 0])
    return replace(
        clip, root_positions=quat_arrays.rotate(upright, clip.root_positions), rotations=turned
    )


def _plane_normal(points: Array, scale: float) -> Array | None:
    """Normal of the plane through points (N, 3), or None where they make no nearly level plane."""
    centred = points - points.mean(axis=0)
    # A walk says little about the tilt across its way: a ridge keeps that part small.
    ridge = len(points) * (0.15 * scale) ** 2
    flat = centred[:, :2]
    slope = np.linalg.solve(flat.T @ flat + ridge * np.eye(2), flat.T @ centred[:, 2])
    residual = centred[:, 2] - flat @ slope
    if math.atan(np.linalg.norm(slope)) > _MOST_TILT or residual.std() > _FLAT_RESIDUAL * scale:
        return None
    normal = np.array([-slope[0], -slope[1], 1.0])
    return normal / np.linalg.norm(normal)


def fit_soles(clip: Clip, rig: Rig) -> tuple[Clip, Rig]:
    """The rig with each sole flat where the foot stands still, and the clip with that floor at 0.

    A rest pose seldom says how the foot lies on the ground; its stance in the clip does. A foot
    that never stands, or only far above the others, keeps its sole.
    """
    positions, rotations = clip.model_pose()
    scale = float(rig.leg_lengths.mean()) / _LEG
    flat = [_standing_flat(leg, positions, clip.fps, scale) for leg in rig.legs]
    floors = np.full(len(rig.legs), np.inf)
    for i, leg in enumerate(rig.legs):
        if flat[i].sum() >= 3:
            floors[i] = np.median(positions[flat[i], leg.ankle, 2]) - leg.sole.height
    lowest = float(floors.min())
    if lowest == np.inf:
        lowest = floor = float(all_sole_points(rig, positions, rotations)[..., 2].min())
    else:
        floor = float(floors[floors < lowest + _ONE_FLOOR * scale].mean())
    legs = tuple(
        replace(leg, sole=_fitted_sole(leg, rotations[flat[i]]))
        if floors[i] < lowest + _ONE_FLOOR * scale
        else leg
        for i, leg in enumerate(rig.legs)
    )
    drop = np.array([0.0, 0.0, floor])
    return replace(clip, root_positions=clip.root_positions - drop), replace(rig, legs=legs)


def _standing_flat(leg: Leg, positions: Array, fps: float, scale: float) -> NDArray[np.bool_]:
    """(T,) frames in which the whole foot stands still, near its lowest."""
    ankle = positions[:, leg.ankle]
    still = point_speed(ankle, fps) < _STILL * scale
    if leg.toe >= 0:
        still &= point_speed(positions[:, leg.toe], fps) < _STILL * scale
    low = ankle[:, 2] < np.percentile(ankle[:, 2], 5) + 0.04 * scale
    return still & low


def _fitted_sole(leg: Leg, rotations: Array) -> Sole:
    """The sole whose frame is upright in these standing poses (N, J, 4)."""
    foot = rotations[:, leg.ankle]
    up = quat_arrays.rotate(quat_arrays.conj(foot), _UP).mean(axis=0)
    frame = quat_upright(rotate(tuple(leg.sole.frame), (1.0, 0.0, 0.0)), tuple(up))
    toe_frame = np.array([1.0, 0.0, 0.0, 0.0])
    if leg.toe >= 0:
        toes = quat_arrays.conj(rotations[:, leg.toe])
        lying = quat_arrays.mul(toes, quat_arrays.mul(foot, np.array(frame)))
        lying *= np.where(lying @ lying[0] < 0.0, -1.0, 1.0)[:, None]
        toe_frame = lying.mean(axis=0) / np.linalg.norm(lying.mean(axis=0))
    return replace(leg.sole, frame=np.array(frame), toe_frame=toe_frame)


def detect_phases(
    clip: Clip, rig: Rig, *, held: Mapping[int, NDArray[np.bool_]] | None = None
) -> NDArray[np.int8]:
    """(T, legs) `Phase` of each foot, for a levelled clip whose floor is at z = 0.

    A loop is told as a cycle that goes on: its last frame has the phase of its first. `held` gives
    the contact (T,) of those legs, by index, where it is known.
    """
    positions, rotations = clip.model_pose()
    points = all_sole_points(rig, positions, rotations)
    scale = float(rig.leg_lengths.mean()) / _LEG
    last = len(clip) - 1
    around = clip.loop and last > 0
    if around:
        points = _three_cycles(points, clip)
    speed = point_speed(points, clip.fps) / scale
    height = points[..., 2] / scale
    speed /= _strictness(speed[..., BALL], height[..., BALL])
    pitch = _pitch(points)
    phases = np.zeros(points.shape[:2], dtype=np.int8)
    for i in range(len(rig.legs)):
        heel, ball = (_stands(speed[:, i, p], height[:, i, p]) for p in (HEEL, BALL))
        if held is not None and i in held:
            contact = _ring(held[i]) if around else held[i]
        else:
            contact = _without_short(heel | ball, clip.fps)
        phases[:, i] = _phase_of(heel, ball, pitch[:, i], contact)
    return np.concatenate([phases[last : 2 * last], phases[last : last + 1]]) if around else phases


def _ring(values: NDArray) -> NDArray:
    """Values (T,) of a loop, three cycles of them."""
    return np.concatenate([values[:-1], values[:-1], values[:-1], values[:1]])


def _three_cycles(points: Array, clip: Clip) -> Array:
    """Points (T, ..., 3) of a loop, with the cycle before it and the one after it."""
    yaw, step = clip.stride()
    turn = quat_arrays.about(_UP, yaw)
    before = quat_arrays.rotate(quat_arrays.conj(turn), points[:-1] - step)
    after = quat_arrays.rotate(turn, points[1:]) + step
    return np.concatenate([before, points, after])


def _strictness(speed: Array, height: Array) -> float:
    """What to multiply the speed thresholds by, for balls' speeds and heights (T, legs).

    A captured foot that stands still moves at some 0.1 m/s, one made by formulas not at all: there,
    the slow frames before a strike and after toe-off are no contact.
    """
    down = np.stack([_stands(v, z) for v, z in zip(speed.T, height.T, strict=True)], axis=1)
    if not down.any():
        return 1.0
    return float(np.clip(np.median(speed[down]) / _CAPTURED, _STRICTEST, 1.0))


def _pitch(points: Array) -> Array:
    """(T, legs) how far each sole (T, legs, 3, 3) points its nose up, rad."""
    along = points[..., BALL, :] - points[..., HEEL, :]
    return np.arctan2(along[..., 2], np.hypot(along[..., 0], along[..., 1]))


def _stands(speed: Array, height: Array) -> NDArray[np.bool_]:
    """(T,) whether a point stands, by its speed and its height over the floor."""
    enters = (speed < _ENTER_SPEED) & (height < _ENTER_HEIGHT)
    return _latched(enters, (speed < _LEAVE_SPEED) & (height < _LEAVE_HEIGHT))


def _latched(enters: NDArray[np.bool_], stays: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(T,) a state that begins where it `enters` and lasts as long as it `stays`."""
    # A frame that only "stays" has the state where the last decisive frame before it was an entry;
    # one before all of them, where the first is a leave.
    decisive = enters | ~stays
    if not decisive.any():
        return np.zeros(len(enters), dtype=bool)
    last = np.maximum.accumulate(np.where(decisive, np.arange(len(enters)), -1))
    return np.where(last >= 0, enters[np.maximum(last, 0)], ~enters[np.argmax(decisive)])


def _without_short(contact: NDArray[np.bool_], fps: float) -> NDArray[np.bool_]:
    """Short swings filled, then short contacts dropped; those cut off by an end are kept."""
    out = contact.copy()
    for value, shortest in ((False, _SHORTEST_SWING), (True, _SHORTEST_CONTACT)):
        edges = np.flatnonzero(np.diff(np.concatenate([[not value], out, [not value]]) == value))
        for start, stop in edges.reshape(-1, 2):
            inside = start > 0 and stop < len(out)
            if inside and (stop - start) < shortest * fps:
                out[start:stop] = not value
    return out


def _phase_of(
    heel: NDArray[np.bool_], ball: NDArray[np.bool_], pitch: Array, contact: NDArray[np.bool_]
) -> NDArray[np.int8]:
    """(T,) the phase of each frame in contact: flat where both ends are down and the sole level.

    A heel leaves the ground long before it is too high or too fast to be called down: the pitch
    of the sole (rad, nose up) tells. Where neither end is down, it tells alone.
    """
    nose_up = _latched(pitch > _ROLLED, pitch > _LEVEL)
    nose_down = _latched(pitch < -_ROLLED, pitch < -_LEVEL)
    on_heel = (heel & ~ball) | (nose_up & (heel | ~ball))
    on_ball = (ball & ~heel) | (nose_down & (ball | ~heel))
    phase = np.where(on_heel, Phase.HEEL, np.where(on_ball, Phase.BALL, Phase.FLAT))
    return np.where(contact, phase, Phase.SWING).astype(np.int8)


def with_contacts(clip: Clip, rig: Rig) -> tuple[Clip, Rig]:
    """A levelled clip with weight and phase curves, and the rig with the soles that fit it.

    Curves that the clip has are kept: a phase is in contact where it says so, a weight where it is
    at least .5, and what is missing is told from the motion. A clip with a curve for every leg
    keeps its floor, and with a phase for every leg its soles too. Raises FootIKError for a phase
    that is no `Phase`.
    """
    phased = [phase_curve(leg.name) in clip.curves for leg in rig.legs]
    weighted = [weight_curve(leg.name) in clip.curves for leg in rig.legs]
    if not np.logical_or(phased, weighted).all():
        clip, rig = fit_soles(level(clip, rig), rig)
    elif not all(phased):
        _, rig = fit_soles(clip, rig)
    held = {
        i: np.asarray(clip.curves[weight_curve(leg.name)]) >= 0.5
        for i, leg in enumerate(rig.legs)
        if weighted[i]
    }
    phases = detect_phases(clip, rig, held=held)
    curves: dict[str, Array] = {}
    for i, leg in enumerate(rig.legs):
        phase = _given_phase(clip, leg.name) if phased[i] else phases[:, i]
        curves[phase_curve(leg.name)] = phase.astype(np.float64)
        if not weighted[i]:
            curves[weight_curve(leg.name)] = (phase != Phase.SWING).astype(np.float64)
    return clip.with_curves(**curves), rig


def _given_phase(clip: Clip, leg: str) -> NDArray[np.int8]:
    """(T,) the phase that a clip's curve gives; a blend of two (2.5) counts as the frame before."""
    values = np.asarray(clip.curves[phase_curve(leg)], dtype=np.float64)
    bad = np.flatnonzero((values < Phase.SWING) | (values > Phase.BALL))
    if len(bad):
        raise FootIKError(
            f"{clip.name}: curve {phase_curve(leg)!r} is {values[bad[0]]:g} at frame {bad[0]}; a "
            f"phase is {', '.join(f'{p.value} ({p.name.lower()})' for p in Phase)}."
        )
    whole = np.abs(values - np.round(values)) < 1e-6
    whole[0] = True
    last = np.maximum.accumulate(np.where(whole, np.arange(len(values)), 0))
    return np.round(values[last]).astype(np.int8)


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
