import math
import os
import time
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from footik_runtime import gait
from footik_runtime import quat_arrays as qa
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.formats.bvh import read_bvh
from footik_runtime.motion import Motion, sample_pose
from footik_runtime.phases import Phase
from footik_runtime.rig import find_rig
from footik_runtime.rig_model import find_rig_in_model
from footik_runtime.skeleton import Skeleton
from footik_runtime.sole import BALL, HEEL, all_sole_points

ROOT = Path(__file__).parent.parent
BVH = Path(os.environ.get("FOOTIK_SHARED", ROOT.parent / "shared")) / "data" / "bvh"
RIG = find_rig_in_model(mujoco.MjModel.from_xml_path(str(ROOT / "models" / "humanoid.xml")))
GAITS = {
    "walk": lambda rig: gait.walk(rig),
    "stroll": lambda rig: gait.walk(rig, speed=0.5),
    "run": lambda rig: gait.run(rig),
    "turn": lambda rig: gait.turn_in_place(rig, rate_deg=90.0),
    "turn right": lambda rig: gait.turn_in_place(rig, rate_deg=-40.0),
    "idle": lambda rig: gait.idle(rig),
}

pytestmark = pytest.mark.filterwarnings("error")


def bare(clip, cycles=3, start=0.0):
    """Some cycles of a loop from `start` s on, without its curves, as if they were captured."""
    poses = [clip.sample(start + t) for t in np.arange((len(clip) - 1) * cycles + 1) / clip.fps]
    return Clip(
        skeleton=clip.skeleton,
        fps=clip.fps,
        root_positions=np.array([p.root_position for p in poses]),
        rotations=np.array([p.rotations for p in poses]),
    )


def moved(clip, yaw, place=(0.0, 0.0, 0.0)):
    turn = qa.about([0, 0, 1], yaw)
    rotations = clip.rotations.copy()
    rotations[:, 0] = qa.mul(turn, rotations[:, 0])
    roots = qa.rotate(turn, clip.root_positions) + np.asarray(place)
    return replace(clip, root_positions=roots, rotations=rotations)


def scaled(rig, size):
    lengths = ("height", "heel", "ball", "tip", "half_width")
    legs = tuple(
        replace(leg, sole=replace(leg.sole, **{k: getattr(leg.sole, k) * size for k in lengths}))
        for leg in rig.legs
    )
    skeleton = replace(rig.skeleton, offsets=rig.skeleton.offsets * size)
    return replace(rig, skeleton=skeleton, legs=legs)


def still(frames=40, knees=(0.0, 0.0)):
    rotations = np.tile(RIG.skeleton.rest_rotations, (frames, 1, 1))
    for leg, bend in zip(RIG.legs, knees, strict=True):
        rotations[:, leg.knee] = qa.mul(rotations[:, leg.knee], qa.about([0, 1, 0], bend))
    place = np.tile(RIG.skeleton.offsets[0], (frames, 1))
    return Clip(skeleton=RIG.skeleton, fps=60.0, root_positions=place, rotations=rotations)


def root_moves(motion, seconds):
    """Places (N,), complex, and yaws (N,) of the root after these seconds."""
    turn = motion.yaw_rate * seconds
    v = complex(*motion.velocity)
    if motion.yaw_rate == 0.0:
        return v * seconds, turn
    return v * (np.exp(1j * turn) - 1.0) / (1j * motion.yaw_rate), turn


def print_errors(motion):
    """m, how far the pinned points are from the print at every frame of every contact."""
    points = all_sole_points(motion.rig, *motion.clip.model_pose())
    errors = [0.0]
    for i, leg in enumerate(motion.rig.legs):
        rows = motion.timing[:-1, i]
        held = np.flatnonzero((rows["phase"] > 0) & np.isfinite(rows["to_release"]))
        place, turn = root_moves(motion, -rows["to_plant"][held])
        flat = points[held, i, :, 0] + 1j * points[held, i, :, 1]
        flat = flat * np.exp(1j * turn)[:, None] + place[:, None]
        middle = rows["print"][held, 0] + 1j * rows["print"][held, 1]
        ahead = np.exp(1j * rows["print_yaw"][held])
        phase = rows["phase"][held]
        heel = np.abs(flat[:, HEEL] - (middle - ahead * leg.sole.heel))
        ball = np.abs(flat[:, BALL] - (middle + ahead * leg.sole.ball))
        errors += [*heel[phase < Phase.BALL], *ball[phase > Phase.HEEL]]
    return np.array(errors)


