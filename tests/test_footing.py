from dataclasses import replace

import numpy as np
import pytest

from footik_runtime import gait
from footik_runtime import quat_arrays as qa
from footik_runtime.builtin import humanoid_rig
from footik_runtime.offline.footing import poses
from footik_runtime.offline.plants import find, phases_of
from footik_runtime.offline.skate import GROUNDS, KINDS, inject, true_walk, working_of
from footik_runtime.offline.spread import heights_under, moved_soles
from footik_runtime.offline.stages import CleanSettings, Contacts
from footik_runtime.phases import Phase
from footik_runtime.sole import BALL, HEEL, TIP

RIG = humanoid_rig()
WALK = gait.walk(RIG)
TRUTHS = {ground: true_walk(WALK, RIG, ground=ground) for ground in GROUNDS}
FLAT = TRUTHS["flat"]
SETTINGS = CleanSettings()


def contacts_of(phases, fps=60.0):
    """Contacts as if they had been told by phases (T, F)."""
    down = np.stack([np.isin(phases, [1, 2]), np.isin(phases, [2, 3])], axis=-1)
    return Contacts(
        fps=fps,
        down=down,
        confidence=down.astype(float),
        ground=np.zeros(down.shape),
        belt=np.zeros(3),
    )


def footed(clip, phases, settings=SETTINGS):
    work = working_of(clip, RIG)
    plants = find(work, contacts_of(phases, clip.fps), settings)
    return work, plants, poses(work, plants, settings)


def asked(work, plant):
    """Whether a plant changes enough for its foot to be moved."""
    return plant.change >= SETTINGS.keep_below * work.scale


def tilted(clip, degrees):
    """A clip whose feet are all pitched nose down by so much, about the ankle."""
    rotations = clip.rotations.copy()
    _, model = clip.model_pose()
    for leg in RIG.legs:
        about = qa.rotate(qa.mul(model[:, leg.ankle], leg.sole.frame), [0.0, 1.0, 0.0])
        turn = qa.from_rotvec(np.radians(degrees) * about)
        above = qa.conj(model[:, RIG.skeleton.parents[leg.ankle]])
        rotations[:, leg.ankle] = qa.mul(above, qa.mul(turn, model[:, leg.ankle]))
    return replace(clip, rotations=rotations)


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("kind", KINDS)
def test_pinned_points_stay_where_they_are_held(ground, kind):
    truth = TRUTHS[ground]
    work, plants, paths = footed(inject(truth, kind, 0.01, seed=3), truth.phases)
    soles = moved_soles(work, paths)
    for p in plants:
        if not asked(work, p):
            continue
        assert np.abs(soles[p.start : p.roll, p.foot, HEEL] - p.heel).max(initial=0.0) < 1e-7
        assert np.abs(soles[p.flat : p.roll, p.foot, BALL] - p.ball).max(initial=0.0) < 1e-7
        off = soles[p.roll : p.stop, p.foot, BALL] - p.ball
        along = off - p.normal * (off @ p.normal)[:, None]
        assert np.abs(along).max(initial=0.0) < 1e-7
        assert (off @ p.normal).max(initial=0.0) < 0.01


@pytest.mark.parametrize("ground", GROUNDS)
def test_feet_that_stand_still_are_asked_nothing(ground):
    truth = TRUTHS[ground]
    _, plants, paths = footed(truth.clip, truth.phases)
    assert plants
    assert not paths.moves.any()
    assert not paths.turns.any()
    assert not paths.toe_turns.any()
    contact = truth.phases != Phase.SWING
    assert not paths.pinned[~contact].any()
    assert paths.pinned[contact].mean() > 0.98


def test_nothing_is_asked_between_plants():
    work, plants, paths = footed(inject(FLAT, "constant", 0.03), FLAT.phases)
    swing = phases_of(plants, FLAT.phases.shape) == Phase.SWING
    assert np.array_equal(paths.pinned, ~swing)
    for values in (paths.moves, paths.turns, paths.toe_turns):
        assert not values[swing].any()
    assert paths.moves[~swing].any()
    assert len(work.soles) == len(paths.moves)


