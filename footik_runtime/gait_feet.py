"""Paths of the feet of one gait cycle, designed backwards from the ground.

In contact the sole rolls over its pinned point, exactly: the heel after the strike, all of it when
flat, the ball after heel-off, while the toes stay down. The swing joins toe-off to the next strike
by quintics with equal velocity and acceleration at both ends (minimum jerk, Flash and Hogan 1985),
raised until no sole point meets the ground.

Frame: x the way of travel, y left, z up, ground at z = 0. Time is in cycles, strike at 0; angles
in radians, pitch positive with the nose (or toes) down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays as qa
from footik_runtime.phases import Phase
from footik_runtime.rig import Leg, Rig, Sole

Array = NDArray[np.float64]

EDGE = 1e-9  # cycles; contact includes both of its ends


@dataclass(frozen=True, kw_only=True)
class FootShape:
    """A sole and its toe joint, in the sole frame of a flat foot, m.

    Attributes:
        sole: the underside.
        toe_ahead: of the toe joint ahead of the ankle; the ball where the foot has none.
        toe_up: of the toe joint over the sole.
        has_toe: whether the toes bend.
    """

    sole: Sole
    toe_ahead: float
    toe_up: float
    has_toe: bool

    @property
    def pivot(self) -> float:
        """What the foot turns over at heel-off: the ball, or the tip of a foot without a toe."""
        return self.sole.ball if self.has_toe else max(self.sole.tip, self.sole.ball)

    @property
    def pins_ball(self) -> bool:
        """False where a stiff tip ahead of the ball must carry the heel-off."""
        return self.pivot - self.sole.ball < 1e-3 * max(self.sole.tip, 1e-9)

    def toes_down(self, pitch: Array) -> Array:
        """World pitch (n,) of the toes that keeps the tip on the ground, the foot on its ball."""
        ahead = self.sole.tip - self.toe_ahead
        reach = np.hypot(ahead, self.toe_up)
        if not self.has_toe or ahead < 1e-6:
            return pitch if not self.has_toe else np.zeros_like(pitch)
        joint = self.toe_ahead - self.sole.ball
        height = self.toe_up * np.cos(pitch) - joint * np.sin(pitch)
        return np.arcsin(np.clip(height / reach, -1.0, 1.0)) - np.arctan2(self.toe_up, ahead)


def foot_shape(rig: Rig, leg: Leg) -> FootShape:
    """The shape of a leg's foot, measured in the rest pose."""
    sole = leg.sole
    if leg.toe < 0:
        return FootShape(sole=sole, toe_ahead=sole.ball, toe_up=0.0, has_toe=False)
    positions, rotations = rig.skeleton.rest_pose()
    frame = qa.mul(rotations[leg.ankle], sole.frame)
    toe = qa.rotate(qa.conj(frame), positions[leg.toe] - positions[leg.ankle])
    return FootShape(
        sole=sole, toe_ahead=float(toe[0]), toe_up=float(toe[2] + sole.height), has_toe=True
    )


@dataclass(frozen=True, kw_only=True)
class Roll:
    """How a foot rolls over the ground and swings.

    Attributes:
        duty: share of the cycle in contact.
        heel_end: when the foot is flat, cycles.
        ball_start: when the heel leaves, cycles.
        strike: pitch at the strike, toes up, rad, positive.
        off: pitch at toe-off, heel up, rad, positive.
        stride: travel of a cycle, m.
        clearance: least height of the sole in mid-swing, m.
        tuck: extra lift of the ankle early in the swing, m.
        tuck_pitch: extra pitch, heel up, early in the swing, rad.
        toe_out: yaw of the foot, to the left positive, rad.
        side: place of the foot to the left of the line of travel, m.
    """

    duty: float
    heel_end: float
    ball_start: float
    strike: float
    off: float
    stride: float
    clearance: float
    tuck: float
    tuck_pitch: float
    toe_out: float
    side: float


@dataclass(frozen=True, kw_only=True, eq=False)
class FootPath:
    """One foot over n times of a cycle; the ankle relative to the root's mean travel.

    Attributes:
        ankle: (n, 3), m.
        yaw: (n,) of the sole, rad.
        pitch: (n,) of the sole, rad.
        toe: (n,) pitch of the toes on top of the sole's, rad.
        phase: (n,) values of `Phase`.
        weight: (n,) IK weight, at least .5 exactly in contact.
    """

    ankle: Array
    yaw: Array
    pitch: Array
    toe: Array
    phase: Array
    weight: Array


