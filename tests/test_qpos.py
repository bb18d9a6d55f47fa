"""Joint values become clips that MuJoCo itself agrees with, and go back exactly."""

import io
import os
import zipfile
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footik_runtime import quat_arrays as qa
from footik_runtime.errors import FootIKError
from footik_runtime.formats.qpos import read_qpos, rig_of, write_qpos
from footik_runtime.formats.qpos_tree import HINGE, tree_of
from footik_runtime.offline.footplant_solve import leg_turns
from footik_runtime.offline.hinge_legs import Hinge, Link, solve_hinges

SHARED = Path(os.environ.get("FOOTIK_SHARED") or Path(__file__).parents[1] / ".." / "shared")


def leg(side, y):
    """Hip yaw, roll, pitch; knee; ankle pitch and roll: with anchors off the bodies' origins."""
    return f"""
    <body name="{side}_thigh" pos="0 {y} -.05">
      <joint name="{side}_hip_yaw" axis="0 0 1" range="-1 1"/>
      <joint name="{side}_hip_roll" axis="1 0 0" range="-1 1"/>
      <joint name="{side}_hip_pitch" axis="0 1 0" range="-2 2" ref=".1"/>
      <geom size=".05 .1" type="capsule" pos="0 0 -.15"/>
      <body name="{side}_shin" pos="0 0 -.4" quat="1 .02 .01 0">
        <joint name="{side}_knee" axis="0 1 0" pos="0 0 .02" range="-.1 2.6"/>
        <geom size=".04 .1" type="capsule" pos="0 0 -.15"/>
        <body name="{side}_foot" pos=".01 0 -.38">
          <joint name="{side}_ankle_pitch" axis="0 1 0" pos="0 0 .03" range="-1 1"/>
          <joint name="{side}_ankle_roll" axis="1 0 0" range="-.6 .6"/>
          <geom size=".1 .04 .02" type="box" pos=".04 0 -.04"/>
        </body>
      </body>
    </body>"""


SLIDES = """
  <joint name="root_x" type="slide" axis="1 0 0"/><joint name="root_y" type="slide" axis="0 1 0"/>
  <joint name="root_z" type="slide" axis="0 0 1"/><joint name="root_yaw" axis="0 0 1"/>
  <joint name="root_roll" axis="1 0 0"/><joint name="root_pitch" axis="0 1 0"/>"""


def robot(root='<freejoint name="root"/>', spine='<joint name="spine" type="ball"/>'):
    return mujoco.MjModel.from_xml_string(f"""
    <mujoco><compiler angle="radian" autolimits="true"/><worldbody>
      <body name="pelvis" pos="0 0 .9">{root}<geom size=".1"/>
        <body name="chest" pos="0 0 .2" quat="1 0 .1 0">{spine}<geom size=".12"/></body>
        {leg("left", 0.1)}{leg("right", -0.1)}
      </body></worldbody></mujoco>""")


