"""Every figure of a recorded run that this project reports, scored and printed.

`score` brings a run to 120 Hz and takes every measure of MEASURES; `format_table` sets runs side
by side. The measures themselves are in `measures`, those of predictions in `contact_scores`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from footik_runtime.contact_scores import (
    ContactTiming,
    ForceScores,
    contact_f1,
    contact_timing,
    force_scores,
)
from footik_runtime.measures import (
    LEAST_STEP,
    PlantSlip,
    float_in_contact,
    foot_joint_speed,
    foot_step,
    hip_acceleration_ratio,
    hip_step,
    jitter,
    largest_stretch,
    mean_angle_change,
    mean_joint_error,
    penetration,
    penetration_p99,
    pinned_point_speed,
    plant_slips,
    pop,
    pop_by_joint,
    ratio,
    require_same,
    root_speed_change,
    skate,
    skating_ratio,
    sliding,
    slip_per_plant,
)
from footik_runtime.recorded import Run
from footik_runtime.resample import GroundHeight, resample

__all__ = [
    "MEASURES",
    "SCORING_FPS",
    "ContactTiming",
    "ForceScores",
    "Measure",
    "PlantSlip",
    "Run",
    "as_json",
    "contact_f1",
    "contact_timing",
    "float_in_contact",
    "foot_joint_speed",
    "foot_step",
    "force_scores",
    "format_table",
    "hip_acceleration_ratio",
    "hip_step",
    "jitter",
    "largest_stretch",
    "mean_angle_change",
    "mean_joint_error",
    "penetration",
    "penetration_p99",
    "pinned_point_speed",
    "plant_slips",
    "pop",
    "pop_by_joint",
    "resample",
    "root_speed_change",
    "score",
    "skate",
    "skating_ratio",
    "sliding",
    "slip_per_plant",
]

SCORING_FPS = 120.0


@dataclass(frozen=True, kw_only=True)
class Measure:
    """One row of the table.

    Attributes:
        key: its name in `score`'s result.
        label: what people read.
        unit: of the figure, "" for a ratio.
        explanation: what is measured, in a line.
        smaller_is_better: whether less of it is better.
        measure: (run, reference) -> figure.
        compares: whether it needs the reference.
    """

    key: str
    label: str
    unit: str
    explanation: str
    measure: Callable[[Run, Run], float]
    smaller_is_better: bool = True
    compares: bool = False


def _alone(key: str, label: str, unit: str, explanation: str, of: Callable[[Run], float]):
    return Measure(
        key=key, label=label, unit=unit, explanation=explanation, measure=lambda run, _: of(run)
    )


def _against(key: str, label: str, unit: str, explanation: str, of: Callable[[Run, Run], float]):
    return Measure(
        key=key, label=label, unit=unit, explanation=explanation, measure=of, compares=True
    )


MEASURES: tuple[Measure, ...] = (
    _alone(
        "pinned_point_speed",
        "pinned point speed",
        "mm/s",
        "mean horizontal speed of the sole point that carries the contact",
        pinned_point_speed,
    ),
    _alone(
        "slip_mean",
        "slip per plant, mean",
        "mm",
        "how far the held point travels between lock and release",
        lambda run: slip_per_plant(run).mean,
    ),
    _alone(
        "slip_max",
        "slip per plant, largest",
        "mm",
        "the same, of the worst plant",
        lambda run: slip_per_plant(run).largest,
    ),
    _alone(
        "foot_joint_speed",
        "foot joint speed in contact",
        "mm/s",
        "mean horizontal speed of ankle and toe joints; heel-off moves the ankle",
        foot_joint_speed,
    ),
    _alone(
        "skating_ratio",
        "skating ratio",
        "",
        "share of frames at 20 fps with a low and fast foot",
        skating_ratio,
    ),
    _alone(
        "sliding_25",
        "sliding under 2.5 cm",
        "cm",
        "horizontal way near the ground, weighted by height, whole run",
        lambda run: sliding(run, 0.025),
    ),
    _alone(
        "sliding_50",
        "sliding under 5 cm",
        "cm",
        "the same under 5 cm",
        lambda run: sliding(run, 0.05),
    ),
    _alone(
        "penetration",
        "penetration, mean",
        "mm",
        "depth of the lowest sole point past 5 mm, mean over frames",
        penetration,
    ),
    _alone(
        "penetration_p99",
        "penetration, p99",
        "mm",
        "99th percentile over feet and frames, past 5 mm",
        penetration_p99,
    ),
    _alone(
        "penetration_contact_p99",
        "penetration in contact, p99",
        "mm",
        "the same of feet in contact",
        lambda run: penetration_p99(run, "contact"),
    ),
    _alone(
        "penetration_swing_p99",
        "penetration in swing, p99",
        "mm",
        "the same of swinging feet",
        lambda run: penetration_p99(run, "swing"),
    ),
    _alone(
        "float",
        "float in contact, mean",
        "mm",
        "height of the lowest sole point past 5 mm, feet in contact",
        float_in_contact,
    ),
    _alone(
        "skate",
        "skate",
        "mm",
        "horizontal step a frame of points on or under the ground",
        skate,
    ),
    _against(
        "pop",
        "pop",
        "",
        "largest angular acceleration of a leg joint over the input's p99",
        pop,
    ),
    _alone(
        "foot_step",
        "largest foot step a frame",
        "mm",
        "largest way of an ankle in one frame",
        foot_step,
    ),
    _against(
        "foot_step_ratio",
        "largest foot step over the input's",
        "",
        "the same over the input's",
        lambda run, given: ratio(foot_step(run), foot_step(given), 1000.0 * LEAST_STEP),
    ),
    _alone(
        "hip_step",
        "largest hip step a frame",
        "mm",
        "largest way of the hips in one frame",
        hip_step,
    ),
    _against(
        "hip_step_ratio",
        "largest hip step over the input's",
        "",
        "the same over the input's",
        lambda run, given: ratio(hip_step(run), hip_step(given), 1000.0 * LEAST_STEP),
    ),
    _against(
        "hip_acceleration_ratio",
        "hip acceleration over the input's",
        "",
        "largest vertical acceleration of the hips over the input's",
        hip_acceleration_ratio,
    ),
    _alone("jitter", "jitter", "m/s^3", "mean third difference of the joints", jitter),
    _against(
        "angle_change",
        "leg joint angle change, mean",
        "deg",
        "mean angle between leg joints and the input's",
        mean_angle_change,
    ),
    _against(
        "mpjpe",
        "joint position change, mean",
        "mm",
        "mean distance of joints from the input's",
        mean_joint_error,
    ),
    _against(
        "root_speed_change",
        "root speed change, mean",
        "mm/s",
        "mean change of the hips' horizontal speed",
        root_speed_change,
    ),
    _alone(
        "stretch",
        "largest segment stretch",
        "%",
        "largest segment length over its rest length, less one",
        largest_stretch,
    ),
)


def score(
    run: Run, reference: Run | None = None, *, ground_height: GroundHeight | None = None
) -> dict[str, float]:
    """Every measure in MEASURES of a run, by key; NaN where one does not apply.

    Args:
        run: at any rate; resampled to 120 Hz first.
        reference: the untouched input over the same frames. Score it against itself for the
            column beside. Without it, the measures that compare are NaN.
        ground_height: passed to `resample`.

    Raises:
        FootIKError: run and reference differ in legs, joints, sole points or length.
    """
    run = resample(run, SCORING_FPS, ground_height=ground_height)
    if reference is not None:
        reference = resample(reference, SCORING_FPS, ground_height=ground_height)
        for name in ("times", "leg_rotations", "sole"):
            require_same(run, reference, name)
    return {
        row.key: math.nan
        if row.compares and reference is None
        else float(row.measure(run, run if reference is None else reference))
        for row in MEASURES
    }


def as_json(scores: Mapping[str, float]) -> dict[str, float | None]:
    """The same figures as JSON can hold them: None for what is not finite."""
    return {key: float(value) if math.isfinite(value) else None for key, value in scores.items()}


def format_table(columns: Mapping[str, Mapping[str, float | None]]) -> str:
    """A plain aligned table: a row for each measure, a column for each result of `score`.

    Rows come in the order of MEASURES, figures of other names after them; what a column has not,
    or has as NaN or None, is "-".
    """
    known = {row.key: (row.label, row.unit) for row in MEASURES}
    given = dict.fromkeys(key for column in columns.values() for key in column)
    keys = [key for key in known if key in given] + [key for key in given if key not in known]
    rows = [("measure", "unit", *columns)]
    for key in keys:
        figures = (_figure(column.get(key)) for column in columns.values())
        rows.append((*known.get(key, (key, "")), *figures))
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if i < 2 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    )


def _figure(value: float | None) -> str:
    if value is None or math.isnan(value):
        return "-"
    size = abs(value)
    digits = 0 if size >= 100 or size == 0 else 1 if size >= 10 else 2 if size >= 1 else 3
    return f"{value:.{digits}f}"
