"""Loops: find the cycle in a clip, close its seam, and put it in place."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays
from footik_runtime.clip import Clip
from footik_runtime.rig import Rig

Array = NDArray[np.float64]

_SHORTEST = 0.4  # s
_MOST_FRAMES = 400  # searched; longer clips are searched at a lower rate
_POOR = 0.35  # seam over excursion: above it, there is no cycle to be found
_STRAIGHT = math.radians(12.0)  # a cycle that turns less goes straight on
_FACING = math.radians(35.0)  # a body that moves closer to its facing than this walks forward


def headings(clip: Clip, rig: Rig) -> Array:
    """(T,) yaw of the hips' forward direction, rad, continuous in time."""
    _, rest = rig.skeleton.rest_pose()
    ahead = quat_arrays.rotate(rest[rig.hips] * [1.0, -1.0, -1.0, -1.0], rig.forward)
    _, rotations = clip.model_pose()
    facing = quat_arrays.rotate(rotations[:, rig.hips], ahead)
    return np.unwrap(np.arctan2(facing[:, 1], facing[:, 0]))


def find_loop(clip: Clip, rig: Rig) -> tuple[int, int]:
    """First and last frame of the best cycle: where the pose returns, after having moved most.

    The whole clip where nothing returns. The clip may be walked in any direction.
    """
    step = max(1, math.ceil(len(clip) / _MOST_FRAMES))
    features = _pose_features(clip, rig)[::step]
    shortest = max(2, math.ceil(_SHORTEST * clip.fps / step))
    if len(features) <= shortest:
        return 0, len(clip) - 1
    squares = np.sum(features**2, axis=1)
    distance = np.sqrt(np.maximum(squares[:, None] + squares - 2.0 * features @ features.T, 0.0))
    excursion = np.maximum.accumulate(np.triu(distance), axis=1)
    score = np.where(np.triu(np.ones_like(distance), shortest) > 0, distance, np.inf)
    score /= np.maximum(excursion, 1e-9)
    # Of equally good seams, the shorter cycle: a hundredth of the excursion for each second.
    first, last = np.indices(score.shape)
    score += 0.01 * (last - first) * step / clip.fps
    i, j = np.unravel_index(np.argmin(score), score.shape)
    if score[i, j] > _POOR:
        return 0, len(clip) - 1
    return int(i) * step, int(j) * step


def _pose_features(clip: Clip, rig: Rig) -> Array:
    """(T, D) joint places and velocities about the hips, seen from the heading, in leg lengths."""
    positions, _ = clip.model_pose()
    back = -headings(clip, rig)
    turn = np.stack([np.cos(back / 2), 0 * back, 0 * back, np.sin(back / 2)], axis=-1)
    hips = positions[:, rig.hips] * [1.0, 1.0, 0.0]
    local = quat_arrays.rotate(turn[:, None], positions - hips[:, None])
    velocity = np.gradient(local, axis=0) * clip.fps if len(local) > 1 else 0.0 * local
    leg = float(rig.leg_lengths.mean())
    both = np.concatenate([local, 0.15 * velocity], axis=1) / leg
    return both.reshape(len(local), -1)


@dataclass(frozen=True, kw_only=True, eq=False)
class InPlace:
    """A cycle with its travel taken out: the pose against a root that moves at constant speed.

    Attributes:
        clip: the cycle, its joint 0 in the root's frame (x forward, z up from the floor).
        velocity: (2,) of the root in its own frame, m/s: forward, left.
        yaw_rate: of the root, rad/s.
        seam: how far the last pose was from the first before it was closed, m, largest joint.
    """

    clip: Clip
    velocity: Array
    yaw_rate: float
    seam: float