def trajectory(model, frames=50, seed=0):
    """Smooth rows of qpos (T, nq) within the limits, legs bent."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None] / 30.0
    wave = np.sin(t * rng.uniform(1, 3, model.nq) + rng.uniform(0, 6, model.nq))
    qpos = model.qpos0 + 0.15 * wave
    for j in range(model.njnt):
        at = model.jnt_qposadr[j]
        if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE:
            turn = qa.euler(0.3 + 0.4 * wave[:, 3], 0.1 * wave[:, 4], 0.1 * wave[:, 5])
            qpos[:, at + 3 : at + 7] = turn
        elif model.jnt_type[j] == mujoco.mjtJoint.mjJNT_BALL:
            qpos[:, at : at + 4] = qa.from_rotvec(0.3 * wave[:, at : at + 3])
        elif "knee" in model.joint(j).name:
            qpos[:, at] += 0.5
    return qpos


def save(path, **arrays):
    np.savez(path, **arrays)
    return path


def body_places(model, qpos, names):
    data = mujoco.MjData(model)
    places, turns = [], []
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        ids = [model.body(name).id for name in names]
        places.append(data.xpos[ids].copy())
        turns.append(data.xquat[ids].copy())
    return np.array(places), np.array(turns)


def same_turns(a, b, tolerance):
    return (1.0 - np.abs(np.sum(a * b, axis=-1))).max() < tolerance


@pytest.fixture(params=["free", "slides"])
def model(request):
    return robot() if request.param == "free" else robot(SLIDES, '<joint name="spine"/>')


def test_bodies_are_where_mujoco_has_them(model, tmp_path):
    qpos = trajectory(model)
    clip = read_qpos(save(tmp_path / "x.npz", qpos=qpos, fps=30.0), model)
    assert (len(clip), clip.fps) == (50, 30.0)
    places, turns = clip.model_pose()
    xpos, xquat = body_places(model, qpos, clip.skeleton.names)
    np.testing.assert_allclose(places, xpos, atol=1e-12)
    assert same_turns(turns, xquat, 1e-12)
    rig = rig_of(clip)
    assert rig is not None
    assert [each.name for each in rig.legs] == ["left", "right"]


def test_what_is_read_is_written_to_the_last_bit(model, tmp_path):
    arrays = {
        "qpos": trajectory(model).astype(np.float32),
        "qvel": np.ones((50, model.nv)),
        "frequency": np.array(50.0),
        "split_points": np.array([0, 25, 50]),
        "names": np.array(["a", "b"]),
    }
    clip = read_qpos(save(tmp_path / "x.npz", **arrays), model)
    assert clip.fps == 50.0
    report = write_qpos(clip, tmp_path / "y.npz")
    assert report == {"legs": {}, "unreached_frames": 0, "stiff": []}
    with np.load(tmp_path / "y.npz") as back:
        assert back.files == list(arrays)
        for name, array in arrays.items():
            assert back[name].dtype == array.dtype
            assert np.array_equal(back[name], array)


def other_angles(clip, rows, seed=1):
    """The clip's qpos with the left leg at other angles in some rows."""
    source = clip.extras["qpos"]
    qpos = source.qpos.copy()
    rng = np.random.default_rng(seed)
    for joint in source.tree.named().values():
        if joint.kind == HINGE and joint.name.startswith("left"):
            qpos[rows, joint.column] += rng.uniform(-0.08, 0.08)
    return qpos


def test_a_leg_of_six_hinges_is_found_again_and_the_rest_stays(model, tmp_path):
    qpos = trajectory(model)
    clip = read_qpos(save(tmp_path / "x.npz", qpos=qpos, fps=30.0), model)
    rows = np.arange(20, 30)
    moved = other_angles(clip, rows)
    goal = read_qpos(save(tmp_path / "goal.npz", qpos=moved, fps=30.0), model)
    asked = replace(clip, rotations=goal.rotations, translations=goal.translations)
    report = write_qpos(asked, tmp_path / "y.npz")
    with np.load(tmp_path / "y.npz") as back:
        written = back["qpos"]
    np.testing.assert_allclose(written, moved, atol=1e-7)
    left = [j.column for n, j in tree_of(model).named().items() if n.startswith("left")]
    others = np.setdiff1d(np.arange(model.nq), left)
    assert np.array_equal(written[:, others], qpos[:, others])
    still = np.setdiff1d(np.arange(50), rows)
    assert np.array_equal(written[still], qpos[still])
    assert report["legs"]["left"]["largest_off"] < 1e-9
    assert report["unreached_frames"] == 0
    assert list(report["legs"]) == ["left"]


def test_velocities_of_rows_follow(tmp_path):
    model = robot()
    qpos = trajectory(model)
    arrays = {"qpos": qpos, "qvel": np.ones((50, model.nv)), "dt": 0.02}
    clip = read_qpos(save(tmp_path / "x.npz", **arrays), model)
    roots = clip.root_positions.copy()
    roots[20:30, 2] += 0.05 * np.hanning(10)
    write_qpos(replace(clip, root_positions=roots), tmp_path / "y.npz")
    with np.load(tmp_path / "y.npz") as back:
        added = back["qvel"] - 1.0
    np.testing.assert_allclose(added[:, 2], np.gradient(roots[:, 2] - qpos[:, 2]) * 50.0)
    assert not added[:, [0, 1, *range(3, model.nv)]].any()


