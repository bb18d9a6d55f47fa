"""What a foot placer must have, feature by feature, on the real MuJoCo scene."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from footik_runtime.balance import convex_hull, margin_in
from footik_runtime.builtin import HUMANOID, builtin_motion
from footik_runtime.clip import Clip
from footik_runtime.crowd import Crowd
from footik_runtime.errors import FootIKError
from footik_runtime.ground import SceneGround
from footik_runtime.humanoid import HumanoidFootIK
from footik_runtime.motion import Motion
from footik_runtime.phases import lock_curve
from footik_runtime.quat_arrays import rotate
from footik_runtime.scene import Scene
from footik_runtime.settings import FootIKSettings
from footik_runtime.sole import all_sole_points
from footik_runtime.terrain import BEGIN, Flat, SideSlope, Terrain

DT = 1.0 / 60.0
UP = np.array([0.0, 0.0, 1.0])


def flat() -> Terrain:
    return Terrain(name="flat", pieces=(Flat(length=30.0),))


def standing(settings: FootIKSettings | None = None, gait: str = "idle", **given) -> HumanoidFootIK:
    terrain = given.pop("terrain", flat())
    passed = given.pop("passed", ())
    scene = Scene.build(builtin_motion(gait), terrain, body=HUMANOID, **given)
    return HumanoidFootIK(scene, settings=settings, passed=passed)


def run(ik: HumanoidFootIK, seconds: float) -> np.ndarray:
    """(T, legs, 3, 3) the sole points frame by frame."""
    out = []
    for _ in range(round(seconds / DT)):
        ik.step(DT)
        out.append(soles(ik))
    return np.array(out)


def soles(ik: HumanoidFootIK) -> np.ndarray:
    rig = ik.scene.motion.rig
    roots, turns = ik.crowd.roots[:1], ik.crowd.rotations[:1]
    return all_sole_points(rig, *rig.skeleton.forward(turns, roots))[0]


def box(name: str, size, at, group: int = 0):
    def add(spec: mujoco.MjSpec) -> None:
        geom = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=at)
        geom.name, geom.group = name, group

    return add


LEFT_BOX = ([0.5, 0.1, 0.05], [0.0, 0.13, 0.05])


# --- plant foot ---------------------------------------------------------------------------------


def test_a_planted_foot_keeps_its_place_and_rotation_while_the_animation_moves_on() -> None:
    ik = standing()
    run(ik, 0.5)
    ik.command((0.1, 0.0))
    taken = run(ik, 1.0)
    # The ball to the bit; a heel may rise a little before the hips have followed.
    assert (np.ptp(taken[:, :, 1:], axis=0) < 1e-9).all()
    assert (np.ptp(taken, axis=0) < 5e-3).all()
    assert ik.root_w[0] > 0.09


def test_a_planted_foot_still_follows_the_height_of_its_ground() -> None:
    def lift(spec: mujoco.MjSpec) -> None:
        body = spec.worldbody.add_body(name="lift", pos=[0.0, 0.0, -0.05], mocap=True)
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[1.0, 1.0, 0.1])

    ik = standing(loose=lift)
    run(ik, 0.5)
    ik.scene.data.mocap_pos[0, 2] += 0.06
    mujoco.mj_kinematics(ik.scene.model, ik.scene.data)
    taken = run(ik, 1.5)
    assert taken[-1, :, :, 2] == pytest.approx(np.full((2, 3), 0.11), abs=2e-3)


# --- plant blend weight -------------------------------------------------------------------------


def test_a_plant_weight_is_set_and_read_back_and_at_0_the_foot_goes_with_the_animation() -> None:
    ik = standing()
    run(ik, 0.5)
    ik.command((0.25, 0.0))
    left = ik.foot("left")
    left.plant_weight = 0.0
    assert left.plant_weight == 0.0
    before = soles(ik)
    run(ik, 0.6)
    moved = soles(ik) - before
    assert moved[0, :, 0] == pytest.approx(np.full(3, 0.15), abs=0.02)
    assert np.abs(moved[1, 1:]).max() < 1e-9
    assert np.abs(soles(ik)[0, :, 2]).max() < 1e-3
    assert not left.locked


def test_a_plant_weight_fades_at_its_speed_and_without_a_jump() -> None:
    ik = standing()
    run(ik, 0.5)
    ik.command((0.25, 0.0))
    run(ik, 0.4)
    ik.foot("left").fade_plant(0.0, speed=2.0)
    taken = run(ik, 0.25)
    assert ik.foot("left").plant_weight == pytest.approx(0.5)
    taken = np.concatenate([taken, run(ik, 0.5)])
    assert ik.foot("left").plant_weight == 0.0
    assert np.linalg.norm(np.diff(taken[:, 0], axis=0), axis=-1).max() < 0.02


@pytest.mark.parametrize("wrong", [-0.1, 1.1, float("nan"), "all"])
def test_a_plant_weight_that_is_none_is_an_error(wrong) -> None:
    with pytest.raises(FootIKError, match="plant weight"):
        standing().foot("left").plant_weight = wrong


# --- locks --------------------------------------------------------------------------------------


def turned_lock(lock: str) -> tuple[np.ndarray, np.ndarray]:
    """The left foot's sole points before and after the animation turned 0.3 rad over it."""
    ik = standing(FootIKSettings().changed(lock=lock))
    run(ik, 0.5)
    before = soles(ik)[0]
    ik.command((0.0, 0.0), 0.3)
    run(ik, 1.0)
    return before, soles(ik)[0]


