"""Every measure on hand-made runs whose figures are known."""

import json
import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from footik_runtime import metrics as m
from footik_runtime.errors import FootIKError
from footik_runtime.quat_arrays import mul as multiply
from footik_runtime.quat_arrays import rotate as rotate_array
from footik_runtime.recorded import Run
from footik_runtime.resample import resample

SWING, HEEL, FLAT, BALL = range(4)


@pytest.fixture(autouse=True)
def _no_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def standing(frames=121, fps=120.0, legs=2, **changes) -> Run:
    """A character that stands still, flat on both feet, on ground at height 0."""
    times = np.arange(frames) / fps
    sole = np.zeros((frames, legs, 3, 3))
    sole[..., 0] = [-0.05, 0.12, 0.2]
    identity = np.tile([1.0, 0.0, 0.0, 0.0], (frames, legs, 4, 1))
    run = Run(
        fps=fps,
        times=times,
        hips=np.tile([0.0, 0.0, 0.9], (frames, 1)),
        leg_rotations=identity,
        ankle=np.tile([0.0, 0.0, 0.08], (frames, legs, 1)),
        toe=np.tile([0.12, 0.0, 0.02], (frames, legs, 1)),
        sole=sole,
        ground=np.zeros((frames, legs, 3)),
        phase=np.full((frames, legs), FLAT),
    )
    return replace(run, **changes)


def moved(run: Run, by, points=(0, 1, 2)) -> Run:
    """The run with `by` (T, 3) added to ankles, toes and the chosen sole points."""
    sole = run.sole.copy()
    sole[:, :, list(points)] += by[:, None, None]
    return replace(run, sole=sole, ankle=run.ankle + by[:, None], toe=run.toe + by[:, None])


def along_x(run: Run, speed: float) -> np.ndarray:
    return run.times[:, None] * np.array([speed, 0.0, 0.0])


def raised(run: Run, height: float) -> Run:
    return moved(run, np.tile([0.0, 0.0, height], (len(run), 1)))


# Speed and slip


def test_a_foot_sliding_at_a_tenth_of_a_metre_a_second_has_that_speed():
    run = moved(standing(), along_x(standing(), 0.1))
    assert m.pinned_point_speed(run) == pytest.approx(100.0)
    assert m.foot_joint_speed(run) == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("phase", "known", "wanted"),
    [(HEEL, True, 0.0), (BALL, True, 100.0), (FLAT, True, 50.0), (FLAT, False, 0.0)],
)
def test_the_pinned_point_is_the_one_that_carries_the_phase(phase, known, wanted):
    run = standing(phase=np.full((121, 2), phase), phases_known=known)
    run = moved(run, along_x(run, 0.1), points=[1, 2])
    assert m.pinned_point_speed(run) == pytest.approx(wanted, abs=1e-9)


def test_a_step_between_phases_takes_the_point_both_of_them_carry():
    phase = np.full((121, 2), HEEL)
    phase[60:] = FLAT
    run = standing(phase=phase)
    ball = moved(run, along_x(run, 0.1) * (run.times < 60.5 / 120)[:, None], points=[1, 2])
    assert m.pinned_point_speed(replace(ball, phase=phase)) < 1000.0 * 0.1 * 61 / 120
    shift = np.zeros((121, 3))
    shift[60:, 0] = 0.03  # only the ball moves as the heel phase turns flat
    assert m.pinned_point_speed(moved(run, shift, points=[1, 2])) == pytest.approx(0.0)


def test_vertical_motion_is_no_horizontal_speed_but_is_travel_of_a_plant():
    run = standing()
    run = moved(run, run.times[:, None] * np.array([0.0, 0.0, 0.1]))
    assert m.pinned_point_speed(run) == pytest.approx(0.0)
    assert m.slip_per_plant(run).largest == pytest.approx(100.0)


def test_swinging_feet_count_in_no_contact_measure():
    phase = np.full((121, 2), SWING)
    phase[:, 1] = FLAT
    fast = standing(phase=phase)
    fast.sole[:, 0, :, 0] += 3.0 * fast.times[:, None]
    fast.ankle[:, 0, 0] += 3.0 * fast.times
    assert m.pinned_point_speed(fast) == 0.0
    assert m.foot_joint_speed(fast) == 0.0
    assert list(m.plant_slips(fast)) == [0.0]


