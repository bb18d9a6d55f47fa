"""Claims: no output replaces an input or another output, which is settled before any is written."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

from footik_runtime.errors import FootIKError
from footik_runtime.files import is_device

_Key = str | tuple[int, int]

_FOLDS_CASE = sys.platform in ("win32", "darwin")  # as their file systems do unless told otherwise


class Claims:
    """Who writes which file. Links, and names that the file system takes for the same, count."""

    def __init__(self, inputs: Iterable[Path]) -> None:
        self._inputs = {key for path in inputs for key in _keys(path)}
        self._outputs: dict[_Key, str] = {}

    def claim(self, path: Path, what: str, *, shared: bool = False) -> None:
        """Take a file for an output; `shared` where all who say the same write the same bytes.

        Raises FootIKError where it is an input, or was claimed already. Devices hold nothing.
        """
        if is_device(path):
            return
        keys = _keys(path)
        if keys & self._inputs:
            raise FootIKError(
                f"{path}: {what} would replace an input or its curves; choose another."
            )
        for key in keys & self._outputs.keys():
            if not (shared and self._outputs[key] == what):
                raise FootIKError(
                    f"{path}: {self._outputs[key]} and {what} would go to the same file."
                )
        self._outputs |= dict.fromkeys(keys, what)


def require_apart(inputs: Iterable[Path | None], outputs: Mapping[str, Path | None]) -> None:
    """Raise FootIKError unless outputs (what -> where) differ from inputs and from one another.

    None stands for what is not asked for.
    """
    claims = Claims(path for path in inputs if path is not None)
    for what, path in outputs.items():
        if path is not None:
            claims.claim(path, what)


def _keys(path: Path) -> set[_Key]:
    """What two paths of the same file share: the place that links lead to, and the file there."""
    try:
        place = os.path.realpath(path)
        keys: set[_Key] = {place.casefold() if _FOLDS_CASE else place}
        if os.path.exists(path):
            found = os.stat(path)
            keys.add((found.st_dev, found.st_ino))
    except (OSError, ValueError) as error:
        raise FootIKError(f"{path}: is no path of a file: {error}.") from None
    return keys
