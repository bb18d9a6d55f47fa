"""Foot targets: the state machine that decides where each foot shall be.

A foot is released (it follows the animation), or grounded: on its way to a print, or locked on it.
A grounded foot that must stand elsewhere makes a bump stride, a step of its own. Prints live in
the frame of the body they lie on, so that feet ride whatever moves.

A frame has two halves with the rays between them: `intend` releases feet and asks its probes;
`settle` hears the hits, starts strides and writes the goal. Whenever what a foot follows changes,
the difference is carried over as an offset that decays to exactly zero.
"""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.feet.carry import carry_over, with_offset
from footik_runtime.feet.footprint import UP, print_of, stance_pitch, to_body
from footik_runtime.feet.lock import loose, stance
from footik_runtime.feet.plan import PROBES, ask, hear_foothold, plan_moved
from footik_runtime.feet.record import (
    ANKLE_LOCK,
    ASKED,
    ASKED_AGAIN,
    BALL_PIN,
    FULL_LOCK,
    GROUNDED,
    HEEL_PIN,
    NO_PIN,
    NO_PLAN,
    NOWHERE,
    ON_HEEL,
    PLANNED,
    RELEASED,
    TOES_DOWN,
)
from footik_runtime.feet.stride import (
    FORCED,
    bump_pose,
    bump_to_plan,
    intend_bump,
    start_stride,
    take_foothold,
)
from footik_runtime.feet.swing import follow_swing, landing, set_down, swing_progress, swinging
from footik_runtime.inertia import smooth_step
from footik_runtime.math3d import (
    add,
    add_scaled,
    get3,
    get4,
    quat_heading,
    quat_yaw,
    rotate,
    set3,
    set4,
    sub,
)
from footik_runtime.probes import set_probe

_DOWN = (0.0, 0.0, -1.0)
_FOLLOWED = 1e-3  # m of ground movement under a print that is not worth following
_MISSED = 0.004  # m by which a leg may miss its goal before a contact is given up
_HEEL_STANCE = 0.2  # s after a plant in which more and more of a heel lift is allowed
_BALL_LEAD = 1.4  # times the usual time in which a foot that lands on its ball is set down
_LONGEST_LEAD = 0.6  # part of a swing in which its foot may be set down


@compiled
def release(foot, told, leg, dt, settings, bodies_at, bodies_turn):
    """Let go of the ground: the foot swings from its print back to the animation."""
    point, turn = print_of(foot, bodies_at, bodies_turn)
    now, _ = stance(foot, told["ankle"], told["turn"], leg, settings, bodies_at, bodies_turn)
    before, _ = stance(foot, foot["anim"], foot["anim_turn"], leg, settings, bodies_at, bodies_turn)
    set3(foot["rolled"], sub(now, before))
    set3(foot["lift"], point)
    set4(foot["lift_turn"], turn)
    foot["state"], foot["bump"], foot["plan"] = RELEASED, 0, NO_PLAN
    foot["floor"], foot["body"], foot["watched"] = -1, 0, 0
    foot["air_age"], foot["arch"], foot["bend"], foot["weight"] = 0.0, 0.0, 1.0, 0.0
    foot["toes_left"] = foot["toes"]
    follow_swing(foot, told, leg, dt, settings, bodies_at, bodies_turn)


@compiled
def place_lead(foot, told, settings):
    """How long before a known plant the foot sets out for its print, s; longer to turn it more."""
    time = settings["place_time"] * (_BALL_LEAD if foot["landing"] == TOES_DOWN else 1.0)
    return min(time, _LONGEST_LEAD * told["swing_time"])


@compiled
def ground_of(foot, bodies_at, bodies_turn):
    """Height of the print a foot stands on, or of the foothold it will take; inf for neither."""
    if foot["state"] == GROUNDED:
        point, _ = print_of(foot, bodies_at, bodies_turn)
    elif foot["plan"] == PLANNED:
        point, _ = landing(foot, bodies_at, bodies_turn)
    else:
        return math.inf
    return point[2]


