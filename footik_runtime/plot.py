"""Plots of a recorded walk. The only module that knows matplotlib, which is an extra."""

from __future__ import annotations

import importlib.util
import io
from collections.abc import Sequence
from pathlib import Path

from footik_runtime.errors import FootIKError
from footik_runtime.files import write_whole
from footik_runtime.motion import Motion
from footik_runtime.phases import Phase
from footik_runtime.score_suite import COLUMNS, MODES, OURS, SceneScore
from footik_runtime.sole import POINTS
from footik_runtime.walk import Recording

_MODE_COLOURS = ("#c9d1d6", "#e0a458", "#1f6f8b")
_COLOURS = ("#2a6f97", "#e07a5f", "#6a994e")


def require_plot(path: Path) -> None:
    """Find out before long work whether a plot can be drawn to this file.

    Raises FootIKError where matplotlib is not installed, saying how to get it, or where it does
    not know the file's suffix.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise FootIKError('a plot needs matplotlib: pip install "footik-runtime[plot]".')
    from matplotlib.backend_bases import FigureCanvasBase

    kind = _kind(path)
    if kind not in FigureCanvasBase.get_supported_filetypes():
        raise FootIKError(f"{path}: a plot cannot be written as {kind!r}; png, svg and pdf can.")


def _kind(path: Path) -> str:
    return path.suffix.lstrip(".").lower() or "png"


def plot_walk(path: Path, motion: Motion, without: Recording, recording: Recording) -> None:
    """Draw a walk to an image file: sole heights over ground, weights and locks, and the hips."""
    from matplotlib.figure import Figure

    legs = motion.rig.legs
    figure = Figure(figsize=(14, 3 + 2.6 * (len(legs) + 1)), layout="constrained")
    axes = figure.subplots(2 * len(legs) + 1, 1, sharex=True)
    times = recording.times
    for i, leg in enumerate(legs):
        heights, weights = axes[2 * i], axes[2 * i + 1]
        over = 1000.0 * (recording.run.sole[:, i, :, 2] - recording.run.ground[:, i])
        was = 1000.0 * (without.run.sole[:, i, :, 2] - without.run.ground[:, i])
        for k, name in enumerate(POINTS):
            heights.plot(times, was[:, k], color=_COLOURS[k], alpha=0.25, linewidth=1)
            heights.plot(times, over[:, k], color=_COLOURS[k], label=name, linewidth=1.4)
        heights.axhline(0.0, color="black", linewidth=0.6)
        heights.set(ylim=(-80, 200), ylabel=f"{leg.name} sole over\nground, mm")
        heights.legend(loc="upper right", ncols=3, fontsize=8)
        contact = recording.phases[:, i] != Phase.SWING
        weights.fill_between(times, 0, contact, step="mid", color="0.88", label="clip's contact")
        weights.plot(times, recording.feet["weight"][:, i], color=_COLOURS[0], label="weight")
        locked = recording.feet["locked"][:, i]
        weights.step(times, 0.9 * locked, where="mid", color=_COLOURS[1], label="locked")
        weights.set(ylim=(-0.05, 1.1), ylabel=leg.name)
        weights.legend(loc="upper right", ncols=3, fontsize=8)
    hips = axes[-1]
    hips.plot(times, without.run.hips[:, 2], color="0.6", label="hips without IK")
    hips.plot(times, recording.run.hips[:, 2], color=_COLOURS[0], label="hips with IK")
    hips.plot(times, recording.bodies["root"][:, 2], color=_COLOURS[2], label="root")
    hips.set(ylabel="height, m", xlabel="time, s")
    hips.legend(loc="upper right", ncols=3, fontsize=8)
    figure.suptitle(f"{motion.clip.name}: faint lines without foot IK, strong lines with it")
    buffer = io.BytesIO()
    figure.savefig(buffer, format=_kind(path), dpi=110)
    write_whole(path, buffer.getvalue())


def plot_suite(path: Path, scores: Sequence[SceneScore]) -> None:
    """Draw the figures of a score suite: a row a measure, a group of bars a scene, its limit."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4 + 0.45 * len(scores), 2.0 * len(COLUMNS)), layout="constrained")
    axes = figure.subplots(len(COLUMNS), 1, sharex=True)
    for axis, (key, label) in zip(axes, COLUMNS.items(), strict=True):
        for i, (mode, colour) in enumerate(zip(MODES, _MODE_COLOURS, strict=True)):
            places = [k + 0.27 * (i - 1) for k in range(len(scores))]
            values = [one.figures[mode][key] for one in scores]
            axis.bar(places, values, 0.27, color=colour, label=mode)
        limits = [getattr(one.limits, key) for one in scores]
        for k, limit in enumerate(limits):
            if limit < float("inf"):
                axis.plot([k - 0.45, k + 0.45], [limit, limit], color="#a8321c", linewidth=1.2)
        finite = [limit for limit in limits if limit < float("inf")]
        ours = max(one.figures[OURS][key] for one in scores)
        axis.set_ylim(0.0, 1.15 * max([ours, *finite, 1e-9]))
        axis.set_ylabel(label)
    axes[0].legend(loc="upper right", ncols=len(MODES))
    axes[-1].set_xticks(range(len(scores)), [one.name for one in scores], rotation=60, ha="right")
    figure.suptitle("without foot IK, OpenKCC's settings, ours; red: the limit")
    out = io.BytesIO()
    figure.savefig(out, format=_kind(path), dpi=110)
    write_whole(path, out.getvalue())
