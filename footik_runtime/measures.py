"""The measures of a recorded run, each its own function.

Speeds and slips are taken in the frame of the body each foot stands on, in world axes; heights
over the terrain under each point, and points over no terrain do not count. A measure with no
sample is NaN. They expect a run at 120 Hz (`resample`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from footik_runtime import quat_arrays
from footik_runtime.errors import FootIKError
from footik_runtime.recorded import BALL, BETWEEN_BODIES, FLAT, HEEL, Array, Bools, Run
from footik_runtime.resample import resample

DIFFERENCE_STEP = 1.0 / 30.0  # s; raw frame differences mostly measure noise and the sampler
HEIGHT_TOLERANCE = 0.005  # m
TOUCHING = 0.001  # m over the ground that still counts as on it: rounding must not decide
# Below these the input stands still, and a ratio to it would say nothing.
LEAST_ANGULAR_ACCELERATION = 1.0  # rad/s^2
LEAST_SHARE = 0.2  # of the liveliest joint of the legs: what a joint that keeps still counts as
LEAST_ACCELERATION = 1.0  # m/s^2, a tenth of gravity: hips that keep still count as this
LEAST_STEP = 0.0001  # m a frame


class PlantSlip(NamedTuple):
    """Slip per plant over all plants, mm."""

    mean: float
    largest: float


def pinned_point_speed(run: Run) -> float:
    """Mean horizontal speed of the sole point that carries the contact, mm/s.

    Over frames in contact at both ends: the heel in the heel phase, the ball in the ball phase,
    the mean of both when flat; the slower of both where phases are unknown.
    """
    speeds = _carried_travel(run, dims=2) / np.diff(run.times)[:, None]
    return 1000.0 * _mean(speeds[_contact_steps(run)])


def plant_slips(run: Run) -> Array:
    """(plants,) how far the held point travels within each plant, mm, in all three axes.

    A plant reaches from lock to release; its slip is the sum of the pinned point's path over the
    stretches where the pin stays the same point. For a run without locks a plant is a contact,
    and the point is the one that carries its phase, as in `pinned_point_speed`. Plants in which
    no point is held for two frames are left out.
    """
    if run.locked is None:
        held = run.contact
        counts = _both_ends(held)
        travel = _carried_travel(run, dims=3)
    else:
        held = run.locked
        same_pin = (run.pin[1:] == run.pin[:-1]) & (run.pin[1:] >= 0)
        counts = _both_ends(held) & same_pin
        steps = np.linalg.norm(_ground_steps(run, run.sole), axis=-1)
        travel = np.take_along_axis(steps, np.maximum(run.pin[:-1], 0)[..., None], -1)[..., 0]
    counts = counts & _on_one_body(run)
    starts = held & ~np.concatenate([np.zeros_like(held[:1]), held[:-1]])
    # Plants are numbered foot after foot, so that no two share a number.
    plants = np.cumsum(starts.T).reshape(held.T.shape).T[:-1]
    sums = np.bincount(plants[counts], weights=1000.0 * travel[counts])
    return sums[np.bincount(plants[counts]) > 0].astype(np.float64)


def slip_per_plant(run: Run) -> PlantSlip:
    """Mean and largest of `plant_slips`, mm."""
    slips = plant_slips(run)
    return PlantSlip(_mean(slips), _largest(slips))


def foot_joint_speed(run: Run) -> float:
    """Mean horizontal speed of the ankle and toe joints in contact, mm/s.

    The literature's figure. A right heel-off moves the ankle, so it cannot reach zero.
    """
    joints = np.stack([run.ankle, run.toe], axis=2)
    steps = np.linalg.norm(_ground_steps(run, joints)[..., :2], axis=-1)
    speeds = steps / np.diff(run.times)[:, None, None]
    return 1000.0 * _mean(speeds[_contact_steps(run)])


def skating_ratio(run: Run, height: float = 0.05, speed: float = 0.5, window: int = 5) -> float:
    """Share of frames, at 20 fps, in which a ball skates: low at both ends, fast, and fast on
    the mean of `window` frames (zeros past the ends); either foot (Guided Motion Diffusion).
    """
    run = resample(run, 20.0)
    if len(run) < 2:
        return math.nan
    low = _above_ground(run)[..., run.point("ball")] < height
    steps = np.linalg.norm(_ground_steps(run, run.sole)[:, :, run.point("ball"), :2], axis=-1)
    speeds = np.nan_to_num(steps) / np.diff(run.times)[:, None]
    padded = np.pad(speeds, ((window // 2, window - 1 - window // 2), (0, 0)))
    means = np.lib.stride_tricks.sliding_window_view(padded, window, axis=0).mean(axis=-1)
    skates = low[1:] & low[:-1] & (speeds > speed) & (means > speed)
    return _mean(skates.any(axis=1))


def sliding(run: Run, height: float) -> float:
    """Horizontal way of the balls near the ground, cm, all frames and feet (MANN).

    Each step counts 2 - 2^(h/height) for a height h of 0 to `height` m over the terrain.
    """
    above = _above_ground(run)[:-1, :, run.point("ball")]
    steps = np.linalg.norm(_ground_steps(run, run.sole)[:, :, run.point("ball"), :2], axis=-1)
    weights = np.where(above < height, 2.0 - 2.0 ** np.clip(above / height, 0.0, 1.0), 0.0)
    counted = np.isfinite(above) & _on_one_body(run)
    return 100.0 * float(np.sum((weights * steps)[counted])) if counted.any() else math.nan


def penetration(run: Run) -> float:
    """Depth of the lowest sole point of both feet under -5 mm, mean over frames, mm (PhysDiff)."""
    lowest = _lowest(run).min(axis=1)
    return 1000.0 * _mean(_depth(lowest[np.isfinite(lowest)]))


def penetration_p99(run: Run, where: str = "all") -> float:
    """99th percentile over frames and feet of the lowest sole point's depth under -5 mm, mm.

    Args:
        run: the run.
        where: "contact", "swing" or "all".
    """
    choices = {"contact": run.contact, "swing": ~run.contact, "all": np.ones_like(run.contact)}
    if where not in choices:
        raise FootIKError(f"penetration is measured in {', '.join(choices)}, not in {where!r}.")
    lowest = _lowest(run)
    return 1000.0 * _percentile(_depth(lowest[choices[where] & np.isfinite(lowest)]))


def float_in_contact(run: Run) -> float:
    """Height of the lowest sole point over +5 mm, mean over feet in contact, mm (PhysDiff)."""
    lowest = _lowest(run)
    heights = lowest[run.contact & np.isfinite(lowest)]
    return 1000.0 * _mean(np.maximum(heights - HEIGHT_TOLERANCE, 0.0))


def skate(run: Run) -> float:
    """Horizontal step of sole points on or under the ground at both ends, mean over frames, mm.

    A frame's figure is the mean over such points, 0 where there is none (PhysDiff).
    """
    touching = _above_ground(run) <= TOUCHING
    steps = np.linalg.norm(_ground_steps(run, run.sole)[..., :2], axis=-1)
    counted = touching[1:] & touching[:-1] & np.isfinite(steps)
    sums = np.sum(np.where(counted, steps, 0.0), axis=(1, 2))
    return 1000.0 * _mean(sums / np.maximum(counted.sum(axis=(1, 2)), 1))


def pop_by_joint(run: Run, reference: Run) -> Array:
    """(L, K) largest angular acceleration over the 99th percentile of the reference's.

    An untouched clip scores 1.2 to 1.3 against itself. A joint that hardly turns in the reference
    counts as a fifth of the liveliest one there, and as 1 rad/s^2 at least.
    """
    given, wanted = _angular_accelerations(run), _angular_accelerations(reference)
    if len(given) == 0 or len(wanted) == 0:
        return np.full(run.leg_rotations.shape[1:3], math.nan)
    usual = np.percentile(wanted, 99.0, axis=0)
    least = max(LEAST_SHARE * float(usual.max()), LEAST_ANGULAR_ACCELERATION)
    return given.max(axis=0) / np.maximum(usual, least)


def pop(run: Run, reference: Run) -> float:
    """The largest of `pop_by_joint`."""
    return _largest(pop_by_joint(run, reference))


def foot_step(run: Run) -> float:
    """Largest way of an ankle from one frame to the next, mm, in the ground's frame."""
    steps = np.linalg.norm(_ground_steps(run, run.ankle), axis=-1)
    return 1000.0 * _largest(steps[np.isfinite(steps)])


