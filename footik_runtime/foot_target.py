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

import numpy as np

from footik_runtime.compiled import compiled
from footik_runtime.foothold import PATH, WINDOW, arch_over, ask_for_foothold, choose_foothold
from footik_runtime.inertia import decayed, limited_velocity, smooth_bump, smooth_step
from footik_runtime.math3d import (
    add,
    add_scaled,
    clamp,
    get3,
    get4,
    lerp,
    quat_axis_angle,
    quat_between,
    quat_conj,
    quat_from_rotvec,
    quat_heading,
    quat_mul,
    quat_nlerp,
    quat_slerp,
    quat_to_rotvec,
    quat_yaw,
    rotate,
    scale,
    set3,
    set4,
    sub,
    unrotate,
    wrap_angle,
)
from footik_runtime.probes import set_probe

RELEASED, GROUNDED = 0, 1
NO_PIN, HEEL_PIN, BALL_PIN = -1, 0, 1
NO_PLAN, ASKED, PLANNED, NOWHERE, ASKED_AGAIN = 0, 1, 2, 3, 4

PROBES = 1 + PATH + WINDOW
"""Probes of a foot: one that watches the ground of its print, and those of a foothold."""

_UP = (0.0, 0.0, 1.0)
_DOWN = (0.0, 0.0, -1.0)
_FOLLOWED = 1e-3  # m of ground movement under a print that is not worth following
_MISSED = 0.004  # m by which a leg may miss its goal before a contact is given up
_LATE = 0.85  # part of a bump stride after which its target stays where it is
_HEEL_STANCE = 0.2  # s after a plant in which more and more of a heel lift is allowed
_LONGEST_LEAD = 0.6  # part of a swing in which its foot may be set down
_SPOT = 0.1  # m; a swing that goes no further is told by time, not by place
_FORCED = 2.0  # times the stride distance at which a foot steps whatever the other foot does

FOOT = np.dtype(
    [
        ("state", "i4"),
        ("bump", "i4"),
        ("floor", "i4"),
        ("body", "i4"),
        ("weight", "f8"),
        ("stride_age", "f8"),
        ("stride_time", "f8"),
        ("hold", "f8", 3),
        ("hold_turn", "f8", 4),
        ("gap", "f8"),
        ("watched", "i4"),
        ("from", "f8", 3),
        ("from_turn", "f8", 4),
        ("from_body", "i4"),
        ("lift", "f8", 3),
        ("lift_turn", "f8", 4),
        ("air_age", "f8"),
        ("spent", "i4"),
        ("rolled", "f8", 3),
        ("plan", "i4"),
        ("plan_place", "f8", 2),
        ("plan_yaw", "f8"),
        ("plan_ref", "f8"),
        ("land", "f8", 3),
        ("land_turn", "f8", 4),
        ("land_floor", "i4"),
        ("land_body", "i4"),
        ("arch", "f8"),
        ("offset", "f8", 3),
        ("offset_speed", "f8", 3),
        ("twist", "f8", 3),
        ("offset_age", "f8"),
        ("offset_time", "f8"),
        ("known", "i4"),
        ("anim", "f8", 3),
        ("anim_turn", "f8", 4),
        ("root_z", "f8"),
        ("out", "f8", 3),
        ("out_turn", "f8", 4),
        ("out_speed", "f8", 3),
        ("goal", "f8", 3),
        ("goal_turn", "f8", 4),
        ("normal", "f8", 3),
        ("toes", "f8"),
        ("heel_lift", "f8"),
        ("pin", "i4"),
        ("locked", "i4"),
        ("reached", "i4"),
        ("missing", "f8"),
        ("drop", "f8"),
    ],
    align=True,
)
"""One foot of one character. Points in metres; *_turn are sole rotations (x forward, z up).

state: RELEASED or GROUNDED; bump: in a bump stride. floor, body: geom and body it stands on, -1.
weight: 0 follows the animation, 1 its print. hold, hold_turn: the print (under the ankle, on the
ground) in its body's frame; gap: height of the watched ground over it. from*: the print a bump
stride leaves. lift*: the print a swing or stride left, world; spent: the contact was given up;
rolled: how far the ankle, held, would have moved in the frame of release. plan*,
land*, arch: the foothold ahead. offset*, twist*: what is carried over, and its age. anim*, root_z,
out*: last frame's animated ankle and final ankle, with the final one's velocity. goal, goal_turn:
of the ankle and sole, world; normal: of the plane it stands on, or left; toes: how flat the toes
lie on it; heel_lift: 0 to 1, how far its heel may lift to reach. pin: the sole point that is held;
locked: and still. reached: whether the leg came to the goal; missing: by how much not, m; drop: of
the hips that it asks for, m.
"""

