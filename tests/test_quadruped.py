"""The quadruped: its model, its gaits, how its body leans, and where its paws come to stand."""

from __future__ import annotations

import sys

import mujoco
import numpy as np
import pytest

from footik_runtime import cli, gait_quadruped
from footik_runtime.builtin import (
    GAITS,
    QUADRUPED,
    builtin_body,
    builtin_motion,
    humanoid_rig,
    quadruped_rig,
)
from footik_runtime.character import CHARACTER_GROUP
from footik_runtime.errors import FootIKError
from footik_runtime.hock import folding_hock, middle_joint
from footik_runtime.measures import penetration as penetration_mean
from footik_runtime.measures import pinned_point_speed, slip_per_plant
from footik_runtime.phases import Phase, phase_curve
from footik_runtime.scene import Scene
from footik_runtime.score_suite import chosen_scenes
from footik_runtime.sole import BALL, HEEL, all_sole_points
from footik_runtime.walk import record_walk

LEGS = ("left_front", "right_front", "left_hind", "right_hind")
GAIT_NAMES = ("quadruped walk", "trot")


def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(QUADRUPED))


# --- the model ----------------------------------------------------------------------------------


def test_the_model_stands_on_its_soles_in_the_characters_group():
    quadruped = model()
    data = mujoco.MjData(quadruped)
    mujoco.mj_forward(quadruped, data)
    assert (quadruped.geom_group == CHARACTER_GROUP).all()
    for leg in LEGS:
        for part in ("sole", "toe_sole"):
            geom = quadruped.geom(f"{leg}_{part}").id
            under = data.geom_xpos[geom, 2] - quadruped.geom_size[geom, 2]
            assert under == pytest.approx(0.0, abs=1e-12)
    assert quadruped.body_subtreemass[1] == pytest.approx(31.4, abs=0.05)


def test_left_and_right_of_the_model_are_mirrored():
    quadruped = model()
    for body in range(1, quadruped.nbody):
        name = quadruped.body(body).name
        twin = quadruped.body(name.replace("left_", "right_")).id
        flip = [1.0, -1.0, 1.0]
        if twin != body:
            np.testing.assert_allclose(quadruped.body_pos[twin], quadruped.body_pos[body] * flip)
            assert quadruped.body_mass[twin] == pytest.approx(quadruped.body_mass[body])


def test_the_rig_has_four_paws_with_toes_and_hocks_behind_that_fold():
    rig = quadruped_rig()
    names = rig.skeleton.names
    assert tuple(leg.name for leg in rig.legs) == LEGS
    assert names[rig.hips] == "trunk"
    np.testing.assert_allclose(rig.forward, [1.0, 0.0, 0.0], atol=1e-9)
    for leg in rig.legs:
        assert names[leg.ankle] == f"{leg.name}_paw"
        assert names[leg.toe] == f"{leg.name}_toes"
        assert leg.sole.height == pytest.approx(0.036)
        middle = middle_joint(rig, leg)
        hind = leg.name.endswith("hind")
        assert names[middle] == f"{leg.name}_{'hock' if hind else 'pastern'}"
        assert folding_hock(rig, leg) == (middle if hind else -1)
    for leg in humanoid_rig().legs:
        assert middle_joint(humanoid_rig(), leg) == -1


# --- the gaits ----------------------------------------------------------------------------------


@pytest.mark.parametrize("fps", [30.0, 60.0])
@pytest.mark.parametrize(
    ("make", "speed"),
    [
        (gait_quadruped.quadruped_walk, 0.5),
        (gait_quadruped.quadruped_walk, 1.0),
        (gait_quadruped.quadruped_walk, 1.6),
        (gait_quadruped.trot, 1.5),
        (gait_quadruped.trot, 2.0),
        (gait_quadruped.trot, 3.0),
    ],
)
def test_what_carries_a_paw_stands_exactly_still_on_the_ground(make, speed, fps):
    rig = quadruped_rig()
    clip = make(rig, speed=speed, fps=fps)
    assert clip.loop
    went = clip.root_positions[-1] - clip.root_positions[0]
    np.testing.assert_allclose(went, [speed * clip.duration, 0.0, 0.0], atol=1e-9)
    points = all_sole_points(rig, *clip.model_pose())
    for i, leg in enumerate(rig.legs):
        phase = clip.curves[phase_curve(leg.name)]
        for point, phases in ((HEEL, (Phase.HEEL, Phase.FLAT)), (BALL, (Phase.BALL, Phase.FLAT))):
            held = np.isin(phase, phases)
            at = points[:, i, point]
            assert np.abs(at[held, 2]).max() < 1e-9
            both = held[1:] & held[:-1]
            assert np.linalg.norm(np.diff(at, axis=0), axis=1)[both].max() < 1e-9
        assert points[:, i, :2, 2].min() > -1e-9


