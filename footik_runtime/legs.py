"""Legs: what the goal of each foot makes of the pose, hip to toes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from footik_runtime.compiled import compiled
from footik_runtime.hock import folding_hock, three_bone, turns_at_hock, unfolded_length
from footik_runtime.leg_ik import (
    heel_lift,
    knee_direction,
    soft_stretch,
    turned_knee,
    two_bone,
)
from footik_runtime.math3d import (
    add,
    clamp,
    dot,
    get3,
    get4,
    norm,
    quat_axis_angle,
    quat_between,
    quat_conj,
    quat_mul,
    quat_nlerp,
    rotate,
    set4,
    sub,
    unit,
)
from footik_runtime.quat_arrays import conj
from footik_runtime.quat_arrays import rotate as rotate_array
from footik_runtime.rig import Leg, Rig

_STRAIGHTEST = 0.998
"""Part of a leg's length that no goal may ask for more of: a straighter knee pops."""

_CLEAR = 0.05
"""Part of a leg that a knee lies off the line from hip to ankle, for its side to be clear.

One that lies clearly behind is an elbow; so is any of a front leg that does not lie clearly ahead.
"""

LEG = np.dtype(
    [
        ("hip", "i4"),
        ("knee", "i4"),
        ("hock", "i4"),
        ("turns_hock", "i4"),
        ("ankle", "i4"),
        ("toe", "i4"),
        ("length", "f8"),
        ("height", "f8"),
        ("heel", "f8"),
        ("ball", "f8"),
        ("tip", "f8"),
        ("half_width", "f8"),
        ("frame", "f8", 4),
        ("toe_frame", "f8", 4),
        ("hinge", "f8", 3),
        ("side", "f8"),
    ],
    align=True,
)
"""A `Leg` and its `Sole` for compiled code.

hinge: the knee's axis in the hip joint's frame, pointing left at rest, or right where the knee
points back. hock: the joint that folds with the knee, -1 for none; turns_hock: it, not the knee, is
where the leg's two parts meet; length: with that joint as far open as `hock.FOLDS`; side: 1
for a left leg, -1 for a right one, 0 between.
"""


def leg_records(rig: Rig) -> NDArray[np.void]:
    """(legs,) of `LEG`."""
    out = np.zeros(len(rig.legs), dtype=LEG)
    at, rest = rig.skeleton.rest_pose()
    left = np.cross([0.0, 0.0, 1.0], rig.forward)
    middle = at[[leg.hip for leg in rig.legs]].mean(axis=0)
    for record, leg, length in zip(out, rig.legs, rig.leg_lengths, strict=True):
        sole = leg.sole
        for name in ("hip", "knee", "ankle", "toe"):
            record[name] = getattr(leg, name)
        for name in ("height", "heel", "ball", "tip", "half_width", "frame", "toe_frame"):
            record[name] = getattr(sole, name)
        record["hock"] = folding_hock(rig, leg)
        record["turns_hock"] = turns_at_hock(rig, leg)
        record["length"] = length if record["hock"] < 0 else unfolded_length(rig, leg)
        record["side"] = np.sign(np.round((at[leg.hip] - middle) @ left, 6))
        clear = _CLEAR if leg.name.endswith("front") else -_CLEAR
        back = _knee_ahead(at, leg, rig.forward) < clear * length
        record["hinge"] = rotate_array(conj(rest[leg.hip]), -left if back else left)
    return out


def _knee_ahead(at: NDArray[np.float64], leg: Leg, forward: NDArray[np.float64]) -> float:
    """How far the knee lies ahead of the line from hip to ankle, m, in places at (J, 3)."""
    thigh, line = at[leg.knee] - at[leg.hip], at[leg.ankle] - at[leg.hip]
    part = float(thigh @ line) / max(float(line @ line), 1e-12)
    return float((thigh - part * line) @ forward)


@compiled
def usable(leg, extension, settings):
    """How long a leg may be made, m: what the setting says, or the animated leg's own extension."""
    length = leg["length"]
    return clamp(extension, settings["reach"] * length, _STRAIGHTEST * length)


@compiled
def lifted(leg, hip, goal, goal_turn, reach, held, settings):
    """The goal with its heel raised over the ball as far as the leg is too short for it.

    The ball stays where it is; `held` scales the angle, which is returned last, rad.
    """
    ball = add(goal, rotate(goal_turn, (leg["ball"], 0.0, -leg["height"])))
    axis = rotate(goal_turn, (0.0, 1.0, 0.0))
    angle = held * min(heel_lift(hip, goal, ball, axis, reach), settings["max_heel_lift"])
    if angle <= 0.0:
        return goal, goal_turn, 0.0
    turn = quat_axis_angle(axis, angle)
    return add(ball, rotate(turn, sub(goal, ball))), quat_mul(turn, goal_turn), angle


