import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from footik_runtime import gait
from footik_runtime import quat_arrays as qa
from footik_runtime.clip import Clip
from footik_runtime.offline.loops import find_loop, headings, put_in_place
from footik_runtime.rig_model import find_rig_in_model

MODEL = Path(__file__).parent.parent / "models" / "humanoid.xml"
RIG = find_rig_in_model(mujoco.MjModel.from_xml_path(str(MODEL)))

pytestmark = pytest.mark.filterwarnings("error")


def repeated(clip, start, seconds, fps=None):
    """A clip that begins `start` s into a loop."""
    fps = fps or clip.fps
    poses = [clip.sample(start + t) for t in np.arange(round(seconds * fps) + 1) / fps]
    return Clip(
        skeleton=clip.skeleton,
        fps=fps,
        root_positions=np.array([p.root_position for p in poses]),
        rotations=np.array([p.rotations for p in poses]),
    )


def moved(clip, yaw, place=(0.0, 0.0, 0.0)):
    turn = qa.about([0, 0, 1], np.broadcast_to(yaw, len(clip)))
    rotations = clip.rotations.copy()
    rotations[:, 0] = qa.mul(turn, rotations[:, 0])
    roots = qa.rotate(turn, clip.root_positions) + np.asarray(place)
    return replace(clip, root_positions=roots, rotations=rotations)


def played(placed, frames):
    """Joints of a cycle in place, carried by its root: what a viewer sees, (frames, J, 3)."""
    positions, _ = placed.clip.model_pose()
    t = np.arange(frames) / placed.clip.fps
    rate, v = placed.yaw_rate, complex(*placed.velocity)
    swept = t if rate == 0.0 else (np.exp(1j * rate * t) - 1) / (1j * rate)
    gone = np.stack([(v * swept).real, (v * swept).imag, 0 * t], axis=-1)
    again = positions[np.arange(frames) % (len(positions) - 1)]
    return qa.rotate(qa.about([0, 0, 1], rate * t)[:, None], again) + gone[:, None]


@pytest.mark.parametrize("start", [0.0, 0.31, 0.8])
@pytest.mark.parametrize("name", ["walk", "run", "turn_in_place"])
def test_the_period_of_a_gait_is_found(name, start):
    clip = getattr(gait, name)(RIG)
    first, last = find_loop(repeated(clip, start, 3.4 * clip.duration), RIG)
    assert last - first == len(clip) - 1


def test_the_period_is_found_in_a_long_clip_to_the_frame():
    clip = gait.walk(RIG, fps=120.0)
    long = repeated(clip, 0.1, 20 * clip.duration)
    # Only one cycle of it is quite like the one before.
    rng = np.random.default_rng(1)
    wobble = rng.normal(size=len(long)).cumsum() * 0.002
    a = 9 * (len(clip) - 1) + 5
    wobble[a : a + len(clip) + 8] = wobble[a]
    arm = RIG.skeleton.index("left_upper_arm")
    rotations = long.rotations.copy()
    rotations[:, arm] = qa.mul(rotations[:, arm], qa.about([0, 1, 0], wobble))
    first, last = find_loop(replace(long, rotations=rotations), RIG)
    assert abs((last - first) - (len(clip) - 1)) <= 1


def test_a_clip_in_which_nothing_returns_is_taken_whole():
    clip = gait.walk(RIG)
    short = repeated(clip, 0.0, 0.6 * clip.duration)
    assert find_loop(short, RIG) == (0, len(short) - 1)
    for frames in (1, 2, 5):
        assert find_loop(short.cut(0, frames), RIG) == (0, frames - 1)


def test_a_loop_is_found_wherever_it_goes():
    clip = repeated(gait.walk(RIG), 0.2, 2.6)
    first, last = find_loop(moved(clip, -1.9, (40.0, -7.0, 2.0)), RIG)
    assert last - first == len(gait.walk(RIG)) - 1


@pytest.mark.parametrize("rate", [-150.0, -90.0, 5.0, 90.0, 180.0])
def test_a_loop_that_turns_keeps_its_rate_and_turns_on_the_spot(rate):
    placed = put_in_place(gait.turn_in_place(RIG, rate_deg=rate), RIG)
    assert placed.yaw_rate == pytest.approx(math.radians(rate), rel=1e-9)
    assert np.hypot(*placed.velocity) < 1e-9
    assert placed.seam < 1e-9


