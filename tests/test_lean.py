"""Lean: the body of a quadruped follows the plane under its paws, and a biped's does not."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from footik_runtime import quat_arrays as qa
from footik_runtime.builtin import QUADRUPED, builtin_body, builtin_motion
from footik_runtime.crowd import Crowd
from footik_runtime.motion import Motion
from footik_runtime.scene import Scene
from footik_runtime.settings import FootIKSettings
from footik_runtime.terrain import BEGIN, Flat, Piece, Ramp, SideSlope, Stairs, Terrain
from footik_runtime.walk import Recording, record_walk


def scene(motion: Motion, *pieces: Piece, body=QUADRUPED) -> Scene:
    laid = (Flat(length=1.0 - BEGIN), *pieces, Flat(length=30.0))
    return Scene.build(motion, Terrain(name="made", pieces=laid), body=body)


@pytest.fixture(scope="module")
def walking() -> Motion:
    return builtin_motion("quadruped walk")


@pytest.fixture(scope="module")
def recorded(walking) -> Callable[..., Recording]:
    """A walk of 6 s over pieces, made once for each."""
    done: dict = {}

    def take(*pieces: Piece, fps: float = 60.0) -> Recording:
        key = (pieces, fps)
        if key not in done:
            done[key] = record_walk(scene(walking, *pieces), seconds=6.0, fps=fps)
        return done[key]

    return take


@pytest.mark.parametrize("angle", [15.0, -15.0])
def test_the_body_pitches_with_a_slope(recorded, walking, angle):
    run = recorded(Ramp(angle_deg=angle, length=20.0))
    late = run.times > 4.0
    np.testing.assert_allclose(np.degrees(run.bodies["lean"][late, 0]), angle, atol=0.2)
    np.testing.assert_allclose(run.bodies["lean"][late, 1], 0.0, atol=0.005)
    # So does what is written: the trunk's own forward direction, over a whole number of cycles.
    whole = np.flatnonzero(late)[: 2 * (len(walking.clip) - 1)]
    nose = qa.rotate(run.rotations[whole, 0], np.array([1.0, 0.0, 0.0]))
    assert math.degrees(float(np.mean(np.arcsin(nose[:, 2])))) == pytest.approx(angle, abs=0.5)


def test_the_body_rolls_with_a_slope_across_its_way(recorded):
    run = recorded(SideSlope(angle_deg=15.0, length=20.0))
    lean = np.degrees(run.bodies["lean"][run.times > 4.0])
    np.testing.assert_allclose(np.abs(lean[:, 1]), 15.0, atol=0.5)
    np.testing.assert_allclose(lean[:, 0], 0.0, atol=0.5)


def test_the_body_pitches_with_stairs_and_does_not_sway_on_them(recorded):
    stairs = Stairs(steps=40, step_height=0.12)
    run = recorded(stairs)
    lean = np.degrees(run.bodies["lean"][run.times > 3.0])
    up = math.degrees(math.atan2(0.12, stairs.step_depth))
    assert lean[:, 0].mean() == pytest.approx(up, abs=3.0)
    assert np.ptp(lean[:, 0]) < 8.0
    assert np.abs(lean[:, 1]).max() < 8.0


def test_the_lean_never_jumps(recorded):
    run = recorded(Stairs(steps=40, step_height=0.12))
    speed = np.diff(run.bodies["lean"], axis=0) * run.fps
    assert np.abs(speed).max() < math.radians(120.0)
    assert np.abs(np.diff(speed, axis=0)).max() < math.radians(60.0)


def test_the_lean_is_alike_at_all_frame_rates(recorded):
    for piece in (Ramp(angle_deg=15.0, length=20.0), Stairs(steps=40, step_height=0.12)):
        slow, fast = recorded(piece, fps=30.0), recorded(piece, fps=240.0)
        same = fast.bodies["lean"][::8][: len(slow.times)]
        assert np.degrees(np.abs(slow.bodies["lean"] - same)).max() < 2.5


def test_a_biped_does_not_lean(walk):
    run = record_walk(
        scene(walk, Ramp(angle_deg=15.0, length=20.0), body=builtin_body("walk")), seconds=4.0
    )
    assert (run.bodies["lean"] == 0.0).all()
    assert (run.bodies["lean_speed"] == 0.0).all()


def test_settings_limit_the_lean_and_switch_it_off(walking):
    for most in (6.0, 0.0):
        settings = FootIKSettings(max_lean_deg=most)
        ramp = scene(walking, Ramp(angle_deg=15.0, length=20.0))
        run = record_walk(ramp, seconds=3.0, settings=settings)
        assert np.degrees(np.abs(run.bodies["lean"])).max() <= most + 1e-9
        assert np.degrees(run.bodies["lean"][-1, 0]) == pytest.approx(most)


def test_the_body_fades_back_to_the_animation_where_foot_ik_is_switched_off(walking):
    built = scene(walking, Ramp(angle_deg=15.0, length=20.0))
    crowd = Crowd(walking, built.ground())
    crowd.place(np.asarray(built.terrain.start_w))
    for _ in range(240):
        crowd.step(1.0 / 60.0)
    assert math.degrees(crowd.bodies["lean"][0, 0]) > 10.0
    crowd.bodies["enabled"] = 0
    turns = []
    for _ in range(30):
        crowd.step(1.0 / 60.0)
        turns.append(crowd.rotations[0, 0].copy())
    steps = qa.to_rotvec(qa.mul(qa.conj(np.array(turns[:-1])), np.array(turns[1:])))
    assert np.degrees(np.linalg.norm(steps, axis=1)).max() < 3.0
    assert (crowd.bodies["lean"] == 0.0).all()


@pytest.mark.parametrize("gait", ["quadruped walk", "trot"])
def test_frames_of_any_length_leave_the_pose_finite_and_the_lean_within_its_limit(gait):
    motion = builtin_motion(gait)
    built = scene(motion, Stairs(steps=40, step_height=0.12))
    crowd = Crowd(motion, built.ground())
    crowd.place(np.asarray(built.terrain.start_w))
    most = math.radians(crowd.settings.max_lean_deg)
    for dt in (0.0, 1 / 60, 1 / 60, 0.0, 1.0, 10.0, 0.0, 1 / 240, 3.0, 1 / 60, 10.0, 10.0, 0.1):
        crowd.step(dt)
        assert np.isfinite(crowd.roots).all()
        assert np.isfinite(crowd.rotations).all()
        assert np.abs(crowd.bodies["lean"]).max() <= most + 1e-12
