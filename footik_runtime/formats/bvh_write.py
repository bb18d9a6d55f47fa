"""Writing BVH: the source's own digits wherever a value is still the one that was read."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.files import write_whole
from footik_runtime.formats.bvh_guess import CMU_UNIT, UNITS, guess
from footik_runtime.formats.bvh_layout import (
    AXES,
    BvhLayout,
    by_order,
    joint_channels,
    pose_arrays,
)
from footik_runtime.formats.euler import is_complete, quaternions_to_euler
from footik_runtime.skeleton import Skeleton

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_PLACE = ("Xposition", "Yposition", "Zposition")
_TURN = ("Zrotation", "Xrotation", "Yrotation")
_DEEPEST_INDENT = 64  # deeper levels are not indented further, or the file would be all tabs


def write_bvh(clip: Clip, path: str | os.PathLike[str]) -> None:
    """Write a clip; one that came from BVH keeps its layout and, where unchanged, its very digits.

    Other clips are written y up, in centimetres, or in whichever axes and unit `read_bvh` finds
    again. A joint whose channels cannot say what the clip holds gets those it lacks. Curves and
    rest rotations have no place in BVH. The file appears whole or not at all.

    Raises:
        FootIKError: the file cannot be written there, or a joint's name cannot stand in BVH.
    """
    layout = clip.extras.get("bvh")
    if not (isinstance(layout, BvhLayout) and _same_joints(layout, clip.skeleton)):
        clip = _depth_first(clip)
        layout = _default_layout(clip)
    source = _Source.of(clip, layout)
    channels = _fitting_channels(clip, layout, source)
    text = [*_hierarchy(clip, layout, channels), *_motion(clip, layout, channels, source), ""]
    write_whole(Path(path), "\n".join(text).encode())


def _same_joints(layout: BvhLayout, skeleton: Skeleton) -> bool:
    return layout.names == skeleton.names and layout.parents == tuple(skeleton.parents.tolist())


def _track(clip: Clip, joint: int) -> Array:
    """(T, 3) or (1, 3): the local place of a joint in every frame, m."""
    if joint == 0:
        return clip.root_positions
    return (
        clip.skeleton.offsets[None, joint]
        if clip.translations is None
        else (clip.translations[:, joint])
    )


# --- what of the source is still so -------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class _Source:
    """The frames that were read, laid beside the clip's: row t of each belongs to the clip's.

    Attributes:
        values: (N, C) with N at most the clip's length; later frames of the clip are new.
        start: the source frame that is the clip's first.
        turns: (T, J) true where a rotation is the source's.
        places: (T, J, 3) true where a coordinate, in our frame, is the source's.
    """

    values: Array
    start: int
    turns: Mask
    places: Mask

    @classmethod
    def of(cls, clip: Clip, layout: BvhLayout) -> _Source:
        values = layout.values()
        places, turns, moves = pose_arrays(layout, values)
        start = _first_frame(clip, places, turns)
        count = min(len(clip), len(values) - start)
        rows = slice(start, start + count)
        same_turn = np.zeros((len(clip), len(clip.skeleton)), dtype=bool)
        same_turn[:count] = _same_rotation(clip.rotations[:count], turns[rows])
        same_place = np.zeros((len(clip), len(clip.skeleton), 3), dtype=bool)
        same_place[:count, 0] = clip.root_positions[:count] == places[rows]
        if moves is not None:
            for j in range(1, len(clip.skeleton)):
                same_place[:count, j] = _track(clip, j)[:count] == moves[rows, j]
        return cls(values=values[rows], start=start, turns=same_turn, places=same_place)


def _same_rotation(a: Array, b: Array) -> Mask:
    """Equal to the last bit, or its negative, which is the same rotation."""
    return (a == b).all(axis=-1) | (a == -b).all(axis=-1)


def _first_frame(clip: Clip, places: Array, turns: Array) -> int:
    """The source frame a clip begins with, where it was cut from its source; else 0."""
    if len(clip) == len(places):
        return 0
    here = (places == clip.root_positions[0]).all(axis=1)
    here &= _same_rotation(turns, clip.rotations[:1]).all(axis=1)
    return int(np.argmax(here)) if len(here) else 0


def _fitting_channels(
    clip: Clip, layout: BvhLayout, source: _Source
) -> tuple[tuple[str, ...], ...]:
    """The layout's channels, more where these cannot say what the clip holds."""
    fitting = []
    for j, joint in enumerate(joint_channels(layout.channels, layout.up)):
        names = layout.channels[j]
        still = [axis for axis in range(3) if axis not in joint.place_axes]
        if (_track(clip, j)[:, still] != clip.skeleton.offsets[j, still]).any():
            names = tuple(p for p in _PLACE if p not in names) + names
        if not (is_complete(joint.turn_axes) or source.turns[:, j].all()):
            names = tuple(n for n in names if n.endswith("position")) + _TURN
        fitting.append(names)
    return tuple(fitting)


