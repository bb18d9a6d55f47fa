"""Contact bench: detectors scored on recorded trials whose forces tell the truth.

A trial is an npz file with heel, ankle and toe (T, F, 3) m, contact and known (T, F), and fps.
"""

from __future__ import annotations

import math
import os
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from footik_runtime.contact_scores import contact_counts, contact_timing, f1_of
from footik_runtime.errors import FootIKError
from footik_runtime.offline import detect
from footik_runtime.offline.filters import fill_gaps, latched, runs

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

TOLERANCES_MS = (0, 20, 40)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """Points of both feet and when they carried: heel, ankle, toe (T, F, 3), contact, known (T, F).

    known: where the truth is known; NaN: a point that was not seen.
    """

    name: str
    fps: float
    heel: Array
    ankle: Array
    toe: Array
    contact: Bools
    known: Bools


Detector = Callable[[Trial], Bools]


def read_trials(folder: str | os.PathLike[str]) -> list[Trial]:
    """Every trial of a folder, by name. Raises FootIKError where there is none."""
    path = Path(folder)
    files = sorted(path.glob("*.npz")) if path.is_dir() else [path]
    if not files or not all(file.is_file() for file in files):
        raise FootIKError(f"{folder}: there are no trials (*.npz) there.")
    return [read_trial(file) for file in files]


