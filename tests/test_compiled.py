"""Compilation: its cache, its one announcement, and the plain-Python way."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import footik_runtime

PACKAGE = Path(footik_runtime.__file__).parent

IMPORTED = """
import sys
import footik_runtime
heavy = {"matplotlib", "torch", "dask", "viser", "mjviser", "mink", "pygltflib"}
print(sorted(heavy & {name.partition(".")[0] for name in sys.modules}))
"""

ONE_KERNEL = """
import sys
sys.path.insert(0, {folder!r})
from footik_runtime.compiled import announce_compilation
announce_compilation(print)
from footik_runtime.math3d import quat_from_rotvec
print(quat_from_rotvec((0.1, 0.2, 0.3)))
"""


def python(code: str, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


# SciPy is not among them: Numba imports it by itself where it is installed.
def test_import_brings_no_viewer_plot_or_learning_library():
    assert python(IMPORTED, PYTHONPATH=str(PACKAGE.parent)).strip() == "[]"


def test_kernels_are_announced_once_cached_and_renewed_with_their_sources(tmp_path):
    copy = tmp_path / "footik_runtime"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    code = ONE_KERNEL.format(folder=str(tmp_path))
    cache = {"FOOTIK_CACHE_DIR": str(tmp_path / "kernels"), "NUMBA_DISABLE_JIT": "0"}
    first, second = python(code, **cache), python(code, **cache)
    assert first.count("compiling") == 1
    assert "compiling" not in second
    assert first.splitlines()[-1] == second.splitlines()[-1]
    # A callee in another module changes: the caller must not run stale code.
    source = copy / "inertia.py"
    source.write_text(source.read_text() + "\n# changed\n")
    assert python(code, **cache).count("compiling") == 1
    assert len(list((tmp_path / "kernels").iterdir())) == 2


def test_plain_python_gives_the_same_numbers(tmp_path):
    code = ONE_KERNEL.format(folder=str(PACKAGE.parent))
    cache = str(tmp_path / "kernels")
    kernel = python(code, FOOTIK_CACHE_DIR=cache, NUMBA_DISABLE_JIT="0").splitlines()[-1]
    plain = python(code, FOOTIK_CACHE_DIR=cache, NUMBA_DISABLE_JIT="1").splitlines()
    assert plain == [kernel]
    assert not Path(cache, "math3d").exists()
