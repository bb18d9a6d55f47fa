"""OpenKCC's behaviour in MuJoCo scenes: it walks, and it walks with OpenKCC's own faults."""

import functools
import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

from footik_runtime import gait
from footik_runtime.crowd import Crowd
from footik_runtime.feet.record import FOOT
from footik_runtime.ground import SceneGround
from footik_runtime.math3d import get4, quat_angle, quat_mul, quat_nlerp
from footik_runtime.motion import Motion
from footik_runtime.openkcc_rooms import cast_feet, openkcc_record
from footik_runtime.rig_model import find_rig_in_model
from footik_runtime.rooms import BLOCK
from footik_runtime.scene import Scene
from footik_runtime.settings import FootIKSettings
from footik_runtime.walk import record_walk

MODEL = Path(__file__).parents[1] / "models" / "humanoid.xml"
OPENKCC = FootIKSettings.openkcc()
DT = 1.0 / 60.0


@functools.cache
def rig():
    return find_rig_in_model(mujoco.MjModel.from_xml_path(str(MODEL)))


@functools.cache
def walking():
    return Motion.prepare(gait.walk(rig()), rig())


@functools.cache
def standing():
    return Motion.prepare(gait.idle(rig()), rig())


@functools.cache
def walked(terrain, behaviour="openkcc"):
    scene = Scene.build(walking(), terrain)
    return record_walk(scene, seconds=3.0, settings=FootIKSettings.preset(behaviour))


def largest_step(recording):
    return np.linalg.norm(np.diff(recording.run.ankle, axis=0), axis=-1).max()


class Slab:
    """A character that stands on one mocap slab, its top at z = 0."""

    def __init__(self, motion=None, count=1, settings=OPENKCC, **place):
        spec = mujoco.MjSpec()
        self.slab = spec.worldbody.add_body(name="slab", mocap=True, pos=[0.0, 0.0, -0.1])
        self.slab.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[5.0, 5.0, 0.1])
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        mujoco.mj_kinematics(self.model, self.data)
        self.ground = SceneGround(self.model, self.data)
        self.crowd = Crowd(motion or standing(), self.ground, count, settings=settings)

    def step(self, frames=1, dt=DT):
        for _ in range(frames):
            self.crowd.step(dt)

    def move(self, by=(0.0, 0.0, 0.0), yaw=0.0):
        self.data.mocap_pos[0] += by
        self.data.mocap_quat[0] = [math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)]
        mujoco.mj_kinematics(self.model, self.data)

    @property
    def own(self):
        assert self.crowd.openkcc is not None
        return self.crowd.openkcc.rows.feet[0]


# --- walks --------------------------------------------------------------------------------------


@pytest.mark.parametrize("terrain", ["flat", "stairs"])
def test_walk_is_finite_and_every_foot_is_grounded_and_released_in_turn(terrain):
    recording = walked(terrain)
    state = recording.feet["state"]
    assert np.isfinite(recording.rotations).all()
    assert np.isfinite(recording.feet["goal"]).all()
    assert state[1].all()  # it starts in double support
    _, feet = np.nonzero(np.diff(state[1:], axis=0) == 1)
    assert len(feet) >= 4
    assert (np.diff(feet) != 0).all()
    _, feet = np.nonzero(np.diff(state[1:], axis=0) == -1)
    assert len(feet) >= 4
    assert (np.diff(feet) != 0).all()


def test_feet_are_grounded_when_the_weight_curve_passes_one_half():
    motion = walking()
    # A rate that is not the clip's, so that frames fall between its frames.
    recording = record_walk(Scene.build(motion, "flat"), seconds=2.5, fps=144, settings=OPENKCC)
    bodies = recording.bodies
    row, part = bodies["frame"], bodies["part"][:, None]
    table = motion.timing["weight"]
    curve = table[row] * (1.0 - part) + table[row + 1] * part
    clear = np.abs(curve[1:] - 0.5) > 1e-6
    assert clear.mean() > 0.9
    assert np.ptp(curve) > 0.9
    np.testing.assert_array_equal(recording.feet["state"][1:][clear], (curve[1:] > 0.5)[clear])


def test_hips_drop_on_stairs_and_hardly_on_level_ground():
    assert walked("flat").bodies["hip_drop"].max() < 0.04
    drop = walked("stairs").bodies["hip_drop"]
    assert 0.08 < drop.max() <= OPENKCC.max_hip_drop
    assert drop.min() >= 0.0


