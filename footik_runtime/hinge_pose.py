"""Hinge pose: what a robot's joints make of the goals of its feet, frame by frame, compiled.

The crowd's rooms say where each foot shall be, as for any character. Here the hinges of each leg
are solved for it within their limits, and the record of the foot is told where it really came to.
"""

from __future__ import annotations

from collections import namedtuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from footik_runtime.clip import cubic_weights
from footik_runtime.compiled import compiled
from footik_runtime.crowd import Crowd
from footik_runtime.feet.record import BALL_PIN, HEEL_PIN
from footik_runtime.hinge_character import HingeCharacter
from footik_runtime.hinge_ik import (
    clamp_hinges,
    forward_hinges,
    goal_weights,
    new_work,
    solve_hinges,
)
from footik_runtime.hinge_values import joint_values
from footik_runtime.inertia import smooth_step
from footik_runtime.legs import leg_records
from footik_runtime.math3d import (
    TINY,
    add,
    get3,
    get4,
    lerp,
    norm,
    quat_angle,
    quat_conj,
    quat_heading,
    quat_mul,
    quat_slerp,
    quat_yaw,
    rotate,
    scale,
    set3,
    set4,
    sub,
)
from footik_runtime.motion import Motion

Array = NDArray[np.float64]

_REACHED = 1.5e-4  # of the leg's length, 0.1 mm for a robot of human size
_HELD = 0.5  # of its weight: what a rotation weighs about a point that is held
_NEARER = 0.25  # of the square of what is missing: a leg changes its mind for no less
_TURNED = 1e-3  # rad: a foot turned off by less is where it shall be
_POINT_HALF_LIFE = 0.02  # s, in which the point that is held moves along the sole to the next
_CORRECTION_HALF_LIFE = 0.5  # s: hinges that nothing asks for drift back to the motion's angles

Robot = namedtuple("Robot", "hinges legs chains feet root_level table")
"""What does not change: of a `HingeCharacter`, its `LEG` records (L,), the root's rotation at rest
undone, and the motion's joint values (T + 2, N), one frame of the loop more at either end."""

Held = namedtuple("Held", "values angles anew corrections points ankles known turns work")
"""What is kept: joint values (N,), angles (L, most), others to compare them with (most,), what the
last frame added to the motion's (L, most), the sole points (L, 3) that places are asked for, where
the ankles came to (L, 3) and whether that is known (L,), and the soles' rotations (L, 4)."""


@compiled
def sample_values(table, frame, part, hinges, values):
    """Write the motion's joint values (N,) at a frame and part, within the joints' limits."""
    a, b, c, d = cubic_weights(part)
    for n in range(values.shape[0]):
        values[n] = (
            a * table[frame, n] + b * table[frame + 1, n] + c * table[frame + 2, n]
            + d * table[frame + 3, n]
        )  # fmt: skip
    clamp_hinges(hinges, values)


@compiled
def _sole_point(leg, pin):
    """The point of the sole that is held, in the sole's frame; the ankle where none is."""
    if pin == HEEL_PIN:
        return (-leg["heel"], 0.0, -leg["height"])
    if pin == BALL_PIN:
        return (leg["ball"], 0.0, -leg["height"])
    return (0.0, 0.0, 0.0)


@compiled
def _wanted(body, foot, leg, point):
    """Where the foot shall be, where the leg of the skeleton came to, and the sole's rotation.

    The first differs from the foot's goal where the heel was lifted about the ball, and while foot
    IK fades in or out. A foot that is a point has no heel to lift.
    """
    share = smooth_step(body["blend"])
    goal, turn = get3(foot["goal"]), get4(foot["goal_turn"])
    if share < 1.0:
        goal = lerp(get3(foot["anim"]), goal, share)
        turn = quat_slerp(get4(foot["anim_turn"]), turn, share)
    if point:
        return goal, goal, turn
    over_ball = (leg["ball"], 0.0, -leg["height"])
    lifted = get4(foot["out_turn"])
    goal = sub(add(goal, rotate(turn, over_ball)), rotate(lifted, over_ball))
    return goal, get3(foot["out"]), lifted