@compiled
def give_up_late(foot, told, settings):
    """Mark a contact as spent where its leg cannot reach any more and its end is near anyway.

    A spent contact is released, and nothing is planted before the next one.
    """
    over = told["to_plant"] > 0.0
    if foot["spent"]:
        foot["spent"] = 0 if over or told["ahead"] == 0 else 1
    elif foot["state"] == GROUNDED and told["ahead"] and not over and foot["bump"] == 0:
        late = told["to_release"] < settings["give_up_time"]
        foot["spent"] = 1 if late and foot["missing"] > _MISSED * settings["size"] else 0


@compiled
def wants_ground(foot, told, settings):
    """Whether the foot shall be on the ground, or on its way there. No input makes it chatter."""
    if foot["spent"]:
        return False
    if told["ahead"]:
        if foot["state"] == GROUNDED and foot["bump"] == 0:
            # Times to a plant stretch with the motion's rate; what was set down stays so.
            placing = foot["stride_age"] < told["swing_time"]
            if placing and told["to_plant"] <= _LONGEST_LEAD * told["swing_time"]:
                return True
        return told["to_plant"] <= place_lead(foot, told, settings)
    if foot["state"] == GROUNDED:
        return told["weight"] > settings["weight_off"]
    return told["weight"] >= settings["weight_on"]


@compiled
def intend(foot, told, leg, may_bump, dt, probes, settings, bodies_at, bodies_turn):
    """Advance clocks, release, and ask this frame's probes (PROBES,).

    `may_bump`: every other foot is locked, so this one may take a stride of its own.
    """
    for k in range(PROBES):
        probes[k]["active"] = 0
    foot["stride_age"] += dt
    foot["air_age"] += dt
    foot["offset_age"] += dt
    if foot["known"] == 0:
        set3(foot["lift"], (told["ankle"][0], told["ankle"][1], told["root_z"]))
        set4(foot["lift_turn"], (1.0, 0.0, 0.0, 0.0))
    give_up_late(foot, told, settings)
    wants = wants_ground(foot, told, settings)
    if foot["state"] == GROUNDED and not wants:
        release(foot, told, leg, dt, settings, bodies_at, bodies_turn)
    if foot["state"] == GROUNDED:
        point, _ = print_of(foot, bodies_at, bodies_turn)
        length = settings["ground_above"] + told["below"]
        set_probe(probes[0], add_scaled(point, UP, settings["ground_above"]), _DOWN, length)
        intend_bump(foot, told, leg, may_bump, probes, settings, bodies_at, bodies_turn)
        return
    if foot["spent"]:
        return
    new = foot["plan"] != PLANNED or plan_moved(foot, told, settings)
    if new and (wants or told["ahead"]):
        lift = get3(foot["lift"]) if told["ahead"] else get3(told["ankle"])
        ask(foot, told, leg, lift, probes, settings)


@compiled
def carried_off(point, told, settings):
    """Whether ground that moves took a print so far from the animated foot that it must let go."""
    dx, dy = point[0] - told["ankle"][0], point[1] - told["ankle"][1]
    most = 2.0 * FORCED * settings["stride_distance"]
    up = abs(point[2] - told["root_z"])
    return dx * dx + dy * dy > most * most or up > 1.5 * settings["largest_step"]


@compiled
def stay_behind(foot, leg):
    """Put the print under where the foot was last frame, in the world."""
    out_turn = get4(foot["out_turn"])
    foot["body"] = 0
    set3(foot["hold"], add(get3(foot["out"]), rotate(out_turn, (0.0, 0.0, -leg["height"]))))
    set4(foot["hold_turn"], quat_yaw(quat_heading(out_turn)))