def quintic(t: Array, span: float, start: tuple, end: tuple) -> Array:
    """The quintic over t in [0, span] from (value, velocity, acceleration) to the same at span.

    Values may be scalars or vectors (k,); then the result is (n, k).
    """
    p0, v0, a0 = (np.asarray(x, dtype=np.float64) for x in start)
    p1, v1, a1 = (np.asarray(x, dtype=np.float64) for x in end)
    s = np.asarray(t, dtype=np.float64) / span
    s = s.reshape(s.shape + (1,) * p0.ndim)
    v0, v1, a0, a1 = v0 * span, v1 * span, a0 * span * span, a1 * span * span
    gap = p1 - p0 - v0 - 0.5 * a0
    turn = v1 - v0 - a0
    bend = a1 - a0
    return (
        p0
        + s * (v0 + s * 0.5 * a0)
        + s**3
        * (
            (10 * gap - 4 * turn + 0.5 * bend)
            + s * ((-15 * gap + 7 * turn - bend) + s * (6 * gap - 3 * turn + 0.5 * bend))
        )
    )


def bump(s: Array, early: float = 0.0) -> Array:
    """A hill over s in [0, 1], height 1, flat to the second derivative at both ends.

    `early` in [0, 1) moves its top from .5 towards the start.
    """
    after = 3.0 * (1.0 + early) / (1.0 - early)
    top = 3.0 / (3.0 + after)
    s = np.clip(s, 0.0, 1.0)
    return (s / top) ** 3 * ((1.0 - s) / (1.0 - top)) ** after


def rolling_foot(shape: FootShape, roll: Roll, times: Array, ease: float) -> FootPath:
    """The path of a foot that strikes at time 0, flat at x = 0, for times (n,) in cycles.

    The root's mean travel, stride * time, is taken off, so the path has period 1. `ease` is the
    length of the IK weight's rise and fall, cycles.
    """
    t = times - np.floor(times)
    t = np.where(t > 1.0 - EDGE, 0.0, t)
    stance = t <= roll.duty + EDGE
    pitch, ankle, toe = np.empty_like(t), np.empty((len(t), 3)), np.empty_like(t)
    pitch[stance], ankle[stance], toe[stance] = _stance(shape, roll, t[stance])
    pitch[~stance], ankle[~stance], toe[~stance] = _swing(shape, roll, t[~stance])
    ankle += np.array([0.0, roll.side, 0.0])
    ankle[:, 0] -= roll.stride * t
    release = roll.duty if shape.pins_ball else roll.ball_start
    return FootPath(
        ankle=ankle,
        yaw=np.full_like(t, roll.toe_out),
        pitch=pitch,
        toe=toe,
        phase=contact_phase(t, roll.heel_end, roll.ball_start, release),
        weight=contact_weight(t, release, ease),
    )


def contact_phase(t: Array, heel_end: float, ball_start: float, duty: float) -> Array:
    """Phases (n,) of a contact that begins at 0, for t (n,) in [0, 1)."""
    flat_or_less = np.where(t < heel_end - EDGE, Phase.HEEL, Phase.FLAT)
    held = np.where(t > ball_start + EDGE, Phase.BALL, flat_or_less)
    return np.where(t <= duty + EDGE, held, Phase.SWING).astype(np.float64)


def contact_weight(t: Array, duty: float, ease: float) -> Array:
    """IK weights (n,): smoothsteps of length `ease` that cross .5 at both ends of contact."""
    inside = np.minimum(t, duty - t)
    outside = np.minimum(t - duty, 1.0 - t)
    into = np.where(t <= duty + EDGE, np.maximum(inside, 0.0), -np.maximum(outside, EDGE))
    s = np.clip(0.5 + into / max(ease, 1e-6), 0.0, 1.0)
    return s * s * (3.0 - 2.0 * s)


def _stance(shape: FootShape, roll: Roll, t: Array) -> tuple[Array, Array, Array]:
    """Pitch, ankle (from the foot's flat place) and toe pitch in contact, smooth past its ends."""
    heel_rate = 1.3 * roll.strike / max(roll.heel_end, EDGE)
    ball_span = roll.duty - roll.ball_start
    off_rate = roll.off / max(ball_span, EDGE)
    on_heel = quintic(t, max(roll.heel_end, EDGE), (-roll.strike, heel_rate, 0.0), (0.0, 0.0, 0.0))
    on_ball = quintic(
        t - roll.ball_start,
        max(ball_span, EDGE),
        (0.0, 0.0, 0.0),
        (roll.off, 2.2 * off_rate, 2.0 * off_rate / max(ball_span, EDGE)),
    )
    rolls = t > roll.ball_start
    pitch = np.where(t < roll.heel_end, on_heel, np.where(rolls, on_ball, 0.0))
    pivot = np.where(rolls, shape.pivot, -shape.sole.heel)
    height = shape.sole.height
    along = pivot - pivot * np.cos(pitch) + height * np.sin(pitch)
    up = pivot * np.sin(pitch) + height * np.cos(pitch)
    c, s = np.cos(roll.toe_out), np.sin(roll.toe_out)
    ankle = np.stack([along * c, along * s, up], axis=-1)
    toe = np.where(rolls, shape.toes_down(pitch) - pitch, 0.0)
    return pitch, ankle, toe


