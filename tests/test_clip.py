"""Skeletons and clips: kinematics, cubic sampling, loops, blends, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footik_runtime import quat_arrays
from footik_runtime.builtin import humanoid_rig
from footik_runtime.clip import Clip, blend, cubic_weights
from footik_runtime.errors import FootIKError
from footik_runtime.gait import run, turn_in_place, walk
from footik_runtime.skeleton import Skeleton


def chain(joints: int = 3) -> Skeleton:
    return Skeleton(
        names=tuple(f"j{i}" for i in range(joints)),
        parents=np.arange(-1, joints - 1, dtype=np.int32),
        offsets=np.tile([0.0, 0.0, 1.0], (joints, 1)),
    )


def swaying(frames: int = 20, loop: bool = False) -> Clip:
    rng = np.random.default_rng(3)
    rotations = rng.normal(size=(frames, 3, 4)) * 0.1 + [1.0, 0, 0, 0]
    rotations /= np.linalg.norm(rotations, axis=-1, keepdims=True)
    return Clip(
        skeleton=chain(),
        fps=30.0,
        root_positions=rng.normal(size=(frames, 3)),
        rotations=rotations,
        curves={"weight": rng.random(frames)},
        loop=loop,
    )


def test_forward_kinematics_is_the_product_of_the_chain():
    clip = swaying()
    positions, rotations = clip.model_pose()
    for frame in range(len(clip)):
        place, turn = clip.root_positions[frame], clip.rotations[frame, 0]
        np.testing.assert_allclose(positions[frame, 0], place)
        for joint in (1, 2):
            place = place + quat_arrays.rotate(turn, np.array([0.0, 0.0, 1.0]))
            turn = quat_arrays.mul(turn, clip.rotations[frame, joint])
            np.testing.assert_allclose(positions[frame, joint], place, atol=1e-12)
            np.testing.assert_allclose(rotations[frame, joint], turn, atol=1e-12)


def test_translations_take_the_place_of_offsets():
    clip = swaying()
    moved = np.tile([0.5, 0.0, 0.0], (len(clip), 3, 1))
    positions, _ = chain().forward(clip.rotations, clip.root_positions, moved)
    np.testing.assert_allclose(np.linalg.norm(positions[:, 1] - positions[:, 0], axis=-1), 0.5)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"names": ("a", "a", "b")}, "must be unique; these are not: a"),
        ({"parents": np.array([-1, 2, 0])}, "every other parent comes before its child"),
        ({"parents": np.array([-1, -1, 0])}, "the only root"),
        ({"offsets": np.zeros((2, 3))}, "need parents"),
        ({"offsets": np.full((3, 3), np.nan)}, "offset of joint 'j0' is not finite"),
        ({"names": ()}, "at least one joint"),
    ],
)
def test_impossible_skeleton_is_refused(change, words):
    given = {"names": ("j0", "j1", "j2"), "parents": [-1, 0, 1], "offsets": np.zeros((3, 3))}
    with pytest.raises(FootIKError, match=words):
        Skeleton(**(given | change))


def test_unknown_joint_suggests_the_nearest():
    with pytest.raises(FootIKError, match="Did you mean 'left_foot'"):
        humanoid_rig().skeleton.index("left_fot")


def test_sample_on_a_frame_is_that_frame():
    clip = swaying()
    for frame in (0, 7, 19):
        pose = clip.sample(frame / clip.fps)
        np.testing.assert_allclose(pose.root_position, clip.root_positions[frame], atol=1e-9)
        assert (abs(np.sum(pose.rotations * clip.rotations[frame], axis=-1)) > 1 - 1e-9).all()
        assert pose.curves["weight"] == pytest.approx(clip.curves["weight"][frame])


def test_clip_that_does_not_loop_holds_its_ends():
    clip = swaying()
    np.testing.assert_allclose(clip.sample(-5.0).root_position, clip.root_positions[0])
    np.testing.assert_allclose(clip.sample(99.0).root_position, clip.root_positions[-1])


def test_cubic_sampling_follows_a_smooth_motion_closely():
    times = np.arange(31) / 30.0
    rotations = np.tile([1.0, 0, 0, 0], (31, 3, 1))
    places = np.stack([np.sin(3 * times), np.cos(3 * times), times], axis=1)
    clip = Clip(skeleton=chain(), fps=30.0, root_positions=places, rotations=rotations)
    for t in np.linspace(0.1, 0.9, 17):
        wanted = [math.sin(3 * t), math.cos(3 * t), t]
        np.testing.assert_allclose(clip.sample(t).root_position, wanted, atol=2e-4)


def test_loop_goes_on_by_one_stride_a_cycle_in_both_directions():
    clip = walk(humanoid_rig(), speed=1.2)
    stride = 1.2 * clip.duration
    here = clip.sample(0.31).root_position
    for cycles in (-3, 1, 2, 7):
        there = clip.sample(0.31 + cycles * clip.duration).root_position
        np.testing.assert_allclose(there - here, [cycles * stride, 0, 0], atol=0.02 * abs(cycles))


def test_turning_loop_keeps_turning():
    clip = turn_in_place(humanoid_rig(), rate_deg=90.0)
    before, after = clip.sample(0.2), clip.sample(0.2 + 3 * clip.duration)
    turned = quat_arrays.mul(after.rotations[0], quat_arrays.conj(before.rotations[0]))
    wanted = math.pi / 2 * 3 * clip.duration
    assert turned[0] ** 2 == pytest.approx(math.cos(wanted / 2) ** 2, abs=1e-6)
    assert np.abs(turned[1:3]).max() < 1e-6


def test_loop_has_no_seam():
    clip = walk(humanoid_rig(), speed=1.3)
    for h in (1e-3, 1e-4):
        before = clip.sample(clip.duration - h)
        after = clip.sample(clip.duration + h)
        assert np.linalg.norm(after.root_position - before.root_position) < 2 * h * 2.0
        assert np.abs(after.rotations - before.rotations).max() < 2 * h * 10.0


def test_blend_meets_both_clips_at_its_ends():
    rig = humanoid_rig()
    a, b = walk(rig, speed=1.0), walk(rig, speed=1.6)
    for weight, end in ((0.0, a), (1.0, b)):
        mixed = blend(a, b, weight)
        assert mixed.duration == pytest.approx(end.duration, abs=1e-9)
        for part in (0.0, 0.37, 0.8):
            one, other = mixed.sample(part * mixed.duration), end.sample(part * end.duration)
            np.testing.assert_allclose(one.root_position, other.root_position, atol=2e-3)
            assert (abs(np.sum(one.rotations * other.rotations, axis=-1)) > 1 - 1e-5).all()


def test_blend_half_way_goes_at_a_speed_between():
    rig = humanoid_rig()
    mixed = blend(walk(rig, speed=1.0), walk(rig, speed=1.6), 0.5)
    _, stride = mixed.stride()
    assert 1.2 < np.linalg.norm(stride) / mixed.duration < 1.4


def test_blend_of_other_skeletons_or_weights_is_refused():
    rig = humanoid_rig()
    with pytest.raises(FootIKError, match="joints differ"):
        blend(walk(rig), swaying(), 0.5)
    with pytest.raises(FootIKError, match=r"in \[0, 1\], not 1.5"):
        blend(walk(rig), run(rig), 1.5)


def test_nan_names_frame_and_joint():
    rotations = np.tile([1.0, 0, 0, 0], (5, 3, 1))
    rotations[3, 1, 2] = np.nan
    with pytest.raises(FootIKError, match=r"frame 3, joint 'j1' \(1 of 5 frames are bad\)"):
        Clip(skeleton=chain(), fps=30.0, root_positions=np.zeros((5, 3)), rotations=rotations)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"fps": 0.0}, "fps must be positive"),
        ({"fps": math.inf}, "fps must be positive"),
        ({"root_positions": np.zeros((4, 3))}, r"root_positions must be \(5, 3\), not \(4, 3\)"),
        ({"rotations": np.zeros((5, 3, 4))}, "rotation of joint 0 at frame 0 has zero length"),
        ({"rotations": np.full((5, 3, 4), 1e200)}, "rotation of joint 0 at frame 0 has infinite"),
        ({"curves": {"w": np.zeros(4)}}, "curve 'w' must have 5 values"),
    ],
)
def test_impossible_clip_is_refused(change, words):
    rotations = np.tile([1.0, 0, 0, 0], (5, 3, 1))
    given = {"fps": 30.0, "root_positions": np.zeros((5, 3)), "rotations": rotations}
    with pytest.raises(FootIKError, match=words):
        Clip(skeleton=chain(), **(given | change))


def test_cut_keeps_frames_and_curves():
    clip = swaying()
    part = clip.cut(4, 9)
    assert len(part) == 5
    np.testing.assert_array_equal(part.root_positions, clip.root_positions[4:9])
    np.testing.assert_array_equal(part.curves["weight"], clip.curves["weight"][4:9])
    with pytest.raises(FootIKError, match="cannot cut frames 4:99"):
        clip.cut(4, 99)


def test_signs_of_rotations_are_made_continuous():
    rotations = np.tile([1.0, 0, 0, 0], (4, 3, 1))
    rotations[2] *= -1
    clip = Clip(skeleton=chain(), fps=30.0, root_positions=np.zeros((4, 3)), rotations=rotations)
    assert (clip.rotations[..., 0] == 1.0).all()


def circling(yaw: float, frames: int = 12) -> Clip:
    """A loop that walks along an arc, climbs, and turns by `yaw` a cycle."""
    turns = np.linspace(0.0, yaw, frames)
    rotations = np.tile([1.0, 0, 0, 0], (frames, 3, 1))
    tilt = quat_arrays.about([0, 1, 0], 0.2)
    for f, turn in enumerate(turns):
        rotations[f, 0] = quat_arrays.mul(quat_arrays.about([0, 0, 1], turn + 0.3), tilt)
    places = np.stack([2 * np.sin(turns) + 1, -2 * np.cos(turns), 0.3 * turns], axis=1)
    return Clip(skeleton=chain(), fps=30.0, root_positions=places, rotations=rotations, loop=True)


@pytest.mark.parametrize("yaw", [0.7, -2.0, 3.0, 1e-8])
@pytest.mark.parametrize("cycles", [-5, -1, 1, 4])
def test_turning_loop_goes_on_along_its_arc_in_both_directions(yaw, cycles):
    clip = circling(yaw)
    for time in (0.0, 0.11, 0.2):
        here, there = clip.sample(time), clip.sample(time + cycles * clip.duration)
        onward = quat_arrays.about([0, 0, 1], cycles * yaw)
        # The arc is about (1, 0): what one cycle does, n cycles do n times.
        centre = np.array([1.0, 0.0, 0.0])
        place = centre + quat_arrays.rotate(onward, here.root_position - centre)
        place[2] += 0.3 * cycles * yaw
        np.testing.assert_allclose(there.root_position, place, atol=1e-6)
        turn = quat_arrays.mul(onward, here.rotations[0])
        assert abs(there.rotations[0] @ turn) == pytest.approx(1.0, abs=1e-12)


def test_loop_joins_with_the_slope_it_left_with():
    clip = circling(0.7)
    h = 1e-5
    before = clip.sample(clip.duration).root_position - clip.sample(clip.duration - h).root_position
    after = clip.sample(clip.duration + h).root_position - clip.sample(clip.duration).root_position
    np.testing.assert_allclose(before / h, after / h, atol=1e-3)


def test_curves_and_translations_repeat_in_a_loop():
    rng = np.random.default_rng(0)
    clip = Clip(
        skeleton=chain(), fps=10.0, root_positions=np.zeros((5, 3)), loop=True,
        rotations=np.tile([1.0, 0, 0, 0], (5, 3, 1)),
        translations=np.concatenate([t := rng.normal(size=(4, 3, 3)), t[:1]]),
        curves={"w": np.array([0.0, 1.0, 2.0, 3.0, 0.0])},
    )  # fmt: skip
    for time in (0.0, 0.05, 0.33):
        for cycles in (-2, 3):
            one, other = clip.sample(time), clip.sample(time + cycles * clip.duration)
            assert one.translations is not None
            np.testing.assert_allclose(one.translations, np.array(other.translations), atol=1e-9)
            assert one.curves["w"] == pytest.approx(other.curves["w"], abs=1e-9)
    assert clip.sample(0.05).curves["w"] == pytest.approx(0.5)


def test_clip_of_one_frame_is_that_frame_for_ever():
    for loop in (False, True):
        clip = swaying(1, loop)
        for time in (-1.0, 0.0, 3.0):
            pose = clip.sample(time)
            np.testing.assert_allclose(pose.root_position, clip.root_positions[0])
            np.testing.assert_allclose(pose.rotations, clip.rotations[0])


@given(st.floats(0, 1))
def test_cubic_weights_sum_to_one_and_move_a_straight_line_straight(u):
    weights = np.array(cubic_weights(u))
    assert weights.sum() == pytest.approx(1.0)
    assert weights @ [-1.0, 0.0, 1.0, 2.0] == pytest.approx(u, abs=1e-12)
    assert weights @ [1.0, 0.0, 1.0, 4.0] == pytest.approx(u * u, abs=1e-12)


@pytest.mark.parametrize("frame", [0.0, 1.0])
def test_cubic_weights_are_exact_on_a_frame(frame):
    assert cubic_weights(frame) == (0.0, 1.0 - frame, frame, 0.0)


def test_samples_are_unit_and_between_their_frames():
    clip = swaying()
    for time in np.linspace(-0.1, clip.duration + 0.1, 60):
        rotations = clip.sample(time).rotations
        np.testing.assert_allclose(np.linalg.norm(rotations, axis=-1), 1.0, atol=1e-12)


@pytest.mark.parametrize("time", [math.nan, math.inf, -math.inf])
def test_time_that_is_no_number_is_refused(time):
    with pytest.raises(FootIKError, match=f"clip: cannot sample at time {time}"):
        swaying().sample(time)


@pytest.mark.parametrize(
    ("what", "index", "words"),
    [
        ("root_positions", (2, 1), r"root_positions is not finite at frame 2 \(1 of 5"),
        ("translations", (4, 2, 0), r"translations is not finite at frame 4, joint 'j2' \(1 of 5"),
        ("curve", (1,), r"curve 'w' is not finite at frame 1 \(1 of 5"),
    ],
)
def test_nan_anywhere_is_named(what, index, words):
    given = {
        "root_positions": np.zeros((5, 3)),
        "translations": np.zeros((5, 3, 3)),
        "rotations": np.tile([1.0, 0, 0, 0], (5, 3, 1)),
        "curve": np.zeros(5),
    }
    given[what][index] = math.nan
    curves = {"w": given.pop("curve")}
    with pytest.raises(FootIKError, match=words):
        Clip(skeleton=chain(), fps=30.0, curves=curves, **given)


def test_blend_of_clips_with_and_without_translations_uses_offsets_for_the_one_without():
    still = swaying(10)
    moved = replace(still, translations=np.tile([0.0, 0.0, 3.0], (10, 3, 1)))
    mixed = np.array(blend(still, moved, 0.5).translations)
    np.testing.assert_allclose(mixed, [[[0, 0, 2.0]] * 3] * 10)
    assert blend(still, still, 0.5).translations is None


def test_blend_keeps_the_curves_both_have_and_loops_only_where_both_do():
    a = swaying(8, loop=True).with_curves(only=np.zeros(8))
    b = swaying(8, loop=True)
    assert set(blend(a, b, 0.5).curves) == {"weight"}
    assert blend(a, b, 0.5).loop
    assert not blend(a, swaying(8), 0.5).loop


def test_blend_of_a_turned_sign_is_the_same_rotation():
    clip = swaying(6)
    negative = replace(clip, rotations=-clip.rotations)
    np.testing.assert_allclose(blend(clip, negative, 0.7).rotations, clip.rotations, atol=1e-12)


def test_rotations_are_made_unit_and_unit_ones_are_left_to_the_bit():
    clip = swaying()
    again = replace(clip, rotations=clip.rotations.copy())
    assert again.rotations.tobytes() == clip.rotations.tobytes()
    doubled = replace(clip, rotations=2.0 * clip.rotations)
    np.testing.assert_allclose(doubled.rotations, clip.rotations, atol=1e-15)


def test_times_and_duration_count_from_the_first_frame_to_the_last():
    clip = swaying(31)
    assert (len(clip), clip.duration, clip.times[0]) == (31, 1.0, 0.0)
    assert clip.times[-1] == clip.duration


@pytest.mark.parametrize(("start", "stop"), [(3, 3), (-1, 2), (5, 4)])
def test_cut_of_nothing_is_refused(start, stop):
    with pytest.raises(FootIKError, match=f"cannot cut frames {start}:{stop} from a clip of 20"):
        swaying().cut(start, stop)
