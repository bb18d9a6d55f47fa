"""Footprints: of each contact, when its foot lies flat, and where it leaves its print."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from footik_runtime.compiled import compiled
from footik_runtime.math3d import add_scaled, get3, norm, scale, sub, unit
from footik_runtime.offline.stages import Bools, Contacts, Ints, Working
from footik_runtime.offline.stretches import BALL, FLAT, HEEL, phase_at, pinned_speed, stretches
from footik_runtime.sole import BALL as BALL_POINT
from footik_runtime.sole import HEEL as HEEL_POINT

Array = NDArray[np.float64]

# Of a body whose legs are 0.85 m long; lengths and speeds scale with the leg.
HOVERS = 0.0025  # m: a heel that comes down no higher than this stands
_STANDS = 0.02  # m/s: a point this slow stands, however still the others are
_MOST_TRIMMED = 0.10  # s off either end of a contact whose foot otherwise stands quite still
_MOSTLY = 0.6  # of a contact's frames: a foot still in so many stands quite still
_BY_FLAT = 0.02  # weight of other frames, against flat ones, in where a foot points


@dataclass(frozen=True, kw_only=True, eq=False)
class Footprints:
    """What K contacts leave on the ground, and their S stretches of heel, then flat, then ball.

    Attributes:
        fps: frames a second.
        spans: (K, 3) foot, first frame, frame after the last in which the foot can be held.
        places: (K, 3) m, of the sole under the ankle, on average; of a contact that is never flat,
            of the heel or ball that carries it.
        ahead: (K,) m, how far ahead of its place the sole is under the ankle: 0 where it is flat.
        directions: (K, 3) unit, from heel to ball of the flat foot.
        has_flat: (K,) whether it ever is.
        wobble: (K,) m, sd of the height of the pinned points.
        contact, start, flat, roll, stop: (S,) the contact a stretch is of, and its frames.
    """

    fps: float
    spans: Ints
    places: Array
    ahead: Array
    directions: Array
    has_flat: Bools
    wobble: Array
    contact: Ints
    start: Ints
    flat: Ints
    roll: Ints
    stop: Ints


def footprints(work: Working, contacts: Contacts, spans: Ints) -> Footprints:
    """The footprints of contacts `spans` (K, 3): foot, first frame, frame after the last."""
    fps = contacts.fps
    spans, parts = stretches(work, contacts, spans)
    soles = np.array([(leg.sole.heel, leg.sole.ball) for leg in work.rig.legs])
    places, directions, ahead = (
        np.empty((len(spans), 3)),
        np.empty((len(spans), 3)),
        np.zeros(len(spans)),
    )
    has_flat, wobble = np.zeros(len(spans), dtype=np.bool_), np.empty(len(spans))
    _measure(
        work.soles, contacts.confidence, spans, parts, soles,
        fps, _STANDS * work.scale, places, ahead, directions, has_flat, wobble,
    )  # fmt: skip
    contact, start, flat, roll, stop = parts.T
    return Footprints(
        fps=fps, spans=spans, places=places, ahead=ahead, directions=directions, has_flat=has_flat,
        wobble=wobble, contact=contact, start=start, flat=flat, roll=roll, stop=stop,
    )  # fmt: skip


def still_ends(
    work: Working, prints: Footprints, heels: Array, balls: Array, keep: float
) -> tuple[Array, Footprints]:
    """(K,) change of each contact, m, and the footprints without the frames that do not stand.

    A contact found from motion may reach a frame or two into the swings around it, and the flat
    foot into those in which its heel already rises, slowly. Where a foot stands to within `keep`,
    the frames at its ends that do not are left out, and a foot is flat while both its ends stand.
    """
    change, spans = np.zeros(len(prints.spans)), prints.spans.copy()
    parts = np.stack([prints.contact, prints.start, prints.flat, prints.roll, prints.stop], axis=1)
    most = math.ceil(_MOST_TRIMMED * prints.fps)
    _trim(work.soles, spans, parts, heels, balls, keep, HOVERS * work.scale, most, change)
    contact, start, flat, roll, stop = parts.T
    trimmed = replace(
        prints, spans=spans, contact=contact, start=start, flat=flat, roll=roll, stop=stop
    )
    return change, trimmed


@compiled
def _measure(
    soles, confidence, spans, parts, lengths, fps, stands, places, ahead, directions, has_flat,
    wobble,
):  # fmt: skip
    """Write where contacts have their prints; a frame much faster than most weighs little."""
    first = 0
    for k in range(spans.shape[0]):
        foot, start, stop = spans[k, 0], spans[k, 1], spans[k, 2]
        last = first
        while last < parts.shape[0] and parts[last, 0] == k:
            last += 1
        heel, ball = lengths[foot, 0], lengths[foot, 1]
        direction = (0.0, 0.0, 0.0)
        speed = 0.0
        for s in range(first, last):
            for t in range(parts[s, 1], parts[s, 4]):
                phase = phase_at(parts, s, t)
                speed += pinned_speed(soles, foot, t, start, stop, phase, fps) / (stop - start)
                has_flat[k] |= phase == FLAT
                weight = 1.0 if phase == FLAT else _BY_FLAT
                along = sub(get3(soles[t, foot, BALL_POINT]), get3(soles[t, foot, HEEL_POINT]))
                if phase != FLAT:
                    along = (along[0], along[1], 0.0)
                direction = add_scaled(direction, along, weight)
        if not has_flat[k]:
            direction = (direction[0], direction[1], 0.0)
        direction = unit(direction, (1.0, 0.0, 0.0))
        total, square, lever = 0.0, 0.0, 0.0
        height, sure = 0.0, 0.0
        place = (0.0, 0.0, 0.0)
        origin = get3(soles[start, foot, BALL_POINT])
        usual = 3.0 * speed + stands
        for s in range(first, last):
            for t in range(parts[s, 1], parts[s, 4]):
                phase = phase_at(parts, s, t)
                off = pinned_speed(soles, foot, t, start, stop, phase, fps) / usual
                weight = 1e-6 + max(confidence[t, foot, 0], confidence[t, foot, 1])
                weight /= 1.0 + off * off * off * off
                by_heel = add_scaled(get3(soles[t, foot, HEEL_POINT]), direction, heel)
                by_ball = add_scaled(get3(soles[t, foot, BALL_POINT]), direction, -ball)
                at = by_ball
                if phase == HEEL:
                    at = by_heel
                elif phase == FLAT:
                    at = add_scaled(scale(by_heel, 0.5), by_ball, 0.5)
                at = sub(at, origin)
                place = add_scaled(place, at, weight)
                total += weight
                # A ball peels off the ground: what stands flat tells how high that is.
                by_height = weight if phase == FLAT else _BY_FLAT * weight
                height += by_height * at[2]
                sure += by_height
                lever += weight * (heel if phase == HEEL else -ball)
                square += weight * at[2] * at[2]
        place = scale(place, 1.0 / total)
        wobble[k] = math.sqrt(max(square / total - place[2] * place[2], 0.0))
        ahead[k] = 0.0 if has_flat[k] else lever / total
        place = (place[0], place[1], height / sure)
        for c in range(3):
            places[k, c] = origin[c] + place[c]
            places[k, c] -= ahead[k] * direction[c]
            directions[k, c] = direction[c]
        first = last


@compiled
def _off(soles, foot, t, phase, heel, ball, hovers):
    """How far the pinned points at frame t are from where they are held, m; the farther of two.

    A ball alone may be over the ground, and a heel alone a little: they are let come and go.
    """
    by_heel = sub(get3(soles[t, foot, HEEL_POINT]), heel)
    by_ball = sub(get3(soles[t, foot, BALL_POINT]), ball)
    if phase == BALL:
        return norm((by_ball[0], by_ball[1], min(by_ball[2], 0.0)))
    if phase == HEEL:
        over = by_heel[2] if by_heel[2] < 0.0 else max(by_heel[2] - hovers, 0.0)
        return norm((by_heel[0], by_heel[1], over))
    return max(norm(by_heel), norm(by_ball))


@compiled
def _trim(soles, spans, parts, heels, balls, keep, hovers, most, change):
    """Write the change of each contact, and take off its spans and parts what does not stand."""
    first = 0
    for k in range(spans.shape[0]):
        foot, start, stop = spans[k, 0], spans[k, 1], spans[k, 2]
        heel, ball = get3(heels[k]), get3(balls[k])
        last = first
        still, low, high = 0, stop, start
        while last < parts.shape[0] and parts[last, 0] == k:
            for t in range(parts[last, 1], parts[last, 4]):
                if _off(soles, foot, t, phase_at(parts, last, t), heel, ball, hovers) < keep:
                    still += 1
                    low, high = min(low, t), max(high, t + 1)
            last += 1
        if still >= _MOSTLY * (stop - start):
            if low - start <= most and stop - high <= most:
                spans[k, 1], spans[k, 2] = low, high
            for s in range(first, last):
                _flat_while_still(soles, foot, parts, s, stop, heel, ball, hovers, keep, most)
        for s in range(first, last):
            for c in range(1, 5):
                parts[s, c] = min(max(parts[s, c], spans[k, 1]), spans[k, 2])
            for t in range(parts[s, 1], parts[s, 4]):
                off = _off(soles, foot, t, phase_at(parts, s, t), heel, ball, hovers)
                change[k] = max(change[k], off)
        first = last


@compiled
def _flat_while_still(soles, foot, parts, s, stop, heel, ball, hovers, keep, most):
    """Let a stretch be flat no longer than both ends of the foot stand, if one stands longer."""
    flat, roll = parts[s, 2], parts[s, 3]
    earliest, latest = roll - most, flat + most
    if roll < parts[s, 4] or roll == stop:
        while roll > max(flat + 1, earliest) and (
            _off(soles, foot, roll - 1, FLAT, heel, ball, hovers) >= keep
            and _off(soles, foot, roll - 1, BALL, heel, ball, hovers) < keep
        ):
            roll -= 1
    if flat > parts[s, 1]:
        while flat < min(roll - 1, latest) and (
            _off(soles, foot, flat, FLAT, heel, ball, hovers) >= keep
            and _off(soles, foot, flat, HEEL, heel, ball, hovers) < keep
        ):
            flat += 1
    parts[s, 2], parts[s, 3] = flat, roll