def require_sound(motion):
    """Every number finite that shall be, and each foot's times consistent with one another."""
    for array in (motion.roots, motion.rotations, motion.translations, motion.velocity):
        assert np.isfinite(array).all()
    assert np.isfinite(motion.yaw_rate)
    assert np.linalg.norm(motion.rotations, axis=-1) == pytest.approx(1.0, abs=1e-9)
    assert np.sum(motion.rotations[1:] * motion.rotations[:-1], axis=-1).min() > 0.0
    timing, fps = motion.timing, motion.clip.fps
    assert (timing[0] == timing[-1]).all()
    for name in ("weight", "swing_time", "print", "print_yaw", "pitch", "hip", "extension"):
        assert np.isfinite(timing[name]).all()
    for i in range(timing.shape[1]):
        rows = timing[:-1, i]
        held = rows["phase"] != Phase.SWING
        plant, release = rows["to_plant"], rows["to_release"]
        assert (release[~held] == 0.0).all()
        if held.all():
            assert (plant == 0.0).all()
            assert np.isinf(release).all()
        elif not held.any():
            assert np.isinf(plant).all()
            assert (plant > 0).all()
        else:
            require_consistent(held, plant, release, rows["swing_time"], fps)


def require_consistent(held, plant, release, swing, fps):
    assert ((plant > 0.0) == ~held).all()
    assert (release[held] > 0.0).all()
    assert (plant[~held] <= swing[~held] + 1e-12).all()
    after = np.roll(plant, -1)
    leaves = held & ~np.roll(held, -1)
    assert after[~leaves] == pytest.approx(plant[~leaves] - 1.0 / fps, abs=1e-9)
    # At the release the count starts anew, at the length of the swing that begins.
    assert after[leaves] == pytest.approx(np.roll(swing, -1)[leaves])
    assert release[leaves] == pytest.approx(1.0 / fps)
    # Contact and swing add up to the cycle, or to a share of it for feet that step often.
    starts = held & ~np.roll(held, 1)
    assert (release[starts].sum() + swing[starts].sum()) * fps == pytest.approx(len(held))


@pytest.mark.parametrize("name", list(GAITS))
def test_the_print_is_where_the_foot_stands_all_through_its_contact(name):
    clip = GAITS[name](RIG)
    motion = Motion.prepare(clip, RIG)
    assert print_errors(motion).max() < 1e-6
    require_sound(motion)
    told = Motion.prepare(bare(clip, start=0.13), RIG)
    assert np.percentile(print_errors(told), 95) < 0.002
    assert print_errors(told).max() < 0.006  # in the first and last frames of a contact
    require_sound(told)


@pytest.mark.parametrize("rate", [-120.0, 90.0])
def test_a_turn_on_the_spot_has_its_rate(rate):
    clip = gait.turn_in_place(RIG, rate_deg=rate)
    for motion in (Motion.prepare(clip, RIG), Motion.prepare(bare(clip), RIG)):
        assert motion.yaw_rate == pytest.approx(math.radians(rate), rel=1e-3)
        assert motion.speed < 1e-3


def test_a_walk_without_curves_becomes_the_motion_that_it_is_with_them():
    clip = gait.walk(RIG)
    told, known = Motion.prepare(bare(clip), RIG), Motion.prepare(clip, RIG)
    assert told.velocity == pytest.approx(known.velocity, abs=1e-3)
    assert len(told.clip) == len(known.clip)
    assert told.timing["swing_time"].max(axis=0) == pytest.approx(
        known.timing["swing_time"].max(axis=0), abs=2.1 / clip.fps
    )
    assert told.timing["print_yaw"].max(axis=0) == pytest.approx(
        known.timing["print_yaw"].max(axis=0), abs=0.01
    )


def test_the_pitch_hip_and_extension_are_those_at_the_plant():
    motion = Motion.prepare(gait.walk(RIG), RIG)
    positions, rotations = motion.clip.model_pose()
    for i, leg in enumerate(motion.rig.legs):
        rows = motion.timing[:-1, i]
        plant = int(np.flatnonzero(rows["to_plant"] == 0.0)[0])
        hip, ankle = positions[plant, leg.hip], positions[plant, leg.ankle]
        toward = qa.rotate(qa.mul(rotations[plant, leg.ankle], leg.sole.frame), [1.0, 0.0, 0.0])
        assert (rows["hip"] == hip).all()
        assert rows["extension"] == pytest.approx(np.linalg.norm(ankle - hip))
        assert rows["pitch"] == pytest.approx(math.asin(toward[2]))
        assert rows["pitch"][0] > math.radians(10.0)


