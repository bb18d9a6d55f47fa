from dataclasses import replace

import numpy as np
import pytest

from footik_runtime import gait
from footik_runtime import quat_arrays as qa
from footik_runtime.builtin import humanoid_rig
from footik_runtime.clip import Clip
from footik_runtime.offline.skate import working_of
from footik_runtime.offline.solve_legs import knee_hinges, leg_spans, solve, usable_lengths
from footik_runtime.offline.stages import CleanSettings, FootPaths
from footik_runtime.rig import find_rig
from footik_runtime.skeleton import Skeleton

RIG = humanoid_rig()
WALK = gait.walk(RIG)
SETTINGS = CleanSettings()


def paths(frames, legs=2, moves=None, turns=None, toe_turns=None):
    still = np.zeros((frames, legs, 3))
    given = [still.copy() if v is None else v for v in (moves, turns, toe_turns)]
    return FootPaths(
        moves=given[0], turns=given[1], toe_turns=given[2], pinned=np.asarray(given[0].any(axis=-1))
    )


def pose_after(clip, rotations, translations, root):
    return replace(
        clip,
        root_positions=clip.root_positions + root,
        rotations=rotations,
        translations=translations,
    ).model_pose()


def lowered_walk():
    down = WALK.root_positions - [0.0, 0.0, 0.03]
    return replace(WALK, root_positions=down)


def test_feet_and_toes_come_to_their_goals_exactly():
    rng = np.random.default_rng(3)
    frames = len(WALK)
    moves = rng.uniform(-0.02, 0.02, (frames, 2, 3)) + np.array([0.0, 0.0, 0.04])
    turns = rng.uniform(-0.5, 0.5, (frames, 2, 3))
    toe_turns = rng.uniform(-0.5, 0.5, (frames, 2, 3))
    root = rng.uniform(-0.01, 0.01, (frames, 3))
    work = working_of(WALK, RIG)
    rotations, translations, reached = solve(
        work, paths(frames, 2, moves, turns, toe_turns), root, SETTINGS
    )
    assert translations is None
    assert reached.all()
    positions, world = pose_after(WALK, rotations, None, root)
    for f, leg in enumerate(RIG.legs):
        goal = work.positions[:, leg.ankle] + moves[:, f]
        assert np.abs(positions[:, leg.ankle] - goal).max() < 1e-9
        foot = qa.mul(qa.from_rotvec(turns[:, f]), work.rotations[:, leg.ankle])
        assert np.abs(qa.to_rotvec(qa.mul(world[:, leg.ankle], qa.conj(foot)))).max() < 1e-7
        toes = qa.mul(qa.from_rotvec(turns[:, f]), work.rotations[:, leg.toe])
        toes = qa.mul(qa.from_rotvec(toe_turns[:, f]), toes)
        assert np.abs(qa.to_rotvec(qa.mul(world[:, leg.toe], qa.conj(toes)))).max() < 1e-7


def test_what_is_not_asked_stays_to_the_last_bit():
    frames = len(WALK)
    moves = np.zeros((frames, 2, 3))
    moves[10:14, 1] = [0.0, 0.01, 0.02]
    rotations, _, _ = solve(
        working_of(WALK, RIG), paths(frames, 2, moves), np.zeros((frames, 3)), SETTINGS
    )
    changed = (rotations != WALK.rotations).any(axis=-1)
    leg = RIG.legs[1]
    assert set(np.flatnonzero(changed.any(axis=0))) == {leg.hip, leg.knee, leg.ankle}
    assert set(np.flatnonzero(changed.any(axis=1))) == set(range(10, 14))


def test_turned_toes_alone_change_the_toe_joint_alone():
    frames = len(WALK)
    toe_turns = np.zeros((frames, 2, 3))
    toe_turns[5, 0] = [0.0, 0.3, 0.0]
    rotations, _, _ = solve(
        working_of(WALK, RIG), paths(frames, toe_turns=toe_turns), np.zeros((frames, 3)), SETTINGS
    )
    changed = np.argwhere((rotations != WALK.rotations).any(axis=-1))
    assert changed.tolist() == [[5, RIG.legs[0].toe]]


