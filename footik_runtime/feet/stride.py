"""Bump strides: the step of its own that a grounded foot makes where it must stand elsewhere."""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.feet.carry import carry_over, with_offset
from footik_runtime.feet.footprint import UP, planted, print_of, stance_pitch, to_world
from footik_runtime.feet.lock import loose
from footik_runtime.feet.plan import ask, ask_under, plan_moved
from footik_runtime.feet.record import GROUNDED
from footik_runtime.inertia import smooth_bump, smooth_step
from footik_runtime.math3d import (
    add_scaled,
    get3,
    get4,
    lerp,
    quat_conj,
    quat_heading,
    quat_mul,
    quat_slerp,
    scale,
    set3,
    set4,
    sub,
    wrap_angle,
)

_LATE = 0.85  # part of a bump stride after which its target stays where it is
FORCED = 2.0  # times the stride distance at which a foot steps whatever the other foot does


@compiled
def take_foothold(foot):
    """The planned foothold is the foot's print."""
    set3(foot["hold"], get3(foot["land"]))
    set4(foot["hold_turn"], get4(foot["land_turn"]))
    foot["floor"], foot["body"], foot["watched"] = foot["land_floor"], foot["land_body"], 0
    foot["landed"] = foot["landing"]


@compiled
def start_stride(foot, bump, age, duration):
    """Set out for the planned foothold: from the swing, or, in a bump, from the present print.

    A stride that is known ahead began when its time had come, not when a frame saw it: `age`.
    """
    if bump:
        set3(foot["from"], get3(foot["hold"]))
        set4(foot["from_turn"], get4(foot["hold_turn"]))
        foot["from_body"] = foot["body"]
    take_foothold(foot)
    foot["state"], foot["bump"] = GROUNDED, bump
    foot["stride_age"], foot["stride_time"] = age, duration


@compiled
def stays(told):
    """Whether a planted foot has no next step of its own."""
    return told["ahead"] == 0 or not math.isfinite(told["to_release"])


@compiled
def astray(foot, told, leg, settings, bodies_at, bodies_turn):
    """How far a locked foot is from where it should be, in parts of what starts a bump stride.

    That is its told place, or, where it will step on, the animated foot: the place of a contact
    that has begun would follow every change of the command.
    """
    here, turn = print_of(foot, bodies_at, bodies_turn)
    x, y, yaw = told["place"][0], told["place"][1], told["yaw"]
    if not stays(told):
        x, y, yaw = told["ankle"][0], told["ankle"][1], quat_heading(get4(told["turn"]))
    if told["ahead"] == 0 or not stays(told):  # the animated ankle rolls over heel and ball
        here, _ = planted(here, turn, stance_pitch(foot, get4(told["turn"]), settings), leg)
    dx, dy = x - here[0], y - here[1]
    turned = wrap_angle(yaw - quat_heading(turn))
    far = math.sqrt(dx * dx + dy * dy) / settings["stride_distance"]
    return max(far, abs(turned) / settings["stride_angle"])


@compiled
def intend_bump(foot, told, leg, may_bump, probes, settings, bodies_at, bodies_turn):
    """Ask for a better place where a locked foot is astray, or a bump stride's target moved."""
    if foot["bump"] and foot["stride_age"] < foot["stride_time"]:
        early = foot["stride_age"] < _LATE * foot["stride_time"]
        if early and plan_moved(foot, told, settings):
            ask(foot, told, leg, get3(foot["lift"]), probes, settings)
        return
    if foot["weight"] < 1.0:
        return
    if loose(foot) == 1.0:
        here, _ = print_of(foot, bodies_at, bodies_turn)
        x, y = told["ankle"][0] - here[0], told["ankle"][1] - here[1]
        if x * x + y * y > settings["replan_distance"] ** 2:
            ask_under(foot, told, leg, probes, settings)
        return
    far = astray(foot, told, leg, settings, bodies_at, bodies_turn)
    # A foot that will soon step anyway steps then, unless it is left far behind.
    if far >= FORCED or (far >= 1.0 and may_bump and stays(told)):
        # A bump stride lifts off its print, not where the last swing did.
        point, turn = print_of(foot, bodies_at, bodies_turn)
        set3(foot["lift"], point)
        set4(foot["lift_turn"], turn)
        ask(foot, told, leg, point, probes, settings)


@compiled
def bump_to_plan(foot, told, leg, may_set_out, dt, settings, bodies_at, bodies_turn):
    """Step to the planned foothold, or, in a bump stride already, move its target there."""
    under_way = foot["bump"] == 1 and foot["stride_age"] < foot["stride_time"]
    if not under_way:
        if may_set_out:
            carry_over_lift(foot, settings["stride_time"], dt, settings)
            start_stride(foot, 1, 0.0, settings["stride_time"])
        return
    take_foothold(foot)
    now, _ = bump_pose(foot, told["turn"], leg, settings, bodies_at, bodies_turn)
    age = foot["stride_age"]
    foot["stride_age"] = max(age - dt, 0.0)
    base, base_turn = bump_pose(foot, foot["anim_turn"], leg, settings, bodies_at, bodies_turn)
    foot["stride_age"] = age
    # A foot under way keeps its speed: it would stop for a frame at every new target otherwise.
    speed = scale(sub(now, base), 1.0 / dt if dt > 0.0 else 0.0)
    speed = sub(get3(foot["out_speed"]), speed)
    carry_over(
        foot,
        get3(foot["out"]),
        speed,
        base,
        base_turn,
        foot["stride_time"] - age + dt,
        dt,
        settings,
    )


@compiled
def carry_over_lift(foot, duration, dt, settings):
    """Carry over what the leg made of the last goal, such as a lifted heel, into a bump stride.

    Both are of the same frame, so that nothing is carried over from ground that moves.
    """
    offset, twist = with_offset(foot, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    base = sub(get3(foot["goal"]), offset)
    base_turn = quat_mul(quat_conj(twist), get4(foot["goal_turn"]))
    carry_over(foot, get3(foot["out"]), (0.0, 0.0, 0.0), base, base_turn, duration, dt, settings)


@compiled
def bump_pose(foot, anim_turn, leg, settings, bodies_at, bodies_turn):
    """Ankle and sole rotation of a foot in a bump stride, rolled as its animated sole (4,) is."""
    pitch = stance_pitch(foot, get4(anim_turn), settings)
    end, end_turn = print_of(foot, bodies_at, bodies_turn)
    end, end_turn = planted(end, end_turn, pitch, leg)
    start, start_turn = to_world(
        foot["from_body"], get3(foot["from"]), get4(foot["from_turn"]), bodies_at, bodies_turn
    )
    start, start_turn = planted(start, start_turn, pitch, leg)
    t = foot["stride_age"] / foot["stride_time"] if foot["stride_time"] > 0.0 else 1.0
    s = smooth_step(t)
    lift = max(settings["step_height"], foot["arch"]) * smooth_bump(t)
    return add_scaled(lerp(start, end, s), UP, lift), quat_slerp(start_turn, end_turn, s)
