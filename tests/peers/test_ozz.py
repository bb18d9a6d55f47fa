"""ozz-animation's own kernels and sample, vector by vector, through `footik_runtime.ozz`.

ozz computes in float32 with estimated square roots; compared are its `_exact` results. Any file of
JSON lines in the folder takes part: its records tell by their keys what they are.
"""

import json
import os
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from footik_runtime.ozz import LocalPose, aim, foot_ik, two_bone

SHARED = Path(os.environ.get("FOOTIK_SHARED") or Path(__file__).parents[2] / ".." / "shared")
FOLDER = SHARED / "peers" / "ozz"
KINDS = {"two_bone": "mid_axis", "aim": "offset", "foot_ik": "legs", "pose": "local"}
pytestmark = pytest.mark.skipif(
    not FOLDER.is_dir(), reason=f"no ozz vectors: {FOLDER} (set FOOTIK_SHARED)"
)

TWO_BONE_ROTATION, TWO_BONE_END, AIM_ROTATION = 5e-4, 1e-3, 1e-4
PLACE, JOINT, ANKLE_AXES = 1e-5, 3e-4, 1e-3
LONG_WAY_LIMIT = 0.2  # share of the weighted aims that may be skipped; recorded are 11 to 12 %


def records(kind: str) -> Iterator[tuple[str, dict]]:
    """(name for messages, record) of every record of one kind, whatever its file."""
    for path in sorted(FOLDER.glob("*.jsonl")):
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            if line.strip() and KINDS[kind] in (record := json.loads(line)):
                yield f"{path.name}:{number}", record


class Comparison:
    """Collects the largest difference of each measure and the records beyond its tolerance."""

    def __init__(self) -> None:
        self.compared = 0
        self.skipped = 0
        self.largest: dict[str, float] = {}
        self.offenders: list[str] = []

    def near(self, where: str, what: str, difference: float, tolerance: float) -> None:
        self.largest[what] = float(np.fmax(self.largest.get(what, 0.0), difference))
        if not difference <= tolerance:  # so that NaN offends
            self.offenders.append(f"{where} {what} off by {difference:.3g} (> {tolerance:g})")

    def holds(self, where: str, what: str, true: bool) -> None:
        if not true:
            self.offenders.append(f"{where} {what}")

    def check(self) -> None:
        figures = ", ".join(f"{what} {value:.3g}" for what, value in self.largest.items())
        summary = f"{self.compared} compared, {self.skipped} skipped; largest: {figures}"
        print(summary)
        assert not self.offenders, f"{len(self.offenders)} differences; {summary}\n" + "\n".join(
            self.offenders[:10]
        )
        assert self.compared > 0, f"no record to compare in {FOLDER}"


def wxyz(xyzw) -> np.ndarray:
    return np.roll(np.asarray(xyzw, dtype=np.float64), 1, axis=-1)


def matrix(column_major) -> np.ndarray:
    return np.array(column_major, dtype=np.float64).reshape(4, 4).T


def apart(a, b) -> float:
    """Largest element of the difference of two arrays."""
    return float(np.max(np.abs(np.asarray(a) - np.asarray(b))))


def turned_apart(a, b) -> float:
    """The same of two quaternions, up to sign."""
    return min(apart(a, b), apart(a, -np.asarray(b)))


