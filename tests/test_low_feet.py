"""Low feet: what is meant as contact is told where paws slide, and left alone where they stand."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from footik_runtime import gait, gait_quadruped, load_clip
from footik_runtime.builtin import humanoid_rig, quadruped_rig
from footik_runtime.motion import Motion
from footik_runtime.offline.contacts import with_contacts
from footik_runtime.offline.low_feet import with_low_feet
from footik_runtime.offline.stages import CleanSettings
from footik_runtime.offline.working import working
from footik_runtime.phases import Phase, phase_curve
from footik_runtime.rig import find_rig
from footik_runtime.scene import Scene
from footik_runtime.walk import record_walk

FOX = Path(os.environ.get("FOOTIK_SHARED", "../shared")) / "data" / "gltf" / "Fox.glb"
needs_fox = pytest.mark.skipif(not FOX.exists(), reason=f"there is no {FOX}")


def contacts(clip, rig) -> np.ndarray:
    """(T, legs) whether each foot is down."""
    return np.stack([clip.curves[phase_curve(leg.name)] != Phase.SWING for leg in rig.legs], axis=1)


def sliding(clip, by: float):
    """The clip without its curves, travelling `by` times as far: feet slide along."""
    roots = clip.root_positions * [by, 1.0, 1.0]
    return replace(clip, root_positions=roots, curves={})


@pytest.mark.parametrize("by", [0.6, 1.5])
def test_contacts_of_sliding_paws_are_told_from_height_and_way(by):
    rig = quadruped_rig()
    clip = gait_quadruped.quadruped_walk(rig)
    told, _ = with_contacts(sliding(clip, by), rig)
    agree = contacts(told, rig) == contacts(clip, rig)
    assert agree.mean(axis=0).min() > 0.8
    assert contacts(told, rig).mean(axis=0).min() > 0.4


def test_paws_that_stand_are_left_to_the_detector():
    rig = quadruped_rig()
    clip = gait_quadruped.quadruped_walk(rig)
    told, _ = with_contacts(sliding(clip, 1.0), rig)
    phases = np.stack([told.curves[phase_curve(leg.name)] for leg in rig.legs], axis=1)
    assert (phases == Phase.BALL).any(), "it tells heel-off, which heights do not"
    assert (contacts(told, rig) == contacts(clip, rig)).mean() > 0.9


def test_two_feet_are_never_told_so():
    rig = humanoid_rig()
    work = working(gait.walk(rig), rig, settings=CleanSettings())
    swing = np.full(work.soles.shape[:2], Phase.SWING, dtype=np.int8)
    assert with_low_feet(swing, work) is swing


@needs_fox
def test_the_foxs_walk_has_contacts_of_all_four_paws_and_holds_them():
    clip = load_clip(FOX, animation="Walk")
    motion = Motion.prepare(clip, find_rig(clip.skeleton))
    assert (motion.timing["phase"] != Phase.SWING).mean(axis=0).min() > 0.35
    for terrain, most in (("flat", 0.1), ("slope", 16.0)):
        run = record_walk(Scene.build(motion, terrain), seconds=5.0)
        assert np.isfinite(run.rotations).all()
        held = run.feet["locked"][run.phases != Phase.SWING].mean()
        assert held > 0.85
        assert np.degrees(np.abs(run.bodies["lean"])).max() < most
