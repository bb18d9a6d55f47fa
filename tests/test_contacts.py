import math
import os
import warnings
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest

from footik_runtime import gait
from footik_runtime import quat_arrays as qa
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.formats.bvh import read_bvh
from footik_runtime.metrics import contact_f1
from footik_runtime.offline import detect
from footik_runtime.offline.contacts import mend_seam, with_contacts
from footik_runtime.offline.stages import CleanSettings
from footik_runtime.offline.working import working
from footik_runtime.phases import Phase, phase_curve, weight_curve
from footik_runtime.rig import find_rig
from footik_runtime.rig_model import find_rig_in_model
from footik_runtime.sole import BALL, HEEL, all_sole_points

ROOT = Path(__file__).parent.parent
BVH = Path(os.environ.get("FOOTIK_SHARED", ROOT.parent / "shared")) / "data" / "bvh"

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture(scope="module")
def rig():
    return find_rig_in_model(mujoco.MjModel.from_xml_path(str(ROOT / "models" / "humanoid.xml")))


def given_phases(clip, rig):
    return np.stack([clip.curves[phase_curve(leg.name)] for leg in rig.legs], axis=-1)


def told_phases(clip, rig):
    """(T, legs) what is told from the motion alone."""
    out, _ = with_contacts(replace(clip, curves={}), rig)
    return given_phases(out, rig).astype(int)


def bare(clip, cycles=1, loop=False):
    """Some cycles of a clip, without its curves."""
    poses = [clip.sample(t) for t in np.arange((len(clip) - 1) * cycles + 1) / clip.fps]
    return Clip(
        skeleton=clip.skeleton,
        fps=clip.fps,
        root_positions=np.array([p.root_position for p in poses]),
        rotations=np.array([p.rotations for p in poses]),
        loop=loop,
    )


def tilted(clip, axis, degrees):
    turn = qa.about(axis, math.radians(degrees))
    rotations = clip.rotations.copy()
    rotations[:, 0] = qa.mul(turn, rotations[:, 0])
    return replace(clip, root_positions=qa.rotate(turn, clip.root_positions), rotations=rotations)


def still(rig, frames=40, lift=0.0, knee=0.0):
    """The rest pose held, its left knee bent."""
    rotations = np.tile(rig.skeleton.rest_rotations, (frames, 1, 1))
    bend = qa.about([0, 1, 0], knee)
    joint = rig.legs[0].knee
    rotations[:, joint] = qa.mul(rotations[:, joint], bend)
    place = np.tile(rig.skeleton.offsets[0] + [0, 0, lift], (frames, 1))
    return Clip(skeleton=rig.skeleton, fps=60.0, root_positions=place, rotations=rotations)


@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0])
@pytest.mark.parametrize(
    ("kind", "speed"), [("walk", 0.5), ("walk", 1.3), ("walk", 2.0), ("run", 2.0), ("run", 3.0)]
)
def test_contacts_of_the_built_in_gait_are_told(rig, kind, speed, fps):
    clip = getattr(gait, kind)(rig, speed=speed, fps=fps)
    loop = replace(clip, curves={})
    assert contact_f1(told_phases(loop, rig) > 0, given_phases(clip, rig) > 0) >= 0.95


def test_phases_of_a_walk_and_a_run_are_told(rig):
    for clip in (gait.walk(rig), gait.run(rig)):
        told = told_phases(replace(clip, curves={}), rig)
        assert (told == given_phases(clip, rig)).mean() > 0.9
        for i in range(2):
            order = told[:-1, i][np.flatnonzero(np.diff(told[:, i]))]
            start = int(np.argmin(order))
            assert np.roll(order, -start).tolist() == [0, 1, 2, 3]


def test_a_step_in_place_and_standing_are_told(rig):
    turn = gait.turn_in_place(rig)
    assert contact_f1(told_phases(bare(turn, 3), rig)[:-1] > 0,
                      np.tile(given_phases(turn, rig)[:-1], (3, 1)) > 0) > 0.95  # fmt: skip
    assert (told_phases(bare(gait.idle(rig)), rig) == Phase.FLAT).all()