def test_hips_joint_is_lowered_by_the_drop():
    recording = walked("stairs")
    without = record_walk(Scene.build(walking(), "stairs"), seconds=3.0, ik=False)
    lower = without.roots - recording.roots
    np.testing.assert_allclose(lower[:, 2], recording.bodies["hip_drop"], atol=1e-12)
    np.testing.assert_array_equal(lower[:, :2], 0.0)


def test_openkcc_reads_its_bones_where_the_last_frame_left_its_avatar():
    scene = Scene.build(walking(), "stairs")
    crowd = Crowd(walking(), scene.ground(), settings=OPENKCC)
    assert crowd.openkcc is not None
    drops = []
    for _ in range(150):
        before = crowd.bodies["hip_drop"][0]
        crowd.step(DT)
        drops.append(before)
        knees = crowd.block.at[0][[leg.knee for leg in rig().legs]]
        ankles = crowd.block.at[0][[leg.ankle for leg in rig().legs]]
        down = [0.0, 0.0, before]
        told = crowd.openkcc.rows.legs[0]
        np.testing.assert_allclose(told["knee"], knees - down, atol=1e-12)
        np.testing.assert_allclose(told["foot"], ankles - down, atol=1e-12)
        hips = crowd.openkcc.rows.frames[0]["hips"]
        np.testing.assert_allclose(hips, crowd.block.at[0][rig().hips] - down, atol=1e-12)
    assert max(drops) > 0.05


def test_two_runs_have_the_same_bits():
    first = walked("stairs")
    again = record_walk(Scene.build(walking(), "stairs"), seconds=3.0, settings=OPENKCC)
    assert first.roots.tobytes() == again.roots.tobytes()
    assert first.rotations.tobytes() == again.rotations.tobytes()
    for name in FOOT.names or ():
        assert first.feet[name].tobytes() == again.feet[name].tobytes(), name


def test_a_replanted_foot_jumps_as_in_openkcc_where_the_default_does_not():
    assert largest_step(walked("flat")) > 0.12
    assert largest_step(walked("flat")) > 2.0 * largest_step(walked("flat", "default"))


def test_a_placed_foot_slides_because_its_weight_only_tends_to_one():
    feet = walked("flat").feet
    contact = feet["state"] == 1
    assert feet["weight"].max() < 0.98
    first = np.nonzero(np.diff(contact[:, 0].astype(int)) == 1)[0][1] + 1
    during = slice(first, first + 15)
    assert contact[during, 0].all()
    assert (np.ptp(feet["hold"][during, 0], axis=0) == 0.0).all()
    assert np.ptp(feet["out"][during, 0], axis=0)[0] > 0.02


def test_behaviours_share_the_root_and_the_untouched_pose():
    scene = Scene.build(walking(), "stairs")
    a = record_walk(scene, seconds=1.0, ik=False, settings=OPENKCC.changed(ground_below=0.6))
    b = record_walk(scene, seconds=1.0, ik=False)
    assert a.roots.tobytes() == b.roots.tobytes()
    assert a.rotations.tobytes() == b.rotations.tobytes()


# --- what others look at ------------------------------------------------------------------------


def test_foot_records_tell_what_openkcc_does():
    scene = Slab()
    scene.step(90)
    shown, own = scene.crowd.feet[0], scene.own
    np.testing.assert_array_equal(shown["state"], own["state"])
    np.testing.assert_array_equal(shown["weight"], own["weight"])
    np.testing.assert_array_equal(shown["floor"], [0, 0])
    np.testing.assert_array_equal(shown["body"], [1, 1])
    np.testing.assert_allclose(
        shown["hold"] + scene.data.xpos[1], own["target_position"], atol=1e-12
    )
    ankle_height = own["target_position"][:, 2] + OPENKCC.foot_height
    np.testing.assert_allclose(shown["goal"][:, 2], ankle_height, atol=1e-3)


def test_a_foot_is_locked_only_when_grounded_at_rest_and_reached():
    scene = Slab(settings=OPENKCC.changed(foot_height=rig().legs[0].sole.height))
    scene.step(3)
    shown = scene.crowd.feet[0]
    assert shown["state"].all()
    assert not shown["locked"].any()
    assert (shown["pin"] == -1).all()
    scene.step(120)
    assert shown["locked"].all()
    assert shown["reached"].all()
    assert (shown["pin"] == 1).all()
    np.testing.assert_allclose(shown["out"], shown["goal"], atol=1e-5)


