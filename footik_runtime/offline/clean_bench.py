"""Clean bench: cleanup scored on clips of a user, and on generated ones whose truth is known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from footik_runtime import quat_arrays
from footik_runtime.builtin import humanoid_rig
from footik_runtime.clip import Clip
from footik_runtime.formats import SUFFIXES, load_clip
from footik_runtime.formats.gltf import read_animations
from footik_runtime.formats.qpos import rig_of
from footik_runtime.gait import run as run_gait
from footik_runtime.gait import walk as walk_gait
from footik_runtime.offline.clean import clean
from footik_runtime.offline.measure_clip import AFTER, BEFORE, PINNED, compare, runs
from footik_runtime.offline.skate import GROUNDS, Truth, inject, true_walk
from footik_runtime.offline.stages import Cleaned
from footik_runtime.phases import Phase
from footik_runtime.recorded import Run
from footik_runtime.rig import Rig, find_rig
from footik_runtime.sole import BALL, HEEL, all_sole_points

Array = NDArray[np.float64]

SKATES: Mapping[str, float] = {
    "constant": 0.03,
    "accelerating": 0.03,
    "noise": 0.004,
    "drift": 0.08,
}
_NARROWEST = 5  # characters of a column
_AT_ENDS = 3  # frames: a contact cut off by the clip's end has no known place


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A clip to clean: captured, or made with feet that slide off the places of `truth`.

    clean: it slides nowhere, and must come back as it is.
    """

    name: str
    clip: Clip
    rig: Rig
    truth: Truth | None = None
    clean: bool = False


def files_as_cases(paths: Sequence[Path], model: Path | None = None) -> Iterator[Case]:
    """Every clip of files and folders, each animation of a glTF file on its own.

    `model` is the MuJoCo model that joint values belong to.

    Raises FootIKError for a file that is none, or holds no legs.
    """
    for path in paths:
        files = sorted(f for f in path.rglob("*") if f.suffix.lower() in SUFFIXES)
        for file in files if path.is_dir() else [path]:
            many = file.suffix.lower() in (".glb", ".gltf")
            for clip in read_animations(file) if many else [load_clip(file, model=model)]:
                name = f"{file.name}: {clip.name}" if many else file.name
                yield Case(name=name, clip=clip, rig=rig_of(clip) or find_rig(clip.skeleton))


def generated_cases(seed: int = 1) -> Iterator[Case]:
    """Walks and runs of the built-in humanoid on flat ground, a slope and stairs, clean and with
    every kind of skate: `SKATES`, m, half as much for runs.
    """
    rig = humanoid_rig()
    gaits = {"walk": walk_gait(rig), "slow walk": walk_gait(rig, speed=0.6), "run": run_gait(rig)}
    for gait, cycle in gaits.items():
        for ground in GROUNDS[:2] if gait == "run" else GROUNDS:
            truth = true_walk(cycle, rig, ground=ground)
            name = f"{gait}, {ground}"
            yield Case(name=f"{name}, clean", clip=truth.clip, rig=rig, truth=truth, clean=True)
            for kind, size in SKATES.items():
                size *= 0.5 if gait == "run" and kind != "drift" else 1.0
                skating = inject(truth, kind, size, seed=seed)
                yield Case(name=f"{name}, {kind}", clip=skating, rig=rig, truth=truth)


COLUMNS: Mapping[str, str] = {
    "before": "pinned, mm/s",
    "after": "after",
    "less": "less, %",
    "penetration": "penetration, mm",
    "float": "float, mm",
    "pop_before": "pop before",
    "pop": "pop",
    "outside": "outside, deg",
    "outside_leg": "leg, deg",
    "segments": "segments, mm",
    "moved": "moved, mm",
    "truth": "truth, mm",
}


