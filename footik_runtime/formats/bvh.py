"""BVH: read a file into a Clip, and write a Clip back with the digits it came with.

A y-up file is turned into our frame (z up, x forward) by the cyclic permutation
(x, y, z) -> (z, x, y): right-handed, and exact, since nothing is multiplied. Lengths become metres
by one scale. BVH has neither curves nor rest rotations; those of a clip are not written.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.formats.bvh_guess import guess
from footik_runtime.formats.bvh_layout import BvhLayout, pose_arrays
from footik_runtime.formats.bvh_text import BvhText, parse_bvh
from footik_runtime.formats.bvh_write import write_bvh

__all__ = ["BvhLayout", "read_bvh", "write_bvh"]

FEW_CELLS = 400_000  # a joint in a frame each: so many are read from the smallest file


def read_bvh(
    path: str | os.PathLike[str],
    *,
    up: Literal["y", "z"] | None = None,
    scale: float | None = None,
) -> Clip:
    """Read a BVH file.

    Args:
        path: the file.
        up: its up axis, "y" or "z"; found from the rest pose where None, y where that is unclear.
        scale: metres a unit; where None, the usual unit that makes the skeleton most human-sized.

    Returns:
        The clip, in metres, z up. `extras["bvh"]` is its BvhLayout; `extras["notes"]` lists, a
        sentence each, what was guessed and what was odd. Position channels of joints other than
        the root become `translations`, and replace the offset.

    Raises:
        FootIKError: the file is missing, or is not one whole BVH skeleton with finite motion.
    """
    if up not in (None, "y", "z"):
        raise unknown_name("up axis", str(up), ("y", "z"))
    if scale is not None and not (np.isfinite(scale) and scale > 0.0):
        raise FootIKError(f"scale must be positive and finite, in metres a unit, not {scale}.")
    path = Path(path)
    text = parse_bvh(path)
    try:
        return _clip(text, path.stem, up, scale)
    except FootIKError as error:
        raise FootIKError(f"{path.name}: {error}") from None


def _require_in_proportion(text: BvhText) -> None:
    """Turn away files whose joints without channels would fill a memory that no motion fills."""
    cells, most = len(text.values) * len(text.names), max(FEW_CELLS, len(text.motion) // 3)
    if cells > most:
        raise FootIKError(
            f"{len(text.values)} frames of {len(text.names)} joints, most of them without "
            f"channels; a file of this size may hold {most // len(text.names)} frames of so many."
        )


def _clip(text: BvhText, name: str, up: str | None, scale: float | None) -> Clip:
    _require_in_proportion(text)
    layout = _layout(text)
    notes = list(text.notes)
    if up is None or scale is None:
        some = text.values[:: max(1, len(text.values) // 16)]
        turns = pose_arrays(layout, some)[1]
        seen_up, seen_scale, words = guess(layout.skeleton(), turns, up)
        notes += [word for word, given in zip(words, (up, scale), strict=True) if given is None]
        up, scale = up or seen_up, seen_scale if scale is None else scale
    layout = replace(layout, up=up, scale=float(scale))
    places, turns, moves = pose_arrays(layout, text.values)
    return Clip(
        skeleton=layout.skeleton(),
        fps=layout.fps,
        root_positions=places,
        rotations=turns,
        translations=moves,
        name=name,
        extras={"bvh": layout, "notes": notes},
    )


def _layout(text: BvhText) -> BvhLayout:
    """The layout of a parsed file, as it stands: in its own axes and units."""
    return BvhLayout(
        names=text.names,
        parents=text.parents,
        channels=text.channels,
        offsets=text.offsets,
        tips=text.tips,
        up="z",
        scale=1.0,
        frame_time=text.frame_time,
        frames=len(text.values),
        motion=text.motion,
    )
