"""Score suite: every scene walked without foot IK, as OpenKCC does it, and as we do; one table.

A scene that misses its limits stays in the table, marked. Nothing here is tuned per scene.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from footik_runtime.errors import unknown_name
from footik_runtime.ground import ABOVE, REACH
from footik_runtime.metrics import score
from footik_runtime.motion import Motion
from footik_runtime.recorded import Run
from footik_runtime.scene import Scene
from footik_runtime.score_scenes import Limits, ScoreScene, score_scenes
from footik_runtime.settings import FootIKSettings, body_size
from footik_runtime.walk import Recording, record_walk

WITHOUT, OPENKCC, OURS = "no IK", "openkcc", "ours"
MODES = (WITHOUT, OPENKCC, OURS)

COLUMNS: Mapping[str, str] = {
    "pinned_point_speed": "pinned mm/s",
    "slip_mean": "slip mm",
    "penetration": "pen mm",
    "penetration_contact_p99": "p99 contact",
    "penetration_swing_p99": "p99 swing",
    "float": "float mm",
    "pop": "pop",
    "hip_acceleration_ratio": "hip acc",
    "hip_drop": "hip drop cm",
}
"""Key of `Limits` and of a result -> what it is called in the table."""

_MARK = "!"
_NEAR_ZERO: Mapping[str, float] = {
    "pinned_point_speed": 1.0,
    "slip_mean": 0.02,
    "penetration": 0.1,
    "penetration_contact_p99": 1.0,
    "penetration_swing_p99": 1.0,
    "float": 0.3,
    "pop": 0.3,
    "hip_acceleration_ratio": 0.2,
    "hip_drop": 0.5,
}
"""What a figure may differ by between frame rates in any case: smaller figures are all but none."""


@dataclass(frozen=True, kw_only=True)
class SceneScore:
    """The figures of one scene.

    Attributes:
        name: of the scene, and of the clip where one took the place of the built-in walk.
        limits: of it.
        figures: mode -> key of COLUMNS -> figure, at the first rate.
        by_rate: frames a second -> key -> figure of ours.
    """

    name: str
    limits: Limits
    figures: dict[str, dict[str, float]]
    by_rate: dict[float, dict[str, float]] = field(default_factory=dict)

    def missed(self) -> list[str]:
        """The keys in which ours misses a limit."""
        ours = self.figures[OURS]
        return [
            f.name for f in fields(Limits) if ours[f.name] > getattr(self.limits, f.name) + 1e-9
        ]

    def worse_than_openkcc(self) -> list[str]:
        """The keys in which ours is worse than OpenKCC's."""
        ours, theirs = self.figures[OURS], self.figures[OPENKCC]
        return [key for key in COLUMNS if ours[key] > theirs[key] + 0.1 * _NEAR_ZERO[key]]

    def uneven(self, most: float = 0.1) -> list[str]:
        """The keys that differ by more than this share between frame rates."""
        out = []
        for key in COLUMNS if self.by_rate else ():
            values = [figures[key] for figures in self.by_rate.values()]
            spread = max(values) - min(values)
            if spread > max(most * float(np.mean(values)), _NEAR_ZERO[key]):
                out.append(key)
        return out


def chosen_scenes(names: Sequence[str]) -> tuple[ScoreScene, ...]:
    """The scenes of these names, or whose names begin so; all where none are given.

    Raises FootIKError, with the nearest, for a name that no scene has.
    """
    scenes = score_scenes()
    if not names:
        return scenes
    out: list[ScoreScene] = []
    for name in names:
        found = [scene for scene in scenes if scene.name.startswith(name)]
        if not found:
            raise unknown_name("scene", name, [scene.name for scene in scenes])
        out += [scene for scene in found if scene not in out]
    return tuple(out)


def score_scene(
    scene: ScoreScene,
    *,
    rates: Sequence[float] = (60.0,),
    settings: FootIKSettings | None = None,
    motion: Motion | None = None,
    clip: str = "",
    body: Path | None = None,
) -> SceneScore:
    """Walk one scene in every mode at the first rate, and with ours at the others.

    Args:
        scene: of `score_scenes`.
        rates: frames a second of the simulation.
        settings: of ours.
        motion: instead of the scene's own.
        clip: what to call it.
        body: the MJCF file of that motion's body, such as a robot's; capsules otherwise.
    """
    settings = FootIKSettings() if settings is None else settings
    body = scene.body if motion is None else body
    motion = scene.motion() if motion is None else motion
    first = rates[0]
    given, asked = _walked(scene, motion, body, first, settings, ik=False)
    figures = {WITHOUT: _figures(given, given.run, asked)}
    for mode, how in ((OPENKCC, FootIKSettings.openkcc()), (OURS, settings)):
        done, asked = _walked(scene, motion, body, first, how, ik=True)
        figures[mode] = _figures(done, given.run, asked)
    by_rate = {first: figures[OURS]}
    for rate in rates[1:]:
        done, asked = _walked(scene, motion, body, rate, settings, ik=True)
        reference, _ = _walked(scene, motion, body, rate, settings, ik=False)
        by_rate[rate] = _figures(done, reference.run, asked)
    name = f"{scene.name}: {clip}" if clip else scene.name
    return SceneScore(name=name, limits=scene.limits, figures=figures, by_rate=by_rate)


