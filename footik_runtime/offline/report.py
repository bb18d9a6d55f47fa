"""Report: one self-contained page of a cleaned clip, to look at and to scrub through."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.metrics import MEASURES, as_json
from footik_runtime.offline.measure_clip import AFTER, BEFORE, as_seen, run_of
from footik_runtime.offline.stages import Cleaned
from footik_runtime.sole import BALL, HEEL

Array = NDArray[np.float64]

MOST_FRAMES = 3000
"""Frames that a page shows; of longer clips it shows every second, third, ..."""

_INDEXED = ("pinned_point_speed", "penetration_p99", "float", "skating_ratio", "pop")
_MM = 1000.0
_MOST = 32767  # of an int16


def report_page(before: Clip, cleaned: Cleaned, measures: Mapping[str, Mapping[str, float]]) -> str:
    """The page as HTML, with all its data inside and nothing fetched.

    Args:
        before: the clip as it was given.
        cleaned: what cleanup made of it.
        measures: of `measure_clip.compare`.
    """
    data = json.dumps(_data(before, cleaned, measures), allow_nan=False)
    template = files("footik_runtime.offline").joinpath("report.html").read_text("utf-8")
    page = template.replace("__TITLE__", html.escape(cleaned.clip.name))
    # "</script>" within a name would end the script.
    return page.replace("__DATA__", data.replace("</", "<\\/"))


def index_page(entries: Sequence[Mapping[str, Any]]) -> str:
    """The HTML page of many clips: a row each, to sort, with a link to the clip's own page.

    Args:
        entries: of files, as `footik clean --json` has them: "in", "error" and, where all went
            well, "clips" with "clip", "frames", "measures", "report" and "page".
    """
    rows = [row for entry in entries for row in _index_rows(entry)]
    template = files("footik_runtime.offline").joinpath("report_index.html").read_text("utf-8")
    data = json.dumps(rows, allow_nan=False, separators=(",", ":"))
    return template.replace("__DATA__", data.replace("</", "<\\/"))


def _index_rows(entry: Mapping[str, Any]) -> list[dict[str, Any]]:
    if entry["error"] is not None:
        return [{"file": entry["in"], "error": entry["error"]}]
    return [
        {
            "file": entry["in"],
            "clip": clip["clip"],
            "page": clip["page"],
            "frames": clip["frames"],
            "plants": len(clip["report"].get("plants", ())),
            "notes": clip["report"].get("notes", []),
            **{key: [clip["measures"][name][key] for name in (BEFORE, AFTER)] for key in _INDEXED},
        }
        for clip in entry["clips"]
    ]


def _data(
    before: Clip, cleaned: Cleaned, measures: Mapping[str, Mapping[str, float]]
) -> dict[str, Any]:
    step = -(-len(before) // MOST_FRAMES)
    joints, heights, speeds = {}, {}, {}
    for name, worked in as_seen(before, cleaned).items():
        run = run_of(worked, cleaned)
        points = run.sole[:, :, [HEEL, BALL]]
        height = points[..., 2] - run.ground[:, :, [HEEL, BALL]]
        speed = np.zeros(height.shape)
        if len(worked) > 1:
            moved = np.gradient(points[..., :2], axis=0)
            speed = np.linalg.norm(moved, axis=-1) * worked.fps
        positions = worked.model_pose()[0]
        joints[name] = _packed(positions[::step])
        heights[name], speeds[name] = _packed(height[::step]), _packed(speed[::step])
    skeleton = cleaned.clip.skeleton
    return {
        "name": cleaned.clip.name,
        "fps": before.fps / step,
        "frames": len(range(0, len(before), step)),
        "shown": f"every {step} frames" if step > 1 else "",
        "legs": [leg.name for leg in cleaned.rig.legs],
        "chains": [
            [j for j in (leg.hip, leg.knee, leg.ankle, leg.toe) if j >= 0]
            for leg in cleaned.rig.legs
        ],
        "parents": skeleton.parents.tolist(),
        "joints": joints,
        "heights": heights,
        "speeds": speeds,
        "phases": ["".join(map(str, row)) for row in cleaned.phases[::step].T.astype(int)],
        "confidence": _bytes(cleaned.contacts.confidence[::step].max(axis=-1)),
        "plants": [
            {"foot": plant.foot, "at": _places(plant), "frames": [plant.start, plant.stop]}
            for plant in cleaned.plants
        ],
        "step": step,
        "measures": _rows(measures),
        "notes": [str(note) for note in cleaned.report.get("notes", ())],
    }


def _places(plant) -> list[list[float]]:
    return [[round(float(v), 4) for v in point] for point in (plant.heel, plant.ball)]


def _rows(measures: Mapping[str, Mapping[str, float]]) -> list[dict[str, Any]]:
    """Label, unit, before, after, and whether less is better, of every measure that was taken."""
    before, after = (as_json(measures[name]) for name in (BEFORE, AFTER))
    return [
        {
            "label": measure.label,
            "unit": measure.unit,
            "tip": measure.explanation,
            "before": before.get(measure.key),
            "after": after.get(measure.key),
            "less": measure.smaller_is_better,
        }
        for measure in MEASURES
        if after.get(measure.key) is not None
    ]


def _packed(values: Array) -> str:
    """Metres as int16 millimetres, little-endian, base64."""
    rounded = np.clip(np.nan_to_num(values) * _MM, -_MOST, _MOST).round()
    return base64.b64encode(rounded.astype("<i2").tobytes()).decode()


def _bytes(values: Array) -> str:
    """Parts of 1 as bytes, base64."""
    scaled = np.clip(np.nan_to_num(values) * 255.0, 0.0, 255.0).round().astype(np.uint8)
    return base64.b64encode(scaled.tobytes()).decode()
