"""Progress: what takes long says how far it is, on the standard error."""

from __future__ import annotations

import sys
import time
from typing import TextIO

_QUIET = 1.0  # s in which nothing is said
_PAUSE = 0.1  # s between two updates on a terminal


class Progress:
    """Says how far a piece of work is, once it has taken a second.

    On a terminal one line is rewritten; elsewhere a line is printed at each quarter.
    """

    def __init__(self, what: str, stream: TextIO | None = None) -> None:
        self._what = what
        self._stream = stream or sys.stderr
        self._begun = self._said = time.monotonic()
        self._quarter = 0
        self._open = False

    def __call__(self, done: int, of: int) -> None:
        """Tell that `done` of `of` parts are done."""
        now = time.monotonic()
        if now - self._begun < _QUIET:
            return
        percent = 100 * done // max(of, 1)
        if self._stream.isatty():
            if now - self._said >= _PAUSE:
                self._said, self._open = now, True
                print(f"\r{self._what} {percent:3d} %", end="", file=self._stream, flush=True)
        elif percent // 25 > self._quarter:
            self._quarter = percent // 25
            print(f"{self._what} {percent} %", file=self._stream, flush=True)

    def close(self) -> None:
        """Clear the line."""
        if self._open:
            print("\r" + " " * (len(self._what) + 6) + "\r", end="", file=self._stream, flush=True)
            self._open = False
