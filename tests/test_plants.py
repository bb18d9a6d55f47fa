from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from footik_runtime import gait
from footik_runtime import quat_arrays as qa
from footik_runtime.builtin import humanoid_rig
from footik_runtime.offline.filters import contact_spans, runs
from footik_runtime.offline.footprints import footprints
from footik_runtime.offline.plants import credible, find, found_ground, phases_of
from footik_runtime.offline.skate import GROUNDS, KINDS, inject, true_walk, working_of
from footik_runtime.offline.stages import CleanSettings, Contacts
from footik_runtime.phases import Phase
from footik_runtime.sole import BALL, HEEL

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


def found(clip, phases, ground=None, settings=SETTINGS):
    return find(working_of(clip, RIG), contacts_of(phases, clip.fps), settings, ground)


def moved(work, move):
    """The working clip with its soles moved by (T, F, 3) or what broadcasts to it."""
    return replace(work, soles=work.soles + np.asarray(move)[..., None, :])


def whole(truth, foot):
    """The true places of contacts that neither end of the clip cuts."""
    return [p for p in truth.places(foot) if p[0] > 0 and p[1] < len(truth.clip)]


class Steps:
    """Level ground with a 4 cm kerb at x = 1."""

    def height(self, points):
        return np.where(points[:, 0] > 1.0, 0.04, 0.0)

    def normal(self, points):
        return np.tile([0.0, 0.0, 1.0], (len(points), 1))


class Slope:
    def __init__(self, rise):
        self.rise = rise

    def height(self, points):
        return self.rise * points[:, 0] - 0.02

    def normal(self, points):
        return np.tile(qa.unit([-self.rise, 0.0, 1.0]), (len(points), 1))


class Nowhere:
    def height(self, points):
        return np.full(len(points), np.nan)

    def normal(self, points):
        return np.full((len(points), 3), np.nan)


@pytest.mark.parametrize("ground", GROUNDS)
def test_feet_that_stand_still_are_held_where_they_are(ground):
    truth = TRUTHS[ground]
    plants = found(truth.clip, truth.phases)
    assert max(p.change for p in plants) < 2e-4
    # A contact of which the clip shows one frame tells no place.
    assert np.array_equal(phases_of(plants, truth.phases.shape)[:-1], truth.phases[:-1])


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("kind", [k for k in KINDS if k != "drift"])
def test_places_are_recovered_from_feet_that_slide(kind, ground):
    truth = TRUTHS[ground]
    slid = inject(truth, kind, 0.008 if kind == "noise" else 0.04, seed=2)
    plants = found(slid, truth.phases)
    for foot in range(2):
        for start, stop, place in whole(truth, foot):
            plant = next(p for p in plants if p.foot == foot and p.start < stop and p.stop > start)
            assert np.linalg.norm(0.5 * (plant.heel + plant.ball) - place) < 0.005
            assert plant.change > 0.004


@pytest.mark.parametrize("kind", ["flat", "slope", "stairs"])
def test_steps_of_a_drifting_body_are_what_they_were_but_for_the_drift(kind):
    truth = TRUTHS[kind]
    drifted = inject(truth, "drift", 0.08)
    plants = found(drifted, truth.phases)
    for foot in range(2):
        true = [p[2] for p in whole(truth, foot)]
        held = [0.5 * (p.heel + p.ball) for p in plants if p.foot == foot]
        held = held[len(held) - len(true) - 1 :][: len(true)] if len(held) > len(true) else held
        steps = np.diff(held, axis=0) - np.diff(true, axis=0)
        # 8 cm over the clip: its share of a cycle is not a fault of the feet.
        assert np.linalg.norm(steps, axis=-1).max() < 0.08 / 4 + 0.005


def test_ground_is_a_plane_where_it_is_one_and_stairs_are_none():
    for ground, kind in (("flat", "plane"), ("slope", "plane"), ("stairs", "per plant")):
        truth = TRUTHS[ground]
        phases = truth.phases.copy()  # a contact that an end cuts would give the stairs away
        for foot in range(2):
            for start, stop in runs(phases[:, foot] > 0):
                if start == 0 or stop == len(phases):
                    phases[start:stop, foot] = Phase.SWING
        work, contacts = working_of(truth.clip, RIG), contacts_of(phases)
        prints = footprints(work, contacts, contact_spans(contacts.foot))
        told = found_ground(prints, work.scale)
        assert told.kind == kind
        wanted = truth.normal(prints.places)
        assert np.abs(told.normals - wanted).max() < 0.01


