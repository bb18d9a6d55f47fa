"""Joint values in other layouts, and files that are none."""

import io
import warnings
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from qpos_robot import robot, same_turns, save, trajectory

from footik_runtime import quat_arrays as qa
from footik_runtime.errors import FootIKError
from footik_runtime.formats.qpos import read_qpos, write_qpos
from footik_runtime.formats.qpos_tree import HINGE, tree_of

# --- other layouts ------------------------------------------------------------------------------


def columns_of(model, frames=60, root="pelvis", fps=100.0, place=True):
    """A column a joint, as robots' imitation data have them, with velocities."""
    qpos = trajectory(model, frames)
    arrays = {}
    t = np.arange(frames) / fps
    if place:
        for i, part in enumerate(("tx", "tz", "ty", "tilt", "list", "rotation")):
            arrays[f"q_{root}_{part}"] = 0.1 * np.sin((1.0 + i) * t + i)
    for name, joint in tree_of(model).named().items():
        if joint.kind == HINGE:
            arrays[f"q_{name}"] = qpos[:, joint.column]
    return arrays | {f"d{n}": np.gradient(a) * fps for n, a in arrays.items()}


def test_columns_of_joints_are_read_and_written(tmp_path):
    model = robot()
    arrays = columns_of(model)
    clip = read_qpos(save(tmp_path / "x.npz", **arrays), model)
    source = clip.extras["qpos"]
    assert clip.fps == 100.0
    assert any("told from the velocities" in note for note in source.notes)
    np.testing.assert_allclose(
        clip.root_positions,
        np.stack([arrays[f"q_pelvis_t{x}"] for x in "xyz"], axis=-1) + np.array([0, 0, 0.9]),
    )
    turn = qa.about([0, 1, 0], arrays["q_pelvis_tilt"])
    turn = qa.mul(turn, qa.about([1, 0, 0], arrays["q_pelvis_list"]))
    turn = qa.mul(turn, qa.about([0, 0, 1], arrays["q_pelvis_rotation"]))
    assert same_turns(clip.rotations[:, 0], turn, 1e-12)
    write_qpos(clip, tmp_path / "same.npz")
    with np.load(tmp_path / "same.npz") as back:
        assert all(np.array_equal(back[name], array) for name, array in arrays.items())
    roots = clip.root_positions.copy()
    roots[20:40, 2] += 0.05 * np.hanning(20)
    rotations = clip.rotations.copy()
    rotations[50:, 0] = qa.mul(qa.about([0, 0, 1], 0.1), rotations[50:, 0])
    asked = replace(clip, root_positions=roots, rotations=rotations)
    write_qpos(asked, tmp_path / "y.npz")
    back = read_qpos(tmp_path / "y.npz", model)
    np.testing.assert_allclose(back.model_pose()[0], asked.model_pose()[0], atol=1e-12)
    written = back.extras["qpos"].table.arrays
    assert np.array_equal(written["q_pelvis_tx"], arrays["q_pelvis_tx"])
    assert np.array_equal(written["q_pelvis_tilt"][:50], arrays["q_pelvis_tilt"][:50])
    assert np.array_equal(written["dq_pelvis_tz"][:19], arrays["dq_pelvis_tz"][:19])
    speed = np.gradient(written["q_pelvis_tz"]) * 100.0
    np.testing.assert_allclose(written["dq_pelvis_tz"], speed, atol=1e-9)


def test_joints_that_only_one_side_has_are_told(tmp_path):
    model = robot()
    arrays = columns_of(model, place=False)
    del arrays["q_left_knee"], arrays["dq_left_knee"]
    clip = read_qpos(save(tmp_path / "x.npz", q_tail=np.zeros(60), **arrays), model)
    notes = " / ".join(clip.extras["qpos"].notes)
    assert "not of this model: tail" in notes
    assert "not in the file, left as in the model: left_knee" in notes


