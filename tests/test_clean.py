import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from footik_runtime import gait, metrics
from footik_runtime import quat_arrays as qa
from footik_runtime.builtin import humanoid_rig
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.formats.bvh import read_bvh
from footik_runtime.offline.clean import clean
from footik_runtime.offline.measure_clip import compare
from footik_runtime.offline.skate import GROUNDS, inject, true_walk
from footik_runtime.offline.stages import CleanSettings
from footik_runtime.offline.working import unpad, working
from footik_runtime.phases import Phase, phase_curve
from footik_runtime.recorded import Run
from footik_runtime.skeleton import Skeleton
from footik_runtime.sole import BALL, HEEL, all_sole_points

ROOT = Path(__file__).parent.parent
BVH = Path(os.environ.get("FOOTIK_SHARED", ROOT.parent / "shared")) / "data" / "bvh"
RIG = humanoid_rig()
GAITS = {"walk": gait.walk(RIG), "slow": gait.walk(RIG, speed=0.6), "run": gait.run(RIG)}
TRUTHS = {(g, k): true_walk(GAITS[g], RIG, ground=k) for g in ("walk", "slow") for k in GROUNDS}
TRUTHS |= {("run", k): true_walk(GAITS["run"], RIG, ground=k) for k in ("flat", "slope")}
SKATES = {"constant": 0.03, "accelerating": 0.03, "noise": 0.004, "drift": 0.08}
CAPTURES = {
    "walk": "cmu_02_01_walk.bvh",
    "run": "cmu_02_03_run.bvh",
    "jump": "cmu_02_04_jump.bvh",
}


def joints(clip):
    return clip.model_pose()[0]


def capture(name):
    path = BVH / CAPTURES[name]
    if not path.exists():
        pytest.skip("the captured clips are not here")
    return read_bvh(path)


def ground_under(plants, soles):
    """Height of the ground of the plant each foot is in; in swing, the lower of those beside."""
    heights = np.full(soles.shape[:-1], np.inf)
    frames = np.arange(len(soles))
    for f in range(soles.shape[1]):
        own = sorted((p for p in plants if p.foot == f), key=lambda p: p.start)
        for k, plant in enumerate(own):
            first = own[k - 1].stop if k else 0
            last = own[k + 1].start if k + 1 < len(own) else len(soles)
            near = (frames >= first) & (frames < last)
            away = (soles[near, f] - plant.heel)[..., :2] @ plant.normal[:2]
            under = plant.heel[2] - away / plant.normal[2]
            heights[near, f] = np.minimum(heights[near, f], under)
    return heights


def run_of(clip, rig, cleaned, held):
    positions, rotations = clip.model_pose()
    soles = all_sole_points(rig, positions, rotations)
    chains = np.array([(leg.hip, leg.knee, leg.ankle, leg.toe) for leg in rig.legs])
    phases = cleaned.phases.astype(np.int64)
    return Run(
        fps=clip.fps,
        times=clip.times,
        hips=positions[:, rig.hips],
        leg_rotations=clip.rotations[:, chains],
        ankle=positions[:, chains[:, 2]],
        toe=positions[:, chains[:, 3]],
        sole=soles,
        ground=ground_under(cleaned.plants, soles),
        phase=phases,
        joints=positions,
        locked=phases > 0 if held else None,
        pin=np.array([-1, HEEL, HEEL, BALL])[phases],
    )