def test_a_foot_that_always_stands_never_plants_anew():
    rows = Motion.prepare(gait.idle(RIG), RIG).timing
    assert (rows["to_plant"] == 0.0).all()
    assert (rows["swing_time"] == 0.0).all()
    assert np.isinf(rows["to_release"]).all()
    assert np.ptp(rows["print"], axis=0).max() == 0.0


def test_a_foot_that_never_stands_never_plants():
    motion = Motion.prepare(still(knees=(0.0, 1.2)), RIG)
    assert (motion.timing["phase"][:, 1] == Phase.SWING).all()
    assert (motion.timing["phase"][:, 0] == Phase.FLAT).all()
    require_sound(motion)
    assert np.isposinf(motion.timing["to_plant"][:, 1]).all()


@pytest.mark.parametrize("frames", [3, 4, 20, 200])
def test_a_still_pose_is_a_motion(frames):
    motion = Motion.prepare(still(frames), RIG)
    require_sound(motion)
    assert motion.velocity.tolist() == [0.0, 0.0]
    assert motion.yaw_rate == 0.0
    assert motion.seam < 1e-9
    assert (motion.timing["phase"] == Phase.FLAT).all()


@pytest.mark.parametrize("frames", [1, 2])
def test_too_few_frames_are_an_error(frames):
    with pytest.raises(FootIKError, match=f"{frames} frames are too few; a motion needs 3"):
        Motion.prepare(still(frames), RIG)


def test_a_rig_of_another_skeleton_is_an_error():
    names = list(RIG.skeleton.names)
    names[3] = "other"
    offsets, parents = RIG.skeleton.offsets, RIG.skeleton.parents
    other = Skeleton(names=tuple(names), parents=parents, offsets=offsets)
    with pytest.raises(FootIKError, match=r"joint 3 is 'neck'.*'other'"):
        Motion.prepare(still(), replace(RIG, skeleton=other))
    fewer = Skeleton(names=tuple(names[:5]), parents=parents[:5], offsets=offsets[:5])
    with pytest.raises(FootIKError, match="of 5 joints, not 21"):
        Motion.prepare(still(), replace(RIG, skeleton=fewer))


@pytest.mark.parametrize("size", [0.3 / 0.861, 3.0 / 0.861])
@pytest.mark.parametrize("name", ["walk", "run"])
def test_a_childs_and_a_giants_gait_are_told_like_ours(name, size):
    rig = scaled(RIG, size)
    assert rig.leg_lengths == pytest.approx(0.861 * size, rel=1e-3)
    speed = {"walk": 1.3, "run": 3.0}[name] * math.sqrt(size)
    clip = getattr(gait, name)(rig, speed=speed, fps=120.0)
    known, told = Motion.prepare(clip, rig), Motion.prepare(bare(clip), rig)
    require_sound(told)
    assert told.speed == pytest.approx(speed, rel=1e-3)
    assert told.timing["swing_time"].max() == pytest.approx(
        known.timing["swing_time"].max(), abs=0.15 * known.clip.duration
    )
    assert np.percentile(print_errors(told), 90) < 0.004 * size


@pytest.mark.parametrize("yaw", [-math.pi / 2, math.pi, 1.0])
def test_a_clip_that_faces_elsewhere_is_the_same_motion(yaw):
    clip = bare(gait.walk(RIG))
    here = Motion.prepare(clip, RIG)
    there = Motion.prepare(moved(clip, yaw, (3.0, 4.0, -1.0)), RIG)
    assert there.velocity == pytest.approx(here.velocity, abs=1e-6)
    assert there.timing["print"] == pytest.approx(here.timing["print"], abs=1e-5)
    assert (there.timing["phase"] == here.timing["phase"]).all()
    assert there.roots == pytest.approx(here.roots, abs=1e-5)


@pytest.mark.parametrize("way", [math.pi / 2, -math.pi / 2, math.pi])
def test_a_body_that_goes_sideways_or_backward_leaves_its_prints_on_its_way(way):
    """A rig said to face elsewhere makes of a walk a sidestep, or a walk backward."""
    forward = qa.rotate(qa.about([0, 0, 1], -way), RIG.forward)
    facing = replace(RIG, forward=forward)
    clip = gait.walk(RIG, speed=0.8)
    for given in (clip, bare(clip, start=0.2)):
        motion = Motion.prepare(given, facing)
        require_sound(motion)
        want = 0.8 * np.array([math.cos(way), math.sin(way)])
        assert motion.velocity == pytest.approx(want, abs=2e-3)
        assert np.percentile(print_errors(motion), 95) < 0.003