def put_in_place(clip: Clip, rig: Rig, *, close: bool = True) -> InPlace:
    """Take the travel out of a cycle and, with `close`, spread what its seam lacks over it."""
    positions, _ = clip.model_pose()
    hips, heading = positions[:, rig.hips, :2], headings(clip, rig)
    duration = max(clip.duration, 1.0 / clip.fps)
    turn = heading[-1] - heading[0]
    yaw_rate = 0.0 if abs(turn) < _STRAIGHT else turn / duration
    yaw = float(np.mean(heading - yaw_rate * clip.times)) + yaw_rate * clip.times
    velocity = _constant_velocity(hips, yaw, yaw_rate, duration)
    speed = float(np.hypot(*velocity))
    astray = math.atan2(velocity[1], velocity[0])
    if yaw_rate == 0.0 and speed * duration > 0.1 and abs(astray) < _FACING:
        yaw, velocity = yaw + astray, np.array([speed, 0.0])
    place = _path(velocity, yaw, yaw_rate, clip.times)
    place = place + np.mean(hips - place, axis=0)
    placed = _seen_from(clip, place, yaw)
    seam = _seam(placed)
    return InPlace(
        clip=_closed(placed) if close else placed,
        velocity=velocity,
        yaw_rate=yaw_rate,
        seam=seam,
    )


def _constant_velocity(hips: Array, yaw: Array, yaw_rate: float, duration: float) -> Array:
    """The root-frame velocity (2,) that carries the hips from first to last while turning."""
    gone = complex(*(hips[-1] - hips[0]))
    turn = yaw_rate * duration
    # The integral of exp(i yaw) over the cycle.
    mean = duration if abs(turn) < 1e-9 else duration * (np.exp(1j * turn) - 1) / (1j * turn)
    local = gone / (mean * np.exp(1j * yaw[0]))
    return np.array([local.real, local.imag])


def _path(velocity: Array, yaw: Array, yaw_rate: float, times: Array) -> Array:
    """(T, 2) where a root that starts at the origin is, at constant velocity and yaw rate."""
    turn = yaw_rate * times
    swept = times if yaw_rate == 0.0 else (np.exp(1j * turn) - 1) / (1j * yaw_rate)
    gone = complex(*velocity) * np.exp(1j * yaw[0]) * swept
    return np.stack([gone.real, gone.imag], axis=-1)


def _seen_from(clip: Clip, place: Array, yaw: Array) -> Clip:
    """The clip against a root at place (T, 2), yaw (T,)."""
    back = np.stack([np.cos(yaw / 2), 0 * yaw, 0 * yaw, -np.sin(yaw / 2)], axis=-1)
    moved = clip.root_positions - np.concatenate([place, 0 * place[:, :1]], axis=-1)
    rotations = clip.rotations.copy()
    rotations[:, 0] = quat_arrays.mul(back, rotations[:, 0])
    return replace(
        clip,
        root_positions=quat_arrays.rotate(back, moved),
        rotations=rotations,
        loop=True,
        extras={},
    )


def _seam(clip: Clip) -> float:
    positions, _ = clip.model_pose()
    return float(np.linalg.norm(positions[-1] - positions[0], axis=-1).max())


def _closed(clip: Clip) -> Clip:
    """The cycle with its seam spread evenly: the last frame becomes the first one exactly."""
    share = np.linspace(0.0, 1.0, len(clip))
    lack = clip.root_positions[0] - clip.root_positions[-1]
    roots = clip.root_positions + share[:, None] * lack
    first, last = clip.rotations[0], clip.rotations[-1]
    missing = _rotvec(quat_arrays.mul(last * [1.0, -1.0, -1.0, -1.0], first))
    rotations = quat_arrays.mul(clip.rotations, _from_rotvec(share[:, None, None] * missing))
    translations = clip.translations
    if translations is not None:
        translations = translations + share[:, None, None] * (translations[0] - translations[-1])
        translations[-1] = translations[0]
    # The ends are equal but for rounding and sign; make them equal to the bit.
    roots[-1] = roots[0]
    sign = np.where(np.sum(rotations[-1] * rotations[0], axis=-1, keepdims=True) < 0, -1.0, 1.0)
    rotations[-1] = sign * rotations[0]
    return replace(clip, root_positions=roots, rotations=rotations, translations=translations)


def _rotvec(q: Array) -> Array:
    q = np.where(q[..., :1] < 0.0, -q, q)
    s = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(s, q[..., :1])
    return q[..., 1:] * np.where(s < 1e-9, 2.0, angle / np.maximum(s, 1e-9))


def _from_rotvec(v: Array) -> Array:
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * v], axis=-1)
