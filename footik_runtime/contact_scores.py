"""How well predicted contacts and ground reaction forces match the true ones."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from footik_runtime.errors import FootIKError

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


class ContactTiming(NamedTuple):
    """Timing of strikes (contact begins) and offs (contact ends) against the truth.

    Attributes:
        strike_ms: mean absolute error of matched strikes, ms; NaN where none matched.
        off_ms: the same of offs.
        strikes_missed: true strikes with no predicted one in the window.
        offs_missed: the same of offs.
    """

    strike_ms: float
    off_ms: float
    strikes_missed: int
    offs_missed: int


class ForceScores(NamedTuple):
    """Vertical ground reaction force, each the mean over feet.

    Attributes:
        rmse_bw: root mean square error, percent of body weight.
        relative_rmse: that error over the mean of both signals' ranges, percent.
        correlation: Pearson's; NaN where a signal is constant.
    """

    rmse_bw: float
    relative_rmse: float
    correlation: float


def contact_f1(
    predicted: ArrayLike,
    truth: ArrayLike,
    known: ArrayLike | None = None,
    tolerance_s: float = 0.0,
    fps: float = 120.0,
) -> float:
    """F1 = 2TP / (2TP + FP + FN) over feet and frames; NaN with no contact on either side.

    With a tolerance, an error counts only if it is at least that far from the foot's nearest true
    change. A change lies halfway between its two frames.

    Args:
        predicted: (T,) or (T, feet) bool.
        truth: the same shape.
        known: the same shape; False where the truth is not known: those frames do not count, and
            a change needs both its frames known. All by default.
        tolerance_s: seconds, at least 0.
        fps: frames a second.

    Raises:
        FootIKError: shapes differ, or tolerance or fps are out of range.
    """
    return f1_of(*contact_counts(predicted, truth, known, tolerance_s, fps))


def contact_counts(
    predicted: ArrayLike,
    truth: ArrayLike,
    known: ArrayLike | None = None,
    tolerance_s: float = 0.0,
    fps: float = 120.0,
) -> tuple[int, int]:
    """True positives, and errors of either kind, as `contact_f1` counts them: sums add up."""
    given, true, sure = _same_shape(predicted, truth, known)
    _require_rate(fps)
    if not (np.isfinite(tolerance_s) and tolerance_s >= 0):
        raise FootIKError(f"the contact tolerance must be at least 0 s, not {tolerance_s}.")
    far = _frames_to_change(true, sure) >= tolerance_s * fps - 1e-9
    hits = int(np.sum(given & true & sure))
    errors = int(np.sum((given != true) & sure & far))
    return hits, errors


def f1_of(hits: int, errors: int) -> float:
    """F1 of counts: 2 hits / (2 hits + errors); NaN of none."""
    return 2 * hits / (2 * hits + errors) if hits + errors else math.nan


def contact_timing(
    predicted: ArrayLike,
    truth: ArrayLike,
    known: ArrayLike | None = None,
    fps: float = 120.0,
    window_s: float = 0.2,
) -> ContactTiming:
    """Mean distance in ms of each true strike and off from the nearest predicted one.

    Arguments as in `contact_f1`; a predicted change more than `window_s` away does not match.
    """
    given, true, sure = _same_shape(predicted, truth, known)
    _require_rate(fps)
    strike, strikes_missed = _timing(given, true, sure, 1, fps, window_s)
    off, offs_missed = _timing(given, true, sure, -1, fps, window_s)
    return ContactTiming(strike, off, strikes_missed, offs_missed)


def force_scores(predicted: ArrayLike, truth: ArrayLike, body_weight: float) -> ForceScores:
    """Errors of vertical ground reaction forces.

    Args:
        predicted: (T,) or (T, feet), N.
        truth: the same shape, N; frames that are NaN there do not count.
        body_weight: N, positive.

    Raises:
        FootIKError: shapes differ, or the weight is not positive.
    """
    given, true = (np.asarray(a, dtype=np.float64) for a in (predicted, truth))
    if given.shape != true.shape or given.ndim not in (1, 2):
        raise FootIKError(
            f"predicted and true forces must have one shape, (frames,) or (frames, feet), "
            f"not {given.shape} and {true.shape}."
        )
    if not (np.isfinite(body_weight) and body_weight > 0):
        raise FootIKError(f"the body weight must be positive, not {body_weight} N.")
    given, true = given.reshape(len(given), -1), true.reshape(len(true), -1)
    feet = [
        _force_scores(g[np.isfinite(t)], t[np.isfinite(t)], body_weight)
        for g, t in zip(given.T, true.T, strict=True)
    ]
    columns = np.array(feet).T.reshape(3, -1)
    return ForceScores(*(_mean_of_finite(column) for column in columns))


def _force_scores(given: Array, true: Array, body_weight: float) -> tuple[float, float, float]:
    if len(true) == 0:
        return math.nan, math.nan, math.nan
    error = float(np.sqrt(np.mean((given - true) ** 2)))
    span = 0.5 * float(np.ptp(given) + np.ptp(true))
    a, b = given - given.mean(), true - true.mean()
    norm = float(np.linalg.norm(a) * np.linalg.norm(b))
    # Rounding leaves a constant signal a little short of its own mean.
    varies = min(np.ptp(given), np.ptp(true)) > 1e-9 * body_weight
    return (
        100.0 * error / body_weight,
        100.0 * error / span if span > 0.0 else math.nan,
        float(a @ b) / norm if varies else math.nan,
    )


def _mean_of_finite(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else math.nan


def _same_shape(
    predicted: ArrayLike, truth: ArrayLike, known: ArrayLike | None
) -> tuple[Bools, Bools, Bools]:
    given, true = np.asarray(predicted, dtype=bool), np.asarray(truth, dtype=bool)
    sure = np.ones_like(true) if known is None else np.asarray(known, dtype=bool)
    for name, array in (("predicted", given), ("known", sure)):
        if array.shape != true.shape or true.ndim not in (1, 2):
            raise FootIKError(
                f"{name} and true contacts must have one shape, (frames,) or (frames, feet), "
                f"not {array.shape} and {true.shape}."
            )
    frames = len(true)
    return given.reshape(frames, -1), true.reshape(frames, -1), sure.reshape(frames, -1)


def _require_rate(fps: float) -> None:
    if not (np.isfinite(fps) and fps > 0):
        raise FootIKError(f"fps must be positive and finite, not {fps}.")


def _changes(contact: Bools, known: Bools, sign: int = 0) -> Bools:
    """(T - 1, feet) where contact begins (1), ends (-1) or either (0) between two known frames."""
    step = np.diff(contact.astype(np.int64), axis=0)
    changed = step != 0 if sign == 0 else step == sign
    return changed & known[1:] & known[:-1]


def _frames_to_change(contact: Bools, known: Bools) -> Array:
    """(T, feet) frames from each frame to the nearest change of its foot; inf without any."""
    frames = np.arange(len(contact))
    away = np.full(contact.shape, np.inf)
    for foot, changed in enumerate(_changes(contact, known).T):
        away[:, foot] = _to_nearest(frames, np.flatnonzero(changed) + 0.5)
    return away


def _to_nearest(wanted: NDArray, sorted_points: NDArray) -> Array:
    """(N,) distance of each wanted value to the nearest point; inf without points."""
    bounded = np.concatenate([[-np.inf], sorted_points, [np.inf]])
    after = np.searchsorted(bounded, wanted)
    return np.minimum(np.abs(wanted - bounded[after - 1]), np.abs(bounded[after] - wanted))


def _timing(
    given: Bools, true: Bools, sure: Bools, sign: int, fps: float, window_s: float
) -> tuple[float, int]:
    everywhere = np.ones_like(sure)
    away = np.concatenate(
        [
            _to_nearest(np.flatnonzero(wanted), np.flatnonzero(found)) / fps
            for wanted, found in zip(
                _changes(true, sure, sign).T, _changes(given, everywhere, sign).T, strict=True
            )
        ]
    )
    matched = away[away <= window_s + 1e-9]
    mean = 1000.0 * float(matched.mean()) if len(matched) else math.nan
    return mean, len(away) - len(matched)
