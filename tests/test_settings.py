"""Settings: presets, ranges, names, and how they scale."""

from __future__ import annotations

import math
import re
from dataclasses import FrozenInstanceError, fields

import numpy as np
import pytest

from footik_runtime.errors import FootIKError
from footik_runtime.settings import (
    RANGES,
    SETTINGS,
    STANDARD_LEG,
    FootIKSettings,
)


def test_every_number_reaches_compiled_code():
    names = {f.name.removesuffix("_deg") for f in fields(FootIKSettings)}
    left_out = {"behaviour", "groups"}
    assert set(SETTINGS.names or ()) - {"size"} == names - left_out


def test_lengths_scale_with_the_leg_and_times_do_not():
    settings = FootIKSettings()
    child, giant = settings.record(0.425), settings.record(1.7)
    assert giant["step_height"] == pytest.approx(4 * child["step_height"])
    assert giant["max_hip_drop"] == pytest.approx(4 * child["max_hip_drop"])
    assert giant["place_time"] == child["place_time"] == settings.place_time
    assert giant["reach"] == child["reach"]


def test_degrees_become_radians():
    assert FootIKSettings(stride_angle_deg=90.0).record(1.0)["stride_angle"] == math.pi / 2


def test_openkcc_lengths_stay_as_they_are():
    assert FootIKSettings.openkcc().record(2.0)["step_height"] == 0.1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"reach": 1.2}, r"reach must be in \[0.5, 1\], not 1.2"),
        ({"stride_time": -1.0}, r"stride_time must be in \[0, 5\], not -1.0"),
        ({"hip_half_life": math.nan}, "hip_half_life"),
        ({"place_time": "soon"}, "place_time"),
        ({"weight_on": 0.4}, r"weight_off \(0.45\) must be less than weight_on \(0.4\)"),
        ({"weight_on": 0.45}, "must be less"),
        ({"groups": (0, 9)}, "geom groups 0 to 5, not 9"),
        ({"behaviour": "opencc"}, "Did you mean 'openkcc'"),
    ],
)
def test_impossible_setting_is_refused(change, words):
    with pytest.raises(FootIKError, match=words):
        FootIKSettings(**change)


def test_unknown_setting_and_preset_suggest_the_nearest():
    with pytest.raises(FootIKError, match="Did you mean 'reach'"):
        FootIKSettings().changed(reech=0.9)
    with pytest.raises(FootIKError, match="Did you mean 'default'"):
        FootIKSettings.preset("defalt")


def test_changed_leaves_the_original_alone():
    settings = FootIKSettings()
    assert settings.changed(reach=0.9).reach == 0.9
    assert settings.reach == FootIKSettings().reach


def test_presets_are_what_they_say():
    assert FootIKSettings.preset("default") == FootIKSettings()
    assert FootIKSettings.preset("openkcc").behaviour == "openkcc"


@pytest.mark.parametrize("name", [n for n in RANGES if not n.startswith("weight")])
def test_every_setting_takes_its_ends_and_nothing_beyond(name):
    for end, beyond in zip(RANGES[name], (-1e-3, 1e-3), strict=True):
        assert getattr(FootIKSettings().changed(**{name: end}), name) == end
        with pytest.raises(FootIKError, match=f"setting {name} must be in"):
            FootIKSettings().changed(**{name: end + beyond})
    for nonsense in (math.nan, math.inf, None, "1", [1.0]):
        with pytest.raises(FootIKError, match=f"setting {name} must be in"):
            FootIKSettings().changed(**{name: nonsense})


def test_every_default_lies_within_its_range():
    for settings in (FootIKSettings(), FootIKSettings.openkcc()):
        for name, (low, high) in RANGES.items():
            assert low <= getattr(settings, name) <= high


def test_numpy_numbers_are_numbers():
    settings = FootIKSettings().changed(place_time=np.float32(0.25), stride_time=np.int64(1))
    assert settings.record(0.85)["place_time"] == 0.25
    assert settings.record(0.85)["stride_time"] == 1.0


def test_equal_weights_are_openkccs_alone():
    assert FootIKSettings.openkcc().weight_on == FootIKSettings.openkcc().weight_off == 0.5
    with pytest.raises(FootIKError, match="placed and released every frame"):
        FootIKSettings(weight_on=0.5, weight_off=0.5)


def test_every_length_scales_and_nothing_else_does():
    settings = FootIKSettings()
    small, large = settings.record(STANDARD_LEG), settings.record(3.0 * STANDARD_LEG)
    scaled = {n for n in SETTINGS.names or () if n != "size" and small[n] and large[n] != small[n]}
    metres = re.findall(r"^ +(\w+): (?:openkcc only: )?m\b", FootIKSettings.__doc__ or "", re.M)
    assert len(metres) > 8
    assert scaled == set(metres)
    for name in scaled:
        assert small[name] == getattr(settings, name)
        assert large[name] == pytest.approx(3.0 * small[name])
    assert (small["size"], large["size"]) == (1.0, pytest.approx(3.0))


def test_every_angle_is_named_in_degrees_and_kept_in_radians():
    settings, record = FootIKSettings(), FootIKSettings().record(2.0)
    angles = [n for n in RANGES if n.endswith("_deg")]
    assert len(angles) >= 4
    for name in angles:
        assert record[name.removesuffix("_deg")] == math.radians(getattr(settings, name))


def test_settings_cannot_be_changed_in_place():
    with pytest.raises(FrozenInstanceError):
        FootIKSettings().reach = 0.9  # pyright: ignore[reportAttributeAccessIssue]


def test_changed_settings_are_checked_as_new_ones_are():
    with pytest.raises(FootIKError, match="clearance must be in"):
        FootIKSettings().changed(clearance=-0.1)


@pytest.mark.parametrize("groups", [5, (), (1.0,), (True,), "01", None, (0, -1), {0}])
def test_groups_that_are_none_are_refused(groups):
    with pytest.raises(FootIKError, match="one or more geom groups 0 to 5, not"):
        FootIKSettings(groups=groups)


def test_groups_are_kept_as_a_tuple_of_ints():
    groups = FootIKSettings(groups=[np.int32(1), 0]).groups  # pyright: ignore[reportArgumentType]
    assert groups == (1, 0)
    assert all(type(group) is int for group in groups)


@pytest.mark.parametrize("leg", [0.0, -0.85, math.nan, math.inf, "long"])
def test_a_leg_that_is_none_is_refused(leg):
    with pytest.raises(FootIKError, match="a leg must be longer than 0 m"):
        FootIKSettings().record(leg)


@pytest.mark.parametrize("change", [{"correct_overlap": "no"}, {"reach": True}])
def test_what_is_neither_number_nor_switch_is_refused(change):
    with pytest.raises(FootIKError, match=next(iter(change))):
        FootIKSettings(**change)


def test_a_preset_that_is_no_name_is_refused():
    with pytest.raises(FootIKError, match="unknown preset"):
        FootIKSettings.preset([])  # pyright: ignore[reportArgumentType]
