"""Offsets that carry a jump away in finite time, and springs that any frame rate drives alike."""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.math3d import add_scaled, clamp, norm, scale

_SHORTEST = 1e-9  # s: a half-life below it is none, and its frequency would overflow
_OVER = 700.0  # radians of a spring's phase after which nothing is left of any distance


@compiled
def smooth_step(t):
    """Quintic ease from 0 at t <= 0 to 1 at t >= 1, at rest at both ends (minimum jerk)."""
    t = clamp(t, 0.0, 1.0)
    return t * t * t * (10.0 + t * (6.0 * t - 15.0))


@compiled
def smooth_bump(t):
    """0 at t <= 0 and t >= 1, 1 at t = 0.5, at rest at all three."""
    t = clamp(t, 0.0, 1.0)
    u = t * (1.0 - t)
    return 16.0 * u * u


@compiled
def decayed(offset, velocity, age, duration):
    """An offset (3,) with its velocity at age 0, `age` seconds on: exactly zero from `duration`.

    The quintic that starts with that offset, velocity and no acceleration, and ends at rest at
    zero: inertialisation after Bollo (GDC 2018), a component at a time.
    """
    if age >= duration:
        return (0.0, 0.0, 0.0)
    s = age / duration
    s3 = s * s * s
    left = 1.0 + s3 * (-10.0 + s * (15.0 - 6.0 * s))
    pushed = duration * (s + s3 * (-6.0 + s * (8.0 - 3.0 * s)))
    return add_scaled(scale(offset, left), velocity, pushed)


@compiled
def limited_velocity(offset, velocity, duration, size):
    """The velocity cut so that a decaying offset overshoots by little: |v| <= 4 |x| / T + rest.

    What the offset is too small for would swing far to the other side; 1.5 m/s always remains, for
    a body of that size (1: a leg of 0.85 m).
    """
    speed = norm(velocity)
    most = 4.0 * norm(offset) / max(duration, 1e-6) + 1.5 * size
    return velocity if speed <= most else scale(velocity, most / speed)


@compiled
def spring(value, velocity, target, half_life, dt):
    """A critically damped spring, integrated exactly: the new value and velocity.

    `half_life` is the time in which a resting spring loses half of a constant distance, to about
    its slow tail: frequency = 1.678 / half_life. Any dt from 0 up; half_life 0 jumps.
    """
    if half_life < _SHORTEST:
        return target, 0.0
    frequency = 1.67835 / half_life
    if frequency * dt > _OVER:
        return target, 0.0
    away = value - target
    pull = velocity + frequency * away
    fade = math.exp(-frequency * dt)
    return target + fade * (away + pull * dt), fade * (velocity - frequency * pull * dt)


@compiled
def damped_spring(value, velocity, target, half_life, damping, dt):
    """A spring as `spring`, but with a damping ratio: 1 is critical, less swings, more creeps.

    Integrated exactly, by x'' = -w^2 x - 2 z w x' with z the damping, in each of its three cases.
    """
    if damping == 1.0 or half_life < _SHORTEST:
        return spring(value, velocity, target, half_life, dt)
    w = 1.67835 / half_life
    away = value - target
    if damping < 1.0:
        turns = w * math.sqrt(1.0 - damping * damping)
        if damping * w * dt > _OVER:
            return target, 0.0
        fade, c, s = math.exp(-damping * w * dt), math.cos(turns * dt), math.sin(turns * dt)
        b = (velocity + damping * w * away) / turns
        here = fade * (away * c + b * s)
        return target + here, fade * turns * (b * c - away * s) - damping * w * here
    root = w * math.sqrt(damping * damping - 1.0)
    slow, fast = root - damping * w, -root - damping * w
    a = (velocity - fast * away) / (slow - fast)
    left, right = a * math.exp(slow * dt), (away - a) * math.exp(max(fast * dt, -_OVER))
    return target + left + right, slow * left + fast * right