def heading(points: np.ndarray) -> float:
    ahead = points[1] - points[0]
    return float(np.arctan2(ahead[1], ahead[0]))


def test_a_full_lock_holds_every_point_of_the_sole() -> None:
    before, after = turned_lock("full")
    assert np.abs(after - before).max() < 5e-4


def test_a_ball_pivot_holds_the_ball_and_turns_with_the_animation() -> None:
    before, after = turned_lock("ball")
    assert after[1] == pytest.approx(before[1], abs=1e-6)
    assert heading(after) - heading(before) == pytest.approx(0.3, abs=0.03)


def test_an_ankle_pivot_holds_the_place_under_the_ankle_and_turns() -> None:
    before, after = turned_lock("ankle")
    assert heading(after) - heading(before) == pytest.approx(0.3, abs=0.03)
    assert np.linalg.norm(after[1] - before[1]) > 0.02


def test_an_unlocked_foot_follows_the_ground_under_the_animation() -> None:
    ik = standing(FootIKSettings(lock="unlocked"), terrain="hills")
    ik.command((0.3, 0.0))
    taken = run(ik, 3.0)
    assert np.ptp(taken[:, 0, 1, 0]) > 0.8
    ground = ik.scene.ground(ik.settings.groups).height(soles(ik))
    assert np.abs(soles(ik)[..., 2] - ground).max() < 0.015


def test_locks_are_chosen_by_a_curve_of_the_clip() -> None:
    motion = builtin_motion("idle")
    curves = {lock_curve(leg.name): np.full(len(motion.clip), 1.0) for leg in motion.rig.legs}
    clip: Clip = motion.clip.with_curves(**curves)
    ik = HumanoidFootIK(Scene.build(Motion.prepare(clip, motion.rig), flat(), body=HUMANOID))
    ik.step(DT)
    assert [foot.lock for foot in ik.feet] == ["ball", "ball"]


def test_a_lock_curve_of_other_values_is_an_error_that_says_where() -> None:
    motion = builtin_motion("idle")
    curve = np.zeros(len(motion.clip))
    curve[3] = 7.0
    clip = motion.clip.with_curves(**{lock_curve("left"): curve})
    with pytest.raises(FootIKError, match="LeftFootLock is 7 in frame 3"):
        Motion.prepare(clip, motion.rig)


def test_a_planted_foot_is_not_twisted_further_than_the_limit() -> None:
    ik = standing(FootIKSettings(max_twist_deg=10.0, stride_angle_deg=170.0))
    run(ik, 0.5)
    before = heading(soles(ik)[0])
    ik.command((0.0, 0.0), 0.4)
    run(ik, 1.0)
    assert heading(soles(ik)[0]) - before == pytest.approx(0.4 - np.radians(10.0), abs=0.03)


