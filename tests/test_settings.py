"""Settings: presets, ranges, names, and how they scale."""

from __future__ import annotations

import math
from dataclasses import fields

import pytest

from footik_runtime.errors import FootIKError
from footik_runtime.settings import SETTINGS, FootIKSettings


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