FOOT_INPUT = np.dtype(
    [
        ("weight", "f8"),
        ("to_plant", "f8"),
        ("to_release", "f8"),
        ("swing_time", "f8"),
        ("ahead", "i4"),
        ("place", "f8", 2),
        ("yaw", "f8"),
        ("pitch", "f8"),
        ("ankle", "f8", 3),
        ("turn", "f8", 4),
        ("root_z", "f8"),
    ],
    align=True,
)
"""What a foot is told each frame: its IK weight and its animated ankle and sole rotation, world.

Where the plant is known ahead (`ahead`): seconds to it (or minus the seconds since) and to the
next release, the swing's duration, the print's place and yaw, world, and the sole's pitch at the
plant. root_z: height of the ground the body walks on.
"""


@compiled
def reset_foot(foot):
    """A released foot that knows nothing yet."""
    foot["state"], foot["bump"] = RELEASED, 0
    foot["floor"], foot["body"] = -1, 0
    foot["weight"], foot["plan"], foot["known"] = 0.0, NO_PLAN, 0
    foot["pin"], foot["locked"], foot["offset_time"] = NO_PIN, 0, 0.0
    foot["air_age"], foot["spent"] = 1e9, 0
    foot["reached"], foot["missing"] = 1, 0.0


# --- frames of bodies ---------------------------------------------------------------------------


@compiled
def to_world(body, point, turn, bodies_at, bodies_turn):
    """A print in a body's frame, in the world; bodies_at (B, 3), bodies_turn (B, 4)."""
    if body <= 0 or body >= bodies_at.shape[0]:
        return point, turn
    at, by = get3(bodies_at[body]), get4(bodies_turn[body])
    return add(at, rotate(by, point)), quat_mul(by, turn)


@compiled
def to_body(body, point, turn, bodies_at, bodies_turn):
    """A print in the world, in a body's frame."""
    if body <= 0 or body >= bodies_at.shape[0]:
        return point, turn
    at, by = get3(bodies_at[body]), get4(bodies_turn[body])
    return unrotate(by, sub(point, at)), quat_mul(quat_conj(by), turn)


@compiled
def print_of(foot, bodies_at, bodies_turn):
    """The foot's own print, in the world."""
    return to_world(
        foot["body"], get3(foot["hold"]), get4(foot["hold_turn"]), bodies_at, bodies_turn
    )


# --- the poses a foot follows -------------------------------------------------------------------


@compiled
def sole_pitch(turn, flat):
    """How far the sole's nose points up, rad; what is less than about `flat` fades to zero."""
    ahead = rotate(turn, (1.0, 0.0, 0.0))
    pitch = math.atan2(ahead[2], math.sqrt(ahead[0] * ahead[0] + ahead[1] * ahead[1]))
    over = abs(pitch) - flat
    if over <= 0.0:
        return 0.0
    over = over * over / (over + flat)
    return over if pitch > 0.0 else -over


@compiled
def planted(point, turn, pitch, leg):
    """Ankle and sole rotation of a foot on its print, rolled by `pitch` over heel or ball."""
    rolled = quat_mul(turn, quat_axis_angle((0.0, 1.0, 0.0), -pitch))
    x = -leg["heel"] if pitch > 0.0 else leg["ball"]
    pinned = add(point, rotate(turn, (x, 0.0, 0.0)))
    return sub(pinned, rotate(rolled, (x, 0.0, -leg["height"]))), rolled


