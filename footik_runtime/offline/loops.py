"""Loops: find the cycle in a clip, close its seam, and put it in place."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.quat_arrays import conj, from_rotvec, mul, rotate, to_rotvec
from footik_runtime.rig import Rig

Array = NDArray[np.float64]

_SHORTEST = 0.4  # s
_MOST_STARTS = 500  # tried; of a longer clip, not every frame
_NO_MOTION = 1e-4  # excursion, in leg lengths, of a pose that is only held
_POOR = 0.35  # seam over excursion: above it, there is no cycle to be found
_STRAIGHT = math.radians(12.0)  # a found cycle that turns less goes straight on
_STAYS = 0.03  # leg lengths: a found cycle that travels less stays in place
_AS_GIVEN = 1e-6  # the same for a clip that says it is a loop, rad and leg lengths
_BLEND = 0.15  # s at either end over which the velocities at the seam are made one
_FACING = math.radians(35.0)  # a body that moves closer to its facing than this walks forward


def headings(clip: Clip, rig: Rig) -> Array:
    """(T,) yaw of the hips' forward direction, rad, continuous in time.

    It is the hips' turn about the vertical since the rest pose, so it holds still in a somersault.
    """
    _, rest = rig.skeleton.rest_pose()
    _, rotations = clip.model_pose()
    turn = mul(rotations[:, rig.hips], conj(rest[rig.hips]))
    yaw = 2.0 * np.arctan2(turn[:, 3], turn[:, 0])
    return np.unwrap(yaw) + math.atan2(rig.forward[1], rig.forward[0])


def find_loop(clip: Clip, rig: Rig) -> tuple[int, int]:
    """First and last frame of the best cycle: where the pose returns, after having moved most.

    The whole clip where nothing returns. The clip may be walked in any direction.
    """
    features = _pose_features(clip, rig)
    shortest = max(2, math.ceil(_SHORTEST * clip.fps))
    best, ends = _POOR, (0, len(clip) - 1)
    for first in range(0, len(clip) - shortest, max(1, math.ceil(len(clip) / _MOST_STARTS))):
        distance = np.linalg.norm(features[first:] - features[first], axis=1)
        score = distance / np.maximum(np.maximum.accumulate(distance), _NO_MOTION)
        # Of equally good seams, the shorter cycle: a hundredth of the excursion for each second.
        score += 0.01 / clip.fps * np.arange(len(score))
        length = shortest + int(np.argmin(score[shortest:]))
        if score[length] < best - 1e-9:
            best, ends = float(score[length]), (first, first + length)
    return ends


def _pose_features(clip: Clip, rig: Rig) -> Array:
    """(T, D) joint places and velocities about the hips, seen from the heading, in leg lengths."""
    positions, _ = clip.model_pose()
    back = -headings(clip, rig)
    turn = np.stack([np.cos(back / 2), 0 * back, 0 * back, np.sin(back / 2)], axis=-1)
    hips = positions[:, rig.hips] * [1.0, 1.0, 0.0]
    local = rotate(turn[:, None], positions - hips[:, None])
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
    """Take the travel out of a cycle and, with `close`, spread what its seam lacks over it.

    A clip that says it is a loop travels and turns exactly as it does; in any other, a small turn
    or step is taken for drift, and the velocities at the seam are joined too.
    """
    positions, _ = clip.model_pose()
    hips, heading = positions[:, rig.hips, :2], headings(clip, rig)
    duration = max(clip.duration, 1.0 / clip.fps)
    leg = float(rig.leg_lengths.mean())
    turn = heading[-1] - heading[0]
    straight = abs(turn) < (_AS_GIVEN if clip.loop else _STRAIGHT)
    yaw_rate = 0.0 if straight else turn / duration
    once = slice(0, max(len(clip) - 1, 1))  # the last frame is the first again
    yaw = float(np.mean((heading - yaw_rate * clip.times)[once])) + yaw_rate * clip.times
    velocity = _constant_velocity(hips, yaw, yaw_rate, duration)
    speed = float(np.hypot(*velocity))
    astray = math.atan2(velocity[1], velocity[0])
    if straight and speed * duration < (_AS_GIVEN if clip.loop else _STAYS) * leg:
        velocity = np.zeros(2)
    elif straight and speed * duration > 0.12 * leg and abs(astray) < _FACING:
        yaw, velocity = yaw + astray, np.array([speed, 0.0])
    place = hips[0] + _path(velocity, yaw, yaw_rate, clip.times)
    # The root goes under the mean of the hips: an offset in its own frame, where a turning root
    # has another velocity.
    offset = np.mean(_turned(hips - place, -yaw)[once], axis=0)
    place = place + _turned(np.broadcast_to(offset, place.shape), yaw)
    velocity = velocity + yaw_rate * np.array([-offset[1], offset[0]])
    placed = _seen_from(clip, place, yaw)
    return InPlace(
        clip=_closed(placed, join=not clip.loop) if close else placed,
        velocity=velocity,
        yaw_rate=yaw_rate,
        seam=_seam(placed),
    )


def _turned(v: Array, yaw: Array) -> Array:
    """Vectors (T, 2) turned by yaw (T,)."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1]], axis=-1)


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
    rotations[:, 0] = mul(back, rotations[:, 0])
    return replace(
        clip,
        root_positions=rotate(back, moved),
        rotations=rotations,
        loop=True,
        extras={},
    )


