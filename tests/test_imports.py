"""What `import footik_runtime` brings along, and what it promises by name."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import footik_runtime

PACKAGE = Path(footik_runtime.__file__).parent
HEAVY = ("dask", "matplotlib", "mink", "mjviser", "pyarrow", "pygltflib", "scipy", "torch", "viser")

# Numba takes SciPy along where it is installed (for its linear algebra): here it finds none, so
# that what is left in sys.modules is our own doing.
IMPORT = """
import sys
sys.modules["scipy"] = None
import footik_runtime
del sys.modules["scipy"]
print(*sorted({{name.partition(".")[0] for name in sys.modules}} & set({heavy!r})))
"""


def test_import_brings_no_viewer_plot_learning_or_science_library():
    done = subprocess.run(
        [sys.executable, "-c", IMPORT.format(heavy=HEAVY)],
        env=os.environ | {"PYTHONPATH": str(PACKAGE.parent)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == []


@pytest.mark.parametrize("source", sorted(PACKAGE.rglob("*.py")), ids=lambda p: p.name)
def test_no_module_imports_a_heavy_library_at_its_top(source):
    imported = set()
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if node.__class__ in (ast.Import, ast.ImportFrom) and node.col_offset == 0:
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in getattr(node, "names", [])]
            imported |= {name.partition(".")[0] for name in names}
    assert not imported & set(HEAVY)


def test_every_promised_name_is_there_and_said_once():
    promised = footik_runtime.__all__
    assert len(set(promised)) == len(promised)
    for name in promised:
        assert getattr(footik_runtime, name) is not None
