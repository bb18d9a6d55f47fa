import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from footik_runtime import gait
from footik_runtime import quat_arrays as qa
from footik_runtime.errors import FootIKError
from footik_runtime.gait_poses import find_body, name_body
from footik_runtime.phases import Phase, phase_curve, weight_curve
from footik_runtime.rig import Leg, Rig, Sole
from footik_runtime.skeleton import Skeleton


def make_rig(size=1.0, arms="T", toes=True, yaw=0.0, floor_root=False, splay=0.0, thigh=0.44):
    """A person of 0.88 m legs; every joint's rest frame is turned, so that none is special."""
    turn = qa.about([0, 0, 1], yaw)
    names, parents, places = [], [], []

    def joint(name, parent, place):
        names.append(name)
        parents.append(names.index(parent) if parent else -1)
        places.append(qa.rotate(turn, np.array(place) * size))

    if floor_root:
        joint("root", None, (0, 0, 0))
    joint("hips", "root" if floor_root else None, (0, 0, 1.0))
    for side, s in (("left", 1), ("right", -1)):
        hip = np.array([0.0, 0.09 * s, 0.95])
        along = np.array([0, np.sin(splay) * s, -np.cos(splay)])
        joint(f"{side}_hip", "hips", hip)
        joint(f"{side}_knee", f"{side}_hip", hip + along * thigh)
        ankle = hip + along * (thigh + 0.44)
        joint(f"{side}_ankle", f"{side}_knee", ankle)
        if toes:
            joint(f"{side}_toe", f"{side}_ankle", ankle + np.array([0.14, 0, -0.05]))
    for name, parent, z in (
        ("spine", "hips", 1.1),
        ("chest", "spine", 1.3),
        ("neck", "chest", 1.5),
        ("head", "neck", 1.6),
    ):
        joint(name, parent, (0, 0, z))
    if arms:
        way = {"T": (0, 1, 0), "A": (0, 0.7, -0.7), "down": (0, 0, -1)}[arms]
        for side, s in (("left", 1), ("right", -1)):
            way_s = np.array(way) * [1, s, 1]
            shoulder = np.array([0, 0.18 * s, 1.45])
            joint(f"{side}_clavicle", "chest", (0, 0.03 * s, 1.45))
            joint(f"{side}_arm", f"{side}_clavicle", shoulder)
            joint(f"{side}_elbow", f"{side}_arm", shoulder + 0.28 * way_s)
            joint(f"{side}_hand", f"{side}_elbow", shoulder + 0.54 * way_s)
    order = range(len(names))
    world = qa.unit(np.random.default_rng(3).normal(size=(len(names), 4)))
    if floor_root:
        world[0] = [1, 0, 0, 0]
    offsets, local = np.zeros((len(names), 3)), world.copy()
    for j in order:
        p = parents[j]
        if p < 0:
            offsets[j] = places[j]
        else:
            offsets[j] = qa.rotate(qa.conj(world[p]), places[j] - places[p])
            local[j] = qa.mul(qa.conj(world[p]), world[j])
    skeleton = Skeleton(
        names=tuple(names), parents=np.array(parents), offsets=offsets, rest_rotations=local
    )
    legs = []
    for side in ("left", "right"):
        ankle = names.index(f"{side}_ankle")
        sole = Sole(
            frame=qa.mul(qa.conj(world[ankle]), turn),
            height=0.08 * size,
            heel=0.06 * size,
            ball=(0.13 if toes else 0.2) * size,
            tip=0.2 * size,
            half_width=0.045 * size,
        )
        legs.append(
            Leg(
                name=side,
                hip=names.index(f"{side}_hip"),
                knee=names.index(f"{side}_knee"),
                ankle=ankle,
                toe=names.index(f"{side}_toe") if toes else -1,
                sole=sole,
            )
        )
    return Rig(
        skeleton=skeleton,
        hips=names.index("hips"),
        legs=tuple(legs),
        forward=qa.rotate(turn, [1.0, 0.0, 0.0]),
    )


