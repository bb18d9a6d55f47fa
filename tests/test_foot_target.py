"""The foot's state machine without MuJoCo: thresholds, replayed ground, and prints in frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import DT

from footik_runtime.builtin import HUMANOID
from footik_runtime.crowd import Crowd
from footik_runtime.errors import FootIKError
from footik_runtime.feet.footprint import planted, sole_pitch, to_body, to_world
from footik_runtime.feet.record import FOOT, FOOT_INPUT, GROUNDED, RELEASED, reset_foot
from footik_runtime.feet.target import wants_ground
from footik_runtime.ground import RecordedGround, SceneGround
from footik_runtime.legs import leg_records
from footik_runtime.math3d import quat_axis_angle
from footik_runtime.motion import Motion
from footik_runtime.probes import HIT
from footik_runtime.quat_arrays import rotate
from footik_runtime.scene import Scene
from footik_runtime.settings import FootIKSettings


class Taped:
    """A ground that writes down every answer of another."""

    def __init__(self, ground: SceneGround) -> None:
        self.ground = ground
        self.answers: list[np.ndarray] = []

    def cast(self, probes, hits) -> None:
        self.ground.cast(probes, hits)
        self.answers.append(hits[probes["active"] == 1].copy())


class Level:
    """A floor at z = 0 that needs no scene, or none at all."""

    there = True

    def cast(self, probes, hits) -> None:
        active = probes["active"] == 1
        hits["hit"][active] = self.there
        hits["geom"][active], hits["body"][active] = (0, 0) if self.there else (-1, -1)
        hits["point"][active] = probes["origin"][active] * [1.0, 1.0, 0.0]
        hits["normal"][active] = [0.0, 0.0, 1.0]


def weighted(motion: Motion, weight: float) -> Motion:
    """The motion with feet that never plant by themselves: their weight alone says what they do."""
    timing = motion.timing.copy()
    timing["weight"], timing["to_plant"], timing["to_release"] = weight, np.inf, 0.0
    return replace(motion, timing=timing)


def states(crowd: Crowd, weights: list[float]) -> list[int]:
    """State of the left foot after a frame of each weight."""
    out = []
    for weight in weights:
        crowd.tables.timing["weight"] = weight
        crowd.step(DT)
        out.append(int(crowd.feet[0, 0]["state"]))
    return out


# --- weights ------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [0.45, 0.5, 0.55])
@pytest.mark.parametrize("state", [RELEASED, GROUNDED])
def test_a_weight_at_a_threshold_never_chatters(idle: Motion, value: float, state: int) -> None:
    crowd = Crowd(weighted(idle, 1.0 if state == GROUNDED else 0.0), Level())
    states(crowd, [1.0 if state == GROUNDED else 0.0] * 5)
    for small in (0.0, 1e-12, 1e-3):
        seen = states(crowd, [value + small, value - small] * 30)
        assert np.count_nonzero(np.diff([state, *seen])) <= 1


def test_weights_place_and_release_where_the_settings_say(idle: Motion) -> None:
    crowd = Crowd(weighted(idle, 0.0), Level())
    weights = [0.0, 0.5, 0.549, 0.55, 0.5, 0.451, 0.45, 0.5]
    assert states(crowd, weights) == [0, 0, 0, 1, 1, 1, 0, 0]


@pytest.mark.parametrize("ahead", [0, 1])
def test_whether_a_foot_wants_ground_flips_once_on_the_way_up_and_down(ahead: int) -> None:
    settings = FootIKSettings().record(0.85)
    foot, told = np.zeros(1, dtype=FOOT)[0], np.zeros(1, dtype=FOOT_INPUT)[0]
    reset_foot(foot)
    told["ahead"], told["swing_time"] = ahead, 0.4
    wanted = []
    for weight in np.concatenate([np.linspace(0, 1, 101), np.linspace(1, 0, 101)]):
        told["weight"], told["to_plant"] = weight, 0.4 * (1.0 - weight)
        foot["state"] = GROUNDED if wants_ground(foot, told, settings) else RELEASED
        wanted.append(int(foot["state"]))
    assert np.count_nonzero(np.diff(wanted)) == 2


# --- ground -------------------------------------------------------------------------------------


def test_recorded_hits_drive_a_crowd_without_mujoco(walk: Motion) -> None:
    scene = Scene.build(walk, "rubble", seed=1, body=HUMANOID)
    taped = Taped(scene.ground())
    live = Crowd(walk, taped, 2)
    live.place(np.array([[1.5, 0.0, 0.0], [3.0, 1.0, 0.0]]), np.array([0.0, 0.4]))
    poses = []
    for _ in range(90):
        live.step(DT)
        poses.append((live.roots.copy(), live.rotations.copy(), live.feet["state"].copy()))
    played = Crowd(walk, RecordedGround(np.concatenate(taped.answers)), 2)
    played.place(np.array([[1.5, 0.0, 0.0], [3.0, 1.0, 0.0]]), np.array([0.0, 0.4]))
    for roots, rotations, state in poses:
        played.step(DT)
        assert (played.roots == roots).all()
        assert (played.rotations == rotations).all()
        assert (played.feet["state"] == state).all()
    with pytest.raises(FootIKError, match="the recording holds"):
        played.step(DT)


def test_a_recording_of_nothing_is_an_error_that_says_how_much_it_holds(idle: Motion) -> None:
    with pytest.raises(FootIKError, match="holds 0 hits"):
        Crowd(idle, RecordedGround(np.zeros(0, dtype=HIT))).step(DT)


def test_a_floor_that_is_switched_off_and_on_again_is_left_and_stood_on(idle: Motion) -> None:
    ground = Level()
    crowd = Crowd(idle, ground)
    for _ in range(30):
        crowd.step(DT)
    assert (crowd.feet["locked"] == 1).all()
    ground.there = False
    crowd.step(DT)
    assert (crowd.feet["state"] == RELEASED).all()
    assert (crowd.bodies["hip_drop"] < 1e-6).all()
    ground.there = True
    for _ in range(30):
        crowd.step(DT)
    assert (crowd.feet["locked"] == 1).all()


# --- prints -------------------------------------------------------------------------------------


def test_a_print_in_a_body_and_back_is_the_same_print() -> None:
    rng = np.random.default_rng(2)
    at, turn = rng.normal(size=(4, 3)), rng.normal(size=(4, 4))
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    point, by = (1.0, -2.0, 0.5), tuple(turn[3])
    for body in (-1, 0, 1, 3, 4):
        held, held_turn = to_body(body, point, by, at, turn)
        back, back_turn = to_world(body, held, held_turn, at, turn)
        assert back == pytest.approx(point)
        assert abs(np.dot(back_turn, by)) == pytest.approx(1.0)
    assert to_body(0, point, by, at, turn) == (point, by)


@pytest.mark.parametrize("pitch", [-0.5, -0.01, 0.0, 0.01, 0.4])
def test_a_planted_foot_rolls_over_its_heel_or_its_ball(idle: Motion, pitch: float) -> None:
    leg = leg_records(idle.rig)[0]
    point = (0.3, -0.2, 0.1)
    turn = quat_axis_angle((0.0, 0.0, 1.0), 0.7)
    ankle, rolled = planted(point, turn, pitch, leg)
    x = -leg["heel"] if pitch > 0.0 else leg["ball"]
    local = np.array([x, 0.0, -leg["height"]])
    pinned = np.array(ankle) + rotate(np.array(rolled), local)
    on_print = np.array(point) + rotate(np.array(turn), np.array([x, 0.0, 0.0]))
    assert pinned == pytest.approx(on_print, abs=1e-12)
    other = np.array([leg["ball"] if pitch > 0.0 else -leg["heel"], 0.0, -leg["height"]])
    assert (np.array(ankle) + rotate(np.array(rolled), other))[2] >= point[2] - 1e-12


def test_small_pitches_fade_to_flat_without_a_jump() -> None:
    flat = np.radians(2.0)
    pitches = np.linspace(-0.5, 0.5, 2001)
    told = [sole_pitch(quat_axis_angle((0.0, 1.0, 0.0), -p), flat) for p in pitches]
    assert all(value == 0.0 for p, value in zip(pitches, told, strict=True) if abs(p) < flat)
    assert np.abs(np.diff(told)).max() < 2.0 * (pitches[1] - pitches[0])
    assert (np.diff(told) >= 0.0).all()