def test_a_walk_played_backward_goes_backward():
    clip = gait.walk(RIG)
    curves = {name: values[::-1] for name, values in clip.curves.items()}
    back = replace(
        clip,
        root_positions=clip.root_positions[::-1],
        rotations=clip.rotations[::-1],
        curves=curves,
    )
    for given in (back, bare(back, start=0.2)):
        motion = Motion.prepare(given, RIG)
        require_sound(motion)
        assert motion.velocity == pytest.approx([-1.3, 0.0], abs=2e-3)
        assert np.percentile(print_errors(motion), 95) < 0.003


def test_translations_are_carried_into_the_motion():
    clip = gait.walk(RIG)
    moves = np.tile(RIG.skeleton.offsets, (len(clip), 1, 1))
    moves[:, 1, 2] += 0.01 * np.sin(np.linspace(0.0, 2 * np.pi, len(clip)))
    motion = Motion.prepare(replace(clip, translations=moves), RIG)
    require_sound(motion)
    assert motion.translations.shape == (len(clip) + 2, len(RIG.skeleton), 3)
    assert Motion.prepare(clip, RIG).translations.shape == (0, len(RIG.skeleton), 3)
    root, turns = np.zeros(3), np.zeros((len(RIG.skeleton), 4))
    out = np.zeros((len(RIG.skeleton), 3))
    sample_pose(
        motion.roots, motion.rotations, motion.translations, clip.fps, 10 / clip.fps, root, turns,
        out,
    )  # fmt: skip
    assert out[1:] == pytest.approx(moves[10, 1:], abs=1e-9)


def test_sampling_a_cycle_gives_its_frames_and_has_no_seam():
    motion = Motion.prepare(gait.walk(RIG), RIG)
    clip, joints = motion.clip, len(RIG.skeleton)

    def at(seconds):
        root, turns = np.zeros(3), np.zeros((joints, 4))
        frame, part = sample_pose(
            motion.roots, motion.rotations, motion.translations, clip.fps, seconds, root, turns,
            np.zeros((joints, 3)),
        )  # fmt: skip
        return root, turns, frame + part

    for frame in (0, 7, len(clip) - 2):
        for cycles in (0, 1, -2):
            root, turns, x = at(frame / clip.fps + cycles * clip.duration)
            assert root == pytest.approx(clip.root_positions[frame], abs=1e-9)
            assert np.abs(np.sum(turns * clip.rotations[frame], axis=-1)) == pytest.approx(1.0)
            assert min(abs(x - frame), abs(abs(x - frame) - len(clip) + 1)) < 1e-6
    before, after = at(clip.duration - 1e-6), at(clip.duration + 1e-6)
    assert before[0] == pytest.approx(after[0], abs=1e-5)
    assert np.abs(np.sum(before[1] * after[1], axis=-1)) == pytest.approx(1.0, abs=1e-6)


def test_the_same_clip_is_the_same_motion_to_the_bit():
    clip = bare(gait.walk(RIG))
    one, two = Motion.prepare(clip, RIG), Motion.prepare(clip, RIG)
    assert one.rotations.tobytes() == two.rotations.tobytes()
    assert one.timing.tobytes() == two.timing.tobytes()


@pytest.mark.skipif(not BVH.is_dir(), reason=f"no captured clips at {BVH} (set FOOTIK_SHARED)")
@pytest.mark.parametrize(
    ("file", "speed", "seam"),
    [("cmu_02_01_walk", (1.0, 1.4), 0.06), ("cmu_02_03_run", (2.3, 3.0), 0.10),
     ("cmu_02_04_jump", (0.0, 0.2), 0.2), ("cmu_01_01_playground", (0.0, 2.0), 0.1)],
)  # fmt: skip
def test_a_captured_clip_becomes_a_sound_motion(file, speed, seam):
    clip = read_bvh(BVH / f"{file}.bvh")
    rig = find_rig(clip.skeleton)
    motion = Motion.prepare(clip, rig)
    require_sound(motion)
    assert speed[0] <= motion.speed <= speed[1]
    assert motion.seam < seam
    assert (motion.timing["phase"] > 0).any(axis=0).all()
    # Captured feet slide by some centimetres on a root of constant speed; their mean does not.
    assert np.sqrt(np.mean(print_errors(motion) ** 2)) < 0.04
    began = time.perf_counter()
    Motion.prepare(clip, rig)
    assert time.perf_counter() - began < 4.0  # 0.5 s here for 2752 frames