# --- set active, transition time ----------------------------------------------------------------


def test_each_foot_is_switched_off_and_on_by_itself_within_the_transition_time() -> None:
    ik = standing(FootIKSettings(blend_time=0.4), loose=box("box", *LEFT_BOX))
    run(ik, 1.0)
    left = ik.foot("left")
    assert soles(ik)[0, 1, 2] == pytest.approx(0.1, abs=2e-3)
    left.active = False
    assert not left.active
    down = run(ik, 0.5)
    assert down[11, 0, 1, 2] == pytest.approx(0.05, abs=0.02)  # half way at half the time
    assert down[-1, 0, 1, 2] == pytest.approx(0.0, abs=5e-3)
    assert left.state == "released"
    assert np.abs(down[:, 1, :, 2]).max() < 5e-3
    left.active = True
    up = run(ik, 0.6)
    assert up[-1, 0, 1, 2] == pytest.approx(0.1, abs=2e-3)
    both = np.concatenate([down, up])
    assert np.linalg.norm(np.diff(both, axis=0), axis=-1).max() < 0.02


def test_feet_that_are_off_are_to_the_bit_as_they_are_animated() -> None:
    ik, plain = standing(gait="walk"), standing(gait="walk")
    plain.enabled = False
    plain.crowd.bodies["blend"] = 0.0
    for foot in ik.feet:
        foot.active = False
    run(ik, 2.0)
    run(plain, 2.0)
    ik.crowd.bodies["root"], plain.crowd.bodies["root"] = 0.0, 0.0
    ik.step(0.0)
    plain.step(0.0)
    assert ik.crowd.rotations.tobytes() == plain.crowd.rotations.tobytes()


# --- rays: reach, layers, drawing ---------------------------------------------------------------


def reach_of(mode: str, gait: str, time: float) -> float:
    ik = standing(FootIKSettings().changed(ray_reach=mode), gait=gait)
    ik.crowd.bodies["time"] = time
    ik.step(DT)
    return float(ik.crowd.block.told[0, 0]["below"])


@pytest.mark.parametrize("mode", ["height", "curve", "phase"])
def test_rays_reach_far_in_stance_and_not_in_swing(mode: str) -> None:
    size = FootIKSettings().record(0.85)
    motion = builtin_motion("walk")
    weights, ankles = motion.timing["weight"][:, 0], motion.timing["phase"][:, 0]
    stance = float(np.flatnonzero((weights == 1.0) & (ankles == 2))[0]) / motion.clip.fps
    reaches = [reach_of(mode, "walk", t) for t in np.linspace(0.0, motion.clip.duration, 30)]
    assert reach_of(mode, "walk", stance) == pytest.approx(size["ground_below"], rel=0.1)
    assert min(reaches) < 0.7 * size["ground_below"]
    assert min(reaches) >= 0.9 * size["ground_below_swing"]


def test_fixed_rays_reach_the_same_always() -> None:
    assert reach_of("fixed", "walk", 0.0) == reach_of("fixed", "walk", 0.4)


def test_rays_see_the_groups_they_are_told_and_pass_the_geoms_they_are_told() -> None:
    seen = standing(loose=box("box", *LEFT_BOX))
    by_group = standing(loose=box("box", *LEFT_BOX, group=3))
    by_name = standing(loose=box("box", *LEFT_BOX), passed=["box"])
    for ik in (seen, by_group, by_name):
        run(ik, 0.5)
    assert soles(seen)[0, 1, 2] == pytest.approx(0.1, abs=2e-3)
    assert soles(by_group)[0, 1, 2] == pytest.approx(0.0, abs=2e-3)
    assert soles(by_name)[0, 1, 2] == pytest.approx(0.0, abs=2e-3)


@pytest.mark.parametrize("native", [True, False])
def test_passed_geoms_are_passed_by_native_rays_and_through_python(native: bool) -> None:
    scene = Scene.build(builtin_motion("idle"), flat(), loose=box("box", *LEFT_BOX))
    over = np.array([[0.0, 0.13, 0.3]])
    seen = SceneGround(scene.model, scene.data, native=native).height(over)
    passed = SceneGround(scene.model, scene.data, passed=["box"], native=native).height(over)
    assert (seen[0], passed[0]) == pytest.approx((0.1, 0.0), abs=1e-9)