@compiled
def swing_progress(foot, told, settings):
    """How far the swing is from lift to landing: 0 to 1, eased."""
    if told["ahead"]:
        if foot["spent"]:
            return 0.0
        return max(1.0 - max(told["to_plant"], 0.0) / max(told["swing_time"], 1e-3), 0.0)
    return min(foot["air_age"] / max(settings["release_time"], 1e-3), 1.0)


@compiled
def progress_along(lift, land, ankle, otherwise):
    """How far an ankle is from lift to landing, seen from above: 0 to 1; `otherwise` on a spot."""
    x, y = land[0] - lift[0], land[1] - lift[1]
    length2 = x * x + y * y
    if length2 < _SPOT * _SPOT:
        return otherwise
    return clamp(((ankle[0] - lift[0]) * x + (ankle[1] - lift[1]) * y) / length2, 0.0, 1.0)


@compiled
def swinging(foot, ankle, turn, root_z, progress, bodies_at, bodies_turn):
    """Ankle and sole rotation of a swinging foot: the animation over the line lift to landing."""
    s = smooth_step(progress)
    lift = get3(foot["lift"])
    land, land_turn = (ankle[0], ankle[1], root_z), (1.0, 0.0, 0.0, 0.0)
    if foot["plan"] == PLANNED:
        land, land_turn = to_world(
            foot["land_body"], get3(foot["land"]), get4(foot["land_turn"]), bodies_at, bodies_turn
        )
        s = progress_along(lift, land, ankle, s)
    z = lift[2] * (1.0 - s) + land[2] * s + foot["arch"] * smooth_bump(progress)
    tilt = quat_nlerp(
        quat_between(_UP, rotate(get4(foot["lift_turn"]), _UP)),
        quat_between(_UP, rotate(land_turn, _UP)),
        s,
    )
    return (ankle[0], ankle[1], ankle[2] - root_z + z), quat_mul(tilt, turn)


# --- carrying differences over ------------------------------------------------------------------


@compiled
def carry_over(foot, start, speed, base, base_turn, duration, age):
    """Begin an offset from the pose that will be followed to where the foot was: `start`.

    `speed` (3,) is the foot's against what it will follow, m/s.
    `base`, `base_turn` are the value, `age` seconds ago, of what is followed from now on.
    """
    if foot["known"] == 0 or duration <= 0.0:
        foot["offset_time"] = 0.0
        return
    offset = sub(start, base)
    twist = quat_to_rotvec(quat_mul(get4(foot["out_turn"]), quat_conj(base_turn)))
    set3(foot["offset"], offset)
    set3(foot["offset_speed"], limited_velocity(offset, speed, duration))
    set3(foot["twist"], twist)
    foot["offset_age"], foot["offset_time"] = age, duration


@compiled
def with_offset(foot, base, base_turn):
    """The pose that is followed, with what is still carried over."""
    age, duration = foot["offset_age"], foot["offset_time"]
    if age >= duration:
        return base, base_turn
    offset = decayed(get3(foot["offset"]), get3(foot["offset_speed"]), age, duration)
    twist = decayed(get3(foot["twist"]), (0.0, 0.0, 0.0), age, duration)
    return add(base, offset), quat_mul(quat_from_rotvec(twist), base_turn)


# --- transitions --------------------------------------------------------------------------------


@compiled
def release(foot, told, leg, dt, settings, bodies_at, bodies_turn):
    """Let go of the ground: the foot swings from its print back to the animation."""
    point, turn = print_of(foot, bodies_at, bodies_turn)
    flat = settings["flat_angle"]
    now, _ = planted(point, turn, sole_pitch(get4(told["turn"]), flat), leg)
    before, _ = planted(point, turn, sole_pitch(get4(foot["anim_turn"]), flat), leg)
    set3(foot["rolled"], sub(now, before))
    set3(foot["lift"], point)
    set4(foot["lift_turn"], turn)
    foot["state"], foot["bump"], foot["plan"] = RELEASED, 0, NO_PLAN
    foot["floor"], foot["body"], foot["watched"] = -1, 0, 0
    foot["air_age"], foot["arch"], foot["weight"] = 0.0, 0.0, 0.0
    follow_swing(foot, told, dt, settings, bodies_at, bodies_turn)


