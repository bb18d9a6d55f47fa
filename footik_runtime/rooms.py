"""Rooms: a frame of many characters, one compiled function a room, over rows of records.

A row is one character. In order: move the root (`locomotion`), sample and place the pose, ask the
probes, cast them (`ground`), settle the feet and move the hips, solve the legs.
"""

from __future__ import annotations

import math
from collections import namedtuple

from footik_runtime.compiled import compiled
from footik_runtime.feet.plan import PROBES
from footik_runtime.feet.record import HEEL_PIN, advance_switches, remember, reset_foot
from footik_runtime.feet.target import ground_of, intend, settle
from footik_runtime.ground import Caster, cast_native
from footik_runtime.hips import move_hips, sway_hips, wanted_drop, wanted_raise
from footik_runtime.inertia import smooth_step
from footik_runtime.lean import lean_body, lean_pose, lean_shift
from footik_runtime.legs import pose_leg
from footik_runtime.locomotion import (
    ahead_of,
    ask_root,
    hear_root,
    root_rows,
    support_root,
    uphill_lead,
)
from footik_runtime.math3d import (
    add,
    clamp,
    get3,
    get4,
    lerp,
    quat_heading,
    quat_mul,
    quat_slerp,
    quat_yaw,
    rotate,
    set3,
    set4,
)
from footik_runtime.motion import sample_pose
from footik_runtime.settings import REACH_BY_CURVE, REACH_BY_HEIGHT, REACH_BY_PHASE

BLOCK = 32
"""Rows worked together."""

_SLOWEST = 0.05  # a rate below it, or none, counts as this: what comes next stays at hand
_MOST_SHIFT = 0.7  # m; how far a print may be from where the animation would put it
_LONGEST_SWING = 2.0  # times its usual duration for which a swing is looked ahead
_HIGH = 0.15  # m of an animated foot over the ground at which its rays are shortest
_LONGEST_HALF = 1.0  # s; half of a contact that is looked ahead at most

Tables = namedtuple(
    "Tables",
    "parents offsets order roots rotations translations timing legs fps cycle settings",
)
"""What all rows share; see `Motion`. order: joints whose world pose the feet need."""

Bodies = namedtuple("Bodies", "at turn")
"""Positions (B, 3) and rotations (B, 4) of the scene's bodies, now."""

Block = namedtuple("Block", "moves at turn told probes hits ray geom_id")
"""Work space of one block: translations (BLOCK, J, 3), world positions and rotations of joints,
`FOOT_INPUT` (BLOCK, legs), probes and hits (BLOCK, 1 + legs * PROBES), the first for the root, and
what a ray needs: (9,) and (1,)."""


@compiled
def pose_row(body, tables, root, local, moves, at, turn):
    """Sample the motion and put the joints that the feet need in the world."""
    frame, part = sample_pose(
        tables.roots, tables.rotations, tables.translations, tables.fps, body["time"], root,
        local, moves,
    )  # fmt: skip
    body["frame"], body["part"] = frame, part
    yaw = quat_yaw(body["yaw"])
    set3(root, add(get3(body["root"]), rotate(yaw, get3(root))))
    set4(local[0], quat_mul(yaw, get4(local[0])))
    set3(at[0], get3(root))
    set4(turn[0], get4(local[0]))
    moved = moves if tables.translations.shape[0] else tables.offsets
    for k in range(1, tables.order.shape[0]):
        j = tables.order[k]
        p = tables.parents[j]
        by = get4(turn[p])
        set4(turn[j], quat_mul(by, get4(local[j])))
        set3(at[j], add(get3(at[p]), rotate(by, get3(moved[j]))))


