"""Feet never jump: whatever vanishes, changes its rate, is switched or is placed in mid-swing."""

import itertools

import mujoco
import numpy as np
import pytest

from footik_runtime.builtin import HUMANOID, builtin_motion
from footik_runtime.clip import Clip
from footik_runtime.crowd import Crowd
from footik_runtime.ground import SceneGround
from footik_runtime.humanoid import HumanoidFootIK
from footik_runtime.motion import Motion
from footik_runtime.rig import find_rig
from footik_runtime.scene import Scene
from footik_runtime.skeleton import Skeleton

HZ = 60


def on_floor(height: float = 0.0, *, step: float = 0.0) -> SceneGround:
    """A wide floor, with a step under a left foot where there is one."""
    spec = mujoco.MjSpec()
    box = mujoco.mjtGeom.mjGEOM_BOX
    spec.worldbody.add_geom(type=box, size=[50.0, 50.0, 0.5], pos=[0.0, 0.0, height - 0.5])
    if step:
        at = [0.0, 0.25, height + step - 0.2]
        spec.worldbody.add_geom(type=box, size=[1.0, 0.2, 0.2], pos=at)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return SceneGround(model, data)


def vanish(ground: SceneGround) -> None:
    ground.data.geom_xpos[:, 2] -= 100.0


def standing(gait: str, ground: SceneGround, height: float = 0.0, time: float = 0.0) -> Crowd:
    crowd = Crowd(builtin_motion(gait), ground)
    crowd.place(np.array([[0.0, 0.0, height]]))
    crowd.bodies["time"] = time
    return crowd


def test_bump_strides_lift_off_where_they_stand_not_where_the_last_swing_did() -> None:
    ik = HumanoidFootIK(Scene.build(builtin_motion("idle"), "slope", body=HUMANOID))
    ik.command((0.5, 0.0))
    raised = []
    for _ in range(10 * 30):
        ik.step(1.0 / 30)
        raised.append(ik.crowd.feet[0]["arch"].max())
    assert ik.root_w[0] > 4.0
    assert max(raised) < 0.1


@pytest.mark.parametrize("hz", [30, 240, 1000])
def test_a_foot_over_nothing_returns_to_the_animation_at_any_rate(hz: int) -> None:
    ground = on_floor()
    crowd = standing("idle", ground)
    for _ in range(5):
        crowd.step(1.0 / hz)
    vanish(ground)
    crowd.bodies["root"][0, 1] += 0.2
    for _ in range(round(0.3 * hz)):
        crowd.step(1.0 / hz)
    feet = crowd.feet[0]
    np.testing.assert_allclose(feet["out"][:, :2], feet["anim"][:, :2], atol=1e-3)


def test_a_foot_placed_in_mid_swing_begins_on_its_animation() -> None:
    assert (builtin_motion().timing["to_plant"] > 0.0).any()
    for time in np.linspace(0.0, 1.0, 11):
        crowd = standing("walk", on_floor(3.0), 3.0, time)
        # What the feet remember of another place says nothing about this one.
        crowd.feet["lift"] = [-7.0, 4.0, 20.0]
        crowd.step(0.0)
        # A foot about to plant is on its print at once: ahead of the animation, and lower.
        assert np.abs(crowd.feet["goal"] - crowd.feet["anim"])[..., 2].max() < 0.15
        last = crowd.feet["goal"].copy()
        crowd.step(1.0 / HZ)
        assert np.linalg.norm(crowd.feet["goal"] - last, axis=-1).max() < 0.1


def test_a_standing_foot_whose_step_vanishes_does_not_jump() -> None:
    ground = on_floor(step=0.15)
    crowd = standing("idle", ground)
    for _ in range(30):
        crowd.step(1.0 / HZ)
    assert crowd.feet[0, 0]["hold"][2] == pytest.approx(0.15, abs=1e-3)
    vanish(ground)
    heights = [crowd.feet[0, 0]["out"][2]]
    for _ in range(20):
        crowd.step(1.0 / HZ)
        heights.append(crowd.feet[0, 0]["out"][2])
    assert crowd.feet[0, 0]["state"] == 0
    assert np.abs(np.diff(heights)).max() < 0.03
    assert heights[-1] == pytest.approx(heights[0] - 0.15, abs=0.01)


def test_a_rate_that_changes_every_frame_does_not_make_feet_chatter() -> None:
    def changes(rates: tuple[float, float]) -> int:
        crowd = standing("walk", on_floor())
        states = []
        for rate, _ in zip(itertools.cycle(rates), range(4 * HZ), strict=False):
            crowd.bodies["rate"] = rate
            crowd.step(1.0 / HZ)
            states.append(crowd.feet[0]["state"].copy())
        return int(np.abs(np.diff(states, axis=0)).sum())

    assert changes((0.5, 2.0)) <= changes((1.25, 1.25)) + 2


def test_a_leg_whose_hip_is_the_root_is_solved() -> None:
    names = ("hip", "knee", "ankle", "toe", "tail")
    skeleton = Skeleton(
        names=names,
        parents=np.array([-1, 0, 1, 2, 0], dtype=np.int32),
        offsets=np.array(
            [[0, 0, 0.9], [0.03, 0, -0.42], [-0.03, 0, -0.4], [0.15, 0, -0.06], [-0.2, 0, 0]]
        ),
    )
    rotations = np.tile([1.0, 0.0, 0.0, 0.0], (31, len(names), 1))
    rotations[:, 4] = [np.cos(0.8), 0.0, np.sin(0.8), 0.0]
    clip = Clip(
        skeleton=skeleton,
        fps=30.0,
        root_positions=np.tile([0.0, 0.0, 0.9], (31, 1)),
        rotations=rotations,
        loop=True,
    )
    motion = Motion.prepare(clip, find_rig(skeleton, legs={"left": names[:4]}))
    crowd = Crowd(motion, on_floor())
    crowd.place(np.zeros((1, 3)))
    for _ in range(3):
        crowd.step(1.0 / HZ)
    assert crowd.rotations[0, 0] == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-6)
    positions, _ = skeleton.forward(crowd.rotations[:1], crowd.roots[:1])
    assert positions[0, 2] == pytest.approx(crowd.feet[0, 0]["out"], abs=1e-9)