def sole_points(rig, clip, leg):
    """Heel, ball and tip (T, 3) in the world; the tip moves with the toes."""
    positions, rotations = clip.model_pose()
    ankle, sole = positions[:, leg.ankle], leg.sole
    frame = qa.mul(rotations[:, leg.ankle], sole.frame)
    heel, ball, tip = (
        ankle + qa.rotate(frame, np.array([x, 0.0, -sole.height]))
        for x in (-sole.heel, sole.ball, sole.tip)
    )
    if leg.toe >= 0:
        rest, turned = rig.skeleton.rest_pose()
        rest_frame = qa.mul(turned[leg.ankle], sole.frame)
        place = rest[leg.ankle] + qa.rotate(rest_frame, [sole.tip, 0.0, -sole.height])
        own = qa.rotate(qa.conj(turned[leg.toe]), place - rest[leg.toe])
        tip = positions[:, leg.toe] + qa.rotate(rotations[:, leg.toe], own)
    return heel, ball, tip


def slip_speed(rig, clip, leg):
    """Greatest speed, m/s, of the sole points that carry the phase at both ends of a frame."""
    phase = clip.curves[phase_curve(leg.name)]
    heel, ball, _ = sole_points(rig, clip, leg)
    worst = 0.0
    for point, held in (
        (heel, (phase == Phase.HEEL) | (phase == Phase.FLAT)),
        (ball, (phase == Phase.BALL) | (phase == Phase.FLAT)),
    ):
        assert np.all(np.abs(point[held, 2]) < 1e-6)
        both = held[1:] & held[:-1]
        speeds = np.linalg.norm(np.diff(point, axis=0), axis=1) * clip.fps
        worst = max(worst, float(speeds[both].max(initial=0.0)))
    return worst


def knee_flexion(rig, clip, leg):
    """(T,) rad, negative where the knee bends backwards, seen across the foot."""
    positions, rotations = clip.model_pose()
    hip, knee, ankle = (positions[:, j] for j in (leg.hip, leg.knee, leg.ankle))
    thigh, shin = qa.unit(knee - hip), qa.unit(ankle - knee)
    left = qa.rotate(qa.mul(rotations[:, leg.ankle], leg.sole.frame), np.array([0.0, 1.0, 0.0]))
    bent = np.arccos(np.clip(np.sum(thigh * shin, axis=1), -1.0, 1.0))
    return np.copysign(bent, np.sum(np.cross(thigh, shin) * left, axis=1))


RIG = make_rig()
CLIPS = {
    "walk_0.4": lambda rig: gait.walk(rig, speed=0.4),
    "walk_1.3": lambda rig: gait.walk(rig),
    "walk_2": lambda rig: gait.walk(rig, speed=2.0),
    "run_2": lambda rig: gait.run(rig, speed=2.0),
    "run_3": lambda rig: gait.run(rig),
    "run_5": lambda rig: gait.run(rig, speed=5.0),
    "turn_left": lambda rig: gait.turn_in_place(rig),
    "turn_right": lambda rig: gait.turn_in_place(rig, rate_deg=-170.0),
    "idle": lambda rig: gait.idle(rig),
}
RIGS = {
    "t_pose": {},
    "a_pose_splayed_legs": {"arms": "A", "splay": 0.35},
    "no_arms_no_toes": {"arms": "", "toes": False},
    "faces_elsewhere": {"yaw": 2.0, "arms": "down"},
    "root_on_the_floor": {"floor_root": True, "yaw": -0.7},
    "child": {"size": 0.6},
    "giant": {"size": 1.6},
}


@pytest.mark.parametrize("make", CLIPS.values(), ids=CLIPS)
@pytest.mark.parametrize("shape", RIGS.values(), ids=RIGS)
def test_pinned_points_hold_still_and_no_sole_point_enters_the_ground(shape, make):
    rig = make_rig(**shape)
    size = shape.get("size", 1.0)
    if size != 1.0 and make in (CLIPS["walk_0.4"], CLIPS["walk_2"], CLIPS["run_2"], CLIPS["run_5"]):
        pytest.skip("the speed is out of range for this size")
    clip = make(rig)
    for leg in rig.legs:
        assert slip_speed(rig, clip, leg) < 1e-3
        lowest = min(point[:, 2].min() for point in sole_points(rig, clip, leg))
        assert lowest > -5e-4