def _seam(clip: Clip) -> float:
    positions, _ = clip.model_pose()
    return float(np.linalg.norm(positions[-1] - positions[0], axis=-1).max())


def _closed(clip: Clip, *, join: bool) -> Clip:
    """The cycle with its seam spread evenly: the last frame becomes the first one exactly.

    With `join`, velocities meet there too: each end is bent, within `_BLEND`, to their mean.
    """
    share = np.linspace(0.0, 1.0, len(clip))
    bend = _Bend(clip) if join and len(clip) > 3 else None
    first, last = clip.rotations[0], clip.rotations[-1]
    missing = share[:, None, None] * to_rotvec(mul(conj(last), first))
    if bend is not None:
        turns = [to_rotvec(mul(conj(q), clip.rotations)) for q in (first, last)]
        missing += bend.correction(*turns)
    rotations = mul(clip.rotations, from_rotvec(missing))
    roots = _spread(clip.root_positions, share, bend)
    translations = clip.translations
    if translations is not None:
        translations = _spread(translations, share, bend)
    # The ends are equal but for rounding and sign; make them equal to the bit.
    sign = np.where(np.sum(rotations[-1] * rotations[0], axis=-1, keepdims=True) < 0, -1.0, 1.0)
    rotations[-1] = sign * rotations[0]
    return replace(clip, root_positions=roots, rotations=rotations, translations=translations)


def _spread(values: Array, share: Array, bend: _Bend | None) -> Array:
    """Values (T, ..., 3) whose last becomes the first, bit by bit."""
    out = values + np.multiply.outer(share, values[0] - values[-1])
    if bend is not None:
        out += bend.correction(values, values)
    out[-1] = out[0]
    return out


class _Bend:
    """What joins the velocities at a clip's seam: nothing at both ends, half the gap in slope."""

    def __init__(self, clip: Clip) -> None:
        self._count = min(len(clip), max(3, round(0.04 * clip.fps) + 1))
        # The slope at the first of these frames, of the parabola that fits them best.
        self._slope = np.linalg.pinv(np.vander(np.arange(self._count) / clip.fps, 3))[1]
        width = min(_BLEND, 0.5 * clip.duration)
        t = clip.times
        self._shape = _hump(t, width) + _hump(t[-1] - t, width)

    def correction(self, start: Array, end: Array) -> Array:
        """(T, ...) for values (T, ...) as told from the first frame and from the last."""
        at_start = np.tensordot(self._slope, start[: self._count], 1)
        at_end = -np.tensordot(self._slope, end[: -self._count - 1 : -1], 1)
        return np.multiply.outer(self._shape, 0.5 * (at_end - at_start))


def _hump(t: Array, width: float) -> Array:
    """Slope 1 at 0, nothing there, and nothing at all from `width` on."""
    return t * np.clip(1.0 - t / width, 0.0, None) ** 2