def test_a_paused_motion_does_not_move_a_foot_in_mid_swing() -> None:
    ik = HumanoidFootIK(Scene.build(builtin_motion(), "stairs", body=HUMANOID))
    for pause in range(70, 118, 6):
        ik.place(np.asarray(ik.scene.terrain.start_w))
        ik.crowd.bodies["time"], ik.crowd.bodies["rate"] = 0.0, 1.0
        for _ in range(pause):
            ik.step(1.0 / HZ)
        ik.crowd.bodies["rate"] = 0.0
        last = ik.crowd.feet[0]["goal"].copy()
        for _ in range(5):
            ik.step(1.0 / HZ)
            moved = np.linalg.norm(ik.crowd.feet[0]["goal"] - last, axis=-1)
            assert moved.max() < 0.12, (pause, moved)
            last = ik.crowd.feet[0]["goal"].copy()


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (0.7, 0.0), (0.0, 0.4), (1.3, 0.3)])
def test_a_leg_is_as_far_ahead_at_the_plant_as_behind_at_the_release(velocity) -> None:
    crowd = standing("walk", on_floor())
    crowd.command(np.array(velocity))
    seen: list[list[np.ndarray]] = [[], []]
    was_locked = np.zeros(2, bool)
    for _ in range(12 * HZ):
        crowd.step(1.0 / HZ)
        feet = crowd.feet[0]
        for leg in range(2):
            if feet[leg]["locked"]:
                if not was_locked[leg]:
                    seen[leg].append(np.zeros((0, 2)))
                place = (feet[leg]["hold"] - crowd.bodies["root"][0])[:2]
                seen[leg][-1] = np.vstack([seen[leg][-1], place])
            was_locked[leg] = feet[leg]["locked"]
    motion = crowd.motion
    for leg in range(2):
        middles = [0.5 * (path[0] + path[-1]) for path in seen[leg][1:-1]]
        under = motion.timing["middle"][0, leg]
        assert len(middles) >= 2
        assert np.abs(np.array(middles) - under).max() < 0.05


def test_switching_foot_ik_on_and_off_moves_no_foot_and_no_hip_at_once() -> None:
    ik = HumanoidFootIK(Scene.build(builtin_motion("idle"), "slope", body=HUMANOID))
    ik.place(np.array([3.0, 0.0, 0.6]))
    heights = []
    for frame in range(240):
        if frame % 60 == 50:
            ik.enabled = not ik.enabled
        ik.step(1.0 / HZ)
        ankles = ik.crowd.feet[0]["out"][:, 2] if ik.enabled else np.zeros(2)
        heights.append([ik.crowd.roots[0, 2], *(ankles * 0.0)])
    assert np.abs(np.diff(heights, axis=0)).max() < 0.02


def test_switched_off_ik_is_faded_out_and_then_is_the_animation() -> None:
    ground = on_floor(step=0.15)
    crowd, plain = standing("idle", ground), standing("idle", ground)
    plain.bodies["enabled"] = 0
    plain.reset()
    for _ in range(30):
        crowd.step(1.0 / HZ)
        plain.step(1.0 / HZ)
    assert np.abs(crowd.rotations - plain.rotations).max() > 0.05
    crowd.bodies["enabled"] = 0
    last = crowd.rotations.copy()
    for _ in range(30):
        crowd.step(1.0 / HZ)
        plain.step(1.0 / HZ)
        assert np.abs(crowd.rotations - last).max() < 0.1
        last = crowd.rotations.copy()
    assert (crowd.rotations == plain.rotations).all()
    assert (crowd.feet["state"] == 0).all()


def test_toes_do_not_jump_when_a_foot_is_let_go_while_it_is_being_placed() -> None:
    ground = on_floor()
    for wait in range(0, 40, 3):
        crowd = standing("walk", ground)
        for _ in range(60 + wait):
            crowd.step(1.0 / HZ)
        before = crowd.feet[0]["toes"].copy()
        heights = ground.data.geom_xpos.copy()
        vanish(ground)
        crowd.step(1.0 / HZ)
        ground.data.geom_xpos[:] = heights
        assert np.abs(crowd.feet[0]["toes"] - before).max() < 0.35


def test_a_print_across_two_bodies_of_one_height_stays_locked() -> None:
    spec = mujoco.MjSpec()
    box = mujoco.mjtGeom.mjGEOM_BOX
    spec.worldbody.add_geom(type=box, size=[50.0, 50.0, 0.5], pos=[0.0, 0.0, -0.5])
    slab = spec.worldbody.add_body(name="slab", pos=[0.0, 0.25, 0.0])
    slab.add_geom(type=box, size=[1.0, 0.2, 0.2], pos=[0.0, 0.0, -0.2])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    crowd = standing("idle", SceneGround(model, data))
    for _ in range(30):
        crowd.step(1.0 / HZ)
    for frame in range(20):
        data.geom_xpos[1, 2] = -0.2 + (4e-4 if frame % 2 else -4e-4)
        crowd.step(1.0 / HZ)
        assert crowd.feet[0, 0]["locked"], frame
