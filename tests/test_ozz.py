"""The port of ozz-animation's kernels on hand-made input; its own vectors are in `peers`."""

import math

import numpy as np
import pytest

from footik_runtime.errors import FootIKError
from footik_runtime.ozz import LocalPose, aim, foot_ik, two_bone
from footik_runtime.quat_arrays import about, rotate

THIGH, SHIN = 0.45, 0.4
KNEE = 0.6  # radians bent


def at(x, y, z):
    matrix = np.eye(4)
    matrix[:3, 3] = (x, y, z)
    return matrix


def bent_leg():
    """Hip at the origin, the leg down -y with its knee towards +x; it opens about +z."""
    half = KNEE * SHIN / (THIGH + SHIN)  # not symmetric, only some bend
    knee = np.array([math.sin(half), -math.cos(half), 0.0]) * THIGH
    shin = half - KNEE
    ankle = knee + np.array([math.sin(shin), -math.cos(shin), 0.0]) * SHIN
    return at(0.0, 0.0, 0.0), at(*knee), at(*ankle)


def moved_leg(target, pole=(1.0, 0.0, 0.0), **options):
    """(knee, ankle) after the solve, and reached."""
    start, mid, end = bent_leg()
    axis = [0.0, 0.0, 1.0]
    start_turn, mid_turn, reached = two_bone(start, mid, end, target, axis, pole, **options)
    knee, ankle = mid[:3, 3], end[:3, 3]
    bent = knee + rotate(mid_turn, ankle - knee)
    return rotate(start_turn, knee), rotate(start_turn, bent), reached


@pytest.mark.parametrize("target", [(0.3, -0.5, 0.2), (-0.1, -0.8, 0.1), (0.5, 0.2, -0.4)])
def test_two_bone_reaches_with_the_knee_on_the_poles_side(target):
    knee, ankle, reached = moved_leg(target)
    assert reached
    assert ankle == pytest.approx(target, abs=1e-9)
    towards = np.array(target) / np.linalg.norm(target)
    aside = knee - towards * (knee @ towards)
    pole = np.array([1.0, 0.0, 0.0])
    pole = pole - towards * (pole @ towards)
    assert aside @ pole == pytest.approx(np.linalg.norm(aside) * np.linalg.norm(pole), abs=1e-9)


def test_two_bone_softens_from_its_share_of_the_length_by_the_stated_curve():
    full = THIGH + SHIN
    asked, soft_start = 0.95 * full, 0.9 * full
    _, ankle, reached = moved_leg((0.0, -asked, 0.0), soften=0.9)
    expected = soft_start + 0.1 * full * (1.0 - 81.0 / 3.5**4)
    assert np.linalg.norm(ankle) == pytest.approx(expected, abs=1e-9)
    assert not reached
    _, ankle, reached = moved_leg((0.0, -2.0 * full, 0.0))
    assert np.linalg.norm(ankle) == pytest.approx(full, abs=1e-9)
    assert not reached


def test_two_bone_turns_by_nothing_at_weight_zero_and_stays_finite_on_degenerate_input():
    start, mid, end = bent_leg()
    axis = [0.0, 0.0, 1.0]
    for turn in two_bone(start, mid, end, [0.3, -0.5, 0.0], axis, [1.0, 0.0, 0.0], weight=0.0)[:2]:
        assert np.array_equal(turn, [1.0, 0.0, 0.0, 0.0])
    flat = np.diag([1.0, 1.0, 0.0, 1.0])
    for joints in ((start, mid, end), (start, start, end), (start, start, start), (flat, mid, end)):
        for target in ([0.0, 0.0, 0.0], [0.0, -5.0, 0.0], end[:3, 3]):
            first, second, _ = two_bone(*joints, target, axis, [0.0, 0.0, 0.0])
            assert np.linalg.norm(first) == pytest.approx(1.0)
            assert np.linalg.norm(second) == pytest.approx(1.0)


