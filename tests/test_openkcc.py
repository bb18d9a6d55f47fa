"""OpenKCC's preset against hand-made hits: what its own unit tests ask of it, and its faults."""

import math

import numpy as np
import pytest

from footik_runtime.errors import FootIKError
from footik_runtime.math3d import get4, quat_angle, quat_yaw, rotate
from footik_runtime.offline.bake import bake_openkcc
from footik_runtime.openkcc import (
    GROUND,
    OPENKCC_BODY,
    OPENKCC_FRAME,
    OPENKCC_GOAL,
    OPENKCC_LEG,
    OVERLAP,
    apply_moving_rows,
    consume_rows,
    emit_moving_ground_rows,
    emit_moving_overlap_rows,
    emit_rows,
    hip_target,
)
from footik_runtime.openkcc_target import (
    GROUNDED,
    NO_FLOOR,
    RELEASED,
    can_update_target,
    force_target,
    ik_position,
    ik_rotation,
    look,
    mid_stride,
    new_feet,
    openkcc_settings,
    release,
    remaining,
    smooth_weight,
    start_stride,
    update_target,
)
from footik_runtime.probes import HIT, PROBE

DT = 1.0 / 60.0
UP, AHEAD, STILL = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)


class Character:
    """One character over level ground, whose rays are answered by hand."""

    def __init__(self, **changes):
        self.settings = openkcc_settings(**changes)
        self.frame, self.body = np.zeros(1, OPENKCC_FRAME), np.zeros(1, OPENKCC_BODY)
        self.legs, self.feet = np.zeros((1, 2), OPENKCC_LEG), new_feet((1, 2))
        self.goals = np.zeros((1, 2), OPENKCC_GOAL)
        self.probes = np.zeros((1, 2, 2), PROBE)
        self.ground: float | None = 0.0  # its height; None: there is none
        self.floor = 7
        self.wall: tuple | None = None  # point and normal of what every overlap ray hits
        self.place()
        self.legs["curve"] = 1.0

    def place(self, at=(0.0, 0.0, 0.0), yaw=0.0):
        turn = quat_yaw(yaw)
        self.frame["hips"] = np.add(at, (0.0, 0.0, 0.9))
        self.frame["forward"] = rotate(turn, AHEAD)
        for j, side in enumerate((0.1, -0.1)):
            self.legs[0, j]["foot"] = np.add(at, rotate(turn, (0.0, side, 0.05)))
            self.legs[0, j]["knee"] = np.add(at, rotate(turn, (0.15, side, 0.475)))

    def cast(self):
        hits = np.zeros((1, 2, 2), HIT)
        for j in range(2):
            if self.probes[0, j, GROUND]["active"] and self.ground is not None:
                hit = hits[0, j, GROUND]
                hit["hit"], hit["geom"], hit["normal"] = 1, self.floor, UP
                hit["point"] = (*self.probes[0, j, GROUND]["origin"][:2], self.ground)
            if self.probes[0, j, OVERLAP]["active"] and self.wall is not None:
                hit = hits[0, j, OVERLAP]
                hit["hit"], hit["geom"] = 1, 8
                hit["point"], hit["normal"] = self.wall
        return hits

    def step(self, frames=1, dt=DT):
        for _ in range(frames):
            self.frame["time"] += dt
            self.frame["dt"] = dt
            emit_rows(self.settings, self.frame, self.feet, self.legs, self.probes)
            hits = self.cast()
            consume_rows(
                self.settings, self.frame, self.body, self.feet, self.legs, hits, self.goals
            )

    def move_ground(self, delta):
        deltas = np.array([delta])
        rows = (self.settings, self.frame, self.body, self.feet, deltas, self.probes)
        emit_moving_overlap_rows(*rows)
        between = self.cast()
        emit_moving_ground_rows(
            self.settings, self.body, self.feet, self.legs, deltas, between, self.probes
        )
        apply_moving_rows(self.frame, self.feet, deltas, self.cast(), float(self.frame["time"][0]))

    @property
    def states(self):
        return list(self.feet["state"][0])


