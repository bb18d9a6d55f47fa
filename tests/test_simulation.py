"""The built-in character in MuJoCo, frame by frame: standing, turning, dragged away, anything."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from simulated import DT, Taken, largest_step, over_ground, run, soles, stand_on

from footik_runtime.builtin import HUMANOID
from footik_runtime.compiled import jit_enabled
from footik_runtime.crowd import Crowd
from footik_runtime.ground import NATIVE_RAYS, SceneGround
from footik_runtime.motion import Motion
from footik_runtime.scene import Scene
from footik_runtime.terrain import make_terrain
from footik_runtime.terrain.even import Flat, Ledge

FLAT = Flat(length=60.0)


def held_step(taken: Taken) -> float:
    """Largest way of a held sole point between two frames in which it is held, m."""
    feet, points = taken["feet"], taken["soles"]
    worst = 0.0
    for pin in (0, 1):
        held = (feet["locked"] == 1) & (feet["pin"] == pin)
        both = held[1:] & held[:-1]
        moved = np.linalg.norm(np.diff(points[:, :, pin], axis=0), axis=-1)
        worst = max(worst, moved[both].max(initial=0.0))
    return worst


def set_outs(taken: Taken) -> list[tuple[int, int]]:
    """(frame, foot) in which a bump stride begins."""
    begins = np.diff(taken["feet"]["bump"], axis=0) > 0
    return [(int(t) + 1, int(foot)) for t, foot in zip(*np.nonzero(begins), strict=True)]


# --- standing -----------------------------------------------------------------------------------


@pytest.mark.parametrize("drop", [0.05, 0.2, 0.4])
def test_standing_across_a_step_lowers_the_hips_and_both_soles_touch(
    idle: Motion, drop: float
) -> None:
    ik = stand_on(idle, Ledge(drop=drop, length=8.0))
    run(ik, 1.5)
    assert ik.hip_drop == pytest.approx(drop, abs=0.02)
    assert np.abs(over_ground(ik)).max() < 0.002
    assert [foot.ground for foot in ik.feet] == [f"terrain_00_ledge/{s}" for s in ("high", "low")]


def test_standing_beside_a_box_lowers_nothing_but_raises_the_foot_on_it(idle: Motion) -> None:
    def box(spec: mujoco.MjSpec) -> None:
        spec.worldbody.add_geom(
            name="box", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.3, 0.15, 0.06], pos=[0, 0.16, 0.06]
        )

    ik = stand_on(idle, FLAT, loose=box)
    run(ik, 1.5)
    assert ik.foot("left").ground == "box"
    assert np.abs(over_ground(ik)).max() < 0.002
    assert soles(ik)[0, :, 2] == pytest.approx(np.full(3, 0.12), abs=1e-3)
    assert ik.root_w[2] == pytest.approx(0.0, abs=1e-9)
    assert ik.hip_drop < 0.01


@pytest.mark.parametrize("drop", [0.56, 1.0])
def test_a_foot_over_a_pit_never_lowers_the_hips(idle: Motion, drop: float) -> None:
    ik = stand_on(idle, Ledge(drop=drop, length=8.0))
    taken = run(ik, 1.5)
    assert taken["drops"].max() < 1e-6
    assert ik.foot("right").state == "released"
    assert ik.foot("left").locked
    assert np.abs(over_ground(ik)[0]).max() < 0.002


def test_a_standing_foot_is_exactly_still(idle: Motion) -> None:
    ik = stand_on(idle, FLAT)
    run(ik, 0.5)
    taken = run(ik, idle.clip.duration)
    assert (taken["feet"]["locked"] == 1).all()
    assert np.abs(taken["soles"] - taken["soles"][0]).max() < 1e-9


# --- turning and being dragged ------------------------------------------------------------------


@pytest.mark.parametrize("turn_rate", [0.3, 0.8, -0.8, 2.0])
def test_turning_in_place_bumps_one_foot_at_a_time(idle: Motion, turn_rate: float) -> None:
    ik = stand_on(idle, FLAT)
    run(ik, 0.5)
    ik.command((0.0, 0.0), turn_rate)
    taken = run(ik, 8.0)
    feet = taken["feet"]
    assert len(set_outs(taken)) >= 4
    assert (feet["bump"].sum(axis=1) <= 1).all()
    assert (feet["state"] == 1).all()
    assert {foot for _, foot in set_outs(taken)} == {0, 1}


def test_a_bump_stride_begins_at_the_angle_of_the_settings(idle: Motion) -> None:
    rate = 0.4
    ik = stand_on(idle, FLAT)
    ik.step(0.0)
    ik.command((0.0, 0.0), rate)
    frames = set_outs(run(ik, 3.0))
    turned = np.degrees(rate * DT * (frames[0][0] + 1))
    assert 45.0 <= turned < 45.0 + np.degrees(rate * DT) + 1.0


def test_a_bump_stride_lands_flat_and_stays(idle: Motion) -> None:
    ik = stand_on(idle, FLAT)
    run(ik, 0.5)
    ik.command((0.0, 0.0), 0.8)
    taken = run(ik, 8.0)
    landed = 0
    for begin, foot in set_outs(taken):
        bump = taken["feet"]["bump"][begin:, foot]
        end = begin + int(np.argmin(bump))
        after = slice(end, end + 10)
        points = taken["soles"][after, foot]
        if bump.all() or len(points) < 10:
            continue
        landed += 1
        assert (taken["feet"]["locked"][after, foot] == 1).all()
        assert np.abs(points[..., 2]).max() < 0.002
        assert np.abs(points[:, 1] - points[0, 1]).max() < 1e-9
    assert landed >= 6
    assert held_step(taken) < 1e-9


@pytest.mark.parametrize("velocity", [(0.3, 0.0), (0.0, 0.3), (-0.3, 0.2)])
def test_a_foot_dragged_away_is_planted_anew_without_a_jump(
    idle: Motion, velocity: tuple[float, float]
) -> None:
    ik = stand_on(idle, FLAT)
    run(ik, 0.5)
    ik.command(velocity)
    taken = run(ik, 6.0)
    assert len(set_outs(taken)) >= 4
    assert (taken["feet"]["bump"].sum(axis=1) <= 1).all()
    assert largest_step(taken["soles"]) < 0.06
    # A jump is a change of speed: a foot that stops for one frame in its stride shows here.
    assert np.linalg.norm(np.diff(taken["soles"], 2, axis=0), axis=-1).max() < 0.02
    assert held_step(taken) < 1e-9
    ik.command((0.0, 0.0))
    run(ik, 1.5)
    assert np.abs(over_ground(ik)).max() < 0.002


def test_a_character_carried_off_fast_may_step_with_both_feet(idle: Motion) -> None:
    ik = stand_on(idle, FLAT)
    ik.command((3.0, 0.0))
    taken = run(ik, 3.0)
    assert (taken["feet"]["bump"].sum(axis=1) == 2).any()
    # It still follows: no foot is left behind by more than the root moves in a stride or two.
    behind = np.abs(taken["soles"][-1, :, 1, 0] - ik.root_w[0])
    assert behind.max() < 2.0


# --- the same bits ------------------------------------------------------------------------------


def bits_of_a_walk(motion: Motion, native: bool, frames: int) -> list[bytes]:
    scene = Scene.build(motion, make_terrain("rubble", seed=3), body=HUMANOID)
    ground = SceneGround(scene.model, scene.data, native=native)
    crowd = Crowd(motion, ground)
    out = []
    for _ in range(frames):
        crowd.step(DT)
        fields = [crowd.feet[name] for name in crowd.feet.dtype.names or ()]
        out += [a.tobytes() for a in (crowd.roots, crowd.rotations, *fields)]
    return out


def test_two_runs_are_bit_identical(walk: Motion) -> None:
    assert bits_of_a_walk(walk, NATIVE_RAYS, 240) == bits_of_a_walk(walk, NATIVE_RAYS, 240)


@pytest.mark.skipif(not NATIVE_RAYS, reason="rays go through Python here anyway")
def test_native_rays_and_rays_through_python_give_the_same_bits(walk: Motion) -> None:
    assert bits_of_a_walk(walk, True, 60) == bits_of_a_walk(walk, False, 60)


# --- anything goes ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("terrain", "gait", "by_weight"),
    [("course", "walk", False), ("course", "walk", True), ("gap", "idle", False)],
)
def test_a_million_random_steps_stay_finite(
    terrain: str, gait: str, by_weight: bool, request: pytest.FixtureRequest
) -> None:
    motion: Motion = request.getfixturevalue(gait)
    if by_weight:
        motion = replace(motion, timing=motion.timing.copy())
        motion.timing["to_plant"] = np.inf  # nothing is known ahead: the weights alone decide
    count, frames = (1000, 334) if jit_enabled() else (2, 20)
    rng = np.random.default_rng(11)
    scene = Scene.build(motion, make_terrain(terrain, seed=2), body=HUMANOID)
    crowd = Crowd(motion, scene.ground(), count, threads=2)
    x_min, x_max, y_min, y_max = scene.terrain.extent
    low, high = (x_min - 1.0, y_min - 1.0, -1.0), (x_max + 1.0, y_max + 1.0, 1.0)
    crowd.place(rng.uniform(low, high, (count, 3)), rng.uniform(-4.0, 4.0, count))
    scene_time = 0.0
    for _ in range(frames):
        some = rng.random(count) < 0.05
        crowd.bodies["velocity"][some] = rng.uniform(-3.0, 3.0, (int(some.sum()), 2))
        crowd.bodies["turn_rate"][some] = rng.uniform(-4.0, 4.0, int(some.sum()))
        crowd.bodies["rate"][some] = rng.uniform(-0.5, 2.0, int(some.sum())).clip(0.0)
        crowd.bodies["enabled"][rng.random(count) < 0.02] ^= 1
        if by_weight:
            motion.timing["weight"] = rng.choice([0.0, 0.45, 0.5, 0.55, 1.0, rng.random()])
        dt = float(rng.choice([0.0, rng.uniform(1e-4, 0.1), 1.0, 10.0], p=[0.1, 0.86, 0.03, 0.01]))
        scene_time += dt
        scene.pose_terrain(scene_time)
        crowd.step(dt)
        for values in (crowd.roots, crowd.rotations):
            assert np.isfinite(values).all()
        length = np.linalg.norm(crowd.rotations, axis=-1)
        assert np.abs(length - 1.0).max() < 1e-9
        for name in (
            "goal",
            "goal_turn",
            "out",
            "out_turn",
            "hold",
            "weight",
            "toes",
            "plan_place",
        ):
            assert np.isfinite(crowd.feet[name]).all(), name
        assert ((crowd.feet["weight"] >= 0.0) & (crowd.feet["weight"] <= 1.0)).all()


@pytest.mark.parametrize("gait", ["walk", "idle"])
def test_a_frame_of_no_time_moves_nothing(gait: str, request: pytest.FixtureRequest) -> None:
    ik = stand_on(request.getfixturevalue(gait), FLAT)
    run(ik, 1.0)
    before, pose = soles(ik), ik.crowd.rotations.copy()
    for _ in range(5):
        ik.step(0.0)
    assert np.abs(soles(ik) - before).max() < 1e-9
    assert np.abs(ik.crowd.rotations - pose).max() < 1e-9
    assert (ik.scene.data.qvel[ik.scene.character.dofs] == 0.0).all()


@pytest.mark.parametrize("gait", ["walk", "idle"])
def test_a_frame_of_ten_seconds_is_safe_and_forgotten_soon(
    gait: str, request: pytest.FixtureRequest
) -> None:
    ik = stand_on(request.getfixturevalue(gait), FLAT)
    run(ik, 0.7)
    ik.step(10.0)
    assert np.isfinite(soles(ik)).all()
    run(ik, 2.0)
    later = run(ik, 1.0)
    assert np.abs(np.min(later["soles"][..., 2], axis=(1, 2))).max() < 0.002
    assert held_step(later) < 1e-9
