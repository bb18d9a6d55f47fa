"""Tables of joint values on disk: NumPy archives and CSV, read with care and written back whole.

An archive's arrays that are not joint values are kept as they are; so are a CSV's header and its
other columns.
"""

from __future__ import annotations

import csv
import io
import math
import os
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from footik_runtime.errors import FootIKError
from footik_runtime.files import write_whole

Array = NDArray[np.float64]

LARGEST_FILE = 1 << 30  # bytes
_MOST_TIMES_LARGER = 10  # than its archive may the content be, and a little for small ones
_SMALL = 1 << 24  # bytes
_TIMES = ("time", "t", "timestamp")


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Columns of numbers by name, and what else the file held.

    Attributes:
        arrays: of an archive, all of them; of a CSV, its columns under `header` or "0", "1", ...
        header: a CSV's header row, or None; None for archives.
        is_csv: what the file was.
    """

    arrays: dict[str, NDArray[Any]]
    header: tuple[str, ...] | None
    is_csv: bool


def read_table(path: str | os.PathLike[str]) -> Table:
    """Read an .npz or .csv file. Raises FootIKError for anything else, or a broken one."""
    suffix = Path(path).suffix.lower()
    try:
        if os.path.getsize(path) > LARGEST_FILE:
            raise FootIKError(f"{path}: larger than {LARGEST_FILE >> 30} GB, the limit.")
        if suffix == ".npz":
            return Table(arrays=_read_archive(path), header=None, is_csv=False)
        if suffix == ".csv":
            return _read_csv(path)
    except OSError as error:
        raise FootIKError(f"{path}: cannot be read: {error.strerror or error}.") from None
    except (
        ValueError,
        KeyError,
        EOFError,
        NotImplementedError,
        MemoryError,
        OverflowError,
    ) as error:
        raise FootIKError(f"{path}: is broken: {_short(error)}.") from None
    except (zipfile.BadZipFile, zipfile.LargeZipFile, RuntimeError, SyntaxError) as error:
        raise FootIKError(f"{path}: is no NumPy archive: {_short(error)}.") from None
    except Exception as error:  # what zlib and its kin raise for damaged streams
        raise FootIKError(f"{path}: is broken: {type(error).__name__}: {_short(error)}.") from None
    raise FootIKError(f"{path}: joint values are read from .npz or .csv files, not {suffix!r}.")


def _short(error: Exception) -> str:
    """An error's words, without the kilobytes of the file that some quote."""
    words = str(error)
    return words if len(words) <= 200 else words[:200] + "…"


def _read_archive(path: str | os.PathLike[str]) -> dict[str, NDArray[Any]]:
    size = os.path.getsize(path)
    arrays = {}
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        if sum(member.file_size for member in members) > _MOST_TIMES_LARGER * size + _SMALL:
            raise FootIKError(f"{path}: unpacks to more than {_MOST_TIMES_LARGER} times its size.")
        for member in members:
            name = member.filename.removesuffix(".npy")
            with archive.open(member) as stream:
                content = stream.read(member.file_size)
            arrays[name] = _read_array(content, f"{path}: array {name[:60]!r}")
    return arrays


def _read_array(content: bytes, where: str) -> NDArray[Any]:
    stream = io.BytesIO(content)
    version = npy.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise FootIKError(f"{where}: has version {version} of NumPy's format, not 1.0 or 2.0.")
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, fortran, dtype = read(stream)
    if dtype.hasobject:
        raise FootIKError(f"{where}: holds Python objects, which are not read.")
    count = math.prod(shape)  # Python's, which cannot overflow
    if count * dtype.itemsize != len(content) - stream.tell() or min(shape, default=0) < 0:
        raise FootIKError(f"{where}: says it is {shape} of {dtype}, which is not what it holds.")
    flat = np.frombuffer(content, dtype=dtype, count=count, offset=stream.tell())
    return flat.reshape(shape, order="F" if fortran else "C").copy()


def _read_csv(path: str | os.PathLike[str]) -> Table:
    text = Path(path).read_bytes().decode("utf-8-sig")
    try:
        rows = [row for row in csv.reader(io.StringIO(text), strict=True) if row]
    except csv.Error as error:
        raise FootIKError(f"{path}: not a CSV table: {error}.") from None
    if not rows:
        raise FootIKError(f"{path}: is empty.")
    header = (
        None if all(_is_number(cell) for cell in rows[0]) else tuple(c.strip() for c in rows[0])
    )
    body = rows if header is None else rows[1:]
    if not body:
        raise FootIKError(f"{path}: has a header but no rows.")
    width = len(rows[0])
    values = np.empty((len(body), width))
    for number, row in enumerate(body):
        line = number + 1 + (header is not None)
        if len(row) != width:
            raise FootIKError(f"{path}: row {line} has {len(row)} cells, the first has {width}.")
        for column, cell in enumerate(row):
            if not _is_number(cell):
                raise FootIKError(
                    f"{path}: row {line}, column {column}: {cell[:40]!r} is no number."
                )
            values[number, column] = float(cell)
    names = header or tuple(str(i) for i in range(width))
    if len(set(names)) != width:
        twice = next(name for name in names if names.count(name) > 1)
        raise FootIKError(f"{path}: column {twice!r} is there twice.")
    arrays = {name: values[:, i].copy() for i, name in enumerate(names)}
    return Table(arrays=arrays, header=header, is_csv=True)


def _is_number(cell: str) -> bool:
    try:
        return math.isfinite(float(cell))
    except ValueError:
        return False


def time_column(table: Table) -> str | None:
    """The name of a CSV's column of times, where its header tells of one."""
    names = () if table.header is None else table.header
    return next((name for name in names if name.lower() in _TIMES), None)


def with_arrays(table: Table, arrays: dict[str, NDArray[Any]]) -> Table:
    """The table with some arrays replaced: of the precision they had, whole numbers made real."""
    kept = {n: np.asarray(a).astype(_real(table.arrays[n].dtype)) for n, a in arrays.items()}
    return replace(table, arrays=table.arrays | kept)


def _real(dtype: np.dtype) -> np.dtype:
    return dtype if dtype.kind == "f" else np.dtype(np.float64)


def write_table(path: str | os.PathLike[str], table: Table) -> None:
    """Write a table as it was read. Raises FootIKError for a suffix of the other kind."""
    suffix = ".csv" if table.is_csv else ".npz"
    if Path(path).suffix.lower() != suffix:
        raise FootIKError(f"{path}: these joint values came from a {suffix} file and go to one.")
    if not table.is_csv:
        out = io.BytesIO()
        np.savez(out, allow_pickle=False, **table.arrays)
        write_whole(path, out.getvalue())
        return
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if table.header is not None:
        writer.writerow(table.header)
    writer.writerows(zip(*(column.tolist() for column in table.arrays.values()), strict=True))
    write_whole(path, text.getvalue().encode("utf-8"))