class Figures:
    """Before and after one clip is cleaned, in the frame that its plants are in."""

    def __init__(self, clip, rig=None, **options):
        self.cleaned = done = clean(clip, rig, **options)
        work = working(clip, rig, **options)
        self.work, self.rig = work, done.rig
        upright = clip.rotations.copy()
        upright[:, work.joints] = unpad(work, work.clip.rotations)
        before = replace(
            clip,
            root_positions=unpad(work, work.clip.root_positions),
            rotations=upright,
            curves={},
        )
        rotations = done.clip.rotations.copy()
        rotations[:, 0] = before.rotations[:, 0]
        after = replace(
            before, root_positions=before.root_positions + done.root_moves, rotations=rotations
        )
        self.before, self.after = (
            run_of(c, done.rig, done, held) for c, held in ((before, False), (after, True))
        )
        self.was = metrics.score(self.before, self.before)
        self.now = metrics.score(self.after, self.before)
        heights = (self.after.sole[..., 2] - self.after.ground).min(axis=-1)
        self.deepest = max(-float(heights.min()), 0.0)
        contact = done.phases > 0
        self.highest = float(heights[contact].max()) if contact.any() else 0.0
        turns = qa.mul(qa.conj(self.before.leg_rotations), self.after.leg_rotations)
        self.turns = np.degrees(np.linalg.norm(qa.to_rotvec(turns), axis=-1))
        # Of all joints: those that are not in a leg do not turn.
        share = self.turns.shape[2] * self.turns.shape[1] / len(clip.skeleton)
        self.outside = float(self.turns[~contact].mean()) * share
        lengths = [
            np.linalg.norm(p[:, 1:] - p[:, clip.skeleton.parents[1:]], axis=-1)
            for p in (joints(before), joints(after))
        ]
        self.longer = float(np.abs(lengths[1] - lengths[0]).max())

    def check(self, pop=1.5):
        assert self.now["pinned_point_speed"] < 0.05 * self.was["pinned_point_speed"]
        assert self.deepest < 0.0031
        assert self.highest < 0.003
        assert self.now["pop"] <= max(pop, 1.05 * self.was["pop"])
        assert self.outside < 0.5
        assert self.longer < 1e-12
        assert self.cleaned.report["unreached_frames"] == 0


@pytest.mark.parametrize("name", CAPTURES)
def test_captures_stand_still(name):
    Figures(capture(name)).check()


@pytest.mark.parametrize("kind", SKATES)
@pytest.mark.parametrize("ground", GROUNDS)
def test_skating_walks_stand_where_they_should(kind, ground):
    truth = TRUTHS["walk", ground]
    clip = inject(truth, kind, SKATES[kind], seed=1)
    figures = Figures(clip, RIG)
    figures.check()
    errors = recovered(figures, truth, clip if kind == "drift" else truth.clip)
    assert len(errors) >= 6
    assert np.max(errors) < 0.005


def recovered(figures, truth, clip):
    """(K,) distances of plants from where the flat feet of a clip are on average, m."""
    soles = all_sole_points(RIG, *clip.model_pose())
    errors = []
    for plant in figures.cleaned.plants:
        for start, stop, _ in truth.places(plant.foot):
            if start < 3 or stop > len(clip) - 3 or plant.stop <= start or stop <= plant.start:
                continue
            flat = np.flatnonzero(truth.phases[start:stop, plant.foot] == Phase.FLAT) + start
            place = soles[flat, plant.foot][:, [HEEL, BALL]].mean(axis=(0, 1))
            held = 0.5 * (plant.heel + plant.ball) - figures.work.shift[figures.work.pad]
            errors.append(np.linalg.norm(qa.rotate(figures.work.back, held) - place))
    return np.array(errors)


@pytest.mark.parametrize("ground", ["flat", "slope"])
@pytest.mark.parametrize("kind", SKATES)
def test_skating_runs_stand_still(kind, ground):
    size = SKATES[kind] if kind == "drift" else 0.5 * SKATES[kind]
    Figures(inject(TRUTHS["run", ground], kind, size, seed=1), RIG).check()


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("name", ["walk", "slow"])
def test_a_clean_clip_comes_back_untouched(name, ground):
    truth = TRUTHS[name, ground]
    cleaned = clean(truth.clip, RIG)
    assert np.abs(joints(cleaned.clip) - joints(truth.clip)).max() < 1e-4
    assert len(cleaned.plants) >= 8


@pytest.mark.parametrize("name", ["walk", "slow"])
def test_a_clean_stair_walk_cut_anywhere_comes_back_untouched(name):
    """Before its first plant and after its last a foot may stand on any step."""
    clip = TRUTHS[name, "stairs"].clip
    for frame in (10, 16, 22, 28, 40):
        for part in (clip.cut(frame, len(clip)), clip.cut(0, len(clip) - frame)):
            cleaned = clean(part, RIG)
            assert np.abs(joints(cleaned.clip) - joints(part)).max() < 1e-3, frame
            assert cleaned.plants


