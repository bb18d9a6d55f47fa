"""Contacts found from motion alone: level the captured floor, fit the soles, tell the phases."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays
from footik_runtime.clip import Clip
from footik_runtime.math3d import quat_between, quat_upright, rotate
from footik_runtime.phases import Phase, phase_curve, weight_curve
from footik_runtime.rig import Leg, Rig
from footik_runtime.sole import BALL, HEEL, all_sole_points

Array = NDArray[np.float64]

# Thresholds of a body whose legs are 0.85 m long; lengths and speeds scale with the leg.
_LEG = 0.85
_STILL = 0.25  # m/s, of a point that surely stands
_ENTER_SPEED, _LEAVE_SPEED = 0.45, 0.70  # m/s
_ENTER_HEIGHT, _LEAVE_HEIGHT = 0.035, 0.055  # m over the floor
_SHORTEST_CONTACT, _SHORTEST_SWING = 0.10, 0.08  # s
_LEVEL = math.radians(4.0)  # pitch of a sole up to which it lies flat
_MOST_TILT = math.radians(4.0)
_FLAT_RESIDUAL = 0.03  # m: a floor less even than this is no tilted plane


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

    A rest pose seldom says how the foot lies on the ground; its stance in the clip does.
    """
    positions, rotations = clip.model_pose()
    scale = float(rig.leg_lengths.mean()) / _LEG
    legs, floors = [], []
    for leg in rig.legs:
        flat = _standing_flat(leg, positions, rotations, clip.fps, scale)
        if flat.sum() < 3:
            legs.append(leg)
            continue
        legs.append(replace(leg, sole=_fitted_sole(leg, rotations[flat])))
        floors.append(np.median(positions[flat, leg.ankle, 2]) - leg.sole.height)
    if not floors:
        floors = [float(all_sole_points(rig, positions, rotations)[..., 2].min())]
    drop = np.array([0.0, 0.0, float(np.mean(floors))])
    return (
        replace(clip, root_positions=clip.root_positions - drop),
        replace(rig, legs=tuple(legs)),
    )


def _standing_flat(
    leg: Leg, positions: Array, rotations: Array, fps: float, scale: float
) -> NDArray[np.bool_]:
    """(T,) frames in which the whole foot stands still, near its lowest."""
    ankle = positions[:, leg.ankle]
    still = point_speed(ankle, fps) < _STILL * scale
    if leg.toe >= 0:
        still &= point_speed(positions[:, leg.toe], fps) < _STILL * scale
    low = ankle[:, 2] < np.percentile(ankle[:, 2], 5) + 0.04 * scale
    return still & low


def _fitted_sole(leg: Leg, rotations: Array):
    """The sole whose frame is upright in these standing poses (N, J, 4)."""
    foot = rotations[:, leg.ankle]
    up = quat_arrays.rotate(foot * [1.0, -1.0, -1.0, -1.0], np.array([0.0, 0.0, 1.0])).mean(axis=0)
    frame = quat_upright(rotate(tuple(leg.sole.frame), (1.0, 0.0, 0.0)), tuple(up))
    toe_frame = np.array([1.0, 0.0, 0.0, 0.0])
    if leg.toe >= 0:
        toes = rotations[:, leg.toe] * [1.0, -1.0, -1.0, -1.0]
        lying = quat_arrays.mul(toes, quat_arrays.mul(foot, np.array(frame)))
        lying *= np.where(lying @ lying[0] < 0.0, -1.0, 1.0)[:, None]
        toe_frame = lying.mean(axis=0) / np.linalg.norm(lying.mean(axis=0))
    return replace(leg.sole, frame=np.array(frame), toe_frame=toe_frame)


def detect_phases(clip: Clip, rig: Rig) -> NDArray[np.int8]:
    """(T, legs) `Phase` of each foot, for a levelled clip whose floor is at z = 0."""
    positions, rotations = clip.model_pose()
    points = all_sole_points(rig, positions, rotations)
    scale = float(rig.leg_lengths.mean()) / _LEG
    speed = point_speed(points, clip.fps)
    height = points[..., 2]
    phases = np.zeros(points.shape[:2], dtype=np.int8)
    for i in range(len(rig.legs)):
        down = [_hysteresis(speed[:, i, p] / scale, height[:, i, p] / scale) for p in (HEEL, BALL)]
        contact = _without_short(down[HEEL] | down[BALL], clip.fps)
        span = np.linalg.norm(points[:, i, BALL] - points[:, i, HEEL], axis=-1)
        pitch = np.arcsin(np.clip((height[:, i, BALL] - height[:, i, HEEL]) / span, -1.0, 1.0))
        phases[:, i] = _phase_of(down[HEEL], down[BALL], pitch, contact)
    return phases


def _hysteresis(speed: Array, height: Array) -> NDArray[np.bool_]:
    """(T,) whether a point stands: entered below one pair of thresholds, left above another."""
    enters = (speed < _ENTER_SPEED) & (height < _ENTER_HEIGHT)
    stays = (speed < _LEAVE_SPEED) & (height < _LEAVE_HEIGHT)
    # A frame that only "stays" is down where the last decisive frame before it was an entry.
    decisive = enters | ~stays
    last = np.maximum.accumulate(np.where(decisive, np.arange(len(speed)), -1))
    return np.where(last >= 0, enters[np.maximum(last, 0)], False)


def _without_short(contact: NDArray[np.bool_], fps: float) -> NDArray[np.bool_]:
    """Short swings filled, then short contacts dropped."""
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
    of the sole (rad, nose up) tells.
    """
    on_heel = heel & (~ball | (pitch > _LEVEL))
    on_ball = ball & (~heel | (pitch < -_LEVEL))
    phase = np.where(on_heel, Phase.HEEL, np.where(on_ball, Phase.BALL, Phase.FLAT))
    # A filled gap has neither end down: it keeps the phase before it.
    known = heel | ball | ~contact
    last = np.maximum.accumulate(np.where(known, np.arange(len(phase)), 0))
    return np.where(contact, phase[last], Phase.SWING).astype(np.int8)


def with_contacts(clip: Clip, rig: Rig) -> tuple[Clip, Rig]:
    """A levelled clip with weight and phase curves, and the rig with the soles that fit it.

    A clip that has weight curves for every leg keeps them, and its floor; phases it lacks are told
    from the motion.
    """
    given = all(weight_curve(leg.name) in clip.curves for leg in rig.legs)
    if not given:
        clip, rig = fit_soles(level(clip, rig), rig)
    phases = detect_phases(clip, rig)
    curves: dict[str, Array] = {}
    for i, leg in enumerate(rig.legs):
        if phase_curve(leg.name) in clip.curves:
            continue
        if given:
            held = np.asarray(clip.curves[weight_curve(leg.name)]) >= 0.5
            told = np.where(phases[:, i] == Phase.SWING, Phase.FLAT, phases[:, i])
            phases[:, i] = np.where(held, told, Phase.SWING)
        else:
            curves[weight_curve(leg.name)] = (phases[:, i] > 0).astype(np.float64)
        curves[phase_curve(leg.name)] = phases[:, i].astype(np.float64)
    return clip.with_curves(**curves), rig