@pytest.mark.parametrize("yaw", [0.0, -math.pi / 2, 3.0])
def test_a_walk_in_place_goes_forward_whichever_way_it_went(yaw):
    clip = moved(gait.walk(RIG), yaw, (5.0, 2.0, 0.0))
    placed = put_in_place(clip, RIG)
    assert placed.velocity == pytest.approx([1.3, 0.0], abs=1e-9)
    assert placed.yaw_rate == 0.0
    assert np.abs(headings(placed.clip, RIG)[:-1].mean()) < 1e-6
    assert placed.clip.root_positions[:, :2].mean(axis=0) == pytest.approx([0, 0], abs=0.1)


@pytest.mark.parametrize(("astray", "forward"), [(0.5, True), (1.2, False), (math.pi, False)])
def test_a_body_that_faces_far_from_its_way_walks_sideways_or_backward(astray, forward):
    """The body is turned on its path; near enough to it, it is said to walk forward."""
    clip = gait.walk(RIG)
    turn = qa.about([0, 0, 1], astray)
    rotations = clip.rotations.copy()
    rotations[:, 0] = qa.mul(turn, rotations[:, 0])
    placed = put_in_place(replace(clip, rotations=rotations), RIG)
    way = 0.0 if forward else -astray
    want = 1.3 * np.array([math.cos(way), math.sin(way)])
    assert placed.velocity == pytest.approx(want, abs=1e-6)


