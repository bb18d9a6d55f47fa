"""OpenKCC's own traces, replayed frame by frame through its preset.

OpenKCC computes in float32 and this library in float64, so each frame starts from the recorded
state of the frame before. Where a decision lies within float32 rounding of its threshold the two
may differ; only such frames are exempt, and few.
"""

import math
from functools import lru_cache

import numpy as np
import pytest

from footik_runtime.errors import FootIKError
from footik_runtime.math3d import get3, get4, quat_angle, quat_nlerp, reject
from footik_runtime.offline.bake import OPENKCC_CURVES, bake_openkcc
from footik_runtime.openkcc import (
    OPENKCC_GOAL,
    OVERLAP,
    apply_moving_rows,
    can_take_stride,
    consume_rows,
    emit_moving_ground_rows,
    emit_moving_overlap_rows,
    emit_rows,
    hip_target,
    latest_stride,
)
from footik_runtime.openkcc_target import (
    GROUNDED,
    can_update_target,
    ik_position,
    ik_rotation,
    look,
    mid_stride,
    remaining,
)
from footik_runtime.probes import PROBE
from footik_runtime.smoothing import ease, smooth_damp, smooth_damp3

from . import openkcc_traces as traces

pytestmark = pytest.mark.skipif(
    not traces.FOLDER.is_dir(), reason=f"no OpenKCC traces: {traces.FOLDER} (set FOOTIK_SHARED)"
)
EXEMPT_LIMIT = 5
POSITIONS = {
    "target_position": "targetPos",
    "from_position": "fromPos",
    "velocity": "raisedFootVelocity",
    "forward": "footForward",
    "normal": "groundNormal",
    "overlap_position": "overlapCorrectedPos",
}
NUMBERS = {
    "weight": "weight",
    "weight_velocity": "weightVel",
    "stride_start": "strideStartTime",
    "overlap_time": "overlapTime",
}
SCALE = {"weight_velocity": 10.0, "velocity": 10.0}  # velocities are in units of a frame, roughly


def step(record, before, body, feet, options, floors):
    """One recorded frame, with its recorded rays; returns the goals (1, 2)."""
    frame, legs = traces.inputs(record)
    probes = np.zeros((1, 2, 2), PROBE)
    goals = np.zeros((1, 2), OPENKCC_GOAL)
    if "feetDelta" in record and before is not None:
        move_ground(record, before, body, feet, options, floors)
    emit_rows(options, frame, feet, legs, probes)
    casts = list(record["casts"])
    hits = traces.replay(probes, casts, floors)
    assert not casts, f"{len(casts)} recorded rays were not asked for"
    consume_rows(options, frame, body, feet, legs, hits, goals)
    return goals


def move_ground(record, before, body, feet, options, floors):
    frame, legs = traces.inputs(before)
    delta = traces.vector(record["feetDelta"])[None]
    casts = list(record.get("platformCasts", []))
    probes = np.zeros((1, 2, 2), PROBE)
    emit_moving_overlap_rows(options, frame, body, feet, delta, probes)
    # Recorded foot by foot, emitted stage by stage: the overlap ray is each foot's first.
    followed = [i for i in range(2) if probes[0, i, OVERLAP]["active"]]
    first = casts[::2] if followed else []
    second = casts[1::2] if followed else casts
    between = traces.replay(probes, first, floors)
    emit_moving_ground_rows(options, body, feet, legs, delta, between, probes)
    below = traces.replay(probes, second, floors)
    assert not first
    assert not second
    apply_moving_rows(frame, feet, delta, below, traces.number(record["time"]))