def test_slip_per_plant_sums_the_pinned_points_path_within_each_plant():
    locked = np.zeros((121, 2), bool)
    locked[10:31, 0] = True
    locked[50:91, 0] = True
    locked[10:51, 1] = True
    pin = np.where(locked, 0, -1)
    run = standing(locked=locked, pin=pin)
    run = moved(run, along_x(run, 0.12), points=[0])  # 1 mm a frame
    assert m.plant_slips(run) == pytest.approx([20.0, 40.0, 40.0])
    assert m.slip_per_plant(run) == pytest.approx((100.0 / 3.0, 40.0))


def test_a_change_of_pin_within_a_plant_is_no_slip():
    locked = np.zeros((121, 1), bool)
    locked[10:61] = True
    pin = np.where(locked, 0, -1)
    pin[36:61] = 1
    run = standing(legs=1, locked=locked, pin=pin)
    shift = np.zeros((121, 3))
    shift[36:, 0] = 0.05
    run = moved(run, shift)  # all points jump as the pin changes
    assert list(m.plant_slips(run)) == [0.0]
    both_ways = moved(run, along_x(run, 0.12), points=[1])
    assert m.plant_slips(both_ways) == pytest.approx([24.0])  # 36 to 60, the ball alone


def test_back_and_forth_slip_does_not_cancel():
    run = standing(legs=1)
    there_and_back = 0.01 * np.sin(2 * np.pi * run.times)[:, None] * np.array([1.0, 0.0, 0.0])
    assert m.slip_per_plant(moved(run, there_and_back)).largest == pytest.approx(40.0, rel=1e-3)


# Moving ground


def platform(times):
    """Place (T, 3) and rotation (T, 4) of a platform that turns, tilts and travels."""
    angle = 0.8 * times
    tilt = 0.15 * np.sin(2.0 * times)
    yaw = np.stack([np.cos(angle / 2), 0 * angle, 0 * angle, np.sin(angle / 2)], -1)
    roll = np.stack([np.cos(tilt / 2), np.sin(tilt / 2), 0 * angle, 0 * angle], -1)
    place = np.stack([0.5 * times, np.sin(times), 0.2 * np.cos(times)], -1)
    return place, multiply(yaw, roll)


def riding(fps=120.0, local_speed=0.0) -> Run:
    run = standing(frames=round(fps) + 1, fps=fps, locked=np.ones((round(fps) + 1, 2), bool))
    run = replace(run, pin=np.ones_like(run.phase))
    run = moved(run, along_x(run, local_speed))
    place, turn = platform(run.times)
    changes = {}
    for name in ("sole", "ankle", "toe"):
        points = getattr(run, name)
        axes = (slice(None),) + (None,) * (points.ndim - 2)
        changes[name] = place[axes] + rotate_array(turn[axes], points)
    return replace(
        run,
        **changes,
        ground=changes["sole"][..., 2],
        ground_positions=np.repeat(place[:, None], 2, 1),
        ground_rotations=np.repeat(turn[:, None], 2, 1),
    )


@pytest.mark.parametrize("fps", [30.0, 50.0, 120.0, 240.0])
def test_a_foot_riding_a_platform_has_no_slip_at_any_rate(fps):
    scores = m.score(riding(fps))
    for key in ("slip_max", "pinned_point_speed", "foot_joint_speed", "skate", "sliding_50"):
        assert scores[key] == pytest.approx(0.0, abs=1e-9), key
    in_world = replace(riding(fps), ground_positions=np.zeros((round(fps) + 1, 2, 3)))
    assert m.score(in_world)["slip_max"] > 100.0


def test_slip_on_a_platform_is_measured_in_its_frame():
    assert m.score(riding(60.0, 0.05))["slip_max"] == pytest.approx(50.0, rel=1e-6)


def test_horizontal_is_the_worlds_on_tilted_ground_too():
    run = moved(standing(), along_x(standing(), 0.1))
    quarter = np.array([math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0])  # x of the body points down
    tilted = replace(run, ground_rotations=np.tile(quarter, (121, 2, 1)))
    assert m.pinned_point_speed(tilted) == pytest.approx(100.0)


