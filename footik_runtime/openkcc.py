"""OpenKCC's foot IK: its two-state foot target, its controller and its hips, as it behaves.

This is the preset that reproduces OpenKCC, faults included (a re-planted foot jumps, a curve of
exactly 0.5 toggles the state, ground that vanishes goes unnoticed). It is here to be measured
against and to replay OpenKCC's own traces; the library's default state machine stands beside it.

One frame of a character is two calls with the rays cast between them:

    emit_rows      weights are smoothed, probes written
    (cast)         each active probe answered by a hit
    consume_rows   state machines stepped, goals and the hip offset written

A ground that moved is answered before that, with three calls and two casts between them, all with
the frame and leg records of the frame before:

    emit_moving_overlap_rows, (cast), emit_moving_ground_rows, (cast), apply_moving_rows

Probes and hits are shaped (rows, feet, 2): per foot the ground ray, then the overlap ray. All is in
world space. Goal rotations are those of the sole: x forward, z along the ground's normal.

dt = 0 makes the velocity of a settled weight or hip offset NaN, as in OpenKCC: the next step with a
dt lands on its target where that is not above the value; where it is, value and goal are NaN for
one frame. That is reproduced because OpenKCC's traces hold it. Do not step this preset with dt = 0.
"""

from __future__ import annotations

import math

import numpy as np

from footik_runtime.compiled import compiled
from footik_runtime.math3d import (
    add,
    add_scaled,
    get3,
    get4,
    lerp,
    norm,
    quat_angle,
    reject,
    scale,
    set3,
    set4,
    sub,
)
from footik_runtime.openkcc_target import (
    GROUNDED,
    RELEASED,
    can_update_target,
    force_target,
    ik_position,
    ik_rotation,
    look,
    mid_stride,
    release,
    smooth_weight,
    start_stride,
    update_target,
)
from footik_runtime.smoothing import clamp_through, smooth_damp

GROUND, OVERLAP = 0, 1  # the probe slots of a foot
CURVE_THRESHOLD = 0.5
SMALLEST_MOVE = 0.001  # m; ground that moved less did not move

OPENKCC_FRAME = np.dtype(  # what a row is given for one frame
    [("time", "f8"), ("dt", "f8"), ("hips", "f8", 3), ("forward", "f8", 3)], align=True
)
OPENKCC_LEG = np.dtype(  # and for each of its feet: the animated leg, and the weight's curve
    [("curve", "f8"), ("knee", "f8", 3), ("foot", "f8", 3)], align=True
)
OPENKCC_BODY = np.dtype(
    [("hip_offset", "f8"), ("hip_speed", "f8"), ("hip_move", "f8")],  # m, m/s, m in the last frame
    align=True,
)
OPENKCC_GOAL = np.dtype(  # of the ankle's position; the rotation of the sole
    [
        ("position", "f8", 3),
        ("rotation", "f8", 4),
        ("position_weight", "f8"),
        ("rotation_weight", "f8"),
    ],
    align=True,
)

# Probes of a frame.


@compiled
def _no_probe(probe):
    probe["active"] = 0
    probe["length"] = 0.0
    set3(probe["origin"], (0.0, 0.0, 0.0))
    set3(probe["direction"], (0.0, 0.0, -1.0))


@compiled
def _probe_down(probe, over, height, length):
    """A ray straight down from `height` over (or under) a place; none where a number is NaN."""
    probe["active"] = 1 if math.isfinite(over[0] + over[1] + height) else 0
    probe["length"] = length
    set3(probe["origin"], (over[0], over[1], height))
    set3(probe["direction"], (0.0, 0.0, -1.0))


@compiled
def _probe_between(probe, start, end):
    """A ray of exactly the length from start to end; none where they coincide."""
    way = sub(end, start)
    length = norm(way)
    if not length > 0.0:
        _no_probe(probe)
        return
    probe["active"] = 1
    probe["length"] = length
    set3(probe["origin"], start)
    set3(probe["direction"], scale(way, 1.0 / length))


@compiled
def emit_probes(settings, frame, foot, leg, probes):
    """Write one foot's probes (2,): the ground ray its state needs, and the overlap ray."""
    hips, at = get3(frame["hips"]), get3(leg["foot"])
    down = probes[GROUND]
    height, length = leg["knee"][2], settings["ground_check_distance"]
    if foot["state"] == GROUNDED and leg["curve"] > CURVE_THRESHOLD:
        # Via the hips: under the foot where it would be, were it abreast of them.
        abreast = add(hips, reject(sub(at, hips), get3(frame["forward"])))
        _probe_down(down, abreast, height, length)
    elif foot["state"] == RELEASED and leg["curve"] >= CURVE_THRESHOLD:
        _probe_down(down, at, height, length)
    else:
        _no_probe(down)
    if settings["correct_for_overlap"] != 0:
        _probe_between(probes[OVERLAP], hips, at)
    else:
        _no_probe(probes[OVERLAP])


