"""The record of a foot, and what a foot is told each frame."""

from __future__ import annotations

import numpy as np

from footik_runtime.compiled import compiled
from footik_runtime.math3d import clamp, get3, get4, scale, set3, set4, sub

RELEASED, GROUNDED = 0, 1
NO_PIN, HEEL_PIN, BALL_PIN = -1, 0, 1
ON_HEEL, HEEL_HANGS, TOES_DOWN = 0, 1, 2
NO_PLAN, ASKED, PLANNED, NOWHERE, ASKED_AGAIN = 0, 1, 2, 3, 4

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
        ("active", "i4"),
        ("share", "f8"),
        ("plant", "f8"),
        ("plant_to", "f8"),
        ("plant_speed", "f8"),
        ("lock", "i4"),
        ("rolled", "f8", 3),
        ("plan", "i4"),
        ("plan_place", "f8", 2),
        ("plan_yaw", "f8"),
        ("plan_ref", "f8"),
        ("plan_shift", "f8", 2),
        ("land", "f8", 3),
        ("land_turn", "f8", 4),
        ("land_floor", "i4"),
        ("land_body", "i4"),
        ("landing", "i4"),
        ("landed", "i4"),
        ("arch", "f8"),
        ("bend", "f8"),
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
        ("toes_left", "f8"),
        ("heel_lift", "f8"),
        ("lifted", "f8"),
        ("pin", "i4"),
        ("locked", "i4"),
        ("reached", "i4"),
        ("missing", "f8"),
        ("stretch", "f8"),
        ("turned_off", "f8"),
    ],
    align=True,
)
"""One foot of one character. Points in metres; *_turn are sole rotations (x forward, z up).

state: RELEASED or GROUNDED; bump: in a bump stride. floor, body: geom and body it stands on, -1.
weight: 0 follows the animation, 1 its print. hold, hold_turn: the print (under the ankle, on the
ground) in its body's frame; gap: height of the watched ground over it. from*: the print a bump
stride leaves. lift*: the print a swing or stride left, world; spent: the contact was given up;
active: switched on; share: 0 to 1, how much of what the foot is given the pose takes. plant,
plant_to, plant_speed: how much a planted foot keeps its place, what that goes to and how fast, 1/s;
lock: `LOCKS`, -1 before it is told. rolled: how far the ankle, held, would have moved in the frame
of release. plan*, land*: the foothold ahead, plan_shift: from where the animation would put the
foot; landing, landed: how it will land there, how it did here: ON_HEEL as the animation has it, or
on the ball, because its heel has no ground (HEEL_HANGS) or because it steps down (TOES_DOWN). arch,
bend: of the swing's line, as `bend_over` has them. offset*, twist*: what is carried over, and its
age. anim*, root_z, out*: last frame's animated ankle and final ankle, with the final one's
velocity. goal, goal_turn: of the ankle and sole, world; normal: of the plane it stands on, or left;
toes: how flat the toes lie on it, toes_left: when it was released; heel_lift: 0 to 1, how far its
heel may lift to reach; lifted: how far it did, rad. pin: the sole point that is held; locked: and
still. reached: whether the leg came to the goal; missing: by how much not, m; stretch: how many
times its length the leg has; turned_off: by what angle the limits of a robot's joints keep the foot
turned off its goal, rad.
"""

LOCKS = ("full", "ball", "ankle", "unlocked")
"""What a planted foot keeps: place and heading; the place of its ball, over which it may turn; that
of its ankle's print; or nothing but the ground under it, over which it goes with the animation."""

FULL_LOCK, BALL_LOCK, ANKLE_LOCK, UNLOCKED = range(4)

FOOT_INPUT = np.dtype(
    [
        ("weight", "f8"),
        ("to_plant", "f8"),
        ("to_release", "f8"),
        ("swing_time", "f8"),
        ("ahead", "i4"),
        ("progress", "f8"),
        ("place", "f8", 2),
        ("due", "f8", 2),
        ("yaw", "f8"),
        ("pitch", "f8"),
        ("lock", "i4"),
        ("below", "f8"),
        ("ankle", "f8", 3),
        ("turn", "f8", 4),
        ("root_z", "f8"),
    ],
    align=True,
)
"""What a foot is told each frame: its IK weight and its animated ankle and sole rotation, world.

Where the plant is known ahead (`ahead`): seconds to it (or minus the seconds since) and to the next
release, the swing's duration and how much of it is over, the print's place and yaw, world, where
the animation alone would put it (`due`), and the sole's pitch at the plant. Where it is not, place
and due are the animated ankle's. root_z: height of the ground the body walks on. lock: `LOCKS`.
below: how far under the ground the body walks on rays reach, m.
"""


@compiled
def switch_on(foot):
    """The foot's own switches as they are to begin with."""
    foot["active"], foot["share"] = 1, 1.0
    foot["plant"], foot["plant_to"], foot["plant_speed"] = 1.0, 1.0, 1.0
    foot["stretch"] = 1.0


@compiled
def advance_switches(foot, dt, settings):
    """Move a foot's share and plant weight towards what they are told."""
    step = dt / max(settings["blend_time"], 1e-9)
    foot["share"] = clamp(foot["share"] + (step if foot["active"] else -step), 0.0, 1.0)
    if foot["share"] == 0.0:
        reset_foot(foot)
    away = foot["plant_to"] - foot["plant"]
    most = foot["plant_speed"] * dt
    foot["plant"] += clamp(away, -most, most)


@compiled
def reset_foot(foot):
    """A released foot that knows nothing yet."""
    foot["state"], foot["bump"] = RELEASED, 0
    foot["floor"], foot["body"] = -1, 0
    foot["weight"], foot["plan"], foot["known"] = 0.0, NO_PLAN, 0
    foot["pin"], foot["locked"], foot["offset_time"] = NO_PIN, 0, 0.0
    foot["air_age"], foot["spent"], foot["bend"] = 1e9, 0, 1.0
    foot["reached"], foot["missing"], foot["turned_off"] = 1, 0.0, 0.0
    foot["toes"], foot["toes_left"] = 0.0, 0.0
    foot["landing"], foot["landed"], foot["lock"] = ON_HEEL, ON_HEEL, -1


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
