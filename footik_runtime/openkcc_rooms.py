"""OpenKCC's rooms: a frame of many characters in a scene, as `openkcc` replays it from records.

The root, the pose and the legs are those of every behaviour; between them stand OpenKCC's state
machines, with rays of their own. What others look at, the `FOOT` records of a crowd, is written
here too. A frame, in order: feet follow ground that moved, the root moves, the pose is sampled,
root and feet ask, the state machines hear, the pose moves by the hip offset, the legs are solved.

OpenKCC reads its bones in an avatar that the hip offset of the frame before has moved already;
offsets are 0 or less. Its clock must not stand: a frame of dt = 0 poses and solves with the goals
there are.
"""

from __future__ import annotations

from collections import namedtuple
from typing import Any

import numpy as np
from numpy.typing import NDArray

from footik_runtime.compiled import compiled
from footik_runtime.feet.footprint import to_body
from footik_runtime.feet.record import BALL_PIN, NO_PIN
from footik_runtime.ground import Ground
from footik_runtime.legs import pose_leg
from footik_runtime.locomotion import ask_root, hear_root, root_rows
from footik_runtime.math3d import (
    add,
    get3,
    get4,
    lerp,
    norm,
    quat_mul,
    quat_nlerp,
    quat_yaw,
    rotate,
    set3,
    set4,
    sub,
    unrotate,
)
from footik_runtime.openkcc import (
    GROUND,
    OPENKCC_BODY,
    OPENKCC_FRAME,
    OPENKCC_GOAL,
    OPENKCC_LEG,
    SMALLEST_MOVE,
    apply_moving_rows,
    consume_rows,
    emit_moving_ground_rows,
    emit_moving_overlap_rows,
    emit_rows,
)
from footik_runtime.openkcc_target import (
    GROUNDED,
    GROUNDED_WEIGHT,
    OPENKCC_FOOT,
    mid_stride,
    new_feet,
    openkcc_settings,
    remaining,
)
from footik_runtime.probes import HIT, PROBE
from footik_runtime.rooms import BLOCK, Block, Bodies, Tables, pose_rows
from footik_runtime.settings import FootIKSettings

Rows = namedtuple("Rows", "bodies feet frames legs goals probes hits root_probes root_hits deltas")
"""What C characters remember and are told, by OpenKCC's records; deltas (C, legs, 3): how far the
ground of each foot moved, m; probes, hits (C, legs, 2); those of the roots (C,)."""

_MISS = np.zeros((), HIT)
_MISS["geom"] = _MISS["body"] = -1


def openkcc_record(settings: FootIKSettings) -> NDArray[np.void]:
    """(1,) OPENKCC_SETTINGS: the settings that OpenKCC knows, under its own names, unscaled."""
    return openkcc_settings(
        ground_check_distance=settings.ground_below,
        step_height=settings.step_height,
        stride_threshold_distance=settings.stride_distance,
        stride_threshold_angle=np.radians(settings.stride_angle_deg),
        stride_time=settings.stride_time,
        foot_grounded_height=settings.foot_height,
        max_hip_foot_distance=settings.max_hip_foot,
        max_hip_offset=settings.max_hip_drop,
        hip_smooth_time=settings.hip_smooth_time,
        overlap_blend_time=settings.overlap_time,
        correct_for_overlap=int(settings.correct_overlap),
    )


# --- before the root moves: ground that moved ---------------------------------------------------


@compiled
def moved_at(point, body, before, scene):
    """How far a body of the scene carried a point of the world (3,) since `before`, m."""
    if body <= 0 or body >= before.at.shape[0]:
        return (0.0, 0.0, 0.0)
    inside = unrotate(get4(before.turn[body]), sub(point, get3(before.at[body])))
    return sub(add(get3(scene.at[body]), rotate(get4(scene.turn[body]), inside)), point)


@compiled
def tell_moves(bodies, feet, rows, before, scene):
    """Write how far the ground of each grounded foot moved, seen from its character's root.

    Returns whether any moved far enough to be followed. Feet never turn or tilt with their ground,
    and all go the way of the root's place: so does OpenKCC.
    """
    any_moved = False
    for c in range(feet.shape[0]):
        for j in range(feet.shape[1]):
            delta = (0.0, 0.0, 0.0)
            if rows.feet[c, j]["state"] == GROUNDED:
                delta = moved_at(get3(bodies[c]["root"]), feet[c, j]["body"], before, scene)
            set3(rows.deltas[c, j], delta)
            any_moved = any_moved or norm(delta) > SMALLEST_MOVE
    return any_moved