@compiled
def follow_swing(foot, told, dt, settings, bodies_at, bodies_turn):
    """Carry over to the swing as it is now defined, from wherever the foot was last frame."""
    progress = swing_progress(foot, told, settings)
    now, _ = swinging(
        foot, get3(told["ankle"]), get4(told["turn"]), told["root_z"], progress,
        bodies_at, bodies_turn,
    )  # fmt: skip
    if told["ahead"] and told["to_plant"] > 0.0:
        # After the plant it has come to its end, and has stayed there.
        progress = max(progress - dt / max(told["swing_time"], 1e-3), 0.0)
    base, base_turn = swinging(
        foot, get3(foot["anim"]), get4(foot["anim_turn"]), foot["root_z"], progress,
        bodies_at, bodies_turn,
    )  # fmt: skip
    rate = 1.0 / dt if dt > 0.0 else 0.0
    speed = scale(sub(now, base), rate)
    start, start_speed, age = get3(foot["out"]), get3(foot["out_speed"]), dt
    if told["ahead"] and foot["air_age"] == 0.0 and foot["spent"] == 0:
        # It was free since the contact's end, not since the frame before: so any rate agrees.
        age = clamp(told["swing_time"] - told["to_plant"], 0.0, dt)
        base = add_scaled(now, speed, -age)
        start_speed = scale(get3(foot["rolled"]), rate)
        start = add_scaled(start, start_speed, dt - age)
    duration = settings["release_time"]
    if told["ahead"] and told["to_plant"] > 0.0:
        duration = min(duration, 0.8 * told["to_plant"])
    carry_over(foot, start, sub(start_speed, speed), base, base_turn, duration, age)


@compiled
def start_stride(foot, bump, age, duration):
    """Set out for the planned foothold: from the swing, or, in a bump, from the present print.

    A stride that is known ahead began when its time had come, not when a frame saw it: `age`.
    """
    if bump:
        set3(foot["from"], get3(foot["hold"]))
        set4(foot["from_turn"], get4(foot["hold_turn"]))
        foot["from_body"] = foot["body"]
    set3(foot["hold"], get3(foot["land"]))
    set4(foot["hold_turn"], get4(foot["land_turn"]))
    foot["floor"], foot["body"] = foot["land_floor"], foot["land_body"]
    foot["state"], foot["bump"], foot["watched"] = GROUNDED, bump, 0
    foot["stride_age"], foot["stride_time"] = age, duration


@compiled
def place_lead(told, settings):
    """How long before a known plant the foot sets out for its print, s."""
    return min(settings["place_time"], _LONGEST_LEAD * told["swing_time"])


@compiled
def give_up_late(foot, told, settings):
    """Mark a contact as spent where its leg cannot reach any more and its end is near anyway.

    A spent contact is released, and nothing is planted before the next one.
    """
    over = told["to_plant"] > 0.0
    if foot["spent"]:
        foot["spent"] = 0 if over or told["ahead"] == 0 else 1
    elif foot["state"] == GROUNDED and told["ahead"] and not over and foot["bump"] == 0:
        late = told["to_release"] < settings["hip_let_go"]
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
        return told["to_plant"] <= place_lead(told, settings)
    if foot["state"] == GROUNDED:
        return told["weight"] > settings["weight_off"]
    return told["weight"] >= settings["weight_on"]


@compiled
def astray(foot, told, leg, settings, bodies_at, bodies_turn):
    """How far a locked foot is from the animated one, in parts of what starts a bump stride."""
    point, turn = print_of(foot, bodies_at, bodies_turn)
    anim_turn = get4(told["turn"])
    home, _ = planted(point, turn, sole_pitch(anim_turn, settings["flat_angle"]), leg)
    dx, dy = told["ankle"][0] - home[0], told["ankle"][1] - home[1]
    turned = wrap_angle(quat_heading(anim_turn) - quat_heading(turn))
    far = math.sqrt(dx * dx + dy * dy) / settings["stride_distance"]
    return max(far, abs(turned) / settings["stride_angle"])


# --- a frame, before the rays -------------------------------------------------------------------


