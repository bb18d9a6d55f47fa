"""The placement suite: its scenes, its figures, and what it says of them."""

from __future__ import annotations

import json
import sys
from dataclasses import fields

import mujoco
import numpy as np
import pytest

from footik_runtime import cli
from footik_runtime.builtin import HUMANOID, builtin_motion
from footik_runtime.errors import FootIKError
from footik_runtime.scene import Scene
from footik_runtime.score_scenes import Limits, score_scenes
from footik_runtime.score_suite import (
    COLUMNS,
    MODES,
    OPENKCC,
    OURS,
    WITHOUT,
    SceneScore,
    chosen_scenes,
    score_scene,
    suite_json,
    suite_summary,
    suite_table,
)
from footik_runtime.terrain import Belt, Flat, SideSlope, Terrain
from footik_runtime.walk import record_walk


def made(name="made", limits=None, by_rate=None, **ours) -> SceneScore:
    """A score with figures of 1, but for some of ours; OpenKCC has 2 of everything."""
    figures = {mode: dict.fromkeys(COLUMNS, 1.0) for mode in MODES}
    figures[OPENKCC] = dict.fromkeys(COLUMNS, 2.0)
    figures[OURS] |= ours
    limits = limits or Limits(**{f.name: 1.5 for f in fields(Limits)})
    return SceneScore(name=name, limits=limits, figures=figures, by_rate=by_rate or {})


def test_scenes_have_names_of_their_own_and_terrain_that_compiles():
    scenes = score_scenes()
    assert len({scene.name for scene in scenes}) == len(scenes) >= 40
    for scene in scenes:
        spec = mujoco.MjSpec()
        scene.terrain().add_to(spec)
        assert spec.compile().ngeom > 0
        assert scene.complaint
    assert {f.name for f in fields(Limits)} == set(COLUMNS)


def test_scenes_are_chosen_by_the_beginnings_of_their_names():
    assert {s.name for s in chosen_scenes(["stairs 12"])} == {
        "stairs 12 cm up",
        "stairs 12 cm down",
    }
    assert len(chosen_scenes([])) == len(score_scenes())
    with pytest.raises(FootIKError, match=r"unknown scene 'platfrom'\. Did you mean 'platform'"):
        chosen_scenes(["platfrom"])


def test_ours_beats_no_ik_and_openkcc_on_a_slope():
    (scene,) = chosen_scenes(["slope 10 down"])
    found = score_scene(scene, rates=(60.0, 30.0))
    none, theirs, ours = (found.figures[mode] for mode in (WITHOUT, OPENKCC, OURS))
    for key in ("penetration", "penetration_contact_p99", "float"):
        assert ours[key] <= 0.2 * theirs[key]
        assert ours[key] <= 0.2 * none[key]
    assert ours["pinned_point_speed"] < 0.2 * theirs["pinned_point_speed"]
    assert found.missed() == []
    assert set(found.by_rate) == {60.0, 30.0}
    assert found.by_rate[60.0] == ours
    assert found.by_rate[30.0] != ours


def test_a_missed_limit_is_marked_and_named():
    found = made(pop=1.6)
    assert found.missed() == ["pop"]
    lines = suite_table([found, made("kept")]).splitlines()
    assert [line.count("!") for line in lines] == [0, 0, 0, 1, 0, 0, 0]
    assert suite_summary([found, made("kept")]).startswith("1 of 2 scenes within every limit")
    assert suite_json([found])[0]["missed"] == ["pop"]


def test_what_openkcc_does_better_is_said():
    assert made().worse_than_openkcc() == []
    found = made(float=2.5)
    assert found.worse_than_openkcc() == ["float"]
    assert "  made: float" in suite_summary([found]).splitlines()


def test_rates_that_differ_are_said_but_not_for_figures_near_zero():
    even = dict.fromkeys(COLUMNS, 10.0)
    assert made(by_rate={30.0: even, 60.0: even}).uneven() == []
    found = made(by_rate={30.0: even, 60.0: even | {"pop": 13.0}})
    assert found.uneven() == ["pop"]
    assert "  made: pop" in suite_summary([found]).splitlines()
    small = dict.fromkeys(COLUMNS, 0.0)
    assert made(by_rate={30.0: small, 60.0: small | {"penetration": 0.05}}).uneven() == []


def test_a_drive_steers_and_a_straight_walk_is_the_same_without_one():
    motion = builtin_motion("walk")

    def walked(**how):
        scene = Scene.build(motion, "flat", body=HUMANOID)
        return record_walk(scene, seconds=2.0, **how)

    straight = walked()
    same = walked(drive=lambda time: (motion.velocity, 0.0))
    np.testing.assert_array_equal(same.rotations, straight.rotations)
    left = walked(drive=lambda time: ([1.0, 0.0], 0.8))
    assert left.roots[-1, 1] > 0.5
    stopping = walked(drive=lambda time: ([1.3 if time < 1.0 else 0.0, 0.0], 0.0))
    assert stopping.roots[-1, 0] < 0.75 * straight.roots[-1, 0]


def test_a_belt_carries_what_stands_on_it():
    terrain = Terrain(name="t", pieces=(Flat(length=5.0), Belt(length=4.0, speed=0.5), Flat()))
    scene = Scene.build(builtin_motion("walk"), terrain, body=HUMANOID)
    body = next(b for b in range(scene.model.nbody) if "belt" in scene.model.body(b).name)
    before = scene.data.xpos[body].copy()
    scene.pose_terrain(2.0)
    np.testing.assert_allclose(scene.data.xpos[body] - before, [0.0, 1.0, 0.0], atol=1e-12)
    ground = scene.ground()
    heights = ground.height(np.array([[2.0, y, 0.0] for y in (-3.0, 0.0, 3.0)]))
    np.testing.assert_allclose(heights, 0.0, atol=1e-9)
    assert not terrain.static


@pytest.mark.parametrize("angle", [-20.0, 5.0, 30.0])
def test_a_slope_across_is_level_in_the_middle_and_high_on_its_left(angle):
    terrain = Terrain(
        name="t", pieces=(Flat(length=5.0), SideSlope(angle_deg=angle, length=6.0), Flat())
    )
    scene = Scene.build(builtin_motion("walk"), terrain, body=HUMANOID)
    points = np.array([[3.0, y, 0.0] for y in (-1.0, 0.0, 0.5)])
    wanted = points[:, 1] * np.tan(np.radians(angle))
    np.testing.assert_allclose(scene.ground().height(points), wanted, atol=1e-6)
    np.testing.assert_allclose(terrain.height(points[:, 0], points[:, 1]), wanted, atol=1e-12)


def test_the_command_prints_the_table_and_writes_it(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(
        sys,
        "argv",
        ["footik", "score", "--scenes", "flat", "--quick", "--json", str(tmp_path / "s.json")],
    )
    cli.main()
    out = capsys.readouterr().out
    assert "scenes within every limit" in out
    told = json.loads((tmp_path / "s.json").read_text())
    assert told["scenes"][0]["scene"] == "flat"
    assert set(told["scenes"][0]["figures"]) == set(MODES)


def test_a_plot_of_the_suite_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    from footik_runtime.plot import plot_suite

    plot_suite(tmp_path / "s.png", [made(), made("other", pop=3.0)])
    assert (tmp_path / "s.png").read_bytes().startswith(b"\x89PNG")