# What the hits change.


@compiled
def latest_stride(feet):
    """When any foot of the row last began a stride, s."""
    latest = -math.inf
    for i in range(feet.shape[0]):
        latest = max(latest, feet[i]["stride_start"])
    return latest


@compiled
def can_take_stride(feet, settings, now):
    """True where no foot of the row strode within the stride time."""
    return latest_stride(feet) + settings["stride_time"] <= now


@compiled
def step_released(foot, frame, leg, ground):
    """A released foot: take the ground below it once the curve asks for it."""
    if leg["curve"] >= CURVE_THRESHOLD and ground["hit"] != 0:
        _stride_onto(foot, frame["time"], get3(frame["forward"]), ground, 0)


@compiled
def step_grounded(foot, feet, settings, frame, leg, ground):
    """A grounded foot: let go, bump to where the body now stands, or correct a bump's target."""
    if leg["curve"] <= CURVE_THRESHOLD:
        release(foot)
        return
    if ground["hit"] == 0:
        return
    now, normal, point = frame["time"], get3(ground["normal"]), get3(ground["point"])
    rotation = look(reject(get3(frame["forward"]), normal), normal)
    target = get3(foot["target_position"])
    on_its_way = mid_stride(foot, settings, now)
    if can_take_stride(feet, settings, now) and not on_its_way:
        distance = math.hypot(point[0] - target[0], point[1] - target[1])
        if distance >= settings["stride_threshold_distance"]:
            release(foot)
        elif (
            quat_angle(rotation, get4(foot["target_rotation"]))
            >= (settings["stride_threshold_angle"])
        ):
            _stride_onto(foot, now, get3(frame["forward"]), ground, 1)
    elif on_its_way and can_update_target(foot, settings, now):
        update_target(foot, settings, point, rotation, (0.0, 0.0, 1.0), frame["dt"])


@compiled
def _stride_onto(foot, now, hips_forward, ground, bump):
    normal = get3(ground["normal"])
    forward = reject(hips_forward, normal)
    start_stride(
        foot,
        now,
        get3(ground["point"]),
        look(forward, normal),
        ground["geom"],
        forward,
        normal,
        bump,
    )


@compiled
def track_overlap(foot, settings, dt, overlap):
    """Blend the correction of a released foot inside an obstacle in or out; its share, 0 to 1."""
    blend = settings["overlap_blend_time"]
    passed = -dt
    if overlap["hit"] != 0 and foot["state"] == RELEASED:
        passed = dt
        over = add_scaled(
            get3(overlap["point"]), get3(overlap["normal"]), settings["foot_grounded_height"]
        )
        if foot["overlap_time"] > 0.0:  # else a new contact
            over = lerp(get3(foot["overlap_position"]), over, 0.5)
        set3(foot["overlap_position"], over)
    foot["overlap_time"] = clamp_through(foot["overlap_time"] + passed, 0.0, blend)
    return foot["overlap_time"] / blend if foot["overlap_time"] > 0.0 else 0.0


@compiled
def write_goal(settings, frame, foot, leg, overlap, goal):
    """Write the ankle's goal: from the animation, or the overlap correction, to the target."""
    now, weight = frame["time"], foot["weight"]
    share = track_overlap(foot, settings, frame["dt"], overlap)
    away = lerp(get3(leg["foot"]), get3(foot["overlap_position"]), share)
    set3(goal["position"], lerp(away, ik_position(foot, settings, now), weight))
    goal["position_weight"] = 1.0
    if share > 0.0:
        normal = get3(overlap["normal"]) if overlap["hit"] != 0 else (0.0, 0.0, 0.0)
        set4(goal["rotation"], look(reject(get3(frame["forward"]), normal), normal))
        goal["rotation_weight"] = share
    else:
        set4(goal["rotation"], ik_rotation(foot, settings, now))
        goal["rotation_weight"] = weight


@compiled
def foot_hip_offset(foot, settings, now, hips_height):
    """How far this foot needs the hips lowered, m, at most 0; 0 while it is released."""
    if foot["state"] != GROUNDED:
        return 0.0
    reach = settings["max_hip_foot_distance"]
    distance = abs(hips_height - ik_position(foot, settings, now)[2])
    return clamp_through(reach - distance, -reach, 0.0)


