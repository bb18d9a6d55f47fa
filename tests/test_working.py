import math
from dataclasses import replace

import numpy as np
import pytest

from footik_runtime import gait
from footik_runtime import quat_arrays as qa
from footik_runtime.builtin import humanoid_rig
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.offline import detect
from footik_runtime.offline.skate import true_walk
from footik_runtime.offline.stages import CleanSettings
from footik_runtime.offline.working import unpad, working
from footik_runtime.phases import Phase, phase_curve
from footik_runtime.rig import find_rig
from footik_runtime.skeleton import Skeleton
from footik_runtime.sole import BALL, HEEL

RIG = humanoid_rig()
WALK = gait.walk(RIG)
BARE = replace(WALK, curves={})
TRUTH = true_walk(WALK, RIG)  # four cycles, without curves, and no loop by name


def seen_from_input(work, points):
    """Points (T, ..., 3) of the working clip where the input has them."""
    shift = unpad(work, work.shift).reshape(-1, *[1] * (points.ndim - 2), 3)
    return qa.rotate(work.back, points - shift)


def on_the_spot(clip):
    """A walk as on a treadmill, and the velocity taken out of it, m/s."""
    _, step = clip.stride()
    velocity = step / clip.duration
    return replace(clip, root_positions=clip.root_positions - velocity * clip.times[:, None])


def same_soles(rig, other):
    """Whether two rigs have the very same soles."""
    return all(a.sole is b.sole for a, b in zip(rig.legs, other.legs, strict=True))


class Level:
    def height(self, points):
        return np.zeros(len(points))

    def normal(self, points):
        return np.tile([0.0, 0.0, 1.0], (len(points), 1))


def test_a_loop_has_its_neighbour_cycles_around_it():
    work = working(WALK, RIG)
    assert work.pad == min(len(WALK) - 1, 90)
    assert work.frames == len(WALK)
    times = (np.arange(len(work.positions)) - work.pad) / WALK.fps
    poses = [WALK.sample(t) for t in times]
    roots = np.array([p.root_position for p in poses])
    assert np.abs(work.clip.root_positions - roots).max() < 1e-9
    positions, rotations = work.clip.model_pose()
    assert np.abs(positions - work.positions).max() < 1e-9
    assert np.abs(np.abs(np.sum(rotations * work.rotations, axis=-1)) - 1.0).max() < 1e-12
    assert np.abs(unpad(work, work.positions) - WALK.model_pose()[0][:, work.joints]).max() < 1e-12


def test_a_turning_loop_is_padded_with_turned_cycles():
    turn = gait.turn_in_place(RIG)
    work = working(turn, RIG)
    positions, _ = work.clip.model_pose()
    assert np.abs(positions - work.positions).max() < 1e-9
    steps = np.linalg.norm(np.diff(work.soles, axis=0), axis=-1)
    seams = [work.pad - 1, work.pad + work.frames - 1]
    assert steps[seams].max() <= steps.max(initial=0.0)
    assert steps[seams].max() < 0.05


def test_a_clip_that_ends_as_it_began_is_a_loop_too():
    work = working(TRUTH.clip, RIG)
    assert work.pad > 0
    assert any("loop" in note for note in work.notes)
    cut = working(TRUTH.clip.cut(0, 100), RIG)
    assert cut.pad == 0
    assert cut.frames == len(cut.positions) == 100


def test_told_contacts_keep_floor_and_soles_and_a_given_ground_all():
    lifted = replace(WALK, root_positions=WALK.root_positions + np.array([0.0, 0.0, 0.3]))
    told = working(lifted, RIG)
    assert not told.shift.any()
    assert same_soles(told.rig, RIG)
    bare = working(replace(lifted, curves={}), RIG)
    assert np.allclose(unpad(bare, bare.shift)[:, 2], -0.3, atol=1e-3)
    given = working(replace(lifted, curves={}), RIG, ground=Level())
    assert not given.shift.any()
    assert same_soles(given.rig, RIG)
    again = working(lifted, RIG, settings=CleanSettings(redetect=True))
    assert again.shift.any()


@pytest.mark.parametrize("loop", [True, False])
def test_a_belt_is_taken_out_exactly_where_feet_stand_still(loop):
    spot = on_the_spot(BARE)
    if not loop:
        spot = replace(on_the_spot(TRUTH.clip.cut(0, 150)), loop=False)
        phases = TRUTH.phases[:150]
    else:
        phases = np.stack([WALK.curves[phase_curve(leg.name)] for leg in RIG.legs], axis=1)
    work = working(spot, RIG)
    assert any("belt" in note for note in work.notes)
    soles = unpad(work, work.soles)
    for phase, point in ((Phase.HEEL, HEEL), (Phase.BALL, BALL), (Phase.FLAT, BALL)):
        stays = (phases[1:] == phase) & (phases[:-1] == phase)
        assert np.linalg.norm(np.diff(soles, axis=0)[stays][:, point], axis=-1).max() < 1e-4
    back = seen_from_input(work, unpad(work, work.positions))
    assert np.abs(back - spot.model_pose()[0][:, work.joints]).max() < 1e-9