@pytest.mark.parametrize("fps", [30.0, 120.0])
def test_stepping_onto_another_body_is_not_measured(fps):
    run = riding(fps)
    later = run.times > 0.5
    ids, places, turns = (
        run.ground_ids.copy(),
        run.ground_positions.copy(),
        run.ground_rotations.copy(),
    )
    ids[later], places[later], turns[later] = 7, 0.0, [1.0, 0.0, 0.0, 0.0]
    still = {name: getattr(run, name).copy() for name in ("sole", "ankle", "toe")}
    for points in still.values():
        points[later] = points[np.argmax(later)]
    run = replace(run, ground_ids=ids, ground_positions=places, ground_rotations=turns, **still)
    assert m.score(run)["slip_max"] == pytest.approx(0.0, abs=1e-9)
    assert m.score(run)["pinned_point_speed"] == pytest.approx(0.0, abs=1e-9)


# Heights


def test_a_foot_12_mm_under_ground_is_7_mm_past_the_tolerance():
    run = raised(standing(), -0.012)
    assert m.penetration(run) == pytest.approx(7.0)
    assert m.penetration_p99(run) == pytest.approx(7.0)
    assert m.penetration_p99(run, "contact") == pytest.approx(7.0)
    assert math.isnan(m.penetration_p99(run, "swing"))
    assert m.float_in_contact(run) == 0.0


def test_a_foot_12_mm_over_ground_floats_7_mm_in_contact_only():
    run = raised(standing(), 0.012)
    assert m.float_in_contact(run) == pytest.approx(7.0)
    assert m.penetration(run) == 0.0
    assert math.isnan(m.float_in_contact(replace(run, phase=np.zeros((121, 2), int))))


def test_penetration_is_of_the_lowest_point_over_its_own_terrain():
    run = standing()
    ground = run.ground.copy()
    ground[..., 2] = 0.025  # a step under the tips
    assert m.penetration(replace(run, ground=ground)) == pytest.approx(20.0)
    assert m.float_in_contact(replace(run, ground=ground)) == 0.0
    ground[...] = -1.0
    assert m.float_in_contact(replace(run, ground=ground)) == pytest.approx(995.0)


def test_penetration_mean_takes_the_lower_foot_and_p99_each_foot():
    run = standing()
    run.sole[:, 0, :, 2] -= 0.015
    assert m.penetration(run) == pytest.approx(10.0)
    swinging = replace(run, phase=np.tile([SWING, FLAT], (121, 1)))
    assert m.penetration_p99(swinging, "swing") == pytest.approx(10.0)
    assert m.penetration_p99(swinging, "contact") == 0.0


def test_points_over_a_pit_do_not_count():
    run = raised(standing(), -0.012)
    ground = run.ground.copy()
    ground[:, :, 0] = np.nan
    run.sole[:, :, 0, 2] = -3.0
    assert m.penetration(replace(run, ground=ground)) == pytest.approx(7.0)
    ground[...] = np.nan
    pit = replace(run, ground=ground)
    for measure in (m.penetration, m.penetration_p99, m.float_in_contact):
        assert math.isnan(measure(pit))
    assert m.skate(pit) == 0.0
    assert m.skating_ratio(pit) == 0.0


def test_where_penetration_is_measured_must_be_known():
    with pytest.raises(FootIKError, match="contact, swing, all"):
        m.penetration_p99(standing(), "air")


# The literature's sliding


def test_skate_is_the_step_of_points_on_the_ground():
    run = moved(standing(), along_x(standing(), 0.12))
    assert m.skate(run) == pytest.approx(1.0)
    assert m.skate(raised(run, 0.01)) == 0.0
    half = run.sole.copy()
    half[60:, ..., 2] += 0.01
    assert m.skate(replace(run, sole=half)) == pytest.approx(59 / 120)


def test_skating_ratio_needs_a_low_and_fast_foot():
    fast = moved(standing(), along_x(standing(), 1.0))
    assert m.skating_ratio(fast) == 1.0
    assert m.skating_ratio(raised(fast, 0.06)) == 0.0
    assert m.skating_ratio(moved(standing(), along_x(standing(), 0.4))) == 0.0


