"""Curve files: a clip's curves beside a format that holds none, as JSON keys or as a CSV table.

The JSON form is also what a glTF file carries in an animation's extras:
{"footik_curves": 1, "fps": .., "frames": .., "clip": .., "curves": {name: {"times": [..],
"values": [..], "interpolation": "smooth" | "linear" | "step", "slopes": [..]}}}; slopes that are
all 0 are left out. Curves without keys of their own are written so that every frame is exact.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn, cast

import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.files import write_whole
from footik_runtime.offline.curve_keys import CURVE_KEYS, Keys, keys_of, sample

Array = NDArray[np.float64]

VERSION = 1
LARGEST_FILE = 64 * 1024 * 1024  # bytes
LONGEST_NAME = 256  # characters
_SAME_RATE = 1e-6  # share by which two frame rates may differ
_TIME = "time"


def sidecar(path: str | os.PathLike[str]) -> Path:
    """Where the curves of a clip's file lie: "walk.curves.json" beside "walk.bvh"."""
    return Path(path).with_suffix(".curves.json")


def write_curves(path: str | os.PathLike[str], clip: Clip) -> None:
    """Write all curves of a clip: keys to .json, a row a frame to .csv.

    Raises FootIKError for another suffix, a name too long, or a file that cannot be written.
    """
    write_whole(path, _form(path, _WRITERS)(clip).encode("utf-8"))


def read_curves(path: str | os.PathLike[str], clip: Clip) -> Clip:
    """The clip with the curves of a file added, in place of its own of those names.

    Raises FootIKError for a file that is none, or was made for other frames.
    """
    read = _form(path, _READERS)
    try:
        if os.path.getsize(path) > LARGEST_FILE:
            raise FootIKError(f"{path}: larger than {LARGEST_FILE >> 20} MB, the limit for curves.")
        text = Path(path).read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FootIKError(f"{path}: not a text file (byte {error.start} is not UTF-8).") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise FootIKError(f"{path}: the curves cannot be read: {reason}.") from None
    return read(text, clip, str(path))


def _form(path: str | os.PathLike[str], forms: dict[str, Callable]) -> Callable:
    suffix = Path(path).suffix.lower()
    if suffix not in forms:
        raise FootIKError(f"{path}: curves are {' or '.join(forms)} files, not {suffix!r}.")
    return forms[suffix]


# --- JSON ---------------------------------------------------------------------------------------


def curves_to_json(clip: Clip) -> dict[str, Any]:
    """The clip's curves as plain dicts, lists, numbers and strings."""
    return {
        "footik_curves": VERSION,
        "fps": clip.fps,
        "frames": len(clip),
        "clip": clip.name,
        "curves": {name: _keys_to_json(_exact_keys(clip, name)) for name in clip.curves},
    }


def _exact_keys(clip: Clip, name: str) -> Keys:
    """Keys that give every frame of a curve to the last bit."""
    _require_name(name, clip.name)
    keys = keys_of(clip, name, 0.0)
    values = np.asarray(clip.curves[name], dtype=np.float64)
    if np.array_equal(sample(keys, clip.times), values):
        return keys
    # Frames inside a run of one value say nothing; a line between others is not exact.
    told = np.ones(len(values), dtype=bool)
    told[1:-1] = (values[1:-1] != values[:-2]) | (values[1:-1] != values[2:])
    return Keys(times=clip.times[told], values=values[told], interpolation="linear")


def _keys_to_json(keys: Keys) -> dict[str, Any]:
    told: dict[str, Any] = {
        "times": keys.times.tolist(),
        "values": keys.values.tolist(),
        "interpolation": keys.interpolation,
    }
    return told | ({"slopes": keys.slopes.tolist()} if keys.slopes.any() else {})


def curves_from_json(data: Any, clip: Clip, where: str) -> Clip:
    """The clip with the curves of `curves_to_json`'s dict; `where` begins every message."""
    if not isinstance(data, dict) or data.get("footik_curves") != VERSION:
        raise FootIKError(f'{where}: holds no curves of version {VERSION} ("footik_curves": 1).')
    curves = data.get("curves")
    if not isinstance(curves, dict):
        raise FootIKError(f'{where}: "curves" must hold name: keys, not {type(curves).__name__}.')
    fps, frames = (_number(data.get(field), field, where) for field in ("fps", "frames"))
    if frames != len(clip) or abs(fps - clip.fps) > _SAME_RATE * clip.fps:
        raise FootIKError(
            f"{where}: the curves are of {frames:g} frames at {fps:g} fps, "
            f"but {clip.name} has {len(clip)} at {clip.fps:g}."
        )
    keys = {name: _keys_from_json(name, entry, where) for name, entry in curves.items()}
    sampled = clip.with_curves(**{name: sample(each, clip.times) for name, each in keys.items()})
    # Lines through every frame are no keys that anyone made: exports may thin them.
    made = {name: each for name, each in keys.items() if each.interpolation != "linear"}
    others = {n: k for n, k in clip.extras.get(CURVE_KEYS, {}).items() if n not in keys}
    return sampled.with_extras(**{CURVE_KEYS: others | made})


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e15