def test_a_loop_is_told_as_a_cycle_that_goes_on(rig):
    clip = gait.walk(rig)
    inside = told_phases(bare(clip, 3), rig)[len(clip) - 1 :][: len(clip)]
    told = told_phases(bare(clip, loop=True), rig)
    assert (told[0] == told[-1]).all()
    assert (told == inside).all()


@pytest.mark.parametrize("name", ["walk", "run", "turn_in_place"])
def test_contacts_scale_with_the_leg(rig, name):
    clip = bare(getattr(gait, name)(rig), 2)
    told = told_phases(clip, rig)
    for size in (0.35, 3.5):
        skeleton = replace(rig.skeleton, offsets=rig.skeleton.offsets * size)
        legs = tuple(
            replace(
                leg,
                sole=replace(
                    leg.sole,
                    **{k: getattr(leg.sole, k) * size
                       for k in ("height", "heel", "ball", "tip", "half_width")},
                ),
            )
            for leg in rig.legs
        )  # fmt: skip
        large = replace(rig, skeleton=skeleton, legs=legs)
        # Speeds in leg lengths a second are kept.
        grown = replace(clip, skeleton=skeleton, root_positions=clip.root_positions * size)
        assert (told_phases(grown, large) == told).all()


def test_the_floor_is_put_at_zero_wherever_it_was(rig):
    clip = bare(gait.walk(rig), 2)
    high = replace(clip, root_positions=clip.root_positions + np.array([3.0, -4.0, 7.0]))
    lowered, fitted = with_contacts(high, rig)
    assert np.abs(lowered.root_positions[:, 2] - clip.root_positions[:, 2]).max() < 1e-3
    balls = all_sole_points(fitted, *lowered.model_pose())[:, :, [HEEL, BALL], 2]
    assert abs(balls.min()) < 2e-3


def test_a_foot_held_up_keeps_its_sole_and_the_other_one_tells_the_floor(rig):
    clip = still(rig, lift=1.0, knee=1.2)
    lowered, fitted = with_contacts(clip, rig)
    assert fitted.legs[0].sole is rig.legs[0].sole
    points = all_sole_points(fitted, *lowered.model_pose())
    assert points[0, 1, [HEEL, BALL], 2] == pytest.approx(0.0, abs=1e-9)
    phases = given_phases(lowered, fitted)
    assert (phases[:, 0] == Phase.SWING).all()
    assert (phases[:, 1] == Phase.FLAT).all()


@pytest.mark.parametrize("frames", [2, 3, 40])
def test_a_still_pose_stands(rig, frames):
    with_curves, _ = with_contacts(still(rig, frames, lift=0.5), rig)
    for leg in rig.legs:
        assert (with_curves.curves[weight_curve(leg.name)] == 1.0).all()


def test_weights_without_phases_are_kept_with_the_floor(rig):
    walk = gait.walk(rig)
    names = [weight_curve(leg.name) for leg in rig.legs]
    weights = {n: walk.curves[n] for n in names}
    clip = replace(walk, curves={**weights, "other": np.ones(len(walk))},
                   root_positions=walk.root_positions + np.array([0, 0, 0.4]))  # fmt: skip
    out, _ = with_contacts(clip, rig)
    assert (out.root_positions == clip.root_positions).all()
    assert set(out.curves) == {*walk.curves, "other"}
    for leg in rig.legs:
        name, phase = weight_curve(leg.name), out.curves[phase_curve(leg.name)]
        assert out.curves[name] is clip.curves[name]
        assert ((phase > 0) == (clip.curves[name] >= 0.5)).all()
        assert set(phase) == {0.0, 1.0, 2.0, 3.0}


def test_phases_without_weights_are_kept_and_give_the_weights(rig):
    walk = gait.walk(rig)
    phases = {phase_curve(leg.name): walk.curves[phase_curve(leg.name)] for leg in rig.legs}
    out, same = with_contacts(replace(walk, curves=phases), rig)
    assert same is rig
    assert (given_phases(out, rig) == given_phases(walk, rig)).all()
    for leg in rig.legs:
        held = phases[phase_curve(leg.name)] > 0
        assert (out.curves[weight_curve(leg.name)] == held).all()


