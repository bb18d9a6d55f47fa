"""A Kovar-style pass recorded elsewhere, file by file, through `footik_runtime.offline.footplant`.

The recordings are y up, centimetres, xyzw, from float32; they are run as they are. Any JSON file in
the folder takes part: a list is a table of two-bone solves, a dict with "input_frames" a clip.
"""

import json
import os
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from footik_runtime import quat_arrays as qa
from footik_runtime.offline.footplant import (
    FootPlantOptions,
    LegJoints,
    clean_frames,
    detect,
    ground_height,
)
from footik_runtime.offline.footplant_solve import leg_turns

SHARED = Path(os.environ.get("FOOTIK_SHARED") or Path(__file__).parents[2] / ".." / "shared")
FOLDER = SHARED / "peers" / "footplant"
pytestmark = pytest.mark.skipif(
    not FOLDER.is_dir(), reason=f"no FootPlant recordings: {FOLDER} (set FOOTIK_SHARED)"
)

ANKLE, ANCHOR = 0.03, 1e-3  # cm
QUATERNION, END = 5e-5, 5e-3  # of the table; cm
REPORT = 0.01
# What float32 leaves where nothing is left to do: a solve there ends a hundredth of a cm off.
SLIDE, NOTHING_DEG, NOTHING_CM = 0.03, 1e-3, 1e-3
SIDES = (("left", "L"), ("right", "R"))
OPTION_NAMES = {
    "SpeedThresholdCmPerSec": "speed",
    "HeightThresholdCm": "height",
    "MinPlantFrames": "min_frames",
    "BlendFrames": "blend",
    "MaxStretch": "stretch",
}


@lru_cache
def load(path):
    return json.loads(path.read_text(encoding="utf-8"))


def files():
    return sorted(FOLDER.glob("*.json"))


def clips():
    return [p for p in files() if isinstance(load(p), dict) and "input_frames" in load(p)]


def tables():
    return [p for p in files() if isinstance(load(p), list)]


def wxyz(xyzw):
    return np.roll(np.asarray(xyzw, dtype=np.float64), 1, axis=-1)


def options_of(record):
    return FootPlantOptions(**{OPTION_NAMES[k]: v for k, v in record["options"].items()})


def transforms(frames):
    """Local translations (T, J, 3) and rotations (T, J, 4) of recorded frames."""
    moves = np.array([[bone[0] for bone in frame] for frame in frames], dtype=np.float64)
    turns = wxyz([[bone[1] for bone in frame] for frame in frames])
    return moves, qa.unit(turns)


def legs_of(record):
    # A straight leg's axis shows in no recorded clip; x is the side, and knees bend about it.
    axis = np.array([-1.0, 0.0, 0.0])
    joints = [{k: record[s][k] for k in ("hip", "knee", "ankle")} for s, _ in SIDES]
    return [LegJoints(**each, bend_axis=axis) for each in joints]


@lru_cache
def passed(path):
    record = load(path)
    moves, turns = transforms(record["input_frames"])
    parents = [bone["parent"] for bone in record["bones"]]
    up = np.array(record["up"], dtype=np.float64)
    return clean_frames(
        moves, turns, parents, legs_of(record),
        fps=record["fps"], up=up, options=options_of(record),
    )  # fmt: skip


each_clip = pytest.mark.parametrize("path", clips(), ids=lambda p: p.stem)


def test_the_folder_holds_recordings_of_both_kinds():
    assert clips()
    assert tables()


@each_clip
def test_intervals_are_found_in_the_recorded_ankles(path):
    record = load(path)
    up = np.array(record["up"], dtype=np.float64)
    ankles = np.array([record[f"input_ankle_{end}"] for _, end in SIDES]).swapaxes(0, 1)
    ground = ground_height(ankles, up)
    assert ground == pytest.approx(record["report"]["GroundHeight"], abs=1e-4)
    for i, (side, _) in enumerate(SIDES):
        found = detect(ankles[:, i], ground, record["fps"], up, options_of(record))
        assert [list(interval) for interval in found] == record[f"detect_{side}"]


@each_clip
def test_intervals_anchors_and_report(path):
    record, result = load(path), passed(path)
    assert result.ground == pytest.approx(record["report"]["GroundHeight"], abs=1e-4)
    for foot, (side, _) in zip(result.feet, SIDES, strict=True):
        told = record["report"][side]
        assert [list(p) for p in foot.plants] == record[f"detect_{side}"] == told["plants"]
        anchors = np.array(record[f"anchors_{side}"]).reshape(-1, 3)
        np.testing.assert_allclose(foot.anchors, anchors, atol=ANCHOR)
        print(side, np.degrees(foot.largest_turn), foot.largest_move, foot.residual_slide, told)
        assert np.degrees(foot.largest_turn) == pytest.approx(
            told["MaxCorrectionDeg"], rel=REPORT, abs=NOTHING_DEG
        )
        assert foot.largest_move == pytest.approx(
            told["MaxCorrectionCm"], rel=REPORT, abs=NOTHING_CM
        )
        assert foot.residual_slide == pytest.approx(told["ResidualSlideCm"], rel=REPORT, abs=SLIDE)


@each_clip
def test_corrected_ankles(path):
    record, result = load(path), passed(path)
    for i, (_, end) in enumerate(SIDES):
        apart = np.linalg.norm(result.ankles[:, i] - record[f"output_ankle_{end}"], axis=-1)
        print(end, "largest difference", apart.max(), "cm at frame", apart.argmax())
        assert apart.max() <= ANKLE


@each_clip
def test_corrected_frames(path):
    """The joints' own transforms, as far as ankles within their tolerance determine them."""
    record, result = load(path), passed(path)
    moves, turns = transforms(record["output_frames"])
    cosine = np.abs(np.sum(result.local_rotations * turns, axis=-1)).clip(0.0, 1.0)
    print("largest turn apart", np.degrees(2 * np.arccos(cosine)).max(), "deg")
    assert np.degrees(2 * np.arccos(cosine)).max() < 0.1
    np.testing.assert_allclose(result.local_positions, moves, atol=ANKLE)


@pytest.mark.parametrize("path", tables(), ids=lambda p: p.stem)
def test_two_bone_solves(path):
    worst = {"upper": (0.0, -1), "lower": (0.0, -1), "end": (0.0, -1)}
    for i, record in enumerate(load(path)):
        a, b, c, target = (np.array(record[k], dtype=np.float64) for k in ("a", "b", "c", "target"))
        axis = np.zeros(3) if record["axis"] is None else np.array(record["axis"], dtype=np.float64)
        upper, lower = leg_turns(
            tuple(a), tuple(b), tuple(c), tuple(target), tuple(axis), float(record["soften"])
        )
        theirs = {k: wxyz(record[k]) for k in ("upper", "lower")}
        differences = {
            "upper": min(np.abs(theirs["upper"] - s * np.array(upper)).max() for s in (1, -1)),
            "lower": min(np.abs(theirs["lower"] - s * np.array(lower)).max() for s in (1, -1)),
            "end": np.linalg.norm(
                end(a, b, c, upper, lower) - end(a, b, c, theirs["upper"], theirs["lower"])
            ),
        }
        for what, size in differences.items():
            worst[what] = max(worst[what], (float(size), i))
    print({what: f"{size:.2g} at {i}" for what, (size, i) in worst.items()})
    assert worst["upper"][0] <= QUATERNION, worst
    assert worst["lower"][0] <= QUATERNION, worst
    assert worst["end"][0] <= END, worst


def end(a, b, c, upper, lower):
    return a + qa.rotate(upper, b - a) + qa.rotate(lower, c - b)