# --- the motion ---------------------------------------------------------------------------------


def _motion(
    clip: Clip, layout: BvhLayout, channels: tuple[tuple[str, ...], ...], source: _Source
) -> Iterator[str]:
    """The lines from MOTION on."""
    yield "MOTION"
    yield f"Frames: {len(clip)}"
    same_rate = layout.fps == clip.fps
    yield f"Frame Time: {layout.frame_time if same_rate else _digits(1.0 / clip.fps)}"
    old_columns, known = _kept_cells(layout, channels, source)
    values = _values(clip, layout, channels, source, old_columns, known)
    cells = np.empty(values.shape, dtype=object)
    count, first = len(source.values), source.start * layout.width
    words = layout.motion.decode("latin-1").split()[first : first + count * layout.width]
    kept = old_columns >= 0
    if words:
        cells[:count, kept] = np.array(words, dtype=object).reshape(count, -1)[:, old_columns[kept]]
    cells[~known] = [_digits(value) for value in values[~known].tolist()]
    yield from (" ".join(row) for row in cells.tolist())


def _kept_cells(
    layout: BvhLayout, channels: tuple[tuple[str, ...], ...], source: _Source
) -> tuple[NDArray[np.intp], Mask]:
    """(C,) each column's column in the source, -1 if new; (T, C) true where its digits hold."""
    old_columns, holds = [], []
    before = joint_channels(layout.channels, layout.up)
    after = joint_channels(channels, layout.up)
    for j, (old, new) in enumerate(zip(before, after, strict=True)):
        own = dict(zip(old.place_axes, old.place_columns, strict=True))
        entries = [
            (column, own.get(axis, -1), source.places[:, j, axis])
            for column, axis in zip(new.place_columns, new.place_axes, strict=True)
        ]
        same_order = new.turn_axes == old.turn_axes
        entries += [
            (column, old.turn_columns[n] if same_order else -1, source.turns[:, j])
            for n, column in enumerate(new.turn_columns)
        ]
        for _, old_column, same in sorted(entries, key=lambda entry: entry[0]):
            old_columns.append(old_column)
            holds.append(same if old_column >= 0 else np.zeros_like(same))
    return np.array(old_columns, dtype=np.intp), np.stack(holds, axis=1)


def _values(
    clip: Clip,
    layout: BvhLayout,
    channels: tuple[tuple[str, ...], ...],
    source: _Source,
    old_columns: NDArray[np.intp],
    known: Mask,
) -> Array:
    """(T, C) in file units: the source's where `known`, the clip's elsewhere."""
    values = np.zeros(known.shape)
    kept = old_columns >= 0
    values[: len(source.values), kept] = source.values[:, old_columns[kept]]
    joints = list(joint_channels(channels, layout.up))
    for j, joint in enumerate(joints):
        for column, axis in zip(joint.place_columns, joint.place_axes, strict=True):
            track = _track(clip, j)[:, axis] / layout.scale
            values[:, column] = np.where(known[:, column], values[:, column], track)
    whole = [j for j, joint in enumerate(joints) if is_complete(joint.turn_axes)]
    for order, members, columns in by_order(joints, whole):
        keep = known[:, columns[0]]
        if keep.all():
            continue
        before = np.radians(values[:, columns.T])
        angles = quaternions_to_euler(clip.rotations[:, members], order, keep, before)
        values[:, columns.T] = np.where(keep[..., None], values[:, columns.T], np.degrees(angles))
    return values


def _digits(value: float) -> str:
    """The shortest decimal that reads back as exactly this number; no exponents."""
    text = repr(value)
    return np.format_float_positional(value, trim="-") if "e" in text else text


# --- the hierarchy ------------------------------------------------------------------------------


