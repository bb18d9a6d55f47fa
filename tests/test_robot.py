"""Robots: legs of hinges walk scenes by the same feet as any character, and tell what they miss."""

import os
import re
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from qpos_robot import beyond_limits, robot_xml, save, trajectory
from quadruped_robot import FPS, quadruped_xml, trot

from footik_runtime import FootIKError, HumanoidFootIK, cli, gait
from footik_runtime.character import CHARACTER_GROUP
from footik_runtime.crowd import Crowd
from footik_runtime.formats.qpos import read_qpos
from footik_runtime.hinge_character import HingeCharacter
from footik_runtime.hinge_pose import HingePose
from footik_runtime.hinge_values import hinge_motion, joint_values
from footik_runtime.metrics import score
from footik_runtime.phases import Phase
from footik_runtime.rig_model import find_rig_in_model
from footik_runtime.scene import Scene
from footik_runtime.score_scenes import score_scenes
from footik_runtime.score_suite import OPENKCC, OURS, WITHOUT, score_scene
from footik_runtime.sole import all_sole_points
from footik_runtime.terrain import Flat, Ramp, Terrain
from footik_runtime.walk import record_walk

SHARED = Path(os.environ.get("FOOTIK_SHARED") or Path(__file__).parents[1] / ".." / "shared")
STEEP = Terrain(name="steep", pieces=(Flat(length=5.0), Ramp(angle_deg=12.0, length=6.0)))


def shared(*names):
    files = [SHARED / "data" / name for name in names]
    if not all(file.exists() for file in files):
        pytest.skip(f"no shared data at {SHARED}: set FOOTIK_SHARED")
    return files


def biped(folder, ankle=0.9, name="biped.xml"):
    """File and motion of the generated robot, its ankles limited to +- ankle rad."""
    xml = robot_xml(spine='<joint name="spine" axis="0 0 1"/>')
    for part in ("pitch", "roll"):
        before = {"pitch": "-1 1", "roll": "-.6 .6"}[part]
        axis = {"pitch": 'axis="0 1 0" pos="0 0 .03"', "roll": 'axis="1 0 0"'}[part]
        xml = xml.replace(f'ankle_{part}" {axis} range="{before}"', f'ankle_{part}" {axis} '
                          f'range="{-ankle} {ankle}"')  # fmt: skip
    file = folder / name
    file.write_text(xml)
    model = mujoco.MjModel.from_xml_string(xml)
    return file, hinge_motion(gait.walk(find_rig_in_model(model), speed=0.8), model)


def hinged(scene: Scene) -> HingeCharacter:
    assert isinstance(scene.character, HingeCharacter)
    return scene.character


@pytest.fixture(scope="module")
def walker(tmp_path_factory):
    return biped(tmp_path_factory.mktemp("biped"))


@pytest.fixture(scope="module")
def stiff(tmp_path_factory):
    return biped(tmp_path_factory.mktemp("stiff"), ankle=0.1)