def differences(record, body, feet, goals, options, floors):
    """What differs from the recording, a line each."""
    wrong = []
    out, now = record["out"], traces.number(record["time"])

    def check(name, ours, theirs, tolerance):
        if not np.allclose(ours, theirs, rtol=0.0, atol=tolerance, equal_nan=True):
            wrong.append(f"{name}: {ours} instead of {theirs}")

    def check_turn(name, ours, theirs):
        if np.isnan(theirs).any() or np.isnan(ours).any():
            check(name, ours, theirs, 0.0)
        elif not (turn := quat_angle(get4(ours), get4(theirs))) <= 1e-3:
            wrong.append(f"{name}: off by {turn} rad")

    check("hip_offset", body[0]["hip_offset"], traces.number(out["hipOffset"]), 1e-4)
    check("hip_speed", body[0]["hip_speed"], traces.number(out["hipOffsetSpeed"]), 1e-3)
    check("can_take_stride", can_take_stride(feet[0], options[0], now), out["canTakeStride"], 0.0)
    for i, side in enumerate(traces.SIDES):
        foot, goal, told = feet[0, i], goals[0, i], out[side]
        check(f"{side}.state", foot["state"] == GROUNDED, told["state"] == "Grounded", 0.0)
        check(f"{side}.bump", foot["bump"], told["useBump"], 0.0)
        check(f"{side}.floor", foot["floor"], floors[told["floor"]], 0.0)
        check(f"{side}.mid_stride", mid_stride(foot, options[0], now), told["midStride"], 0.0)
        may_move = can_update_target(foot, options[0], now)
        check(f"{side}.can_update", may_move, told["canUpdateStrideTarget"], 0.0)
        left = traces.number(told["remainingStrideTime"])
        check(f"{side}.remaining", remaining(foot, options[0], now), left, 1e-5)
        for name, recorded in NUMBERS.items():
            close = 1e-4 * SCALE.get(name, 1.0)
            check(f"{side}.{name}", foot[name], traces.number(told[recorded]), close)
        for name, recorded in POSITIONS.items():
            close = 1e-4 * SCALE.get(name, 1.0)
            check(f"{side}.{name}", foot[name], traces.vector(told[recorded]), close)
        check_turn(
            f"{side}.target_rotation", foot["target_rotation"], traces.rotation(told["targetRot"])
        )
        check_turn(f"{side}.from_rotation", foot["from_rotation"], traces.rotation(told["fromRot"]))
        target = ik_position(foot, options[0], now)
        check(f"{side}.ik_position", target, traces.vector(told["ikTargetPos"]), 1e-4)
        turn = np.array(ik_rotation(foot, options[0], now))
        check_turn(f"{side}.ik_rotation", turn, traces.rotation(told["ikTargetRot"]))
        check(f"{side}.goal", goal["position"], traces.vector(told["ikPos"]), 1e-4)
        check_turn(f"{side}.goal_rotation", goal["rotation"], traces.rotation(told["ikRot"]))
        for kind, recorded in (("position", "ikPosWeight"), ("rotation", "ikRotWeight")):
            ours = goal[f"{kind}_weight"]
            check(f"{side}.{kind}_weight", ours, traces.number(told[recorded]), 1e-4)
    return wrong


def decided_by_float32(record, options, body, feet, stepped):
    """True where a threshold of this frame lies within float32 rounding.

    `body` and `feet` are the state it starts from, `stepped` the two as it left them.
    """
    frame, _ = traces.inputs(record)
    now, option = frame[0]["time"], options[0]
    if abs(latest_stride(feet[0]) + option["stride_time"] - now) < 1e-6:
        return True
    if any(foot["bump"] and abs(remaining(foot, option, now)) < 1e-6 for foot in feet[0]):
        return True
    if turns_by_the_threshold(record, option, feet):
        return True
    states = [(body, feet), stepped]
    speeds = [state[0][0]["hip_speed"] for state in states]
    offset = body[0]["hip_offset"]
    height = frame[0]["hips"][2] - offset
    needs = np.array([hip_target(state[1][0], option, now, height) for state in states])
    paused = np.isnan([*speeds, traces.number(record["out"]["hipOffsetSpeed"])]).any()
    return bool(paused and (np.abs(needs - offset) < 1e-6).any())


def turns_by_the_threshold(record, option, feet):
    """True where a foot would turn by just the threshold onto a ground that a ray of it hit."""
    frame, _ = traces.inputs(record)
    forward = get3(frame[0]["forward"])
    grounds = [c for c in record["casts"] if c["hit"] and traces.number(c["dir"][1]) == -1.0]
    for foot in feet[0][feet[0]["state"] == GROUNDED]:
        for cast in grounds:
            normal = get3(traces.vector(cast["normal"]))
            turn = look(reject(forward, normal), normal)
            angle = quat_angle(turn, get4(foot["target_rotation"]))
            if abs(angle - option["stride_threshold_angle"]) < math.radians(1e-4):
                return True
    return False


@lru_cache
def replayed(path):
    """(differences of frames no tie explains, exempt frames) of a trace, from recorded states."""
    trace = traces.load(path)
    options, floors = traces.settings(trace["config"]), traces.FloorIds()
    wrong, exempt = [], []
    history = [None, None, *trace["frames"]]
    for number, (earlier, before, record) in enumerate(
        zip(history, history[1:], history[2:], strict=False)
    ):
        body, feet = traces.state(before, earlier, floors)
        loaded = body.copy(), feet.copy()
        try:
            goals = step(record, before, body, feet, options, floors)
        except AssertionError as error:
            raise AssertionError(f"{path.name}, frame {number}: {error}") from None
        found = differences(record, body, feet, goals, options, floors)
        if found and decided_by_float32(record, options, *loaded, stepped=(body, feet)):
            exempt.append(number)
        elif found:
            wrong += [f"frame {number}: {line}" for line in found]
    return wrong, exempt


def by_name(path):
    return path.stem


@pytest.mark.parametrize("path", traces.trace_files(), ids=by_name)
def test_each_frame_follows_from_the_recorded_state(path):
    wrong, _ = replayed(path)
    assert not wrong, "\n".join(wrong[:12])