@compiled
def _begin_anew(hinges, angles, held, base, point, goal, weights, off, turned):
    """Where the angles miss their goal, take those found from the motion's, if they are nearer.

    A leg that was folded by a goal out of its reach would else stay so.
    """
    count = hinges.shape[0]
    other = held.anew[:count]
    for h in range(count):
        other[h] = held.values[hinges[h]["column"]]
    new_off, new_turned = solve_hinges(hinges, other, base, point, goal, weights, held.work)
    before = off * off + (weights[1] * turned) ** 2
    if new_off * new_off + (weights[1] * new_turned) ** 2 < _NEARER * before:
        for h in range(count):
            angles[h] = other[h]


@compiled
def _solve_leg(i, root, root_turn, target, sole_turn, robot, held, keep):
    """Solve one leg's own hinges; returns where its ankle and sole came to."""
    part, leg, chain = robot.legs[i], robot.feet[i], robot.chains[i]
    trunk, count = part["trunk"], part["count"]
    angles, corrections = held.angles[i], held.corrections[i]
    for h in range(count):
        angles[h] = held.values[chain[h]["column"]]
    base = forward_hinges(
        chain[:trunk], angles[:trunk], root, root_turn, held.work.axes, held.work.anchors
    )
    for h in range(trunk, count):
        angles[h] += keep * corrections[h]
    to_sole = quat_mul(get4(part["tail_turn"]), get4(leg["frame"]))
    on_sole = get3(held.points[i])
    point = add(get3(part["tail"]), rotate(to_sole, on_sole))
    goal = (add(target, rotate(sole_turn, on_sole)), quat_mul(sole_turn, quat_conj(to_sole)))
    # A point that is held must not give way; the foot turns about it, as a heel that lifts does.
    free = 1.0 - min(norm(on_sole) / max(leg["height"], TINY), 1.0)
    place_weight, turn_weight = goal_weights(count - trunk, leg["length"], part["point"])
    weights = (place_weight, turn_weight * (_HELD + (1.0 - _HELD) * free))
    own, mine = chain[trunk:count], angles[trunk:count]
    off, turned = solve_hinges(own, mine, base, point, goal, weights, held.work)
    if off > _REACHED * leg["length"]:
        _begin_anew(own, mine, held, base, point, goal, weights, off, turned)
    for h in range(trunk, count):
        corrections[h] = angles[h] - held.values[chain[h]["column"]]
        held.values[chain[h]["column"]] = angles[h]
    place, turn = forward_hinges(own, mine, base[0], base[1], held.work.axes, held.work.anchors)
    ankle = add(place, rotate(turn, get3(part["tail"])))
    return ankle, sole_turn if part["point"] else quat_mul(turn, to_sole)


@compiled
def _tell_foot(foot, leg, goal, wanted_turn, ankle, turn, dt, last, known):
    """Write into a foot's record where its hinges brought it, and what is missing."""
    held = _sole_point(leg, foot["pin"])
    off = sub(add(goal, rotate(wanted_turn, held)), add(ankle, rotate(turn, held)))
    foot["missing"], foot["turned_off"] = norm(off), quat_angle(wanted_turn, turn)
    there = foot["missing"] <= _REACHED * leg["length"]
    foot["reached"] = 1 if there and foot["turned_off"] <= _TURNED else 0
    if not there:
        foot["locked"] = 0
    speed = (0.0, 0.0, 0.0)
    if known and dt > 0.0:
        speed = scale(sub(ankle, last), 1.0 / dt)
    set3(foot["out_speed"], speed)
    set3(foot["out"], ankle)
    set4(foot["out_turn"], turn)


@compiled
def place_feet(body, feet, root, root_turn, robot, held, dt):
    """Solve the hinges of every leg of one character for its feet's goals, into `held.values`."""
    keep = 0.5 ** (dt / _CORRECTION_HALF_LIFE)
    stay = 0.5 ** (dt / _POINT_HALF_LIFE)
    for i in range(feet.shape[0]):
        foot, leg = feet[i], robot.feet[i]
        if not robot.legs[i]["point"]:
            pinned = _sole_point(leg, foot["pin"])
            set3(held.points[i], lerp(pinned, get3(held.points[i]), stay))
        goal, target, wanted_turn = _wanted(body, foot, leg, robot.legs[i]["point"])
        ankle, turn = _solve_leg(i, root, root_turn, target, wanted_turn, robot, held, keep)
        _tell_foot(
            foot, leg, goal, wanted_turn, ankle, turn, dt, get3(held.ankles[i]), held.known[i]
        )
        set3(held.ankles[i], ankle)
        set4(held.turns[i], turn)
        held.known[i] = 1