def foot_target(**changes):
    return new_feet((1,))[0], openkcc_settings(**changes)[0]


def stride(foot, now=0.0, to=(1.0, 0.5, 0.25), rotation=STILL, bump=0):
    start_stride(foot, now, to, rotation, 3, AHEAD, UP, bump)


def test_a_new_foot_is_released_without_weight():
    foot, settings = foot_target()
    assert (foot["state"], foot["weight"], foot["floor"]) == (RELEASED, 0.0, NO_FLOOR)
    assert not mid_stride(foot, settings, 0.0)
    assert can_update_target(foot, settings, 0.0)


def test_a_placed_foot_gains_weight_until_it_stands_over_its_target():
    foot, settings = foot_target()
    stride(foot)
    weights = [0.0]
    for _ in range(300):
        assert mid_stride(foot, settings, 0.0) == (weights[-1] <= 0.95)
        smooth_weight(foot, settings, DT)
        weights.append(float(foot["weight"]))
    assert (np.diff(weights) >= 0.0).all()
    assert weights[-1] > 0.95
    assert ik_position(foot, settings, 5.0) == pytest.approx((1.0, 0.5, 0.3))
    assert not can_update_target(foot, settings, 5.0)


def test_a_bump_travels_on_an_arc_to_its_target_and_turns_onto_it():
    foot, settings = foot_target()
    stride(foot)
    stride(foot, now=1.0, to=(1.0, 0.5, 0.25), rotation=quat_yaw(1.0), bump=1)
    times = np.linspace(1.0, 1.25, 26)
    heights = [ik_position(foot, settings, float(t))[2] for t in times]
    assert max(heights) == pytest.approx(0.3 + settings["step_height"], abs=1e-3)
    assert heights[0] == pytest.approx(0.3)
    assert heights[-1] == pytest.approx(0.3)
    turned = [quat_angle(ik_rotation(foot, settings, float(t)), quat_yaw(1.0)) for t in times]
    assert (np.diff(turned) < 0.0).all()
    assert turned[-1] < math.radians(5.0)


def test_a_bump_is_on_its_way_while_time_remains_and_locked_in_its_last_part():
    foot, settings = foot_target()
    stride(foot, now=1.0, bump=1)
    for now in np.linspace(1.001, 1.3, 50):
        left = remaining(foot, settings, now)
        assert left == pytest.approx(1.25 - now)
        assert mid_stride(foot, settings, now) == (left > 0.0)
        assert can_update_target(foot, settings, now) == (left > 0.15 * 0.25)


def test_a_released_foot_is_on_its_way_until_its_weight_is_gone():
    foot, settings = foot_target()
    stride(foot)
    foot["weight"] = 1.0
    release(foot)
    assert (foot["state"], foot["floor"]) == (RELEASED, NO_FLOOR)
    for _ in range(120):
        assert mid_stride(foot, settings, 0.0) == (foot["weight"] >= 0.05)
        assert can_update_target(foot, settings, 0.0) == (foot["weight"] <= 0.05)
        smooth_weight(foot, settings, DT)
    assert foot["weight"] < 0.05


def test_a_release_keeps_that_the_stride_was_a_bump():
    foot, _ = foot_target()
    stride(foot, bump=1)
    release(foot)
    assert foot["bump"] == 1


def test_a_forced_update_is_exact_and_an_unforced_one_comes_nearer_each_frame():
    foot, settings = foot_target()
    stride(foot, bump=1)
    goal = np.array([2.0, -1.0, 0.5])
    gaps = []
    for _ in range(40):
        gaps.append(np.linalg.norm(goal - foot["target_position"]))
        update_target(foot, settings, tuple(goal), quat_yaw(0.5), UP, DT)
    assert (np.diff(gaps) < 0.0).all()
    assert np.abs(foot["velocity"]).max() > 0.0
    force_target(foot, tuple(goal), quat_yaw(0.25), UP)
    assert (foot["target_position"] == goal).all()
    assert (foot["velocity"] == 0.0).all()
    assert quat_angle(get4(foot["target_rotation"]), quat_yaw(0.25)) < 1e-9


