"""Crowd: what it takes, what it refuses, and whose groups its ground sees."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from footik_runtime.builtin import builtin_motion
from footik_runtime.crowd import Crowd, stays_in_place
from footik_runtime.errors import FootIKError
from footik_runtime.ground import RecordedGround, SceneGround
from footik_runtime.settings import FootIKSettings

NAN, INF = float("nan"), float("inf")
NOWHERE = RecordedGround([])
CROWD: Any = Crowd  # for arguments that no type checker lets through

TWO_FLOORS = """
<mujoco><worldbody>
  <geom type="plane" size="0 0 1" group="0"/>
  <geom type="plane" size="0 0 1" pos="0 0 .2" group="2"/>
</worldbody></mujoco>
"""


def two_floors(**how) -> SceneGround:
    model = mujoco.MjModel.from_xml_string(TWO_FLOORS)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return SceneGround(model, data, **how)


@pytest.mark.parametrize(
    ("velocity", "turn_rate", "words"),
    [
        ([[0.0, 0.0], [0.0, NAN], [0.0, 0.0]], 0.0, r"velocity must be finite.* for character 1"),
        ([INF, 0.0], 0.0, r"velocity must be finite.* for every character"),
        ([1.0, 0.0], [0.0, 0.0, -INF], r"turn_rate must be finite.* for character 2"),
        ([1.0, 0.0], NAN, r"turn_rate must be finite"),
        (
            [1.0, 0.0, 0.0],
            0.0,
            r"velocity must be shape \(2,\), or shape \(3, 2\).*not shape \(3,\)",
        ),
        (np.zeros((2, 2)), 0.0, r"velocity must be .* not shape \(2, 2\)"),
        ([1.0, 0.0], [0.0, 0.0], r"turn_rate must be one number, or shape \(3,\)"),
        ("on", 0.0, r"velocity must be numbers, not 'on'"),
    ],
)
def test_a_command_that_is_none_is_an_error_and_changes_nothing(walk, velocity, turn_rate, words):
    crowd = Crowd(walk, NOWHERE, 3)
    before = crowd.bodies.tobytes()
    with pytest.raises(FootIKError, match=words):
        crowd.command(velocity, turn_rate)
    assert crowd.bodies.tobytes() == before


@pytest.mark.parametrize(
    ("at", "yaw", "words"),
    [
        ([[0, 0, 0], [0, 0, 0], [0, NAN, 0]], 0.0, r"at must be finite.* for character 2"),
        (np.zeros((3, 2)), 0.0, r"at must be shape \(3,\), or .*not shape \(3, 2\)"),
        (np.zeros(3), [0.0, INF, 0.0], r"yaw must be finite.* for character 1"),
        (np.zeros(3), np.zeros(2), r"yaw must be one number, or shape \(3,\)"),
    ],
)
def test_a_place_that_is_none_is_an_error_and_changes_nothing(walk, at, yaw, words):
    crowd = Crowd(walk, NOWHERE, 3)
    before = crowd.bodies.tobytes()
    with pytest.raises(FootIKError, match=words):
        crowd.place(at, yaw)
    assert crowd.bodies.tobytes() == before


def test_one_place_and_one_command_are_everyones(walk):
    crowd = Crowd(walk, NOWHERE, 3)
    crowd.place([1, 2, 3], 0.5)
    crowd.command([1, 0], [0.1, 0.2, 0.3])
    assert (crowd.bodies["root"] == [1.0, 2.0, 3.0]).all()
    assert (crowd.bodies["yaw"] == 0.5).all()
    assert (crowd.bodies["velocity"] == [1.0, 0.0]).all()
    assert crowd.bodies["turn_rate"].tolist() == [0.1, 0.2, 0.3]


@pytest.mark.parametrize("groups", [(0,), (2,), (0, 2)])
def test_the_settings_say_which_groups_a_crowd_sees(idle, groups):
    ground = two_floors()
    crowd = Crowd(idle, ground, settings=FootIKSettings(groups=groups))
    crowd.place(np.zeros((1, 3)))
    for _ in range(60):
        crowd.step(1.0 / 60.0)
    assert crowd.bodies["ground"][0] == pytest.approx(0.2 if 2 in groups else 0.0, abs=1e-3)
    assert ground.groups == (0,)


def test_a_ground_of_other_groups_than_the_settings_is_refused(idle):
    with pytest.raises(FootIKError, match=r"made for the geom groups 0, 2, but the settings .* 0:"):
        Crowd(idle, two_floors(groups=(0, 2)))
    ground = two_floors(groups=(2, 0))
    crowd = Crowd(idle, ground, settings=FootIKSettings(groups=(0, 2)))
    assert crowd.ground is ground


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda motion: CROWD(motion, NOWHERE, 2.5), "at least one character"),
        (lambda motion: CROWD(motion, NOWHERE, threads="2"), "at least one thread"),
        (lambda motion: CROWD(motion, None), "a ground that casts rays, not None"),
        (lambda _: CROWD(None, NOWHERE), "a Motion, not None"),
        (lambda motion: CROWD(motion, NOWHERE, settings="openkcc"), "a FootIKSettings"),
    ],
)
def test_what_is_no_crowd_is_an_error(walk, make, words):
    with pytest.raises(FootIKError, match=words):
        make(walk)


@pytest.mark.parametrize("dt", ["soon", None, [0.1], NAN, -0.1])
def test_what_is_no_time_is_an_error(walk, dt):
    with pytest.raises(FootIKError, match="dt must be 0 or more and finite"):
        Crowd(walk, NOWHERE).step(dt)


def test_whether_a_motion_stays_in_place_depends_on_its_size(idle, walk):
    assert stays_in_place(idle)
    assert not stays_in_place(walk)
    drift = replace(walk, velocity=np.array([0.04, 0.0]))
    assert stays_in_place(drift)
    skeleton = walk.rig.skeleton
    small = replace(walk.rig, skeleton=replace(skeleton, offsets=0.1 * skeleton.offsets))
    assert not stays_in_place(replace(drift, rig=small))


def test_a_motion_that_turns_in_place_is_played_as_fast_as_it_is_told_to_turn():
    turn = builtin_motion("turn")
    crowd = Crowd(turn, NOWHERE)
    for told, rate in ((1.5, 1.5), (-1.5, 1.5), (0.0, 0.5), (9.0, 2.0)):
        crowd.command([0.0, 0.0], told * turn.yaw_rate)
        assert crowd.bodies["rate"][0] == pytest.approx(rate)