@compiled
def ask(foot, told, x, y, yaw, lift, probes, settings):
    """Ask for a foothold at a place; again, where there was none last time."""
    foot["plan"] = ASKED_AGAIN if foot["plan"] == NOWHERE else ASKED
    foot["plan_place"][0], foot["plan_place"][1], foot["plan_yaw"] = x, y, yaw
    foot["plan_ref"] = told["root_z"]
    ask_for_foothold(probes[1:], lift, x, y, yaw, told["root_z"], settings)


@compiled
def ask_under_animation(foot, told, lift, probes, settings):
    """Ask for a foothold where the animated foot is."""
    yaw = quat_heading(get4(told["turn"]))
    ask(foot, told, told["ankle"][0], told["ankle"][1], yaw, lift, probes, settings)


@compiled
def plan_moved(foot, x, y, settings):
    """Whether a place is so far from the one last looked at that it must be looked at again."""
    dx, dy = x - foot["plan_place"][0], y - foot["plan_place"][1]
    return dx * dx + dy * dy > settings["replan_distance"] ** 2


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
        length = settings["ground_above"] + settings["ground_below"]
        set_probe(probes[0], add_scaled(point, _UP, settings["ground_above"]), _DOWN, length)
        intend_bump(foot, told, leg, may_bump, probes, settings, bodies_at, bodies_turn)
        return
    if foot["spent"]:
        return
    if told["ahead"] and told["to_plant"] > -1.0:
        x, y = told["place"][0], told["place"][1]
        if foot["plan"] != PLANNED or plan_moved(foot, x, y, settings):
            ask(foot, told, x, y, told["yaw"], get3(foot["lift"]), probes, settings)
    elif wants:
        ask_under_animation(foot, told, get3(told["ankle"]), probes, settings)


@compiled
def intend_bump(foot, told, leg, may_bump, probes, settings, bodies_at, bodies_turn):
    """Ask for a better place where a locked foot is astray, or a bump stride's target moved."""
    if foot["bump"] and foot["stride_age"] < foot["stride_time"]:
        early = foot["stride_age"] < _LATE * foot["stride_time"]
        if early and plan_moved(foot, told["ankle"][0], told["ankle"][1], settings):
            ask_under_animation(foot, told, get3(foot["lift"]), probes, settings)
        return
    if foot["weight"] < 1.0:
        return
    far = astray(foot, told, leg, settings, bodies_at, bodies_turn)
    if far >= _FORCED or (far >= 1.0 and may_bump):
        # A bump stride lifts off its print, not where the last swing did.
        point, turn = print_of(foot, bodies_at, bodies_turn)
        set3(foot["lift"], point)
        set4(foot["lift_turn"], turn)
        ask_under_animation(foot, told, point, probes, settings)


# --- a frame, after the rays --------------------------------------------------------------------


@compiled
def hear_foothold(foot, told, hits, leg, settings, bodies_at, bodies_turn):
    """Turn the answered probes into the planned foothold."""
    x, y, yaw = foot["plan_place"][0], foot["plan_place"][1], foot["plan_yaw"]
    lift = get3(foot["lift"])
    found, point, turn, under = choose_foothold(
        hits[1:], lift, x, y, yaw, foot["plan_ref"], leg, settings
    )
    if not found:
        foot["plan"] = NOWHERE
        return
    foot["plan"] = PLANNED
    over = arch_over(hits[1:], foot["lift"][2], point[2], settings)
    foot["arch"] = max(over, settings["swing_lift"])
    hit = hits[1 + under]
    foot["land_floor"], foot["land_body"] = hit["geom"], hit["body"]
    point, turn = to_body(hit["body"], point, turn, bodies_at, bodies_turn)
    set3(foot["land"], point)
    set4(foot["land_turn"], turn)