@compiled
def tell_foot(body, timing, part, fps, leg, at, turn, settings, told):
    """Write what one foot is told: its animated pose, and what the motion's table says of it."""
    set3(told["ankle"], get3(at[leg["ankle"]]))
    set4(told["turn"], quat_mul(get4(turn[leg["ankle"]]), get4(leg["frame"])))
    told["root_z"] = body["root"][2]
    told["weight"] = timing["weight"]
    told["ahead"] = 1 if math.isfinite(timing["to_plant"]) else 0
    if told["ahead"] == 0:
        told["to_plant"], told["to_release"], told["swing_time"] = math.inf, math.inf, 0.0
        for k in range(2):
            told["place"][k] = told["due"][k] = told["ankle"][k]
        told["yaw"] = quat_heading(get4(told["turn"]))
        return
    rate = max(body["rate"], _SLOWEST)
    ticks = timing["to_plant"] - part / fps
    told["to_plant"], told["swing_time"] = ticks / rate, timing["swing_time"] / rate
    told["to_release"] = (timing["to_release"] - part / fps) / rate
    told["progress"] = clamp(1.0 - ticks / max(timing["swing_time"], 1e-3), 0.0, 1.0)
    told["pitch"] = timing["pitch"]
    told["lock"] = timing["lock"] if timing["lock"] >= 0 else int(settings["lock"])
    told["below"] = ray_reach(told, timing, leg, settings)
    tell_place(body, timing, rate, leg, settings, told)


@compiled
def ray_reach(told, timing, leg, settings):
    """How far under the ground that the body walks on a foot's rays reach, m."""
    mode = settings["ray_reach"]
    share = 1.0
    if mode == REACH_BY_HEIGHT:
        high = told["ankle"][2] - told["root_z"] - leg["height"]
        share = 1.0 - smooth_step(high / (_HIGH * settings["size"]))
    elif mode == REACH_BY_CURVE:
        share = clamp(told["weight"], 0.0, 1.0)
    elif mode == REACH_BY_PHASE:
        share = 1.0 if timing["phase"] != 0 else 0.0
    least = min(settings["ground_below_swing"], settings["ground_below"])
    return least + share * (settings["ground_below"] - least)


@compiled
def tell_place(body, timing, rate, leg, settings, told):
    """Write where the next plant shall be: where the foot is in the middle of its contact.

    At the motion's own velocity that is the print at the plant itself (`due`); at any other the
    leg is stretched as far back at the end as it is forward at the beginning.
    """
    # A motion that is all but paused plants some day: where, its velocity does not say.
    seconds = min(told["to_plant"], _LONGEST_SWING * timing["swing_time"])
    due = ahead_of(body, (timing["print"][0], timing["print"][1], 0.0), seconds)
    later = min(timing["to_middle"] / rate, _LONGEST_HALF)
    middle = (timing["middle"][0], timing["middle"][1], 0.0)
    place = ahead_of(body, middle, seconds + later)
    x, y = place[0] - due[0], place[1] - due[1]
    part = min(1.0, _MOST_SHIFT * settings["size"] / max(math.sqrt(x * x + y * y), 1e-9))
    told["due"][0], told["due"][1] = due[0], due[1]
    uphill = uphill_lead(body, leg["length"], settings)
    uphill = rotate(quat_yaw(body["yaw"]), (uphill[0], uphill[1], 0.0))
    told["place"][0] = due[0] + part * x + uphill[0]
    told["place"][1] = due[1] + part * y + uphill[1]
    told["yaw"] = body["yaw"] + body["turn_rate"] * (seconds + later) + timing["middle_yaw"]


@compiled
def others_locked(feet, i):
    """Whether every foot of this character but the i-th is locked."""
    locked = 0
    for k in range(feet.shape[0]):
        locked += feet[k]["locked"]
    return locked - feet[i]["locked"] == feet.shape[0] - 1


@compiled
def none_sets_out(feet, i):
    """Whether no foot of this character but the i-th begins a bump stride in this very frame."""
    for k in range(feet.shape[0]):
        if k != i and feet[k]["bump"] and feet[k]["stride_age"] == 0.0:
            return False
    return True


@compiled
def ask_row(body, feet, tables, at, turn, told, probes, dt, scene):
    """Ask every probe of one character: its root's first, then PROBES of each foot."""
    ask_root(body, dt, probes[0], tables.settings)
    for i in range(feet.shape[0]):
        leg = tables.legs[i]
        timing = tables.timing[body["frame"], i]
        advance_switches(feet[i], dt, tables.settings)
        tell_foot(body, timing, body["part"], tables.fps, leg, at, turn, tables.settings, told[i])
        first = 1 + i * PROBES
        if feet[i]["share"] == 0.0:
            for k in range(first, first + PROBES):
                probes[k]["active"] = 0
            continue
        intend(
            feet[i], told[i], leg, others_locked(feet, i), dt, probes[first : first + PROBES],
            tables.settings, scene.at, scene.turn,
        )  # fmt: skip


