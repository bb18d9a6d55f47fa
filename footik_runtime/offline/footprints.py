"""Footprints: of each contact, when its foot lies flat, and where it leaves its print."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from footik_runtime.compiled import compiled
from footik_runtime.math3d import add_scaled, get3, norm, scale, sub, unit
from footik_runtime.offline.stages import Bools, Contacts, Ints, Working
from footik_runtime.phases import Phase
from footik_runtime.sole import BALL as BALL_POINT
from footik_runtime.sole import HEEL as HEEL_POINT

Array = NDArray[np.float64]

HEEL, FLAT, BALL = int(Phase.HEEL), int(Phase.FLAT), int(Phase.BALL)  # plain, for kernels

# Of a body whose legs are 0.85 m long; lengths and speeds scale with the leg.
_WINDOW = 0.08  # s within which a phase's ends are looked for
_SHORTEST_PHASE = 0.05  # s: a foot that rocks back for less does not
_PER_FRAME = 1e-4  # m of the pinned point's way that moving an end by a frame must save
_STANDS = 0.02  # m/s: a point this slow stands, however still the others are
_LEAVES = 0.12  # m/s, over and above what it does in mid-contact: a point this fast is not held
_PER_USUAL = 1.0
_LIFTED = 0.005  # m over where it is in mid-contact: a point this high is not held
_ROLLED = math.radians(2.5)  # pitch, off that of the flat foot, from which it turns over an end
_BETWEEN = 1.0 / 60.0  # s over which that speed is told
_MOST_TRIMMED = 0.10  # s, and a third of the contact, off either end of it
_MOSTLY = 0.6  # of a contact's frames: a foot still in so many stands quite still
_BY_FLAT = 0.02  # weight of other frames, against flat ones, in where a foot points


@dataclass(frozen=True, kw_only=True, eq=False)
class Footprints:
    """What K contacts leave on the ground, and their S stretches of heel, then flat, then ball.

    Attributes:
        fps: frames a second.
        spans: (K, 3) foot, first frame, frame after the last in which the foot can be held.
        places: (K, 3) m, of the sole under the ankle, on average.
        directions: (K, 3) unit, from heel to ball of the flat foot.
        has_flat: (K,) whether it ever is.
        wobble: (K,) m, sd of the height of the pinned points.
        contact, start, flat, roll, stop: (S,) the contact a stretch is of, and its frames.
    """

    fps: float
    spans: Ints
    places: Array
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
    fps, phases = contacts.fps, contacts.phases().astype(np.int64)
    stretches = np.empty((int(np.sum(spans[:, 2] - spans[:, 1])), 5), dtype=np.int64)
    count = _split(phases, spans, math.ceil(_SHORTEST_PHASE * fps), stretches)
    stretches = stretches[:count]
    window = max(1, round(_WINDOW * fps))
    _refine(work.soles, spans, stretches, window, _PER_FRAME * work.scale)
    spans = spans.copy()
    apart = max(1, round(_BETWEEN * fps))
    _release(
        work.soles, spans, stretches, fps, apart,
        _LEAVES * work.scale, _LIFTED * work.scale, _MOST_TRIMMED * fps,
    )  # fmt: skip
    soles = np.array([(leg.sole.heel, leg.sole.ball) for leg in work.rig.legs])
    places, directions = np.empty((len(spans), 3)), np.empty((len(spans), 3))
    has_flat, wobble = np.zeros(len(spans), dtype=np.bool_), np.empty(len(spans))
    _measure(
        work.soles, contacts.confidence, spans, stretches, soles,
        fps, _STANDS * work.scale, places, directions, has_flat, wobble,
    )  # fmt: skip
    contact, start, flat, roll, stop = stretches.T
    return Footprints(
        fps=fps, spans=spans, places=places, directions=directions, has_flat=has_flat,
        wobble=wobble, contact=contact, start=start, flat=flat, roll=roll, stop=stop,
    )  # fmt: skip


def still_ends(
    work: Working, prints: Footprints, heels: Array, balls: Array, keep: float
) -> tuple[Array, Ints, Ints]:
    """(K,) change of each contact, m, and its first frame and frame after its last.

    A contact found from motion may reach a frame or two into the swings around it. Where a foot
    stands to within `keep`, the frames at its ends that do not are left out.
    """
    change = np.zeros(len(prints.spans))
    starts, stops = prints.spans[:, 1].copy(), prints.spans[:, 2].copy()
    stretches = np.stack(
        [prints.contact, prints.start, prints.flat, prints.roll, prints.stop], axis=1
    )
    most = math.ceil(_MOST_TRIMMED * prints.fps)
    _trim(work.soles, prints.spans, stretches, heels, balls, keep, most, change, starts, stops)
    return change, starts, stops


@compiled
def _split(phases, spans, shortest, out):
    """Write contact, start, flat, roll, stop of every stretch into out (S, 5); return how many."""
    count = 0
    for k in range(spans.shape[0]):
        foot, stop = spans[k, 0], spans[k, 2]
        t = spans[k, 1]
        while t < stop:
            start, flat, roll = t, -1, -1
            reached = HEEL
            while t < stop:
                phase = phases[t, foot]
                if phase < reached:
                    # Back on the flat foot, or the heel: a new stretch, unless it is a flicker.
                    end = t
                    while end < stop and phases[end, foot] < reached:
                        end += 1
                    if end - t >= shortest or end == stop and end - t > t - start:
                        break
                    t = end
                    continue
                if phase > HEEL and flat < 0:
                    flat = t
                if phase == BALL and roll < 0:
                    roll = t
                reached = phase
                t += 1
            flat = t if flat < 0 else flat
            roll = t if roll < 0 else roll
            if start < flat == roll < t:
                roll += 1  # from heel to ball the foot is flat for a moment
            out[count, 0], out[count, 1], out[count, 2] = k, start, flat
            out[count, 3], out[count, 4] = roll, t
            count += 1
    return count


@compiled
def _way(soles, t, foot, point):
    """How far a sole point goes from frame t - 1 to t, m."""
    return norm(sub(get3(soles[t, foot, point]), get3(soles[t - 1, foot, point])))


@compiled
def _refine(soles, spans, stretches, window, per_frame):
    """Move where each stretch goes flat and where it rolls so that pinned points move least."""
    for s in range(stretches.shape[0]):
        k, start, stop = stretches[s, 0], stretches[s, 1], stretches[s, 4]
        flat, roll = stretches[s, 2], stretches[s, 3]
        if flat >= roll:
            continue
        foot = spans[k, 0]
        if flat > start or start == spans[k, 1]:
            low, high = max(start, flat - window), min(roll - 1, flat + window)
            flat = _least(soles, foot, low, flat, high, HEEL_POINT, per_frame)
        if roll < stop or stop == spans[k, 2]:
            low, high = max(flat + 1, roll - window), min(stop, roll + window)
            roll = _least(soles, foot, low, roll, high, BALL_POINT, per_frame)
        stretches[s, 2], stretches[s, 3] = _while_level(soles, foot, flat, roll)


@compiled
def _pitch(soles, foot, t):
    """How far the nose of a sole points up, rad."""
    along = sub(get3(soles[t, foot, BALL_POINT]), get3(soles[t, foot, HEEL_POINT]))
    return math.atan2(along[2], math.hypot(along[0], along[1]))


@compiled
def _while_level(soles, foot, flat, roll):
    """Of flat frames, those between a nose that comes down and a heel that goes up.

    A heel leaves the ground long before it is fast: then the foot would be turned back a lot.
    """
    third = (roll - flat) // 3
    usual = 0.0
    for t in range(flat + third, roll - third):
        usual += _pitch(soles, foot, t) / (roll - flat - 2 * third)
    while flat + 1 < roll and _pitch(soles, foot, flat) - usual > _ROLLED:
        flat += 1
    while flat + 1 < roll and _pitch(soles, foot, roll - 1) - usual < -_ROLLED:
        roll -= 1
    return flat, roll


@compiled
def _least(soles, foot, low, now, high, point, per_frame):
    """The frame in low..high at which to go over between one pinned point and both.

    With the heel, before the frame it is pinned alone; with the ball, from the frame on.
    """
    best, least = now, np.inf
    for b in range(low, high + 1):
        cost = per_frame * abs(b - now)
        for t in range(max(low, 1), min(high + 1, soles.shape[0])):
            alone = t < b if point == HEEL_POINT else t > b
            if alone:
                cost += 2.0 * _way(soles, t, foot, point)
            elif t != b:
                cost += _way(soles, t, foot, HEEL_POINT) + _way(soles, t, foot, BALL_POINT)
            else:
                cost += 2.0 * _way(soles, t, foot, point)
        if cost < least:
            best, least = b, cost
    return best


@compiled
def _phase(stretches, s, t):
    """The phase of frame t in stretch s."""
    if t < stretches[s, 2]:
        return HEEL
    return FLAT if t < stretches[s, 3] else BALL


@compiled
def _pinned_speed(soles, foot, t, start, stop, phase, fps):
    """Speed of what is pinned at frame t, from its neighbours in start <= t < stop, m/s."""
    a, b = max(t - 1, start), min(t + 1, stop - 1)
    if a == b:
        return 0.0
    speed = 0.0
    if phase != BALL:
        heels = sub(get3(soles[b, foot, HEEL_POINT]), get3(soles[a, foot, HEEL_POINT]))
        speed += norm(heels)
    if phase != HEEL:
        balls = sub(get3(soles[b, foot, BALL_POINT]), get3(soles[a, foot, BALL_POINT]))
        speed += norm(balls)
    return speed * fps / (b - a) * (0.5 if phase == FLAT else 1.0)


@compiled
def _way_between(soles, foot, a, b, phase):
    """How far what is pinned goes from frame a to b, m; the farther of both when flat."""
    by_heel = norm(sub(get3(soles[b, foot, HEEL_POINT]), get3(soles[a, foot, HEEL_POINT])))
    by_ball = norm(sub(get3(soles[b, foot, BALL_POINT]), get3(soles[a, foot, BALL_POINT])))
    if phase == FLAT:
        return max(by_heel, by_ball)
    return by_heel if phase == HEEL else by_ball


@compiled
def _pinned_height(soles, foot, t, phase):
    """Height of what is pinned at frame t, m."""
    heel, ball = soles[t, foot, HEEL_POINT, 2], soles[t, foot, BALL_POINT, 2]
    if phase == FLAT:
        return 0.5 * (heel + ball)
    return heel if phase == HEEL else ball


@compiled
def _release(soles, spans, stretches, fps, apart, leaves, lifted, most):
    """Take off each contact's ends what still comes down, or already leaves.

    A foot that bears weight may move faster than one that can be held: its ball rolls off the tip.
    """
    first = 0
    for k in range(spans.shape[0]):
        foot, start, stop = spans[k, 0], spans[k, 1], spans[k, 2]
        last = first
        while last < stretches.shape[0] and stretches[last, 0] == k:
            last += 1
        margin = (stop - start) // 5
        usual, level, count = 0.0, 0.0, 0
        for s in range(first, last):
            for t in range(
                max(stretches[s, 1], start + margin), min(stretches[s, 4], stop - margin)
            ):
                phase = _phase(stretches, s, t)
                usual += _pinned_speed(soles, foot, t, start, stop, phase, fps)
                level += _pinned_height(soles, foot, t, phase)
                count += 1
        highest = level / max(count, 1) + lifted if count else np.inf
        fastest = (leaves + _PER_USUAL * usual / max(count, 1)) * apart / fps
        longest = int(min(most, (stop - start) / 3.0))
        while stop - apart > start and spans[k, 2] - stop < longest:
            phase = _phase(stretches, last - 1, stop - 1)
            way = _way_between(soles, foot, stop - 1 - apart, stop - 1, phase)
            if way <= fastest and _pinned_height(soles, foot, stop - 1, phase) <= highest:
                break
            stop -= 1
        while start + apart < stop and start - spans[k, 1] < longest:
            phase = _phase(stretches, first, start)
            way = _way_between(soles, foot, start, start + apart, phase)
            if way <= fastest and _pinned_height(soles, foot, start, phase) <= highest:
                break
            start += 1
        spans[k, 1], spans[k, 2] = start, stop
        for s in range(first, last):
            for c in range(1, 5):
                stretches[s, c] = min(max(stretches[s, c], start), stop)
        first = last


@compiled
def _measure(
    soles, confidence, spans, stretches, lengths, fps, stands, places, directions, has_flat, wobble
):
    """Write where contacts have their prints; a frame that moves much faster than most weighs little."""
    first = 0
    for k in range(spans.shape[0]):
        foot, start, stop = spans[k, 0], spans[k, 1], spans[k, 2]
        last = first
        while last < stretches.shape[0] and stretches[last, 0] == k:
            last += 1
        heel, ball = lengths[foot, 0], lengths[foot, 1]
        direction = (0.0, 0.0, 0.0)
        speed = 0.0
        for s in range(first, last):
            for t in range(stretches[s, 1], stretches[s, 4]):
                phase = _phase(stretches, s, t)
                speed += _pinned_speed(soles, foot, t, start, stop, phase, fps) / (stop - start)
                has_flat[k] |= phase == FLAT
                weight = 1.0 if phase == FLAT else _BY_FLAT
                along = sub(get3(soles[t, foot, BALL_POINT]), get3(soles[t, foot, HEEL_POINT]))
                if phase != FLAT:
                    along = (along[0], along[1], 0.0)
                direction = add_scaled(direction, along, weight)
        if not has_flat[k]:
            direction = (direction[0], direction[1], 0.0)
        direction = unit(direction, (1.0, 0.0, 0.0))
        total, square = 0.0, 0.0
        place = (0.0, 0.0, 0.0)
        origin = get3(soles[start, foot, BALL_POINT])
        usual = 3.0 * speed + stands
        for s in range(first, last):
            for t in range(stretches[s, 1], stretches[s, 4]):
                phase = _phase(stretches, s, t)
                off = _pinned_speed(soles, foot, t, start, stop, phase, fps) / usual
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
                square += weight * at[2] * at[2]
        place = scale(place, 1.0 / total)
        wobble[k] = math.sqrt(max(square / total - place[2] * place[2], 0.0))
        for c in range(3):
            places[k, c] = origin[c] + place[c]
            directions[k, c] = direction[c]
        first = last


@compiled
def _off(soles, foot, t, phase, heel, ball):
    """How far the pinned points at frame t are from where they are held, m; the farther of two."""
    by_heel = norm(sub(get3(soles[t, foot, HEEL_POINT]), heel)) if phase != BALL else 0.0
    by_ball = norm(sub(get3(soles[t, foot, BALL_POINT]), ball)) if phase != HEEL else 0.0
    return max(by_heel, by_ball)


@compiled
def _trim(soles, spans, stretches, heels, balls, keep, most, change, starts, stops):
    first = 0
    for k in range(spans.shape[0]):
        foot, start, stop = spans[k, 0], spans[k, 1], spans[k, 2]
        heel, ball = get3(heels[k]), get3(balls[k])
        last = first
        still, low, high = 0, stop, start
        while last < stretches.shape[0] and stretches[last, 0] == k:
            for t in range(stretches[last, 1], stretches[last, 4]):
                off = _off(soles, foot, t, _phase(stretches, last, t), heel, ball)
                if off < keep:
                    still += 1
                    low, high = min(low, t), max(high, t + 1)
            last += 1
        if still >= _MOSTLY * (stop - start) and low - start <= most and stop - high <= most:
            starts[k], stops[k] = low, high
        for s in range(first, last):
            for t in range(max(stretches[s, 1], starts[k]), min(stretches[s, 4], stops[k])):
                off = _off(soles, foot, t, _phase(stretches, s, t), heel, ball)
                change[k] = max(change[k], off)
        first = last