def test_rays_never_see_the_character_in_whatever_group_it_is() -> None:
    scene = Scene.build(builtin_motion("idle"), flat(), body=HUMANOID)
    scene.model.geom_group[np.isin(scene.model.geom_bodyid, scene.character.bodies)] = 0
    ik = HumanoidFootIK(scene)
    run(ik, 1.0)
    assert np.abs(soles(ik)[..., 2]).max() < 2e-3


def test_a_geom_that_there_is_not_is_an_error_that_names_the_nearest() -> None:
    with pytest.raises(FootIKError, match="Did you mean 'box'"):
        standing(loose=box("box", *LEFT_BOX), passed=["boxx"])


def test_rays_of_a_step_can_be_drawn_with_what_they_met() -> None:
    ik = standing()
    ik.step(DT)
    rays = ik.rays
    assert {ray.foot for ray in rays} == {"left", "right"}
    met = [ray for ray in rays if ray.normal_w is not None]
    assert met
    assert all(ray.end_w[2] == pytest.approx(0.0, abs=1e-6) for ray in met)
    assert all(ray.normal_w == pytest.approx(UP, abs=1e-9) for ray in met)


# --- limits and hints ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("along", "name"), [(True, "largest_slope_deg"), (False, "largest_roll_deg")]
)
def test_the_foot_is_tilted_no_further_than_each_axis_allows(along: bool, name: str) -> None:
    slope = SideSlope(angle_deg=25.0, length=-2.0 * BEGIN)
    terrain = Terrain(name="s", pieces=(slope, Flat(length=10.0)))
    ik = standing(FootIKSettings().changed(**{name: 10.0}), terrain=terrain)
    ik.place(np.zeros(3), yaw=np.pi / 2 if along else 0.0)
    run(ik, 1.0)
    up = rotate(ik.crowd.feet[0, 0]["goal_turn"], UP)
    assert np.degrees(np.arccos(up[2])) == pytest.approx(10.0, abs=2.5)


def knee_way(settings: FootIKSettings) -> np.ndarray:
    ik = standing(settings, loose=box("box", [0.5, 0.5, 0.1], [0.0, 0.0, 0.1]))
    ik.crowd.bodies["hips"] = 0
    run(ik, 1.0)
    rig = ik.scene.motion.rig
    at, _ = rig.skeleton.forward(ik.crowd.rotations[:1], ik.crowd.roots[:1])
    leg = rig.legs[0]
    hip, knee, ankle = (at[0, j] for j in (leg.hip, leg.knee, leg.ankle))
    line = (ankle - hip) / np.linalg.norm(ankle - hip)
    off = (knee - hip) - ((knee - hip) @ line) * line
    return off / np.linalg.norm(off)


def test_a_knee_hint_turns_the_knee_outward_and_no_further_than_its_limit() -> None:
    plain = knee_way(FootIKSettings())
    out = knee_way(FootIKSettings(knee_out_deg=20.0))
    most = knee_way(FootIKSettings(knee_out_deg=20.0, max_knee_twist_deg=5.0))
    assert out[1] > plain[1]
    assert np.degrees(np.arccos(plain @ out)) == pytest.approx(20.0, abs=2.0)
    assert np.degrees(np.arccos(plain @ most)) == pytest.approx(5.0, abs=1.0)


def test_a_knee_follows_the_toes_as_far_as_it_is_told() -> None:
    toes = knee_way(FootIKSettings(knee_toe=1.0, max_knee_twist_deg=180.0))
    ik = standing()
    run(ik, 0.5)
    ahead = rotate(ik.crowd.feet[0, 0]["goal_turn"], np.array([1.0, 0.0, 0.0]))
    assert np.arctan2(toes[1], toes[0]) == pytest.approx(np.arctan2(ahead[1], ahead[0]), abs=0.1)