def test_treads_are_shared_by_both_feet():
    work = working_of(FLAT.clip, RIG)
    feet = np.array([[[0.0, 0.0, 0.003], [0.0, 0.0, -0.003]]])
    # A clip in which feet sink and rise while they stand: heights of single plants mean little.
    wobble = 0.004 * np.sin(0.9 * np.arange(len(work.soles)))[:, None, None] * [0.0, 0.0, 1.0]
    plants = find(moved(work, feet + wobble), contacts_of(FLAT.phases), SETTINGS)
    assert np.ptp([p.heel[2] for p in plants]) < 1e-12
    stairs = TRUTHS["stairs"]
    work = working_of(stairs.clip, RIG)
    plants = find(moved(work, wobble), contacts_of(stairs.phases), SETTINGS)
    heights = np.array([p.heel[2] for p in plants])
    assert np.abs(heights - stairs.height(np.array([p.heel for p in plants]))).max() < 0.006


def test_given_ground_wins():
    plants = found(FLAT.clip, FLAT.phases, Steps())
    heights = {round(float(p.ball[2]), 6) for p in plants if abs(p.ball[0] - 1.0) > 0.3}
    assert heights == {0.0, 0.04}
    plants = found(FLAT.clip, FLAT.phases, Slope(0.1))
    for p in plants:
        for point in (p.heel, p.ball):
            assert abs(point[2] - (0.1 * point[0] - 0.02)) < 1e-9
        assert np.allclose(qa.rotate(p.turn, [0.0, 0.0, 1.0]), p.normal)
        along = qa.unit(p.ball - p.heel)
        assert np.allclose(qa.rotate(p.turn, [1.0, 0.0, 0.0]), along)
        length = RIG.legs[p.foot].sole.heel + RIG.legs[p.foot].sole.ball
        assert np.linalg.norm(p.ball - p.heel) == pytest.approx(length)


def test_where_the_given_ground_ends_the_found_is_used():
    plants = found(FLAT.clip, FLAT.phases, Nowhere())
    assert max(p.change for p in plants) < 1e-4


@pytest.mark.parametrize("late", [-3, 3])
def test_phases_told_early_or_late_are_mended(late):
    phases = FLAT.phases.copy()
    for foot in range(2):
        for start, stop in runs(phases[:, foot] == Phase.FLAT):
            if start > 6 and stop < len(phases) - 6:
                low, high = (stop + late, stop) if late < 0 else (stop, stop + late)
                phases[low:high, foot] = Phase.BALL if late < 0 else Phase.FLAT
                low, high = (start + late, start) if late < 0 else (start, start + late)
                phases[low:high, foot] = Phase.FLAT if late < 0 else Phase.HEEL
    assert (phases != FLAT.phases).any()
    assert max(p.change for p in found(FLAT.clip, phases)) < 1e-4


def test_contacts_told_too_long_are_shortened():
    phases = FLAT.phases.copy()
    for foot in range(2):
        for start, stop in runs(FLAT.phases[:, foot] != Phase.SWING):
            phases[max(start - 3, 0) : start, foot] = Phase.HEEL
            phases[stop : stop + 3, foot] = Phase.BALL
    plants = found(FLAT.clip, phases)
    # Of a contact that is hardly begun when the clip ends, nobody can tell.
    assert max(p.change for p in plants if p.stop - p.start > 12) < SETTINGS.keep_below
    assert np.mean(phases_of(plants, phases.shape) != FLAT.phases) < 0.02


def test_a_foot_that_rocks_is_plants_of_one_print_without_a_gap():
    phases = FLAT.phases.copy()
    start, stop = next((a, b) for a, b in runs(phases[:, 0] == Phase.FLAT) if a > 0 and b - a > 12)
    phases[start + 4 : start + 9, 0] = Phase.HEEL
    plants = [
        p for p in found(FLAT.clip, phases) if p.start < stop and p.stop > start and not p.foot
    ]
    assert len(plants) == 2
    assert plants[0].stop == plants[1].start
    assert np.array_equal(plants[0].heel, plants[1].heel)
    phases[start + 4 : start + 9, 0] = Phase.FLAT
    phases[start + 4 : start + 5, 0] = Phase.HEEL  # a flicker
    plants = [
        p for p in found(FLAT.clip, phases) if p.start < stop and p.stop > start and not p.foot
    ]
    assert len(plants) == 1