@pytest.mark.parametrize("degrees", [-5.0, 5.0])
def test_pitched_feet_are_laid_flat_without_a_jump(degrees):
    work, plants, paths = footed(tilted(FLAT.clip, degrees), FLAT.phases)
    soles = moved_soles(work, paths)
    phases = phases_of(plants, FLAT.phases.shape)
    flat = phases == Phase.FLAT
    over = soles[..., 2] - heights_under(soles, plants)
    assert np.abs(over[flat][:, [HEEL, BALL]]).max() < SETTINGS.keep_below
    within = (phases[1:] != Phase.SWING) & (phases[:-1] != Phase.SWING)
    steps = np.degrees(np.linalg.norm(np.diff(paths.turns, axis=0), axis=-1))
    asked = np.abs(np.diff(work.rotations[:, [leg.ankle for leg in RIG.legs]], axis=0))
    assert steps[within].max() < 1.0 + np.degrees(2.2 * asked.max())
    assert np.degrees(np.linalg.norm(paths.turns[flat], axis=-1)).max() < abs(degrees) + 0.5


@pytest.mark.parametrize("degrees", [-8.0, 8.0])
def test_no_part_of_a_held_foot_is_under_the_ground(degrees):
    work, plants, paths = footed(tilted(FLAT.clip, degrees), FLAT.phases)
    soles = moved_soles(work, paths)
    over = soles[..., 2] - heights_under(soles, plants)
    for p in plants:
        if asked(work, p):
            assert over[p.start : p.stop, p.foot].min() > -1e-9
    assert over[..., TIP][paths.pinned].min() > -SETTINGS.keep_below * work.scale


def test_the_whole_contact_has_the_yaw_of_its_print():
    turn = qa.about([0.0, 0.0, 1.0], 0.06 * np.sin(np.arange(len(FLAT.clip)) / 9.0))
    clip = FLAT.clip
    rotations = clip.rotations.copy()
    _, model = clip.model_pose()
    for leg in RIG.legs:
        above = qa.conj(model[:, RIG.skeleton.parents[leg.ankle]])
        rotations[:, leg.ankle] = qa.mul(above, qa.mul(turn, model[:, leg.ankle]))
    work, plants, paths = footed(replace(clip, rotations=rotations), FLAT.phases)
    soles = moved_soles(work, paths)
    along = soles[:, :, BALL] - soles[:, :, HEEL]
    yaw = np.arctan2(along[..., 1], along[..., 0])
    for p in plants:
        if p.flat < p.roll and asked(work, p):
            assert np.ptp(yaw[p.flat : p.roll, p.foot]) < 1e-9


def test_a_foot_that_rocks_back_goes_from_flat_to_flat_without_a_jump():
    start, stop = next(
        (p.flat, p.roll) for p in footed(FLAT.clip, FLAT.phases)[1] if p.start > 0 and p.foot == 0
    )
    phases = FLAT.phases.copy()
    phases[start + 5 : start + 11, 0] = Phase.HEEL
    work, plants, paths = footed(tilted(FLAT.clip, 4.0), phases)
    mine = [p for p in plants if p.foot == 0 and p.start < stop and p.stop > start]
    assert len(mine) == 2
    turns = np.degrees(paths.turns[start : start + 14, 0])
    assert np.linalg.norm(np.diff(turns, axis=0), axis=-1).max() < 2.5
    soles = moved_soles(work, paths)[start : start + 14, 0, HEEL]
    assert np.abs(soles - mine[0].heel).max() < 1e-9


def test_no_plants_ask_nothing():
    work = working_of(FLAT.clip, RIG)
    paths = poses(work, (), SETTINGS)
    assert not paths.moves.any()
    assert not paths.pinned.any()