def contacts(name: str) -> np.ndarray:
    """(T, 4) whether each paw is down, over one cycle."""
    clip = GAITS[name](quadruped_rig(), None)
    return np.stack([clip.curves[phase_curve(leg)][:-1] != Phase.SWING for leg in LEGS], axis=1)


def test_the_walk_is_a_lateral_sequence_with_two_or_more_paws_down():
    down = contacts("quadruped walk")
    strikes = [int(np.flatnonzero(d & ~np.roll(d, 1))[0]) for d in down.T]
    order = [LEGS[i] for i in np.argsort((np.array(strikes) - strikes[2]) % len(down))]
    assert order == ["left_hind", "left_front", "right_hind", "right_front"]
    assert down.sum(axis=1).min() >= 2


def test_the_trot_steps_in_diagonal_pairs_with_two_flights():
    down = contacts("trot")
    np.testing.assert_array_equal(down[:, 0], down[:, 3])
    np.testing.assert_array_equal(down[:, 1], down[:, 2])
    assert not (down[:, 0] & down[:, 1]).any()
    assert (down.sum(axis=1) == 0).any()


@pytest.mark.parametrize("name", GAIT_NAMES)
def test_builtin_motions_come_with_the_quadrupeds_body(name):
    motion = builtin_motion(name)
    assert builtin_body(name) == QUADRUPED
    assert builtin_body("walk") != QUADRUPED
    assert motion.seam < 1e-9
    assert motion.speed == pytest.approx({"quadruped walk": 1.0, "trot": 2.0}[name])


def test_speeds_and_rigs_that_have_no_such_gait_are_errors():
    with pytest.raises(FootIKError, match=r"walking speed must be 0\.3.* to 1\.8.* m/s"):
        gait_quadruped.quadruped_walk(quadruped_rig(), speed=4.0)
    with pytest.raises(FootIKError, match="trotting speed"):
        gait_quadruped.trot(quadruped_rig(), speed=float("nan"))
    with pytest.raises(FootIKError, match="needs a rig with four legs, this one has 2"):
        gait_quadruped.trot(humanoid_rig())


# --- on the ground ------------------------------------------------------------------------------


@pytest.mark.parametrize("gait", GAIT_NAMES)
@pytest.mark.parametrize(
    ("ground", "pinned", "penetration"),
    [
        ("flat", 2.0, 0.01),
        ("slope 15 up", 2.0, 0.01),
        ("slope 15 down", 2.0, 0.01),
        ("stairs 12 cm up", 15.0, 1.0),
        ("stairs 12 cm down", 3.0, 3.0),
        ("rubble", 9.0, 0.6),
    ],
)
def test_paws_stay_where_they_stand_and_out_of_the_ground(gait, ground, pinned, penetration):
    (scene,) = chosen_scenes([f"{gait}, {ground}"])
    assert scene.body == QUADRUPED
    built = Scene.build(scene.motion(), scene.terrain(), body=scene.body)
    run = record_walk(built, seconds=6.0).run
    assert pinned_point_speed(run) < pinned
    assert slip_per_plant(run).largest < 0.1
    assert penetration_mean(run) < penetration
    assert run.locked is not None
    held = run.locked[run.phase != Phase.SWING]
    assert held.mean() > 0.75


def test_the_command_line_trots(capsys, monkeypatch):
    command = ["footik", "walk", "--gait", "trot", "--terrain", "slope", "--seconds", "2"]
    monkeypatch.setattr(sys, "argv", command)
    cli.main()
    assert "trot at 2.00 m/s over slope" in capsys.readouterr().out