def test_skating_ratio_asks_the_mean_speed_too_and_either_foot():
    # 20 fps, 41 frames: one single fast step has a five-frame mean of a fifth of it.
    run = standing(frames=41, fps=20.0)
    one = np.where(np.arange(41) > 20, 0.06, 0.0)[:, None] * np.array([1.0, 0.0, 0.0])
    assert m.skating_ratio(moved(run, one)) == 0.0
    run.sole[20:31, 0, :, 0] += np.arange(11)[:, None] * 0.05
    run.sole[31:, 0, :, 0] += 0.5
    ratio = m.skating_ratio(run)  # ten steps at 1 m/s; at their ends the mean is still over .5
    assert ratio == pytest.approx(10 / 40)


def test_sliding_weighs_each_step_by_its_height():
    run = moved(standing(), along_x(standing(), 0.1))  # both feet 10 cm
    assert m.sliding(run, 0.025) == pytest.approx(20.0)
    assert m.sliding(raised(run, 0.0125), 0.025) == pytest.approx(20.0 * (2 - math.sqrt(2)))
    assert m.sliding(raised(run, 0.025), 0.05) == pytest.approx(20.0 * (2 - math.sqrt(2)))
    assert m.sliding(raised(run, 0.025), 0.025) == 0.0
    assert m.sliding(raised(run, -0.1), 0.025) == pytest.approx(20.0)


# Motion: pop, hips, jitter, deviation


def walking(fps=120.0, seconds=4.0) -> Run:
    """Smooth periodic motion: hinged legs, bobbing hips, feet that slide a little."""
    frames = round(seconds * fps) + 1
    run = standing(frames=frames, fps=fps)
    t = run.times
    phase = 2 * np.pi * (t[:, None] + np.array([0.0, 0.5]))  # 1 Hz, legs opposed
    angle = np.stack(
        [
            0.5 * np.sin(phase),
            0.5 - 0.5 * np.cos(2 * phase),
            0.2 * np.sin(phase + 1),
            0.1 * np.sin(2 * phase),
        ],
        -1,
    )
    rotations = np.zeros((frames, 2, 4, 4))
    rotations[..., 0], rotations[..., 2] = np.cos(angle / 2), np.sin(angle / 2)
    hips = np.stack([1.3 * t, 0.02 * np.sin(2 * np.pi * t), 0.9 + 0.02 * np.cos(4 * np.pi * t)], -1)
    lift = np.maximum(np.sin(phase), 0.0) ** 3
    shift = np.stack([0.3 * np.sin(phase), 0.0 * phase, 0.1 * lift - 0.008], -1)
    return replace(
        run,
        hips=hips,
        leg_rotations=rotations,
        ankle=run.ankle + shift,
        toe=run.toe + shift,
        sole=run.sole + shift[:, :, None],
        phase=np.where(np.sin(phase) > 1e-9, SWING, FLAT),
        joints=np.stack([hips, hips + 0.2], axis=1),
        stretch=np.full((frames, 2), 0.01),
    )


