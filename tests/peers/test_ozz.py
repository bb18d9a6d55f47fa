"""ozz.py against the vectors of ozz-animation itself: every *.jsonl of the folder, by its keys.

Quaternions in the files are xyzw, matrices 16 floats by columns, and y is up.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from footik_runtime import ozz
from footik_runtime.leg_ik import two_bone
from footik_runtime.math3d import norm, quat_mul, sub

_ROOT = Path(os.environ.get("FOOTIK_SHARED") or Path(__file__).parents[2] / ".." / "shared")
FOLDER = _ROOT / "peers" / "ozz"
UP = (0.0, 1.0, 0.0)
AXES = ((0.0, 0.0, 1.0), UP, (-1.0, 0.0, 0.0), UP)  # of the sample's skeleton
ORIGIN = (0.0, 0.0, 0.0)
FOOT_HEIGHT, RAY_START = 0.12, 0.5
TWO_BONE_Q, TWO_BONE_END, AIM_Q = 5e-4, 1e-3, 1e-4
GROUND, JOINT, ELEMENT = 1e-5, 3e-4, 1e-3


def _read(path: Path) -> list[dict]:
    with path.open() as lines:
        return [json.loads(line) for line in lines if line.strip()]


def _kind(path: Path) -> str:
    with path.open() as lines:
        keys = set(json.loads(next(line for line in lines if line.strip())))
    if {"mid_joint", "start_correction_exact"} <= keys:
        return "two_bone"
    if {"joint", "correction_exact"} <= keys:
        return "aim"
    if {"pose", "pelvis_offset", "legs"} <= keys:
        return "foot_ik"
    return "other"


FILES = [(_kind(path), path) for path in sorted(FOLDER.glob("*.jsonl"))]


def _files(kind: str):
    found = [pytest.param(path, id=path.name) for k, path in FILES if k == kind]
    absent = pytest.mark.skip(reason=f"no recordings of ozz at {FOLDER} (set FOOTIK_SHARED)")
    return found or [pytest.param(None, marks=absent)]


def _vec(values) -> tuple[float, float, float]:
    return (float(values[0]), float(values[1]), float(values[2]))


def _joint(m):
    return (_vec(m[0:3]), _vec(m[4:7]), _vec(m[8:11]), _vec(m[12:15]))


def _wxyz(q) -> tuple[float, float, float, float]:
    return (float(q[3]), float(q[0]), float(q[1]), float(q[2]))


def _quat_error(q, xyzw) -> float:
    wxyz = np.array(_wxyz(xyzw))
    return min(np.abs(np.array(q) - wxyz).max(), np.abs(np.array(q) + wxyz).max())


def _off(a, b) -> float:
    return float(np.abs(np.subtract(a, b)).max())


class _Tally:
    """Which records differ, and in what."""

    def __init__(self) -> None:
        self.compared = 0
        self.exempt: Counter[str] = Counter()
        self.wrong: list[str] = []

    def check(self, what: str, error: float, limit: float) -> None:
        if not error <= limit:
            self.wrong.append(f"{what} is off by {error:.3g} (limit {limit:g})")

    def settle(self, path: Path) -> None:
        summary = f"{path.name}: {self.compared} compared, exempt {dict(self.exempt)}"
        assert self.compared > 0, summary
        shown = "\n".join(self.wrong[:10])
        assert not self.wrong, f"{summary}, {len(self.wrong)} differences, first:\n{shown}"


def _run_two_bone(r: dict):
    return ozz.two_bone(
        _joint(r["start_joint"]),
        _joint(r["mid_joint"]),
        _joint(r["end_joint"]),
        _vec(r["target"]),
        _vec(r["mid_axis"]),
        _vec(r["pole_vector"]),
        float(r["twist_angle"]),
        float(r["soften"]),
        float(r["weight"]),
    )


def _end_after(start, mid, end, start_turn, mid_turn):
    """Where the end joint comes to lie once both corrections are applied."""
    _, to_start = ozz.inverse(start)
    _, to_mid = ozz.inverse(mid)
    new_start = ozz.joint_mul(start, ozz.joint_from(start_turn, ORIGIN))
    new_mid = ozz.joint_mul(new_start, ozz.joint_mul(to_start, mid))
    new_mid = ozz.joint_mul(new_mid, ozz.joint_from(mid_turn, ORIGIN))
    return ozz.point_from_joint(new_mid, ozz.point_from_joint(to_mid, end[3]))


@pytest.mark.parametrize("path", _files("two_bone"))
def test_two_bone_vectors_of_ozz(path):
    tally = _Tally()
    for r in _read(path):
        start_turn, mid_turn, reached = _run_two_bone(r)
        name = f"record {r['id']}"
        for q in (start_turn, mid_turn):
            tally.check(f"{name}: the unit norm", abs(float(np.linalg.norm(q)) - 1.0), 1e-9)
        if r["target_kind"] != "at_start":
            tally.check(f"{name}: reached", abs(reached - r["reached_exact"]), 0)
        if r["degenerate"]:
            tally.exempt["degenerate"] += 1
            continue
        tally.compared += 1
        start, mid, end = (_joint(r[k]) for k in ("start_joint", "mid_joint", "end_joint"))
        length = norm(sub(mid[3], start[3])) + norm(sub(end[3], mid[3]))
        after = _end_after(start, mid, end, start_turn, mid_turn)
        error = _quat_error(start_turn, r["start_correction_exact"])
        tally.check(f"{name}: the start correction", error, TWO_BONE_Q)
        error = _quat_error(mid_turn, r["mid_correction_exact"])
        tally.check(f"{name}: the mid correction", error, TWO_BONE_Q)
        tally.check(f"{name}: the end", _off(after, r["end_after_exact"]) / length, TWO_BONE_END)
    tally.settle(path)


def _run_aim(r: dict, weight: float):
    return ozz.aim(
        _joint(r["joint"]),
        _vec(r["target"]),
        _vec(r["forward"]),
        _vec(r["offset"]),
        _vec(r["up"]),
        _vec(r["pole_vector"]),
        float(r["twist_angle"]),
        weight,
    )


@pytest.mark.parametrize("path", _files("aim"))
def test_aim_vectors_of_ozz(path):
    tally = _Tally()
    for r in _read(path):
        q, reached = _run_aim(r, float(r["weight"]))
        name = f"record {r['id']}"
        tally.check(f"{name}: the unit norm", abs(float(np.linalg.norm(q)) - 1.0), 1e-9)
        if r["target_kind"] != "at_joint":
            tally.check(f"{name}: reached", abs(reached - r["reached_exact"]), 0)
        if r["degenerate"]:
            tally.exempt["degenerate"] += 1
            continue
        error = _quat_error(q, r["correction_exact"])
        if error > AIM_Q and _is_long_way(r):
            tally.exempt["blended the long way"] += 1
            continue
        tally.compared += 1
        tally.check(f"{name}: the correction", error, AIM_Q)
    tally.settle(path)
    assert tally.exempt["blended the long way"] < 0.2 * tally.compared


def _is_long_way(r: dict) -> bool:
    """True where the recording is the blend from the identity to minus the full correction."""
    weight = r["weight"]
    if not 0.0 < weight < 1.0:
        return False
    full, _ = _run_aim(r, 1.0)
    long_way = weight * -np.array(full) + (1.0 - weight) * np.array([1.0, 0.0, 0.0, 0.0])
    long_way /= np.linalg.norm(long_way)
    wxyz = np.array(_wxyz(r["correction_exact"]))
    return float(np.abs(long_way - wxyz).max()) < AIM_Q


def _triangles(path: Path) -> np.ndarray:
    """(T, 3, 3) corners of an OBJ file."""
    points, faces = [], []
    for line in path.read_text().splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            points.append([float(w) for w in words[1:4]])
        elif words[:1] == ["f"]:
            faces.append([int(w.split("/")[0]) - 1 for w in words[1:4]])
    return np.array(points)[np.array(faces)]


def _cast_down(triangles: np.ndarray, start) -> tuple[np.ndarray, np.ndarray] | None:
    """Nearest hit below, two-sided: (point, unit normal by the winding), or None."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    direction = -np.array(UP)
    edge1, edge2 = b - a, c - a
    p = np.cross(direction, edge2)
    det = np.einsum("ij,ij->i", edge1, p)
    crossing = np.abs(det) > 1e-12
    det = np.where(crossing, det, 1.0)
    s = np.asarray(start) - a
    u = np.einsum("ij,ij->i", s, p) / det
    q = np.cross(s, edge1)
    v = q @ direction / det
    t = np.einsum("ij,ij->i", edge2, q) / det
    margin = 1e-6  # a ray along a shared edge must hit one of its two triangles
    hit = crossing & (u >= -margin) & (v >= -margin) & (u + v <= 1.0 + margin) & (t > 0.0)
    if not hit.any():
        return None
    t = np.where(hit, t, np.inf)
    best = int(np.argmin(t))
    normal = np.cross(edge1[best], edge2[best])
    return np.asarray(start) + t[best] * direction, normal / np.linalg.norm(normal)


