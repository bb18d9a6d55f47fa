"""Joint values become clips that MuJoCo itself agrees with, and go back exactly."""

import os
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from qpos_robot import SLIDES, robot, same_turns, save, trajectory

from footik_runtime import quat_arrays as qa
from footik_runtime.formats.qpos import read_qpos, rig_of, write_qpos
from footik_runtime.formats.qpos_tree import HINGE, tree_of
from footik_runtime.offline.footplant_solve import leg_turns
from footik_runtime.offline.hinge_legs import Hinge, Link, solve_hinges

SHARED = Path(os.environ.get("FOOTIK_SHARED") or Path(__file__).parents[1] / ".." / "shared")


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
    roots = clip.root_positions + np.array([0.02, -0.01, 0.03])
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
