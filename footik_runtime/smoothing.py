"""Smoothing: values that follow a target over time, and the easing of a stride.

Everything here is compiled, works on scalars or vec3 tuples and returns what it changes: the new
value and, where there is one, the new velocity. Times are in seconds.

- `smooth_damp`, `smooth_damp3`: a critically damped follower after Game Programming Gems 4, as
  game engines ship it. It approximates exp() by a cubic, so its path depends slightly on the frame
  rate. It never overshoots: where a step would pass the target, it lands on it and stops.
- `ease`: half a cosine from 0 to 1.

A step of no time (dt = 0) keeps the value. On the target it also makes the velocity NaN, as the
engines do: 0 / 0. The next step then lands on its target, if that is not above the value, and else
returns NaN once before it does. OpenKCC's recorded traces hold exactly that; other callers leave
out the call where dt is 0.
"""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.math3d import add_scaled, dot, scale, sub

SHORTEST_SMOOTH_TIME = 1e-4


@compiled
def clamp_through(x, low, high):
    """Limit x to [low, high]; NaN passes through, whichever way min and max treat it."""
    if x < low:
        return low
    if x > high:
        return high
    return x


@compiled
def ease(f):
    """Half a cosine: 0 up to f = 0, 1 from f = 1, strictly rising and symmetric between."""
    return 0.5 * (math.sin(math.pi * (clamp_through(f, 0.0, 1.0) - 0.5)) + 1.0)


@compiled
def _decay(smooth_time, dt):
    """(omega, decay): the follower's frequency in 1/s, and about exp(-omega * dt)."""
    omega = 2.0 / max(smooth_time, SHORTEST_SMOOTH_TIME)
    x = omega * dt
    return omega, 1.0 / (1.0 + x + 0.48 * x * x + 0.235 * x * x * x)


@compiled
def _stopped(dt):
    """The velocity after landing on the target: the remaining way 0 over dt."""
    return 0.0 if dt > 0.0 else math.nan


@compiled
def smooth_damp(current, target, velocity, smooth_time, dt):
    """One step towards a target.

    Args:
        current: the value now.
        target: where it should go.
        velocity: what the last step returned, units/s; 0 at the start.
        smooth_time: about the lag behind a moving target, s; taken as at least 1e-4.
        dt: s, not negative.

    Returns:
        (value, velocity).
    """
    omega, decay = _decay(smooth_time, dt)
    change = current - target
    step = (velocity + omega * change) * dt
    value = target + (change + step) * decay
    # Written with the engines' comparison, so that NaN takes the branch it takes there.
    if (target - current > 0.0) == (value > target):
        return target, _stopped(dt)
    return value, (velocity - omega * step) * decay


@compiled
def smooth_damp3(current, target, velocity, smooth_time, dt):
    """One step of a vec3 towards a target; arguments and result as in `smooth_damp`."""
    omega, decay = _decay(smooth_time, dt)
    change = sub(current, target)
    step = scale(add_scaled(velocity, change, omega), dt)
    value = add_scaled(target, add_scaled(change, step, 1.0), decay)
    if dot(sub(target, current), sub(value, target)) > 0.0:
        rest = _stopped(dt)
        return target, (rest, rest, rest)
    return value, scale(add_scaled(velocity, step, -omega), decay)