def test_the_curve_of_one_leg_alone_is_kept(rig):
    walk = gait.walk(rig)
    name = weight_curve("left")
    out, _ = with_contacts(replace(walk, curves={name: walk.curves[name]}), rig)
    assert out.curves[name] is walk.curves[name]
    assert contact_f1(given_phases(out, rig) > 0, given_phases(walk, rig) > 0) > 0.95


def test_a_blend_of_phases_is_the_phase_before_it(rig):
    walk = gait.walk(rig)
    curve = phase_curve("left")
    values = walk.curves[curve].copy()
    release = int(np.flatnonzero(np.diff(values) == -3.0)[0])
    values[release + 1] = 1.5
    out, _ = with_contacts(walk.with_curves(**{curve: values}), rig)
    assert out.curves[curve][release : release + 3].tolist() == [3.0, 3.0, 0.0]


@pytest.mark.parametrize("value", [-1.0, 3.5, 7.0])
def test_a_value_that_is_no_phase_is_an_error(rig, value):
    walk = gait.walk(rig)
    values = walk.curves[phase_curve("right")].copy()
    values[5] = value
    clip = walk.with_curves(**{phase_curve("right"): values})
    with pytest.raises(FootIKError, match=r"RightFootPhase.*frame 5; a phase is 0 \(swing\)"):
        with_contacts(clip, rig)


def test_a_stub_of_a_contact_at_the_cut_is_mended(rig):
    names = weight_curve("left"), phase_curve("left")
    right = {weight_curve("right"): np.ones(61), phase_curve("right"): np.full(61, 2.0)}
    for stub, value in ((slice(57, 61), 2.0), (slice(0, 3), 2.0)):
        phase = np.zeros(61)
        phase[20:40] = 2.0
        phase[stub] = value
        clip = still(rig, 61).with_curves(**{names[0]: (phase > 0) * 1.0, names[1]: phase}, **right)
        out = mend_seam(clip, rig)
        assert np.flatnonzero(out.curves[names[1]]).tolist() == list(range(20, 40))
        assert (out.curves[names[0]] == (out.curves[names[1]] > 0)).all()
    # A contact that goes on across the cut is none.
    phase = np.zeros(61)
    phase[:20], phase[57:] = 2.0, 2.0
    clip = still(rig, 61).with_curves(**{names[0]: (phase > 0) * 1.0, names[1]: phase}, **right)
    assert (mend_seam(clip, rig).curves[names[1]] == phase).all()


@pytest.mark.parametrize(
    ("file", "swing", "stance"),
    [("cmu_02_01_walk.bvh", (0.36, 0.50), (0.55, 0.75)),
     ("cmu_02_03_run.bvh", (0.45, 0.65), (0.15, 0.28))],
)  # fmt: skip
def test_captured_steps_last_as_long_as_peoples(file, swing, stance):
    if not (BVH / file).exists():
        pytest.skip(f"no captured clips: {BVH} is not there (set FOOTIK_SHARED)")
    clip = read_bvh(BVH / file)
    down = detect.of_clip(working(clip), CleanSettings()).foot
    spans = {False: [], True: []}
    for i in range(2):
        edges = np.flatnonzero(np.diff(down[:, i])) + 1
        for a, b in pairwise(edges):
            spans[bool(down[a, i])].append((b - a) / clip.fps)
    assert len(spans[False]) >= 2
    assert swing[0] <= min(spans[False]) <= max(spans[False]) <= swing[1]
    assert stance[0] <= min(spans[True]) <= max(spans[True]) <= stance[1]


@pytest.mark.parametrize("file", sorted(BVH.glob("*.bvh")), ids=lambda p: p.stem)
def test_captured_floors_are_level_and_at_zero(file):
    clip = read_bvh(file)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        clip, rig = with_contacts(clip, find_rig(clip.skeleton))
    points = all_sole_points(rig, *clip.model_pose())
    flat = given_phases(clip, rig) == Phase.FLAT
    for i in range(2):
        heights = points[flat[:, i], i][:, [HEEL, BALL], 2]
        assert abs(np.median(heights)) < 0.01
        assert np.percentile(np.abs(heights), 95) < 0.03