def test_contacts_that_no_foot_can_be_held_in_are_left_alone():
    """Feet that glide far while slow, as those of a body that sits down or dances do, not stand."""
    clip = inject(TRUTHS["walk", "flat"], "constant", 0.2)
    cleaned = clean(clip, RIG)
    assert not cleaned.plants
    assert (joints(cleaned.clip) == joints(clip)).all()
    assert any("left alone" in note for note in cleaned.report["notes"])
    asked = clean(clip, RIG, settings=CleanSettings(leave_above=1.0))
    assert len(asked.plants) >= 8
    assert not any("left alone" in note for note in asked.report["notes"])


@pytest.mark.parametrize("speed", [0.3, 0.35, 0.4])
def test_a_heel_that_rises_slowly_is_left_to_rise(speed):
    clip = true_walk(gait.walk(RIG, speed=speed), RIG, cycles=3).clip
    cleaned = clean(clip, RIG)
    assert np.abs(joints(cleaned.clip) - joints(clip)).max() < 1e-4
    assert len(cleaned.plants) >= 6


def backwards(clip):
    return replace(
        clip, root_positions=clip.root_positions[::-1].copy(), rotations=clip.rotations[::-1].copy()
    )


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("name", ["walk", "slow"])
def test_walks_backwards_are_cleaned_as_walks_are(name, ground):
    """A foot that comes down over its ball and leaves over its heel."""
    truth = TRUTHS[name, ground]
    clean_clip = backwards(truth.clip)
    cleaned = clean(clean_clip, RIG)
    assert np.abs(joints(cleaned.clip) - joints(clean_clip)).max() < 1e-4
    stands = truth.phases[::-1] > 0
    assert (cleaned.phases == truth.phases[::-1])[stands].mean() > 0.93
    Figures(backwards(inject(truth, "constant", 0.03, seed=1)), RIG).check()


def test_what_is_clean_keeps_every_bit():
    truth = TRUTHS["walk", "flat"]
    cleaned = clean(truth.clip, RIG).clip
    assert (cleaned.rotations == truth.clip.rotations).all()
    assert (cleaned.root_positions == truth.clip.root_positions).all()


def test_gaits_with_curves_come_back_untouched():
    for clip in (*GAITS.values(), gait.idle(RIG), gait.turn_in_place(RIG)):
        cleaned = clean(clip, RIG)
        assert np.abs(joints(cleaned.clip) - joints(clip)).max() < 1e-4
        assert (cleaned.clip.curves.keys()) == clip.curves.keys()


def test_joints_that_are_in_no_leg_keep_every_bit():
    truth = TRUTHS["walk", "flat"]
    clip = inject(truth, "constant", 0.03)
    cleaned = clean(clip, RIG).clip
    legs = [j for g in RIG.legs for j in (g.hip, g.knee, g.ankle, g.toe)]
    others = [j for j in range(len(RIG.skeleton)) if j not in legs]
    assert (cleaned.rotations[:, others] == clip.rotations[:, others]).all()
    assert cleaned.translations is None
    assert cleaned.skeleton is clip.skeleton


@pytest.mark.parametrize("name", CAPTURES)
def test_a_second_pass_with_the_same_contacts_changes_next_to_nothing(name):
    once = clean(capture(name), settings=CleanSettings(level=True))
    told = {
        phase_curve(leg.name): once.phases[:, f].astype(float)
        for f, leg in enumerate(once.rig.legs)
    }
    twice = clean(once.clip.with_curves(**told), once.rig)
    # A run is flat for a frame or two, a jumper long on the balls: which frames is told anew.
    most = 2e-4 if name == "walk" else 0.008
    assert np.abs(joints(twice.clip) - joints(once.clip)).max() < most


def skating_loop(name, factor=1.04):
    """A gait that goes faster than its feet."""
    clip = GAITS[name]
    return replace(clip, curves={}, root_positions=clip.root_positions * [factor, 1.0, 1.0])


@pytest.mark.parametrize("name", ["walk", "run"])
def test_loops_stay_seamless(name):
    clip = skating_loop(name)
    cleaned = clean(clip, RIG)
    after = cleaned.clip
    assert after.loop
    assert cleaned.report["loop"]
    assert (after.rotations[-1, 1:] == after.rotations[0, 1:]).all()
    assert np.abs(after.stride()[1] - clip.stride()[1]).max() < 1e-12
    places = joints(after)
    around = np.concatenate([places[:-1], places + after.stride()[1]])
    bends = np.linalg.norm(np.diff(around, 2, axis=0), axis=-1).max(axis=1)
    seam = len(clip) - 2
    near = bends[seam - 2 : seam + 3].max()
    assert near < 1.2 * np.delete(bends, range(seam - 2, seam + 3)).max()
    second = clean(after, RIG).clip
    assert np.abs(joints(second) - places).max() < 2e-4