@compiled
def carried_off(point, told, settings):
    """Whether ground that moves took a print so far from the animated foot that it must let go."""
    dx, dy = point[0] - told["ankle"][0], point[1] - told["ankle"][1]
    most = 2.0 * _FORCED * settings["stride_distance"]
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
    if hit["body"] == foot["body"] and abs(moved) <= _FOLLOWED * settings["size"]:
        return
    point = add_scaled(point, _UP, moved)
    foot["body"] = hit["body"]
    held, held_turn = to_body(hit["body"], point, turn, bodies_at, bodies_turn)
    set3(foot["hold"], held)
    set4(foot["hold_turn"], held_turn)
    if abs(moved) > 1e-9:
        pitch = sole_pitch(get4(foot["anim_turn"]), settings["flat_angle"])
        base, base_turn = planted(point, turn, pitch, leg)
        carry_over(
            foot, get3(foot["out"]), get3(foot["out_speed"]), base, base_turn,
            settings["settle_time"], dt,
        )  # fmt: skip


@compiled
def settle(foot, told, leg, hits, may_set_out, dt, settings, bodies_at, bodies_turn):
    """Hear this frame's hits (PROBES,), make the transitions they bring, and write the goal.

    `may_set_out`: no other foot began a bump stride in this frame. Feet ask before any is answered,
    so both may have asked at once.
    """
    again = foot["plan"] == ASKED_AGAIN
    asked = again or foot["plan"] == ASKED
    if asked:
        hear_foothold(foot, told, hits, leg, settings, bodies_at, bodies_turn)
    if foot["state"] == RELEASED:
        # Without a foothold as before, the swing is as before, and its offset goes on decaying.
        if asked and foot["known"] and not (again and foot["plan"] == NOWHERE):
            follow_swing(foot, told, dt, settings, bodies_at, bodies_turn)
        if foot["plan"] == PLANNED and wants_ground(foot, told, settings):
            age, duration = 0.0, settings["place_time"]
            if told["ahead"] and told["to_plant"] > 0.0:
                duration = place_lead(told, settings)
                age = duration - told["to_plant"]
            start_stride(foot, 0, age, duration if foot["known"] else 0.0)
    else:
        watch_ground(foot, told, hits[0], leg, dt, settings, bodies_at, bodies_turn)
        if foot["state"] == GROUNDED and asked and foot["plan"] == PLANNED:
            bump_to_plan(foot, told, leg, may_set_out, dt, settings, bodies_at, bodies_turn)
    write_goal(foot, told, leg, settings, bodies_at, bodies_turn)


@compiled
def bump_to_plan(foot, told, leg, may_set_out, dt, settings, bodies_at, bodies_turn):
    """Step to the planned foothold, or, in a bump stride already, move its target there."""
    under_way = foot["bump"] == 1 and foot["stride_age"] < foot["stride_time"]
    if not under_way:
        if may_set_out:
            carry_over_lift(foot, settings["stride_time"], dt)
            start_stride(foot, 1, 0.0, settings["stride_time"])
        return
    set3(foot["hold"], get3(foot["land"]))
    set4(foot["hold_turn"], get4(foot["land_turn"]))
    foot["floor"], foot["body"], foot["watched"] = foot["land_floor"], foot["land_body"], 0
    now, _ = grounded_pose(
        foot, told, get3(told["ankle"]), get4(told["turn"]), told["root_z"], leg, settings,
        bodies_at, bodies_turn,
    )  # fmt: skip
    age = foot["stride_age"]
    foot["stride_age"] = max(age - dt, 0.0)
    base, base_turn = grounded_pose(
        foot, told, get3(foot["anim"]), get4(foot["anim_turn"]), foot["root_z"], leg, settings,
        bodies_at, bodies_turn,
    )  # fmt: skip
    foot["stride_age"] = age
    # A foot under way keeps its speed: it would stop for a frame at every new target otherwise.
    speed = scale(sub(now, base), 1.0 / dt if dt > 0.0 else 0.0)
    speed = sub(get3(foot["out_speed"]), speed)
    carry_over(foot, get3(foot["out"]), speed, base, base_turn, foot["stride_time"] - age + dt, dt)


