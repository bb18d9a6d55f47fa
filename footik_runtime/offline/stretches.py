"""Stretches: when the foot of a contact turns over its heel, lies flat, and turns over its ball."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from footik_runtime.compiled import compiled
from footik_runtime.math3d import get3, norm, sub
from footik_runtime.offline.stages import Contacts, Ints, Working
from footik_runtime.phases import Phase
from footik_runtime.sole import BALL as BALL_POINT
from footik_runtime.sole import HEEL as HEEL_POINT
from footik_runtime.sole import TIP as TIP_POINT

Array = NDArray[np.float64]

HEEL, FLAT, BALL = int(Phase.HEEL), int(Phase.FLAT), int(Phase.BALL)  # plain, for kernels

# Of a body whose legs are 0.85 m long; lengths and speeds scale with the leg.
_WINDOW = 0.15  # s within which a phase's ends are looked for
_SHORTEST_PHASE = 0.05  # s: a foot that rocks back for less does not
_PER_FRAME = 1e-4  # m of the pinned point's way that moving an end by a frame must save
_ARRIVES = 0.15  # m/s, over what it does in mid-contact: a foot that comes so fast does not stand
_LEAVES = 0.20  # m/s, likewise: a point that goes so fast is not held
_PER_USUAL = 1.0  # times what it does in mid-contact
_LIFTED = 0.003  # m over where it is in mid-contact: a point that high does not stand yet
_LEVEL = math.radians(1.5)  # pitch, off that of the flat foot, of one that is level still
_ROLLED = math.radians(2.5)  # pitch, off that of the flat foot, from which it turns over an end
_TURNS = math.radians(1.5)  # pitch within twice `_BETWEEN` by which a foot turns that is not flat
_STEPS = 0.25  # m/s, over twice what it does in all: a foot with both ends this fast goes away
_NEW_PLACE = 0.025  # m: and does, where that brings it this far
_BETWEEN = 1.0 / 60.0  # s over which that speed is told
_MOST_TRIMMED = 0.10  # s, and a third of the contact, off either end of it


def stretches(work: Working, contacts: Contacts, spans: Ints) -> tuple[Ints, Ints]:
    """When the feet of contacts `spans` (K, 3: foot, first frame, frame after the last) are what.

    Returns:
        (K, 3) the contacts without the frames in which their foot cannot be held yet, or any more;
        and (S, 5) contact, start, flat, roll and stop of every stretch on the heel, then flat, then
        on the ball. Most contacts have one; a foot that rocks back has several.
    """
    fps, phases = contacts.fps, contacts.phases().astype(np.int64)
    out = np.empty((int(np.sum(spans[:, 2] - spans[:, 1])), 5), dtype=np.int64)
    out = out[: _split(phases, spans, math.ceil(_SHORTEST_PHASE * fps), out)]
    window = max(1, round(_WINDOW * fps))
    apart = max(1, round(_BETWEEN * fps))
    _refine(work.soles, spans, out, window, 2 * apart, _PER_FRAME * work.scale)
    spans = spans.copy()
    _release(
        work.soles, spans, out, fps, apart,
        _ARRIVES * work.scale, _LEAVES * work.scale, _LIFTED * work.scale, _MOST_TRIMMED * fps,
    )  # fmt: skip
    return spans, out


def stands(work: Working, spans: Ints) -> Ints:
    """(K', 3) the contacts `spans` (K, 3), parted where a foot goes from one place to another.

    A foot that shuffles hardly leaves the ground: its contact lasts, but it has two footprints.
    """
    fps = work.clip.fps
    out = np.empty((int(np.sum(spans[:, 2] - spans[:, 1])), 3), dtype=np.int64)
    apart = max(1, round(_BETWEEN * fps))
    fewest = max(2, math.ceil(_SHORTEST_PHASE * fps))
    count = _part(
        work.soles, spans, fps, apart, fewest, _STEPS * work.scale, _NEW_PLACE * work.scale, out
    )
    return out[:count]


@compiled
def _part(soles, spans, fps, apart, fewest, steps, new_place, out):
    """Write the stands of all contacts into out (S, 3); return how many."""
    count = 0
    for k in range(spans.shape[0]):
        foot, start, stop = spans[k, 0], spans[k, 1], spans[k, 2]
        usual = 0.0
        for t in range(start, stop - apart):
            usual += _slower(soles, foot, t, t + apart) / max(stop - start - apart, 1)
        fastest = steps * apart / fps + 2.0 * usual
        t = start
        while t < stop - apart:
            if _slower(soles, foot, t, t + apart) <= fastest:
                t += 1
                continue
            first = t
            while t < stop - apart and _slower(soles, foot, t, t + apart) > fastest:
                t += 1
            last = t + apart - 1
            within = first - start >= fewest and stop - last - 1 >= fewest
            if within and _slower(soles, foot, first, last) > new_place:
                out[count, 0], out[count, 1], out[count, 2] = foot, start, first + 1
                count += 1
                start = last
                t = last
        out[count, 0], out[count, 1], out[count, 2] = foot, start, stop
        count += 1
    return count


@compiled
def _slower(soles, foot, a, b):
    """How far heel and ball go from frame a to b, the one that goes less far, m."""
    by_heel = norm(sub(get3(soles[b, foot, HEEL_POINT]), get3(soles[a, foot, HEEL_POINT])))
    by_ball = norm(sub(get3(soles[b, foot, BALL_POINT]), get3(soles[a, foot, BALL_POINT])))
    return min(by_heel, by_ball)


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
                    if end - t >= shortest or (end == stop and end - t > t - start):
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
def _refine(soles, spans, stretches, window, apart, per_frame):
    """Move where each stretch goes flat and where it rolls so that pinned points move least.

    A foot that walks backwards comes down over its ball and leaves over its heel: there one stretch
    ends where the next begins, and both go with that.
    """
    count = stretches.shape[0]
    for s in range(count):
        k, start, stop = stretches[s, 0], stretches[s, 1], stretches[s, 4]
        flat, roll = stretches[s, 2], stretches[s, 3]
        if flat >= roll:
            continue
        foot = spans[k, 0]
        comes = start == flat and s > 0 and stretches[s - 1, 0] == k
        goes = roll == stop and s + 1 < count and stretches[s + 1, 0] == k
        comes_over = BALL_POINT if comes else HEEL_POINT
        leaves_over = HEEL_POINT if goes else BALL_POINT
        first, last = _level_within(soles, foot, flat, roll, comes_over, leaves_over)
        earliest = max(stretches[s - 1, 3], stretches[s - 1, 2]) if comes else start
        latest = _first_flat(stretches, s + 1) if goes else stop
        if comes or flat > start or start == spans[k, 1]:
            low, high = max(earliest, flat - window), min(roll - 1, flat + window)
            flat = _least(soles, foot, low, flat, high, comes_over, True, per_frame)
        if goes or roll < stop or stop == spans[k, 2]:
            low, high = max(flat + 1, roll - window), min(latest, roll + window)
            roll = _least(soles, foot, low, roll, high, leaves_over, False, per_frame)
        # A level foot that goes up or down does so as a whole, not over its heel or ball.
        flat, roll = min(flat, first), max(roll, last)
        flat, roll = _while_level(soles, foot, flat, roll, apart, comes_over, leaves_over)
        stretches[s, 2], stretches[s, 3] = flat, roll
        if comes:
            stretches[s, 1] = stretches[s - 1, 4] = flat
        if goes:
            stretches[s, 4] = stretches[s + 1, 1] = roll


@compiled
def _first_flat(stretches, s):
    """The first frame of a stretch that is not on its heel."""
    return min(stretches[s, 2], stretches[s, 4])


@compiled
def _pitch(soles, foot, t):
    """How far the nose of a sole points up, rad."""
    along = sub(get3(soles[t, foot, BALL_POINT]), get3(soles[t, foot, HEEL_POINT]))
    return math.atan2(along[2], math.hypot(along[0], along[1]))


@compiled
def _usual_pitch(soles, foot, flat, roll):
    """The mean pitch of the middle third of flat frames, rad."""
    third = (roll - flat) // 3
    usual = 0.0
    for t in range(flat + third, roll - third):
        usual += _pitch(soles, foot, t) / (roll - flat - 2 * third)
    return usual


@compiled
def _level_within(soles, foot, flat, roll, comes_over, leaves_over):
    """First frame and frame after the last, around the middle of flat ones, of a level foot.

    Both its ends move: one that turns over an end is level for a while, too.
    """
    usual = _usual_pitch(soles, foot, flat, roll)
    first = last = (flat + roll) // 2
    while first > flat and _is_level(soles, foot, first - 1, first, usual, comes_over):
        first -= 1
    while last < roll and _is_level(soles, foot, last, last, usual, leaves_over):
        last += 1
    return first, last


@compiled
def _is_level(soles, foot, t, after, usual, pivot):
    """Whether a foot is level at t and goes to frame `after` as a whole, not over its pivot."""
    other = HEEL_POINT if pivot == BALL_POINT else BALL_POINT
    if abs(_pitch(soles, foot, t) - usual) > _LEVEL:
        return False
    return after == 0 or _way(soles, after, foot, other) < 2.0 * _way(soles, after, foot, pivot)


@compiled
def _while_level(soles, foot, flat, roll, apart, comes_over, leaves_over):
    """Of flat frames, those between an end that comes down and an end that goes up.

    A heel leaves the ground long before it is fast: then the foot would be turned back a lot. A
    contact that the clip cuts off may have no flat frame.
    """
    usual = _usual_pitch(soles, foot, flat, roll)
    frames = soles.shape[0]
    whole = flat > 0 and roll < frames
    nose_first = 1.0 if comes_over == HEEL_POINT else -1.0
    nose_last = 1.0 if leaves_over == HEEL_POINT else -1.0
    while flat > 0 and flat + whole < roll:
        since = flat if whole else max(flat - apart, 0)
        falls = _pitch(soles, foot, since) - _pitch(soles, foot, min(flat + apart, roll - 1))
        off = _pitch(soles, foot, flat) - usual
        if nose_first * off < _ROLLED and nose_first * falls < _TURNS:
            break
        flat += 1
    while roll < frames and flat + whole < roll:
        until = roll - 1 if whole else min(roll - 1 + apart, frames - 1)
        rises = _pitch(soles, foot, until) - _pitch(soles, foot, max(roll - 1 - apart, flat))
        off = _pitch(soles, foot, roll - 1) - usual
        if nose_last * off < _ROLLED and nose_last * rises < _TURNS:
            break
        roll -= 1
    return flat, roll


@compiled
def _least(soles, foot, low, now, high, point, before, per_frame):
    """The frame in low..high at which to go over between one pinned point and both.

    The point is pinned alone before that frame, or from it on.
    """
    best, least = now, np.inf
    for b in range(low, high + 1):
        cost = per_frame * abs(b - now)
        for t in range(max(low, 1), min(high + 1, soles.shape[0])):
            alone = t < b if before else t > b
            if not alone and t != b:
                cost += _way(soles, t, foot, HEEL_POINT) + _way(soles, t, foot, BALL_POINT)
            else:
                cost += 2.0 * _way(soles, t, foot, point)
        if cost < least:
            best, least = b, cost
    return best


@compiled
def phase_at(stretches, s, t):
    """The phase of frame t in stretch s."""
    if t < stretches[s, 2]:
        return HEEL
    return FLAT if t < stretches[s, 3] else BALL


@compiled
def pinned_speed(soles, foot, t, start, stop, phase, fps):
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
def _lifted(soles, foot, t, phase, levels):
    """How far what is pinned at frame t is over where it is in mid-contact, m.

    A ball may be, while its foot rolls over toes that stay down.
    """
    heel = soles[t, foot, HEEL_POINT, 2] - levels[0]
    ball = soles[t, foot, BALL_POINT, 2] - levels[1]
    if phase == BALL:
        return min(ball, soles[t, foot, TIP_POINT, 2] - levels[2])
    return heel if phase == HEEL else 0.5 * (heel + ball)


@compiled
def _levels(soles, foot, start, stop, stretches, first, last):
    """Mean heights of heel, ball and tip where they carry in mid-contact, m; else infinite.

    A tip that never lies flat carries where it is lowest.
    """
    heel, ball, tip, heels, balls, tips = 0.0, 0.0, 0.0, 0, 0, 0
    lowest = np.inf
    for s in range(first, last):
        for t in range(max(stretches[s, 1], start), min(stretches[s, 4], stop)):
            phase = phase_at(stretches, s, t)
            if phase != BALL:
                heel += soles[t, foot, HEEL_POINT, 2]
                heels += 1
            if phase != HEEL:
                ball += soles[t, foot, BALL_POINT, 2]
                balls += 1
            if phase == FLAT:
                tip += soles[t, foot, TIP_POINT, 2]
                tips += 1
            lowest = min(lowest, soles[t, foot, TIP_POINT, 2])
    return (
        heel / heels if heels else np.inf,
        ball / balls if balls else np.inf,
        tip / tips if tips else lowest,
    )


@compiled
def _release(soles, spans, stretches, fps, apart, arrives, leaves, lifted, most):
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
        levels = _levels(soles, foot, start + margin, stop - margin, stretches, first, last)
        usual, count = 0.0, 0
        for s in range(first, last):
            for t in range(
                max(stretches[s, 1], start + margin), min(stretches[s, 4], stop - margin)
            ):
                phase = phase_at(stretches, s, t)
                usual += pinned_speed(soles, foot, t, start, stop, phase, fps)
                count += 1
        usual *= _PER_USUAL / max(count, 1)
        slowest, fastest = (arrives + usual) * apart / fps, (leaves + usual) * apart / fps
        longest = int(min(most, (stop - start) / 3.0))
        while stop - apart > start and spans[k, 2] - stop < longest:
            phase = phase_at(stretches, last - 1, stop - 1)
            way = _way_between(soles, foot, stop - 1 - apart, stop - 1, phase)
            height = _lifted(soles, foot, stop - 1, phase, levels)
            if way <= fastest and height <= lifted:
                break
            stop -= 1
        while start + apart < stop and start - spans[k, 1] < longest:
            phase = phase_at(stretches, first, start)
            way = _way_between(soles, foot, start, start + apart, phase)
            height = _lifted(soles, foot, start, phase, levels)
            if way <= slowest and height <= lifted:
                break
            start += 1
        spans[k, 1], spans[k, 2] = start, stop
        for s in range(first, last):
            for c in range(1, 5):
                stretches[s, c] = min(max(stretches[s, c], start), stop)
        first = last