@compiled
def settle_row(body, feet, tables, at, told, hits, dt, scene):
    """Hear every hit of one character: settle its feet, lean its body, and move its hips."""
    hear_root(body, hits[0])
    wanted, rise, lowest, count = 0.0, 0.0, math.inf, feet.shape[0]
    x, y = 0.0, 0.0
    for i in range(feet.shape[0]):
        leg, foot = tables.legs[i], feet[i]
        if foot["share"] == 0.0:
            continue
        first = 1 + i * PROBES
        settle(
            feet[i], told[i], leg, hits[first : first + PROBES], none_sets_out(feet, i), dt,
            tables.settings, scene.at, scene.turn,
        )  # fmt: skip
    lean_body(body, feet, dt, tables.settings, scene.at, scene.turn)
    for i in range(feet.shape[0]):
        leg, foot = tables.legs[i], feet[i]
        if foot["share"] == 0.0:
            continue
        timing = tables.timing[body["frame"], i]
        hip = get3(at[leg["hip"]])
        shift = lean_shift(body, hip)
        drop = wanted_drop(
            body, foot, told[i], leg, hip, shift, timing, tables.settings, scene.at, scene.turn,
        )  # fmt: skip
        share = smooth_step(foot["share"])
        wanted = max(wanted, share * drop)
        rise = max(rise, share * wanted_raise(foot, leg, add(hip, shift), tables.settings))
        x += share * foot["weight"] * (foot["goal"][0] - told[i]["ankle"][0]) / count
        y += share * foot["weight"] * (foot["goal"][1] - told[i]["ankle"][1]) / count
        lowest = min(lowest, ground_of(feet[i], scene.at, scene.turn))
    support_root(body, lowest, tables.settings)
    move_hips(body, wanted - rise, dt, tables.settings)
    sway_hips(body, x, y, dt, tables.settings)


@compiled
def leg_row(body, feet, tables, root, local, at, turn, told, dt):
    """Lower the hips and solve the legs of one character, into its local rotations (J, 4)."""
    lean_pose(body, tables.order, root, local, at, turn)
    share = smooth_step(body["blend"])
    any_foot = 0.0
    for i in range(feet.shape[0]):
        any_foot = max(any_foot, smooth_step(feet[i]["share"]))
    hips = share * any_foot
    moved = (hips * body["sway"][0], hips * body["sway"][1], -hips * body["hip_drop"])
    still = moved[0] == 0.0 and moved[1] == 0.0 and moved[2] == 0.0
    for k in range(3):
        root[k] += moved[k]
    for i in range(feet.shape[0]):
        foot = feet[i]
        if foot["share"] == 0.0 and still:
            continue  # to the bit as it is animated
        goal, goal_turn = get3(foot["goal"]), get4(foot["goal_turn"])
        part = share * smooth_step(foot["share"])
        if foot["share"] == 0.0:
            goal, goal_turn = get3(told[i]["ankle"]), get4(told[i]["turn"])
        elif part < 1.0:
            goal = lerp(get3(told[i]["ankle"]), goal, part)
            goal_turn = quat_slerp(get4(told[i]["turn"]), goal_turn, part)
        ankle, sole_turn, reached, missing, lift, stretch = pose_leg(
            tables.legs[i], moved, goal, goal_turn, part * foot["heel_lift"],
            part * foot["toes"], get3(foot["normal"]), tables.parents, tables.settings,
            local, at, turn,
        )  # fmt: skip
        foot["reached"], foot["missing"], foot["lifted"] = reached, missing, lift
        foot["stretch"] = stretch
        if not reached or part < 1.0 or (lift > 0.0 and foot["pin"] == HEEL_PIN):
            foot["locked"] = 0  # a lift turns about the ball, and carries a held heel away
        if foot["share"] > 0.0:
            remember(foot, told[i], ankle, sole_turn, dt)


# --- blocks of rows -----------------------------------------------------------------------------


@compiled
def pose_rows(bodies, tables, roots, locals_, block):
    """Sample and place the poses of these rows."""
    for c in range(bodies.shape[0]):
        pose_row(
            bodies[c], tables, roots[c], locals_[c], block.moves[c], block.at[c], block.turn[c]
        )