@compiled
def watch_ground(foot, told, hit, leg, dt, settings, bodies_at, bodies_turn):
    """Follow ground that sank or rose under a print; let go of ground that is gone."""
    point, turn = print_of(foot, bodies_at, bodies_turn)
    height = hit["point"][2] - point[2]
    if hit["hit"] == 1 and foot["watched"] == 0:
        foot["gap"], foot["watched"] = height, 1
    moved = height - foot["gap"]
    gone = hit["hit"] == 0 or abs(moved) > settings["largest_step"]
    if carried_off(point, told, settings):
        gone = True
        stay_behind(foot, leg)
    if gone:
        release(foot, told, leg, dt, settings, bodies_at, bodies_turn)
        return
    foot["floor"] = hit["geom"]
    if abs(moved) <= _FOLLOWED * settings["size"]:
        if hit["body"] == foot["body"]:
            return
        moved, foot["gap"] = 0.0, height  # the same place, on another body
    point = add_scaled(point, UP, moved)
    foot["body"] = hit["body"]
    held, held_turn = to_body(hit["body"], point, turn, bodies_at, bodies_turn)
    set3(foot["hold"], held)
    set4(foot["hold_turn"], held_turn)
    if abs(moved) > 1e-9:
        carry_over_stance(foot, leg, dt, settings, bodies_at, bodies_turn)


@compiled
def carry_over_stance(foot, leg, dt, settings, bodies_at, bodies_turn):
    """Carry over to the stance as it is now defined, from wherever the foot was last frame."""
    base, base_turn = stance(
        foot, foot["anim"], foot["anim_turn"], leg, settings, bodies_at, bodies_turn
    )
    carry_over(
        foot, get3(foot["out"]), get3(foot["out_speed"]), base, base_turn,
        settings["settle_time"], dt, settings,
    )  # fmt: skip


@compiled
def take_lock(foot, told, leg, dt, settings, bodies_at, bodies_turn):
    """Take the lock that the foot is told; what it changes is carried over."""
    before, foot["lock"] = foot["lock"], told["lock"]
    changed = before >= 0 and before != told["lock"]
    if changed and foot["state"] == GROUNDED and foot["bump"] == 0:
        carry_over_stance(foot, leg, dt, settings, bodies_at, bodies_turn)


@compiled
def move_print(foot, leg, dt, settings, bodies_at, bodies_turn):
    """Take the planned foothold for the print of a foot that goes over the ground as it likes."""
    take_foothold(foot)
    carry_over_stance(foot, leg, dt, settings, bodies_at, bodies_turn)


@compiled
def settle(foot, told, leg, hits, may_set_out, dt, settings, bodies_at, bodies_turn):
    """Hear this frame's hits (PROBES,), make the transitions they bring, and write the goal.

    `may_set_out`: no other foot began a bump stride in this frame. Feet ask before any is answered,
    so both may have asked at once.
    """
    take_lock(foot, told, leg, dt, settings, bodies_at, bodies_turn)
    again = foot["plan"] == ASKED_AGAIN
    asked = again or foot["plan"] == ASKED
    if asked:
        hear_foothold(foot, told, hits, leg, settings, bodies_at, bodies_turn)
    if foot["state"] == RELEASED:
        # Without a foothold as before, the swing is as before, and its offset goes on decaying.
        if asked and foot["known"] and not (again and foot["plan"] == NOWHERE):
            follow_swing(foot, told, leg, dt, settings, bodies_at, bodies_turn)
        if foot["plan"] == PLANNED and wants_ground(foot, told, settings):
            # A foot that knows nothing yet stands at once, but is in no hurry to a plant ahead.
            age, duration = 0.0, settings["place_time"] if foot["known"] else 0.0
            if told["ahead"] and told["to_plant"] > 0.0:
                duration = place_lead(foot, told, settings)
                age = duration - told["to_plant"]
            start_stride(foot, 0, age, duration)
    else:
        watch_ground(foot, told, hits[0], leg, dt, settings, bodies_at, bodies_turn)
        if foot["state"] == GROUNDED and asked and foot["plan"] == PLANNED:
            if loose(foot) == 1.0 and foot["bump"] == 0:
                move_print(foot, leg, dt, settings, bodies_at, bodies_turn)
            else:
                bump_to_plan(foot, told, leg, may_set_out, dt, settings, bodies_at, bodies_turn)
    write_goal(foot, told, leg, settings, bodies_at, bodies_turn)


