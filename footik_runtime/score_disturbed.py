"""Disturbed motions for the score: what a clip tells is wrong, or the character is steered hard."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from footik_runtime.motion import Motion
from footik_runtime.phases import phase_curve, weight_curve
from footik_runtime.walk import Drive


def with_late_contacts(motion: Motion, seconds: float) -> Motion:
    """The motion prepared from contact curves that are late by so much, or early below 0."""
    clip, rig = motion.clip, motion.rig
    frames = round(seconds * clip.fps)
    names = [name(leg.name) for leg in rig.legs for name in (weight_curve, phase_curve)]

    def rolled(curve: np.ndarray) -> np.ndarray:
        late = np.roll(curve[:-1], frames)  # the last frame of a loop repeats the first
        return np.append(late, late[0])

    late = clip.with_curves(**{name: rolled(clip.curves[name]) for name in names})
    told = Motion.prepare(late, rig)
    return replace(told, velocity=motion.velocity, yaw_rate=motion.yaw_rate)


def with_wrong_footholds(motion: Motion, metres: float) -> Motion:
    """The motion with every foothold foreseen so far ahead of where the foot will be."""
    timing = motion.timing.copy()
    timing["print"][..., 0] += metres
    timing["middle"][..., 0] += metres
    return replace(motion, timing=timing)


def steered_hard(speed: float) -> Drive:
    """Commands that turn by up to 1.5 rad/s to and fro, and change speed, within each swing."""

    def drive(time: float) -> tuple[list[float], float]:
        turn = 1.5 * math.copysign(1.0, math.sin(2.0 * math.pi * time / 1.1))
        part = 1.0 if math.sin(2.0 * math.pi * time / 1.7) > 0.0 else 0.6
        return [speed * part, 0.0], turn

    return drive