def _model_joints(skeleton: dict, pose: dict) -> list:
    """Joints of a sampled pose in model space, by forward kinematics over its local transforms."""
    joints: list = []
    for parent, local in zip(skeleton["parents"], pose["local"], strict=True):
        x, y, z, t = ozz.joint_from(_wxyz(local["q_xyzw"]), _vec(local["t"]))
        sx, sy, sz = local["s"]
        own = (
            (x[0] * sx, x[1] * sx, x[2] * sx),
            (y[0] * sy, y[1] * sy, y[2] * sy),
            (z[0] * sz, z[1] * sz, z[2] * sz),
            t,
        )
        joints.append(own if parent < 0 else ozz.joint_mul(joints[parent], own))
    return joints


def _yaw_joint(yaw: float, origin):
    return ozz.joint_from((float(np.cos(0.5 * yaw)), 0.0, float(np.sin(0.5 * yaw)), 0.0), origin)


class _Sample:
    """The foot_ik sample: its skeleton, poses and floor."""

    def __init__(self, folder: Path) -> None:
        self.skeleton = json.loads((folder / "skeleton.json").read_text())
        rows = {row["pose"]: row for row in _read(folder / "sampled_poses.jsonl")}
        self.locals = {pose: row["local"] for pose, row in rows.items()}
        self.joints = {pose: _model_joints(self.skeleton, row) for pose, row in rows.items()}
        self.floor = _triangles(folder / "floor.obj")