@pytest.fixture(scope="module")
def dog(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dog")
    file = folder / "dog.xml"
    file.write_text(quadruped_xml())
    model = mujoco.MjModel.from_xml_string(quadruped_xml())
    qpos = trot(model)
    assert beyond_limits(model, qpos) <= 0.0
    clip = save(folder / "trot.npz", qpos=qpos, fps=FPS)
    return file, hinge_motion(read_qpos(clip, model), model), clip


def test_a_scene_has_the_robots_own_joints_and_rays_do_not_see_it(walker):
    file, motion = walker
    alone = mujoco.MjModel.from_xml_path(str(file))
    scene = Scene.build(motion, "flat", body=file)
    assert isinstance(scene.character, HingeCharacter)
    for j in range(alone.njnt):
        ours = scene.model.joint(f"character/{alone.joint(j).name}").id
        np.testing.assert_array_equal(scene.model.jnt_range[ours], alone.jnt_range[j])
    theirs = np.isin(scene.model.geom_bodyid, scene.character.bodies)
    assert (scene.model.geom_group[theirs] == CHARACTER_GROUP).all()
    assert scene.ground().height(np.zeros((1, 3)), above=3.0, reach=9.0)[0] == pytest.approx(0.0)


def test_joint_values_of_a_clip_are_given_back(tmp_path):
    model = mujoco.MjModel.from_xml_string(robot_xml())
    qpos = trajectory(model)
    clip = read_qpos(save(tmp_path / "x.npz", qpos=qpos, fps=30.0), model)
    character = HingeCharacter.bind(model, find_rig_in_model(model))
    values = joint_values(character, clip)
    np.testing.assert_allclose(values, qpos[:, character.addresses], atol=1e-7)


def test_without_ik_the_robot_plays_its_own_joint_values(dog):
    file, motion, _ = dog
    scene = Scene.build(motion, "flat", body=file)
    crowd, pose = Crowd(motion, scene.ground()), scene.hinge_pose()
    assert pose is not None
    crowd.bodies["enabled"] = 0
    crowd.place(np.zeros(3))
    values = joint_values(hinged(scene), motion.clip)
    for frame in range(20):
        crowd.step(1.0 / motion.clip.fps if frame else 0.0)
        pose.write(scene.data, crowd, 1.0 / motion.clip.fps)
        np.testing.assert_allclose(pose.values, values[frame], atol=1e-9)


@pytest.mark.parametrize("terrain", ["flat", "slope", STEEP], ids=["flat", "slope", "steep"])
def test_planted_feet_stay_where_they_are(walker, terrain):
    file, motion = walker
    recording = record_walk(Scene.build(motion, terrain, body=file), seconds=5.0)
    figures = score(recording.run)
    assert figures["slip_max"] < 0.5  # mm
    assert figures["float"] < 1.0
    locked = recording.feet["locked"].astype(bool)
    assert locked[recording.phases != Phase.SWING].mean() > 0.6
    assert recording.feet["missing"][locked].max() < 2e-4


def test_what_is_recorded_is_where_mujoco_has_the_feet(stiff):
    file, motion = stiff
    scene = Scene.build(motion, STEEP, body=file)
    walker, rig = HumanoidFootIK(scene), motion.rig
    seen = []
    limits = scene.model.jnt_range
    for _ in range(240):
        walker.step(1.0 / 60.0)
        seen.append(scene.data.qpos.copy())
        ids = [
            scene.model.body(f"character/{rig.skeleton.names[leg.ankle]}").id for leg in rig.legs
        ]
        for foot, body in zip(walker.feet, ids, strict=True):
            np.testing.assert_allclose(foot.ankle_w, scene.data.xpos[body], atol=1e-9)
            if foot.locked:
                assert foot.missing < 2e-4
            if foot.reached:
                assert foot.turned_off < 1e-3
    assert limits.shape[0] == scene.model.njnt
    assert beyond_limits(scene.model, np.array(seen)) <= 0.0
    recorded = record_walk(Scene.build(motion, STEEP, body=file), seconds=4.0)
    assert recorded.run.joints is not None
    at, turn = recorded.run.joints[-1], recorded.feet[-1]["out"]
    np.testing.assert_allclose(at[[leg.ankle for leg in rig.legs]], turn, atol=1e-9)


def test_a_goal_beyond_the_limits_is_told_and_not_faked(stiff, walker):
    off = {}
    for name, (file, motion) in {"stiff": stiff, "free": walker}.items():
        scene = Scene.build(motion, STEEP, body=file)
        recording = record_walk(scene, seconds=6.0)
        standing = recording.feet["state"][-120:] == 1
        off[name] = float(recording.feet["turned_off"][-120:][standing].max())
        unreached = recording.feet["turned_off"] > 1e-3
        assert not recording.feet["reached"][unreached].any()
    assert off["stiff"] > np.radians(3.0)
    assert off["free"] < 0.5 * off["stiff"]


def test_joints_move_smoothly(walker):
    file, motion = walker
    scene = Scene.build(motion, "slope", body=file)
    controller = HumanoidFootIK(scene)
    fastest = 0.0
    for _ in range(300):
        before = scene.data.qpos.copy()
        controller.step(1.0 / 60.0)
        steps = scene.data.qpos[scene.character.addresses] - before[scene.character.addresses]
        fastest = max(fastest, float(np.abs(steps).max()))
    own = np.abs(np.diff(joint_values(hinged(scene), motion.clip), axis=0)).max()
    assert fastest < 3.0 * own


def test_a_leg_that_was_left_folded_unfolds_for_a_goal_in_reach(dog):
    file, motion, _ = dog
    scene = Scene.build(motion, "flat", body=file)
    crowd, pose = Crowd(motion, scene.ground()), HingePose(hinged(scene), motion)
    crowd.place(np.zeros(3))
    for frame in range(40):
        crowd.step(1.0 / 60.0 if frame else 0.0)
        if frame == 30:  # every hinge at a limit, from where no small step leads back
            pose._held.corrections[:] = [[side, 9.0, -9.0] for side in (9.0, -9.0, 9.0, -9.0)]
        pose.write(scene.data, crowd, 1.0 / 60.0 if frame else 0.0)
        assert crowd.feet["missing"].max() < 1e-4


def test_velocities_lead_from_pose_to_pose(walker):
    file, motion = walker
    scene = Scene.build(motion, "flat", body=file)
    controller = HumanoidFootIK(scene)
    for _ in range(5):
        before = scene.data.qpos.copy()
        controller.step(0.01)
        mujoco.mj_integratePos(scene.model, before, scene.data.qvel, 0.01)
        np.testing.assert_allclose(before, scene.data.qpos, atol=1e-9)


def test_point_feet_of_a_quadruped_stand_on_what_is_there(dog):
    file, motion, _ = dog
    assert motion.speed == pytest.approx(0.36, abs=0.03)
    scene = Scene.build(motion, STEEP, body=file)
    assert scene.character.legs["point"].all()
    recording = record_walk(scene, seconds=10.0)
    figures = score(recording.run)
    locked = recording.feet["locked"].astype(bool)
    assert locked[recording.phases != Phase.SWING].mean() > 0.8
    assert figures["slip_max"] < 0.1
    assert figures["penetration"] < 0.5
    assert recording.feet["turned_off"].max() < 1e-9  # how a ball is turned changes nothing


def test_a_standing_robot_stands(walker):
    file, _ = walker
    model = mujoco.MjModel.from_xml_path(str(file))
    still = hinge_motion(gait.idle(find_rig_in_model(model)), model)
    recording = record_walk(Scene.build(still, "slope", body=file), seconds=2.0)
    assert recording.feet["locked"][5:].all()
    assert score(recording.run)["slip_max"] < 0.5
    ankles = [leg.ankle for leg in still.rig.legs]
    assert recording.run.joints is not None
    assert np.ptp(recording.run.joints[5:, ankles], axis=0).max() < 1e-3


def test_fades_in_and_out_without_a_jump(walker):
    file, motion = walker
    scene = Scene.build(motion, STEEP, body=file)
    controller = HumanoidFootIK(scene)
    controller.place((4.0, 0.0, 0.4))
    largest, before = 0.0, None
    for frame in range(180):
        controller.enabled = not 60 <= frame < 120
        controller.step(1.0 / 60.0)
        values = scene.data.qpos[scene.character.addresses].copy()
        if before is not None:
            largest = max(largest, float(np.abs(values - before).max()))
        before = values
    assert largest < 0.4


def test_any_row_of_a_crowd_may_be_a_robot_and_runs_are_alike(walker):
    file, motion = walker
    scene = Scene.build(motion, "slope", body=file)
    both = []
    for _ in range(2):
        crowd, pose = Crowd(motion, scene.ground(), 2), HingePose(hinged(scene), motion)
        crowd.place([[0.0, 0.0, 0.0], [1.0, 0.5, 0.0]])
        for frame in range(30):
            crowd.step(1.0 / 60.0 if frame else 0.0)
            pose.write(scene.data, crowd, 1.0 / 60.0 if frame else 0.0, row=1)
        both.append(scene.data.qpos.copy())
    assert np.array_equal(*both)
    assert both[0][scene.character.root_address] == pytest.approx(crowd.roots[1, 0])


def test_soles_are_level_with_flat_ground(walker):
    _, motion = walker
    positions, rotations = motion.clip.model_pose()
    lowest = all_sole_points(motion.rig, positions, rotations)[..., 2].min()
    assert abs(lowest) < 0.01


def test_legs_that_are_not_of_hinges_are_refused_by_name():
    slide = robot_xml().replace('name="left_knee" axis', 'name="left_knee" type="slide" axis')
    model = mujoco.MjModel.from_xml_string(slide)
    with pytest.raises(FootIKError, match=r"left leg must be moved by hinges .* left_knee"):
        HingeCharacter.bind(model, find_rig_in_model(model))
    fixed = mujoco.MjModel.from_xml_string(robot_xml(root=""))
    with pytest.raises(FootIKError, match="'pelvis' must have a free joint"):
        HingeCharacter.bind(fixed, find_rig_in_model(fixed))


def test_the_documentations_robot_walks(monkeypatch, capsys, tmp_path, dog):
    file, _, clip = dog
    (tmp_path / "your_robot.xml").write_text(file.read_text())
    (tmp_path / "your_walk.npz").write_bytes(Path(clip).read_bytes())
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[1] / "docs" / "your-own-character.md").read_text("utf-8")
    (block,) = (b for b in re.findall(r"```python\n(.*?)```", page, re.S) if "hinge_motion" in b)
    exec(compile(block, "block", "exec"), {})
    assert "left_front" in capsys.readouterr().out