@pytest.mark.parametrize("header", [False, True])
@pytest.mark.parametrize("last", [False, True])
def test_tables_are_read_with_the_quaternion_in_either_order(tmp_path, header, last):
    model = robot()
    qpos = trajectory(model)
    table = qpos.copy()
    if last:
        table[:, 3:7] = np.roll(qpos[:, 3:7], -1, axis=-1)
    times = np.arange(50)[:, None] / 120.0
    names = ["time", *(f"c{i}" for i in range(model.nq))]
    rows = np.hstack([times, table]) if header else table
    path = tmp_path / "x.csv"
    lines = [",".join(map(repr, row.tolist())) for row in rows]
    path.write_text("\n".join([",".join(names)] * header + lines) + "\n")
    clip = read_qpos(path, model, fps=None if header else 30.0)
    assert clip.fps == (120.0 if header else 30.0)
    np.testing.assert_allclose(clip.extras["qpos"].qpos, qpos)
    assert bool(clip.extras["qpos"].notes) == last
    write_qpos(clip, tmp_path / "y.csv")
    assert (tmp_path / "y.csv").read_text() == path.read_text()
    roots = clip.root_positions + np.array([0.0, 0.0, 0.1])
    write_qpos(replace(clip, root_positions=roots), tmp_path / "z.csv")
    back = read_qpos(tmp_path / "z.csv", model, fps=clip.fps)
    np.testing.assert_array_equal(back.root_positions, roots)
    assert np.array_equal(back.extras["qpos"].qpos[:, 3:], clip.extras["qpos"].qpos[:, 3:])


@pytest.mark.parametrize("kind", ["U3", "c16"])
def test_velocities_of_columns_that_are_no_real_numbers_tell_no_rate(kind, tmp_path):
    model = robot()
    arrays = {n: a.astype(kind) if n[0] == "d" else a for n, a in columns_of(model).items()}
    path = save(tmp_path / "x.npz", **arrays)
    with pytest.raises(FootIKError, match="does not tell its frame rate"):
        read_qpos(path, model)
    clip = read_qpos(path, model, fps=100.0)
    write_qpos(replace(clip, root_positions=clip.root_positions + 0.1), tmp_path / "y.npz")
    with np.load(tmp_path / "y.npz") as back:
        np.testing.assert_array_equal(back["dq_pelvis_tx"], arrays["dq_pelvis_tx"])


def test_velocities_that_are_no_real_numbers_are_left_alone(tmp_path):
    model = robot()
    speeds = np.full((50, model.nv), 1.0 + 2.0j)
    clip = read_qpos(save(tmp_path / "x.npz", qpos=trajectory(model), qvel=speeds, fps=30.0), model)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_qpos(replace(clip, root_positions=clip.root_positions + 0.1), tmp_path / "y.npz")
    with np.load(tmp_path / "y.npz") as back:
        np.testing.assert_array_equal(back["qvel"], speeds)


