"""A changed clip as the model's joints can pose it, so that what is measured is what is written."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.formats.qpos import SOURCE, Posed, QposSource
from footik_runtime.formats.qpos_tree import locals_of
from footik_runtime.formats.qpos_write import qpos_of

_TURNED = np.radians(1.0)  # what a foot is turned off by is worth a word from here on
_FREE_FOOT = 6  # hinges a leg needs to turn its foot as it likes


def posed(clip: Clip) -> Clip:
    """The clip with every joint where the model's joints, within their limits, can bring it.

    Raises FootIKError for a clip that was not read from joint values, or one of other frames.
    """
    source = clip.extras.get(SOURCE)
    if not isinstance(source, QposSource) or source.clip is None:
        raise FootIKError(f"{clip.name}: was not read from the joint values of a model.")
    qpos, report = qpos_of(clip, source.clip, source.tree, source.qpos)
    roots, rotations, moves = locals_of(source.tree, qpos)
    made = replace(clip, root_positions=roots, rotations=rotations, translations=moves)
    kept = Posed(
        root_positions=made.root_positions, rotations=made.rotations, qpos=qpos, report=report
    )
    return made.with_extras(**{SOURCE: replace(source, posed=kept)})


def unreached(clip: Clip) -> list[str]:
    """A sentence for each foot of a clip of `posed` that its joints did not bring to its goal."""
    source = clip.extras.get(SOURCE)
    if not isinstance(source, QposSource) or source.posed is None:
        return []
    return [
        words for name, leg in source.posed.report["legs"].items() if (words := _told(name, leg))
    ]


def _told(name: str, leg: dict[str, Any]) -> str:
    frames, words = leg["unreached_frames"], []
    if frames:
        words.append(f"up to {1e3 * leg['largest_off']:.1f} mm off in {frames} frames")
    if leg["hinges"] >= _FREE_FOOT and leg["largest_turned_off"] > _TURNED:
        words.append(f"turned off by up to {np.degrees(leg['largest_turned_off']):.1f} degrees")
    if not words:
        return ""
    return f"the {name} foot is {' and '.join(words)}: its joints' limits reach no further"