def test_the_root_and_ball_joints_are_written_directly(tmp_path):
    model = robot()
    qpos = trajectory(model)
    clip = read_qpos(save(tmp_path / "x.npz", qpos=qpos, fps=30.0), model)
    roots = clip.root_positions.copy()
    roots[10:20, 2] -= 0.03
    rotations = clip.rotations.copy()
    chest = clip.skeleton.index("chest")
    rotations[5:9, chest] = qa.mul(rotations[5:9, chest], qa.about([1, 0, 0], 0.2))
    rotations[30:33, 0] = qa.mul(qa.about([0, 0, 1], 0.3), rotations[30:33, 0])
    asked = replace(clip, root_positions=roots, rotations=rotations)
    write_qpos(asked, tmp_path / "y.npz")
    back = read_qpos(tmp_path / "y.npz", model)
    places, turns = asked.model_pose()
    np.testing.assert_allclose(back.model_pose()[0], places, atol=1e-12)
    assert same_turns(back.model_pose()[1], turns, 1e-12)
    written, unchanged = back.extras["qpos"].qpos, [*range(5), 9, *range(20, 30)]
    assert np.array_equal(written[unchanged], qpos[unchanged])


def test_a_root_of_slides_and_hinges_follows_the_clip(tmp_path):
    model = robot(SLIDES, '<joint name="spine"/>')
    clip = read_qpos(save(tmp_path / "x.npz", qpos=trajectory(model), fps=30.0), model)
    roots = clip.root_positions + [0.02, -0.01, 0.03]
    rotations = clip.rotations.copy()
    rotations[:, 0] = qa.mul(qa.about([0, 0, 1], 0.2), rotations[:, 0])
    asked = replace(clip, root_positions=roots, rotations=rotations)
    write_qpos(asked, tmp_path / "y.npz")
    back = read_qpos(tmp_path / "y.npz", model)
    np.testing.assert_allclose(back.model_pose()[0], asked.model_pose()[0], atol=1e-9)


def test_a_goal_out_of_reach_is_told_and_stays_finite(tmp_path):
    model = robot()
    clip = read_qpos(save(tmp_path / "x.npz", qpos=trajectory(model), fps=30.0), model)
    moves = np.tile(clip.skeleton.offsets, (50, 1, 1))
    moves[:, clip.skeleton.index("left_shin"), 2] = -0.9  # no hinge makes a thigh longer
    rotations = clip.rotations.copy()
    thigh = clip.skeleton.index("left_thigh")
    rotations[7, thigh] = qa.mul(rotations[7, thigh], qa.about([0, 1, 0], 0.1))
    report = write_qpos(replace(clip, rotations=rotations, translations=moves), tmp_path / "y.npz")
    assert report["unreached_frames"] == 1
    assert report["legs"]["left"]["largest_off"] > 0.05
    with np.load(tmp_path / "y.npz") as back:
        knee = tree_of(model).named()["left_knee"]
        assert np.isfinite(back["qpos"]).all()
        assert back["qpos"][7, knee.column] >= knee.low - 1e-12


def test_what_no_joint_can_turn_is_told(tmp_path):
    model = robot(spine="")
    clip = read_qpos(save(tmp_path / "x.npz", qpos=trajectory(model), fps=30.0), model)
    rotations = clip.rotations.copy()
    chest = clip.skeleton.index("chest")
    rotations[:, chest] = qa.mul(rotations[:, chest], qa.about([1, 0, 0], 0.2))
    report = write_qpos(replace(clip, rotations=rotations), tmp_path / "y.npz")
    assert report["stiff"] == ["chest"]


angle = st.floats(-0.6, 0.6)


@given(st.lists(angle, min_size=6, max_size=6), st.lists(angle, min_size=6, max_size=6))
def test_six_hinges_reach_what_six_hinges_made(start, target):
    axes = np.eye(3)[[2, 0, 1, 1, 1, 0]]
    links = tuple(
        Link(
            offset=np.array([0.0, 0.0, 0.0 if i < 3 or i == 5 else -0.4]),
            turn=np.array([1.0, 0.0, 0.0, 0.0]),
            hinges=(Hinge(column=i, axis=axes[i], anchor=np.zeros(3), zero=0.0),),
        )
        for i in range(6)
    )
    shift = np.array([0.0, 0.0, 0.0, 0.8, 0.0, 0.0])  # knees bent: away from the singular pose
    made = np.array([target]) * 0.5 + shift
    place, turn = np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]])
    for i, link in enumerate(links):
        place = place + qa.rotate(turn, link.offset)
        turn = qa.mul(turn, qa.about(axes[i], made[:, i]))
    base = (np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]))
    limits = (np.full(6, -np.pi), np.full(6, np.pi))
    solved = solve_hinges(links, np.array([start]) * 0.5 + shift, base, (place, turn), limits)
    assert solved.off[0] < 1e-6
    assert solved.turned_off[0] < 1e-5


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
        np.stack([arrays[f"q_pelvis_t{x}"] for x in "xyz"], axis=-1) + [0, 0, 0.9],
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
    roots = clip.root_positions + [0.0, 0.0, 0.1]
    write_qpos(replace(clip, root_positions=roots), tmp_path / "z.csv")
    back = read_qpos(tmp_path / "z.csv", model, fps=clip.fps)
    np.testing.assert_array_equal(back.root_positions, roots)
    assert np.array_equal(back.extras["qpos"].qpos[:, 3:], clip.extras["qpos"].qpos[:, 3:])


