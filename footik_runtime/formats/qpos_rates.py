"""The frame rate of a table of joint values, from whatever in it tells of time."""

from __future__ import annotations

import os
from collections.abc import Iterable

import numpy as np

from footik_runtime.errors import FootIKError
from footik_runtime.formats.qpos_tables import Table, time_column

_RATES = (24.0, 25.0, 30.0, 50.0, 60.0, 100.0, 120.0, 125.0, 200.0, 240.0, 250.0, 500.0, 1000.0)
_NEAR_RATE = 0.03  # share by which a rate told from velocities may be off
_RATE_KEYS = ("fps", "frequency", "framerate", "frame_rate", "mocap_framerate", "dt", "timestep")


def rate_of(
    table: Table, columns: Iterable[str], path: str | os.PathLike[str]
) -> tuple[float, tuple[str, ...]]:
    """Frames a second, and a note where they are a guess.

    An archive says its rate or its step, a table has a column of times; else velocities tell.

    Args:
        table: the file.
        columns: names of its arrays of values (T,); that of their velocities begins with a d more.
        path: for the message.

    Raises:
        FootIKError: nothing tells it.
    """
    for key in () if table.is_csv else _RATE_KEYS:
        value = table.arrays.get(key)
        if value is not None and value.size == 1 and value.dtype.kind in "fiu":
            number = float(value.reshape(-1)[0])
            if np.isfinite(number) and number > 0.0:
                return (1.0 / number if key in ("dt", "timestep") else number), ()
    column = time_column(table)
    if column is not None and len(table.arrays[column]) > 1:
        step = float(np.median(np.diff(table.arrays[column])))
        if step > 0.0:
            return _snapped(1.0 / step, 1e-3), ()
    told = _rate_of_velocities(table, columns)
    if told is None:
        raise FootIKError(f"{path}: does not tell its frame rate; give fps.")
    return told, (f"{told:g} fps, told from the velocities in the file",)


def _rate_of_velocities(table: Table, columns: Iterable[str]) -> float | None:
    """The rate at which the differences of values are the mean velocities between them."""
    steps, speeds = [], []
    for name in columns:
        velocity = table.arrays.get(f"d{name}")
        if velocity is None or velocity.dtype.kind not in "fiu":
            continue
        if velocity.shape == table.arrays[name].shape:
            steps.append(np.diff(table.arrays[name]))
            speeds.append(0.5 * (velocity[1:] + velocity[:-1]))
    if not steps:
        return None
    step, speed = np.concatenate(steps), np.concatenate(speeds)
    # Small steps are rounding and turning points; the median leaves out jumps between takes.
    large = (np.abs(step) > np.median(np.abs(step))) & (step * speed > 0.0)
    return (
        _snapped(float(np.median(speed[large] / step[large])), _NEAR_RATE) if large.any() else None
    )


def _snapped(rate: float, near: float) -> float:
    best = min(_RATES, key=lambda known: abs(known - rate) / known)
    return best if abs(best - rate) <= near * best else rate
