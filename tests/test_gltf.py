"""glTF: joints, axes, units and keys as read; files as written, to the last byte and number.

The public validator is used where FOOTIK_GLTF_VALIDATOR names a folder that node finds
gltf-validator in (as after `npm install gltf-validator` there); benchmarks/validate_gltf.py fetches
it by itself.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gltf_files import Document, walker
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.formats import read_bvh
from footik_runtime.formats.glb_container import Gltf, read_container
from footik_runtime.formats.gltf import animation_names, read_animations, read_gltf
from footik_runtime.formats.gltf_write import write_gltf
from footik_runtime.quat_arrays import about, mul, to_rotvec
from footik_runtime.rig import find_rig
from footik_runtime.skeleton import Skeleton

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from validate_gltf import issues, sliding_walk, table  # pyright: ignore[reportMissingImports]

SHARED = Path(os.environ.get("FOOTIK_SHARED", Path(__file__).parents[1] / "../shared"))
FILES = {path.stem: path for path in sorted((SHARED / "data" / "gltf").glob("*.glb"))}
needs_shared = pytest.mark.skipif(not FILES, reason="FOOTIK_SHARED holds no data/gltf")
VALIDATOR = os.environ.get("FOOTIK_GLTF_VALIDATOR", "")
WALKS = {"Knight": "Walking_A", "CesiumMan": None, "Fox": "Walk", "greenman": "2_move"}
walks = pytest.mark.parametrize(("stem", "animation"), list(WALKS.items()))


def same(a: Clip, b: Clip) -> bool:
    """Whether two clips are equal to the last bit."""
    arrays = ("root_positions", "rotations", "translations")
    pairs = [(getattr(a, name), getattr(b, name)) for name in arrays]
    pairs += [(a.skeleton.offsets, b.skeleton.offsets)]
    pairs += [(a.skeleton.rest_rotations, b.skeleton.rest_rotations)]
    pairs += [(values, b.curves.get(name)) for name, values in a.curves.items()]
    equal = all(
        x is y if x is None or y is None else np.array_equal(np.asarray(x), np.asarray(y))
        for x, y in pairs
    )
    return equal and (a.fps, a.loop, a.curves.keys()) == (b.fps, b.loop, b.curves.keys())


def moved(clip: Clip, joint: int) -> Clip:
    """Frames 1 to 3 of one joint turned, the root moved in frame 2, a curve added."""
    turns, places = clip.rotations.copy(), clip.root_positions.copy()
    turns[1:4, joint] = mul(about([0.0, 1.0, 0.0], 0.2), turns[1:4, joint])
    places[2] += [0.01, -0.02, 0.03]
    weight = np.linspace(0.0, 1.0, len(clip)) ** 2
    held = replace(clip, rotations=turns, root_positions=places, loop=True)
    return held.with_curves(LeftFootIKWeight=weight)


# What is read ----------------------------------------------------------------------------------


def test_y_up_facing_z_becomes_z_up_facing_x(tmp_path: Path):
    clip = read_gltf(walker().glb(tmp_path / "clip.glb"))
    assert clip.skeleton.names == ("root", "hip", "knee", "ankle")
    np.testing.assert_array_equal(clip.skeleton.offsets[1], [0.0, 0.1, 0.9])  # +x is left
    np.testing.assert_array_equal(clip.skeleton.offsets[3], [0.05, 0.0, -0.4])
    times = np.arange(5) / 30
    np.testing.assert_allclose(clip.root_positions, times[:, None] * [1, 0, 0], atol=1e-7)
    expected = 0.4 * np.sin(7.0 * times)[:, None] * [0, 1, 0]  # about file x is about our y
    np.testing.assert_allclose(to_rotvec(clip.rotations[:, 1]), expected, atol=1e-7)
    assert (clip.fps, clip.name) == (30.0, "walk")


def test_still_ancestors_turn_scale_and_move_the_root(tmp_path: Path):
    plain = read_gltf(walker().glb(tmp_path / "plain.glb"))
    half = np.sqrt(0.5)
    for above in (
        {"rotation": [-half, 0, 0, half], "scale": [0.01] * 3, "translation": [3, 2, 1]},
        {"matrix": [0.01, 0, 0, 0, 0, 0, -0.01, 0, 0, 0.01, 0, 0, 3, 2, 1, 1]},
    ):
        document = walker()
        for node in document.json["nodes"]:  # in the armature z is up and the unit a centimetre
            x, y, z = node.get("translation", [0, 0, 0])
            node["translation"] = [100 * x, -100 * z, 100 * y]
        document.json["nodes"].append({"name": "Armature", "children": [0], **above})
        document.json["animations"] = []
        times = np.arange(5) / 30
        along = np.stack([0 * times, -100 * times, 0 * times], axis=1)
        document.animate((0, "translation", times, along))
        path = document.glb(tmp_path / "clip.glb")
        clip = read_gltf(path)
        assert clip.skeleton.names == plain.skeleton.names
        ours, theirs = clip.model_pose()[0], plain.skeleton.rest_pose()[0]
        shift = np.array([1.0, 3.0, 2.0]) + times[:, None] * [1, 0, 0]
        np.testing.assert_allclose(ours, theirs + shift[:, None], atol=1e-6)
        changed = moved(clip, 2)
        write_gltf(changed, path)
        again = read_gltf(path)
        np.testing.assert_allclose(again.root_positions, changed.root_positions, atol=1e-6)
        np.testing.assert_allclose(again.rotations, changed.rotations, atol=1e-6)


def test_a_joint_with_a_matrix_can_be_animated_afterwards(tmp_path: Path):
    document = walker()
    turn = Rotation.from_euler("xyz", [0.3, 0.2, 0.1])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn.as_matrix(), [0, -0.45, 0]
    document.json["nodes"][2] = {"name": "knee", "children": [3], "matrix": [*matrix.T.ravel()]}
    path = document.glb(tmp_path / "clip.glb")
    clip = read_gltf(path)
    w, x, y, z = clip.skeleton.rest_rotations[2]  # ours is file (z, x, y)
    expected = turn.as_quat(canonical=True)
    np.testing.assert_allclose([y, z, x, w], expected, atol=1e-12)
    changed = moved(clip, 2)
    write_gltf(changed, path)
    node = json.loads(json.dumps(read_container(path).item("nodes", 2)))
    assert "matrix" not in node
    np.testing.assert_allclose(read_gltf(path).rotations, changed.rotations, atol=1e-7)


@pytest.mark.parametrize("kind", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_keys_between_frames_are_joined_as_the_file_says(kind: str, tmp_path: Path):
    even = np.arange(7) / 10
    times = np.array([0.0, 0.2, 0.6])
    turns = Rotation.from_rotvec([[0, 0, 0], [0.8, 0.1, 0], [0.2, 0, 1.0]])
    moves = np.array([[0, 0, 0], [1, 2, 3], [2, 0, 1]], dtype=float)
    quats = turns.as_quat()
    values, rotations = moves, quats
    if kind == "CUBICSPLINE":
        slopes = np.ones_like(moves)
        values = np.stack([slopes, moves, slopes], axis=1).reshape(9, 3)
        rotations = np.stack([0 * quats, quats, 0 * quats], axis=1).reshape(9, 4)
    document = Document(walker().json["nodes"], [0, 1, 2, 3])
    document.animate(
        (0, "translation", times, values), (1, "rotation", times, rotations), kind=kind
    )
    clip = read_gltf(document.glb(tmp_path / "clip.glb"), fps=10)
    np.testing.assert_allclose(clip.root_positions[[0, 2, 6]], moves[:, [2, 0, 1]], atol=1e-6)
    k = np.array([0, 0, 1, 1, 1, 1, 2])
    u = ((even - times[k]) / np.array([0.2, 0.4, 1.0])[k])[:, None]
    follow = np.minimum(k + 1, 2)
    if kind == "STEP":
        expected, turned = moves[k], Rotation.from_quat(quats[k])
    elif kind == "LINEAR":
        expected, turned = moves[k] + u * (moves[follow] - moves[k]), Slerp(times, turns)(even)
    else:
        span = np.array([0.2, 0.4, 1.0])[k][:, None]
        h = [2 * u**3 - 3 * u**2 + 1, u**3 - 2 * u**2 + u, 3 * u**2 - 2 * u**3, u**3 - u**2]
        expected = h[0] * moves[k] + h[1] * span + h[2] * moves[follow] + h[3] * span
        turned = Rotation.from_quat(h[0] * quats[k] + h[2] * quats[follow])
    np.testing.assert_allclose(clip.root_positions, expected[:, [2, 0, 1]], atol=1e-6)
    ours = Rotation.from_quat(clip.rotations[:, 1][:, [2, 3, 1, 0]])  # back to the file's xyzw
    assert (ours.inv() * turned).magnitude().max() < 1e-6


def test_quaternions_that_change_their_sign_go_the_short_way(tmp_path: Path):
    document = Document(walker().json["nodes"], [0, 1, 2, 3])
    document.animate((1, "rotation", [0, 0.1, 0.2], [[0, 0, 0, 1], [0, 0, 0, -1], [0, 0, 0, 1]]))
    clip = read_gltf(document.glb(tmp_path / "clip.glb"), fps=20)
    np.testing.assert_allclose(clip.rotations[:, 1], np.tile([1, 0, 0, 0], (5, 1)), atol=1e-12)


@pytest.mark.parametrize("fps", [24.0, 25.0, 30000 / 1001, 30.0, 60.0, 120.0])
def test_the_rate_is_that_of_the_keys(fps: float, tmp_path: Path):
    frames = 400
    clip = read_gltf(walker(frames, fps).glb(tmp_path / "clip.glb"))
    assert (len(clip), clip.fps) == (frames, fps)
    assert clip.extras["gltf"].grid.exact


def test_thinned_keys_still_tell_their_frames(tmp_path: Path):
    frames = np.array([0, 2, 3, 7, 9, 12, 13, 20])
    document = Document(walker().json["nodes"], [0, 1, 2, 3])
    document.animate((0, "translation", frames / 30, np.tile(frames[:, None], (1, 3)) / 100))
    clip = read_gltf(document.glb(tmp_path / "clip.glb"))
    assert (len(clip), clip.fps) == (21, 30.0)
    np.testing.assert_allclose(clip.root_positions[:, 0], np.arange(21) / 100, atol=1e-8)


def test_keys_on_no_even_frames_are_sampled_and_noted(tmp_path: Path):
    times = np.cumsum(np.random.default_rng(3).uniform(0.02, 0.05, 40))
    document = Document(walker().json["nodes"], [0, 1, 2, 3])
    document.animate((0, "translation", times, np.tile(times[:, None], (1, 3))))
    clip = read_gltf(document.glb(tmp_path / "clip.glb"))
    assert "no even frames" in " ".join(clip.extras["notes"])
    expected = times[0] + np.arange(len(clip)) / clip.fps
    np.testing.assert_allclose(clip.root_positions[:, 0], expected, atol=1e-6)
    assert abs(expected[-1] - times[-1]) < 1e-6


def test_a_key_ages_away_is_refused_before_memory_is_taken(tmp_path: Path):
    document = Document(walker().json["nodes"], [0, 1, 2, 3])
    document.animate((0, "translation", [0, 0.01, 0.02, 1e9], np.zeros((4, 3))))
    with pytest.raises(FootIKError, match=r"at most \d+ are read"):
        read_gltf(document.glb(tmp_path / "clip.glb"))


def test_steps_of_size_are_noted_and_far_too_large_ones_are_centimetres(tmp_path: Path):
    document = walker()
    document.json["nodes"][0]["scale"] = [100, 100, 100]
    clip = read_gltf(document.glb(tmp_path / "clip.glb"))
    np.testing.assert_allclose(clip.skeleton.offsets[1], [0.0, 0.1, 0.9], atol=1e-12)
    assert "centimetres" in " ".join(clip.extras["notes"])
    assert read_gltf(tmp_path / "clip.glb", scale=1.0).skeleton.offsets[1, 2] == pytest.approx(90)
    with pytest.raises(FootIKError, match="scale must be positive"):
        read_gltf(tmp_path / "clip.glb", scale=0.0)


def test_odd_scales_are_noted(tmp_path: Path):
    document = walker()
    document.json["nodes"][1]["scale"] = [2, 1, 1]
    document.json["nodes"][2]["scale"] = [-1, 1, 1]
    document.json["nodes"][3]["scale"] = [0, 1, 1]
    notes = " ".join(read_gltf(document.glb(tmp_path / "clip.glb")).extras["notes"])
    assert "along each axis" in notes
    assert "mirroring" in notes
    assert "zero" in notes


def test_names_are_made_unique_and_never_empty(tmp_path: Path):
    document = walker()
    document.json["nodes"][2] = {"name": "hip", "children": [3]}
    del document.json["nodes"][3]["name"]
    clip = read_gltf(document.glb(tmp_path / "clip.glb"))
    assert clip.skeleton.names == ("root", "hip", "hip#2", "node_3")


def test_nodes_that_are_no_joints_stay_out(tmp_path: Path):
    document = walker()
    nodes = document.json["nodes"]
    nodes += [{"name": "camera"}, {"name": "mesh", "mesh": 0}, {"name": "scene", "children": [0]}]
    times = [0.0, 1.0]
    document.animate((4, "translation", times, np.zeros((2, 3))), (1, "rotation", *_still(times)))
    clip = read_gltf(document.glb(tmp_path / "clip.glb"), animation=1)
    assert clip.skeleton.names == ("root", "hip", "knee", "ankle")
    assert "'camera'" in " ".join(clip.extras["notes"])


def _still(times: list[float]) -> tuple[list[float], list[list[float]]]:
    return times, [[0.0, 0.0, 0.0, 1.0]] * len(times)


def test_an_animated_ancestor_of_the_skin_becomes_the_root(tmp_path: Path):
    document = walker()
    document.json["nodes"].append({"name": "mover", "children": [0]})
    times = np.arange(5) / 30
    document.animate((4, "translation", times, np.stack([times] * 3, axis=1)))
    clip = read_gltf(document.glb(tmp_path / "clip.glb"), animation=1)
    assert clip.skeleton.names[0] == "mover"
    np.testing.assert_allclose(clip.root_positions, np.stack([times] * 3, axis=1), atol=1e-7)


def test_animations_are_chosen_by_name_or_number(tmp_path: Path):
    document = walker()
    document.animate((1, "rotation", *_still([0.0, 1.0]))).animate(
        (1, "rotation", *_still([0.0, 1.0])), name="walk"
    )
    path = document.glb(tmp_path / "clip.glb")
    assert animation_names(path) == ["walk", "animation_1", "walk#2"]
    assert read_gltf(path, animation="walk#2").extras["gltf"].animation == 2
    assert read_gltf(path, animation="1").name == "clip"
    assert [clip.extras["gltf"].animation for clip in read_animations(path)] == [0, 1, 2]
    with pytest.raises(FootIKError, match=r"unknown animation 'wolk'\. Did you mean 'walk'"):
        read_gltf(path, animation="wolk")
    with pytest.raises(FootIKError, match="0 to 2"):
        read_gltf(path, animation=3)


def test_a_skin_is_chosen_by_name_or_number(tmp_path: Path):
    document = walker()
    document.json["skins"].append({"joints": [2, 3], "name": "shin"})
    path = document.glb(tmp_path / "clip.glb")
    assert len(read_gltf(path, skin="shin").skeleton) == 4  # animated ones above it too
    with pytest.raises(FootIKError, match=r"unknown skin 'shim'\. Did you mean 'shin'"):
        read_gltf(path, skin="shim")
    with pytest.raises(FootIKError, match="skin 5"):
        read_gltf(path, skin=5)


def broken(**changes: Any) -> Document:
    """A walker with members of its document replaced; a path such as nodes__1__children."""
    document = walker()
    for path, value in changes.items():
        *way, last = [int(step) if step.isdigit() else step for step in path.split("__")]
        owner: Any = document.json
        for step in way:
            owner = owner[step]
        owner[last] = value
    return document


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"animations": []}, "holds no animation"),
        ({"animations": 3}, "must be a list"),
        ({"nodes": []}, "no nodes"),
        ({"nodes__3__children": [1]}, r"nodes\[1\] is a child of"),
        ({"nodes__0__children": [], "nodes__3__children": [1]}, "its own ancestor"),
        ({"nodes__3__children": [9]}, "has a child 9"),
        ({"nodes__3__children": [None]}, "has a child"),
        ({"nodes__1": 5}, "must be an object"),
        ({"nodes__1__rotation": [0, 0, 0, 0]}, "zero length"),
        ({"nodes__1__translation": [0, 0]}, "must be 3 finite numbers"),
        ({"nodes__1__translation": [0, 0, 10**400]}, "must be 3 finite numbers"),
        ({"nodes__1__scale": [1e-13] * 3, "nodes__0__scale": [1e-9] * 3}, None),
        ({"nodes__1__matrix": [0] * 16}, None),
        ({"skins__0__joints": [99]}, "which is no node"),
        ({"skins__0__joints": []}, None),
        ({"animations__0__channels__0__sampler": 7}, "has sampler 7"),
        ({"animations__0__channels__0__target__node": 70}, r"nodes\[70\]"),
        ({"animations__0__channels__1__target": {"node": 0, "path": "translation"}}, "second one"),
        ({"animations__0__samplers__0__interpolation": "CUBIC"}, "CUBIC"),
        ({"animations__0__samplers__0__output": 0}, "needs an accessor of VEC3"),
        ({"animations__0__samplers__0__input": 3}, "needs an accessor of SCALAR"),
        ({"accessors__1__count": 3}, "5 times, but 3 values"),
        ({"animations__0__extras": {"footik_curves": {"curves": {"a": {}}}}}, "has no 'times'"),
        (
            {"animations__0__extras": {"footik_curves": {"curves": {"a": {"times": [0, 0]}}}}},
            "as many values",
        ),
    ],
)
def test_a_broken_document_is_told(changes, message, tmp_path: Path):
    path = broken(**changes).glb(tmp_path / "clip.glb")
    if message is None:
        assert np.isfinite(read_gltf(path).model_pose()[0]).all()
        return
    with pytest.raises(FootIKError, match=message) as caught:
        read_gltf(path)
    assert "clip.glb" in str(caught.value)


def test_times_that_do_not_grow_are_told(tmp_path: Path):
    for times in ([0.0, 0.1, 0.1], [-1.0, 0.0, 0.1], [0.2, 0.1, 0.3]):
        document = Document(walker().json["nodes"], [0, 1, 2, 3])
        document.animate((0, "translation", times, np.zeros((3, 3))))
        with pytest.raises(FootIKError, match="must grow from 0"):
            read_gltf(document.glb(tmp_path / "clip.glb"))


# What is written -------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_an_unchanged_clip_makes_an_identical_file(suffix: str, tmp_path: Path):
    document = walker()
    path = tmp_path / f"clip{suffix}"
    document.glb(path) if suffix == ".glb" else document.gltf(path)
    (tmp_path / "out").mkdir()
    write_gltf(read_gltf(path), tmp_path / "out" / path.name)
    assert (tmp_path / "out" / path.name).read_bytes() == path.read_bytes()
    if suffix == ".gltf":
        assert (tmp_path / "out" / "clip.bin").read_bytes() == document.data
    assert same(read_gltf(tmp_path / "out" / path.name), read_gltf(path))


@pytest.mark.parametrize("source", ["glb", "bin", "data"])
@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_a_changed_clip_is_read_back(source: str, suffix: str, tmp_path: Path):
    document = walker()
    path = tmp_path / ("in.glb" if source == "glb" else "in.gltf")
    if source == "glb":
        document.glb(path)
    else:
        document.gltf(path, embedded=source == "data")
    clip = read_gltf(path)
    changed = moved(clip, 2)
    (tmp_path / "out").mkdir()
    target = tmp_path / "out" / f"clip{suffix}"
    write_gltf(changed, target)
    again = read_gltf(target)
    np.testing.assert_allclose(again.rotations, changed.rotations, atol=1e-7)
    np.testing.assert_allclose(again.root_positions, changed.root_positions, atol=1e-8)
    np.testing.assert_array_equal(
        again.curves["LeftFootIKWeight"], changed.curves["LeftFootIKWeight"]
    )
    assert again.loop
    untouched = [0, 4]  # frames
    np.testing.assert_array_equal(again.rotations[untouched], clip.rotations[untouched])
    np.testing.assert_array_equal(
        again.root_positions[[0, 1, 3, 4]], clip.root_positions[[0, 1, 3, 4]]
    )
    write_gltf(again, tmp_path / "out" / f"twice{suffix}")
    assert (tmp_path / "out" / f"twice{suffix}").read_bytes() == target.read_bytes()


def test_what_a_gltf_names_is_copied_beside_it(tmp_path: Path):
    document = walker()
    document.json["images"] = [{"uri": "textures/skin%20a.png"}, {"uri": "data:,"}]
    (tmp_path / "in" / "textures").mkdir(parents=True)
    (tmp_path / "in" / "textures" / "skin a.png").write_bytes(b"picture")
    (tmp_path / "out").mkdir()
    write_gltf(
        moved(read_gltf(document.gltf(tmp_path / "in" / "a.gltf")), 1), tmp_path / "out/b.gltf"
    )
    assert (tmp_path / "out" / "textures" / "skin a.png").read_bytes() == b"picture"
    assert (tmp_path / "out" / "a.bin").read_bytes() == document.data


def test_several_animations_go_into_one_file(tmp_path: Path):
    document = walker()
    times = np.arange(5) / 30
    document.animate((0, "translation", times, np.stack([times] * 3, axis=1)), name="other")
    path = document.glb(tmp_path / "clip.glb")
    clips = [moved(clip, 1 + n) for n, clip in enumerate(read_animations(path))]
    write_gltf(clips, tmp_path / "out.glb")
    for clip, again in zip(clips, read_animations(tmp_path / "out.glb"), strict=True):
        np.testing.assert_allclose(again.rotations, clip.rotations, atol=1e-7)
    with pytest.raises(FootIKError, match="read from one glTF file"):
        write_gltf([clips[0], replace(clips[1], extras={})], tmp_path / "out.glb")
    with pytest.raises(FootIKError, match=r"ends in \.glb or \.gltf"):
        write_gltf(clips[0], tmp_path / "out.bvh")


def test_a_clip_of_other_frames_replaces_its_animation(tmp_path: Path):
    path = walker(20).glb(tmp_path / "clip.glb")
    clip = read_gltf(path)
    for other in (clip.cut(3, 9), replace(clip, fps=24.0)):
        write_gltf(other, tmp_path / "out.glb")
        again = read_gltf(tmp_path / "out.glb")
        assert (len(again), again.fps) == (len(other), other.fps)
        np.testing.assert_allclose(again.rotations, other.rotations, atol=1e-7)
        np.testing.assert_allclose(again.root_positions, other.root_positions, atol=1e-7)


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
@pytest.mark.parametrize("made_here", [False, True])
def test_cleaning_again_replaces_what_was_added_and_grows_nothing(suffix, made_here, tmp_path):
    document = walker(20)
    document.animate(
        (0, "translation", np.arange(20) / 30, np.zeros((20, 3))),
        (1, "rotation", *_still((np.arange(20) / 30).tolist())),
        name="other",
    )
    document.view(b"odd")
    path = document.glb(tmp_path / "in.glb")
    if made_here:
        write_gltf(replace(read_gltf(path), extras={}), path)
    names = animation_names(path)
    before = [bytes(read_container(path).buffer(0)), read_container(path).items("accessors")]
    sizes, counts = [], []
    for turn in range(4):
        for name in names:
            clip = read_gltf(path, animation=name)
            others = {n: read_gltf(path, animation=n) for n in names if n != name}
            # Each time something else: the joint that was turned before keeps its new channel.
            changed = moved(clip, 1 + turn % 2)
            path = tmp_path / f"out{turn}{name}{suffix}"
            write_gltf(changed, path)
            again = read_gltf(path, animation=name)
            np.testing.assert_allclose(again.rotations, changed.rotations, atol=1e-7)
            assert all(same(read_gltf(path, animation=n), kept) for n, kept in others.items())
        gltf = read_container(path)
        counts.append([len(gltf.items(k)) for k in ("accessors", "bufferViews", "buffers")])
        sizes.append(sum(owner["byteLength"] for owner in gltf.items("buffers")))
        if not made_here:
            assert bytes(gltf.buffer(0))[: len(before[0])] == before[0]
            assert gltf.items("accessors")[: len(before[1])] == before[1]
    assert counts[1:] == [counts[1]] * 3  # by then both joints have a channel
    assert sizes[1:] == [sizes[1]] * 3


def test_a_sampler_of_two_channels_is_not_shared_afterwards(tmp_path: Path):
    document = walker()
    channels = document.json["animations"][0]["channels"]
    channels.append({"sampler": 1, "target": {"node": 2, "path": "rotation"}})
    path = document.glb(tmp_path / "clip.glb")
    clip = read_gltf(path)
    write_gltf(moved(clip, 2), path)
    again = read_gltf(path)
    np.testing.assert_array_equal(again.rotations[:, 1], clip.rotations[:, 1])
    np.testing.assert_allclose(again.rotations[:, 2], moved(clip, 2).rotations[:, 2], atol=1e-7)


def test_what_is_added_lies_on_multiples_of_four_bytes(tmp_path: Path):
    document = walker()
    document.view(b"odd")
    path = document.glb(tmp_path / "clip.glb")
    write_gltf(moved(read_gltf(path), 2), path)
    gltf = read_container(path)
    views = gltf.items("bufferViews")
    assert all(view["byteOffset"] % 4 == 0 for view in views)
    assert bytes(gltf.buffer(0)[views[4]["byteOffset"] :][:3]) == b"odd"
    last = views[-1]
    assert last["byteOffset"] + last["byteLength"] == gltf.item("buffers", 0)["byteLength"]


def test_changed_quaternions_keep_the_sign_that_the_file_has_there(tmp_path: Path):
    document = Document(walker().json["nodes"], [0, 1, 2, 3])
    signs = np.array([1, 1, -1, -1, -1])[:, None]  # a jump, which clips do not keep
    document.animate((1, "rotation", np.arange(5) / 30, signs * [0, 0, 0, 1]))
    path = document.glb(tmp_path / "clip.glb")
    write_gltf(moved(read_gltf(path), 1), path)
    gltf = read_container(path)
    output = gltf.item("animations", 0)["samplers"][0]["output"]
    written = gltf.accessor(output, ("VEC4",), "the test")
    np.testing.assert_array_equal(np.sign(written[:, 3]), signs[:, 0])


def test_values_beyond_float32_are_refused(tmp_path: Path):
    clip = read_gltf(walker().glb(tmp_path / "clip.glb"))
    with pytest.raises(FootIKError, match="float32"):
        write_gltf(replace(clip, root_positions=clip.root_positions + 1e39), tmp_path / "out.glb")
    assert not (tmp_path / "out.glb").exists()


@example(9, 5, 24.0, 5)
@given(
    st.integers(1, 12),
    st.integers(1, 6),
    st.sampled_from([24.0, 30.0, 60.0, 120.0]),
    st.integers(0, 2**31),
)
@example(9, 5, 24.0, 5)  # one joint lies a few micrometres from its place at rest, all others far
@example(3, 5, 24.0, 1307)
def test_any_clip_makes_a_file_that_is_read_back(tmp_path_factory, frames, joints, fps, seed):
    folder = tmp_path_factory.mktemp("any")
    rng = np.random.default_rng(seed)
    skeleton = Skeleton(
        names=tuple(f"joint {j}" for j in range(joints)),
        parents=np.array([-1, *(int(rng.integers(0, j)) for j in range(1, joints))]),
        offsets=rng.normal(size=(joints, 3)),
        tips={joints - 1: rng.normal(size=3)},
    )
    turns = rng.normal(size=(frames, joints, 4))
    moves = np.tile(skeleton.offsets, (frames, 1, 1)) + 0.1 * rng.normal(size=(1, joints, 1))
    clip = Clip(
        skeleton=skeleton,
        fps=fps,
        root_positions=rng.normal(size=(frames, 3)),
        rotations=turns,
        translations=moves if seed % 2 else None,
        curves={"a": rng.integers(0, 2, frames).astype(float), "b": rng.normal(size=frames)},
        loop=bool(seed % 3),
    )
    write_gltf(clip, folder / "a.glb")
    again = read_gltf(folder / "a.glb")
    assert again.skeleton.names == skeleton.names
    assert again.fps == (fps if frames > 1 else 30.0)
    # The file holds single precision: what a joint is off by grows along the chain.
    reach = 1.0 + np.linalg.norm(moves if seed % 2 else skeleton.offsets, axis=-1).max() * joints
    off = np.abs(again.model_pose()[0] - clip.model_pose()[0]).max()
    assert off < 5e-7 * reach
    np.testing.assert_allclose(again.skeleton.tips[joints - 1], skeleton.tips[joints - 1])
    assert all(np.array_equal(again.curves[name], clip.curves[name]) for name in clip.curves)
    assert again.loop == clip.loop
    write_gltf(again, folder / "b.glb")
    assert same(read_gltf(folder / "b.glb"), again)


# Real files ------------------------------------------------------------------------------------


@needs_shared
@walks
def test_real_files_come_back_identical(stem: str, animation: str | None, tmp_path: Path):
    clip = read_gltf(FILES[stem], animation=animation)
    assert clip.extras["gltf"].grid.exact
    write_gltf(clip, tmp_path / "out.glb")
    assert (tmp_path / "out.glb").read_bytes() == FILES[stem].read_bytes()


def resources(gltf: Gltf) -> dict[str, Any]:
    """What of a file cleaning may not touch: all but its first animations, by what it holds."""
    document = gltf.json
    images = [view for image in document.get("images", []) if (view := image.get("bufferView"))]
    data = {
        n: bytes(gltf.buffer(0)[view.get("byteOffset", 0) :][: view["byteLength"]])
        for n, view in enumerate(document["bufferViews"])
    }
    names = ("meshes", "skins", "materials", "textures", "images", "nodes", "scenes", "samplers")
    return {
        **{name: document.get(name) for name in names},
        "animations": document["animations"],
        "accessors": document["accessors"],
        "views": data,
        "pictures": [data[view] for view in images],
    }


@needs_shared
@walks
def test_only_the_changed_animation_of_a_real_file_changes(stem, animation, tmp_path: Path):
    clip = read_gltf(FILES[stem], animation=animation)
    changed = moved(clip, len(clip.skeleton) // 2)
    write_gltf(changed, tmp_path / "out.glb")
    before, after = (resources(read_container(p)) for p in (FILES[stem], tmp_path / "out.glb"))
    index = clip.extras["gltf"].animation
    for part in before:
        if part in ("accessors", "animations"):
            continue
        if part == "views":
            assert all(after[part][n] == data for n, data in before[part].items())
        else:
            assert after[part] == before[part], part
    assert after["accessors"][: len(before["accessors"])] == before["accessors"]
    others = [n for n in range(len(before["animations"])) if n != index]
    assert all(after["animations"][n] == before["animations"][n] for n in others)
    again = read_gltf(tmp_path / "out.glb", animation=animation)
    np.testing.assert_allclose(again.rotations, changed.rotations, atol=1e-7)
    for frame in (0, 4, len(clip) - 1):
        np.testing.assert_array_equal(again.rotations[frame], clip.rotations[frame])
    write_gltf(again, tmp_path / "twice.glb")
    assert (tmp_path / "twice.glb").read_bytes() == (tmp_path / "out.glb").read_bytes()


@needs_shared
@pytest.mark.parametrize(
    ("stem", "knee", "leg_length"),
    [("Knight", "lowerleg.l", 0.38), ("CesiumMan", "leg_joint_L_2", 0.54)],
)
def test_the_rig_stands_upright_facing_x_on_the_ground(stem, knee, leg_length):
    clip = read_gltf(FILES[stem], animation=WALKS[stem])
    rig = find_rig(clip.skeleton)
    left, right = rig.legs
    assert (left.name, clip.skeleton.names[left.knee]) == ("left", knee)
    np.testing.assert_allclose(rig.forward, [1, 0, 0], atol=1e-3)
    np.testing.assert_allclose(rig.leg_lengths, leg_length, atol=0.01)
    places, _ = clip.model_pose()
    up = places[:, :, 2]
    assert 1.0 < up.max() < 1.5
    assert np.abs(up[:, [left.ankle, right.ankle]].min() - left.sole.height) < 0.03
    assert (places[:, left.hip, 1] > places[:, right.hip, 1] + 0.05).all()
    # Knees bend forward, and the feet swing along x, not y.
    middle = 0.5 * (places[:, left.hip] + places[:, left.ankle])
    assert (places[:, left.knee] - middle)[:, 0].max() > 0.05
    assert np.ptp(places[:, left.ankle, 0]) > 3 * np.ptp(places[:, left.ankle, 1])


@needs_shared
def test_all_animations_of_a_real_file_are_read():
    clips = list(read_animations(FILES["Knight"]))
    assert len(clips) == 76
    assert len({clip.name for clip in clips}) == 76
    assert all(clip.fps == 30.0 for clip in clips)
    for clip in clips:
        places, _ = clip.model_pose()
        assert np.isfinite(places).all()
        assert np.abs(places).max() < 5.0


@needs_shared
def test_a_motion_capture_clip_becomes_a_gltf_file(tmp_path: Path):
    source = read_bvh(sorted((SHARED / "data" / "bvh").glob("*walk*.bvh"))[0])
    write_gltf(source, tmp_path / "walk.gltf")
    again = read_gltf(tmp_path / "walk.gltf")
    assert again.fps == source.fps
    np.testing.assert_allclose(again.model_pose()[0], source.model_pose()[0], atol=1e-6)
    assert again.skeleton.tips.keys() == source.skeleton.tips.keys()


needs_validator = pytest.mark.skipif(
    not (VALIDATOR and shutil.which("node")),
    reason="FOOTIK_GLTF_VALIDATOR names no validator; benchmarks/validate_gltf.py fetches one",
)


@needs_validator
@needs_shared
@walks
def test_the_validator_finds_nothing_new(stem: str, animation: str | None, tmp_path: Path):
    clip = read_gltf(FILES[stem], animation=animation)
    before = issues(FILES[stem], Path(VALIDATOR))
    changed = moved(clip, len(clip.skeleton) // 2)
    for n, other in enumerate((changed, changed.cut(1, 5), replace(changed, extras={}))):
        for suffix in (".glb", ".gltf"):
            write_gltf(other, tmp_path / f"out{n}{suffix}")
            after = issues(tmp_path / f"out{n}{suffix}", Path(VALIDATOR))
            assert after == (before if n < 2 else Counter())


@needs_validator
@pytest.mark.parametrize("stem", ["sliding walk", *FILES])
def test_the_validator_finds_nothing_new_in_what_footik_clean_writes(stem: str, tmp_path: Path):
    path = FILES.get(stem) or sliding_walk(tmp_path)
    lines, worse = table([path], Path(VALIDATOR), tmp_path)
    assert worse == 0, lines
    if stem != "greenman":  # its legs have no feet
        gltf = read_container(tmp_path / f"cleaned {path.name}")
        curves = [a["extras"]["footik_curves"]["curves"] for a in gltf.items("animations")]
        assert all(any(name.endswith("IKWeight") for name in held) for held in curves)
