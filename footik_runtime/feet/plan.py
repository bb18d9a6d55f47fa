"""The plan of a foot: a foothold is asked for, heard of, and kept until its place moves."""

from __future__ import annotations

from footik_runtime.compiled import compiled
from footik_runtime.feet.clearance import bend_over
from footik_runtime.feet.foothold import choose_foothold
from footik_runtime.feet.footprint import UP, to_body
from footik_runtime.feet.profile import STEP_PROBES, ask_for_step
from footik_runtime.feet.record import ASKED, ASKED_AGAIN, NOWHERE, PLANNED
from footik_runtime.math3d import get3, get4, quat_heading, rotate, set3, set4

PROBES = 1 + STEP_PROBES
"""Probes of a foot: one that watches the ground of its print, and those of a foothold."""


@compiled
def ask(foot, told, leg, lift, probes, settings):
    """Ask for a foothold at the told place; again, where there was none last time."""
    foot["plan"] = ASKED_AGAIN if foot["plan"] == NOWHERE else ASKED
    x, y, yaw = told["place"][0], told["place"][1], told["yaw"]
    foot["plan_place"][0], foot["plan_place"][1], foot["plan_yaw"] = x, y, yaw
    foot["plan_ref"] = told["root_z"]
    ask_for_step(
        probes[1:], lift, x, y, yaw, told["root_z"], told["below"], leg["half_width"], settings
    )


@compiled
def ask_under(foot, told, leg, probes, settings):
    """Ask for a foothold right under the animated foot."""
    x, y = told["ankle"][0], told["ankle"][1]
    foot["plan"], foot["plan_place"][0], foot["plan_place"][1] = ASKED, x, y
    foot["plan_yaw"], foot["plan_ref"] = quat_heading(get4(told["turn"])), told["root_z"]
    set3(foot["lift"], (x, y, told["root_z"]))
    ask_for_step(
        probes[1:], get3(foot["lift"]), x, y, foot["plan_yaw"], told["root_z"], told["below"],
        leg["half_width"], settings,
    )  # fmt: skip


@compiled
def plan_moved(foot, told, settings):
    """Whether the told place is so far from the one last looked at that it must be looked at."""
    dx, dy = told["place"][0] - foot["plan_place"][0], told["place"][1] - foot["plan_place"][1]
    return dx * dx + dy * dy > settings["replan_distance"] ** 2


@compiled
def hear_foothold(foot, told, hits, leg, settings, bodies_at, bodies_turn):
    """Turn the answered probes into the planned foothold."""
    x, y, yaw = foot["plan_place"][0], foot["plan_place"][1], foot["plan_yaw"]
    lift = get3(foot["lift"])
    found, point, turn, under, how = choose_foothold(
        hits[1:], lift, x, y, yaw, foot["plan_ref"], leg, settings
    )
    if not found:
        foot["plan"] = NOWHERE
        return
    foot["plan"] = PLANNED
    lift_up, land_up = rotate(get4(foot["lift_turn"]), UP), rotate(turn, UP)
    bend, arch = bend_over(hits[1:], lift, lift_up, point, land_up, leg, settings)
    foot["bend"], foot["arch"] = bend, max(arch, settings["swing_lift"])
    foot["plan_shift"][0] = point[0] - told["due"][0]
    foot["plan_shift"][1] = point[1] - told["due"][1]
    foot["landing"] = how
    hit = hits[1 + under]
    foot["land_floor"], foot["land_body"] = hit["geom"], hit["body"]
    point, turn = to_body(hit["body"], point, turn, bodies_at, bodies_turn)
    set3(foot["land"], point)
    set4(foot["land_turn"], turn)