def under_a_still_root(clip):
    """The clip and its rig under one more joint, which stays while translations carry the hips."""
    bones = clip.skeleton
    skeleton = Skeleton(
        names=("world", *bones.names),
        parents=np.concatenate([[-1], bones.parents + 1]),
        offsets=np.vstack([np.zeros(3), bones.offsets]),
        rest_rotations=np.vstack([[1.0, 0.0, 0.0, 0.0], bones.rest_rotations]),
    )
    translations = np.tile(skeleton.offsets, (len(clip), 1, 1))
    translations[:, 1] = clip.root_positions
    still = np.tile([1.0, 0.0, 0.0, 0.0], (len(clip), 1, 1))
    carried = Clip(
        skeleton=skeleton,
        fps=clip.fps,
        loop=clip.loop,
        root_positions=np.zeros((len(clip), 3)),
        rotations=np.concatenate([still, clip.rotations], axis=1),
        translations=translations,
    )
    parts = ("hip", "knee", "ankle", "toe")
    legs = tuple(replace(g, **{p: getattr(g, p) + 1 for p in parts}) for g in RIG.legs)
    return carried, replace(RIG, skeleton=skeleton, hips=RIG.hips + 1, legs=legs)


@pytest.mark.parametrize("name", ["loop", "loop that does not say so", "turn"])
def test_hips_that_translations_carry_travel_as_a_root_does(name):
    clip = skating_loop("walk")
    if name == "turn":
        clip = replace(gait.turn_in_place(RIG), curves={})
    clip = replace(clip, loop=name != "loop that does not say so")
    plain, (carried, rig) = clean(clip, RIG), under_a_still_root(clip)
    cleaned = clean(carried, rig)
    assert (cleaned.phases == plain.phases).all()
    assert np.abs(joints(cleaned.clip)[:, 1:] - joints(plain.clip)).max() < 1e-9


def test_in_place_clips_stay_in_place():
    clip = skating_loop("walk")
    travel = np.arange(len(clip))[:, None] / (len(clip) - 1) * clip.stride()[1]
    still = replace(clip, root_positions=clip.root_positions - travel)
    cleaned = clean(still, RIG)
    assert np.linalg.norm(cleaned.clip.stride()[1]) < 1e-9
    assert np.ptp(cleaned.clip.root_positions[:, 0]) < 0.05
    assert cleaned.report["plants"]


@pytest.mark.parametrize("kind", SKATES)
@pytest.mark.parametrize("frames", [(0, 257), (10, 180), (5, 111)])
def test_in_place_clips_cleaned_twice_stay(kind, frames):
    clip = inject(TRUTHS["walk", "flat"], kind, SKATES[kind]).cut(*frames)
    still = replace(clip, root_positions=clip.root_positions * [0.0, 1.0, 1.0])
    once = clean(still, RIG)
    assert len(once.plants) >= 4
    assert np.abs(joints(clean(once.clip, RIG).clip) - joints(once.clip)).max() < 1e-3


@pytest.mark.parametrize("climb", [0.0, 0.1])
def test_in_place_clips_stand_still_on_a_true_ground_too(climb):
    """It is the ground of the clip's own frame: on a belt that climbs it stays where it is."""
    truth = TRUTHS["walk", "flat"]
    clip = inject(truth, "constant", 0.03)
    still = replace(clip, root_positions=clip.root_positions * [0.0, 1.0, 1.0])
    ground: Any = SimpleNamespace(
        height=lambda p: climb * p[:, 0],
        normal=lambda p: np.tile(qa.unit(np.array([-climb, 0.0, 1.0])), (len(p), 1)),
    )
    alone, cleaned = clean(still, RIG), clean(still, RIG, ground=ground)
    assert len(cleaned.plants) == len(alone.plants) >= 8
    assert cleaned.report["contacts"]["belt"] != [0.0, 0.0, 0.0]
    after = compare(still, cleaned)["after"]
    assert after["pinned_point_speed"] < 1e-3
    soles = all_sole_points(cleaned.rig, *cleaned.clip.model_pose())
    for plant in cleaned.plants:
        middle = (plant.start + plant.stop - 1) // 2
        heel, ball = soles[middle, plant.foot, :2]
        assert abs(heel[2] - climb * heel[0]) < 0.004 or middle >= plant.roll
        assert abs(ball[2] - climb * ball[0]) < 0.004 or middle < plant.flat