@settings(max_examples=15, deadline=None)
@given(rate=st.floats(-2.5, 2.5), yaw=st.floats(-3.0, 3.0), ahead=st.floats(-1.5, 1.5))
def test_a_cycle_carried_by_its_root_is_the_motion_it_was_cut_from(rate, yaw, ahead):
    """A walk bent to an arc: the root's path and the pose in place give it back, and go on."""
    base = gait.turn_in_place(RIG, rate_deg=60.0)
    t = base.times
    turn = (
        np.asarray(math.radians(60.0) * t + (rate - math.radians(60.0)) * t) - math.radians(60) * t
    )
    way = np.exp(1j * (rate * t + yaw))
    swept = t * np.exp(1j * yaw) if abs(rate) < 1e-6 else (way - way[0]) / (1j * rate)
    travel = ahead * swept
    roots = qa.rotate(qa.about([0, 0, 1], turn + yaw), base.root_positions)
    roots += np.stack([travel.real, travel.imag, 0 * t], axis=-1)
    rotations = base.rotations.copy()
    rotations[:, 0] = qa.mul(qa.about([0, 0, 1], turn + yaw), rotations[:, 0])
    clip = replace(base, root_positions=roots, rotations=rotations)
    placed = put_in_place(clip, RIG)
    assert placed.seam < 1e-5
    seen, _ = clip.model_pose()
    got = played(placed, len(clip))
    # They differ by one fixed move of the whole: distances between frames tell.
    for a, b in ((0, len(t) // 2), (len(t) // 3, -1), (0, -1)):
        want = np.linalg.norm(seen[a][:, None] - seen[b][None], axis=-1)
        assert np.linalg.norm(got[a][:, None] - got[b][None], axis=-1) == pytest.approx(
            want, abs=1e-4
        )


def soft(clip, seed=0, size=0.06):
    """A cycle whose pose drifts and whose pace changes, as a captured one does."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, len(clip))
    axes = rng.normal(size=(len(RIG.skeleton), 2, 3)) * size
    rotvec = s[:, None, None] * axes[:, 0] + (s**2)[:, None, None] * axes[:, 1]
    angle = np.linalg.norm(rotvec, axis=-1)
    drift = np.concatenate(
        [np.cos(angle / 2)[..., None], 0.5 * np.sinc(angle / 2 / np.pi)[..., None] * rotvec], -1
    )
    roots = clip.root_positions + np.multiply.outer(s**2, rng.normal(size=3) * size)
    return replace(clip, rotations=qa.mul(clip.rotations, drift), root_positions=roots, loop=False)


def velocity_gap(clip):
    """Largest difference of any joint's velocity before the seam and after it, m/s."""
    positions, _ = clip.model_pose()
    steps = np.diff(positions, axis=0) * clip.fps
    return np.linalg.norm(steps[0] - steps[-1], axis=-1).max()


@pytest.mark.parametrize("seed", range(4))
def test_a_soft_seam_is_closed_without_a_jump_in_pose_or_velocity(seed):
    clip = soft(gait.idle(RIG, seconds=2.0, fps=120.0), seed)
    placed = put_in_place(clip, RIG)
    assert placed.seam > 0.02
    assert (placed.clip.root_positions[0] == placed.clip.root_positions[-1]).all()
    same = np.abs(np.sum(placed.clip.rotations[0] * placed.clip.rotations[-1], axis=-1))
    assert same == pytest.approx(1.0, abs=1e-12)
    gap = velocity_gap(put_in_place(clip, RIG, close=False).clip)
    assert gap > 0.05
    assert velocity_gap(placed.clip) < 0.3 * gap


def test_closing_changes_the_middle_of_a_cycle_by_its_drift_alone():
    clip = soft(gait.walk(RIG, fps=120.0))
    before = put_in_place(clip, RIG, close=False)
    after = put_in_place(clip, RIG)
    off = np.linalg.norm(after.clip.model_pose()[0] - before.clip.model_pose()[0], axis=-1)
    assert off.max() <= 1.1 * before.seam
    assert before.seam == after.seam


def test_an_exact_loop_is_left_as_it_is():
    for clip in (gait.walk(RIG), gait.run(RIG)):
        open_ended, closed = put_in_place(clip, RIG, close=False), put_in_place(clip, RIG)
        assert open_ended.clip.rotations == pytest.approx(closed.clip.rotations, abs=1e-12)
        assert open_ended.clip.root_positions == pytest.approx(
            closed.clip.root_positions, abs=1e-12
        )


def test_small_travel_and_turns_of_a_found_cycle_are_drift_but_those_of_a_loop_are_not():
    idle = gait.idle(RIG, seconds=2.0)
    share = np.linspace(0.0, 1.0, len(idle))
    clip = moved(idle, 0.05 * share, np.multiply.outer(share, [0.015, 0.0, 0.0]))
    found = put_in_place(replace(clip, loop=False), RIG)
    assert found.velocity.tolist() == [0.0, 0.0]
    assert found.yaw_rate == 0.0
    assert found.seam > 0.01
    given_loop = put_in_place(clip, RIG)
    assert given_loop.yaw_rate == pytest.approx(0.025)
    assert np.hypot(*given_loop.velocity) > 0.005
    assert given_loop.seam < 1e-3


def test_translations_are_closed_too():
    clip = soft(gait.walk(RIG))
    share = np.linspace(0.0, 1.0, len(clip))[:, None, None]
    moves = np.tile(RIG.skeleton.offsets, (len(clip), 1, 1)) + 0.01 * share
    placed = put_in_place(replace(clip, translations=moves), RIG)
    assert placed.clip.translations is not None
    assert (placed.clip.translations[0] == placed.clip.translations[-1]).all()
    assert np.ptp(placed.clip.translations, axis=0).max() < 0.011


def test_the_heading_holds_still_in_a_somersault():
    clip = gait.walk(RIG)
    flip = qa.about([0, 1, 0], np.linspace(0.0, 2 * np.pi, len(clip)))
    rotations = clip.rotations.copy()
    rotations[:, 0] = qa.mul(flip, rotations[:, 0])
    over = headings(replace(clip, rotations=rotations), RIG)
    assert abs(over[-1] - over[0]) < 1e-6


@pytest.mark.parametrize("frames", [1, 2, 3, 4])
def test_cycles_of_some_frames_are_put_in_place(frames):
    for clip in (gait.walk(RIG), gait.idle(RIG)):
        placed = put_in_place(clip.cut(0, frames), RIG)
        assert np.isfinite(placed.velocity).all()
        assert np.isfinite(placed.clip.rotations).all()
        assert np.isfinite(placed.clip.root_positions).all()