def _swing(shape: FootShape, roll: Roll, t: Array) -> tuple[Array, Array, Array]:
    """The same in the air; the ankle ends a stride ahead."""
    grid = np.linspace(0.0, 1.0, 202)[1:-1]
    span = 1.0 - roll.duty
    lowest = _sole_low(shape, *_swing_unraised(shape, roll, roll.duty + span * grid))
    raise_by = max(0.0, float(np.max(roll.clearance - lowest / bump(grid))))
    pitch, ankle, toe = _swing_unraised(shape, roll, t)
    ankle[:, 2] += raise_by * bump((t - roll.duty) / span)
    return pitch, ankle, toe


def _swing_unraised(shape: FootShape, roll: Roll, t: Array) -> tuple[Array, Array, Array]:
    since, span = t - roll.duty, 1.0 - roll.duty
    leave = _edge(shape, roll, roll.duty)
    land = _edge(shape, roll, 0.0)
    ahead = np.array([roll.stride, 0.0, 0.0])
    land_ankle = (land[1][0] + ahead, *land[1][1:])
    s = since / span
    pitch = quintic(since, span, leave[0], land[0]) + roll.tuck_pitch * bump(s, early=0.25)
    ankle = quintic(since, span, leave[1], land_ankle)
    ankle[:, 2] += roll.tuck * bump(s, early=0.25)
    toe = quintic(np.minimum(since, 0.7 * span), 0.7 * span, leave[2], (0.0, 0.0, 0.0))
    return pitch, ankle, toe


def _edge(shape: FootShape, roll: Roll, at: float) -> list[tuple]:
    """(value, velocity, acceleration) of pitch, ankle and toe at an end of the contact."""
    step = 1e-4
    values = _stance(shape, roll, at + np.array([-step, 0.0, step]))
    return [
        (v[1], (v[2] - v[0]) / (2.0 * step), (v[2] - 2.0 * v[1] + v[0]) / step**2) for v in values
    ]


def _sole_low(shape: FootShape, pitch: Array, ankle: Array, toe: Array) -> Array:
    """Height (n,) of the lowest of heel, ball and tip."""
    sole = shape.sole
    c, s = np.cos(pitch), np.sin(pitch)
    under = ankle[:, 2] - sole.height * c
    joint = ankle[:, 2] - shape.toe_ahead * s + (shape.toe_up - sole.height) * c
    toes = pitch + toe
    tip = joint - (sole.tip - shape.toe_ahead) * np.sin(toes) - shape.toe_up * np.cos(toes)
    return np.minimum(np.minimum(under + sole.heel * s, under - sole.ball * s), tip)


def stepping_foot(
    times: Array,
    *,
    duty: float,
    turn: float,
    place: tuple[float, float],
    toe_out: float,
    height: float,
    lift: float,
    ease: float,
) -> FootPath:
    """A foot that turns about the root by `turn` rad a cycle in flat steps; contact begins at 0.

    Given in the root's own heading, which turns evenly. `place` is the ankle's (x, y) when the
    foot and the root head the same way, `height` the flat ankle's, `lift` of the step, m.
    """
    t = times - np.floor(times)
    t = np.where(t > 1.0 - EDGE, 0.0, t)
    s = np.clip((t - duty) / (1.0 - duty), 0.0, 1.0)
    stepped = turn * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
    yaw = turn * 0.5 * duty + stepped - turn * t
    c, k = np.cos(yaw), np.sin(yaw)
    x, y = place
    ankle = np.stack([c * x - k * y, k * x + c * y, height + lift * bump(s)], axis=-1)
    zero = np.zeros_like(t)
    return FootPath(
        ankle=ankle,
        yaw=yaw + toe_out,
        pitch=zero,
        toe=zero,
        phase=contact_phase(t, 0.0, duty, duty),
        weight=contact_weight(t, duty, ease),
    )


def standing_foot(
    frames: int, *, place: tuple[float, float], toe_out: float, height: float
) -> FootPath:
    """A foot that stands flat throughout."""
    zero = np.zeros(frames)
    return FootPath(
        ankle=np.tile([*place, height], (frames, 1)),
        yaw=zero + toe_out,
        pitch=zero,
        toe=zero,
        phase=zero + Phase.FLAT,
        weight=zero + 1.0,
    )