def _walked(
    scene: ScoreScene,
    motion: Motion,
    body: Path | None,
    rate: float,
    settings: FootIKSettings,
    *,
    ik: bool,
) -> tuple[Recording, Any]:
    """The scene recorded, and the height of its ground where that stands still."""
    built = Scene.build(motion, scene.terrain(), body=body)
    recording = record_walk(
        built, seconds=scene.seconds, fps=rate, settings=settings, ik=ik, drive=scene.drive
    )
    if not built.terrain.static:
        return recording, None
    ground, size = built.ground(settings.groups), body_size(motion.rig)

    def height(points: np.ndarray, _: np.ndarray) -> np.ndarray:
        return ground.height(points, above=ABOVE * size, reach=REACH * size)

    return recording, height


def _figures(recording: Recording, given: Run, ground_height: Any) -> dict[str, float]:
    figures = score(recording.run, given, ground_height=ground_height)
    figures["hip_drop"] = 100.0 * float(recording.bodies["hip_drop"].max())
    return {key: figures[key] if math.isfinite(figures[key]) else 0.0 for key in COLUMNS}


def suite_table(scores: Sequence[SceneScore]) -> str:
    """Three lines a scene: without IK, OpenKCC's, ours; what misses a limit is marked."""
    width = max(len(score.name) for score in scores)
    lines = [_line(" " * width, "", COLUMNS.values())]
    for one in scores:
        missed = one.missed()
        for mode in MODES:
            marks = missed if mode == OURS else []
            cells = [
                f"{_figure(value)}{_MARK if key in marks else ' '}"
                for key, value in one.figures[mode].items()
            ]
            lines.append(_line((one.name if mode == WITHOUT else "").ljust(width), mode, cells))
    return "\n".join(lines)


def _line(name: str, mode: str, cells: Iterable[str]) -> str:
    return "  ".join([name, mode.ljust(7), *(cell.rjust(12) for cell in cells)])


def _figure(value: float) -> str:
    if value >= 100.0:
        return f"{value:.0f}"
    return f"{value:.1f}" if value >= 10.0 else f"{value:.2f}"


def suite_summary(scores: Sequence[SceneScore]) -> str:
    """How many scenes keep every limit, beat OpenKCC in everything, and are alike at all rates."""
    kept = [one for one in scores if not one.missed()]
    better = [one for one in scores if not one.worse_than_openkcc()]
    lines = [
        f"{len(kept)} of {len(scores)} scenes within every limit ({_MARK}: missed); mean over all:",
        *_means(scores),
        f"in every measure no worse than OpenKCC: {len(better)} of {len(scores)} scenes",
    ]
    worse = [f"  {one.name}: {', '.join(w)}" for one in scores if (w := one.worse_than_openkcc())]
    lines += worse
    if any(len(one.by_rate) > 1 for one in scores):
        uneven = [f"  {one.name}: {', '.join(u)}" for one in scores if (u := one.uneven())]
        lines.append(f"alike within 10 % at all rates: {len(scores) - len(uneven)} scenes")
        lines += uneven
    return "\n".join(lines)


def _means(scores: Sequence[SceneScore]) -> list[str]:
    out = []
    for mode in MODES:
        means = {key: float(np.mean([one.figures[mode][key] for one in scores])) for key in COLUMNS}
        told = ", ".join(f"{COLUMNS[key]} {_figure(value)}" for key, value in means.items())
        out.append(f"  {mode}: {told}")
    return out


def suite_json(scores: Sequence[SceneScore]) -> list[dict[str, Any]]:
    """The scores as JSON holds them."""
    return [
        {
            "scene": one.name,
            "figures": one.figures,
            "by_rate": {f"{rate:g}": figures for rate, figures in one.by_rate.items()},
            "missed": one.missed(),
            "worse than openkcc": one.worse_than_openkcc(),
            "uneven over rates": one.uneven(),
        }
        for one in scores
    ]