def jumped(run: Run, angle: float, joint=1) -> Run:
    """One leg joint turned on by `angle` radians from mid-run on, at once."""
    rotations = run.leg_rotations.copy()
    late = rotations[len(run) // 2 :, 0, joint]
    late[:] = multiply(np.array([math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0]), late)
    return replace(run, leg_rotations=rotations)


def test_an_untouched_clip_pops_about_one_and_a_jump_pops_much():
    run = walking()
    assert 1.0 <= m.pop(run, run) < 1.3
    assert m.pop(jumped(run, 0.3), run) > 4.0  # .3 rad in one frame: 270 rad/s^2
    by_joint = m.pop_by_joint(jumped(run, 0.3), run)
    assert np.unravel_index(by_joint.argmax(), by_joint.shape) == (0, 1)


def test_pop_has_the_known_angular_acceleration():
    # theta = a t^2 / 2 about one axis: the acceleration is a at any step.
    run = standing(legs=1)
    angle = 0.5 * 3.0 * run.times**2
    rotations = run.leg_rotations.copy()
    rotations[:, 0, 2] = np.stack([np.cos(angle / 2), 0 * angle, np.sin(angle / 2), 0 * angle], -1)
    turning = replace(run, leg_rotations=rotations)
    assert m.pop_by_joint(turning, run)[0] == pytest.approx([0.0, 0.0, 3.0, 0.0])
    assert m.pop(turning, turning) == pytest.approx(1.0)


def test_pop_does_not_care_for_the_sign_of_quaternions():
    run = walking()
    flipped = run.leg_rotations.copy()
    flipped[100:200] *= -1.0
    assert m.pop(replace(run, leg_rotations=flipped), run) == pytest.approx(m.pop(run, run))
    coarse = walking(30.0)
    flipped = coarse.leg_rotations.copy()
    flipped[25::2] *= -1.0
    coarse_flipped = replace(coarse, leg_rotations=flipped)
    assert m.score(coarse_flipped, coarse)["pop"] == pytest.approx(m.score(coarse, coarse)["pop"])


def test_steps_and_their_ratios_are_against_the_inputs():
    run = walking()
    higher = replace(run, hips=run.hips * 2.0, ankle=run.ankle * 3.0)
    scores = m.score(higher, run)
    assert scores["hip_step_ratio"] == pytest.approx(2.0)
    assert scores["foot_step_ratio"] == pytest.approx(3.0)
    jump = standing()
    jump.hips[60:, 0] += 0.05
    jump.ankle[30:, 0, 2] += 0.03
    assert m.hip_step(jump) == pytest.approx(50.0)
    assert m.foot_step(jump) == pytest.approx(30.0)


def test_hip_acceleration_ratio_is_vertical_and_over_33_ms():
    def falling(acceleration):
        run = standing()
        return replace(
            run, hips=run.hips + 0.5 * acceleration * run.times[:, None] ** 2 * [1.0, 0.0, 1.0]
        )

    assert m.hip_acceleration_ratio(falling(6.0), falling(2.0)) == pytest.approx(3.0)
    sideways = falling(2.0)
    sideways.hips[:, 0] *= 10.0
    assert m.hip_acceleration_ratio(sideways, falling(2.0)) == pytest.approx(1.0)
    jump = falling(2.0)
    jump.hips[60:, 2] += 0.01  # over 4 frames of 1/120 s: .01 / (1/30)^2 = 9 on top of 2
    assert m.hip_acceleration_ratio(jump, falling(2.0)) == pytest.approx(5.5)
    assert math.isfinite(m.hip_acceleration_ratio(jump, standing()))


def test_jitter_is_the_mean_third_derivative():
    run = standing()
    cubic = run.times[:, None, None] ** 3 * np.array([1.0, 0.0, 0.0])
    assert m.jitter(replace(run, joints=np.repeat(cubic, 4, 1))) == pytest.approx(6.0)
    assert m.jitter(run) == 0.0


def test_deviation_measures_have_known_figures():
    run = walking()
    turn = np.array([math.cos(0.05), math.sin(0.05), 0.0, 0.0])
    assert run.joints is not None
    changed = replace(
        run,
        leg_rotations=multiply(np.broadcast_to(turn, run.leg_rotations.shape), run.leg_rotations),
        joints=run.joints + np.array([0.0, 0.03, 0.04]),
        hips=run.hips + along_x(run, 0.2),
    )
    scores = m.score(changed, run)
    assert scores["angle_change"] == pytest.approx(math.degrees(0.1))
    assert scores["mpjpe"] == pytest.approx(50.0)
    assert scores["root_speed_change"] == pytest.approx(200.0, rel=1e-2)
    assert scores["stretch"] == pytest.approx(1.0)
    same = m.score(run, run)
    for key in ("angle_change", "mpjpe", "root_speed_change"):
        assert same[key] == pytest.approx(0.0, abs=1e-5), key
    bare = replace(run, joints=None, stretch=None)
    assert math.isnan(m.score(bare, bare)["mpjpe"])
    assert math.isnan(m.score(bare, bare)["stretch"])


# Resampling


@pytest.mark.parametrize("fps", [30.0, 60.0, 144.0, 240.0])
def test_the_same_motion_scores_the_same_at_any_rate(fps):
    wanted, given = (m.score(walking(rate), walking(rate)) for rate in (120.0, fps))
    for key, value in wanted.items():
        tolerance = 0.1 if key == "jitter" else 0.04
        assert given[key] == pytest.approx(value, rel=tolerance, abs=1e-6), key


@pytest.mark.parametrize("fps", [24.0, 30.0, 60.0, 144.0, 240.0])
def test_resampling_follows_the_motion(fps):
    run, wanted = resample(walking(fps)), walking(120.0)
    assert len(run) == len(wanted)
    assert run.times == pytest.approx(wanted.times)
    assert np.abs(run.hips - wanted.hips).max() < 1e-3
    assert np.abs(run.leg_rotations - wanted.leg_rotations).max() < 4e-3
    assert np.linalg.norm(run.leg_rotations, axis=-1) == pytest.approx(1.0)
    assert np.abs(run.sole - wanted.sole).max() < 4e-3


def test_a_resampled_run_keeps_its_recorded_frames_and_halving_is_exact():
    run = walking(60.0)
    fine = resample(run)
    for name in ("hips", "sole", "ankle", "leg_rotations", "phase", "ground", "stretch"):
        assert getattr(fine, name)[::2] == pytest.approx(getattr(run, name), abs=1e-12), name
    double = walking(240.0)
    assert resample(double).hips == pytest.approx(double.hips[::2], abs=1e-12)
    assert resample(walking(120.0)).hips is not None


@pytest.mark.parametrize("frames", [2, 3, 4, 40])
def test_cubic_resampling_matches_the_spline_of_an_oracle(frames):
    interpolate = pytest.importorskip("scipy.interpolate")
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.uniform(0.02, 0.06, frames))  # uneven frames
    hips = rng.normal(size=(frames, 3))
    run = replace(standing(frames=frames, fps=25.0), times=times, hips=hips)
    tangents = np.gradient(hips, times, axis=0, edge_order=2 if frames > 2 else 1)
    ends = (1, tangents[0]), (1, tangents[-1])
    fine = resample(run)
    wanted = interpolate.CubicSpline(times, hips, bc_type=ends)(fine.times)
    assert fine.hips == pytest.approx(wanted, abs=1e-9)
    run.ankle[:, 0] = hips
    hermite = interpolate.CubicHermiteSpline(times, hips, tangents)(fine.times)
    assert resample(run).ankle[:, 0] == pytest.approx(hermite, abs=1e-9)