def test_a_foot_that_shuffles_in_one_contact_has_two_places():
    idle = gait.idle(RIG)
    work = working_of(idle, RIG)
    frames = np.arange(len(idle))
    slide = 0.06 * np.clip((frames - 150) / 9.0, 0.0, 1.0)
    work = moved(work, slide[:, None, None] * [1.0, 0.0, 0.0])
    plants = find(work, contacts_of(np.full((len(idle), 2), 2)), SETTINGS)
    for foot in range(2):
        first, second = (p for p in plants if p.foot == foot)
        assert first.stop <= second.start
        assert second.start >= 150
        assert second.heel[0] - first.heel[0] == pytest.approx(0.06, abs=0.002)


def test_without_snap_plants_keep_their_height():
    work = working_of(FLAT.clip, RIG)
    feet = np.array([[[0.0, 0.0, 0.004], [0.0, 0.0, -0.004]]])
    plants = find(moved(work, feet), contacts_of(FLAT.phases), replace(SETTINGS, snap=False))
    for p in plants:
        assert p.heel[2] == pytest.approx(0.004 if p.foot == 0 else -0.004, abs=1e-4)


def test_no_contact_no_plant_and_a_cut_contact_is_one():
    phases = np.zeros_like(FLAT.phases)
    assert found(FLAT.clip, phases) == ()
    phases[:, 0] = Phase.FLAT
    plants = found(FLAT.clip, phases)
    assert plants
    assert all(p.foot == 0 and np.isfinite(p.heel).all() for p in plants)
    assert found(FLAT.clip.cut(0, 1), np.full((1, 2), Phase.FLAT)) == ()
    assert len(found(FLAT.clip.cut(20, 26), np.full((6, 2), Phase.FLAT))) == 2


@given(hnp.arrays(bool, st.tuples(st.integers(0, 30), st.integers(1, 4))))
def test_spans_tell_the_contacts(down):
    again = np.zeros_like(down)
    spans = contact_spans(down)
    for foot, start, stop in spans:
        assert start < stop
        assert not again[start:stop, foot].any()
        again[start:stop, foot] = True
    assert np.array_equal(again, down)
    assert [tuple(s) for s in spans] == sorted(tuple(s) for s in spans)


@pytest.mark.parametrize("size", [0.5, 2.0])
def test_plants_scale_with_the_body(size):
    """A body twice the size, moving twice as far in the same frames, is held twice as far."""
    work, contacts = working_of(inject(FLAT, "constant", 0.03), RIG), contacts_of(FLAT.phases)
    legs = tuple(
        replace(
            leg,
            sole=replace(
                leg.sole,
                heel=size * leg.sole.heel,
                ball=size * leg.sole.ball,
                tip=size * leg.sole.tip,
                height=size * leg.sole.height,
            ),
        )
        for leg in RIG.legs
    )
    big = replace(
        work, rig=replace(RIG, legs=legs), soles=size * work.soles, scale=size * work.scale
    )
    for a, b in zip(find(work, contacts, SETTINGS), find(big, contacts, SETTINGS), strict=True):
        assert (a.start, a.flat, a.roll, a.stop) == (b.start, b.flat, b.roll, b.stop)
        assert np.allclose(size * a.heel, b.heel, atol=1e-9)


def test_a_ball_of_a_held_foot_is_as_far_from_its_heel_as_the_sole_says():
    for p in found(inject(FLAT, "noise", 0.01), FLAT.phases):
        assert p.start <= p.flat <= p.roll <= p.stop
        sole = RIG.legs[p.foot].sole
        assert np.linalg.norm(p.ball - p.heel) == pytest.approx(sole.heel + sole.ball)
        assert HEEL != BALL
        assert p.normal[2] > 0.99


def test_plants_that_go_far_or_stand_steep_are_not_credible():
    truth = TRUTHS["flat"]
    work = working_of(truth.clip, RIG)
    plants = find(work, contacts_of(truth.phases, truth.clip.fps), SETTINGS)
    assert credible(work, plants, SETTINGS) == (plants, ())
    far = replace(plants[1], change=1.1 * SETTINGS.leave_above * work.scale)
    steep = replace(plants[2], normal=np.array([np.sin(1.0), 0.0, np.cos(1.0)]))
    mixed = (plants[0], far, steep, *plants[3:])
    assert credible(work, mixed, SETTINGS) == ((plants[0], *plants[3:]), (far, steep))
