"""Upright: any direction may be up. All rooms work in a frame whose z axis that is.

The frame has the world's origin. Rays are turned into the world where they are cast, poses where
they are handed out; when up changes, everything a character remembers is told anew in the new
frame, so that nothing it remembers moves in the world.
"""

from __future__ import annotations

import math

from footik_runtime.compiled import compiled
from footik_runtime.feet.record import GROUNDED, NO_PLAN
from footik_runtime.math3d import (
    get3,
    get4,
    quat_conj,
    quat_mul,
    quat_yaw,
    rotate,
    set3,
    set4,
)


@compiled
def turn_bodies(frame, at, turn, out_at, out_turn):
    """A scene's bodies (B, 3), (B, 4) as they stand in the frame (4,)."""
    back = quat_conj(get4(frame))
    for b in range(at.shape[0]):
        set3(out_at[b], rotate(back, get3(at[b])))
        set4(out_turn[b], quat_mul(back, get4(turn[b])))


@compiled
def turn_poses(frame, roots, rotations):
    """Poses (C, 3), (C, J, 4) of the frame, in the world."""
    by = get4(frame)
    for c in range(roots.shape[0]):
        set3(roots[c], rotate(by, get3(roots[c])))
        set4(rotations[c, 0], quat_mul(by, get4(rotations[c, 0])))


@compiled
def turn_memory(by, bodies, feet):
    """Tell everything that rows remember in another frame; `by` (4,) turns old vectors to new."""
    turn = get4(by)
    for c in range(bodies.shape[0]):
        body = bodies[c]
        ahead = rotate(turn, rotate(quat_yaw(body["yaw"]), (1.0, 0.0, 0.0)))
        rise = body["ground"] - body["root"][2]
        set3(body["root"], rotate(turn, get3(body["root"])))
        body["yaw"] = math.atan2(ahead[1], ahead[0])
        body["ground"] = body["root"][2] + rise
        sway = rotate(turn, (body["sway"][0], body["sway"][1], 0.0))
        body["sway"][0], body["sway"][1] = sway[0], sway[1]
        for i in range(feet.shape[1]):
            turn_foot(feet[c, i], turn, body["root"][2])


@compiled
def turn_foot(foot, by, root_z):
    """The same for one foot; what lies in the frame of a body stays."""
    if foot["body"] <= 0:
        set3(foot["hold"], rotate(by, get3(foot["hold"])))
        set4(foot["hold_turn"], quat_mul(by, get4(foot["hold_turn"])))
    if foot["from_body"] <= 0:
        set3(foot["from"], rotate(by, get3(foot["from"])))
        set4(foot["from_turn"], quat_mul(by, get4(foot["from_turn"])))
    if foot["land_body"] <= 0:
        set3(foot["land"], rotate(by, get3(foot["land"])))
        set4(foot["land_turn"], quat_mul(by, get4(foot["land_turn"])))
    set3(foot["lift"], rotate(by, get3(foot["lift"])))
    set3(foot["offset"], rotate(by, get3(foot["offset"])))
    set3(foot["offset_speed"], rotate(by, get3(foot["offset_speed"])))
    set3(foot["twist"], rotate(by, get3(foot["twist"])))
    set3(foot["rolled"], rotate(by, get3(foot["rolled"])))
    set3(foot["anim"], rotate(by, get3(foot["anim"])))
    set3(foot["out"], rotate(by, get3(foot["out"])))
    set3(foot["out_speed"], rotate(by, get3(foot["out_speed"])))
    set3(foot["goal"], rotate(by, get3(foot["goal"])))
    set3(foot["normal"], rotate(by, get3(foot["normal"])))
    set4(foot["lift_turn"], quat_mul(by, get4(foot["lift_turn"])))
    set4(foot["anim_turn"], quat_mul(by, get4(foot["anim_turn"])))
    set4(foot["out_turn"], quat_mul(by, get4(foot["out_turn"])))
    set4(foot["goal_turn"], quat_mul(by, get4(foot["goal_turn"])))
    foot["root_z"], foot["watched"] = root_z, 0
    if foot["state"] != GROUNDED:
        foot["plan"] = NO_PLAN  # asked anew: its place was told in the old frame