def _check_ground(tally: _Tally, name: str, sample: _Sample, ankle, recorded: dict):
    """Cast the leg's ray and place its ankle; returns (target, normal), or None without a hit."""
    tally.check(f"{name}: the ankle", _off(ankle, recorded["ankle_initial_ws"]), GROUND)
    start = (ankle[0], ankle[1] + RAY_START, ankle[2])
    hit = _cast_down(sample.floor, start)
    tally.check(f"{name}: hit", abs((hit is not None) - recorded["hit"]), 0)
    if hit is None or not recorded["hit"]:
        return None
    point, normal = hit
    tally.check(f"{name}: the hit", _off(point, recorded["hit_point"]), GROUND)
    tally.check(f"{name}: the normal", _off(normal, recorded["hit_normal"]), GROUND)
    target = ozz.ankle_target(start, _vec(point), _vec(normal), FOOT_HEIGHT)
    tally.check(f"{name}: the target", _off(target, recorded["ankle_target_ws"]), GROUND)
    vertical = point + np.array(UP) * FOOT_HEIGHT / normal[1]
    tally.check(f"{name}: I + up*h/(n.up)", _off(target, vertical), 1e-9)
    return target, _vec(normal)


def _check_leg(tally: _Tally, name: str, sample: _Sample, r: dict, leg, to_model, found, recorded):
    """Solve one leg, or leave it untouched without ground, and compare its pose."""
    joints, local = sample.joints[r["pose"]], sample.locals[r["pose"]]
    ids = (leg["hip"], leg["knee"], leg["ankle"])
    hip, knee, ankle = (joints[i] for i in ids)
    turns = ((1.0, 0.0, 0.0, 0.0),) * 3
    if found is not None:
        target = ozz.point_from_joint(to_model, found[0])
        normal = ozz.vector_from_joint(to_model, found[1])
        *turns, _ = ozz.foot_ik_leg(hip, knee, ankle, target, normal, AXES, 1.0, 1.0)
    for part, i, turn in zip(("hip_q", "knee_q", "ankle_q"), ids, turns, strict=True):
        q = quat_mul(_wxyz(local[i]["q_xyzw"]), turn)
        tally.check(f"{name}: {part}", _quat_error(q, recorded[part]), ELEMENT)
    at = joints[sample.skeleton["parents"][ids[0]]]
    after = []
    for parent, i, turn in zip((None, *ids[:2]), ids, turns, strict=True):
        _, inverse = ozz.inverse(at if parent is None else joints[parent])
        own = ozz.joint_mul(inverse, joints[i])
        above = at if parent is None else after[-1]
        after.append(ozz.joint_mul(ozz.joint_mul(above, own), ozz.joint_from(turn, ORIGIN)))
    wanted = _joint(recorded["ankle_model"])
    tally.check(f"{name}: ankle", _off(after[2][3], wanted[3]), JOINT)
    tally.check(f"{name}: ankle rotation", _off(after[2][:3], wanted[:3]), ELEMENT)
    tally.check(f"{name}: knee", _off(after[1][3], recorded["knee_pos_model"]), JOINT)