@settings(max_examples=15, deadline=None)
@given(st.floats(0.35, 2.1), st.sampled_from([30.0, 60.0, 144.0]))
def test_any_walking_speed_is_held_exactly_with_still_feet_in_reach(speed, fps):
    clip = gait.walk(RIG, speed=speed, fps=fps)
    travel = clip.root_positions[-1] - clip.root_positions[0]
    np.testing.assert_allclose(travel / clip.duration, [speed, 0, 0], atol=1e-9)
    for leg in RIG.legs:
        assert slip_speed(RIG, clip, leg) < 1e-3
        assert knee_flexion(RIG, clip, leg).min() > 0.25


@pytest.mark.parametrize("make", CLIPS.values(), ids=CLIPS)
def test_knees_bend_forward_only_and_legs_stay_within_reach(make):
    clip = make(RIG)
    positions, _ = clip.model_pose()
    for leg, length in zip(RIG.legs, RIG.leg_lengths, strict=True):
        reach = np.linalg.norm(positions[:, leg.ankle] - positions[:, leg.hip], axis=1) / length
        assert reach.max() <= 0.9855
        assert knee_flexion(RIG, clip, leg).min() > 0.25


@pytest.mark.parametrize("make", CLIPS.values(), ids=CLIPS)
def test_the_last_frame_is_the_first_and_velocity_is_continuous_over_the_seam(make):
    clip = make(RIG)
    turn = qa.mul(clip.rotations[-1, 0], qa.conj(clip.rotations[0, 0]))
    np.testing.assert_allclose(clip.rotations[-1, 1:], clip.rotations[0, 1:], atol=1e-12)
    assert abs(turn[1]) + abs(turn[2]) < 1e-9
    positions, _ = clip.model_pose()
    ahead = positions[1:4] - clip.root_positions[0]
    ahead = qa.rotate(turn, ahead) + clip.root_positions[-1]
    joined = np.concatenate([positions[-4:], ahead])
    bends = np.linalg.norm(np.diff(joined, n=2, axis=0), axis=-1)
    inside = np.linalg.norm(np.diff(positions, n=2, axis=0), axis=-1)
    assert bends.max() <= 1.2 * inside.max() + 1e-12
    for name, values in clip.curves.items():
        assert values[0] == values[-1], name


@pytest.mark.parametrize("make", CLIPS.values(), ids=CLIPS)
def test_no_joint_has_an_acceleration_spike(make):
    clip = make(RIG)
    positions, _ = clip.model_pose()
    spine = np.linalg.norm(np.diff(positions, n=2, axis=0), axis=-1) * clip.fps**2
    assert np.all(spine.max(axis=0) < 3.0 * np.percentile(spine, 90, axis=0) + 0.5)
    assert spine.max() < (400.0 if clip.name == "run" else 130.0)


@pytest.mark.parametrize("name", ["walk_0.4", "walk_1.3", "walk_2", "run_2", "run_3", "run_5"])
def test_contacts_go_heel_flat_ball_swing_and_the_weights_agree(name):
    clip = CLIPS[name](RIG)
    for leg in RIG.legs:
        phase = clip.curves[phase_curve(leg.name)][:-1]
        start = int(np.flatnonzero((phase == Phase.HEEL) & (np.roll(phase, 1) == Phase.SWING))[0])
        phase = np.roll(phase, -start)
        changes = phase[np.flatnonzero(np.diff(phase, prepend=-1.0))]
        assert list(changes) == [Phase.HEEL, Phase.FLAT, Phase.BALL, Phase.SWING]
        weight = np.roll(clip.curves[weight_curve(leg.name)][:-1], -start)
        np.testing.assert_array_equal(weight >= 0.5, phase != Phase.SWING)
        assert weight.min() == 0.0
        assert weight.max() == 1.0


def duty(clip, name="left"):
    return float(np.mean(clip.curves[phase_curve(name)][:-1] != Phase.SWING))


def test_duty_factor_falls_with_speed_and_running_flies():
    walks = [duty(gait.walk(RIG, speed=v, fps=240.0)) for v in (0.4, 1.3, 2.0)]
    assert walks == sorted(walks, reverse=True)
    assert walks[1] == pytest.approx(0.62, abs=0.02)
    assert all(0.55 < d < 0.72 for d in walks)
    clip = gait.run(RIG, fps=240.0)
    assert duty(clip) == pytest.approx(0.35, abs=0.02)
    air = np.all([clip.curves[phase_curve(n)] == Phase.SWING for n in ("left", "right")], axis=0)
    assert air.mean() == pytest.approx(1.0 - 2 * 0.35, abs=0.03)


