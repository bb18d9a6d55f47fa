"""Our leg IK against ozz's two-bone vectors: the same end wherever ozz has no fault."""

import numpy as np
import pytest

from footik_runtime.leg_ik import two_bone
from footik_runtime.math3d import norm, sub

from .test_ozz import FOLDER, TWO_BONE_END, Comparison, apart, matrix, records

pytestmark = pytest.mark.skipif(
    not FOLDER.is_dir(), reason=f"no ozz vectors: {FOLDER} (set FOOTIK_SHARED)"
)


def vector(values) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z


def test_our_two_bone_ends_where_ozz_ends_for_goals_in_reach_of_a_rigid_sound_leg():
    comparison = Comparison()
    for where, record in records("two_bone"):
        sound = record["root_kind"] == "rigid" and record["axis_consistent"]
        if record["degenerate"] or not sound or not record["reached_exact"]:
            comparison.skipped += 1
            continue
        start, mid, end = (matrix(record[f"{name}_joint"]) for name in ("start", "mid", "end"))
        bending = -mid[:3, :3] @ np.array(record["mid_axis"])  # ozz's axis opens the knee
        hip, knee, ankle = (vector(joint[:3, 3]) for joint in (start, mid, end))
        length = norm(sub(knee, hip)) + norm(sub(ankle, knee))
        _, _, came_to, reached = two_bone(
            hip,
            knee,
            ankle,
            vector(record["target"]),
            vector(bending),
            length,
            vector(record["pole_vector"]),
        )
        comparison.compared += 1
        off = apart(came_to, record["end_after_exact"]) / length
        comparison.near(where, "end", off, TWO_BONE_END)
        comparison.holds(where, "reached is false", reached)
    comparison.check()