@pytest.mark.parametrize("path", _files("foot_ik"))
def test_foot_ik_records_of_ozz(path):
    sample, tally = _Sample(path.parent), _Tally()
    for number, r in enumerate(_read(path)):
        tally.compared += 1
        name = f"record {number}"
        root = _cast_down(sample.floor, (r["x"], 10.0, r["z"]))
        root_point = (r["x"], 0.0, r["z"]) if root is None else _vec(root[0])
        tally.check(f"{name}: the root", _off(root_point, r["root"]), GROUND)
        root_point = _vec(r["root"])
        world = _yaw_joint(r["yaw"], root_point)
        found, drop = [], -np.inf
        for leg, recorded in zip(sample.skeleton["legs"], r["legs"], strict=True):
            ankle = ozz.point_from_joint(world, sample.joints[r["pose"]][leg["ankle"]][3])
            ground = _check_ground(tally, f"{name} {leg['side']}", sample, ankle, recorded)
            found.append(ground)
            if ground is not None:
                drop = ozz.pelvis_drop(drop, ankle, ground[0], UP)
        offset = (0.0, 0.0 if np.isinf(drop) else -drop, 0.0)
        tally.check(f"{name}: the pelvis", _off(offset, r["pelvis_offset"]), GROUND)
        lowered = _yaw_joint(r["yaw"], tuple(np.add(root_point, offset).tolist()))
        _, to_model = ozz.inverse(lowered)
        for leg, ground, recorded in zip(sample.skeleton["legs"], found, r["legs"], strict=True):
            side = f"{name} {leg['side']}"
            _check_leg(tally, side, sample, r, leg, to_model, ground, recorded)
    tally.settle(path)


@pytest.mark.parametrize("path", _files("two_bone"))
def test_our_two_bone_ends_where_ozz_ends(path):
    """Where ozz has no fault: rigid, consistent axes, in reach, unsoftened, full weight."""
    tally = _Tally()
    for r in _read(path):
        faultless = r["root_kind"] == "rigid" and r["axis_consistent"] and r["weight"] >= 1.0
        if r["degenerate"] or not (faultless and r["reached_exact"]):
            continue
        start, mid, end = (_joint(r[k]) for k in ("start_joint", "mid_joint", "end_joint"))
        axis = ozz.vector_from_joint(mid, _vec(r["mid_axis"]))
        bending = (-axis[0], -axis[1], -axis[2])  # ozz's axis opens the knee, ours bends it
        tally.compared += 1
        length = norm(sub(mid[3], start[3])) + norm(sub(end[3], mid[3]))
        pole = _vec(r["pole_vector"])
        _, _, after, reached = two_bone(
            start[3], mid[3], end[3], _vec(r["target"]), bending, length, pole
        )
        name = f"record {r['id']}"
        tally.check(f"{name}: the end", _off(after, r["end_after_exact"]) / length, TWO_BONE_END)
        tally.check(f"{name}: reached", 0.0 if reached else 1.0, 0)
    tally.settle(path)
