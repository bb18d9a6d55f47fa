"""Walking on flat ground, slopes, hills and stairs: what the figures must be, at any frame rate."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from footik_runtime.builtin import HUMANOID, builtin_motion
from footik_runtime.compiled import jit_enabled
from footik_runtime.metrics import plant_slips, score
from footik_runtime.quat_arrays import rotate
from footik_runtime.scene import Scene
from footik_runtime.terrain import make_terrain
from footik_runtime.terrain.even import Flat, Ramp
from footik_runtime.terrain.layout import Terrain
from footik_runtime.walk import Recording, record_walk

pytestmark = pytest.mark.skipif(not jit_enabled(), reason="walks need kernels to be quick")

TERRAINS = ("flat", "slope", "hills", "stairs")
RATES = (30.0, 60.0, 144.0, 240.0)
SECONDS = 6.0


@cache
def recorded(terrain: str, fps: float = 60.0, ik: bool = True) -> Recording:
    scene = Scene.build(builtin_motion("walk"), make_terrain(terrain), body=HUMANOID)
    return record_walk(scene, seconds=SECONDS, fps=fps, ik=ik)


@cache
def figures(terrain: str, fps: float = 60.0, ik: bool = True) -> dict[str, float]:
    return score(recorded(terrain, fps, ik).run, recorded(terrain, fps, False).run)


@pytest.mark.parametrize("terrain", TERRAINS)
def test_no_plant_slips(terrain: str) -> None:
    slips = plant_slips(recorded(terrain).run)
    assert len(slips) >= 10
    assert slips.max() <= 0.1  # mm


def test_a_flat_walk_neither_sinks_nor_floats() -> None:
    walked = recorded("flat")
    points, ground = walked.run.sole[..., 2], walked.run.ground
    locked = walked.feet["locked"] == 1
    assert figures("flat")["penetration_p99"] == 0.0
    assert (points - ground).min() > -1e-4
    lowest = (points - ground).min(axis=-1)
    assert np.abs(lowest[locked]).max() < 1e-4


@pytest.mark.parametrize("terrain", ["slope", "hills"])
@pytest.mark.parametrize("key", ["penetration", "penetration_p99", "float", "sliding_25"])
def test_uneven_ground_is_walked_better_than_without_ik(terrain: str, key: str) -> None:
    assert figures(terrain)[key] < figures(terrain, ik=False)[key]


@pytest.mark.parametrize("angle_deg", [12.0, -12.0])
def test_a_locked_foot_has_the_normal_of_its_slope(angle_deg: float) -> None:
    pieces = (Flat(length=4.8), Ramp(angle_deg=angle_deg, length=20.0), Flat(length=2.0))
    scene = Scene.build(builtin_motion("walk"), Terrain(name="ramp", pieces=pieces), body=HUMANOID)
    feet = record_walk(scene, seconds=SECONDS).feet
    ramp = scene.model.geom("terrain_01_ramp/ramp").id
    on_it = (feet["state"] == 1) & (feet["floor"] == ramp)
    on_it[:180] = False  # let both feet be well on it
    normal = np.array([-np.sin(np.radians(angle_deg)), 0.0, np.cos(np.radians(angle_deg))])
    up = rotate(feet["hold_turn"][on_it], np.array([0.0, 0.0, 1.0]))
    assert on_it.sum() > 200
    assert np.degrees(np.arccos(np.clip(up @ normal, -1.0, 1.0))).max() < 0.5
    plane = feet["normal"][on_it & (feet["locked"] == 1)]
    assert np.degrees(np.arccos(np.clip(plane @ normal, -1.0, 1.0))).max() < 0.5


@pytest.mark.parametrize(
    ("key", "least"),
    [
        ("foot_joint_speed", 0.0),
        ("pop", 0.0),
        ("hip_acceleration_ratio", 0.0),
        ("sliding_25", 0.0),
        ("sliding_50", 0.0),
        ("skating_ratio", 0.01),
    ],
)
def test_no_figure_depends_on_the_frame_rate(key: str, least: float) -> None:
    values = np.array([figures("flat", fps)[key] for fps in RATES])
    spread = values.max() - values.min()
    assert spread <= max(0.15 * values.max(), least), dict(zip(RATES, values, strict=True))