def hip_step(run: Run) -> float:
    """Largest way of the hips from one frame to the next, mm."""
    return 1000.0 * _largest(np.linalg.norm(np.diff(run.hips, axis=0), axis=-1))


def hip_acceleration_ratio(run: Run, reference: Run) -> float:
    """Largest vertical hip acceleration over the reference's, both from 33 ms differences."""
    return ratio(_hip_acceleration(run), _hip_acceleration(reference), LEAST_ACCELERATION)


def jitter(run: Run) -> float:
    """Mean length of the third difference times fps cubed, m/s^3, of all joints.

    Where a run has no `joints`: of its hips, ankles and toes.
    """
    points = run.joints
    if points is None:
        points = np.concatenate([run.hips[:, None], run.ankle, run.toe], axis=1)
    return run.fps**3 * _mean(np.linalg.norm(np.diff(points, 3, axis=0), axis=-1))


def mean_angle_change(run: Run, reference: Run) -> float:
    """Mean angle between the leg joints' local rotations and the reference's, degrees."""
    require_same(run, reference, "leg_rotations")
    turns = quat_arrays.mul(quat_arrays.conj(reference.leg_rotations), run.leg_rotations)
    return math.degrees(_mean(np.linalg.norm(quat_arrays.to_rotvec(turns), axis=-1)))


def mean_joint_error(run: Run, reference: Run) -> float:
    """MPJPE: mean distance of all joints from the reference's, mm; NaN where not recorded."""
    if run.joints is None or reference.joints is None:
        return math.nan
    require_same(run, reference, "joints")
    return 1000.0 * _mean(np.linalg.norm(run.joints - reference.joints, axis=-1))