@compiled
def leave_feet(root_turn, robot, held):
    """Leave the legs to the motion: nothing is known of them when they are placed next."""
    heading = quat_yaw(quat_heading(quat_mul(root_turn, get4(robot.root_level))))
    for i in range(held.known.shape[0]):
        held.known[i] = 0
        set3(held.points[i], (0.0, 0.0, 0.0))
        set4(held.turns[i], quat_mul(heading, get4(robot.legs[i]["level"])))
        for h in range(held.corrections.shape[1]):
            held.corrections[i, h] = 0.0


@compiled
def pose_hinges(bodies, feet, roots, rotations, row, placed, robot, held, dt):
    """Pose one row of a crowd by its hinges, into `held.values`; `placed`: its feet have goals.

    Called from Python for every frame, so it is given plain tuples for `Robot` and `Held`.
    """
    body = bodies[row]
    fixed, state = Robot(*robot), Held(*held)
    sample_values(fixed.table, body["frame"], body["part"], fixed.hinges, state.values)
    root_turn = get4(rotations[row, 0])
    if placed:
        place_feet(body, feet[row], get3(roots[row]), root_turn, fixed, state, dt)
    else:
        leave_feet(root_turn, fixed, state)


class HingePose:
    """Writes a crowd's character to the qpos of a robot: its root, its hinges and its balls.

    Attributes:
        character: the robot.
        values: (N,) rad, its hinges now.
        point_turns: (L, 4) the soles' world rotations now, for `HingeCharacter.world_pose`.
    """

    def __init__(self, character: HingeCharacter, motion: Motion) -> None:
        """Find the motion's joint values. Raises FootIKError for a motion of another skeleton."""
        self.character = character
        legs, most = character.chains.shape
        values = joint_values(character, motion.clip)
        pad = [len(values) - 2, *range(len(values)), 1]
        self.values = values[0].copy()
        self.point_turns = np.tile([1.0, 0.0, 0.0, 0.0], (legs, 1))
        self._robot = Robot(
            hinges=character.hinges,
            legs=character.legs,
            chains=character.chains,
            feet=leg_records(motion.rig),
            root_level=motion.rig.skeleton.rest_rotations[0] * [1.0, -1.0, -1.0, -1.0],
            table=np.ascontiguousarray(values[pad]),
        )
        self._held = Held(
            values=self.values,
            angles=np.zeros((legs, most)),
            anew=np.zeros(most),
            corrections=np.zeros((legs, most)),
            points=np.zeros((legs, 3)),
            ankles=np.zeros((legs, 3)),
            known=np.zeros(legs, dtype=np.int32),
            turns=self.point_turns,
            work=new_work(most),
        )

    def write(self, data: mujoco.MjData, crowd: Crowd, dt: float, row: int = 0) -> None:
        """Pose one of a crowd's characters, dt seconds after the last time, and write its qpos.

        Its feet's records are told what the hinges reached. Call `mj_kinematics` next.
        """
        roots, rotations, body = crowd.roots, crowd.rotations, crowd.bodies[row]
        fading = crowd.openkcc is None and body["blend"] > 0.0  # OpenKCC's switches at once
        pose_hinges(
            crowd.bodies, crowd.feet, roots, rotations, row, bool(body["enabled"] or fading),
            tuple(self._robot), tuple(self._held), dt,
        )  # fmt: skip
        character, qpos = self.character, data.qpos
        start = character.root_address
        qpos[start : start + 3] = roots[row]
        qpos[start + 3 : start + 7] = rotations[row, 0]
        qpos[character.addresses] = self.values
        self._write_balls(qpos, rotations[row])

    def _write_balls(self, qpos: Array, local: Array) -> None:
        rest = self.character.rig.skeleton.rest_rotations
        for joint, address in zip(self.character.balls, self.character.ball_addresses, strict=True):
            turn = quat_mul(quat_conj(get4(rest[joint])), get4(local[joint]))
            set4(qpos[address:], turn)