@compiled
def lie_toes(leg, foot, sole_turn, normal, share, parents, local):
    """Bend the toes so that they stay flat on the plane while the heel is up, by a share."""
    ahead = rotate(sole_turn, (1.0, 0.0, 0.0))
    pitch = min(math.asin(clamp(dot(ahead, normal), -1.0, 1.0)), 0.0)
    flat = quat_mul(sole_turn, quat_axis_angle((0.0, 1.0, 0.0), pitch))
    toes = quat_mul(flat, quat_conj(get4(leg["toe_frame"])))
    # Between ankle and toes there may be joints that follow the foot.
    bent = quat_mul(quat_conj(foot), toes)
    set4(local[leg["toe"]], quat_nlerp(get4(local[leg["toe"]]), bent, share))


@compiled
def knee_pole(leg, hip, knee, ankle, goal, goal_turn, hinge, settings):
    """Where the knee shall point: as the animation bends it, turned as the settings say."""
    line = unit(sub(ankle, hip), unit(sub(knee, hip), (0.0, 0.0, -1.0)))
    toward = unit(sub(goal, hip), line)
    bent = rotate(quat_between(line, toward), knee_direction(hip, knee, ankle, hinge))
    toes = rotate(goal_turn, (1.0, 0.0, 0.0))
    return turned_knee(bent, toward, toes, settings, leg["side"])


@compiled
def pose_leg(leg, down, goal, goal_turn, held, toes, normal, parents, settings, local, at, turn):
    """Pose one leg for a goal of its ankle and sole, into the local rotations (J, 4).

    Args:
        leg: `LEG`.
        down: (3,) how far the hips are moved from the world pose `at`, m.
        goal, goal_turn: of the ankle joint and the sole, world.
        held: 0 to 1, how much the foot is on the ground: so much may the heel lift over the ball
            where the leg is too short.
        toes, normal: how much the toes lie flat, and on which plane.
        parents: (J,) of the skeleton.
        settings: `SETTINGS`.
        local: (J, 4) read and written.
        at, turn: (J, 3), (J, 4) animated pose of the leg's joints, world, before that.

    Returns:
        The ankle (3,) and sole rotation that the leg came to, whether that is the goal, by how
        much it is not, m, by what angle the heel was lifted, rad, and how many times their length
        thigh and shin have.
    """
    hip = add(get3(at[leg["hip"]]), down)
    knee = add(get3(at[leg["knee"]]), down)
    ankle = add(get3(at[leg["ankle"]]), down)
    reach = usable(leg, norm(sub(ankle, hip)), settings)
    goal, goal_turn, lift = lifted(leg, hip, goal, goal_turn, reach, held, settings)
    foot = quat_mul(goal_turn, quat_conj(get4(leg["frame"])))
    hip_turn, knee_turn = get4(turn[leg["hip"]]), get4(turn[leg["knee"]])
    hinge = rotate(hip_turn, get3(leg["hinge"]))
    pole, most = (0.0, 0.0, 0.0), settings["max_stretch"]
    if settings["knee_toe"] > 0.0 or settings["knee_out"] != 0.0:
        pole = knee_pole(leg, hip, knee, ankle, goal, goal_turn, hinge, settings)
    if leg["hock"] >= 0:
        most = 1.0
        hock = add(get3(at[leg["hock"]]), down)
        thigh, shin, below, came_to, reached = three_bone(
            hip, knee, hock, ankle, goal, hinge, reach, leg["turns_hock"]
        )
    else:
        thigh, shin, came_to, reached = two_bone(hip, knee, ankle, goal, hinge, reach, pole, most)
        below = shin
    # All other joints between hip, knee and ankle keep their local rotations and ride along.
    above = parents[leg["hip"]]
    over_hip = get4(turn[above]) if above >= 0 else (1.0, 0.0, 0.0, 0.0)
    over_knee = quat_mul(thigh, get4(turn[parents[leg["knee"]]]))
    if leg["hock"] >= 0:
        over_hock = quat_mul(shin, get4(turn[parents[leg["hock"]]]))
        hock_turn = quat_mul(below, get4(turn[leg["hock"]]))
        set4(local[leg["hock"]], quat_mul(quat_conj(over_hock), hock_turn))
    over_ankle = quat_mul(below, get4(turn[parents[leg["ankle"]]]))
    set4(local[leg["hip"]], quat_mul(quat_conj(over_hip), quat_mul(thigh, hip_turn)))
    set4(local[leg["knee"]], quat_mul(quat_conj(over_knee), quat_mul(shin, knee_turn)))
    set4(local[leg["ankle"]], quat_mul(quat_conj(over_ankle), foot))
    if leg["toe"] >= 0 and toes > 0.0:
        lie_toes(leg, foot, goal_turn, normal, toes, parents, local)
    _, stretch = soft_stretch(norm(sub(goal, hip)), reach, leg["length"], most)
    return came_to, goal_turn, reached, norm(sub(goal, came_to)), lift, stretch
