"""What a review of the runtime broke, one test a fault."""

import itertools
import os
from pathlib import Path

import mujoco
import numpy as np
import pytest

from footik_runtime.builtin import HUMANOID, builtin_motion
from footik_runtime.clip import Clip
from footik_runtime.crowd import Crowd
from footik_runtime.errors import FootIKError
from footik_runtime.files import require_writable, write_whole
from footik_runtime.ground import SceneGround
from footik_runtime.humanoid import HumanoidFootIK
from footik_runtime.motion import Motion
from footik_runtime.plot import require_plot
from footik_runtime.rig import find_rig
from footik_runtime.scene import Scene
from footik_runtime.skeleton import Skeleton
from footik_runtime.walk import record_walk

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


def test_following_a_path_that_begins_behind_turns_first_and_arrives() -> None:
    ik = HumanoidFootIK(Scene.build(builtin_motion(), "flat", body=HUMANOID))
    path = ik.root_w[:2] + np.array([[0.0, 0.0], [-2.0, 0.0]])
    frames = 0
    while ik.follow(path) and frames < 20 * HZ:
        ik.step(1.0 / HZ)
        frames += 1
    assert np.hypot(*(ik.root_w[:2] - path[-1])) < 0.5
    assert frames > HZ


def test_a_speed_of_zero_is_not_the_usual_speed() -> None:
    ik = HumanoidFootIK(Scene.build(builtin_motion(), "flat", body=HUMANOID))
    ik.follow(np.array([[0.0, 0.0], [5.0, 0.0]]), speed=0.0)
    assert (ik.crowd.bodies["velocity"] == 0.0).all()


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


def test_a_file_that_cannot_be_written_is_one_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    for path in (tmp_path / "file" / "x", tmp_path / ("a" * 300), f"{tmp_path}/a\0b"):
        with pytest.raises(FootIKError, match="cannot be written"):
            write_whole(path, b"")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_device_is_written_to_and_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    require_writable(pipe)
    write_whole(pipe, b"told")
    assert os.read(reader, 10) == b"told"
    os.close(reader)
    assert pipe.is_fifo()


def test_a_recording_too_long_for_memory_is_refused_at_once() -> None:
    scene = Scene.build(builtin_motion(), "flat", body=HUMANOID)
    with pytest.raises(FootIKError, match="at most 1000000 frames"):
        record_walk(scene, seconds=1e12)


def test_a_plot_of_an_unknown_kind_is_refused_before_the_walk() -> None:
    pytest.importorskip("matplotlib")
    require_plot(Path("run"))
    with pytest.raises(FootIKError, match="'xyz'; png, svg and pdf can"):
        require_plot(Path("run.xyz"))
