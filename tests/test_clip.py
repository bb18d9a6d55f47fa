"""Skeletons and clips: kinematics, cubic sampling, loops, blends, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from footik_runtime import quat_arrays
from footik_runtime.builtin import humanoid_rig
from footik_runtime.clip import Clip, blend
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
