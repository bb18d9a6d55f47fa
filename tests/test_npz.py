"""Clips as NumPy arrays: exact both ways, and one clear error for what is none."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from footik_runtime import gait
from footik_runtime.builtin import humanoid_rig
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.formats import load_clip, save_clip
from footik_runtime.formats.npz import read_npz, write_npz
from footik_runtime.offline.bake import bake
from footik_runtime.offline.curve_keys import CURVE_KEYS
from footik_runtime.offline.detect import contacts
from footik_runtime.sole import all_sole_points

RIG = humanoid_rig()


@pytest.fixture(scope="module")
def walk() -> Clip:
    clip = gait.walk(RIG, speed=1.2)
    moves = np.tile(clip.skeleton.offsets, (len(clip), 1, 1))
    made = Clip(
        skeleton=clip.skeleton,
        fps=clip.fps,
        root_positions=clip.root_positions,
        rotations=clip.rotations,
        translations=moves * 1.01,
        curves={"other": np.linspace(0.0, 1.0, len(clip))},
        loop=clip.loop,
        name="ein Gang",
        extras={"notes": ("found",)},
    )
    soles = all_sole_points(RIG, *made.model_pose())
    return bake(made, contacts(soles[:, :, :2], made.fps), RIG)


def test_a_clip_comes_back_to_the_last_bit(walk, tmp_path):
    save_clip(walk, tmp_path / "walk.npz")
    back = load_clip(tmp_path / "walk.npz")
    assert back.skeleton.names == walk.skeleton.names
    assert (back.name, back.fps, back.loop) == (walk.name, walk.fps, walk.loop)
    for part in ("root_positions", "rotations", "translations"):
        np.testing.assert_array_equal(getattr(back, part), getattr(walk, part))
    for part in ("parents", "offsets", "rest_rotations"):
        np.testing.assert_array_equal(getattr(back.skeleton, part), getattr(walk.skeleton, part))
    assert list(back.curves) == list(walk.curves)
    for name, values in walk.curves.items():
        np.testing.assert_array_equal(back.curves[name], values)
    assert set(back.extras[CURVE_KEYS]) == set(walk.extras[CURVE_KEYS])
    assert back.extras["notes"] == ["found"]
    write_npz(back, tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes()[:4] == b"PK\x03\x04"
    again = read_npz(tmp_path / "again.npz")
    np.testing.assert_array_equal(again.rotations, walk.rotations)


def arrays_of(clip: Clip, folder: Path) -> dict[str, np.ndarray]:
    write_npz(clip, folder / "whole.npz")
    with np.load(folder / "whole.npz") as held:
        return {name: held[name] for name in held.files}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"footik_clip": 9.0}, "is of version 9"),
        ({"rotations": None}, "array rotations is missing"),
        ({"rotations": np.zeros((3, 2, 4))}, "array rotations must be"),
        ({"offsets": np.array([["a"] * 3])}, "array offsets must be"),
        ({"fps": np.array([1.0, 2.0])}, "array fps must be one float"),
        ({"fps": -1.0}, "fps must be positive"),
        ({"extras": "[]"}, "extras is no JSON object"),
        ({"parents": "all -1"}, "is the only root"),
    ],
)
def test_a_broken_clip_is_one_error_that_names_the_array(walk, tmp_path, change, words):
    arrays = arrays_of(walk, tmp_path)
    for name, value in change.items():
        if isinstance(value, str) and value == "all -1":
            value = np.full(len(walk.skeleton), -1)
        if value is None:
            del arrays[name]
        else:
            arrays[name] = np.asarray(value)
    np.savez(tmp_path / "broken.npz", allow_pickle=False, **arrays)
    with pytest.raises(FootIKError, match=words):
        load_clip(tmp_path / "broken.npz")


def test_objects_and_bombs_are_refused(tmp_path):
    np.savez(tmp_path / "objects.npz", footik_clip=np.array([{}], dtype=object))
    with pytest.raises(FootIKError, match="Python objects"):
        read_npz(tmp_path / "objects.npz")
    np.savez_compressed(tmp_path / "bomb.npz", footik_clip=np.zeros(30_000_000))
    with pytest.raises(FootIKError, match="times its size"):
        read_npz(tmp_path / "bomb.npz")
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(FootIKError, match=r"need the MuJoCo model|broken|no clip"):
        load_clip(tmp_path / "other.npz")


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_damaged_archives_are_errors_of_ours(walk, tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("damaged")
    write_npz(walk, folder / "whole.npz")
    content = bytearray((folder / "whole.npz").read_bytes())
    for _ in range(data.draw(st.integers(1, 8))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = folder / "damaged.npz"
    path.write_bytes(bytes(content[: data.draw(st.integers(0, len(content)))]))
    with contextlib.suppress(FootIKError):
        load_clip(path)


def test_amass_has_legs_stands_on_the_floor_and_turns_as_its_poses_say(tmp_path):
    upright = np.full(3, 2.0 * np.pi / 3.0 / np.sqrt(3.0))  # SMPL's y to z, z to x, x to y
    poses = np.zeros((20, 156))
    poses[:, :3] = upright
    poses[:, 3 + 3 * 3] = np.linspace(0.0, 0.8, 20)  # left knee about SMPL's x, its left
    trans = np.tile([1.0, 2.0, 0.93], (20, 1))
    buffer = io.BytesIO()
    np.savez(buffer, poses=poses, trans=trans, mocap_framerate=120.0, betas=np.zeros(16))
    (tmp_path / "amass.npz").write_bytes(buffer.getvalue())
    clip = load_clip(tmp_path / "amass.npz")
    assert clip.fps == 120.0
    positions, _ = clip.model_pose()
    at = {name: positions[:, i] for i, name in enumerate(clip.skeleton.names)}
    assert (at["Head"][:, 2] > 1.3).all()
    assert at["L_Hip"][0, 1] > at["R_Hip"][0, 1]
    assert at["L_Foot"][0, 0] > at["L_Ankle"][0, 0]
    assert abs(at["R_Foot"][0, 2] - 0.02) < 0.02
    bent = at["L_Ankle"][-1] - at["L_Ankle"][0]
    assert bent[0] < -0.2, "the shin swings back"
    assert "no skeleton" in clip.extras["notes"][0]


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"poses": np.zeros((4, 10)), "trans": np.zeros((4, 3)), "fps": 30.0}, "poses must be"),
        ({"poses": np.zeros((4, 72)), "trans": np.zeros((3, 3)), "fps": 30.0}, "trans must be"),
        ({"poses": np.zeros((4, 72)), "trans": np.zeros((4, 3))}, "frame rate is missing"),
        ({"poses": np.zeros((4, 72)), "trans": np.zeros((4, 3)), "fps": 0.0}, "positive"),
        ({"poses": np.full((4, 72), np.nan), "trans": np.zeros((4, 3)), "fps": 30.0}, "finite"),
        (
            {"poses": np.full((4, 72), 5, np.float16), "trans": np.full((4, 3), "a"), "fps": 30.0},
            "finite",
        ),
        ({"poses": np.full((4, 72), 1e160), "trans": np.zeros((4, 3)), "fps": 30.0}, "beyond"),
    ],
)
def test_what_is_no_amass_archive_is_one_error(tmp_path, arrays, words):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(FootIKError, match=words):
        load_clip(tmp_path / "a.npz")