def test_goal_blends_from_the_animated_foot_to_the_target_by_the_weight():
    scene = Slab()
    scene.step(8)
    crowd, legs = scene.crowd, scene.crowd.tables.legs
    assert crowd.openkcc is not None
    for j, leg in enumerate(rig().legs):
        weight = scene.own["weight"][j]
        assert 0.05 < weight < 0.5
        sole = quat_mul(get4(crowd.block.turn[0, leg.ankle]), get4(legs[j]["frame"]))
        turn = quat_nlerp(sole, get4(scene.own["target_rotation"][j]), weight)
        assert quat_angle(turn, get4(crowd.feet[0, j]["goal_turn"])) < 1e-9
        target = scene.own["target_position"][j] + [0.0, 0.0, OPENKCC.foot_height]
        goal = (1.0 - weight) * crowd.openkcc.rows.legs[0, j]["foot"] + weight * target
        np.testing.assert_allclose(crowd.feet[0, j]["goal"], goal, atol=1e-12)


def test_turned_about_the_feet_bump_one_at_a_time_and_say_so():
    scene = Slab()
    scene.step(120)
    scene.crowd.bodies["yaw"] += math.radians(60.0)
    scene.step()
    assert scene.crowd.feet[0]["bump"].tolist() == [1, 0]
    scene.step(round((OPENKCC.stride_time + 0.05) / DT))
    assert scene.crowd.feet[0]["bump"].tolist() == [0, 1]
    scene.step(30)
    assert scene.crowd.feet[0]["bump"].tolist() == [0, 0]
    assert scene.own["bump"].tolist() == [1, 1]  # OpenKCC keeps its flag


# --- moving ground ------------------------------------------------------------------------------


def test_grounded_feet_follow_their_body_exactly():
    scene = Slab()
    scene.step(90)
    before = scene.own["target_position"].copy()
    scene.move(by=(0.03, -0.02, 0.01))
    scene.step()
    np.testing.assert_allclose(
        scene.own["target_position"] - before, [[0.03, -0.02, 0.01]] * 2, atol=1e-12
    )


def test_moves_below_a_millimetre_are_ignored_and_lost():
    scene = Slab()
    scene.step(90)
    before = scene.own["target_position"].copy()
    for _ in range(10):
        scene.move(by=(0.0009, 0.0, 0.0))
        scene.step()
    np.testing.assert_array_equal(scene.own["target_position"], before)


def test_feet_go_the_way_of_the_root_when_their_body_turns_and_never_turn_with_it():
    scene = Slab()
    scene.crowd.place(np.array([[2.0, 0.0, 0.0]]))
    scene.step(90)
    before, turn = scene.own["target_position"].copy(), scene.own["target_rotation"].copy()
    yaw = 0.05
    scene.move(yaw=yaw)
    scene.step()
    way = [2.0 * math.cos(yaw) - 2.0, 2.0 * math.sin(yaw), 0.0]
    np.testing.assert_allclose(scene.own["target_position"] - before, [way, way], atol=1e-9)
    np.testing.assert_allclose(scene.own["target_rotation"], turn, atol=1e-9)


def test_ground_that_sinks_out_of_reach_lets_both_feet_go():
    scene = Slab()
    scene.step(90)
    scene.move(by=(0.0, 0.0, -3.0))
    scene.step()
    assert (scene.own["state"] == 0).all()
    assert (scene.crowd.feet[0]["state"] == 0).all()
    assert (scene.crowd.feet[0]["body"] == 0).all()


def test_only_the_foot_whose_body_moved_follows():
    scene = Slab()
    scene.step(90)
    scene.crowd.feet[0]["body"] = [1, 0]
    before = scene.own["target_position"].copy()
    scene.move(by=(0.05, 0.0, 0.0))
    scene.step()
    np.testing.assert_allclose(
        scene.own["target_position"] - before, [[0.05, 0, 0], [0, 0, 0]], atol=1e-12
    )


# --- time, blocks, switches ---------------------------------------------------------------------


def test_a_frame_of_no_time_changes_nothing():
    scene = Slab()
    scene.step(1, dt=0.0)
    assert np.isfinite(scene.crowd.rotations).all()
    scene.step(20)
    own, rotations = scene.own.tobytes(), scene.crowd.rotations.copy()
    scene.step(5, dt=0.0)
    assert scene.own.tobytes() == own
    np.testing.assert_allclose(scene.crowd.rotations, rotations, atol=1e-12)
    scene.step(20)
    assert np.isfinite(scene.crowd.rotations).all()