def test_an_update_leaves_the_stored_forward_alone():
    foot, settings = foot_target()
    stride(foot, bump=1)
    update_target(foot, settings, (2.0, 0.0, 0.0), quat_yaw(1.5), UP, DT)
    assert tuple(foot["forward"]) == AHEAD


def test_a_stride_starts_from_the_old_target():
    foot, _ = foot_target()
    stride(foot, to=(1.0, 2.0, 3.0), rotation=quat_yaw(0.5))
    stride(foot, to=(4.0, 5.0, 6.0), bump=1)
    assert tuple(foot["from_position"]) == (1.0, 2.0, 3.0)
    assert get4(foot["from_rotation"]) == quat_yaw(0.5)


def test_a_weight_curve_that_sweeps_grounds_and_releases_each_foot():
    character = Character()
    seen = []
    for phase in np.linspace(0.0, 1.0, 61):
        character.legs["curve"] = 1.0 - abs(2.0 * phase - 1.0)
        character.step()
        seen.append(character.states[0])
    assert [seen[0], seen[30], seen[-1]] == [RELEASED, GROUNDED, RELEASED]
    assert np.abs(np.diff(seen)).sum() == 2


def test_a_curve_of_exactly_half_toggles_the_state_every_frame():
    character = Character()
    character.legs["curve"] = 0.5
    seen = []
    for _ in range(6):
        character.step()
        seen.append(character.states[0])
    assert seen == [GROUNDED, RELEASED] * 3


def test_ground_that_moves_takes_only_the_grounded_foot_along():
    character = Character()
    character.legs[0, 0]["curve"] = 0.0
    character.step(3)
    before = character.feet.copy()
    character.move_ground((0.0, -0.3, 0.0))
    moved = character.feet["target_position"] - before["target_position"]
    assert moved[0, 1] == pytest.approx((0.0, -0.3, 0.0))
    assert (moved[0, 0] == 0.0).all()


def test_a_new_floor_is_bumped_onto_and_no_floor_lets_go():
    character = Character()
    character.step(60)
    character.floor = 9
    character.move_ground((0.1, 0.0, 0.0))
    assert list(character.feet["floor"][0]) == [9, 9]
    assert (character.feet["bump"] == 1).all()
    assert (character.feet["stride_start"] == character.frame["time"]).all()
    character.ground = None
    character.move_ground((0.1, 0.0, 0.0))
    assert character.states == [RELEASED, RELEASED]


@pytest.mark.parametrize("delta", [0.0, 0.001])
def test_ground_that_hardly_moved_did_not_move(delta):
    character = Character()
    character.step(60)
    before = character.feet.copy()
    character.ground = None
    character.move_ground((delta, 0.0, 0.0))
    assert (character.feet == before).all()


def test_what_stands_before_a_moved_target_takes_the_target():
    character = Character()
    character.step(60)
    character.wall = ((0.05, 0.3, 0.2), (0.0, -1.0, 0.0))
    character.move_ground((0.0, 0.5, 0.0))
    assert character.feet["target_position"][0, 0] == pytest.approx((0.05, 0.3, 0.0))


def test_feet_left_behind_far_are_both_released():
    character = Character()
    character.step(60)
    character.place(at=(100.0, 0.0, 0.0))
    character.step()
    assert character.states == [RELEASED, RELEASED]


def test_a_replanted_foot_jumps_as_openkcc_does():
    character = Character()
    character.step(60)
    character.place(at=(1.0, 0.0, 0.0))
    goals = []
    for _ in range(3):
        character.step()
        goals.append(character.goals["position"][0, 0, 0])
    assert max(np.diff(goals)) > 0.7