def follow_moves(settings: NDArray[Any], rows: Rows, ground: Ground, dt: float) -> None:
    """Let grounded feet follow their ground by `rows.deltas`, in three stages and two casts."""
    now = float(rows.frames[0]["time"]) + dt  # one clock: rows are reset together
    # Feet of one character may stand on different bodies, so each leg has its own delta.
    legs = [slice(j, j + 1) for j in range(rows.feet.shape[1])]
    for j, leg in enumerate(legs):
        emit_moving_overlap_rows(
            settings, rows.frames, rows.bodies, rows.feet[:, leg], rows.deltas[:, j],
            rows.probes[:, leg],
        )  # fmt: skip
    cast_feet(rows, ground)
    for j, leg in enumerate(legs):
        emit_moving_ground_rows(
            settings, rows.bodies, rows.feet[:, leg], rows.legs[:, leg], rows.deltas[:, j],
            rows.hits[:, leg], rows.probes[:, leg],
        )  # fmt: skip
    cast_feet(rows, ground)
    for j, leg in enumerate(legs):
        apply_moving_rows(rows.frames, rows.feet[:, leg], rows.deltas[:, j], rows.hits[:, leg], now)


def cast_feet(rows: Rows, ground: Ground) -> None:
    """Answer every foot's probes; one that is not active is answered by a miss."""
    rows.hits[...] = _MISS
    ground.cast(rows.probes.reshape(-1), rows.hits.reshape(-1))


@compiled
def note_floor(feet, rows):
    """Keep which body each foot stands on, from the hits that gave it its floor."""
    for c in range(feet.shape[0]):
        for j in range(feet.shape[1]):
            hit = rows.hits[c, j, GROUND]
            if rows.feet[c, j]["state"] != GROUNDED:
                feet[c, j]["body"] = 0
            elif hit["hit"] != 0 and hit["geom"] == rows.feet[c, j]["floor"]:
                feet[c, j]["body"] = hit["body"]


# --- before the rays ----------------------------------------------------------------------------


@compiled
def tell_row(body, tables, hips, at, frame, legs, offset, dt):
    """Tell one character's state machines of its animated pose, `offset` (m) above where it is."""
    raise_by = (0.0, 0.0, offset)
    frame["time"] += dt
    frame["dt"] = dt
    set3(frame["hips"], add(get3(at[hips]), raise_by))
    set3(frame["forward"], rotate(quat_yaw(body["yaw"]), (1.0, 0.0, 0.0)))
    part = body["part"]
    for j in range(legs.shape[0]):
        leg, told = tables.legs[j], legs[j]
        here = tables.timing[body["frame"], j]["weight"]
        there = tables.timing[body["frame"] + 1, j]["weight"]
        told["curve"] = here * (1.0 - part) + there * part
        set3(told["knee"], add(get3(at[leg["knee"]]), raise_by))
        set3(told["foot"], add(get3(at[leg["ankle"]]), raise_by))


@compiled
def tell_rows(bodies, tables, hips, roots, locals_, block, rows, dt):
    """Move the roots, sample the poses, tell the state machines of them, and ask the roots' rays.

    `hips`: index of the joint that carries the body.
    """
    root_rows(bodies, dt, tables.cycle, tables.settings)
    pose_rows(bodies, tables, roots, locals_, block)
    for c in range(bodies.shape[0]):
        offset = rows.bodies[c]["hip_offset"]
        tell_row(bodies[c], tables, hips, block.at[c], rows.frames[c], rows.legs[c], offset, dt)
        ask_root(bodies[c], dt, rows.root_probes[c], tables.settings)


# --- after the rays -----------------------------------------------------------------------------


@compiled
def pose_foot(foot, leg, drop, goal, tables, local, at, turn):
    """Solve one leg for the ankle and sole that the animation and OpenKCC's goal blend to.

    What was asked for and what it came to are written into its `FOOT`.
    """
    ankle = add(get3(at[leg["ankle"]]), (0.0, 0.0, -drop))
    sole = quat_mul(get4(turn[leg["ankle"]]), get4(leg["frame"]))
    wanted = lerp(ankle, get3(goal["position"]), goal["position_weight"])
    wanted_turn = sole
    if goal["rotation_weight"] > 0.0:
        wanted_turn = quat_nlerp(sole, get4(goal["rotation"]), goal["rotation_weight"])
    came_to, came_turn, reached, missing, _, _ = pose_leg(
        leg, (0.0, 0.0, -drop), wanted, wanted_turn, 0.0, 0.0, (0.0, 0.0, 1.0), tables.parents,
        tables.settings, local, at, turn,
    )  # fmt: skip
    set3(foot["goal"], wanted)
    set4(foot["goal_turn"], wanted_turn)
    set3(foot["out"], came_to)
    set4(foot["out_turn"], came_turn)
    foot["reached"], foot["missing"] = reached, missing


@compiled
def show_foot(foot, own, settings, now, hips_height, scene):
    """Write into a `FOOT` what an OpenKCC foot, `own`, is doing; its leg has been solved."""
    grounded = own["state"] == GROUNDED
    foot["state"], foot["floor"], foot["weight"] = own["state"], own["floor"], own["weight"]
    foot["bump"] = 1 if grounded and remaining(own, settings, now) > 0.0 else 0
    held, held_turn = to_body(
        foot["body"], get3(own["target_position"]), get4(own["target_rotation"]),
        scene.at, scene.turn,
    )  # fmt: skip
    set3(foot["hold"], held)
    set4(foot["hold_turn"], held_turn)
    set3(foot["normal"], get3(own["normal"]))
    placed = grounded and not mid_stride(own, settings, now) and own["weight"] > GROUNDED_WEIGHT
    foot["locked"] = 1 if placed and foot["reached"] else 0
    foot["pin"] = BALL_PIN if foot["locked"] else NO_PIN
    foot["known"] = 1