@compiled
def carry_over_lift(foot, duration, dt):
    """Carry over what the leg made of the last goal, such as a lifted heel, into a bump stride.

    Both are of the same frame, so that nothing is carried over from ground that moves.
    """
    offset, twist = with_offset(foot, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    base = sub(get3(foot["goal"]), offset)
    base_turn = quat_mul(quat_conj(twist), get4(foot["goal_turn"]))
    carry_over(foot, get3(foot["out"]), (0.0, 0.0, 0.0), base, base_turn, duration, dt)


@compiled
def grounded_pose(foot, told, ankle, turn, root_z, leg, settings, bodies_at, bodies_turn):
    """Ankle and sole rotation of a grounded foot: blended onto its print, or stepping to it."""
    pitch = sole_pitch(turn, settings["flat_angle"])
    point, print_turn = print_of(foot, bodies_at, bodies_turn)
    base, base_turn = planted(point, print_turn, pitch, leg)
    if foot["weight"] >= 1.0 and foot["bump"] == 0:
        return base, base_turn
    t = foot["stride_age"] / foot["stride_time"] if foot["stride_time"] > 0.0 else 1.0
    s = smooth_step(t)
    if foot["bump"]:
        start, start_turn = to_world(
            foot["from_body"], get3(foot["from"]), get4(foot["from_turn"]), bodies_at, bodies_turn
        )
        start, start_turn = planted(start, start_turn, pitch, leg)
        lift = max(settings["step_height"], foot["arch"]) * smooth_bump(t)
        moved = add_scaled(lerp(start, base, s), _UP, lift)
        return moved, quat_slerp(start_turn, base_turn, s)
    progress = swing_progress(foot, told, settings)
    start, start_turn = swinging(foot, ankle, turn, root_z, progress, bodies_at, bodies_turn)
    return lerp(start, base, s), quat_slerp(start_turn, base_turn, s)


@compiled
def write_goal(foot, told, leg, settings, bodies_at, bodies_turn):
    """The goal of this frame, and what of the sole is held."""
    ankle, turn, root_z = get3(told["ankle"]), get4(told["turn"]), told["root_z"]
    foot["pin"], foot["locked"], foot["heel_lift"] = NO_PIN, 0, 0.0
    if foot["state"] == RELEASED:
        foot["weight"] = 0.0
        progress = swing_progress(foot, told, settings)
        base, base_turn = swinging(foot, ankle, turn, root_z, progress, bodies_at, bodies_turn)
        set3(foot["normal"], rotate(get4(foot["lift_turn"]), _UP))
        fading = foot["air_age"] / max(settings["release_time"], 1e-3)
        foot["toes"] = 1.0 - smooth_step(fading)
    else:
        _, print_turn = print_of(foot, bodies_at, bodies_turn)
        set3(foot["normal"], rotate(print_turn, _UP))
        arrived = foot["stride_age"] >= foot["stride_time"]
        if arrived:
            foot["bump"] = 0
        t = 1.0 if arrived else foot["stride_age"] / foot["stride_time"]
        foot["weight"] = 1.0 if foot["bump"] else smooth_step(t)
        foot["toes"] = foot["weight"]
        if arrived:
            # The first part of a known contact stands on the heel, which a lift would move.
            known = told["ahead"] and math.isfinite(told["to_release"])
            stood = -told["to_plant"] / _HEEL_STANCE if known else 1.0
            foot["heel_lift"] = smooth_step(stood)
            heel = sole_pitch(turn, settings["flat_angle"]) > 0.0
            foot["pin"] = HEEL_PIN if heel else BALL_PIN
            foot["locked"] = 1 if foot["offset_age"] >= foot["offset_time"] else 0
        base, base_turn = grounded_pose(
            foot, told, ankle, turn, root_z, leg, settings, bodies_at, bodies_turn
        )
    goal, goal_turn = with_offset(foot, base, base_turn)
    set3(foot["goal"], goal)
    set4(foot["goal_turn"], goal_turn)


@compiled
def remember(foot, told, ankle, turn, dt):
    """Keep what the leg made of the goal, for the offsets of later frames."""
    if foot["known"] == 0 or dt <= 0.0:
        set3(foot["out_speed"], (0.0, 0.0, 0.0))
    else:
        set3(foot["out_speed"], scale(sub(ankle, get3(foot["out"])), 1.0 / dt))
    set3(foot["out"], ankle)
    set4(foot["out_turn"], turn)
    set3(foot["anim"], get3(told["ankle"]))
    set4(foot["anim_turn"], get4(told["turn"]))
    foot["root_z"] = told["root_z"]
    foot["known"] = 1