def test_hips_turned_about_make_exactly_one_foot_bump():
    character = Character()
    character.step(60)
    character.place(yaw=math.pi)
    character.step()
    assert sorted(character.feet["bump"][0]) == [0, 1]


def test_turning_in_place_bumps_one_foot_at_a_time():
    character = Character()
    character.step(60)
    together = bumps = 0
    for frame in range(180):
        character.place(yaw=math.radians(90.0) * frame * DT)
        started = character.feet["stride_start"].copy()
        character.step()
        bumps += int((character.feet["stride_start"] != started).sum())
        now = float(character.frame["time"][0])
        left = [remaining(foot, character.settings[0], now) for foot in character.feet[0]]
        together += sum(value > 0.0 for value in left) == 2
    assert bumps >= 4
    assert together == 0


@pytest.mark.parametrize(
    ("depths", "offset"),
    [((-1.25, 0.0), -0.35), ((-1.45, -1.25), -0.55), ((0.0, -1.45), -0.55), ((0.0, 0.0), 0.0)],
)
def test_hips_are_lowered_for_the_foot_that_needs_it_most(depths, offset):
    settings = openkcc_settings(
        max_hip_foot_distance=0.9, max_hip_offset=0.65, foot_grounded_height=0.0
    )
    feet = new_feet((2,))
    for foot, depth in zip(feet, depths, strict=True):
        stride(foot, to=(0.0, 0.0, depth))
    assert hip_target(feet, settings[0], 9.0, 0.0) == pytest.approx(offset)
    feet["state"] = RELEASED
    assert hip_target(feet, settings[0], 9.0, 0.0) == 0.0


def test_hips_sink_smoothly_to_the_limit_and_no_farther():
    character = Character(max_hip_offset=0.2)
    character.ground = -0.5
    offsets = []
    for _ in range(240):
        character.step()
        character.place(at=(0.0, 0.0, float(character.body["hip_offset"][0])))
        offsets.append(float(character.body["hip_offset"][0]))
    assert (np.diff(offsets) <= 0.0).all()
    assert offsets[-1] == pytest.approx(-0.2, abs=1e-3)
    assert np.abs(np.diff(offsets)).max() < 0.01


def test_an_obstacle_lifts_a_released_foot_out_of_it_and_lets_it_back():
    character = Character()
    character.legs["curve"] = 0.0
    character.step(2)
    character.wall = ((0.0, 0.0, 0.2), UP)
    character.step(10)
    assert character.goals["position"][0, 0] == pytest.approx((0.0, 0.0, 0.25))
    assert character.goals["rotation_weight"][0, 0] == 1.0
    character.wall = None
    character.step(10)
    assert character.goals["position"][0] == pytest.approx(character.legs["foot"][0])


def test_a_standing_contact_is_averaged_and_a_new_one_taken_at_once():
    character = Character()
    character.legs["curve"] = 0.0
    character.wall = ((0.0, 0.0, 0.2), UP)
    character.step(2)
    character.wall = ((0.0, 0.0, 0.4), UP)
    character.step()
    assert character.feet["overlap_position"][0, 0] == pytest.approx((0.0, 0.0, 0.35))
    character.wall = None
    character.step(10)
    character.wall = ((0.0, 0.0, 0.6), UP)
    character.step()
    assert character.feet["overlap_position"][0, 0] == pytest.approx((0.0, 0.0, 0.65))


def test_a_foot_whose_weight_still_settles_is_not_let_go_however_far_it_is():
    character = Character()
    character.step(20)  # longer than a stride, and the weight is not settled yet
    assert 0.25 / DT < 20
    assert character.feet["weight"].max() < 0.95
    character.place(at=(100.0, 0.0, 0.0))
    character.step()
    assert character.states == [GROUNDED, GROUNDED]