def _number(value: Any, field: str, where: str) -> float:
    if not _is_number(value):
        raise FootIKError(f'{where}: "{field}" must be a number, not {str(value)[:40]!r}.')
    return float(value)


def _keys_from_json(name: str, entry: Any, where: str) -> Keys:
    _require_name(name, where)
    if not isinstance(entry, dict):
        raise FootIKError(f"{where}: curve {name!r} must hold times and values.")
    lists = {part: _numbers(entry.get(part, []), part, name, where) for part in _PARTS}
    try:
        return Keys(**lists, interpolation=entry.get("interpolation", "linear"))
    except FootIKError as error:
        raise FootIKError(f"{where}: curve {name!r}: {error}") from None
    except TypeError:  # an interpolation that is a list
        raise FootIKError(f"{where}: curve {name!r}: the interpolation must be a name.") from None


_PARTS = ("times", "values", "slopes")


def _numbers(value: Any, part: str, name: str, where: str) -> Array:
    if isinstance(value, list) and all(_is_number(each) for each in value):
        return np.array(value, dtype=np.float64)
    raise FootIKError(f"{where}: curve {name!r}: {part} must be a list of finite numbers.")


def _require_name(name: str, where: str) -> None:
    if not 0 < len(name) <= LONGEST_NAME or not name.isprintable():
        raise FootIKError(
            f"{where}: a curve's name must have 1 to {LONGEST_NAME} printable characters, "
            f"not {name[:40]!r}."
        )


def _json_text(clip: Clip) -> str:
    return json.dumps(curves_to_json(clip), allow_nan=False) + "\n"


def _from_json_text(text: str, clip: Clip, where: str) -> Clip:
    def refuse(constant: str) -> NoReturn:
        raise FootIKError(f"{where}: holds {constant}, which is no number of a curve.")

    try:
        data = json.loads(text, parse_constant=refuse)
    except json.JSONDecodeError as error:
        raise FootIKError(f"{where}:{error.lineno}: not JSON: {error.msg}.") from None
    except (RecursionError, ValueError) as error:  # nested too deep; a number of too many digits
        raise FootIKError(f"{where}: not JSON that holds curves: {error}.") from None
    return curves_from_json(data, clip, where)


# --- CSV ----------------------------------------------------------------------------------------


def csv_text(clip: Clip) -> str:
    """A header of time and the curves' names, and a row a frame; numbers are exact."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    for name in clip.curves:
        _require_name(name, clip.name)
    writer.writerow([_TIME, *clip.curves])
    columns = [clip.times, *(np.asarray(v, dtype=np.float64) for v in clip.curves.values())]
    writer.writerows(zip(*(column.tolist() for column in columns), strict=True))
    return out.getvalue()


def _from_csv_text(text: str, clip: Clip, where: str) -> Clip:
    try:
        rows = list(csv.reader(io.StringIO(text), strict=True))
    except csv.Error as error:
        raise FootIKError(f"{where}: not a CSV table: {error}.") from None
    rows = [row for row in rows if row]
    if not rows or rows[0][0].strip().lower() != _TIME:
        raise FootIKError(f"{where}: a table of curves begins with a column named {_TIME!r}.")
    names = [name.strip() for name in rows[0][1:]]
    for name in names:
        _require_name(name, where)
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise FootIKError(f"{where}: column {twice!r} is there twice.")
    table = _table(rows, where)
    # Python's numbers: a span too short to divide by is infinitely many rows a second.
    span = float(table[-1, 0]) - float(table[0, 0]) if len(table) else 0.0
    fps = (len(table) - 1) / span if span > 0.0 else clip.fps
    if len(table) != len(clip) or abs(span - clip.duration) > 1e-4 * max(clip.duration, 1.0):
        _refuse_frames(clip, len(table), fps, where)
    return clip.with_curves(**dict(zip(names, table[:, 1:].T.copy(), strict=True)))


def _refuse_frames(clip: Clip, frames: int, fps: float, where: str) -> NoReturn:
    raise FootIKError(
        f"{where}: the table has {frames} rows at {fps:.6g} a second, "
        f"but {clip.name} has {len(clip)} frames at {clip.fps:.6g}."
    )


def _table(rows: list[list[str]], where: str) -> Array:
    """(T, columns) numbers of all rows but the first."""
    width = len(rows[0])
    for number, row in enumerate(rows[1:], 2):
        if len(row) != width:
            raise FootIKError(f"{where}: row {number} has {len(row)} cells, the header {width}.")
    table = np.empty((len(rows) - 1, width))
    for number, row in enumerate(rows[1:]):
        for column, cell in enumerate(row):
            try:
                table[number, column] = float(cell)
            except ValueError:
                table[number, column] = math.nan
            if not math.isfinite(table[number, column]):
                raise FootIKError(
                    f"{where}: row {number + 2}, column {rows[0][column]!r}: {cell[:40]!r} is no "
                    "finite number."
                )
    return table


_WRITERS = {".json": _json_text, ".csv": csv_text}
_READERS = cast(
    dict[str, Callable[[str, Clip, str], Clip]], {".json": _from_json_text, ".csv": _from_csv_text}
)
