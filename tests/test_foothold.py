"""Footholds from hand-made hits: no scene, no rays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from footik_runtime.feet.foothold import (
    PATH,
    WINDOW,
    arch_over,
    ask_for_foothold,
    choose_foothold,
    most_climb,
)
from footik_runtime.inertia import smooth_bump, smooth_step
from footik_runtime.legs import LEG
from footik_runtime.probes import HIT, PROBE
from footik_runtime.quat_arrays import rotate
from footik_runtime.settings import STANDARD_LEG, FootIKSettings

SETTINGS = FootIKSettings().record(STANDARD_LEG)
SOLE = np.zeros((), dtype=LEG)
SOLE["heel"], SOLE["ball"], SOLE["tip"], SOLE["height"] = 0.065, 0.13, 0.195, 0.09
PLACE, LIFT = 0.7, (0.0, 0.0, 0.0)
UP = np.array([0.0, 0.0, 1.0])

Height = Callable[[float, float], float]


def answered(height: Height, yaw: float = 0.0, normal=(0.0, 0.0, 1.0)):
    """Hits of the probes of a step from the origin to x = 0.7, over ground of this height."""
    probes, hits = np.zeros(PATH + WINDOW, dtype=PROBE), np.zeros(PATH + WINDOW, dtype=HIT)
    ask_for_foothold(probes, LIFT, PLACE, 0.0, yaw, 0.0, SETTINGS[()])
    assert (probes["active"] == 1).all()
    for probe, hit in zip(probes, hits, strict=True):
        x, y, top = probe["origin"]
        z = height(x, y)
        hit["hit"] = np.isfinite(z) and top - z <= probe["length"]
        if hit["hit"]:
            hit["point"], hit["normal"] = (x, y, z), np.asarray(normal) / np.linalg.norm(normal)
    return hits


def chosen(hits, yaw: float = 0.0):
    return choose_foothold(hits, LIFT, PLACE, 0.0, yaw, 0.0, SOLE[()], SETTINGS[()])


@pytest.mark.parametrize("yaw", [0.0, 0.9, -2.5])
def test_level_ground_is_stood_on_as_planned(yaw: float) -> None:
    found, point, turn, _ = chosen(answered(lambda x, y: 0.05, yaw), yaw)
    assert found
    assert point == pytest.approx((PLACE, 0.0, 0.05), abs=1e-12)
    assert rotate(np.array(turn), np.array([1.0, 0.0, 0.0])) == pytest.approx(
        [np.cos(yaw), np.sin(yaw), 0.0], abs=1e-12
    )


@pytest.mark.parametrize("edge", [0.66, 0.70, 0.80, 0.86])
def test_near_an_edge_the_print_moves_along_the_foot_until_it_lies_even(edge: float) -> None:
    found, point, turn, _ = chosen(answered(lambda x, y: 0.0 if x < edge else 0.17))
    assert found
    assert point[0] != PLACE
    assert abs(point[0] - PLACE) <= SETTINGS["foothold_shift"] + 1e-9
    behind, before = point[0] - SOLE["heel"], point[0] + SOLE["tip"]
    assert before <= edge or behind >= edge
    assert point[2] == pytest.approx(0.0 if before <= edge else 0.17, abs=1e-9)
    assert rotate(np.array(turn), UP) == pytest.approx(UP, abs=1e-9)


def test_an_edge_that_the_sole_misses_moves_nothing() -> None:
    _, point, _, _ = chosen(answered(lambda x, y: 0.0 if x < PLACE + 0.25 else 0.17))
    assert point[0] == PLACE


def test_a_pit_is_refused() -> None:
    found, *_ = chosen(answered(lambda x, y: np.nan if x > 0.3 else 0.0))
    assert not found


@pytest.mark.parametrize("height", [-1.1, 1.1])
def test_ground_too_far_down_or_up_is_refused(height: float) -> None:
    hits = answered(lambda x, y: height)
    hits["hit"] = 1
    hits["point"][:, 2] = height
    far = SETTINGS["largest_step"] + most_climb(PLACE, 0.0, SETTINGS[()])
    assert far < abs(height)
    assert not chosen(hits)[0]
    hits["point"][:, 2] = np.copysign(far - 0.01, height)
    assert chosen(hits)[0]


def test_beside_a_pit_the_print_moves_onto_the_ground() -> None:
    found, point, _, _ = chosen(answered(lambda x, y: 0.0 if x < 0.84 else np.nan))
    assert found
    assert point[0] + SOLE["tip"] <= 0.84


@pytest.mark.parametrize(("along", "across"), [(0.2, 0.0), (-0.3, 0.0), (0.0, 0.25), (0.2, -0.15)])
@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_a_slope_tilts_the_sole_to_its_own_normal(along: float, across: float, yaw: float) -> None:
    normal = np.array([-along, -across, 1.0])
    hits = answered(lambda x, y: along * (x - PLACE) + across * y, yaw, normal)
    found, point, turn, _ = chosen(hits, yaw)
    assert found
    assert point == pytest.approx((PLACE, 0.0, 0.0), abs=1e-9)
    up = rotate(np.array(turn), UP)
    assert up == pytest.approx(normal / np.linalg.norm(normal), abs=1e-9)


def test_a_slope_steeper_than_the_largest_tilts_no_further() -> None:
    hits = answered(lambda x, y: 1.5 * (x - PLACE), 0.0, (-1.5, 0.0, 1.0))
    _, _, turn, _ = chosen(hits)
    tilt = np.arccos(rotate(np.array(turn), UP)[2])
    assert tilt <= SETTINGS["largest_slope"] + 1e-9


def test_nothing_sticks_through_a_sole_on_waves() -> None:
    for phase in np.linspace(0.0, 6.0, 40):
        hits = answered(lambda x, y, phase=phase: 0.01 * np.sin(16.0 * x + phase))
        found, point, turn, _ = chosen(hits)
        assert found
        ahead = rotate(np.array(turn), np.array([1.0, 0.0, 0.0]))
        for hit in hits[PATH:]:
            along = hit["point"][0] - point[0]
            if -SOLE["heel"] <= along <= SOLE["tip"]:
                assert hit["point"][2] <= point[2] + along * ahead[2] / ahead[0] + 0.001


@pytest.mark.parametrize("height", [0.05, 0.12, 0.2])
def test_an_arch_clears_a_box_between_lift_and_landing(height: float) -> None:
    hits = answered(lambda x, y: height if 0.25 < x < 0.45 else 0.0)
    arch = arch_over(hits, 0.0, 0.0, SETTINGS[()])
    assert arch <= SETTINGS["largest_step"]
    for t in np.linspace(0.0, 1.0, 200):
        if 0.25 < PLACE * smooth_step(t) < 0.45:
            assert arch * smooth_bump(t) >= min(height, SETTINGS["largest_step"])


def test_level_ground_needs_no_arch() -> None:
    assert arch_over(answered(lambda x, y: 0.0), 0.0, 0.0, SETTINGS[()]) == 0.0
    assert arch_over(answered(lambda x, y: -0.3 if x < 0.6 else 0.0), 0.0, 0.0, SETTINGS[()]) == 0.0
