"""Every format gives back what it was given: read, written and read again is the same clip.

What each format leaves alone of a file it changes is in test_bvh, test_gltf and test_qpos_files.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from qpos_robot import robot, save, trajectory

from footik_runtime.builtin import builtin_motion
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.formats import load_clip, save_clip
from footik_runtime.formats.qpos import read_qpos
from footik_runtime.offline.bake import bake
from footik_runtime.offline.curve_keys import CURVE_KEYS
from footik_runtime.offline.detect import contacts
from footik_runtime.rig import find_rig
from footik_runtime.sole import all_sole_points

SHARED = Path(os.environ.get("FOOTIK_SHARED", Path(__file__).parents[1] / "../shared"))
REAL = sorted(
    path
    for folder in ("bvh", "gltf")
    for path in (SHARED / "data" / folder).glob("*.*")
    if path.suffix in (".bvh", ".glb") and path.stat().st_size < 4_000_000
)


def assert_same(a: Clip, b: Clip) -> None:
    """Two clips are equal to the last bit, their curves' keys too."""
    assert (a.fps, a.loop, len(a)) == (b.fps, b.loop, len(b))
    assert a.skeleton.names == b.skeleton.names
    for part in ("parents", "offsets", "rest_rotations"):
        np.testing.assert_array_equal(getattr(a.skeleton, part), getattr(b.skeleton, part))
    assert a.skeleton.tips.keys() == b.skeleton.tips.keys()
    for joint, tip in a.skeleton.tips.items():
        np.testing.assert_array_equal(tip, b.skeleton.tips[joint])
    for part in ("root_positions", "rotations", "translations"):
        np.testing.assert_array_equal(getattr(a, part), getattr(b, part))
    assert list(a.curves) == list(b.curves)
    for name, values in a.curves.items():
        np.testing.assert_array_equal(values, b.curves[name])


def baked(clip: Clip) -> Clip:
    """The clip with detected contacts as curves, and one drawn by hand."""
    rig = find_rig(clip.skeleton)
    soles = all_sole_points(rig, *clip.model_pose())
    bent = clip.with_curves(bend=np.sin(clip.times) ** 3)
    return bake(bent, contacts(soles[:, :, :2], clip.fps), rig)


def walk() -> Clip:
    """The built-in walk with its curves and nothing else."""
    clip = builtin_motion("walk").clip
    return baked(replace(clip, curves={}, extras={}))


def amass(path: Path) -> Path:
    rng = np.random.default_rng(4)
    poses = 0.2 * rng.normal(size=(12, 156)).astype(np.float32)
    np.savez(path, poses=poses, trans=rng.normal(size=(12, 3)), fps=60.0)
    return path


def files_of(folder: Path) -> list[Path]:
    """All files of a folder, below it."""
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())


def again_and_again(clip: Clip, suffix: str, folder: Path) -> Clip:
    """Written, read, written and read: the second file is the first, byte by byte."""
    first, second = folder / "first", folder / "second"
    first.mkdir()
    second.mkdir()
    name = f"{clip.name}{suffix}"  # BVH holds none: a clip is called as its file is
    save_clip(clip, first / name)
    read = load_clip(first / name)
    save_clip(read, second / name)
    assert files_of(first) == files_of(second)
    for path in files_of(first):
        assert (first / path).read_bytes() == (second / path).read_bytes(), path
    back = load_clip(second / name)
    assert_same(read, back)
    return back


@pytest.mark.parametrize("suffix", [".bvh", ".glb", ".gltf", ".npz"])
def test_a_baked_clip_is_written_the_same_after_it_was_read(suffix: str, tmp_path: Path):
    clip = walk()
    back = again_and_again(clip, suffix, tmp_path)
    for name, values in clip.curves.items():
        np.testing.assert_array_equal(back.curves[name], values)
    np.testing.assert_allclose(back.model_pose()[0], clip.model_pose()[0], atol=1e-6)
    if suffix == ".npz":
        assert_same(clip, back)