def test_walking_always_has_a_foot_on_the_ground():
    for speed in (0.4, 2.0):
        clip = gait.walk(RIG, speed=speed)
        held = [clip.curves[phase_curve(n)] != Phase.SWING for n in ("left", "right")]
        assert np.any(held, axis=0).all()


@pytest.mark.parametrize("make", [CLIPS["walk_1.3"], CLIPS["run_3"]], ids=["walk", "run"])
def test_left_and_right_are_mirror_images_half_a_cycle_apart(make):
    clip = make(RIG)
    half = (len(clip) - 1) // 2
    positions, _ = clip.model_pose()
    positions = (
        positions[:-1]
        - np.stack(
            [
                np.linspace(0, np.ptp(clip.root_positions[[0, -1], 0]), len(clip)),
                *np.zeros((2, len(clip))),
            ],
            -1,
        )[:-1, None]
    )
    names = RIG.skeleton.names
    other = {"left": "right", "right": "left"}
    for j, name in enumerate(names):
        side, _, part = name.partition("_")
        mirror = names.index(f"{other[side]}_{part}") if side in other else j
        np.testing.assert_allclose(
            np.roll(positions[:, mirror], -half, axis=0) * [1, -1, 1], positions[:, j], atol=1e-6
        )


def test_the_same_froude_number_gives_the_same_rotations_at_any_size():
    big = make_rig(size=4.0)
    for clip, scaled in (
        (gait.walk(RIG, speed=1.1), gait.walk(big, speed=2.2, fps=30.0)),
        (gait.run(RIG, speed=3.0), gait.run(big, speed=6.0, fps=30.0)),
    ):
        assert len(scaled) == len(clip)
        np.testing.assert_allclose(scaled.rotations, clip.rotations, atol=1e-6)
        np.testing.assert_allclose(scaled.root_positions, 4.0 * clip.root_positions, atol=1e-6)


def test_the_clip_moves_and_faces_along_the_rigs_forward():
    straight, turned = gait.walk(RIG), gait.walk(make_rig(yaw=2.0))
    way = qa.about([0, 0, 1], 2.0)
    np.testing.assert_allclose(
        turned.model_pose()[0], qa.rotate(way, straight.model_pose()[0]), atol=1e-8
    )


def test_hips_rise_about_four_centimetres_twice_a_cycle():
    clip = gait.walk(RIG)
    height = clip.root_positions[:-1, 2]
    assert np.ptp(height) == pytest.approx(0.04, abs=0.008)
    peaks = (height > np.roll(height, 1)) & (height >= np.roll(height, -1))
    assert peaks.sum() == 2