def test_without_overlap_correction_no_overlap_ray_is_asked_for():
    character = Character(correct_for_overlap=0)
    character.step()
    assert not character.probes["active"][:, :, OVERLAP].any()
    character.step(30)
    character.move_ground((0.2, 0.0, 0.0))
    assert character.feet["target_position"][0, :, 0] == pytest.approx(0.2)


def test_a_pause_makes_settled_velocities_nan_and_the_next_steps_recover():
    character = Character()
    character.step(dt=0.0)
    assert np.isnan(character.body["hip_speed"]).all()
    assert np.isnan(character.feet["weight_velocity"]).all()
    character.step()
    assert np.isnan(character.feet["weight"]).all()  # one frame, as in OpenKCC
    character.step()
    for record in (character.feet["weight"], character.body["hip_offset"]):
        assert np.isfinite(record).all()
    assert np.isfinite(character.goals["position"]).all()


def test_rows_are_stepped_alike_with_shared_and_with_own_settings():
    one, rows = Character(), 3
    frames, bodies = np.repeat(one.frame, rows), np.repeat(one.body, rows)
    legs, feet = np.repeat(one.legs, rows, axis=0), new_feet((rows, 2))
    goals, probes = np.zeros((rows, 2), OPENKCC_GOAL), np.zeros((rows, 2, 2), PROBE)
    for settings in (one.settings, np.repeat(one.settings, rows)):
        one.step()
        frames["time"], frames["dt"] = one.frame["time"], one.frame["dt"]
        emit_rows(settings, frames, feet, legs, probes)
        assert (probes == one.probes).all()
        hits = np.repeat(one.cast(), rows, axis=0)
        consume_rows(settings, frames, bodies, feet, legs, hits, goals)
        assert (feet == one.feet).all()
        assert (goals == one.goals).all()


def test_looking_keeps_forward_and_falls_back_where_it_has_to():
    turn = look((0.0, 2.0, 0.0), (0.1, 0.0, 1.0))
    assert rotate(turn, AHEAD) == pytest.approx((0.0, 1.0, 0.0))
    assert look((0.0, 0.0, 0.0), UP) == STILL
    assert rotate(look(UP, UP), AHEAD) == pytest.approx(UP)


def test_settings_that_cannot_be_are_refused():
    with pytest.raises(FootIKError, match="stride_time"):
        openkcc_settings(strid_time=1.0)
    with pytest.raises(FootIKError, match="step_height must be finite and >= 0, not -1"):
        openkcc_settings(step_height=-1.0)
    with pytest.raises(FootIKError, match="nan"):
        openkcc_settings(stride_time=math.nan)


def test_baking_skews_time_where_the_length_is_no_whole_number_of_samples():
    keys = bake_openkcc(lambda t: np.where(t < 0.5, 0.0, 1.0), length_s=1.01)
    assert keys[:, 1].tolist() == [1.0, 1.0, 0.0, 0.0]
    assert keys[2, 0] == pytest.approx(15.0 / 31.0)
    assert (keys[0, 0], keys[-1, 0]) == (0.0, 1.0)


def test_baking_reads_samples_linearly():
    times = np.array([0.0, 1.0])
    keys = bake_openkcc((times, np.array([0.0, 1.0])), length_s=1.0, foot_grounded_height=0.5)
    assert keys[keys[:, 1] == 1.0][-1, 0] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"length_s": 0.0}, "length must be positive"),
        ({"rate": 0.0}, "rate must be positive"),
        ({"heights": lambda t: t * math.nan}, "height is not finite at 0 s"),
        ({"heights": (np.zeros(2), np.zeros(2))}, "increasing times"),
    ],
)
def test_what_cannot_be_baked_is_refused(changes, message):
    with pytest.raises(FootIKError, match=message):
        bake_openkcc(**{"heights": lambda t: t, "length_s": 1.0, **changes})