def test_a_still_plant_stays_still_between_the_frames_of_a_coarse_run():
    run = walking(30.0)
    locked = np.zeros((121, 2), bool)
    locked[20:41] = True
    sole = run.sole.copy()
    sole[20:41] = sole[20]
    planted = replace(run, sole=sole, locked=locked, pin=np.where(locked, 1, -1))
    assert m.score(planted)["slip_max"] == pytest.approx(0.0, abs=1e-9)


def test_resampled_flags_claim_no_contact_that_one_neighbour_lacks():
    phase = np.array([0, 1, 2, 3, 0, 0, 3, 0])[:, None]
    locked = phase > 0
    pin = np.where(phase == 3, 1, np.where(locked, 0, -1))
    run = standing(frames=8, fps=60.0, legs=1, phase=phase, locked=locked, pin=pin)
    fine = resample(run)
    assert fine.locked is not None
    assert fine.phase[:, 0].tolist() == [0, 0, 1, 1, 2, 2, 3, 0, 0, 0, 0, 0, 3, 0, 0]
    assert fine.locked[:, 0].tolist() == (fine.phase[:, 0] > 0).tolist()
    assert fine.pin[:, 0].tolist() == [-1, -1, 0, 0, 0, -1, 1, -1, -1, -1, -1, -1, 1, -1, -1]