def test_a_walking_foot_clears_the_ground_in_mid_swing():
    for speed in (0.4, 1.3, 2.0):
        clip = gait.walk(RIG, speed=speed)
        leg = RIG.legs[0]
        lowest = np.min([p[:, 2] for p in sole_points(RIG, clip, leg)], axis=0)
        swing = np.flatnonzero(clip.curves[phase_curve("left")][:-1] == Phase.SWING)
        middle = swing[len(swing) // 3 : 2 * len(swing) // 3]
        assert 0.015 < lowest[middle].min() < 0.06


def test_arms_hang_beside_the_body_whatever_the_rest_pose():
    for arms in ("T", "A", "down"):
        rig = make_rig(arms=arms)
        positions, _ = gait.idle(rig).model_pose()
        names = rig.skeleton.names
        for side in ("left", "right"):
            shoulder, hand = (positions[:, names.index(f"{side}_{n}")] for n in ("arm", "hand"))
            assert np.all(shoulder[:, 2] - hand[:, 2] > 0.45)
            assert np.all(hand[:, 0] > shoulder[:, 0])


@pytest.mark.parametrize("name", ["walk_1.3", "run_3"])
def test_each_arm_swings_with_the_other_leg(name):
    clip = CLIPS[name](RIG)
    positions, _ = clip.model_pose()
    ahead = positions[:, :, 0] - clip.root_positions[:, :1]
    at = RIG.skeleton.names.index
    assert np.corrcoef(ahead[:, at("left_hand")], ahead[:, at("right_ankle")])[0, 1] > 0.6
    assert np.corrcoef(ahead[:, at("left_hand")], ahead[:, at("left_ankle")])[0, 1] < -0.6


def test_the_head_stays_steadier_than_the_hips():
    clip = gait.walk(RIG)
    _, rotations = clip.model_pose()
    turns = qa.mul(rotations, qa.conj(rotations[:1]))
    head, hips = RIG.skeleton.names.index("head"), RIG.hips
    assert np.abs(turns[:, head, 1:]).max() < 0.3 * np.abs(turns[:, hips, 1:]).max()


@pytest.mark.parametrize("rate", [-180.0, -30.0, 45.0, 120.0])
def test_the_root_turns_at_the_rate_asked_one_foot_at_a_time(rate):
    clip = gait.turn_in_place(RIG, rate_deg=rate)
    # The hips also list a little, so compare whole cycles exactly and steps on average.
    turn = qa.mul(clip.rotations[-1, 0], qa.conj(clip.rotations[0, 0]))
    assert 2.0 * np.degrees(np.arctan2(turn[3], turn[0])) == pytest.approx(rate * clip.duration)
    lifted = [clip.curves[phase_curve(n)] == Phase.SWING for n in ("left", "right")]
    assert all(foot.any() for foot in lifted)
    assert not np.logical_and(*lifted).any()
    np.testing.assert_allclose(clip.root_positions[-1], clip.root_positions[0], atol=0.05)


def test_idle_feet_are_exactly_still_while_the_body_moves():
    clip = gait.idle(RIG)
    for leg in RIG.legs:
        assert slip_speed(RIG, clip, leg) < 1e-9
        assert np.all(clip.curves[phase_curve(leg.name)] == Phase.FLAT)
        assert np.all(clip.curves[weight_curve(leg.name)] == 1.0)
    assert np.ptp(clip.root_positions[:, 1]) > 0.02


def test_the_upper_body_is_found_by_topology_or_given_by_name():
    named = name_body(
        RIG.skeleton,
        torso=("spine", "chest"),
        neck=("neck", "head"),
        left_arm=("left_arm", "left_elbow", "left_hand"),
        right_arm=("right_arm", "right_elbow", "right_hand"),
    )
    assert find_body(RIG) == named
    assert find_body(make_rig(arms="")).arms == ()
    with pytest.raises(FootIKError, match="Did you mean 'head'"):
        name_body(RIG.skeleton, neck=("haed",))


def test_two_calls_give_the_same_bits():
    first, second = gait.walk(RIG), gait.walk(RIG)
    assert first.rotations.tobytes() == second.rotations.tobytes()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: gait.walk(RIG, speed=9.0), "walking speed must be 0.297 to 2.18 m/s"),
        (lambda: gait.walk(RIG, speed=float("nan")), "walking speed"),
        (lambda: gait.run(RIG, speed=0.0), "running speed"),
        (lambda: gait.turn_in_place(RIG, rate_deg=0.0), "rate_deg must be 5 to 180"),
        (lambda: gait.idle(RIG, seconds=-1.0), "seconds must be at least 1"),
        (lambda: gait.walk(RIG, fps=0.0), "fps must be at least 10"),
        (lambda: gait.walk(without_legs()), "needs a rig with two legs, this one has 0"),
        (lambda: gait.idle(make_rig(size=0.0)), "0 m long"),
    ],
)
def test_bad_input_raises_one_clear_error(call, message):
    with pytest.raises(FootIKError, match=message):
        call()


def without_legs():
    return Rig(skeleton=RIG.skeleton, hips=RIG.hips, legs=(), forward=RIG.forward)


def test_a_leg_with_one_bone_of_no_length_stays_finite():
    clip = gait.idle(make_rig(thigh=0.0))
    assert np.isfinite(clip.rotations).all()


@pytest.mark.parametrize("name", ["walk_1.3", "run_3", "idle"])
def test_thighs_and_shins_keep_their_outer_side_outside(name):
    clip = CLIPS[name](RIG)
    _, rotations = clip.model_pose()
    _, rest = RIG.skeleton.rest_pose()
    for leg in RIG.legs:
        for joint in (leg.hip, leg.knee):
            turn = qa.mul(rotations[:, joint], qa.conj(rest[joint]))
            assert np.all(qa.rotate(turn, np.array([0.0, 1.0, 0.0]))[:, 1] > 0.95)