# --- bad input ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"poses": np.zeros(3)}, "neither an array 'qpos' nor a q_NAME"),
        ({"qpos": np.zeros((5, 3)), "fps": 30.0}, "rows have 23 numbers"),
        ({"qpos": np.zeros((0, 23)), "fps": 30.0}, "has no frames"),
        ({"qpos": np.full((5, 23), np.nan), "fps": 30.0}, "not finite at frame 0"),
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


# --- robots' own data ---------------------------------------------------------------------------


@pytest.mark.skipif(not (SHARED / "data" / "npz").is_dir(), reason=f"no trajectories: {SHARED}")
@pytest.mark.parametrize(
    ("file", "robot_name", "legs"),
    [
        ("02-constspeed_UnitreeG1.npz", "g1_collision_only.xml", 2),
        ("walk_straight.npz", "go1_collision_only.xml", 4),
    ],
)
def test_robots_trajectories_are_read_and_written(tmp_path, file, robot_name, legs):
    path = SHARED / "data" / "npz" / file
    clip = read_qpos(path, SHARED / "data" / "mjcf" / robot_name)
    assert clip.fps == 500.0
    rig = rig_of(clip)
    assert rig is not None
    assert len(rig.legs) == legs
    write_qpos(clip, tmp_path / "same.npz")
    with np.load(path) as before, np.load(tmp_path / "same.npz") as after:
        assert before.files == after.files
        assert all(np.array_equal(before[name], after[name]) for name in before.files)
    # The body lowered by a centimetre, its feet held where they were by the hinges.
    frames = range(100, 160)
    roots = clip.root_positions.copy()
    roots[frames, 2] -= 0.01
    held = feet_held(clip, replace(clip, root_positions=roots), rig, frames)
    report = write_qpos(held, tmp_path / "low.npz")
    back = read_qpos(tmp_path / "low.npz", SHARED / "data" / "mjcf" / robot_name, fps=500.0)
    ankles = [leg.ankle for leg in rig.legs]
    off = np.abs(back.model_pose()[0][:, ankles] - held.model_pose()[0][:, ankles]).max()
    print(file, "ankles off by at most", off, "m;", report)
    assert off < 5e-4
    assert report["unreached_frames"] == 0


def feet_held(before, after, rig, frames):
    """Legs of `after` bent so that the ankles are where `before` has them."""
    places, turns = before.model_pose()
    moved, world = after.model_pose()
    rotations = after.rotations.copy()
    parents = after.skeleton.parents
    for each in rig.legs:
        for t in frames:
            hip, knee, ankle = (tuple(moved[t, j]) for j in (each.hip, each.knee, each.ankle))
            goal = tuple(places[t, each.ankle])
            upper, lower = leg_turns(hip, knee, ankle, goal, (0.0, -1.0, 0.0), 0.0)
            thigh = qa.mul(upper, world[t, each.hip])
            rotations[t, each.hip] = qa.mul(qa.conj(world[t, parents[each.hip]]), thigh)
            above = qa.mul(upper, world[t, parents[each.knee]])
            shin = qa.mul(lower, world[t, each.knee])
            rotations[t, each.knee] = qa.mul(qa.conj(above), shin)
            below = qa.mul(lower, world[t, parents[each.ankle]])
            rotations[t, each.ankle] = qa.mul(qa.conj(below), turns[t, each.ankle])
    return replace(after, rotations=rotations)