def read_trial(path: str | os.PathLike[str]) -> Trial:
    """Read one trial. Raises FootIKError for what is none, naming the array that is wrong."""
    try:
        with np.load(path, allow_pickle=False) as data:
            held = {name: data[name] for name in data.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise FootIKError(f"{path}: no trial can be read from it ({error}).") from None
    missing = [k for k in ("fps", "heel", "ankle", "toe", "contact", "known") if k not in held]
    if missing:
        raise FootIKError(f"{path}: a trial needs {', '.join(missing)}; it has {', '.join(held)}.")
    shape = held["contact"].shape
    for name in ("heel", "ankle", "toe", "known"):
        wanted = shape if name == "known" else (*shape, 3)
        if len(shape) != 2 or held[name].shape != wanted:
            raise FootIKError(f"{path}: {name} must have shape {wanted}, not {held[name].shape}.")
    fps = float(held["fps"]) if held["fps"].size == 1 else math.nan
    if not (math.isfinite(fps) and fps > 0.0):
        raise FootIKError(f"{path}: fps must be one positive number, not {held['fps']}.")
    points = {name: held[name].astype(np.float64) for name in ("heel", "ankle", "toe")}
    flags = {name: held[name].astype(bool) for name in ("contact", "known")}
    return Trial(name=Path(path).stem, fps=fps, **points, **flags)


# --- detectors ----------------------------------------------------------------------------------


def ours(trial: Trial) -> Bools:
    """(T, F) this library's detector at its defaults."""
    return detect.contacts(np.stack([trial.heel, trial.toe], axis=2), trial.fps).foot


def footplant(trial: Trial) -> Bools:
    """(T, F) FootPlant's rule, for heel or toe, since not every trial has ankles.

    Slower than .08 m/s and within 4 cm of the floor it enters, with 1.5 times of both it stays,
    and fewer than three frames are none. The floor: 5th percentile of the lower foot.
    """
    out = np.zeros(trial.contact.shape, dtype=bool)
    for points in (trial.heel, trial.toe):
        filled, _ = fill_gaps(points)
        speed = np.linalg.norm(np.gradient(filled, axis=0), axis=-1) * trial.fps
        lowest = np.sort(filled[..., 2].min(axis=-1))
        height = filled[..., 2] - lowest[int(0.05 * (len(lowest) - 1))]
        for foot in range(speed.shape[1]):
            enters = (speed[:, foot] < 0.08) & (height[:, foot] < 0.04)
            held = latched(enters, (speed[:, foot] < 0.12) & (height[:, foot] < 0.06))
            for start, stop in runs(held):
                out[start:stop, foot] |= stop - start >= 3
    return out


def by_thresholds(trial: Trial, *, speed: float, height: float) -> Bools:
    """(T, F) heel or toe slower than a speed, m/s, and nearer than a height, m, to its own floor.

    The floor of a point is the 5th percentile of its height.
    """
    out = np.zeros(trial.contact.shape, dtype=bool)
    for points in (trial.heel, trial.toe):
        filled, missing = fill_gaps(points)
        moved = np.linalg.norm(np.gradient(filled, axis=0), axis=-1) * trial.fps
        low = filled[..., 2] - np.percentile(filled[..., 2], 5.0, axis=0)
        out |= (moved < speed) & (low < height) & ~missing
    return out


def tuned(trials: Sequence[Trial]) -> tuple[str, Detector]:
    """The thresholds that score best on these very trials: what no detector may be told."""
    best, choice = -1.0, (0.5, 0.05)
    for speed in np.arange(0.2, 1.61, 0.1):
        for height in (0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.1):
            detector = partial(by_thresholds, speed=float(speed), height=height)
            total = np.sum([_counts(detector(t), t, 0.0) for t in trials], axis=0)
            score = f1_of(int(total[0]), int(total[1]))
            if score > best:
                best, choice = score, (float(speed), height)
    speed, height = choice
    label = f"tuned on this set: {speed:.1f} m/s & {100 * height:.0f} cm"
    return label, partial(by_thresholds, speed=speed, height=height)


def detectors(trials: Sequence[Trial]) -> dict[str, Detector]:
    """What is compared, by label; the last is tuned on the trials."""
    fixed = partial(by_thresholds, speed=0.5, height=0.05)
    return {
        "ours": ours,
        "FootPlant": footplant,
        "fixed 0.5 m/s & 5 cm": fixed,
        **dict([tuned(trials)]),
    }


# --- disturbed trials ---------------------------------------------------------------------------


def with_noise(trial: Trial, sd: float, seed: int) -> Trial:
    """The trial with white noise of a standard deviation, m, on every coordinate and frame."""
    rng = np.random.default_rng(seed)
    points = {
        name: getattr(trial, name) + rng.normal(0.0, sd, getattr(trial, name).shape)
        for name in ("heel", "ankle", "toe")
    }
    return replace(trial, **points)


def with_drift(trial: Trial, size: float) -> Trial:
    """The trial with a root that drifts by a size, m, upwards and aside over its whole length."""
    part = np.linspace(0.0, 1.0, len(trial.heel))[:, None, None]
    moved = part * np.array([0.0, size, size])
    points = {name: getattr(trial, name) + moved for name in ("heel", "ankle", "toe")}
    return replace(trial, **points)


# --- scores -------------------------------------------------------------------------------------


def _counts(found: Bools, trial: Trial, tolerance: float) -> tuple[int, int]:
    return contact_counts(found, trial.contact, trial.known, tolerance, trial.fps)


def score_trials(trials: Sequence[Trial], detector: Detector) -> dict[str, dict[str, float]]:
    """Rows of figures by trial, and "all": F1 by tolerance, and strike and off timing, ms.

    "all" adds counts up over trials, and its timing is the mean weighted by matched events.
    """
    rows: dict[str, dict[str, float]] = {}
    totals = np.zeros((len(TOLERANCES_MS), 2), dtype=np.int64)
    events: list[tuple[float, int, float, int]] = []
    for trial in trials:
        found = detector(trial)
        counts = np.array([_counts(found, trial, ms / 1000.0) for ms in TOLERANCES_MS])
        totals += counts
        timing = contact_timing(found, trial.contact, trial.known, trial.fps)
        strikes, offs = _events(trial, timing)
        events.append((timing.strike_ms, strikes, timing.off_ms, offs))
        rows[trial.name] = _row(counts, timing.strike_ms, timing.off_ms)
    strike = _weighted([(ms, n) for ms, n, _, _ in events])
    off = _weighted([(ms, n) for _, _, ms, n in events])
    rows["all"] = _row(totals, strike, off)
    return rows


def _events(trial: Trial, timing) -> tuple[int, int]:
    """How many true strikes and offs were matched."""
    both = trial.known[1:] & trial.known[:-1]
    change = np.diff(trial.contact.astype(np.int8), axis=0) * both
    strikes, offs = int((change == 1).sum()), int((change == -1).sum())
    return strikes - timing.strikes_missed, offs - timing.offs_missed


def _weighted(pairs: Sequence[tuple[float, int]]) -> float:
    known = [(ms, n) for ms, n in pairs if n > 0 and math.isfinite(ms)]
    total = sum(n for _, n in known)
    return sum(ms * n for ms, n in known) / total if total else math.nan


def _row(counts: NDArray[np.int64], strike: float, off: float) -> dict[str, float]:
    scores = {
        f"F1 at {ms} ms": f1_of(int(hits), int(errors))
        for ms, (hits, errors) in zip(TOLERANCES_MS, counts, strict=True)
    }
    return scores | {"strike, ms": strike, "off, ms": off}


def score_contacts(
    trials: Sequence[Trial], *, noise: float = 0.03, drift: float = 0.08, seeds: int = 5
) -> dict[str, dict[str, dict[str, float]]]:
    """Every detector's rows by its label: each trial, all, and all with noise and with drift.

    noise: m of standard deviation, the mean over seeds; drift: m. Thresholds that are tuned are
    tuned on the clean trials.
    """
    out = {}
    for label, detector in detectors(trials).items():
        rows = score_trials(trials, detector)
        noisy = [
            score_trials([with_noise(t, noise, seed) for t in trials], detector)["all"]
            for seed in range(seeds)
        ]
        rows[f"all, {100 * noise:g} cm noise"] = {
            key: float(np.mean([row[key] for row in noisy])) for key in noisy[0]
        }
        drifted = [with_drift(t, drift) for t in trials]
        rows[f"all, {100 * drift:g} cm drift"] = score_trials(drifted, detector)["all"]
        out[label] = rows
    return out


def contact_table(scores: Mapping[str, Mapping[str, Mapping[str, float]]]) -> str:
    """The scores as text: a row for each trial, a column of F1 for each detector, then timing."""
    labels = list(scores)
    names = list(scores[labels[0]])
    wide = max(len(name) for name in names)
    lines = [f"{i + 1}: {label}" for i, label in enumerate(labels)]
    marks = "".join(f"{f'{i + 1}':>21}" for i in range(len(labels)))
    heads = "".join(f"{'F1 at 0 / 20 / 40 ms':>21}" for _ in labels)
    lines += ["", f"{'':{wide}}{marks}", f"{'':{wide}}{heads}"]
    for name in names:
        cells = ""
        for label in labels:
            scored = [scores[label][name][f"F1 at {ms} ms"] for ms in TOLERANCES_MS]
            cells += f"{' '.join(f'{score:.3f}' for score in scored):>21}"
        lines.append(f"{name:{wide}}{cells}")
    lines += ["", f"{'strike / off, ms':{wide}}{marks}"]
    for name in names:
        cells = "".join(
            f"{scores[label][name]['strike, ms']:>12.1f} /{scores[label][name]['off, ms']:>7.1f}"
            for label in labels
        )
        lines.append(f"{name:{wide}}{cells}")
    return "\n".join(lines)