def root_speed_change(run: Run, reference: Run) -> float:
    """Mean difference of the hips' horizontal speed from the reference's, mm/s, over 33 ms."""
    require_same(run, reference, "hips")
    return 1000.0 * _mean(np.abs(_hip_speeds(run) - _hip_speeds(reference)))


def largest_stretch(run: Run) -> float:
    """Largest stretch of a leg's segment over its rest length, percent; NaN where not recorded."""
    return math.nan if run.stretch is None else 100.0 * _largest(run.stretch)


def ratio(value: float, wanted: float, least: float) -> float:
    """A value over the wanted one, which counts as `least` where it is under that."""
    return value / max(wanted, least)


def _ground_steps(run: Run, points: Array) -> Array:
    """(T - 1, L, ..., 3) steps of points (T, L, ..., 3) in the ground's frame, in world axes.

    NaN where a foot comes to stand on another body.
    """
    axes = (slice(None),) * 2 + (None,) * (points.ndim - 3)
    turns = run.ground_rotations[axes]
    local = quat_arrays.rotate(quat_arrays.conj(turns), points - run.ground_positions[axes])
    steps = quat_arrays.rotate(turns[:-1], np.diff(local, axis=0))
    return np.where(_on_one_body(run)[axes][..., None], steps, math.nan)


def _carried_travel(run: Run, dims: int) -> Array:
    """(T - 1, L) way of the sole point that carries the contact, m, over the first `dims` axes.

    The mean of heel and ball where both carry at both ends; the slower where neither does, or
    where phases are unknown.
    """
    steps = _ground_steps(run, run.sole)
    heel, ball = (
        np.linalg.norm(steps[:, :, run.point(name), :dims], axis=-1) for name in ("heel", "ball")
    )
    slower = np.minimum(heel, ball)
    if not run.phases_known:
        return slower
    on_heel = _both_ends((run.phase == HEEL) | (run.phase == FLAT))
    on_ball = _both_ends((run.phase == BALL) | (run.phase == FLAT))
    return np.select(
        [on_heel & on_ball, on_heel, on_ball], [0.5 * (heel + ball), heel, ball], slower
    )


def _both_ends(frames: Bools) -> Bools:
    return frames[1:] & frames[:-1]


def _on_one_body(run: Run) -> Bools:
    """(T - 1, L) steps that begin and end on the same body."""
    return (run.ground_ids[1:] == run.ground_ids[:-1]) & (run.ground_ids[1:] != BETWEEN_BODIES)


def _contact_steps(run: Run) -> Bools:
    """(T - 1, L) steps from contact to contact on the same body."""
    return _both_ends(run.contact) & _on_one_body(run)


def _above_ground(run: Run) -> Array:
    """(T, L, P) height of each sole point over the terrain; inf where there is none."""
    return np.where(np.isnan(run.ground), math.inf, run.sole[..., 2] - run.ground)


def _lowest(run: Run) -> Array:
    """(T, L) height of each foot's lowest sole point; inf where there is no terrain."""
    return _above_ground(run).min(axis=-1)


def _depth(heights: Array) -> Array:
    return np.maximum(-heights - HEIGHT_TOLERANCE, 0.0)


def _difference_frames(run: Run) -> int:
    return max(1, round(run.fps * DIFFERENCE_STEP))


def _angular_accelerations(run: Run) -> Array:
    """(N, L, K) lengths, rad/s^2, from 33 ms differences; the rotations' parent frame."""
    step = _difference_frames(run)
    if len(run) <= 2 * step:
        return np.zeros((0, *run.leg_rotations.shape[1:3]))
    turns = quat_arrays.mul(run.leg_rotations[step:], quat_arrays.conj(run.leg_rotations[:-step]))
    speeds = quat_arrays.to_rotvec(turns) * (run.fps / step)
    return np.linalg.norm(speeds[step:] - speeds[:-step], axis=-1) * (run.fps / step)


def _hip_acceleration(run: Run) -> float:
    step = _difference_frames(run)
    speeds = (run.hips[step:, 2] - run.hips[:-step, 2]) * (run.fps / step)
    return _largest(np.abs(speeds[step:] - speeds[:-step]) * (run.fps / step))


def _hip_speeds(run: Run) -> Array:
    step = _difference_frames(run)
    return np.linalg.norm(run.hips[step:, :2] - run.hips[:-step, :2], axis=-1) * (run.fps / step)


def require_same(run: Run, reference: Run, name: str) -> None:
    """Raise FootIKError where an array of run and reference differs in shape."""
    given, wanted = getattr(run, name).shape, getattr(reference, name).shape
    if given != wanted:
        raise FootIKError(
            f"the run's {name} is {given} and the reference's {wanted}; they must be the same "
            "frames of the same character."
        )


def _mean(values: Array) -> float:
    return float(np.mean(values)) if np.size(values) else math.nan


def _largest(values: Array) -> float:
    return float(np.max(values)) if np.size(values) else math.nan


def _percentile(values: Array) -> float:
    return float(np.percentile(values, 99.0)) if np.size(values) else math.nan
