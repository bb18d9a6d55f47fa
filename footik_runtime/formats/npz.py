"""NPZ: a clip as plain NumPy arrays, exact in both directions.

Arrays: footik_clip (the version), fps, name, loop; joint_names, parents, offsets, rest_rotations,
tip_joints, tip_offsets; root_positions, rotations, and translations where there are any;
curve_names and curves (C, T); extras, JSON of the notes and the keys of the curves.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.files import write_whole
from footik_runtime.formats.qpos_tables import read_table
from footik_runtime.offline.curve_files import curves_from_json, curves_to_json
from footik_runtime.offline.curve_keys import CURVE_KEYS
from footik_runtime.skeleton import Skeleton

VERSION = 1

_SHAPES: dict[str, tuple[str, ...]] = {
    "joint_names": ("J",),
    "parents": ("J",),
    "offsets": ("J", "3"),
    "rest_rotations": ("J", "4"),
    "tip_joints": ("E",),
    "tip_offsets": ("E", "3"),
    "root_positions": ("T", "3"),
    "rotations": ("T", "J", "4"),
    "curve_names": ("C",),
    "curves": ("C", "T"),
}
_TEXTS = ("joint_names", "curve_names")


def write_npz(clip: Clip, path: str | os.PathLike[str]) -> None:
    """Write a clip, all of it but other formats' sources. Raises FootIKError where it cannot."""
    skeleton = clip.skeleton
    tips = sorted(skeleton.tips)
    arrays: dict[str, Any] = {
        "footik_clip": VERSION,
        "fps": clip.fps,
        "name": clip.name,
        "loop": clip.loop,
        "joint_names": np.array(skeleton.names),
        "parents": skeleton.parents,
        "offsets": skeleton.offsets,
        "rest_rotations": skeleton.rest_rotations,
        "tip_joints": np.array(tips, dtype=np.int64),
        "tip_offsets": np.array([skeleton.tips[j] for j in tips]).reshape(-1, 3),
        "root_positions": clip.root_positions,
        "rotations": clip.rotations,
        "curve_names": np.array(list(clip.curves), dtype=np.str_),
        "curves": np.array(list(clip.curves.values())).reshape(len(clip.curves), len(clip)),
        "extras": json.dumps(_extras(clip)),
    }
    if clip.translations is not None:
        arrays["translations"] = clip.translations
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    write_whole(path, buffer.getvalue())


def read_npz(path: str | os.PathLike[str]) -> Clip:
    """Read what `write_npz` wrote. Raises FootIKError, naming the array that is wrong."""
    return clip_of(read_table(path).arrays, path)


def clip_of(arrays: Mapping[str, NDArray[Any]], path: str | os.PathLike[str]) -> Clip:
    """The clip of an archive's arrays, as `read_npz` reads them."""
    if "footik_clip" not in arrays:
        raise FootIKError(f"{path}: holds no clip of ours: the array footik_clip is missing.")
    if _one(arrays, "footik_clip", path, float) != VERSION:
        raise FootIKError(f"{path}: is of version {arrays['footik_clip']}, not {VERSION}.")
    _require_shapes(arrays, path)
    tips = zip(arrays["tip_joints"].tolist(), arrays["tip_offsets"], strict=True)
    translations = arrays.get("translations")
    names = [str(name) for name in arrays["curve_names"]]
    try:
        clip = Clip(
            skeleton=Skeleton(
                names=tuple(str(name) for name in arrays["joint_names"]),
                parents=arrays["parents"].astype(np.int32),
                offsets=_numbers(arrays, "offsets", path),
                rest_rotations=_numbers(arrays, "rest_rotations", path),
                tips={int(joint): np.asarray(offset, np.float64) for joint, offset in tips},
            ),
            fps=_one(arrays, "fps", path, float),
            root_positions=_numbers(arrays, "root_positions", path),
            rotations=_numbers(arrays, "rotations", path),
            translations=None if translations is None else _numbers(arrays, "translations", path),
            curves=dict(zip(names, _numbers(arrays, "curves", path), strict=True)),
            loop=bool(_one(arrays, "loop", path, bool)),
            name=_one(arrays, "name", path, str),
        )
    except FootIKError as error:
        raise FootIKError(f"{path}: {error}") from None
    return _with_extras(clip, _one(arrays, "extras", path, str), path)


def _extras(clip: Clip) -> dict[str, Any]:
    kept: dict[str, Any] = {"notes": list(clip.extras.get("notes", ()))}
    if CURVE_KEYS in clip.extras:
        kept["curves"] = curves_to_json(clip)
    return kept


def _with_extras(clip: Clip, text: str, path: str | os.PathLike[str]) -> Clip:
    try:
        held = json.loads(text)
        notes = [str(note) for note in held.get("notes", ())]
    except (ValueError, AttributeError, TypeError, RecursionError):
        raise FootIKError(f"{path}: the array extras is no JSON object.") from None
    if "curves" in held:
        values = clip.curves
        clip = curves_from_json(held["curves"], clip, str(path)).with_curves(**values)
    return clip.with_extras(notes=notes) if notes else clip


def _one(arrays: Mapping[str, NDArray[Any]], name: str, path: Any, kind: type) -> Any:
    """The only value of an array, as a float, bool or str."""
    value = arrays.get(name)
    kinds = {float: "iuf", bool: "b", str: "U"}
    if value is None or value.size != 1 or value.dtype.kind not in kinds[kind]:
        found = "is missing" if value is None else f"is {value.shape} of {value.dtype}"
        raise FootIKError(f"{path}: the array {name} must be one {kind.__name__}; it {found}.")
    return kind(value.reshape(-1)[0])


def _numbers(arrays: Mapping[str, NDArray[Any]], name: str, path: Any) -> NDArray[np.float64]:
    value = arrays[name]
    if value.dtype.kind not in "iuf":
        raise FootIKError(f"{path}: the array {name} must hold numbers, not {value.dtype}.")
    return value.astype(np.float64)


def _require_shapes(arrays: Mapping[str, NDArray[Any]], path: str | os.PathLike[str]) -> None:
    """Raise FootIKError unless every array is there, with lengths that agree."""
    lengths = {"3": 3, "4": 4}
    for name, wanted in _SHAPES.items():
        value = arrays.get(name)
        if value is None:
            raise FootIKError(f"{path}: the array {name} is missing.")
        kinds = "U" if name in _TEXTS else "iuf"
        fits = value.ndim == len(wanted) and (value.dtype.kind in kinds or value.size == 0)
        if fits:
            for letter, length in zip(wanted, value.shape, strict=True):
                fits &= lengths.setdefault(letter, length) == length
        if not fits:
            shape = ", ".join(str(lengths.get(letter, letter)) for letter in wanted)
            raise FootIKError(
                f"{path}: the array {name} must be ({shape}), not {value.shape} of {value.dtype}."
            )