def _hierarchy(
    clip: Clip, layout: BvhLayout, channels: tuple[tuple[str, ...], ...]
) -> Iterator[str]:
    """The lines before MOTION; joints stand depth first."""
    skeleton = clip.skeleton
    parents = skeleton.parents.tolist()
    has_child = set(parents)
    depths: list[int] = []
    yield "HIERARCHY"
    for j, name in enumerate(skeleton.names):
        depth = depths[parents[j]] + 1 if j else 0
        for level in range(depths[-1] if j else -1, depth - 1, -1):
            yield _indent(level) + "}"
        depths.append(depth)
        tab, inner = _indent(depth), _indent(depth + 1)
        yield f"{tab}{'JOINT' if j else 'ROOT'} {_writable(name)}"
        yield tab + "{"
        yield f"{inner}OFFSET {_offset(layout, skeleton.offsets[j], layout.offsets[j])}"
        yield " ".join([f"{inner}CHANNELS {len(channels[j])}", *channels[j]])
        tip = skeleton.tips.get(j)
        if tip is None and j not in has_child and not layout.motion:
            tip = np.zeros(3)  # many readers want an end site in every leaf
        if tip is not None:
            yield inner + "End Site"
            yield inner + "{"
            yield f"{_indent(depth + 2)}OFFSET {_offset(layout, tip, layout.tips.get(j, ''))}"
            yield inner + "}"
    for level in range(depths[-1], -1, -1):
        yield _indent(level) + "}"


def _indent(depth: int) -> str:
    return "\t" * min(depth, _DEEPEST_INDENT)


def _offset(layout: BvhLayout, offset: Array, text: str) -> str:
    """The text it was read from, where it still says the same."""
    if text and (layout.lengths(text) == offset).all():
        return text
    return " ".join(_digits(value) for value in (offset[AXES[layout.up]] / layout.scale).tolist())


def _writable(name: str) -> str:
    if not name or name != " ".join(name.split()) or set(name) & set("{}"):
        raise FootIKError(
            f"joint name {name!r} cannot be written to BVH, where names are one line without "
            "braces or spaces at their ends."
        )
    return name


# --- clips that came from elsewhere -------------------------------------------------------------


def _depth_first(clip: Clip) -> Clip:
    """The same clip with its joints in the order BVH must list them."""
    skeleton = clip.skeleton
    order, stack = [], [0]
    children: list[list[int]] = [[] for _ in skeleton.names]
    for j, parent in enumerate(skeleton.parents.tolist()):
        if j:
            children[parent].append(j)
    while stack:
        order.append(joint := stack.pop())
        stack.extend(reversed(children[joint]))
    if order == sorted(order):
        return clip
    place = {joint: n for n, joint in enumerate(order)}
    reordered = Skeleton(
        names=tuple(skeleton.names[j] for j in order),
        parents=np.array([place.get(int(skeleton.parents[j]), -1) for j in order], dtype=np.int32),
        offsets=skeleton.offsets[order],
        rest_rotations=skeleton.rest_rotations[order],
        tips={place[j]: tip for j, tip in skeleton.tips.items()},
    )
    moves = None if clip.translations is None else clip.translations[:, order]
    return replace(clip, skeleton=reordered, rotations=clip.rotations[:, order], translations=moves)


def _default_layout(clip: Clip) -> BvhLayout:
    """The layout of a clip that has none, with no frames: every value counts as changed."""
    up, scale = _found_again(clip)
    joints = len(clip.skeleton)
    return BvhLayout(
        names=clip.skeleton.names,
        parents=tuple(clip.skeleton.parents.tolist()),
        channels=(_PLACE + _TURN, *[_TURN] * (joints - 1)),
        offsets=("0 0 0",) * joints,
        tips={},
        up=up,
        scale=scale,
        frame_time=_digits(1.0 / clip.fps),
        frames=0,
        motion=b"",
    )


def _found_again(clip: Clip) -> tuple[str, float]:
    """The up axis and unit to write in: the first pair that a reader's guess gives back."""
    skeleton, some = clip.skeleton, clip.rotations[:: max(1, len(clip) // 16)]
    tried = [(up, unit) for up in ("y", "z") for unit in (0.01, *UNITS, CMU_UNIT)]

    def found(pair: tuple[str, float]) -> tuple[bool, bool]:
        axes = AXES[pair[0]]
        seen = Skeleton(
            names=skeleton.names,
            parents=skeleton.parents,
            offsets=skeleton.offsets[:, axes] / pair[1],
            tips={j: tip[axes] / pair[1] for j, tip in skeleton.tips.items()},
        )
        up, unit, _ = guess(seen, some[..., [0, *(1 + a for a in axes)]])
        return up == pair[0], unit == pair[1]

    return max(tried, key=found)