def test_true_ground_is_used():
    truth = TRUTHS["walk", "stairs"]
    ground: Any = SimpleNamespace(height=lambda p: truth.height(p) + 0.01, normal=truth.normal)
    cleaned = clean(truth.clip, RIG, ground=ground)
    for plant in cleaned.plants:
        assert abs(plant.heel[2] - ground.height(plant.heel[None])[0]) < 1e-9
    soles = all_sole_points(cleaned.rig, *cleaned.clip.model_pose())
    flat = cleaned.phases == Phase.FLAT
    flat[:5] = flat[-5:] = False
    heights = soles[flat][:, :2].reshape(-1, 3)
    assert np.abs(heights[:, 2] - ground.height(heights)).max() < 1e-6


def test_contact_that_curves_tell_is_kept():
    clip = replace(GAITS["walk"], loop=False)
    moved = replace(clip, root_positions=clip.root_positions * [1.05, 1.0, 1.0])
    cleaned = clean(moved, RIG)
    told = np.stack(
        [np.asarray(clip.curves[n]) for n in ("LeftFootPhase", "RightFootPhase")], axis=1
    )
    assert ((cleaned.phases > 0) <= (told > 0)).all()
    assert (cleaned.phases > 0).sum() > 0.75 * (told > 0).sum()


@pytest.mark.parametrize("length", [1, 3, 6])
def test_curves_that_flicker_or_make_no_sense_do_no_harm(length):
    truth = TRUTHS["walk", "flat"]
    clip = inject(truth, "constant", 0.03)
    flicker = (np.arange(len(clip)) // length % 2).astype(float)
    told = clip.with_curves(LeftFootIKWeight=flicker, RightFootIKWeight=flicker)
    cleaned = clean(told, RIG)
    moved = np.linalg.norm(joints(cleaned.clip) - joints(clip), axis=-1).max()
    assert moved < 0.1
    if length < 5:
        assert not cleaned.plants
        assert any("too short" in note for note in cleaned.report["notes"])


def test_phases_at_random_move_no_foot_far():
    clip = TRUTHS["walk", "flat"].clip
    phases = np.random.default_rng(0).integers(0, 4, (2, len(clip))).astype(float)
    cleaned = clean(clip.with_curves(LeftFootPhase=phases[0], RightFootPhase=phases[1]), RIG)
    ankles = [leg.ankle for leg in RIG.legs]
    moved = joints(cleaned.clip)[:, ankles] - joints(clip)[:, ankles]
    assert np.linalg.norm(moved, axis=-1).max() < 0.1


def test_weights_that_are_none_are_told():
    clip = TRUTHS["walk", "flat"].clip
    odd = clip.with_curves(LeftFootIKWeight=np.full(len(clip), 7.0))
    notes = clean(odd, RIG).report["notes"]
    assert any("LeftFootIKWeight" in note and "7" in note for note in notes)
    notes = clean(odd, RIG, settings=CleanSettings(redetect=True)).report["notes"]
    assert not any("LeftFootIKWeight" in note for note in notes)


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 10])
def test_short_clips_come_back(frames):
    clip = inject(TRUTHS["walk", "flat"], "constant", 0.03).cut(20, 20 + frames)
    cleaned = clean(clip, RIG)
    assert len(cleaned.clip) == frames
    assert np.isfinite(cleaned.clip.rotations).all()
    assert cleaned.phases.shape == (frames, 2)
    assert not cleaned.plants or frames >= 0.08 * clip.fps
    if frames < 3:
        assert "too few" in cleaned.report["notes"][-1]
        assert (cleaned.clip.rotations == clip.rotations).all()


def test_still_and_flying_bodies_come_back():
    clip = TRUTHS["walk", "flat"].clip
    pose = np.zeros(60, dtype=int)
    standing = replace(
        clip, root_positions=clip.root_positions[pose], rotations=clip.rotations[pose]
    )
    flying = replace(clip, root_positions=clip.root_positions + np.arange(len(clip))[:, None] * 0.1)
    for given in (standing, flying):
        cleaned = clean(given, RIG)
        assert np.isfinite(cleaned.clip.rotations).all()
        assert np.isfinite(cleaned.clip.root_positions).all()
    assert np.abs(joints(clean(standing, RIG).clip) - joints(standing)).max() < 1e-3


