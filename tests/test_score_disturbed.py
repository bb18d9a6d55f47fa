"""What disturbs a motion for the score, and that its strips are pictures."""

from __future__ import annotations

import os

import numpy as np
import pytest

from footik_runtime.builtin import builtin_motion
from footik_runtime.score_disturbed import (
    steered_hard,
    with_late_contacts,
    with_wrong_footholds,
)
from footik_runtime.score_strips import SHOTS, strip_name, write_strip
from footik_runtime.score_suite import OURS, chosen_scenes, score_scene
from footik_runtime.settings import FootIKSettings


@pytest.mark.parametrize("seconds", [-0.06, 0.06])
def test_late_contacts_come_later_by_so_much_and_nothing_else_changes(seconds: float) -> None:
    motion = builtin_motion()
    late = with_late_contacts(motion, seconds)
    frames = round(seconds * motion.clip.fps)
    phases, told = motion.timing["phase"][:-1], late.timing["phase"][:-1]
    assert (np.roll(phases, frames, axis=0) == told).mean() > 0.99
    assert late.rotations == pytest.approx(motion.rotations, abs=1e-12)
    assert late.speed == motion.speed


def test_wrong_footholds_are_foreseen_ahead_by_so_much() -> None:
    motion = builtin_motion()
    wrong = with_wrong_footholds(motion, 0.1)
    moved = wrong.timing["print"] - motion.timing["print"]
    assert moved[..., 0] == pytest.approx(0.1)
    assert moved[..., 1] == pytest.approx(0.0)


def test_steering_hard_turns_to_and_fro_within_a_stride() -> None:
    turns = [steered_hard(1.3)(t)[1] for t in np.linspace(0.0, 1.1, 50)]
    assert min(turns) == -1.5
    assert max(turns) == 1.5


@pytest.mark.parametrize("name", ["contacts 60 ms early, hills", "footholds 10 cm off, hills"])
def test_feet_told_wrong_neither_sink_nor_pop_beyond_twice_the_limits(name: str) -> None:
    (scene,) = chosen_scenes([name])
    figures = score_scene(scene).figures[OURS]
    for key in ("penetration", "penetration_contact_p99", "penetration_swing_p99", "float", "pop"):
        assert figures[key] <= getattr(scene.limits, key), key


@pytest.mark.skipif(os.environ.get("MUJOCO_GL") not in ("egl", "osmesa"), reason="no MUJOCO_GL")
def test_a_strip_shows_a_scene_without_foot_ik_above_and_with_it_below(tmp_path) -> None:
    matplotlib_image = pytest.importorskip("matplotlib.image")
    (scene,) = chosen_scenes(["stairs 17 cm up"])
    path = write_strip(tmp_path, scene)
    assert path.name == strip_name(scene) == "stairs-17-cm-up.png"
    pixels = matplotlib_image.imread(path)
    assert pixels.shape[:2] == (480, 320 * SHOTS)
    above, below = pixels[:240], pixels[240:]
    assert np.abs(above - below).mean() > 0.005
    assert pixels[..., :3].std() > 0.05


@pytest.mark.parametrize(
    "name", ["stairs 17 cm up", "stairs 15 cm down", "slope 20 up", "gap", "stairs 12 cm up"]
)
def test_what_was_won_on_stairs_slopes_and_gaps_is_kept(name: str) -> None:
    scene = next(scene for scene in chosen_scenes([name]) if scene.name == name)
    assert score_scene(scene).missed() == []


def test_prints_moved_uphill_let_the_hips_ride_higher() -> None:
    scene = next(s for s in chosen_scenes(["stairs 15 cm up"]))
    ours, level = (
        score_scene(scene, settings=FootIKSettings(uphill_lead=lead, max_stride_drop=0.45))
        for lead in (0.7, 0.0)
    )
    assert ours.figures[OURS]["hip_drop"] < level.figures[OURS]["hip_drop"] - 5.0
