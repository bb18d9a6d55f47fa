"""Ground that moves under standing feet: it carries them, sinks, rises, vanishes and comes back."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from simulated import DT, FAR_AWAY, Array, add_slab, largest_step, over_ground, run, soles, stand_on

from footik_runtime.builtin import HUMANOID
from footik_runtime.humanoid import HumanoidFootIK
from footik_runtime.metrics import plant_slips
from footik_runtime.motion import Motion
from footik_runtime.quat_arrays import conj, rotate
from footik_runtime.scene import Scene
from footik_runtime.terrain.even import Gap
from footik_runtime.walk import record_walk

PIT = (Gap(width=5.0, depth=5.0), Gap(width=5.0, depth=5.0))


def add_block(spec: mujoco.MjSpec) -> None:
    """The slab again, but a geom of the world: its prints lie in the world's frame."""
    spec.worldbody.add_geom(
        name="block", type=mujoco.mjtGeom.mjGEOM_BOX, size=[1.0, 1.0, 0.1], pos=[0.0, 0.0, -0.1]
    )


def move_ground(ik: HumanoidFootIK, by: tuple[float, float, float], turn=(1.0, 0.0, 0.0, 0.0)):
    """Put the slab, or the block, `by` m from where it was built."""
    model, data = ik.scene.model, ik.scene.data
    if model.nmocap:
        data.mocap_pos[0], data.mocap_quat[0] = by, turn
    else:
        model.geom("block").pos = np.array(by) - [0.0, 0.0, 0.1]
    mujoco.mj_kinematics(model, data)


def euler(yaw: float, pitch: float, roll: float) -> Array:
    quat = np.zeros(4)
    mujoco.mju_euler2Quat(quat, np.array([yaw, pitch, roll]), "zyx")
    return quat


GROUNDS = pytest.mark.parametrize("ground", [add_slab, add_block])


def test_feet_ride_a_platform_that_travels_turns_and_tilts_on_their_marks(idle: Motion) -> None:
    ik = stand_on(idle, *PIT, loose=add_slab)
    run(ik, 0.5)
    marks: dict[tuple[int, int], Array] = {}
    worst, held_frames = 0.0, 0
    for frame in range(600):
        t = frame * DT
        by = (0.12 * math.sin(1.7 * t), 0.1 * math.sin(2.3 * t), 0.08 * math.sin(1.1 * t))
        turn = euler(0.35 * math.sin(0.9 * t), 0.06 * math.sin(2.0 * t), 0.06 * math.sin(1.3 * t))
        move_ground(ik, by, turn)
        ik.step(DT)
        points = rotate(conj(turn), soles(ik) - np.array(by))
        for leg, foot in enumerate(ik.crowd.feet[0]):
            pin = int(foot["pin"])
            if not foot["locked"]:
                marks = {key: mark for key, mark in marks.items() if key[0] != leg}
                continue
            mark = marks.setdefault((leg, pin), points[leg, pin])
            worst = max(worst, float(np.linalg.norm(points[leg, pin] - mark)))
            assert abs(points[leg, pin, 2]) < 1e-4
            held_frames += 1
    assert worst < 1e-4
    assert held_frames > 1100


def test_a_walk_over_platforms_slips_nowhere(walk: Motion) -> None:
    taken = record_walk(Scene.build(walk, "platform", body=HUMANOID), seconds=12.0)
    slips = plant_slips(taken.run)
    assert len(set(taken.feet["body"].ravel())) > 2
    assert len(slips) > 15
    assert slips.max() < 0.1  # mm


@GROUNDS
@pytest.mark.parametrize("to", [(FAR_AWAY, 0.0, 0.0), (0.0, 0.0, -FAR_AWAY), (0.0, 0.0, -2.0)])
def test_feet_let_go_of_ground_that_vanishes(idle: Motion, ground, to) -> None:
    ik = stand_on(idle, *PIT, loose=ground)
    before = run(ik, 0.5)
    move_ground(ik, to)
    after = run(ik, 1.0)
    assert [foot.state for foot in ik.feet] == ["released", "released"]
    assert ik.foot("left").ground is None
    assert after["drops"].max() < 1e-3
    assert np.isfinite(after["soles"]).all()
    assert largest_step(np.concatenate([before["soles"], after["soles"]])) < 0.01


@GROUNDS
def test_feet_are_planted_again_without_a_jump_when_ground_comes_back(idle: Motion, ground) -> None:
    ik = stand_on(idle, *PIT, loose=ground)
    run(ik, 0.5)
    move_ground(ik, (0.0, 0.0, -FAR_AWAY))
    gone = run(ik, 0.5)
    move_ground(ik, (0.0, 0.0, 0.0))
    back = run(ik, 1.0)
    assert (gone["feet"]["locked"][-1] == 0).all()
    assert (back["feet"]["locked"][-1] == 1).all()
    assert np.abs(over_ground(ik)).max() < 1e-6
    assert largest_step(np.concatenate([gone["soles"], back["soles"]])) < 0.01


@GROUNDS
@pytest.mark.parametrize("speed", [0.05, -0.05, 0.15, -0.15])
def test_ground_that_sinks_or_rises_slowly_is_followed(idle: Motion, ground, speed: float) -> None:
    ik = stand_on(idle, *PIT, loose=ground)
    run(ik, 0.5)
    points, goals = [soles(ik)], []
    for frame in range(1, 121):
        move_ground(ik, (0.0, 0.0, speed * frame * DT))
        ik.step(DT)
        points.append(soles(ik))
        goals.append(ik.crowd.feet[0]["goal"].copy())
        assert (ik.crowd.feet[0]["state"] == 1).all()
        assert np.abs(over_ground(ik)).max() < 0.03
    assert largest_step(np.array(points)) < 3.0 * abs(speed) * DT + 0.002
    assert largest_step(np.array(goals)) < 3.0 * abs(speed) * DT + 0.002
    rest = run(ik, 1.0)
    assert np.abs(over_ground(ik)).max() < 0.0015
    assert (rest["feet"]["locked"][-1] == 1).all()


@GROUNDS
@pytest.mark.parametrize("height", [0.08, -0.08])
def test_ground_that_jumps_is_reached_in_the_settle_time(
    idle: Motion, ground, height: float
) -> None:
    ik = stand_on(idle, *PIT, loose=ground)
    run(ik, 0.5)
    move_ground(ik, (0.0, 0.0, height))
    run(ik, 1.0)
    assert np.abs(over_ground(ik)).max() < 0.002
    assert [foot.locked for foot in ik.feet] == [True, True]