def test_no_belt_under_a_walk_that_travels():
    assert not any("belt" in note for note in working(BARE, RIG).notes)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
def test_a_tilted_floor_is_levelled_and_turned_back(axis):
    tilt = qa.about(axis, math.radians(2.0))
    rotations = TRUTH.clip.rotations.copy()
    rotations[:, 0] = qa.mul(tilt, rotations[:, 0])
    roots = qa.rotate(tilt, TRUTH.clip.root_positions)
    clip = replace(TRUTH.clip, root_positions=roots, rotations=rotations)
    work = working(clip, RIG)
    left = qa.to_rotvec(qa.mul(qa.conj(work.back), tilt))
    # A straight walk says little about the tilt across its way: that is left to the plants.
    assert np.degrees(np.linalg.norm(left)) < (0.3 if axis[1] else 2.0)
    back = seen_from_input(work, unpad(work, work.positions))
    assert np.abs(back - clip.model_pose()[0][:, work.joints]).max() < 1e-9
    positions, _ = work.clip.model_pose()
    assert np.abs(positions - work.positions).max() < 1e-9


def test_soles_are_fitted_to_level_ground_and_not_to_a_slope():
    nose_up = qa.about([0.0, 1.0, 0.0], math.radians(-6.0))
    legs = tuple(
        replace(leg, sole=replace(leg.sole, frame=qa.mul(leg.sole.frame, nose_up)))
        for leg in RIG.legs
    )
    work = working(TRUTH.clip, replace(RIG, legs=legs))
    for leg, true in zip(work.rig.legs, RIG.legs, strict=True):
        off = qa.to_rotvec(qa.mul(qa.conj(true.sole.frame), leg.sole.frame))
        assert np.degrees(np.linalg.norm(off)) < 0.5
    slope = working(true_walk(WALK, RIG, ground="slope").clip, RIG)
    for leg, true in zip(slope.rig.legs, RIG.legs, strict=True):
        assert np.array_equal(leg.sole.frame, true.sole.frame)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_clips_of_few_frames_are_taken(frames):
    work = working(BARE.cut(0, frames), RIG)
    assert len(work.positions) == frames
    assert np.isfinite(work.soles).all()


def test_a_rig_of_another_skeleton_is_refused():
    names = ("a", "b", "c", "d", "e", "f", "g")
    other = Skeleton(
        names=names,
        parents=np.array([-1, 0, 1, 2, 0, 4, 5]),
        offsets=np.array(
            [[0, 0, 1.0], [0, 0.1, 0], [0, 0, -0.4], [0, 0, -0.4], [0, -0.1, 0], [0, 0, -0.4],
             [0, 0, -0.4]]
        ),
    )  # fmt: skip
    rig = find_rig(other, legs={"left": ("b", "c", "d"), "right": ("e", "f", "g")})
    with pytest.raises(FootIKError, match="another skeleton"):
        working(WALK, rig)


def test_a_loop_of_one_frame_is_not_padded():
    one = Clip(
        skeleton=WALK.skeleton,
        fps=60.0,
        root_positions=WALK.root_positions[:1],
        rotations=WALK.rotations[:1],
        loop=True,
    )
    assert working(one, RIG).pad == 0


def test_a_loop_in_place_without_its_last_frame_is_a_loop():
    spot = replace(on_the_spot(BARE), loop=False)
    open_end = replace(spot, root_positions=spot.root_positions[:-1], rotations=spot.rotations[:-1])
    work = working(open_end, RIG)
    assert work.pad > 0
    assert not work.closed
    assert any("comes the first" in note for note in work.notes)
    assert len(unpad(work, work.soles)) == len(open_end)
    # The frame after its last is its first, a cycle of the belt further on.
    after = work.positions[work.pad + work.frames] - work.positions[work.pad]
    assert np.abs(after - after[0]).max() < 1e-9
    step = -work.belt * len(open_end) / open_end.fps
    assert np.abs(after[0] - step).max() < 1e-9
    # Half a cycle is none.
    half = spot.cut(0, len(spot) // 2)
    assert working(half, RIG).pad == 0


@pytest.mark.parametrize("speed", [2.5, 4.0])
def test_a_run_in_place_is_on_a_belt_at_its_speed(speed):
    clip = gait.run(RIG, speed=speed)
    work = working(on_the_spot(replace(clip, curves={})), RIG)
    assert work.belt == pytest.approx([-speed, 0.0, 0.0], abs=0.05 * speed)
    assert work.belt[2] == 0.0
    found = detect.of_clip(work, CleanSettings())
    assert (found.belt == work.belt).all()
    assert unpad(work, found.foot).any(axis=0).all()


def test_an_inclined_belt_is_taken_out_with_its_climb():
    uphill = true_walk(WALK, RIG, ground="slope").clip
    velocity = (uphill.root_positions[-1] - uphill.root_positions[0]) / uphill.duration
    assert velocity[2] > 0.05
    still = uphill.root_positions - velocity * uphill.times[:, None]
    work = working(replace(uphill, root_positions=still), RIG)
    assert work.belt == pytest.approx(-velocity, abs=0.01)
    assert working(on_the_spot(BARE), RIG).belt[2] == 0.0
