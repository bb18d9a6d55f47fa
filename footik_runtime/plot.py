"""Plots of a recorded walk. The only module that knows matplotlib, which is an extra."""

from __future__ import annotations

import importlib.util
import io
from pathlib import Path

from footik_runtime.errors import FootIKError
from footik_runtime.files import write_whole
from footik_runtime.motion import Motion
from footik_runtime.phases import Phase
from footik_runtime.sole import POINTS
from footik_runtime.walk import Recording

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
