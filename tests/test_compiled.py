"""Compilation: its cache, its one announcement, and the plain-Python way."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numba.core import config as numba_config
from numba.core import event

import footik_runtime
from footik_runtime.compiled import (
    _CompileNotice,
    announce_compilation,
    compiled,
    jit_enabled,
)

PACKAGE = Path(footik_runtime.__file__).parent

ONE_KERNEL = """
import sys
sys.path.insert(0, {folder!r})
from footik_runtime.compiled import announce_compilation
announce_compilation(print)
from footik_runtime.inertia import limited_velocity
print(limited_velocity((0.0, 0.0, 0.0), (9.0, 0.0, 0.0), 1.0, 1.0))
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
    source = copy / "math3d.py"
    length = "return math.sqrt(v[0] * v[0]"
    assert length in source.read_text()
    source.write_text(source.read_text().replace(length, length.replace("math", "2.0 * math")))
    third = python(code, **cache)
    assert third.count("compiling") == 1
    assert third.splitlines()[-1] != first.splitlines()[-1]
    assert len(list((tmp_path / "kernels").iterdir())) == 2


FEW_ROOMS = """
import mujoco, numpy as np
from footik_runtime.ground import SceneGround
from footik_runtime.inertia import decayed, spring
from footik_runtime.leg_ik import heel_lift, two_bone
from footik_runtime.math3d import quat_upright
from footik_runtime.skeleton import Skeleton

rng = np.random.default_rng(0)
numbers = [*decayed((0.1, 0.2, 0.3), (1.0, 0.0, 0.0), 0.03, 0.2), *spring(1.0, 2.0, 3.0, 0.1, 0.02)]
thigh, shin, end, reached = two_bone(
    (0.0, 0.0, 0.9), (0.06, 0.0, 0.5), (0.0, 0.0, 0.1), (0.2, 0.1, 0.3), (0.0, 1.0, 0.0), 0.8
)
numbers += [*thigh, *shin, *end, reached, *quat_upright((1.0, 0.2, 0.0), (0.1, 0.0, 1.0))]
numbers += [heel_lift((0.0, 0.0, 1.0), (0.0, 0.0, 0.1), (0.1, 0.0, 0.0), (0.0, 1.0, 0.0), 0.8)]
skeleton = Skeleton(
    names=("a", "b", "c"), parents=np.array([-1, 0, 1]), offsets=rng.normal(size=(3, 3))
)
for made in skeleton.forward(rng.normal(size=(2, 3, 4)), rng.normal(size=(2, 3))):
    numbers += made.ravel().tolist()
model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><geom type='box' size='1 1 .2' euler='5 5 5'/></worldbody></mujoco>"
)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
numbers += SceneGround(model, data).height(rng.uniform(-1, 1, (9, 3)) + [0, 0, 1]).tolist()
print(*(float(x).hex() for x in numbers))
"""


def numbers(text: str) -> np.ndarray:
    return np.array([float.fromhex(word) for word in text.splitlines()[-1].split()])


def test_plain_python_gives_the_same_numbers(tmp_path):
    here, cache = str(PACKAGE.parent), tmp_path / "kernels"
    kernels = python(FEW_ROOMS, PYTHONPATH=here, NUMBA_DISABLE_JIT="0")
    plain = python(
        FEW_ROOMS, PYTHONPATH=here, NUMBA_DISABLE_JIT="1", FOOTIK_CACHE_DIR=str(cache)
    )  # fmt: skip
    assert numbers(kernels).size > 50
    np.testing.assert_allclose(numbers(plain), numbers(kernels), rtol=1e-13, atol=1e-13)
    assert not cache.exists()  # nothing was compiled


@pytest.fixture
def copied(tmp_path) -> Path:
    """A package of its own: compiled.py, a module that compiles and one that does not."""
    package = tmp_path / "package"
    package.mkdir()
    shutil.copy(PACKAGE / "compiled.py", package)
    (package / "kernels.py").write_text("@compiled\ndef f(x): return x\n")
    (package / "plain.py").write_text("def g(x): return x\n")
    return package


def load(package: Path) -> ModuleType:
    """The copied compiled.py, imported anew."""
    spec = importlib.util.spec_from_file_location("compiled_copy", package / "compiled.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_key_of_the_cache_changes_with_each_compiled_source_and_with_no_other(copied):
    keys = [load(copied)._sources_key()]
    assert load(copied)._sources_key() == keys[0]
    (copied / "plain.py").write_text("def g(x): return 2 * x\n")
    assert load(copied)._sources_key() == keys[0]
    (copied / "kernels.py").write_text("@compiled\ndef f(x): return 2 * x\n")
    keys.append(load(copied)._sources_key())
    (copied / "kernels.py").rename(copied / "renamed.py")
    keys.append(load(copied)._sources_key())
    (copied / "deeper").mkdir()
    (copied / "deeper" / "more.py").write_text("@compiled\ndef h(x): return x\n")
    keys.append(load(copied)._sources_key())
    assert len(set(keys)) == len(keys)


def test_key_of_the_cache_changes_with_the_versions_it_compiles_with(copied, monkeypatch):
    key = load(copied)._sources_key()
    monkeypatch.setattr(np, "__version__", "9.9.9")
    assert load(copied)._sources_key() != key


def test_cache_lies_where_it_is_told_or_where_caches_lie(copied, monkeypatch, tmp_path):
    monkeypatch.setenv("FOOTIK_CACHE_DIR", str(tmp_path / "mine"))
    assert load(copied)._CACHE_DIR.parent == tmp_path / "mine"
    monkeypatch.delenv("FOOTIK_CACHE_DIR")
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert load(copied)._cache_root() == tmp_path / "xdg" / "footik_runtime"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert load(copied)._cache_root() == Path.home() / ".cache" / "footik_runtime"
    monkeypatch.setattr(sys, "platform", "darwin")
    assert load(copied)._cache_root().parent == Path.home() / "Library" / "Caches"
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path / "local"))
    assert load(copied)._cache_root() == tmp_path / "local" / "footik_runtime"


def test_numbas_own_cache_folder_is_left_as_the_user_set_it(monkeypatch):
    monkeypatch.setattr(numba_config, "CACHE_DIR", "of the user")
    compiled(lambda x: x)
    assert numba_config.CACHE_DIR == "of the user"


def test_announcement_is_made_once_and_only_when_something_compiles():
    said: list[str] = []
    notice = _CompileNotice(said.append)
    assert said == []
    for _ in range(3):
        notice.on_start(event.Event("numba:compile", event.EventStatus.START))
        notice.on_end(event.Event("numba:compile", event.EventStatus.END))
    assert len(said) == 1
    assert "compiling" in said[0]


def test_nothing_is_announced_where_nothing_compiles(monkeypatch):
    monkeypatch.setattr(numba_config, "DISABLE_JIT", 1)
    monkeypatch.setattr(event, "register", lambda *_: pytest.fail("listens to what cannot come"))
    announce_compilation(print)
    assert not jit_enabled()
    assert compiled(numbers) is numbers