def test_ground_heights_are_asked_again_where_terrain_has_edges():
    run = standing(frames=31, fps=30.0)
    run = moved(run, along_x(run, 1.0))

    def stairs(points, times):
        assert times == pytest.approx(points[:, 0] - np.tile([-0.05, 0.12, 0.2], len(points) // 3))
        return np.where(points[:, 0] > 0.85, np.nan, 0.1 * np.floor(points[:, 0] / 0.3))

    run = replace(
        run, ground=stairs(run.sole.reshape(-1, 3), np.repeat(run.times, 6)).reshape(31, 2, 3)
    )
    fine = resample(run, ground_height=stairs)
    assert set(np.unique(fine.ground[np.isfinite(fine.ground)]).round(6)) == {-0.1, 0.0, 0.1, 0.2}
    assert np.isnan(fine.ground[-1]).all()
    linear = resample(run)
    assert linear.ground[::4][np.isfinite(run.ground)] == pytest.approx(
        run.ground[np.isfinite(run.ground)]
    )
    with pytest.raises(FootIKError, match=r"\(726,\) heights, not \(3,\)"):
        resample(run, ground_height=lambda points, times: np.zeros(3))


def test_runs_of_one_or_two_frames_are_scored_without_complaint():
    for frames in (1, 2, 3):
        scores = m.score(standing(frames=frames), standing(frames=frames))
        assert not any(math.isinf(v) for v in scores.values())
    resample(standing(frames=2, fps=30.0))
    assert len(resample(standing(frames=1, fps=30.0))) == 1


def test_a_run_without_contacts_is_scored_without_complaint():
    run = replace(walking(), phase=np.zeros((481, 2), int), locked=np.zeros((481, 2), bool))
    scores = m.score(run, run)
    for key in ("pinned_point_speed", "slip_mean", "slip_max", "foot_joint_speed", "float"):
        assert math.isnan(scores[key]), key


# Contacts and forces


def contacts():
    return st.integers(1, 30).flatmap(
        lambda n: st.tuples(*[st.lists(st.booleans(), min_size=n, max_size=n)] * 3)
    )


@settings(max_examples=200, deadline=None)
@given(contacts(), st.sampled_from([0.0, 0.01, 0.02, 0.05, 0.2]), st.sampled_from([30.0, 100.0]))
def test_contact_f1_matches_a_brute_force_count(arrays, tolerance, fps):
    predicted, truth, known = arrays
    changes = [
        i + 0.5
        for i in range(len(truth) - 1)
        if truth[i] != truth[i + 1] and known[i] and known[i + 1]
    ]
    hits = errors = 0
    for i, (p, t, k) in enumerate(zip(predicted, truth, known, strict=True)):
        if k and p and t:
            hits += 1
        away = min((abs(i - c) / fps for c in changes), default=math.inf)
        if k and p != t and away >= tolerance - 1e-12:
            errors += 1
    score = m.contact_f1(predicted, truth, known, tolerance, fps)
    if hits + errors == 0:
        assert math.isnan(score)
    else:
        assert score == pytest.approx(2 * hits / (2 * hits + errors))


def test_contact_f1_has_known_figures_and_keeps_feet_apart():
    truth = np.zeros((20, 2), bool)
    truth[5:15, 0] = True
    late = np.roll(truth, 2, axis=0)
    assert m.contact_f1(truth, truth) == 1.0
    assert m.contact_f1(late, truth) == pytest.approx(2 * 8 / (2 * 8 + 2 + 2))
    assert m.contact_f1(late, truth, tolerance_s=0.02, fps=100.0) == 1.0
    assert m.contact_f1(late[:, ::-1], truth, tolerance_s=0.02, fps=100.0) < 0.5
    assert m.contact_f1(~truth, truth) == 0.0


def test_contact_timing_is_the_way_to_the_nearest_predicted_change():
    truth = np.zeros(200, bool)
    truth[20:60] = truth[100:150] = True
    predicted = np.zeros(200, bool)
    predicted[23:59] = predicted[99:152] = True
    assert m.contact_timing(predicted, truth, fps=100.0) == pytest.approx((20.0, 15.0, 0, 0))
    missed = m.contact_timing(np.where(np.arange(200) > 80, predicted, False), truth, fps=100.0)
    assert missed == pytest.approx((10.0, 20.0, 1, 1))
    nothing = m.contact_timing(np.zeros(200, bool), truth, fps=100.0)
    assert math.isnan(nothing.strike_ms)
    assert nothing.strikes_missed == 2


def test_force_scores_have_known_figures():
    t = np.linspace(0, 2 * np.pi, 101)
    truth = np.stack([400 + 300 * np.sin(t), 500 - 300 * np.sin(t)], -1)
    off = m.force_scores(truth + 35.0, truth, 700.0)
    assert off == pytest.approx((5.0, 100 * 35.0 / 600.0, 1.0), rel=1e-3)
    assert m.force_scores(800 - truth, truth, 700.0).correlation == pytest.approx(-1.0)
    holed = truth.copy()
    holed[::3] = np.nan
    assert m.force_scores(truth, holed, 700.0).rmse_bw == 0.0
    flat = m.force_scores(np.full(5, 0.1), np.full(5, 0.1), 700.0)
    assert math.isnan(flat.correlation)
    assert math.isnan(flat.relative_rmse)


# Results, table, errors


def test_scores_are_plain_floats_in_the_order_of_the_measures():
    scores = m.score(walking(30.0), walking(30.0))
    assert list(scores) == [row.key for row in m.MEASURES]
    assert all(type(value) is float for value in scores.values())
    alone = m.score(walking(30.0))
    assert {key for key in alone if math.isnan(alone[key])} == {
        row.key for row in m.MEASURES if row.compares
    }
    parsed = json.loads(json.dumps(m.as_json(alone), allow_nan=False))
    assert parsed["pop"] is None
    assert parsed["jitter"] == alone["jitter"]


def test_scoring_twice_gives_the_same_bits():
    assert m.score(walking(30.0), walking(30.0)) == m.score(walking(30.0), walking(30.0))


def test_the_table_is_aligned_and_shows_what_does_not_apply_as_a_dash():
    run = walking()
    table = m.format_table(
        {"without IK": m.score(run, run), "with IK": {"pop": math.nan, "slip_max": 0.01}}
    )
    lines = table.splitlines()
    assert lines[0].split() == ["measure", "unit", "without", "IK", "with", "IK"]
    assert len(lines) == 1 + len(m.MEASURES)
    assert len({len(line) for line in lines}) == 1
    rows = {
        line[: len(row.label)]: line.split()
        for row, line in zip(m.MEASURES, lines[1:], strict=True)
    }
    assert rows["pop"][-1] == "-"
    assert rows["slip per plant, largest"][-1] == "0.010"
    assert rows["pinned point speed"][-1] == "-"
    assert "custom" in m.format_table({"a": {"custom": 1.0, "pop": None}})


WRONG = {
    "hips": np.zeros((121, 2)),
    "leg_rotations": np.zeros((121, 3, 4, 4)),
    "ankle": np.zeros((120, 2, 3)),
    "sole": np.zeros((121, 2, 2, 3)),
    "ground": np.zeros((121, 2)),
    "phase": np.zeros((121, 1), int),
    "locked": np.zeros((121, 3), bool),
    "pin": np.zeros((121,), int),
    "ground_rotations": np.zeros((121, 2, 3)),
    "joints": np.zeros((5, 2, 3)),
    "stretch": np.zeros((121,)),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_shape_names_the_array_and_both_shapes(name):
    wrong = WRONG[name]
    with pytest.raises(FootIKError) as caught:
        standing(**{name: wrong})
    message = str(caught.value)
    assert f"a run's {name} must be (" in message
    assert f"not {wrong.shape}" in message


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fps": 0.0}, "fps must be positive"),
        ({"times": np.zeros(121)}, "must increase; those of frame 1"),
        ({"hips": np.full((121, 3), np.nan)}, "hips is not finite at frame 0"),
        ({"pin": np.full((121, 2), 3)}, "from 0 to 2"),
        ({"sole_names": ("heel", "toes", "tip")}, "unknown sole point 'ball'"),
    ],
)
def test_other_bad_input_has_its_own_error(changes, message):
    with pytest.raises(FootIKError, match=message):
        replace(standing(), **changes)


def test_a_reference_of_other_frames_or_legs_is_refused():
    with pytest.raises(FootIKError, match=r"run's times is \(121,\) and the reference's \(61,\)"):
        m.score(standing(), standing(frames=61))
    with pytest.raises(FootIKError, match="leg_rotations"):
        m.score(standing(), standing(legs=1))


def test_bad_contacts_forces_and_rates_are_refused():
    with pytest.raises(FootIKError, match=r"predicted .*\(3,\) and \(4,\)"):
        m.contact_f1([0, 1, 1], [0, 1, 1, 0])
    with pytest.raises(FootIKError, match=r"known .*\(1,\) and \(2,\)"):
        m.contact_f1([0, 1], [0, 1], known=[1])
    with pytest.raises(FootIKError, match="tolerance"):
        m.contact_f1([0, 1], [0, 1], tolerance_s=-1.0)
    with pytest.raises(FootIKError, match="fps"):
        m.contact_timing([0, 1], [0, 1], fps=0.0)
    with pytest.raises(FootIKError, match=r"\(3,\) and \(2,\)"):
        m.force_scores(np.zeros(3), np.zeros(2), 700.0)
    with pytest.raises(FootIKError, match="body weight"):
        m.force_scores(np.zeros(3), np.zeros(3), 0.0)
    with pytest.raises(FootIKError, match="resample"):
        resample(standing(), 0.0)