def turn_matrix(q) -> np.ndarray:
    """(4, 4) of a unit quaternion wxyz, written out: independent of the code under test."""
    w, x, y, z = q
    result = np.eye(4)
    result[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return result


def is_turn(q) -> bool:
    return bool(np.isfinite(q).all()) and abs(float(np.linalg.norm(q)) - 1.0) < 1e-9


# -- the kernels ---------------------------------------------------------------------------------


def end_after(start, mid, end, start_turn, mid_turn) -> np.ndarray:
    """Where the end joint goes when both corrections post-multiply."""
    in_mid = np.linalg.inv(mid) @ end[:, 3]
    bent = np.linalg.inv(start) @ mid @ turn_matrix(mid_turn) @ in_mid
    return (start @ turn_matrix(start_turn) @ bent)[:3]


def test_every_two_bone_vector_is_reproduced():
    result = Comparison()
    for where, r in records("two_bone"):
        start, mid, end = (matrix(r[name]) for name in ("start_joint", "mid_joint", "end_joint"))
        start_turn, mid_turn, reached = two_bone(
            start,
            mid,
            end,
            r["target"],
            r["mid_axis"],
            r["pole_vector"],
            r["twist_angle"],
            r["soften"],
            r["weight"],
        )
        result.compared += 1
        result.holds(where, "start is no unit quaternion", is_turn(start_turn))
        result.holds(where, "mid is no unit quaternion", is_turn(mid_turn))
        if not (r["degenerate"] and r["target_kind"] == "at_start"):
            result.holds(where, f"reached is {reached}", reached == r["reached_exact"])
        if r["degenerate"]:
            continue
        for name, turn in (("start", start_turn), ("mid", mid_turn)):
            expected = wxyz(r[f"{name}_correction_exact"])
            result.near(where, name, turned_apart(turn, expected), TWO_BONE_ROTATION)
        chain = np.linalg.norm((mid - start)[:, 3]) + np.linalg.norm((end - mid)[:, 3])
        got = end_after(start, mid, end, start_turn, mid_turn)
        missed = np.linalg.norm(got - r["end_after_exact"])
        result.near(where, "end (of the chain)", float(missed / chain), TWO_BONE_END)
    result.check()


def test_every_aim_vector_is_reproduced_but_where_ozz_blends_the_long_way_round():
    result = Comparison()
    weighted = 0
    for where, r in records("aim"):
        arguments = (
            matrix(r["joint"]),
            r["target"],
            r["forward"],
            r["offset"],
            r["up"],
            r["pole_vector"],
            r["twist_angle"],
        )
        turn, reached = aim(*arguments, r["weight"])
        expected = wxyz(r["correction_exact"])
        result.holds(where, "is no unit quaternion", is_turn(turn))
        result.holds(where, f"reached is {reached}", reached == r["reached_exact"])
        if r["degenerate"]:
            result.compared += 1
            continue
        if 0.0 < r["weight"] < 1.0:
            weighted += 1
        if 0.0 < r["weight"] < 1.0 and r["twist_angle"] != 0.0:  # ozz errs with a twist only
            long_way = blended_the_long_way(aim(*arguments, 1.0)[0], r["weight"])
            if turned_apart(long_way, expected) <= AIM_ROTATION < turned_apart(turn, expected):
                result.skipped += 1
                continue
        result.compared += 1
        result.near(where, "correction", turned_apart(turn, expected), AIM_ROTATION)
    result.check()
    assert result.skipped <= LONG_WAY_LIMIT * weighted, f"{result.skipped} of {weighted} long ways"


def blended_the_long_way(turn, weight) -> np.ndarray:
    """From the identity to the negative of a quaternion with w >= 0."""
    identity = np.array([1.0, 0.0, 0.0, 0.0])
    blend = identity + (-turn - identity) * weight
    return blend / np.linalg.norm(blend)


# -- the sample ----------------------------------------------------------------------------------


@lru_cache
def floor() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First corners and both edges (T, 3) of the triangles of every .obj beside the vectors."""
    corners = []
    for path in sorted(FOLDER.glob("*.obj")):
        rows = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
        vertices = np.array([row[1:4] for row in rows if row[:1] == ["v"]], dtype=np.float64)
        faces = [[int(i.split("/")[0]) - 1 for i in row[1:4]] for row in rows if row[:1] == ["f"]]
        corners.append(vertices[np.array(faces)])
    v0, v1, v2 = np.moveaxis(np.concatenate(corners), 1, 0)
    return v0, v1 - v0, v2 - v0


def cast_down(origin):
    """Moeller and Trumbore's test, two-sided: the nearest hit, its normal by the winding."""
    v0, e1, e2 = floor()
    down = np.array([0.0, -1.0, 0.0])
    p = np.cross(down, e2)
    determinant = np.sum(e1 * p, axis=1)
    facing = np.abs(determinant) > 1e-12
    inverse = 1.0 / np.where(facing, determinant, 1.0)
    s = origin - v0
    u = np.sum(s * p, axis=1) * inverse
    q = np.cross(s, e1)
    v = q @ down * inverse
    t = np.sum(e2 * q, axis=1) * inverse
    inside = facing & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t >= 0.0)
    if not inside.any():
        return None
    nearest = int(np.argmin(np.where(inside, t, np.inf)))
    normal = np.cross(e1[nearest], e2[nearest])
    return origin + down * t[nearest], normal / np.linalg.norm(normal)


@lru_cache
def skeleton() -> dict:
    for path in sorted(FOLDER.glob("*.json")):
        if "parents" in (found := json.loads(path.read_text(encoding="utf-8"))):
            return found
    raise AssertionError(f"no skeleton (a .json with parents) in {FOLDER}")


def poses() -> dict[int, LocalPose]:
    found = {}
    for _, record in records("pose"):
        joints = record["local"]
        found[record["pose"]] = LocalPose(
            parents=skeleton()["parents"],
            translations=np.array([joint["t"] for joint in joints]),
            rotations=wxyz([joint["q_xyzw"] for joint in joints]),
            scales=np.array([joint["s"] for joint in joints]),
        )
    return found


def test_every_frame_of_the_foot_ik_sample_is_reproduced():
    result = Comparison()
    sampled = poses()
    legs = [(leg["hip"], leg["knee"], leg["ankle"]) for leg in skeleton()["legs"]]
    for where, r in records("foot_ik"):
        position = [r["x"], 0.0, r["z"]]
        frame = foot_ik(sampled[r["pose"]], legs, position, r["yaw"], cast_down)
        result.compared += 1
        result.near(where, "root", apart(frame.root_w, r["root"]), PLACE)
        result.near(where, "pelvis", apart(frame.pelvis_offset_w, r["pelvis_offset"]), PLACE)
        for side, (got, expected) in enumerate(zip(frame.legs, r["legs"], strict=True)):
            compare_leg(result, f"{where} leg {side}", got, expected)
    result.check()


def compare_leg(result, where, got, expected):
    result.holds(where, f"hit is {got.hit}", got.hit == expected["hit"])
    initial = apart(got.ankle_initial_w, expected["ankle_initial_ws"])
    result.near(where, "ankle before", initial, PLACE)
    result.near(where, "hit point", apart(got.hit_point_w, expected["hit_point"]), PLACE)
    result.near(where, "hit normal", apart(got.hit_normal_w, expected["hit_normal"]), PLACE)
    if expected["hit"]:
        target = apart(got.ankle_target_w, expected["ankle_target_ws"])
        result.near(where, "ankle target", target, PLACE)
    ankle = matrix(expected["ankle_model"])
    result.near(where, "knee", apart(got.knee_m, expected["knee_pos_model"]), JOINT)
    result.near(where, "ankle", apart(got.ankle_m[:3, 3], ankle[:3, 3]), JOINT)
    result.near(where, "ankle axes", apart(got.ankle_m[:3, :3], ankle[:3, :3]), ANKLE_AXES)
    for name, turn in zip(("hip_q", "knee_q", "ankle_q"), got.rotations_l, strict=True):
        result.near(where, name, turned_apart(turn, wxyz(expected[name])), ANKLE_AXES)
