"""Files that appear whole or not at all."""

from __future__ import annotations

import contextlib
import os
import re
import unicodedata
from collections.abc import Iterable
from itertools import chain, count
from pathlib import Path

from footik_runtime.errors import FootIKError


def write_whole(path: str | os.PathLike[str], data: bytes) -> None:
    """Write beside, then rename: a reader sees the old file or the new one, never a part.

    What is no file, such as /dev/null or a pipe, is written to as it is. Raises FootIKError where
    the file cannot be written, or is there and protected: renaming would not ask.
    """
    target = Path(path)
    beside = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        if is_device(target):
            target.write_bytes(data)
            return
        require_replaceable(target)
        beside.write_bytes(data)
        os.replace(beside, target)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise FootIKError(f"{target}: the file cannot be written: {reason}.") from None
    finally:
        with contextlib.suppress(OSError, ValueError):
            beside.unlink()


def require_replaceable(path: str | os.PathLike[str]) -> None:
    """Raise FootIKError for a folder, and for a file that is there and protected."""
    if os.path.isdir(path):
        raise FootIKError(f"{path}: is a folder, not a file that can be written.")
    if os.path.isfile(path) and not os.access(path, os.W_OK):
        raise FootIKError(f"{path}: the file is write-protected.")


def remove(path: str | os.PathLike[str]) -> None:
    """Remove a file, where there is one. Raises FootIKError where it cannot be removed."""
    target = Path(path)
    if not target.is_file():
        return
    require_replaceable(target)
    try:
        target.unlink()
    except OSError as error:
        raise FootIKError(f"{path}: the file cannot be removed: {error.strerror}.") from None


_LONGEST_PART = 80  # bytes: names are put together of two or three, and 255 is most
# What some file system forbids, white space, and half a surrogate pair, which none can hold.
_NO_NAME = re.compile(r"[\x00-\x1f\x7f\s/\\:*?\"<>|\ud800-\udfff]+")


def name_part(text: str) -> str:
    """A name as a part of a file's name anywhere: letters of all languages stay, slashes do not."""
    plain = _NO_NAME.sub("_", unicodedata.normalize("NFC", text)).strip(".")
    return plain.encode()[:_LONGEST_PART].decode(errors="ignore") or "_"


def unique_parts(texts: Iterable[str]) -> list[str]:
    """Names as parts of file names, each another also where case does not count."""
    parts: list[str] = []
    taken: set[str] = set()
    for part in map(name_part, texts):
        numbered = (f"{part}_{n}" for n in count(2))
        free = next(name for name in chain([part], numbered) if name.casefold() not in taken)
        taken.add(free.casefold())
        parts.append(free)
    return parts


def is_device(path: Path) -> bool:
    """Whether a path is there and neither a file nor a folder, such as /dev/null or a pipe."""
    return path.exists() and not (path.is_file() or path.is_dir())


def make_folder(path: str | os.PathLike[str]) -> None:
    """Make a folder and those above it, where they are not there. Raises FootIKError."""
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise FootIKError(f"{path}: the folder cannot be made: {reason}.") from None


def require_writable(path: str | os.PathLike[str]) -> None:
    """Find out before long work whether a file can be written where it shall go."""
    if is_device(Path(path)) and os.access(path, os.W_OK):
        return
    folder = Path(path).absolute().parent
    if not folder.is_dir():
        raise FootIKError(f"{path}: there is no folder {folder} to write it in.")
    require_replaceable(path)
    if not os.access(folder, os.W_OK):
        raise FootIKError(f"{path}: the folder {folder} cannot be written in.")