def test_knees_stay_in_the_plane_they_were_bent_in():
    clip = lowered_walk()
    work = working_of(clip, RIG)
    moves = np.zeros((len(clip), 2, 3))
    moves[..., 2] = 0.05
    rotations, _, _ = solve(work, paths(len(clip), 2, moves), np.zeros((len(clip), 3)), SETTINGS)
    positions, _ = pose_after(clip, rotations, None, np.zeros((len(clip), 3)))
    for leg in RIG.legs:
        before, after = (
            np.cross(p[:, leg.knee] - p[:, leg.hip], p[:, leg.ankle] - p[:, leg.knee])
            for p in (work.positions, positions)
        )
        cosine = np.sum(qa.unit(before) * qa.unit(after), axis=-1)
        assert cosine.min() > 0.98


def straight_leg(frames=30, bend=None):
    names = ("hips", "LeftUpLeg", "LeftTwist", "LeftLeg", "LeftFoot", "LeftToe")
    names += ("RightUpLeg", "RightLeg", "RightFoot", "RightToe")
    parents = np.array([-1, 0, 1, 2, 3, 4, 0, 6, 7, 8])
    offsets = np.array(
        [
            [0, 0, 0.95], [0, 0.1, 0], [0, 0, -0.2], [0, 0, -0.22], [0, 0, -0.43], [0.12, 0, -0.07],
            [0, -0.1, 0], [0, 0, -0.42], [0, 0, -0.43], [0.12, 0, -0.07],
        ]
    )  # fmt: skip
    skeleton = Skeleton(names=names, parents=parents, offsets=offsets)
    rotations = np.tile([1.0, 0.0, 0.0, 0.0], (frames, len(names), 1))
    if bend is not None:
        rotations[:, [3, 7]] = qa.about([0.0, 1.0, 0.0], bend)[:, None]
    roots = np.tile(offsets[0], (frames, 1))
    return Clip(skeleton=skeleton, fps=60.0, root_positions=roots, rotations=rotations)


def test_straight_legs_bend_forward_and_do_not_flip():
    # Straight in most frames, hyperextended by a hair in some, as captured knees are.
    bend = np.where(np.arange(30) % 7 < 3, -0.001, 0.0005)
    bend[:2] = 0.6
    clip = straight_leg(bend=bend)
    rig = find_rig(clip.skeleton)
    work = working_of(clip, rig)
    root = np.tile([0.0, 0.0, -0.02], (30, 1))
    moves = np.zeros((30, 2, 3))
    rotations, _, reached = solve(work, paths(30, 2, moves), root, SETTINGS)
    positions, _ = pose_after(clip, rotations, None, root)
    assert reached.all()
    for leg in rig.legs:
        line = 0.5 * (positions[:, leg.hip] + positions[:, leg.ankle])
        assert (positions[2:, leg.knee, 0] - line[2:, 0] > 0.01).all()
        knees = rotations[2:, leg.knee]
        assert np.ptp(np.linalg.norm(qa.to_rotvec(knees), axis=-1)) < np.radians(1.0)


def test_twist_bones_keep_their_place_in_the_bone():
    clip = straight_leg(bend=np.full(30, 0.4))
    rig = find_rig(clip.skeleton)
    work = working_of(clip, rig)
    twist = np.tile(qa.from_rotvec([0.0, 0.0, 0.7]), (30, 1))
    twisted = clip.rotations.copy()
    twisted[:, 2] = twist
    clip = replace(clip, rotations=twisted)
    work = working_of(clip, rig)
    moves = np.tile([0.02, 0.03, 0.05], (30, 2, 1))
    rotations, _, _ = solve(work, paths(30, 2, moves), np.zeros((30, 3)), SETTINGS)
    assert (rotations[:, 2] == twist).all()
    positions, _ = pose_after(clip, rotations, None, np.zeros((30, 3)))
    assert np.abs(positions[:, 4] - work.positions[:, 4] - moves[:, 0]).max() < 1e-9