@compiled
def grounded_pose(foot, told, leg, settings, bodies_at, bodies_turn):
    """Ankle and sole rotation of a grounded foot: blended onto its print, or stepping to it."""
    if foot["bump"]:
        return bump_pose(foot, told["turn"], leg, settings, bodies_at, bodies_turn)
    ankle, turn, root_z = get3(told["ankle"]), get4(told["turn"]), told["root_z"]
    base, base_turn = stance(
        foot, told["ankle"], told["turn"], leg, settings, bodies_at, bodies_turn
    )
    if foot["weight"] >= 1.0:
        return base, base_turn
    t = foot["stride_age"] / foot["stride_time"] if foot["stride_time"] > 0.0 else 1.0
    s = smooth_step(t)
    progress = swing_progress(foot, told, settings)
    start, start_turn = swinging(
        foot, leg, ankle, turn, root_z, progress, settings, bodies_at, bodies_turn
    )
    return set_down(
        foot, leg, start, start_turn, base, base_turn, s, progress, settings,
        bodies_at, bodies_turn,
    )  # fmt: skip


@compiled
def write_goal(foot, told, leg, settings, bodies_at, bodies_turn):
    """The goal of this frame, and what of the sole is held."""
    ankle, turn, root_z = get3(told["ankle"]), get4(told["turn"]), told["root_z"]
    foot["pin"], foot["locked"], foot["heel_lift"] = NO_PIN, 0, 0.0
    fading = 1.0 - smooth_step(foot["air_age"] / max(settings["release_time"], 1e-3))
    foot["toes"] = foot["toes_left"] * fading
    if foot["state"] == RELEASED:
        foot["weight"] = 0.0
        progress = swing_progress(foot, told, settings)
        base, base_turn = swinging(
            foot, leg, ankle, turn, root_z, progress, settings, bodies_at, bodies_turn
        )
        set3(foot["normal"], rotate(get4(foot["lift_turn"]), UP))
    else:
        _, print_turn = print_of(foot, bodies_at, bodies_turn)
        set3(foot["normal"], rotate(print_turn, UP))
        arrived = foot["stride_age"] >= foot["stride_time"]
        if arrived:
            foot["bump"] = 0
        t = 1.0 if arrived else foot["stride_age"] / foot["stride_time"]
        foot["weight"] = 1.0 if foot["bump"] else smooth_step(t)
        foot["toes"] = max(foot["toes"], foot["weight"])
        if arrived:
            # The first part of a known contact stands on the heel, which a lift would move.
            known = told["ahead"] and math.isfinite(told["to_release"])
            stood = -told["to_plant"] / _HEEL_STANCE if known else 1.0
            foot["heel_lift"] = smooth_step(stood)
            heel = stance_pitch(foot, turn, settings) > 0.0
            foot["pin"] = HEEL_PIN if heel else BALL_PIN
            held = foot["offset_age"] >= foot["offset_time"] and loose(foot) == 0.0
            foot["locked"] = 1 if held else 0
            if foot["lock"] != FULL_LOCK:
                foot["pin"] = BALL_PIN
                if foot["lock"] == ANKLE_LOCK and foot["locked"]:
                    foot["locked"] = 0  # the point that is held is none of the sole's
        if foot["landed"] != ON_HEEL:
            foot["heel_lift"] = foot["weight"]
        base, base_turn = grounded_pose(foot, told, leg, settings, bodies_at, bodies_turn)
    goal, goal_turn = with_offset(foot, base, base_turn)
    set3(foot["goal"], goal)
    set4(foot["goal_turn"], goal_turn)
