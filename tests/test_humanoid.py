"""HumanoidFootIK and FootTarget, as a user meets them."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from simulated import DT, run, soles, stand_on

from footik_runtime.builtin import HUMANOID, builtin_motion
from footik_runtime.character import CHARACTER_GROUP
from footik_runtime.errors import FootIKError
from footik_runtime.humanoid import HumanoidFootIK, steer_along
from footik_runtime.motion import Motion
from footik_runtime.scene import Scene
from footik_runtime.settings import FootIKSettings
from footik_runtime.terrain.even import Flat
from footik_runtime.walk import record_walk

FLAT = Flat(length=60.0)


@pytest.fixture
def standing(idle: Motion) -> HumanoidFootIK:
    ik = stand_on(idle, FLAT)
    run(ik, 0.5)
    return ik


def test_a_standing_foot_tells_what_it_does(standing: HumanoidFootIK) -> None:
    foot = standing.foot("left")
    assert (foot.state, foot.weight, foot.locked, foot.reached) == ("grounded", 1.0, True, True)
    assert foot.ground == "terrain_00_flat/floor"
    assert foot.pinned == "ball"
    assert str(foot) == "left: grounded on terrain_00_flat/floor, weight 1.00, ball held"
    print_w = foot.print_w
    assert print_w is not None
    assert print_w[2] == pytest.approx(0.0, abs=1e-9)
    height = standing.scene.motion.rig.legs[0].sole.height
    assert foot.goal_w == pytest.approx(print_w + np.array([0.0, 0.0, height]), abs=1e-6)
    assert foot.ankle_w == pytest.approx(foot.goal_w, abs=1e-5)
    assert np.linalg.norm(foot.goal_rotation_w) == pytest.approx(1.0)


def test_the_view_is_live_and_its_arrays_are_copies(standing: HumanoidFootIK) -> None:
    foot = standing.foot("right")
    goal = foot.goal_w
    goal[:] = 7.0
    assert foot.goal_w[0] != 7.0
    standing.place(np.array([3.0, 1.0, 0.0]), yaw=1.0)
    assert foot.goal_w[0] > 2.0


def test_a_place_is_posed_at_once_and_the_first_step_has_no_speed_from_elsewhere(
    standing: HumanoidFootIK,
) -> None:
    standing.place(np.array([3.0, 1.0, 0.0]), yaw=1.0)
    data, character = standing.scene.data, standing.scene.character
    for address in character.qpos_address[1:]:
        assert np.linalg.norm(data.qpos[address : address + 4]) == pytest.approx(1.0)
    standing.step(DT)
    assert np.abs(data.qvel[character.dofs]).max() < 1.0


def test_a_released_foot_has_neither_ground_nor_print(standing: HumanoidFootIK) -> None:
    standing.place(np.array([0.0, 0.0, 30.0]))
    standing.step(DT)
    foot = standing.foot("left")
    assert (foot.state, foot.ground, foot.pinned, foot.print_w) == ("released", None, None, None)
    assert str(foot) == "left: released, weight 0.00"


def test_a_foot_that_steps_says_bump_stride(standing: HumanoidFootIK) -> None:
    standing.command((0.0, 0.0), 0.8)
    seen = set()
    for _ in range(180):
        standing.step(DT)
        seen |= {(foot.state, foot.pinned is None, foot.locked) for foot in standing.feet}
    assert ("bump stride", True, False) in seen
    assert not any(state == "bump stride" and locked for state, _, locked in seen)


def test_a_misspelt_foot_is_an_error_that_names_the_feet(standing: HumanoidFootIK) -> None:
    with pytest.raises(FootIKError, match=r"lfet.*left"):
        standing.foot("lfet")


@pytest.mark.parametrize("velocity", [(np.nan, 0.0), (0.0, np.inf)])
def test_a_command_that_is_not_finite_is_an_error(standing: HumanoidFootIK, velocity) -> None:
    with pytest.raises(FootIKError, match="must be finite"):
        standing.command(velocity)
    with pytest.raises(FootIKError, match="must be finite"):
        standing.command((0.0, 0.0), float(velocity[0] + velocity[1]))


def test_a_place_that_is_none_is_an_error(standing: HumanoidFootIK) -> None:
    for at, yaw in ((np.zeros(2), 0.0), (np.array([0.0, np.nan, 0.0]), 0.0), (np.zeros(3), np.inf)):
        with pytest.raises(FootIKError, match="three finite numbers"):
            standing.place(at, yaw)


@pytest.mark.parametrize("dt", [-1e-9, np.nan, np.inf])
def test_a_step_that_is_not_forward_in_time_is_an_error_and_changes_nothing(
    standing: HumanoidFootIK, dt: float
) -> None:
    before, time = soles(standing), standing.time
    with pytest.raises(FootIKError, match="dt must be 0 or more"):
        standing.step(dt)
    assert standing.time == time
    standing.step(0.0)
    assert np.abs(soles(standing) - before).max() < 1e-9


def test_a_path_is_walked_to_its_end(walk: Motion) -> None:
    ik = stand_on(walk, FLAT)
    path = np.array([[0.0, 0.0], [3.0, 0.0], [4.0, 2.0], [2.0, 3.5]])
    for _ in range(1200):
        if not ik.follow(path):
            break
        ik.step(DT)
    else:
        pytest.fail(f"after 20 s the root is at {ik.root_w}")
    assert np.hypot(*(ik.root_w[:2] - path[-1])) < 0.4
    assert (ik.crowd.bodies["velocity"] == 0.0).all()


def test_a_path_behind_is_turned_to_first() -> None:
    behind = np.array([[0.0, 0.0], [-5.0, 0.1]])
    (forward, left), turn_rate = steer_along(behind, np.zeros(3), 0.0, 1.3, 0.5)
    assert (forward, left) == (0.0, 0.0)
    assert abs(turn_rate) == 2.5


@pytest.mark.parametrize("path", [np.zeros((1, 2)), np.zeros((4, 3)), np.full((3, 2), np.nan)])
def test_a_path_that_is_none_is_an_error(standing: HumanoidFootIK, path) -> None:
    with pytest.raises(FootIKError, match="a path must be"):
        standing.follow(path)


def test_switched_off_leaves_the_animation_as_it_is(walk: Motion) -> None:
    ik = stand_on(walk, FLAT)
    run(ik, 0.4)
    ik.enabled = False
    ik.place(np.zeros(3))
    ik.crowd.bodies["time"] = 0.0
    plain = record_walk(ik.scene, seconds=1.0, ik=False)
    for frame in range(60):
        ik.step(DT if frame else 0.0)
        assert (ik.crowd.roots[0] == plain.roots[frame]).all()
        assert (ik.crowd.rotations[0] == plain.rotations[frame]).all()


def test_switched_on_again_feet_are_placed_anew(walk: Motion) -> None:
    ik = stand_on(walk, FLAT)
    run(ik, 0.4)
    ik.enabled = False
    run(ik, 0.4)
    assert all(foot.state == "released" for foot in ik.feet)
    ik.enabled = True
    run(ik, 1.0)
    assert any(foot.locked for foot in ik.feet)


def test_velocities_move_the_pose_of_one_frame_to_the_next(walk: Motion) -> None:
    ik = stand_on(walk, FLAT)
    run(ik, 0.5)
    model, data = ik.scene.model, ik.scene.data
    before = data.qpos.copy()
    ik.step(DT)
    mujoco.mj_integratePos(model, before, data.qvel, DT)
    turned = np.where(before[3] * data.qpos[3] < 0.0, -1.0, 1.0)
    assert before[:3] == pytest.approx(data.qpos[:3], abs=1e-9)
    assert turned * before[3:7] == pytest.approx(data.qpos[3:7], abs=1e-9)
    for address in ik.scene.character.qpos_address[1:]:
        mine, theirs = before[address : address + 4], data.qpos[address : address + 4]
        assert abs(mine @ theirs) == pytest.approx(1.0, abs=1e-9)


def test_a_ball_in_the_way_is_pushed_by_a_foot(walk: Motion) -> None:
    def ball(spec: mujoco.MjSpec) -> None:
        body = spec.worldbody.add_body(name="ball", pos=[1.2, 0.08, 0.11])
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.11, 0, 0], mass=0.4, group=1)

    ik = stand_on(walk, FLAT, loose=ball)
    model, data = ik.scene.model, ik.scene.data
    feet = [i for leg in ik.scene.motion.rig.legs for i in (leg.ankle, leg.toe)]
    bodies = {int(ik.scene.character.bodies[i]) for i in feet}
    model.opt.timestep = DT / 4.0
    touched: set[int] = set()
    for _ in range(150):
        ik.step(DT)
        character = data.qpos[ik.scene.character.qpos_address[0] :][:3].copy()
        for _ in range(4):
            mujoco.mj_step(model, data)
            for contact in data.contact[: data.ncon]:
                pair = {int(b) for b in model.geom_bodyid[list(contact.geom)]}
                touched |= pair if model.body("ball").id in pair else set()
        assert np.isfinite(data.qpos).all()
        # What the foot does to the ball does not carry the character away.
        assert data.qpos[ik.scene.character.qpos_address[0] :][:3] == pytest.approx(
            character, abs=0.05
        )
    assert touched & bodies
    assert data.body("ball").xpos[0] > 1.5


def test_velocity_is_the_motions_own_with_physics_between_the_steps(walk):
    walker = HumanoidFootIK(Scene.build(walk, "flat", body=HUMANOID))
    model, data = walker.scene.model, walker.scene.data
    speeds = []
    for _ in range(200):
        walker.step(model.opt.timestep)
        speeds.append(data.qvel[0])
        mujoco.mj_step(model, data)
    # The pelvis surges within a stride, but never goes back and never leaps.
    assert min(speeds[5:]) > 0.8
    assert max(speeds[5:]) < 2.0


def test_following_a_path_that_begins_behind_turns_first_and_arrives() -> None:
    ik = HumanoidFootIK(Scene.build(builtin_motion(), "flat", body=HUMANOID))
    path = ik.root_w[:2] + np.array([[0.0, 0.0], [-2.0, 0.0]])
    frames = 0
    while ik.follow(path) and frames < 20 * 60:
        ik.step(DT)
        frames += 1
    assert np.hypot(*(ik.root_w[:2] - path[-1])) < 0.5
    assert frames > 60


def test_a_speed_of_zero_is_not_the_usual_speed() -> None:
    ik = HumanoidFootIK(Scene.build(builtin_motion(), "flat", body=HUMANOID))
    ik.follow(np.array([[0.0, 0.0], [5.0, 0.0]]), speed=0.0)
    assert (ik.crowd.bodies["velocity"] == 0.0).all()


@pytest.mark.parametrize("ahead", [0.0, -1.0, np.nan, np.inf, "far"])
def test_no_look_ahead_is_an_error(standing: HumanoidFootIK, ahead) -> None:
    with pytest.raises(FootIKError, match="ahead must be more than 0"):
        standing.follow([(0.0, 0.0), (5.0, 0.0)], ahead=ahead)


@pytest.mark.parametrize("speed", [-1.0, np.nan, np.inf, "fast"])
def test_no_speed_is_an_error(standing: HumanoidFootIK, speed) -> None:
    with pytest.raises(FootIKError, match="speed must be 0 or more"):
        standing.follow([(0.0, 0.0), (5.0, 0.0)], speed=speed)


def test_a_path_may_be_a_list_and_ragged_ones_are_an_error(standing: HumanoidFootIK) -> None:
    assert standing.follow([(0.0, 0.0), (5.0, 0.0)], speed=1.0)
    for path in ([[1.0], [1.0, 2.0]], "there"):
        with pytest.raises(FootIKError, match="a path must be"):
            standing.follow(path)


def test_the_look_ahead_grows_with_the_leg(standing: HumanoidFootIK) -> None:
    leg = standing.scene.motion.rig.leg_lengths.mean()
    path = standing.root_w[:2] + np.array([[0.0, 0.0], [0.5 * 0.5 * leg / 0.85, 0.0]])
    assert not standing.follow(path * 0.99, speed=1.0)
    assert standing.follow(path * 1.01, speed=1.0)


@pytest.mark.parametrize("velocity", [5, (1.0, 2.0, 3.0), "ab", None])
def test_a_command_of_another_kind_is_an_error(standing: HumanoidFootIK, velocity) -> None:
    with pytest.raises(FootIKError, match="a command must be finite"):
        standing.command(velocity)


def test_a_place_of_another_kind_is_an_error(standing: HumanoidFootIK) -> None:
    for at, yaw in (("here", 0.0), (None, 0.0), (np.zeros(3), "north"), (np.zeros(3), [0.0])):
        with pytest.raises(FootIKError, match="three finite numbers"):
            standing.place(at, yaw)  # pyright: ignore[reportArgumentType]


def test_groups_without_ground_are_an_error_that_names_those_with(idle: Motion) -> None:
    for group in (3, CHARACTER_GROUP):
        with pytest.raises(FootIKError, match=rf"groups {group}: .* is in 0 \(1\)"):
            stand_on(idle, FLAT, settings=FootIKSettings(groups=(group,)))
        scene = stand_on(idle, FLAT).scene
        with pytest.raises(FootIKError, match="there is no ground"):
            record_walk(scene, seconds=0.1, settings=FootIKSettings(groups=(group,)))


def test_a_scene_of_something_else_is_one_error(idle: Motion) -> None:
    with pytest.raises(FootIKError, match="unknown terrain"):
        Scene.build(idle, 5)  # pyright: ignore[reportArgumentType]
    with pytest.raises(FootIKError, match="needs a Motion"):
        Scene.build(None)  # pyright: ignore[reportArgumentType]
    with pytest.raises(FootIKError, match="cannot compile this scene"):
        Scene.build(idle, body=HUMANOID, loose=lambda spec: spec.worldbody.add_geom(size=[0, 0, 0]))