def score_case(case: Case) -> dict[str, float]:
    """Clean a case. Returns the figures of `COLUMNS`; NaN where one does not apply.

    Speeds are of the pinned point; penetration and float are the largest of any sole point in any
    frame, and of any foot in contact; outside is the mean change of joints while their foot swings,
    of all the skeleton's joints and of the swinging leg's; truth is how far the farthest plant is
    from where its foot truly stood.
    """
    done = clean(case.clip, case.rig)
    made, told = runs(case.clip, done), compare(case.clip, done)
    before, after = made[BEFORE], made[AFTER]
    was, now = told[BEFORE], told[AFTER]
    outside = _outside(before, after, done)
    share = outside.shape[-1] / len(case.clip.skeleton)
    outside_leg = float(outside.mean()) if outside.size else 0.0
    heights = after.sole[..., 2] - after.ground
    contact = done.phases != Phase.SWING
    lowest = heights.min(axis=-1)
    speed, left = was[PINNED], now[PINNED]
    places, joints = case.clip.model_pose()[0], done.clip.model_pose()[0]
    return {
        "before": speed,
        "after": left,
        "less": 100.0 * (1.0 - left / speed) if speed > 0.0 else float("nan"),
        "penetration": 1000.0 * abs(min(float(heights.min()), 0.0)),
        "float": 1000.0 * max(float(lowest[contact].max()), 0.0) if contact.any() else 0.0,
        "pop_before": was["pop"],
        "pop": now["pop"],
        "outside": outside_leg * share,
        "outside_leg": outside_leg,
        "segments": 1000.0 * _longer(case.clip, places, joints),
        "moved": 1000.0 * float(np.linalg.norm(joints - places, axis=-1).max()),
        "truth": 1000.0 * _off_truth(case, done),
    }


def cleanup_table(rows: Mapping[str, Mapping[str, float]]) -> str:
    """The figures of `score_case`, a line each."""
    width = max(len(name) for name in rows)
    labels = {key: label.rjust(_NARROWEST) for key, label in COLUMNS.items()}
    lines = ["  ".join([" " * width, *labels.values()])]
    for name, row in rows.items():
        cells = [_cell(row[key]).rjust(len(label)) for key, label in labels.items()]
        lines.append("  ".join([name.ljust(width), *cells]))
    return "\n".join(lines)


def _cell(value: float) -> str:
    if not np.isfinite(value):
        return "-"
    return f"{value:.1f}" if value >= 10.0 else f"{value:.2f}"


def _outside(before: Run, after: Run, done: Cleaned) -> Array:
    """(N, K) how far joints of swinging legs turned against their parents, degrees."""
    turns = quat_arrays.mul(quat_arrays.conj(before.leg_rotations), after.leg_rotations)
    angles = np.degrees(np.linalg.norm(quat_arrays.to_rotvec(turns), axis=-1))
    return angles[done.phases == Phase.SWING]


def _longer(clip: Clip, before: Array, after: Array) -> float:
    """By how much any segment changes its length, m."""
    parents = clip.skeleton.parents[1:]
    lengths = [np.linalg.norm(p[:, 1:] - p[:, parents], axis=-1) for p in (before, after)]
    return float(np.abs(lengths[1] - lengths[0]).max()) if lengths[0].size else 0.0


def _off_truth(case: Case, done: Cleaned) -> float:
    """How far the farthest plant is from where its foot stood, m; NaN where that is not known.

    A body that drifted took the places of its feet along: there the drifted clip tells them.
    """
    truth, work = case.truth, done.work
    if truth is None or work is None:
        return float("nan")
    drifts = np.ptp(case.clip.root_positions - truth.clip.root_positions, axis=0).max() > 0.0
    stood = case.clip if drifts else truth.clip
    soles = all_sole_points(case.rig, *stood.model_pose())
    errors = [
        np.linalg.norm(_in_clip(0.5 * (plant.heel + plant.ball), done) - _place(soles, truth, span))
        for plant in done.plants
        for span in _contacts_of(truth, plant.foot)
        if plant.start < span[2] and span[1] < plant.stop
    ]
    return float(np.max(errors)) if errors else float("nan")


def _contacts_of(truth: Truth, foot: int) -> list[tuple[int, int, int]]:
    """Foot, first frame and frame after the last of its whole contacts."""
    last = len(truth.clip) - _AT_ENDS
    spans = [(foot, start, stop) for start, stop, _ in truth.places(foot)]
    return [s for s in spans if s[1] >= _AT_ENDS and s[2] <= last]


def _place(soles: Array, truth: Truth, span: tuple[int, int, int]) -> Array:
    """(3,) where a contact's flat foot is on average."""
    foot, start, stop = span
    flat = np.flatnonzero(truth.phases[start:stop, foot] == Phase.FLAT) + start
    return soles[flat, foot][:, [HEEL, BALL]].mean(axis=(0, 1))


def _in_clip(point: Array, done: Cleaned) -> Array:
    """A point of a plant in the frame of the clip that was cleaned."""
    assert done.work is not None
    return quat_arrays.rotate(done.work.back, point - done.work.shift[done.work.pad])