def test_ground_that_moves_in_a_frame_of_no_time_is_followed_in_the_next():
    scene = Slab()
    scene.step(90)
    before = scene.own["target_position"].copy()
    scene.move(by=(0.05, 0.0, 0.0))
    scene.step(1, dt=0.0)
    scene.step()
    np.testing.assert_allclose(
        scene.own["target_position"] - before, [[0.05, 0.0, 0.0]] * 2, atol=1e-12
    )


def test_reset_begins_as_a_new_crowd_does():
    a, b = Slab(walking()), Slab(walking())
    a.step(40)
    a.crowd.place(np.zeros((1, 3)))
    a.crowd.bodies[:] = b.crowd.bodies
    a.step(30)
    b.step(30)
    assert a.own.tobytes() == b.own.tobytes()
    assert a.crowd.rotations.tobytes() == b.crowd.rotations.tobytes()


def test_every_row_of_several_blocks_walks_as_it_would_alone():
    many, one = Slab(walking(), count=BLOCK + 3), Slab(walking())
    many.step(40)
    one.step(40)
    for row in (0, 1, BLOCK - 1, BLOCK, BLOCK + 2):
        assert many.crowd.rotations[row].tobytes() == one.crowd.rotations[0].tobytes()
        assert many.crowd.feet[row].tobytes() == one.crowd.feet[0].tobytes()


def test_a_row_switched_off_shows_the_animation_and_begins_anew_when_switched_on():
    scene = Slab()
    scene.step(90)
    scene.crowd.bodies["enabled"] = 0
    scene.step(2)
    assert not scene.own["state"].any()
    untouched = scene.crowd.motion.rotations[1:, rig().legs[0].knee]
    knee = scene.crowd.rotations[0, rig().legs[0].knee]
    assert np.abs(untouched - knee).max(axis=1).min() < 1e-2
    scene.crowd.bodies["enabled"] = 1
    scene.step()
    assert scene.own["state"].all()
    assert (scene.own["weight"] < 0.1).all()


class LevelGround:
    """The plane z = 0, which is no scene."""

    def cast(self, probes, hits):
        for probe, hit in zip(probes, hits, strict=True):
            height, down = probe["origin"][2], -probe["direction"][2]
            if probe["active"] and height >= 0.0 and 0.0 <= height <= probe["length"] * down:
                hit["hit"], hit["geom"], hit["body"] = 1, 0, 0
                hit["distance"] = height / down
                hit["point"] = probe["origin"] + hit["distance"] * probe["direction"]
                hit["normal"] = [0.0, 0.0, 1.0]


def test_any_ground_that_answers_rays_will_do():
    crowd = Crowd(walking(), LevelGround(), settings=OPENKCC)
    scene = Slab(walking())
    for _ in range(40):
        crowd.step(DT)
    scene.step(40)
    np.testing.assert_allclose(crowd.rotations, scene.crowd.rotations, atol=1e-9)
    np.testing.assert_allclose(crowd.roots, scene.crowd.roots, atol=1e-9)


def test_a_probe_that_is_not_cast_is_answered_by_a_miss():
    scene = Slab()
    scene.step(10)
    assert scene.crowd.openkcc is not None
    rows = scene.crowd.openkcc.rows
    assert rows.hits["hit"].any()
    rows.probes["active"] = 0
    cast_feet(rows, scene.ground)
    assert not rows.hits["hit"].any()
    assert (rows.hits["geom"] == -1).all()


def test_settings_are_openkccs_own_unscaled():
    record = openkcc_record(OPENKCC)[0]
    expected = {
        "ground_check_distance": 1.5,
        "step_height": 0.1,
        "stride_threshold_distance": 0.75,
        "stride_threshold_angle": math.radians(45.0),
        "stride_time": 0.25,
        "foot_grounded_height": 0.05,
        "max_hip_foot_distance": 0.85,
        "max_hip_offset": 0.45,
        "hip_smooth_time": 0.35,
        "overlap_blend_time": 0.05,
        "correct_for_overlap": 1,
    }
    assert {name: record[name] for name in record.dtype.names} == pytest.approx(expected)
    assert openkcc_record(OPENKCC.changed(correct_overlap=False))["correct_for_overlap"] == 0


def test_the_default_behaviour_has_no_openkcc_rooms():
    assert Slab(settings=FootIKSettings()).crowd.openkcc is None
