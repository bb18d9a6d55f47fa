import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from footik_runtime import gait
from footik_runtime.builtin import humanoid_rig
from footik_runtime.offline.footing import poses
from footik_runtime.offline.plants import find
from footik_runtime.offline.skate import inject, true_walk, working_of
from footik_runtime.offline.spread import heights_under, lowest_in_swing, moved_soles, spread
from footik_runtime.offline.stages import CleanSettings, Contacts, FootPaths
from footik_runtime.sole import BALL, HEEL, TIP

RIG = humanoid_rig()
FLAT = true_walk(gait.walk(RIG), RIG)
WORK = working_of(FLAT.clip, RIG)
SETTINGS = CleanSettings()
EASE = SETTINGS.ease * FLAT.clip.fps


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


PLANTS = find(WORK, contacts_of(FLAT.phases), SETTINGS)
MOVED = tuple(replace(p, change=0.02) for p in PLANTS)  # of feet that may be deep in swing, too


def paths_of(spans, frames=None):
    """Foot 0 pinned in spans {(start, stop): (offset, velocity in m/s)}, at offsets (3,)."""
    frames = len(WORK.soles) if frames is None else frames
    moves, pinned = np.zeros((frames, 2, 3)), np.zeros((frames, 2), dtype=bool)
    for (start, stop), (offset, velocity) in spans.items():
        middle = 0.5 * (start + stop - 1)
        t = (np.arange(start, stop) - middle) / FLAT.clip.fps
        moves[start:stop, 0] = np.asarray(offset) + np.outer(t, velocity)
        pinned[start:stop, 0] = True
    still = np.zeros_like(moves)
    return FootPaths(moves=moves, turns=still, toe_turns=still.copy(), pinned=pinned)


def faded(paths, plants=()):
    return spread(paths, WORK, plants, SETTINGS)


def test_nothing_asked_is_nothing_given():
    paths = paths_of({(20, 40): ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))})
    out = faded(paths, PLANTS)
    for values in (out.moves, out.turns, out.toe_turns):
        assert not values.any()


def test_plants_keep_what_they_ask_and_swings_fade_to_nothing():
    spans = {(20, 50): ((0.02, 0.0, 0.0), (0.03, 0.0, 0.0)), (100, 130): ((0, -0.01, 0), (0, 0, 0))}
    paths = paths_of(spans)
    out = faded(paths).moves[:, 0]
    assert np.array_equal(out[paths.pinned[:, 0]], paths.moves[paths.pinned[:, 0], 0])
    far = np.ones(len(out), dtype=bool)
    for start, stop in spans:
        far[max(start - int(EASE), 0) : stop + int(EASE)] = False
    assert not out[far].any()
    assert np.linalg.norm(np.diff(out, 2, axis=0), axis=-1).max() < 0.0025
    assert not faded(paths).moves[:, 1].any()


@given(
    offset=st.tuples(*[st.floats(-0.05, 0.05)] * 3),
    velocity=st.tuples(*[st.floats(-2.0, 2.0)] * 3),
)
@settings(max_examples=60)
def test_no_fade_swings_out_far(offset, velocity):
    # Pinned for so short that the velocity is what counts.
    paths = paths_of({(40, 44): (offset, velocity)})
    out = faded(paths).moves[:, 0]
    assert np.isfinite(out).all()
    for side, edge in ((out[:40], out[40]), (out[44:], out[43])):
        most = 1.25 * np.linalg.norm(edge) + 1e-12
        assert np.linalg.norm(side, axis=-1).max() <= most


def test_a_short_swing_goes_over_from_plant_to_plant():
    ask = (0.02, 0.01, 0.0)
    paths = paths_of({(20, 50): (ask, (0, 0, 0)), (58, 90): (ask, (0, 0, 0))})
    out = faded(paths).moves[50:58, 0]
    assert np.abs(out - ask).max() < 1e-12  # the same offset on both sides: no way to zero and back
    other = paths_of({(20, 50): (ask, (0, 0, 0)), (52, 90): ((0, 0, 0), (0, 0, 0))})
    out = faded(other).moves[49:53, 0]
    assert (np.diff(np.linalg.norm(out, axis=-1)) <= 1e-12).all()


def test_clip_ends_fade_and_single_frames_do_not_fail():
    last = len(WORK.soles)
    paths = paths_of(
        {(4, 5): ((0.01, 0, 0), (0, 0, 0)), (last - 2, last): ((0, 0.02, 0), (0, 0, 0))}
    )
    out = faded(paths).moves[:, 0]
    assert np.isfinite(out).all()
    assert np.linalg.norm(out[0]) < 0.01
    assert out[last - 3, 1] > 0.015