@compiled
def blend_row(body, feet, dt, settings):
    """Fade foot IK in or out as it is enabled or not; feet that are out forget everything.

    Returns whether anything is left of it.
    """
    step = dt / max(settings["blend_time"], 1e-9)
    on, before = body["enabled"] != 0, body["blend"]
    body["blend"] = clamp(before + (step if on else -step), 0.0, 1.0)
    if body["blend"] == 0.0 and before > 0.0:
        start_anew(body, feet)
    return on or body["blend"] > 0.0


@compiled
def start_anew(body, feet):
    """Feet and hips that know nothing yet: they begin where the animation has them."""
    body["fresh"], body["hip_drop"], body["hip_speed"] = 1, 0.0, 0.0
    for k in range(2):
        body["sway"][k], body["sway_speed"][k] = 0.0, 0.0
        body["lean"][k], body["lean_speed"][k] = 0.0, 0.0
    for i in range(feet.shape[0]):
        reset_foot(feet[i])


@compiled
def ask_rows(bodies, feet, tables, block, dt, scene):
    """Ask the probes of these rows."""
    for c in range(bodies.shape[0]):
        if blend_row(bodies[c], feet[c], dt, tables.settings):
            ask_row(
                bodies[c], feet[c], tables, block.at[c], block.turn[c], block.told[c],
                block.probes[c], dt, scene,
            )  # fmt: skip
        else:
            for k in range(1, block.probes.shape[1]):
                block.probes[c, k]["active"] = 0
            ask_root(bodies[c], dt, block.probes[c, 0], tables.settings)


@compiled
def settle_rows(bodies, feet, tables, block, dt, scene):
    """Hear the hits of these rows."""
    for c in range(bodies.shape[0]):
        if bodies[c]["enabled"] or bodies[c]["blend"] > 0.0:
            settle_row(
                bodies[c], feet[c], tables, block.at[c], block.told[c], block.hits[c], dt, scene
            )
        else:
            hear_root(bodies[c], block.hits[c, 0])


@compiled
def leg_rows(bodies, feet, tables, roots, locals_, block, dt):
    """Solve the legs of these rows."""
    for c in range(bodies.shape[0]):
        if bodies[c]["enabled"] or bodies[c]["blend"] > 0.0:
            leg_row(
                bodies[c], feet[c], tables, roots[c], locals_[c], block.at[c], block.turn[c],
                block.told[c], dt,
            )  # fmt: skip


@compiled
def before_rays(bodies, feet, tables, roots, locals_, block, dt, scene):
    """The rooms before the rays."""
    root_rows(bodies, dt, tables.cycle, tables.settings)
    pose_rows(bodies, tables, roots, locals_, block)
    ask_rows(bodies, feet, tables, block, dt, scene)


@compiled
def after_rays(bodies, feet, tables, roots, locals_, block, dt, scene):
    """The rooms after the rays."""
    settle_rows(bodies, feet, tables, block, dt, scene)
    leg_rows(bodies, feet, tables, roots, locals_, block, dt)


@compiled
def cast_rows(block, rows, caster):
    """Cast the probes of the first rows of a block."""
    for c in range(rows):
        cast_native(
            caster.model, caster.data, caster.groups, caster.geom_body, caster.passed, caster.frame,
            block.probes[c], block.hits[c], block.ray, block.geom_id,
        )  # fmt: skip


@compiled
def step_native(dt, bodies, feet, roots, locals_, block, tables, scene, caster):
    """A whole frame of many rows, block by block, with native rays: nothing calls Python.

    Called from Python for every frame, so it is given what Numba takes in fast: plain tuples for
    `Tables`, `Block`, `Bodies` and `Caster`, and the settings as an array (1,).
    """
    shared = Tables(*tables[:-1], tables[-1][0])  # pyright: ignore[reportCallIssue]
    work, around, by = Block(*block), Bodies(*scene), Caster(*caster)
    rows = bodies.shape[0]
    for first in range(0, rows, BLOCK):
        last = min(first + BLOCK, rows)
        here, theirs = bodies[first:last], feet[first:last]
        root, local = roots[first:last], locals_[first:last]
        before_rays(here, theirs, shared, root, local, work, dt, around)
        cast_rows(work, last - first, by)
        after_rays(here, theirs, shared, root, local, work, dt, around)