# --- pelvis -------------------------------------------------------------------------------------


def across_a_step(**changes) -> HumanoidFootIK:
    settings = FootIKSettings().changed(**changes)
    ik = standing(settings, loose=box("box", [0.5, 0.3, 0.05], [0.0, 0.28, 0.05]))
    ik.place((0.0, 0.0, 0.1))
    return ik


def test_the_pelvis_is_lowered_and_that_can_be_switched_off_and_on_again() -> None:
    ik = across_a_step()
    run(ik, 1.5)
    lowered = ik.hip_drop
    assert lowered == pytest.approx(0.1, abs=0.02)
    ik.hips_move = False
    taken = []
    for _ in range(120):
        ik.step(DT)
        taken.append(ik.hip_drop)
    assert abs(taken[-1]) < 1e-3
    assert np.abs(np.diff([lowered, *taken])).max() < 0.02
    ik.hips_move = True
    run(ik, 1.5)
    assert ik.hip_drop == pytest.approx(lowered, abs=0.01)


def test_the_pelvis_moves_no_faster_than_its_speed() -> None:
    ik = across_a_step(max_hip_speed=0.05)
    run(ik, 0.1)
    ik.hips_move = False
    drops = []
    for _ in range(60):
        ik.step(DT)
        drops.append(ik.hip_drop)
    size = float(ik.crowd.tables.settings["size"])
    assert np.abs(np.diff(drops)).max() <= 0.05 * size * DT + 1e-9


def test_an_underdamped_pelvis_swings_past_and_an_overdamped_one_creeps() -> None:
    ends = {}
    for damping in (0.3, 1.0, 3.0):
        ik = across_a_step(hip_damping=damping)
        run(ik, 1.5)
        ik.hips_move = False
        drops = []
        for _ in range(90):
            ik.step(DT)
            drops.append(ik.hip_drop)
        ends[damping] = drops
    assert min(ends[0.3]) < -0.002
    assert min(ends[1.0]) > -0.002
    assert ends[3.0][30] > ends[1.0][30]


def test_the_pelvis_rises_where_a_leg_would_be_too_short() -> None:
    ik = standing(FootIKSettings(min_leg=0.8, ground_above=0.8), loose=box("box", *LEFT_BOX))
    ik.scene.model.geom("box").size[2] = 0.15
    ik.scene.model.geom("box").pos[2] = 0.15
    mujoco.mj_kinematics(ik.scene.model, ik.scene.data)
    ik.place((0.0, 0.0, 0.0))
    run(ik, 1.5)
    assert ik.hip_drop < 0.0


def test_the_pelvis_goes_sideways_with_its_support_as_far_as_it_is_told() -> None:
    ways = []
    for share in (0.0, 1.0):
        ik = standing(FootIKSettings(hip_balance=share))
        run(ik, 0.5)
        ik.command((0.2, 0.0))
        run(ik, 0.8)
        ways.append(ik.root_w[0] - ik.crowd.roots[0, 0])
    assert ways[1] - ways[0] > 0.05


def test_the_centre_of_mass_is_reported_over_its_support() -> None:
    ik = standing()
    run(ik, 1.0)
    balance = ik.balance()
    assert balance.margin > 0.0
    assert len(balance.support_w) >= 4
    ik.crowd.roots[0, 1] += 0.5
    ik.scene.character.write_pose(ik.scene.data, ik.crowd.roots[0], ik.crowd.rotations[0])
    mujoco.mj_kinematics(ik.scene.model, ik.scene.data)
    assert ik.balance().margin == pytest.approx(balance.margin - 0.5, abs=0.15)


def test_a_margin_is_the_way_to_the_nearest_side() -> None:
    square = convex_hull(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 0.0]]))
    assert len(square) == 4
    assert margin_in(square, np.array([0.5, 0.2, 9.0])) == pytest.approx(0.2)
    assert margin_in(square, np.array([2.0, 0.5, 0.0])) == pytest.approx(-1.0)
    assert margin_in(square, np.array([2.0, 2.0, 0.0])) == pytest.approx(-np.sqrt(2.0))


# --- leg stretch --------------------------------------------------------------------------------