def test_walk_prints_what_limits_leave_of_the_goals(monkeypatch, capsys, dog):
    file, _, clip = dog
    arguments = ["walk", "--clip", clip, "--model", file, "--terrain", "slope", "--seconds", "3"]
    monkeypatch.setattr(sys, "argv", ["footik", *map(str, arguments)])
    cli.main()
    out = capsys.readouterr().out
    for row in ("goal missed, largest, mm", "goal missed on the ground, largest, mm",
                "foot turned off, largest, deg"):  # fmt: skip
        assert row in out


def test_a_suites_scene_is_walked_by_a_robot_in_every_mode(dog):
    file, motion, _ = dog
    (scene,) = (scene for scene in score_scenes() if scene.name == "slope 10 up")
    one = score_scene(scene, motion=motion, clip="trot", body=file)
    assert one.name == "slope 10 up: trot"
    assert one.figures[OURS]["slip_mean"] < 0.1
    assert one.figures[OURS]["penetration"] < one.figures[WITHOUT]["penetration"]
    assert one.figures[OURS]["pinned_point_speed"] < one.figures[OPENKCC]["pinned_point_speed"]


def test_score_takes_a_model_for_placement_alone(monkeypatch, dog):
    file, _, clip = dog
    arguments = ["score", "cleanup", "--clips", clip, "--model", file]
    monkeypatch.setattr(sys, "argv", ["footik", *map(str, arguments)])
    with pytest.raises(SystemExit):
        cli.main()


@pytest.mark.parametrize("terrain", ["flat", "slope"])
def test_a_robot_of_others_walks(terrain):
    xml, clip = shared("mjcf/go1_collision_only.xml", "npz/walk_straight.npz")
    model = mujoco.MjModel.from_xml_path(str(xml))
    motion = hinge_motion(read_qpos(clip, model).cut(0, 500), model)
    recording = record_walk(Scene.build(motion, terrain, body=xml), seconds=4.0)
    locked = recording.feet["locked"].astype(bool)
    assert locked[recording.phases != Phase.SWING].mean() > 0.9
    assert score(recording.run)["slip_max"] < 0.1


@pytest.mark.parametrize("name", ["g1_collision_only", "humanoid"])
def test_robots_of_others_walk_by_a_made_gait(name):
    (xml,) = shared(f"mjcf/{name}.xml")
    model = mujoco.MjModel.from_xml_path(str(xml))
    motion = hinge_motion(gait.walk(find_rig_in_model(model), speed=0.7), model)
    recording = record_walk(Scene.build(motion, "slope", body=xml), seconds=4.0)
    assert recording.feet["locked"][recording.phases != Phase.SWING].mean() > 0.6
    assert score(recording.run)["slip_max"] < 0.5
