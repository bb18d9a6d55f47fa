"""Files that appear whole or not at all."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from footik_runtime.errors import FootIKError


def write_whole(path: str | os.PathLike[str], data: bytes) -> None:
    """Write beside, then rename: a reader sees the old file or the new one, never a part.

    What is no file, such as /dev/null or a pipe, is written to as it is. Raises FootIKError where
    the file cannot be written.
    """
    target = Path(path)
    beside = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        if is_device(target):
            target.write_bytes(data)
            return
        beside.write_bytes(data)
        os.replace(beside, target)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise FootIKError(f"{target}: the file cannot be written: {reason}.") from None
    finally:
        with contextlib.suppress(OSError, ValueError):
            beside.unlink()


def remove(path: str | os.PathLike[str]) -> None:
    """Remove a file, where there is one. Raises FootIKError where it cannot be removed."""
    target = Path(path)
    if not target.is_file():
        return
    try:
        target.unlink()
    except OSError as error:
        raise FootIKError(f"{path}: the file cannot be removed: {error.strerror}.") from None


def is_device(path: Path) -> bool:
    """Whether a path is there and neither a file nor a folder, such as /dev/null or a pipe."""
    return path.exists() and not (path.is_file() or path.is_dir())


def require_writable(path: str | os.PathLike[str]) -> None:
    """Find out before long work whether a file can be written where it shall go."""
    if is_device(Path(path)) and os.access(path, os.W_OK):
        return
    folder = Path(path).absolute().parent
    if not folder.is_dir():
        raise FootIKError(f"{path}: there is no folder {folder} to write it in.")
    if Path(path).is_dir():
        raise FootIKError(f"{path}: is a folder, not a file that can be written.")
    if not os.access(folder, os.W_OK):
        raise FootIKError(f"{path}: the folder {folder} cannot be written in.")