@pytest.mark.parametrize("suffix", [".bvh", ".glb", ".gltf", ".npz"])
def test_the_keys_of_baked_curves_are_kept_as_keys(suffix: str, tmp_path: Path):
    clip = walk()
    back = again_and_again(clip, suffix, tmp_path)
    for name, keys in clip.extras[CURVE_KEYS].items():
        kept = back.extras[CURVE_KEYS][name]
        assert kept.interpolation == keys.interpolation
        for part in ("times", "values", "slopes"):
            np.testing.assert_array_equal(getattr(kept, part), getattr(keys, part))


@pytest.mark.parametrize("suffix", [".bvh", ".glb", ".npz"])
def test_one_curve_more_leaves_the_others_their_keys(suffix: str, tmp_path: Path):
    clip = again_and_again(walk(), suffix, tmp_path)
    more = clip.with_curves(more=np.cos(clip.times))
    save_clip(more, tmp_path / f"{clip.name}{suffix}")
    back = load_clip(tmp_path / f"{clip.name}{suffix}")
    assert list(back.curves) == [*clip.curves, "more"]
    for name, keys in clip.extras[CURVE_KEYS].items():
        assert len(back.extras[CURVE_KEYS][name]) == len(keys)
        np.testing.assert_array_equal(back.curves[name], clip.curves[name])


def test_amass_poses_go_into_our_own_archive_exactly(tmp_path: Path):
    clip = load_clip(amass(tmp_path / "poses.npz"))
    assert_same(clip, again_and_again(clip, ".npz", tmp_path))


def test_a_change_of_one_frame_changes_no_other_frame_in_any_format(tmp_path: Path):
    plain = replace(builtin_motion("walk").clip, curves={}, extras={}, loop=False)
    for suffix in (".bvh", ".glb", ".gltf", ".npz"):
        save_clip(plain, tmp_path / f"in{suffix}")
        clip = load_clip(tmp_path / f"in{suffix}")
        turns = clip.rotations.copy()
        turns[5, 3] = [0.8, 0.0, 0.6, 0.0]
        save_clip(replace(clip, rotations=turns), tmp_path / f"out{suffix}")
        back = load_clip(tmp_path / f"out{suffix}")
        others = np.arange(len(clip)) != 5
        np.testing.assert_array_equal(back.rotations[others], clip.rotations[others])
        np.testing.assert_array_equal(back.root_positions, clip.root_positions)
        sign = np.sign(back.rotations[5, 3, :1] * turns[5, 3, :1])
        np.testing.assert_allclose(sign * back.rotations[5, 3], turns[5, 3], atol=1e-7)


def _rows(path: Path, model: mujoco.MjModel) -> Path:
    return save(path, qpos=trajectory(model), fps=30.0, names=np.array(["a", "b"]))


def _csv(path: Path, model: mujoco.MjModel) -> Path:
    lines = [",".join(map(repr, row.tolist())) for row in trajectory(model)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(("make", "suffix"), [(_rows, ".npz"), (_csv, ".csv")])
def test_joint_values_are_written_as_they_were_read(
    make: Callable[[Path, mujoco.MjModel], Path], suffix: str, tmp_path: Path
):
    model = robot()
    path = make(tmp_path / f"in{suffix}", model)
    clip = read_qpos(path, model, fps=30.0)
    save_clip(clip, tmp_path / f"out{suffix}")
    assert (tmp_path / f"out{suffix}").read_bytes() == path.read_bytes()
    assert_same(clip, read_qpos(tmp_path / f"out{suffix}", model, fps=30.0))


@pytest.mark.parametrize("path", REAL or [None], ids=lambda path: path.name if path else "none")
def test_real_files_come_back_byte_by_byte_after_baking(path: Path | None, tmp_path: Path):
    if path is None:
        pytest.skip("FOOTIK_SHARED holds no data")
    clip = load_clip(path)
    with contextlib.suppress(FootIKError):  # one that is no walker has a curve all the same
        clip = baked(clip)
    bent = clip.with_curves(bend=np.sin(clip.times))
    again_and_again(replace(bent, name="clip"), path.suffix, tmp_path)