def test_legs_stretch_as_far_as_they_may_and_the_bodies_with_them() -> None:
    deep = box("box", [0.5, 0.5, 0.1], [0.0, 0.0, -0.1])
    settings = FootIKSettings(max_stretch=1.15, hips=False)
    ik = standing(settings, loose=deep)
    ik.place((0.0, 0.0, 0.08))
    ik.crowd.bodies["on_ground"] = 0
    ik.crowd.bodies["velocity"] = 0.0
    ik.step(DT)
    body = ik.scene.character.bodies
    leg = ik.scene.motion.rig.legs[0]
    stretch = ik.foot("left").stretch
    assert 1.0 < stretch <= 1.15
    hip, ankle = ik.scene.data.xpos[body[leg.hip]], ik.scene.data.xpos[body[leg.ankle]]
    assert ankle == pytest.approx(ik.foot("left").ankle_w, abs=1e-6)
    rest = ik.scene.motion.rig.leg_lengths[0]
    assert np.linalg.norm(ankle - hip) <= stretch * rest + 1e-6


# --- climbing: what is up -----------------------------------------------------------------------


def walk_from(up: np.ndarray, frames: int = 240) -> tuple[np.ndarray, np.ndarray]:
    """Roots and ankles of a walk over blocks on a plane whose normal is `up`, told in its frame."""
    spec = mujoco.MjSpec()
    turn = np.array([1.0, 0.0, 0.0, 0.0])
    crowd_up = Crowd(builtin_motion(), SceneGround(*compiled_floor(mujoco.MjSpec(), turn)))
    crowd_up.up = up
    turn = crowd_up.frame
    crowd = Crowd(builtin_motion(), SceneGround(*compiled_floor(spec, turn)))
    crowd.up = up
    crowd.place(np.zeros(3))
    roots, ankles = [], []
    for _ in range(frames):
        crowd.step(DT)
        roots.append(rotate(np.array([turn[0], *-turn[1:]]), crowd.roots[0]))
        ankles.append(crowd.feet[0]["out"].copy())
    return np.array(roots), np.array(ankles)


def compiled_floor(spec: mujoco.MjSpec, turn: np.ndarray):
    """A floor with blocks on it, all turned about the origin."""
    kind = mujoco.mjtGeom.mjGEOM_BOX
    at = rotate(turn, np.array([0.0, 0.0, -0.5]))
    spec.worldbody.add_geom(type=kind, size=[30.0, 30.0, 0.5], pos=at, quat=turn)
    for k in range(6):
        at = rotate(turn, np.array([1.2 + 0.9 * k, 0.1, 0.04]))
        spec.worldbody.add_geom(type=kind, size=[0.3, 0.6, 0.05], pos=at, quat=turn)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


@pytest.mark.parametrize("up", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.3, 0.4, -0.8)])
def test_a_wall_or_a_ceiling_is_walked_on_as_a_floor_is(up) -> None:
    floor, wall = walk_from(UP), walk_from(np.array(up))
    assert wall[0] == pytest.approx(floor[0], abs=1e-5)
    assert wall[1] == pytest.approx(floor[1], abs=1e-5)


def test_up_changes_while_feet_stand_and_none_of_them_moves() -> None:
    ik = standing(FootIKSettings(hips=False))
    run(ik, 0.5)
    before = soles(ik)
    for k in range(1, 31):
        angle = np.radians(0.2 * k)
        ik.up = (np.sin(angle), 0.0, np.cos(angle))
        ik.step(DT)
    assert ik.up == pytest.approx((np.sin(angle), 0.0, np.cos(angle)), abs=1e-9)
    assert np.linalg.norm(soles(ik) - before, axis=-1).max() < 0.02
    assert all(foot.state == "grounded" for foot in ik.feet)


@pytest.mark.parametrize("wrong", [(0.0, 0.0, 0.0), (0.0, 1.0), "up", (np.nan, 0.0, 1.0)])
def test_an_up_that_is_none_is_an_error(wrong) -> None:
    with pytest.raises(FootIKError, match="up must be three finite numbers"):
        standing().up = wrong