@compiled
def hip_target(feet, settings, now, hips_height):
    """How far the row's feet need the hips lowered, m, limited. The height is without offset."""
    lowest = 0.0
    for i in range(feet.shape[0]):
        need = foot_hip_offset(feet[i], settings, now, hips_height)
        if not lowest < need:
            lowest = need
    return clamp_through(lowest, -settings["max_hip_offset"], 0.0)


@compiled
def step_hips(body, feet, settings, frame):
    """Let the hip offset follow the feet's need, and note how far that moved the character."""
    before = body["hip_offset"]
    target = hip_target(feet, settings, frame["time"], frame["hips"][2] - before)
    offset, speed = smooth_damp(
        before, target, body["hip_speed"], settings["hip_smooth_time"], frame["dt"]
    )
    body["hip_offset"] = offset
    body["hip_speed"] = speed
    body["hip_move"] = offset - before


# Rows of characters. `settings` is (rows,), or (1,) for all.


@compiled
def emit_rows(settings, frames, feet, legs, probes):
    """Smooth the weights and write the probes (rows, feet, 2) of one frame."""
    for i in range(feet.shape[0]):
        own = settings[i % settings.shape[0]]
        for j in range(feet.shape[1]):
            smooth_weight(feet[i, j], own, frames[i]["dt"])
            emit_probes(own, frames[i], feet[i, j], legs[i, j], probes[i, j])


@compiled
def consume_rows(settings, frames, bodies, feet, legs, hits, goals):
    """Step feet, goals (rows, feet) and hips of one frame by the hits (rows, feet, 2)."""
    for i in range(feet.shape[0]):
        own, frame = settings[i % settings.shape[0]], frames[i]
        for j in range(feet.shape[1]):
            foot, leg = feet[i, j], legs[i, j]
            if foot["state"] == GROUNDED:
                step_grounded(foot, feet[i], own, frame, leg, hits[i, j, GROUND])
            else:
                step_released(foot, frame, leg, hits[i, j, GROUND])
            write_goal(own, frame, foot, leg, hits[i, j, OVERLAP], goals[i, j])
        step_hips(bodies[i], feet[i], own, frame)


# Ground that moved by `deltas` (rows, 3) since the frame these records are of.


@compiled
def _follows(foot, delta):
    return foot["state"] == GROUNDED and norm(delta) > SMALLEST_MOVE


@compiled
def _raised(point, body):
    """A bone as the hip move at the end of its frame left it."""
    return (point[0], point[1], point[2] + body["hip_move"])


@compiled
def emit_moving_overlap_rows(settings, frames, bodies, feet, deltas, probes):
    """First stage: look from the hips for what stands before where each target moved."""
    for i in range(feet.shape[0]):
        own, delta = settings[i % settings.shape[0]], get3(deltas[i])
        hips = _raised(get3(frames[i]["hips"]), bodies[i])
        for j in range(feet.shape[1]):
            foot = feet[i, j]
            _no_probe(probes[i, j, GROUND])
            _no_probe(probes[i, j, OVERLAP])
            if own["correct_for_overlap"] != 0 and _follows(foot, delta):
                moved = add(get3(foot["target_position"]), delta)
                _probe_between(probes[i, j, OVERLAP], hips, moved)


@compiled
def emit_moving_ground_rows(settings, bodies, feet, legs, deltas, hits, probes):
    """Second stage: the ground below where each target moved, or below what stood in between."""
    for i in range(feet.shape[0]):
        own, delta = settings[i % settings.shape[0]], get3(deltas[i])
        for j in range(feet.shape[1]):
            foot, between = feet[i, j], hits[i, j, OVERLAP]
            _no_probe(probes[i, j, GROUND])
            _no_probe(probes[i, j, OVERLAP])
            if _follows(foot, delta):
                place = add(get3(foot["target_position"]), delta)
                if between["hit"] != 0:
                    place = get3(between["point"])
                height = _raised(get3(legs[i, j]["knee"]), bodies[i])[2]
                _probe_down(probes[i, j, GROUND], place, height, own["ground_check_distance"])


@compiled
def apply_moving_rows(frames, feet, deltas, hits, now):
    """Last stage, at the time `now`: ride the same floor, bump onto another, or let go."""
    for i in range(feet.shape[0]):
        delta = get3(deltas[i])
        for j in range(feet.shape[1]):
            foot, ground = feet[i, j], hits[i, j, GROUND]
            if not _follows(foot, delta):
                continue
            if ground["hit"] == 0:
                release(foot)
            elif ground["geom"] == foot["floor"]:
                normal = get3(ground["normal"])
                rotation = look(reject(get3(foot["forward"]), normal), normal)
                force_target(foot, get3(ground["point"]), rotation, normal)
            else:
                _stride_onto(foot, now, get3(frames[i]["forward"]), ground, 1)
