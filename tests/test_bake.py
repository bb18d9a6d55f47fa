"""Baked curves tell the contact they were made from, by few keys, and end where they begin."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footik_runtime.builtin import builtin_motion
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.offline.bake import (
    BAKE_NOTES,
    BakeSettings,
    bake,
    bake_openkcc,
    curve_names,
    curves,
    weight_keys,
)
from footik_runtime.offline.contacts import with_contacts
from footik_runtime.offline.curve_keys import CURVE_KEYS, Keys, keys_of, sample, thinned
from footik_runtime.offline.stages import Contacts
from footik_runtime.phases import Phase, heel_curve, phase_curve, toe_curve, weight_curve
from footik_runtime.rig import Rig

FPS = 60.0
masks = st.lists(st.integers(1, 20), min_size=1, max_size=12).map(
    lambda runs: np.repeat(np.arange(len(runs)) % 2 == 1, runs)
)
masks = st.builds(lambda mask, flip: mask ^ flip, masks, st.booleans())


@pytest.fixture(scope="module")
def rig() -> Rig:
    return builtin_motion("idle").rig


def at_frames(keys, frames):
    return sample(keys, np.arange(frames) / FPS)


def contacts_of(down):
    return Contacts(
        fps=FPS, down=down, confidence=down * 1.0, ground=np.zeros(down.shape), belt=np.zeros(3)
    )


def still(rig, frames, loop=False, curves=None):
    return Clip(
        skeleton=rig.skeleton,
        fps=FPS,
        root_positions=np.tile(rig.skeleton.offsets[0], (frames, 1)),
        rotations=np.tile(rig.skeleton.rest_rotations, (frames, 1, 1)),
        loop=loop,
        curves=curves or {},
    )


def rolling(rig, frames=60):
    """Each leg strikes heel first and leaves by the ball, half a cycle apart."""
    down = np.zeros((frames, len(rig.legs), 2), dtype=bool)
    for i in range(len(rig.legs)):
        first = 8 + 25 * i
        down[first : first + 14, i, 0] = True
        down[first + 5 : first + 21, i, 1] = True
    return contacts_of(down)


@given(masks, st.sampled_from([0.0, 0.04, 0.1, 0.5]), st.sampled_from([0.0, 0.1, 0.3]))
def test_half_a_weight_and_more_is_contact_again(mask, ease_in, ease_out):
    settings = BakeSettings(ease_in=ease_in, ease_out=ease_out)
    values = at_frames(weight_keys(mask, FPS, settings), len(mask))
    assert np.array_equal(values >= 0.5, mask)
    assert np.abs(values - 0.5).min() > 0.01 / max(1.0, FPS * max(ease_in, ease_out))
    assert 0.0 <= values.min() <= values.max() <= 1.0


@given(masks, st.sampled_from([0.0, 0.1, 0.5]))
def test_a_loops_weight_is_its_contact_and_has_no_seam(mask, ease):
    mask = np.concatenate([mask, mask[:1]])
    keys = weight_keys(mask, FPS, BakeSettings(ease_in=ease, ease_out=ease), loop=True)
    values = at_frames(keys, len(mask))
    assert np.array_equal(values >= 0.5, mask)
    assert values[0] == values[-1]
    end, near = (len(mask) - 1) / FPS, 1e-6
    before, after = np.diff(sample(keys, np.array([end - near, end, 0.0, near])))[[0, 2]] / near
    assert before == pytest.approx(after, abs=0.05)


@given(masks)
def test_there_are_at_most_four_keys_a_contact_and_two(mask):
    contacts = np.count_nonzero(np.diff(mask.astype(int), prepend=0) == 1)
    assert len(weight_keys(mask, FPS, BakeSettings())) <= max(4 * contacts, 1)
    looped = np.concatenate([mask, mask[:1]])
    assert len(weight_keys(looped, FPS, BakeSettings(), loop=True)) <= 4 * contacts + 2


@given(masks, st.sampled_from([0.04, 0.1, 0.5]), st.sampled_from([0.1, 0.3]), st.booleans())
def test_a_weight_is_a_smoothstep_in_its_ramps_and_exactly_0_or_1_outside(
    mask, ease_in, ease_out, loop
):
    if loop:
        mask = np.concatenate([mask, mask[:1]])
    settings = BakeSettings(ease_in=ease_in, ease_out=ease_out)
    keys = weight_keys(mask, FPS, settings, loop=loop)
    times = np.linspace(0.0, (len(mask) - 1) / FPS, 40 * len(mask))
    values = sample(keys, times)
    changes = np.flatnonzero(mask[1:] != mask[:-1]) + 1
    events = (changes - 0.5) / FPS
    if loop and len(changes):  # the neighbouring cycles' too
        cycle = (len(mask) - 1) / FPS
        events, changes = (
            np.concatenate([events - cycle, events, events + cycle]),
            np.concatenate([changes, changes, changes]),
        )
    expected = np.where(mask[0], 1.0, 0.0) * np.ones(len(times))
    if len(events):
        k = np.clip(np.searchsorted(events, times) - 1, 0, len(events) - 1)
        after = mask[changes[k]]
        expected = np.where(times < events[0], ~after, after).astype(float)
    near = np.full(len(times), np.inf)
    half = 0.5 * max(ease_in, ease_out, 1.0 / FPS)
    for event in events:
        near = np.minimum(near, np.abs(times - event))
    outside = near > half + 1e-9
    np.testing.assert_array_equal(values[outside], expected[outside])
    assert np.all((values >= 0.0) & (values <= 1.0))
    for change, event in zip(changes, events, strict=True):
        rises = bool(mask[change])
        ramp = 0.5 * (ease_in if rises else ease_out)
        apart = np.abs(np.delete(events, np.flatnonzero(events == event)) - event).min(initial=9.0)
        if apart < 2.0 * half or ramp < 0.5 / FPS:
            continue  # shortened
        own = (np.abs(times - event) < ramp) & (min(event, times[-1] - event) > ramp)
        u = (times[own] - event + ramp) / (2.0 * ramp)
        shape = u * u * (3.0 - 2.0 * u)
        np.testing.assert_allclose(values[own], shape if rises else 1.0 - shape, atol=1e-9)


def test_ramps_are_as_long_as_asked_and_cross_the_half_at_the_event():
    mask = np.arange(120) >= 60
    keys = weight_keys(mask, FPS, BakeSettings(ease_in=0.3))
    event = 59.5 / FPS
    np.testing.assert_allclose(keys.times, [event - 0.15, event + 0.15])
    assert sample(keys, np.array([event]))[0] == pytest.approx(0.5)
    keys = weight_keys(~mask, FPS, BakeSettings(ease_in=0.3, ease_out=0.1))
    np.testing.assert_allclose(keys.times, [event - 0.05, event + 0.05])


def test_ramps_share_a_short_swing_and_still_reach_zero():
    mask = np.ones(60, dtype=bool)
    mask[30:34] = False
    keys = weight_keys(mask, FPS, BakeSettings(ease_in=0.5, ease_out=0.5))
    assert len(keys) == 3
    assert keys.values.tolist() == [1.0, 0.0, 1.0]
    assert sample(keys, np.array([31.5 / FPS]))[0] == pytest.approx(0.0, abs=1e-12)


@given(
    st.lists(st.tuples(st.floats(-2, 2), st.floats(-5, 5)), min_size=1, max_size=8),
    st.integers(-2, 3) | st.floats(-0.5, 3.0),
    st.integers(4, 10) | st.floats(3.5, 10.0),
    st.sampled_from(["smooth", "linear", "step"]),
)
def test_a_part_of_a_curve_is_the_same_curve(knots, start, stop, interpolation):
    values, slopes = np.round(np.array(knots).T)  # so that some are alike
    keys = Keys(
        times=np.arange(len(knots), dtype=np.float64),
        values=values,
        slopes=slopes,
        interpolation=interpolation,
    )
    part = keys.part(start, stop)
    times = np.linspace(start, stop, 67)[:-1]
    np.testing.assert_allclose(sample(part, times - start), sample(keys, times), atol=1e-9)


def test_sampling_is_the_same_in_any_order():
    keys = Keys(times=np.array([0.0, 1.0, 2.0]), values=np.array([0.0, 1.0, -1.0]))
    times = np.array([1.7, -1.0, 0.3, 5.0, 1.0, 0.0])
    one_by_one = [sample(keys, np.array([t]))[0] for t in times]
    assert sample(keys, times).tolist() == one_by_one
    assert one_by_one[1] == 0.0
    assert one_by_one[3] == -1.0


@given(st.lists(st.floats(-1, 1), min_size=1, max_size=60), st.sampled_from([0.0, 0.01, 0.3]))
def test_thinned_keys_stay_within_the_tolerance(values, tolerance):
    values = np.array(values)
    keys = thinned(values, FPS, tolerance)
    assert np.abs(at_frames(keys, len(values)) - values).max() <= tolerance + 1e-9


@given(st.lists(st.floats(-1, 1), min_size=2, max_size=60), st.sampled_from([0.001, 0.01, 0.3]))
def test_thinned_keys_stay_within_the_tolerance_between_the_frames_too(values, tolerance):
    values = np.array(values) + 0.5  # no whole numbers: those become steps
    keys = thinned(values, FPS, tolerance)
    times = np.linspace(0.0, (len(values) - 1) / FPS, 7 * len(values))
    lines = np.interp(times, np.arange(len(values)) / FPS, values)
    if keys.interpolation == "linear":
        assert np.abs(sample(keys, times) - lines).max() <= tolerance + 1e-9


def test_thinning_a_smooth_curve_leaves_few_keys():
    weight = at_frames(weight_keys(np.arange(600) % 60 < 30, FPS, BakeSettings()), 600)
    keys = thinned(weight, FPS, 0.005)
    assert len(keys) <= 8 * 20  # a ramp of a smoothstep in lines, 20 ramps
    assert len(thinned(weight, FPS, 0.05)) < 0.6 * len(keys)


def test_thinning_leaves_a_line_two_keys_and_a_phase_its_changes():
    assert len(thinned(np.linspace(0.0, 0.7, 100), FPS, 0.001)) == 2
    stepped = thinned(np.repeat([0.0, 1.0, 2.0, 3.0], 10), FPS, 0.001)
    assert (stepped.interpolation, len(stepped)) == ("step", 4)


def test_a_baked_clip_has_the_curves_of_every_leg(rig):
    contacts = rolling(rig)
    clip = bake(still(rig, 60), contacts, rig)
    phases = contacts.phases()
    for i, leg in enumerate(rig.legs):
        down = contacts.down[:, i]
        for curve, mask in (
            (weight_curve, down.any(axis=-1)),
            (heel_curve, down[:, 0]),
            (toe_curve, down[:, 1]),
        ):
            assert np.array_equal(clip.curves[curve(leg.name)] >= 0.5, mask)
        assert np.array_equal(clip.curves[phase_curve(leg.name)], phases[:, i])
    assert set(clip.curves) == set(clip.extras[CURVE_KEYS])
    assert set(clip.curves) == set(curve_names(rig, BakeSettings()))
    assert clip.curves["LeftHeelIKWeight"].max() == clip.curves["LeftToeIKWeight"].max() == 1.0
    assert {Phase.HEEL, Phase.FLAT, Phase.BALL, Phase.SWING} == set(phases[:, 0])


def test_the_built_in_walk_takes_at_most_four_keys_a_contact():
    motion = builtin_motion("walk")
    clip, _ = with_contacts(motion.clip, motion.rig)
    down = np.stack([clip.curves[phase_curve(leg.name)] for leg in motion.rig.legs], axis=-1) > 0.0
    keys = curves(contacts_of(np.stack([down, down], axis=-1)), motion.rig, loop=clip.loop)
    for i, leg in enumerate(motion.rig.legs):
        contacts = np.count_nonzero(np.diff(down[:, i].astype(int), prepend=0) == 1)
        assert len(keys[weight_curve(leg.name)]) <= 4 * contacts + 2


def test_what_the_runtime_reads_back_is_what_was_baked(rig):
    contacts = rolling(rig)
    baked = bake(still(rig, 60), contacts, rig)
    read, _ = with_contacts(baked, rig)
    told = np.stack([read.curves[phase_curve(leg.name)] for leg in rig.legs], axis=-1)
    assert np.array_equal(told, contacts.phases())
    assert read.curves[weight_curve("left")] is baked.curves[weight_curve("left")]


def test_curves_that_are_there_stay_unless_they_are_to_be_replaced(rig):
    drawn = np.linspace(0.0, 1.0, 60)
    clip = still(rig, 60, curves={"LeftFootIKWeight": drawn, "smile": drawn})
    kept = bake(clip, rolling(rig), rig)
    assert kept.curves["LeftFootIKWeight"] is drawn
    assert "LeftFootIKWeight" not in kept.extras[CURVE_KEYS]
    assert len(kept.extras[BAKE_NOTES]) == 1
    assert "'LeftFootIKWeight'" in kept.extras[BAKE_NOTES][0]
    assert np.array_equal(kept.curves["smile"], drawn)
    replaced = bake(clip, rolling(rig), rig, BakeSettings(replace=True))
    assert not np.array_equal(replaced.curves["LeftFootIKWeight"], drawn)
    assert replaced.extras[BAKE_NOTES] == ()


def test_keys_that_no_longer_fit_the_clip_are_not_used(rig):
    clip = bake(still(rig, 60), rolling(rig), rig)
    name = weight_curve("left")
    assert keys_of(clip, name) is clip.extras[CURVE_KEYS][name]
    part = clip.cut(10, 50)
    keys = keys_of(part, name)
    assert np.abs(sample(keys, part.times) - part.curves[name]).max() <= 0.005 + 1e-12
    with pytest.raises(FootIKError, match="Did you mean 'LeftFootIKWeight'"):
        keys_of(clip, "LeftFootIKWeigth")


def test_a_foot_that_always_or_never_stands_has_one_key(rig):
    down = np.zeros((30, len(rig.legs), 2), dtype=bool)
    down[:, 0] = True
    made = curves(contacts_of(down), rig)
    assert {len(keys) for keys in made.values()} == {1}
    assert made[weight_curve("left")].values[0] == 1.0
    assert made[weight_curve("right")].values[0] == 0.0


def test_a_loops_last_frame_has_the_curves_of_its_first(rig):
    contacts = rolling(rig)
    down = contacts.down.copy()
    down[-1] = ~down[0]
    clip = bake(still(rig, 60, loop=True), replace(contacts, down=down), rig)
    for name, values in clip.curves.items():
        assert values[-1] == pytest.approx(values[0], abs=1e-12), name


@pytest.mark.parametrize("frames", [1, 2, 3])
@pytest.mark.parametrize("loop", [False, True])
def test_the_shortest_clips_bake(rig, frames, loop):
    for pattern in range(2**frames):
        down = np.zeros((frames, len(rig.legs), 2), dtype=bool)
        down[:, 0, 0] = [pattern >> k & 1 for k in range(frames)]
        if loop:
            down[-1] = down[0]
        clip = bake(still(rig, frames, loop), contacts_of(down), rig)
        assert np.array_equal(clip.curves[weight_curve("left")] >= 0.5, down[:, 0, 0])


def test_contacts_of_another_clip_are_refused(rig):
    with pytest.raises(FootIKError, match="are not of this clip"):
        bake(still(rig, 59), rolling(rig), rig)
    with pytest.raises(FootIKError, match="are not of this clip"):
        bake(replace(still(rig, 60), fps=30.0), rolling(rig), rig)
    with pytest.raises(FootIKError, match="needs the contacts"):
        bake(still(rig, 60), None, rig)


def test_the_preset_openkcc_makes_its_two_curves_alone(rig):
    frames = 101
    clip = still(rig, frames)
    lift = np.where(np.arange(frames) < 50, 0.0, 0.5)
    clip = replace(clip, root_positions=clip.root_positions + lift[:, None] * [0, 0, 1])
    ankle = clip.model_pose()[0][:, rig.legs[0].ankle, 2]
    settings = BakeSettings(preset="openkcc", grounded_height=float(ankle[0]) + 0.01)
    baked = bake(clip, None, rig, settings)
    assert set(baked.curves) == {weight_curve(leg.name) for leg in rig.legs}
    assert set(baked.curves) == set(curve_names(rig, settings))
    keys = baked.extras[CURVE_KEYS]["LeftFootIKWeight"]
    plain = bake_openkcc(
        (clip.times, ankle), length_s=clip.duration, foot_grounded_height=float(ankle[0]) + 0.01
    )
    np.testing.assert_array_equal(keys.times, plain[:, 0] * clip.duration)
    np.testing.assert_array_equal(keys.values, plain[:, 1])
    with pytest.raises(FootIKError, match="length must be positive"):
        bake(still(rig, 1), None, rig, settings)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"times": np.array([0.0, 0.0])}, "must increase"),
        ({"values": np.array([0.0])}, "as many values as times"),
        ({"values": np.array([0.0, np.nan])}, "not finite at key 1"),
        ({"interpolation": "smoth"}, "Did you mean 'smooth'"),
        ({"times": np.zeros(0), "values": np.zeros(0)}, "at least one"),
    ],
)
def test_what_is_no_curve_is_refused(changes, message):
    with pytest.raises(FootIKError, match=message):
        Keys(**{"times": np.array([0.0, 1.0]), "values": np.array([0.0, 1.0]), **changes})