def test_a_foot_pushed_into_the_ground_is_lifted_smoothly():
    work = WORK
    low = WORK.soles[..., 2].min(axis=-1)
    paths = paths_of({})
    pinned = FLAT.phases > 0
    paths = replace(paths, pinned=pinned)
    sunk = replace(
        work,
        positions=work.positions - [0.0, 0.0, 0.02],
        soles=np.where(pinned[..., None, None], work.soles, work.soles - [0.0, 0.0, 0.02]),
    )
    assert low[~pinned].min() < 0.015
    out = spread(paths, sunk, MOVED, SETTINGS)
    # `sunk` was so deep already: only what is deeper than 3 mm is taken out.
    lift = out.moves[..., 2]
    assert lift.max() > 0.005
    assert (lift >= 0.0).all()
    assert not lift[pinned].any()
    soles = moved_soles(sunk, out)
    depth = heights_under(soles, PLANTS) - soles[..., 2]
    assert depth[~pinned][:, [HEEL, BALL]].max() < 0.003 * work.scale + 1e-9


def test_toes_bend_out_of_the_ground():
    pinned = FLAT.phases > 0
    bent = np.zeros((len(WORK.soles), 2, 3))
    along = WORK.soles[:, :, TIP] - WORK.soles[:, :, BALL]
    axis = np.cross([0.0, 0.0, 1.0], along)
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    bent[~pinned] = 0.7 * axis[~pinned]  # every tip turned down in swing
    still = np.zeros_like(bent)
    paths = FootPaths(moves=still, turns=still, toe_turns=bent, pinned=np.ones_like(pinned))
    paths = replace(paths, pinned=pinned)
    asked = moved_soles(WORK, paths)[..., TIP, 2][~pinned]
    assert asked.min() < -0.01
    # `spread` fills the swings itself; what it is given there is replaced where plants ask nothing.
    sunk = replace(WORK, soles=moved_soles(WORK, paths))
    out = spread(replace(paths, toe_turns=still.copy()), sunk, MOVED, SETTINGS)
    soles = moved_soles(sunk, out)
    assert soles[..., TIP, 2][~pinned].min() > -0.003 * WORK.scale - 1e-6
    assert not out.toe_turns[pinned].any()


def test_no_swing_is_deeper_than_it_was_or_three_millimetres():
    clip = inject(FLAT, "constant", 0.05)
    work = working_of(clip, RIG)
    plants = find(work, contacts_of(FLAT.phases), SETTINGS)
    paths = spread(poses(work, plants, SETTINGS), work, plants, SETTINGS)
    soles = moved_soles(work, paths)
    depth = (heights_under(soles, plants) - soles[..., 2]).max(axis=-1)
    assert depth[~paths.pinned].max() < 0.003


def test_ground_before_the_first_plant_is_no_higher_than_the_foot_that_may_be_elsewhere():
    first = tuple(p for p in PLANTS if p.start > 20)
    for deep, change, elsewhere in ((0.02, 0.0, True), (0.02, 0.02, False), (0.05, 0.02, True)):
        low = WORK.soles.copy()
        low[:20] -= [0.0, 0.0, deep]
        plants = tuple(replace(p, change=change) for p in first)
        heights = heights_under(low, plants, lowest=lowest_in_swing(low, plants, WORK.scale))
        under = (heights[:20] - low[:20, ..., 2]).max()
        assert (under < 1e-9) if elsewhere else (under > 0.01)


def test_a_foot_that_goes_far_below_both_its_plants_is_over_lower_ground():
    one, other = [p for p in PLANTS if p.foot == 0][:2]
    low = WORK.soles.copy()
    low[one.stop : other.start, 0] -= [0.0, 0.0, 0.2]
    lowest = lowest_in_swing(low, PLANTS, WORK.scale)
    under = heights_under(low, PLANTS, lowest) - low[..., 2]
    assert under[one.stop : other.start, 0].max() < 1e-9
    assert np.isinf(lowest[one.start : one.stop, 0]).all()


def test_ground_is_that_of_the_plant_and_the_lower_of_two_in_swing():
    stairs = true_walk(gait.walk(RIG), RIG, ground="stairs")
    work = working_of(stairs.clip, RIG)
    plants = find(work, contacts_of(stairs.phases), SETTINGS)
    heights = heights_under(work.soles, plants)[..., HEEL]
    mine = [p for p in plants if p.foot == 0]
    for before, after in itertools.pairwise(mine):
        assert np.allclose(heights[before.start : before.stop, 0], before.heel[2], atol=1e-6)
        assert np.allclose(heights[before.stop : after.start, 0], before.heel[2], atol=1e-6)
        assert after.heel[2] > before.heel[2] + 0.1
    none = heights_under(work.soles, tuple(p for p in plants if p.foot == 0))
    assert np.isneginf(none[:, 1]).all()


@pytest.mark.parametrize("ease", [0.0, 0.05, 0.3])
def test_the_ease_is_how_far_a_fade_reaches(ease):
    paths = paths_of({(100, 120): ((0.02, 0, 0), (0, 0, 0))})
    out = spread(paths, WORK, (), replace(SETTINGS, ease=ease)).moves[:, 0]
    reach = np.flatnonzero(out.any(axis=-1))
    frames = ease * FLAT.clip.fps
    assert 100 - max(frames, 1) <= reach[0] <= 100 - max(frames, 1) + 2
    assert 119 + max(frames, 1) - 2 <= reach[-1] <= 119 + max(frames, 1)
