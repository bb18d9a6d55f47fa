"""Reads OpenKCC's recorded traces into this library's records and frame.

Recorded left-handed, y up, z forward, degrees, xyzw, in float32; here right-handed, z up, x
forward, radians, wxyz: (x, y, z) -> (z, -x, y) and (qx, qy, qz, qw) -> (qw, -qz, qx, -qy).
"""

import json
import math
import os
from functools import lru_cache
from pathlib import Path

import numpy as np

from footik_runtime.openkcc import OPENKCC_BODY, OPENKCC_FRAME, OPENKCC_LEG
from footik_runtime.openkcc_target import NO_FLOOR, RELEASED, new_feet, openkcc_settings
from footik_runtime.probes import HIT

SHARED = Path(os.environ.get("FOOTIK_SHARED") or Path(__file__).parents[2] / ".." / "shared")
FOLDER = SHARED / "peers" / "openkcc"
SIDES = ("L", "R")
SETTING_NAMES = {
    "groundCheckDist": "ground_check_distance",
    "stepHeight": "step_height",
    "strideThresholdDistance": "stride_threshold_distance",
    "strideThresholdDegrees": "stride_threshold_angle",
    "strideTime": "stride_time",
    "footGroundedHeight": "foot_grounded_height",
    "maxHipFootDistance": "max_hip_foot_distance",
    "maxHipOffset": "max_hip_offset",
    "hipSmoothTime": "hip_smooth_time",
    "overlapBlendTime": "overlap_blend_time",
    "correctForOverlap": "correct_for_overlap",
}


@lru_cache
def load(path):
    return json.loads(path.read_text(encoding="utf-8"))


def trace_files():
    """Every file of the folder that holds frames, whatever its name."""
    return [path for path in sorted(FOLDER.glob("*.json")) if "frames" in load(path)]


def number(value):
    """A recorded number (or "nan", "inf", "-inf"), as the float32 it was."""
    return float(np.float32(value))


def vector(xyz):
    x, y, z = map(number, xyz)
    return np.array([z, -x, y])


def rotation(xyzw):
    x, y, z, w = map(number, xyzw)
    return np.array([w, -z, x, -y])


def settings(config):
    values = {SETTING_NAMES[name]: number(value) for name, value in config.items()}
    values["stride_threshold_angle"] = math.radians(values["stride_threshold_angle"])
    return openkcc_settings(**values)


class FloorIds:
    """A geom id for each floor's name."""

    def __init__(self):
        self._ids = {None: NO_FLOOR}

    def __getitem__(self, name):
        return self._ids.setdefault(name, len(self._ids) - 1)


def inputs(record):
    """Frame (1,) and leg (1, 2) records of one recorded frame."""
    frame, legs = np.zeros(1, OPENKCC_FRAME), np.zeros((1, 2), OPENKCC_LEG)
    given = record["in"]
    frame["time"], frame["dt"] = number(record["time"]), number(record["dt"])
    frame["hips"], frame["forward"] = vector(given["hipsPos"]), vector(given["hipsForward"])
    for i, side in enumerate(SIDES):
        legs[0, i]["curve"] = number(given[f"weight{side}"])
        legs[0, i]["knee"] = vector(given[f"knee{side}Pos"])
        legs[0, i]["foot"] = vector(given[f"foot{side}Pos"])
    return frame, legs


def state(record, before, floors):
    """Body (1,) and feet (1, 2) as a recorded frame left them; `before` is the frame before it."""
    body, feet = np.zeros(1, OPENKCC_BODY), new_feet((1, 2))
    if record is None:
        return body, feet
    out = record["out"]
    body["hip_offset"], body["hip_speed"] = number(out["hipOffset"]), number(out["hipOffsetSpeed"])
    earlier = number(before["out"]["hipOffset"]) if before else 0.0
    body["hip_move"] = body["hip_offset"] - earlier
    for i, side in enumerate(SIDES):
        foot, told = feet[0, i], out[side]
        foot["state"] = RELEASED if told["state"] == "Released" else 1
        foot["bump"] = told["useBump"]
        foot["floor"] = floors[told["floor"]]
        foot["weight"], foot["weight_velocity"] = number(told["weight"]), number(told["weightVel"])
        foot["stride_start"] = number(told["strideStartTime"])
        foot["target_position"] = vector(told["targetPos"])
        foot["target_rotation"] = rotation(told["targetRot"])
        foot["from_position"] = vector(told["fromPos"])
        foot["from_rotation"] = rotation(told["fromRot"])
        foot["velocity"] = vector(told["raisedFootVelocity"])
        foot["forward"] = vector(told["footForward"])
        foot["normal"] = vector(told["groundNormal"])
        foot["overlap_time"] = number(told["overlapTime"])
        foot["overlap_position"] = vector(told["overlapCorrectedPos"])
    return body, feet


def answer(probe, cast, floors):
    """The hit that was recorded for a probe, which must be the ray that was recorded."""
    np.testing.assert_allclose(probe["origin"], vector(cast["src"]), atol=1e-5)
    np.testing.assert_allclose(probe["direction"], vector(cast["dir"]), atol=1e-5)
    np.testing.assert_allclose(probe["length"], number(cast["dist"]), atol=1e-5)
    hit = np.zeros((), HIT)
    hit["geom"] = hit["body"] = -1
    if cast["hit"]:
        hit["hit"], hit["geom"] = 1, floors[cast["floor"]]
        hit["point"], hit["normal"] = vector(cast["point"]), vector(cast["normal"])
        hit["distance"] = np.linalg.norm(hit["point"] - probe["origin"])
    return hit


def replay(probes, casts, floors):
    """Hits (1, 2, 2) for probes: each active one takes the next of the casts."""
    hits = np.zeros(probes.shape, HIT)
    for index in np.ndindex(probes.shape):
        if probes[index]["active"]:
            assert casts, f"probe {index} was emitted, but no ray is left in the recording"
            hits[index] = answer(probes[index], casts.pop(0), floors)
    return hits