def test_few_frames_are_exempt_as_float32_ties():
    exempt = {path.stem: replayed(path)[1] for path in traces.trace_files()}
    assert sum(map(len, exempt.values())) <= EXEMPT_LIMIT, exempt


def run_free(path):
    """(frames, farthest goal from the recording in m) of a trace run unaided from its start.

    It ends at a pause and at the first frame that float32 decided: what follows is another story.
    (Ties in time are not among them: times are the recorded ones, whoever adds them.)
    """
    trace = traces.load(path)
    options, floors = traces.settings(trace["config"]), traces.FloorIds()
    body, feet = traces.state(None, None, floors)
    before, frames, farthest = None, 0, 0.0
    _, exempt = replayed(path)
    for number, record in enumerate(trace["frames"]):
        decided = number in exempt or turns_by_the_threshold(record, options[0], feet)
        if decided or traces.number(record["dt"]) == 0.0:
            break
        goals = step(record, before, body, feet, options, floors)
        for i, side in enumerate(traces.SIDES):
            gap = goals[0, i]["position"] - traces.vector(record["out"][side]["ikPos"])
            farthest = max(farthest, float(np.linalg.norm(gap)))
        before, frames = record, frames + 1
    return frames, farthest


@pytest.mark.parametrize("path", traces.trace_files(), ids=by_name)
def test_a_trace_run_from_its_start_stays_with_the_recording(path):
    frames, farthest = run_free(path)
    print(f"{path.stem}: {frames} frames, at most {farthest:.2g} m away")
    assert frames > 0
    assert farthest < 1e-4


def table(name):
    path = traces.FOLDER / "unit_tables.json"
    return traces.load(path)[name] if path.is_file() else []


def test_table_of_the_easing():
    for f, eased in table("smoothValue"):
        assert ease(traces.number(f)) == pytest.approx(eased, abs=1e-6)


def test_table_of_scalar_smoothing():
    for case in table("smoothDampScalar"):
        value, velocity = traces.number(case["start"]), 0.0
        smooth_time, dt = traces.number(case["smoothTime"]), traces.number(case["dt"])
        for expected in case["seq"]:
            value, velocity = smooth_damp(value, float(case["target"]), velocity, smooth_time, dt)
            assert (value, velocity) == pytest.approx(tuple(expected), abs=2e-5)


def test_table_of_vector_smoothing():
    value = velocity = (0.0, 0.0, 0.0)
    for case in table("smoothDampVector"):
        target = get3(traces.vector(case["target"]))
        value, velocity = smooth_damp3(value, target, velocity, 0.25, float(np.float32(1 / 60)))
        np.testing.assert_allclose(value, traces.vector(case["value"]), atol=1e-5)
        np.testing.assert_allclose(velocity, traces.vector(case["vel"]), atol=1e-4)


def test_table_of_looking_along_a_direction():
    for case in table("lookRotation"):
        turn = look(get3(traces.vector(case["forward"])), get3(traces.vector(case["up"])))
        assert quat_angle(turn, get4(traces.rotation(case["q"]))) < 1e-5, case


def test_table_of_blended_rotations():
    for case in table("quatLerp"):
        a, b = get4(traces.rotation(case["a"])), get4(traces.rotation(case["b"]))
        blended = quat_nlerp(a, b, traces.number(case["t"]))
        assert quat_angle(blended, get4(traces.rotation(case["q"]))) < 1e-5
        assert math.degrees(quat_angle(a, b)) == pytest.approx(case["angle"], abs=1e-3)


def baked_clips():
    path = traces.FOLDER / "bake_curves.json"
    return traces.load(path)["clips"] if path.is_file() else []


@pytest.mark.parametrize("clip", baked_clips(), ids=lambda clip: clip["name"])
def test_baked_curves_are_the_recorded_ones(clip):
    asked_at = np.array([traces.number(sample["t"]) for sample in clip["samples"]])
    for name, column in zip(OPENKCC_CURVES, ("footLY", "footRY"), strict=True):
        heights = np.array([traces.number(sample[column]) for sample in clip["samples"]])

        def recorded_height(times, heights=heights):
            nearest = np.abs(asked_at - times[:, None]).argmin(axis=1)
            assert np.abs(asked_at[nearest] - times).max() < 1e-6, "sampled at another time"
            return heights[nearest]

        def bake(height=recorded_height):
            return bake_openkcc(
                height,
                length_s=clip["length"],
                rate=clip["samplingRate"],
                foot_grounded_height=clip["footGroundedHeight"],
            )

        if clip["error"] is not None:
            with pytest.raises(FootIKError, match="length"):
                bake()
        else:
            np.testing.assert_allclose(bake(), clip["curves"][name], atol=1e-6)