@compiled
def solve_rows(bodies, feet, tables, hips, roots, locals_, block, rows, settings, scene):
    """Hear the roots' rays, move the poses by the hip offset, solve the legs, and show the feet."""
    for c in range(bodies.shape[0]):
        body, at, turn, now = bodies[c], block.at[c], block.turn[c], rows.frames[c]["time"]
        hear_root(body, rows.root_hits[c])
        if not body["enabled"]:
            continue
        drop = -rows.bodies[c]["hip_offset"]
        body["hip_drop"], body["hip_speed"] = drop, -rows.bodies[c]["hip_speed"]
        body["fresh"] = 0
        roots[c, 2] -= drop
        for j in range(feet.shape[1]):
            foot, goal = feet[c, j], rows.goals[c, j]
            pose_foot(foot, tables.legs[j], drop, goal, tables, locals_[c], at, turn)
            show_foot(foot, rows.feet[c, j], settings[0], now, at[hips][2], scene)


# --- a crowd's ----------------------------------------------------------------------------------


class OpenKCCRooms:
    """OpenKCC's state machines for all characters of a crowd.

    Attributes:
        settings: (1,) OPENKCC_SETTINGS.
        rows: what the characters remember.
    """

    def __init__(self, settings: FootIKSettings, hips: int, count: int, legs: int) -> None:
        self.settings = openkcc_record(settings)
        self._hips = hips
        self._before: Bodies | None = None  # where the scene's bodies were
        self.rows = Rows(
            bodies=np.zeros(count, OPENKCC_BODY),
            feet=np.zeros((count, legs), OPENKCC_FOOT),
            frames=np.zeros(count, OPENKCC_FRAME),
            legs=np.zeros((count, legs), OPENKCC_LEG),
            goals=np.zeros((count, legs), OPENKCC_GOAL),
            probes=np.zeros((count, legs, 2), PROBE),
            hits=np.full((count, legs, 2), _MISS),
            root_probes=np.zeros(count, PROBE),
            root_hits=np.full(count, _MISS),
            deltas=np.zeros((count, legs, 3)),
        )
        self.reset()

    def reset(self) -> None:
        """Forget all feet, where the scene's bodies were, and the time."""
        self._before = None
        self.rows.frames["time"] = 0.0
        self._forget(np.ones(len(self.rows.bodies), bool))

    def _forget(self, which: NDArray[np.bool_]) -> None:
        self.rows.feet[which] = new_feet(())
        for records in (self.rows.bodies, self.rows.goals):
            records[which] = np.zeros((), records.dtype)

    def step(
        self,
        bodies: NDArray[Any],
        feet: NDArray[Any],
        tables: Tables,
        roots: NDArray[np.float64],
        rotations: NDArray[np.float64],
        block: Block,
        dt: float,
        scene: Bodies,
        ground: Ground,
    ) -> None:
        """A whole frame of a crowd, block by block; the crowd's arrays are written."""
        for first in range(0, len(bodies), BLOCK):
            here = slice(first, first + BLOCK)
            rows = Rows(*(a[here] for a in self.rows))
            these = (bodies[here], feet[here], tables, roots[here], rotations[here], block)
            self._step_block(rows, these, dt, scene, ground)
        off = bodies["enabled"] == 0
        if off.any():
            self._forget(off)  # so that they begin anew, from the animation, once they are enabled
        if dt > 0.0 or self._before is None:
            self._before = Bodies(scene.at.copy(), scene.turn.copy())

    def _step_block(
        self,
        rows: Rows,
        these: tuple[Any, ...],
        dt: float,
        scene: Bodies,
        ground: Ground,
    ) -> None:
        bodies, feet, tables, roots, rotations, block = these
        before = self._before if dt > 0.0 else None
        if before is not None and tell_moves(bodies, feet, rows, before, scene):
            follow_moves(self.settings, rows, ground, dt)
            note_floor(feet, rows)
        tell_rows(bodies, tables, self._hips, roots, rotations, block, rows, dt)
        ground.cast(rows.root_probes, rows.root_hits)
        if dt > 0.0:
            emit_rows(self.settings, rows.frames, rows.feet, rows.legs, rows.probes)
            cast_feet(rows, ground)
            consume_rows(
                self.settings, rows.frames, rows.bodies, rows.feet, rows.legs, rows.hits,
                rows.goals,
            )  # fmt: skip
            note_floor(feet, rows)
        solve_rows(
            bodies, feet, tables, self._hips, roots, rotations, block, rows, self.settings, scene
        )