def test_bones_stretch_only_as_far_as_allowed():
    work = working_of(WALK, RIG)
    length, extension = leg_spans(RIG, work.positions)
    frames = len(WALK)
    line = qa.unit(work.positions[:, RIG.legs[0].ankle] - work.positions[:, RIG.legs[0].hip])
    moves = np.zeros((frames, 2, 3))
    moves[:, 0] = line * (1.005 * length[:, 0] - extension[:, 0])[:, None]
    still = np.zeros((frames, 3))
    _, none, reached = solve(work, paths(frames, 2, moves), still, SETTINGS)
    assert none is None
    assert not reached[:, 0].any()
    assert reached[:, 1].all()
    rotations, longer, reached = solve(
        work, paths(frames, 2, moves), still, CleanSettings(stretch=0.02, reach=0.995)
    )
    assert reached.all()
    assert longer is not None
    positions, _ = pose_after(WALK, rotations, longer, still)
    stretched, _ = leg_spans(RIG, positions)
    assert (stretched[:, 0] / length[:, 0]).max() < 1.02 + 1e-9
    assert (stretched[:, 0] / length[:, 0]).min() > 1.004
    assert np.abs(stretched[:, 1] - length[:, 1]).max() < 1e-12


def test_segments_keep_their_lengths_without_stretch():
    rng = np.random.default_rng(0)
    work = working_of(WALK, RIG)
    moves = rng.uniform(-0.3, 0.3, (len(WALK), 2, 3))
    rotations, none, _ = solve(work, paths(len(WALK), 2, moves), np.zeros((len(WALK), 3)), SETTINGS)
    positions, _ = pose_after(WALK, rotations, none, np.zeros((len(WALK), 3)))
    before, _ = leg_spans(RIG, work.positions)
    after, _ = leg_spans(RIG, positions)
    assert np.isfinite(rotations).all()
    assert np.abs(after - before).max() < 1e-12


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e9])
def test_degenerate_bodies_stay_finite(size):
    skeleton = replace(RIG.skeleton, offsets=RIG.skeleton.offsets * size)
    rig = replace(RIG, skeleton=skeleton)
    clip = replace(WALK, skeleton=skeleton, root_positions=WALK.root_positions * size)
    moves = np.full((len(clip), 2, 3), 0.1)
    rotations, _, _ = solve(
        working_of(clip, rig), paths(len(clip), 2, moves), np.zeros((len(clip), 3)), SETTINGS
    )
    assert np.isfinite(rotations).all()
    assert np.abs(np.linalg.norm(rotations, axis=-1) - 1.0).max() < 1e-9


def test_hinges_point_left_where_knees_bend_forward():
    hinges = knee_hinges(working_of(WALK, RIG))
    for f, leg in enumerate(RIG.legs):
        thigh = working_of(WALK, RIG).rotations[:, leg.hip]
        assert (qa.rotate(thigh, hinges[f])[:, 1] > 0.8).all()
    clip = straight_leg()  # bends in no frame, nor at rest
    rig = find_rig(clip.skeleton)
    assert np.abs(knee_hinges(working_of(clip, rig)) - [0.0, 1.0, 0.0]).max() < 1e-9


def test_a_leg_may_do_what_the_input_does():
    clip = straight_leg(bend=np.linspace(0.0, 0.8, 30))
    rig = find_rig(clip.skeleton)
    work = working_of(clip, rig)
    length, extension = leg_spans(rig, work.positions)
    usable = usable_lengths(work, SETTINGS)
    assert (usable >= np.minimum(extension, length * (1.0 - 1e-7))).all()
    assert usable[-1] == pytest.approx(SETTINGS.reach * length[-1])
