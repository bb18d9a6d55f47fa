"""The one way this library compiles: `@compiled`, Numba with a cache that notices every source.

Numba's disk cache compares a function's own file only, so a change in a callee's module would run
stale code. Here the cache directory is named by a hash of all sources of the package that compile,
and of the versions they compile with. NUMBA_DISABLE_JIT=1 turns every kernel into plain Python.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import llvmlite
import numba
import numpy as np
from numba.core import config, event

_F = TypeVar("_F", bound=Callable[..., Any])
_PACKAGE = Path(__file__).parent


def jit_enabled() -> bool:
    """False under NUMBA_DISABLE_JIT=1, where kernels run as plain Python."""
    return not config.DISABLE_JIT


def _sources_key() -> str:
    digest = hashlib.sha256()
    for source in sorted(_PACKAGE.rglob("*.py")):
        text = source.read_bytes()
        if b"@compiled" in text:
            digest.update(source.relative_to(_PACKAGE).as_posix().encode() + b"\0" + text)
    versions = (numba.__version__, llvmlite.__version__, np.__version__, platform.python_version())
    digest.update(repr(versions).encode())
    return digest.hexdigest()[:16]


def _cache_root() -> Path:
    if chosen := os.environ.get("FOOTIK_CACHE_DIR"):
        return Path(chosen)
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or str(Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = str(Path.home() / "Library" / "Caches")
    else:
        base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "footik_runtime"


_CACHE_DIR = _cache_root() / _sources_key()


def compiled(function: _F) -> _F:
    """Compile `function` to native code (nogil, exact float64), cached on disk between runs.

    Kernels own no memory: one that allocates does not compile. So arrays need no reference counts,
    whose atomic operations would be a third of a frame.
    """
    if not jit_enabled():
        return function
    user_choice = config.CACHE_DIR
    config.CACHE_DIR = str(_CACHE_DIR)  # read by Numba while it decorates
    try:
        options = {"cache": True, "nogil": True, "error_model": "numpy", "_nrt": False}
        return cast(_F, numba.njit(**options)(function))
    finally:
        config.CACHE_DIR = user_choice


class _CompileNotice(event.Listener):
    """Calls `say` once, when the first kernel of this process has to be compiled."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._said = False

    def on_start(self, event: event.Event) -> None:
        if not self._said:
            self._said = True
            self._say("compiling the kernels, once for this version (about a minute) …")

    def on_end(self, event: event.Event) -> None:
        pass


def announce_compilation(say: Callable[[str], None]) -> None:
    """Have `say` called with one line of text when, and only when, kernels must be compiled."""
    if jit_enabled():
        event.register("numba:compile", _CompileNotice(say))
