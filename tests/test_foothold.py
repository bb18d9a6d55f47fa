"""Footholds from hand-made hits: no scene, no rays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from footik_runtime.feet.clearance import arched, bend_over, climbed
from footik_runtime.feet.foothold import choose_foothold
from footik_runtime.feet.profile import PATH, STEP_PROBES, WINDOW, ask_for_step, most_climb
from footik_runtime.feet.record import HEEL_HANGS, ON_HEEL, TOES_DOWN
from footik_runtime.legs import LEG
from footik_runtime.probes import HIT, PROBE
from footik_runtime.quat_arrays import rotate
from footik_runtime.settings import STANDARD_LEG, FootIKSettings

SETTINGS = FootIKSettings().record(STANDARD_LEG)
SOLE = np.zeros((), dtype=LEG)
SOLE["heel"], SOLE["ball"], SOLE["tip"], SOLE["height"] = 0.065, 0.13, 0.195, 0.09
SOLE["half_width"] = 0.045
PLACE, LIFT = 0.7, (0.0, 0.0, 0.0)
UP = np.array([0.0, 0.0, 1.0])

Height = Callable[[float, float], float]


def answered(height: Height, yaw: float = 0.0, lift=LIFT):
    """Hits of the probes of a step from the origin to x = 0.7, over ground of this height."""
    probes, hits = np.zeros(STEP_PROBES, dtype=PROBE), np.zeros(STEP_PROBES, dtype=HIT)
    ask_for_step(probes, lift, PLACE, 0.0, yaw, 0.0, 0.6, SOLE["half_width"], SETTINGS[()])
    assert (probes["active"] == 1).all()
    for probe, hit in zip(probes, hits, strict=True):
        x, y, top = probe["origin"]
        z = height(x, y)
        hit["hit"] = np.isfinite(z) and top - z <= probe["length"]
        if hit["hit"]:
            hit["point"] = (x, y, z)
    return hits


def landed(hits, yaw: float = 0.0, lift=LIFT):
    return choose_foothold(hits, lift, PLACE, 0.0, yaw, 0.0, SOLE[()], SETTINGS[()])


def chosen(hits, yaw: float = 0.0):
    return landed(hits, yaw)[:4]


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
    # Going up, a heel may hang a little.
    assert before <= edge or behind >= edge - 0.02
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
    assert point[0] + SOLE["ball"] <= 0.84


@pytest.mark.parametrize(("along", "across"), [(0.2, 0.0), (-0.3, 0.0), (0.0, 0.25), (0.2, -0.15)])
@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_a_slope_tilts_the_sole_to_its_own_normal(along: float, across: float, yaw: float) -> None:
    normal = np.array([-along, -across, 1.0])
    hits = answered(lambda x, y: along * (x - PLACE) + across * y, yaw)
    found, point, turn, _ = chosen(hits, yaw)
    assert found
    assert point == pytest.approx((PLACE, 0.0, 0.0), abs=1e-9)
    up = rotate(np.array(turn), UP)
    assert up == pytest.approx(normal / np.linalg.norm(normal), abs=1e-9)


def test_a_slope_steeper_than_the_largest_tilts_no_further() -> None:
    hits = answered(lambda x, y: 1.5 * (x - PLACE))
    _, _, turn, _ = chosen(hits)
    tilt = np.arccos(rotate(np.array(turn), UP)[2])
    assert tilt <= SETTINGS["largest_slope"] + 1e-9


def test_nothing_sticks_through_a_sole_on_waves() -> None:
    for phase in np.linspace(0.0, 6.0, 40):
        hits = answered(lambda x, y, phase=phase: 0.01 * np.sin(16.0 * x + phase))
        found, point, turn, _ = chosen(hits)
        assert found
        ahead = rotate(np.array(turn), np.array([1.0, 0.0, 0.0]))
        for hit in hits[PATH : PATH + WINDOW]:
            along = hit["point"][0] - point[0]
            if -SOLE["heel"] <= along <= SOLE["tip"]:
                assert hit["point"][2] <= point[2] + along * ahead[2] / ahead[0] + 0.001


# --- edges, walls, and how a foot lands -----------------------------------------------------------


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_foot_half_beside_a_stone_moves_over_it_by_half_its_width(side: float) -> None:
    found, point, turn, _ = chosen(answered(lambda x, y: 0.0 if side * y < 0.02 else -0.3))
    assert found
    assert point[1] == pytest.approx(-side * SOLE["half_width"], abs=1e-9)
    assert rotate(np.array(turn), UP) == pytest.approx(UP, abs=1e-9)


def test_one_edge_over_a_drop_or_against_a_wall_rolls_nothing() -> None:
    for beside in (-0.3, 0.3):
        hits = answered(lambda x, y, beside=beside: beside if y > 0.03 else 0.0)
        hits["point"][PATH + WINDOW :, 2] = np.where(
            hits["point"][PATH + WINDOW :, 1] > 0.0, beside, 0.0
        )
        _, _, turn, _ = chosen(hits)
        assert rotate(np.array(turn), UP) == pytest.approx(UP, abs=1e-9)


@pytest.mark.parametrize("across", [0.9, -0.9])
def test_a_roll_over_the_limit_is_cut_to_it(across: float) -> None:
    _, _, turn, _ = chosen(answered(lambda x, y: across * y))
    left = rotate(np.array(turn), np.array([0.0, 1.0, 0.0]))
    assert abs(left[2] / left[1]) == pytest.approx(np.tan(SETTINGS["largest_roll"]), abs=1e-6)


def test_a_sole_rests_on_the_two_points_under_its_weight_and_nothing_sticks_through() -> None:
    def ridges(x: float, y: float) -> float:
        return 0.02 if abs(x - PLACE + 0.03) < 0.04 or abs(x - PLACE - 0.11) < 0.03 else 0.0

    _, point, turn, _ = chosen(answered(ridges))
    ahead = rotate(np.array(turn), np.array([1.0, 0.0, 0.0]))
    along = np.linspace(-SOLE["heel"], SOLE["tip"], 60)
    plane = point[2] + along * ahead[2] / ahead[0]
    ground = np.array([ridges(point[0] + a, 0.0) for a in along])
    assert (plane >= ground - 0.006).all()
    assert plane.max() < 0.035


def test_up_a_stair_the_heel_may_hang_and_the_foot_lands_on_its_ball() -> None:
    tread = (PLACE - 0.03, PLACE + 0.20)

    def stair(x: float, y: float) -> float:
        return 0.17 * (1 + (x > tread[1]) - (x < tread[0]))

    found, point, _, _, how = landed(answered(stair))
    assert found
    assert how == HEEL_HANGS
    assert tread[0] < point[0] + SOLE["ball"] < point[0] + SOLE["tip"] < tread[1]


def test_over_an_edge_down_a_foot_lands_on_its_ball_but_not_down_a_slope() -> None:
    high = (0.0, 0.0, 0.25)
    assert landed(answered(lambda x, y: 0.25 if x < 0.3 else 0.0, lift=high), lift=high)[4] == (
        TOES_DOWN
    )
    slope = answered(lambda x, y: 0.25 * (1.0 - x / PLACE), lift=high)
    assert landed(slope, lift=high)[4] == ON_HEEL


# --- the way there ------------------------------------------------------------------------------


def bent(hits, lift=LIFT, land=(PLACE, 0.0, 0.0)):
    return bend_over(hits, lift, UP, land, UP, SOLE[()], SETTINGS[()])


def line(part: float, bend: float, arch: float, rise: float) -> float:
    return rise * climbed(part, bend, rise > 0.0) + arch * arched(part)


@pytest.mark.parametrize("height", [0.05, 0.12, 0.2])
def test_a_swing_clears_a_box_between_lift_and_landing_from_tip_to_heel(height: float) -> None:
    bend, arch = bent(answered(lambda x, y: height if 0.3 < x < 0.45 else 0.0))
    assert arch <= SETTINGS["largest_step"]
    for part in np.linspace(0.0, 1.0, 200):
        heel, tip = PLACE * part - SOLE["heel"], PLACE * part + SOLE["tip"]
        if part > 0.4 and heel < 0.44 and tip > 0.32:
            assert line(part, bend, arch, 0.0) >= height - 1e-6


def test_level_ground_needs_neither_arch_nor_bend() -> None:
    assert bent(answered(lambda x, y: 0.0)) == (1.0, 0.0)
    assert bent(answered(lambda x, y: -0.3 if x < 0.6 else 0.0)) == (1.0, 0.0)


@pytest.mark.parametrize("slope", [-0.5, 0.3, 0.6])
def test_a_slope_needs_no_arch_for_a_foot_that_is_tilted_with_it(slope: float) -> None:
    up = np.array([-slope, 0.0, 1.0]) / np.hypot(slope, 1.0)
    hits = answered(lambda x, y: slope * x)
    land = (PLACE, 0.0, slope * PLACE)
    bend, arch = bend_over(hits, LIFT, up, land, up, SOLE[()], SETTINGS[()])
    assert bend == 1.0
    assert arch == pytest.approx(0.0, abs=1e-9)


def test_up_stairs_a_swing_climbs_before_it_goes_on_and_down_stairs_after() -> None:
    up, _ = bent(answered(lambda x, y: 0.34 if x > 0.4 else 0.0), land=(PLACE, 0.0, 0.34))
    lift = (0.0, 0.0, 0.34)
    down, _ = bent(answered(lambda x, y: 0.34 if x < 0.4 else 0.0, lift=lift), lift=lift)
    assert up > 1.0
    assert down > 1.0
    assert climbed(0.3, up, True) > 0.3 > climbed(0.3, down, False)


@pytest.mark.parametrize("up", [True, False])
@pytest.mark.parametrize("bend", [1.0, 1.5, 2.5])
def test_a_bent_line_begins_and_ends_where_it_shall_and_never_turns_back(
    up: bool, bend: float
) -> None:
    parts = [climbed(p, bend, up) for p in np.linspace(0.0, 1.0, 50)]
    assert (parts[0], parts[-1]) == (0.0, 1.0)
    assert (np.diff(parts) >= 0.0).all()