def test_same_input_same_bits():
    clip = inject(TRUTHS["walk", "slope"], "noise", 0.004)
    a, b = clean(clip, RIG), clean(clip, RIG)
    assert (a.clip.rotations == b.clip.rotations).all()
    assert (a.clip.root_positions == b.clip.root_positions).all()


def test_levelled_clips_stand_on_level_ground():
    tilt = qa.about([0.0, 1.0, 0.0], np.array(np.radians(1.5)))
    clip = inject(TRUTHS["walk", "flat"], "constant", 0.03)
    rotations = clip.rotations.copy()
    rotations[:, 0] = qa.mul(tilt, rotations[:, 0])
    tilted = replace(clip, root_positions=qa.rotate(tilt, clip.root_positions), rotations=rotations)
    as_given, level = clean(tilted, RIG), clean(tilted, RIG, settings=CleanSettings(level=True))
    spans = []
    for cleaned in (as_given, level):
        soles = all_sole_points(cleaned.rig, *cleaned.clip.model_pose())
        spans.append(np.ptp(soles[cleaned.phases == Phase.FLAT][:, :2, 2]))
    assert spans[0] > 0.002
    assert spans[1] < 0.002
    # Both are the same motion, turned as the roots' rotations tell.
    upright = qa.mul(level.clip.rotations[0, 0], qa.conj(as_given.clip.rotations[0, 0]))
    turned = qa.rotate(upright, joints(as_given.clip))
    assert np.abs(turned - joints(level.clip)).max() < 1e-9
    same = [j for j in range(1, len(RIG.skeleton))]
    assert np.abs(as_given.clip.rotations[:, same] - level.clip.rotations[:, same]).max() < 1e-12


def test_other_sizes_are_cleaned_alike():
    truth = TRUTHS["walk", "flat"]
    clip = inject(truth, "constant", 0.03, seed=2)
    once = clean(clip, RIG)
    for size in (0.5, 3.0):
        lengths = ("height", "heel", "ball", "tip", "half_width")
        legs = tuple(
            replace(g, sole=replace(g.sole, **{k: getattr(g.sole, k) * size for k in lengths}))
            for g in RIG.legs
        )
        skeleton = replace(RIG.skeleton, offsets=RIG.skeleton.offsets * size)
        rig = replace(RIG, skeleton=skeleton, legs=legs)
        # Time scales too: speeds are then in proportion.
        big = replace(
            clip, skeleton=skeleton, root_positions=clip.root_positions * size, fps=clip.fps
        )
        other = clean(big, rig)
        assert len(other.plants) == len(once.plants)
        moved = joints(other.clip) / size - joints(once.clip)
        assert np.abs(moved).max() < 0.02


def test_stretch_is_written_as_translations():
    clip = inject(TRUTHS["run", "flat"], "constant", 0.03)
    lower = replace(clip, root_positions=clip.root_positions + np.array([0, 0, 0.012]))
    settings = CleanSettings(stretch=0.02, root_follow=0.0)
    cleaned = clean(lower, RIG, settings=settings)
    if cleaned.clip.translations is not None:
        assert np.isfinite(cleaned.clip.translations).all()
    stiff = clean(lower, RIG)
    assert stiff.clip.translations is None
    assert np.abs(cleaned.root_moves).max() <= np.abs(stiff.root_moves).max() + 1e-3


def test_footplant_is_a_preset():
    clip = inject(TRUTHS["walk", "flat"], "constant", 0.03)
    cleaned = clean(clip, RIG, settings=CleanSettings(preset="footplant"))
    assert isinstance(cleaned.clip, Clip)
    assert cleaned.report


def test_a_rig_of_another_skeleton_is_refused():
    clip = TRUTHS["walk", "flat"].clip
    other = replace(
        RIG,
        skeleton=replace(
            RIG.skeleton,
            names=tuple(
                "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"[
                    : len(RIG.skeleton)
                ]
            ),
        ),
    )
    with pytest.raises(FootIKError, match="another skeleton"):
        clean(clip, other)