# --- bad input ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"poses": np.zeros(3)}, "neither an array 'qpos' nor a q_NAME"),
        ({"qpos": np.zeros((5, 3)), "fps": 30.0}, "rows have 23 numbers"),
        ({"qpos": np.zeros((0, 23)), "fps": 30.0}, "has no frames"),
        ({"qpos": np.full((5, 23), np.nan), "fps": 30.0}, "not finite at frame 0"),
        ({"qpos": np.full((5, 23), 1e160), "fps": 30.0}, r"at frame 0, or beyond 1e\+15"),
        ({"qpos": np.zeros((5, 23), dtype="U3"), "fps": 30.0}, "of <U3"),
        ({"qpos": np.zeros((5, 23), dtype=object), "fps": 30.0}, "Python objects"),
        ({"qpos": np.ones((5, 23))}, "does not tell its frame rate"),
        ({"qpos": np.ones((5, 23)), "fps": -1.0}, "does not tell its frame rate"),
        ({"q_left_knee": np.zeros(5), "q_right_knee": np.zeros(4)}, "different lengths"),
        ({"q_left_knee": np.array(["a", "b"])}, "nor a q_NAME"),
    ],
)
def test_archives_that_are_no_trajectory_are_refused(tmp_path, arrays, message):
    with pytest.raises(FootIKError, match=message):
        read_qpos(save(tmp_path / "x.npz", **arrays), robot())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("a,b\n", "header but no rows"),
        ("1,2\n3\n", "row 2 has 1 cells, the first has 2"),
        ("1,2\n3,x\n", "row 2, column 1: 'x' is no number"),
        ("1,2\n3,nan\n", "'nan' is no number"),
        ("a,a\n1,2\n", "column 'a' is there twice"),
        ("1,2\n", "has 2 columns of joint values"),
        ('1,"2\n', "not a CSV table"),
    ],
)
def test_tables_that_are_no_trajectory_are_refused(tmp_path, text, message):
    (tmp_path / "x.csv").write_text(text)
    with pytest.raises(FootIKError, match=message):
        read_qpos(tmp_path / "x.csv", robot(), fps=30.0)


def test_what_cannot_be_read_or_written_is_refused(tmp_path):
    model = robot()
    with pytest.raises(FootIKError, match="cannot be read"):
        read_qpos(tmp_path / "none.npz", model)
    (tmp_path / "x.bvh").write_text("x")
    with pytest.raises(FootIKError, match=r"\.npz or \.csv files, not '\.bvh'"):
        read_qpos(tmp_path / "x.bvh", model)
    (tmp_path / "x.xml").write_text("<mujoco>")
    with pytest.raises(FootIKError, match="not a model that MuJoCo reads"):
        read_qpos(tmp_path / "x.npz", tmp_path / "x.xml")
    clip = read_qpos(save(tmp_path / "x.npz", qpos=trajectory(model), fps=30.0), model)
    with pytest.raises(FootIKError, match=r"came from a \.npz file"):
        write_qpos(clip, tmp_path / "x.csv")
    with pytest.raises(FootIKError, match="no longer those"):
        write_qpos(clip.cut(0, 10), tmp_path / "y.npz")
    with pytest.raises(FootIKError, match="only clips that were read from joint values"):
        write_qpos(replace(clip, extras={}), tmp_path / "y.npz")


def test_an_archive_that_lies_about_its_size_is_refused(tmp_path):
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("qpos.npy", b"\0" * (1 << 26))
    with pytest.raises(FootIKError, match="unpacks to more than 10 times"):
        read_qpos(path, robot())
    content = io.BytesIO()
    np.save(content, np.zeros((5, 23)))
    lying = content.getvalue().replace(b"(5, 23)", b"(999999999, 23)")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("qpos.npy", lying)
    with pytest.raises(FootIKError):
        read_qpos(path, robot())


@given(st.data())
def test_mutilated_files_raise_nothing_but_our_error(tmp_path_factory, data):
    model = robot()
    folder = tmp_path_factory.mktemp("fuzz")
    path = save(folder / "x.npz", qpos=trajectory(model, 8), fps=30.0)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    try:
        read_qpos(path, model)
    except FootIKError:
        return


@pytest.mark.filterwarnings("error")
def test_whole_numbers_become_real_ones_where_a_clip_is_written(tmp_path):
    model = robot()
    qpos = trajectory(model, 20)
    velocities = np.zeros((20, model.nv), dtype=np.int8)
    clip = read_qpos(save(tmp_path / "x.npz", qpos=qpos, qvel=velocities, fps=30.0), model)
    moved = replace(clip, root_positions=clip.root_positions + np.linspace(0, 900, 20)[:, None])
    write_qpos(moved, tmp_path / "y.npz")
    with np.load(tmp_path / "y.npz") as held:
        assert held["qvel"].dtype == np.float64
        assert np.abs(held["qvel"]).max() > 1000.0
        assert held["qpos"].dtype == np.float64