def test_aim_points_its_offset_ray_at_the_target_with_up_towards_the_pole():
    forward, offset, up = (np.array(v) for v in ([1.0, 0, 0], [0.0, 0.1, 0.05], [0.0, 1.0, 0.0]))
    joint, target = at(0.2, 1.0, -0.3), np.array([1.0, 0.4, 0.9])
    turn, reached = aim(joint, target, forward, offset, up, [0.0, 1.0, 0.0])
    assert reached
    to_target = target - joint[:3, 3] - rotate(turn, offset)
    towards = to_target / np.linalg.norm(to_target)
    assert towards == pytest.approx(rotate(turn, forward), abs=1e-9)
    assert rotate(turn, up)[1] > 0.5
    turn, reached = aim(joint, joint[:3, 3] + [0.0, 0.05, 0.0], forward, offset, up, [0.0, 1.0, 0])
    assert not reached
    assert np.array_equal(turn, [1.0, 0.0, 0.0, 0.0])


def sample_pose():
    """Two legs of sample-like axes under one root: the bones point down, the knees bend about z."""
    down = about([0.0, 0.0, 1.0], -math.pi / 2.0)  # local +x looks down, local -x up
    bend, unbend = (about([0.0, 0.0, 1.0], angle) for angle in (0.3, -0.6))
    still = np.array([1.0, 0.0, 0.0, 0.0])
    translations = [[0.0, 0.95, 0.0]]
    rotations = [still]
    for x in (0.1, -0.1):
        translations += [[x, 0.0, 0.0], [0.0, 0.0, 0.0], [0.45, 0.0, 0.0], [0.45, 0.0, 0.0]]
        rotations += [down, bend, unbend, bend]
    return LocalPose(
        parents=[-1, 0, 1, 2, 3, 0, 5, 6, 7],
        translations=np.array(translations),
        rotations=np.array(rotations),
        scales=np.ones((9, 3)),
    )


def stairs(origin):
    """Level ground, 0.1 m lower where x < 0; none beyond x = 5."""
    if origin[0] > 5.0:
        return None
    return [origin[0], 0.0 if origin[0] >= 0.0 else -0.1, origin[2]], [0.0, 1.0, 0.0]


def test_foot_ik_lowers_the_pelvis_to_the_lowest_foot_and_puts_both_feet_on_their_steps():
    legs = ((2, 3, 4), (6, 7, 8))
    frame = foot_ik(sample_pose(), legs, [0.05, 3.0, 0.0], 0.0, stairs)
    assert frame.root_w == pytest.approx([0.05, 0.0, 0.0])
    left, right = frame.legs
    ankle_height = right.ankle_initial_w[1]
    assert frame.pelvis_offset_w == pytest.approx([0.0, 0.02 - ankle_height, 0.0])
    for leg, height in ((left, 0.12), (right, 0.02)):
        assert leg.hit
        ankle_w = leg.ankle_m[:3, 3] + frame.root_w + frame.pelvis_offset_w
        assert ankle_w == pytest.approx(leg.ankle_target_w, abs=1e-9)
        assert ankle_w[1] == pytest.approx(height, abs=1e-9)
        assert -leg.ankle_m[:3, 0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)


def test_foot_ik_leaves_the_pose_alone_where_no_ray_hits():
    pose = sample_pose()
    frame = foot_ik(pose, ((2, 3, 4), (6, 7, 8)), [9.0, 3.0, 0.0], 0.5, stairs)
    assert frame.root_w == pytest.approx([9.0, 3.0, 0.0])
    assert not frame.pelvis_offset_w.any()
    assert not any(leg.hit for leg in frame.legs)
    assert frame.legs[0].rotations_l == pytest.approx(pose.rotations[2:5])


def test_bad_input_is_named():
    start, mid, end = bent_leg()
    with pytest.raises(FootIKError, match=r"mid_axis has length 2; it must be a unit vector"):
        two_bone(start, mid, end, [0, -0.5, 0], [0, 0, 2.0], [1.0, 0, 0])
    with pytest.raises(FootIKError, match="target holds NaN"):
        aim(start, [0, math.nan, 0], [1.0, 0, 0], [0, 0, 0], [0, 1.0, 0], [0, 1.0, 0])
