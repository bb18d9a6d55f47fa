import numpy as np
import pytest

from footik_runtime import gait
from footik_runtime.builtin import humanoid_rig
from footik_runtime.errors import FootIKError
from footik_runtime.offline.filters import runs
from footik_runtime.offline.skate import GROUNDS, KINDS, inject, true_walk
from footik_runtime.offline.solve_legs import leg_spans
from footik_runtime.phases import Phase
from footik_runtime.sole import BALL, HEEL, all_sole_points

RIG = humanoid_rig()
WALK = gait.walk(RIG)
TRUTHS = {ground: true_walk(WALK, RIG, ground=ground) for ground in GROUNDS}


def soles(clip):
    return all_sole_points(RIG, *clip.model_pose())


@pytest.mark.parametrize("ground", GROUNDS)
def test_true_feet_stand_still_on_their_ground(ground):
    truth = TRUTHS[ground]
    steps = np.linalg.norm(np.diff(truth.soles, axis=0), axis=-1)
    for phase, points in (
        (Phase.HEEL, [HEEL]),
        (Phase.FLAT, [HEEL, BALL]),
        (Phase.BALL, [BALL]),
    ):
        stays = (truth.phases[1:] == phase) & (truth.phases[:-1] == phase)
        assert steps[stays][:, points].max() < 1e-9
        stands = truth.soles[truth.phases == phase][:, points].reshape(-1, 3)
        assert np.abs(stands[:, 2] - truth.height(stands)).max() < 1e-9
    assert not truth.clip.curves
    assert not truth.clip.loop


@pytest.mark.parametrize("ground", GROUNDS)
def test_true_feet_are_far_enough_from_the_end_of_their_legs(ground):
    truth = TRUTHS[ground]
    length, extension = leg_spans(RIG, truth.clip.model_pose()[0])
    assert (extension / length).max() < 0.9851


def test_slopes_tilt_the_feet_and_stairs_do_not():
    for ground, rise in (("flat", 0.0), ("slope", 0.15), ("stairs", 0.0)):
        truth = TRUTHS[ground]
        flat = truth.phases == Phase.FLAT
        along = truth.soles[flat][:, BALL] - truth.soles[flat][:, HEEL]
        assert np.abs(along[:, 2] / along[:, 0] - rise).max() < 0.01
    assert np.ptp(TRUTHS["stairs"].clip.root_positions[:, 2]) > 0.8


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("kind", [k for k in KINDS if k != "drift"])
def test_slides_are_zero_on_average_and_along_the_ground(kind, ground):
    truth = TRUTHS[ground]
    clip = inject(truth, kind, 0.004 if kind == "noise" else 0.02, seed=1)
    joints = [leg.ankle for leg in RIG.legs]
    moved = clip.model_pose()[0][:, joints] - truth.clip.model_pose()[0][:, joints]
    normal = truth.normal(np.zeros((1, 3)))[0]
    assert np.abs(moved[truth.phases > 0] @ normal).max() < 1e-9
    for f in range(2):
        for start, stop in runs(truth.phases[:, f] != Phase.SWING):
            assert np.linalg.norm(moved[start:stop, f].mean(axis=0)) < 1e-9
            if kind == "constant" and stop - start > 1:
                step = np.linalg.norm(np.diff(moved[start:stop, f], axis=0)[:, :2], axis=-1)
                assert step.sum() == pytest.approx(0.02, rel=1e-6)
    turned = (clip.rotations != truth.clip.rotations).any(axis=(0, 2))
    assert set(np.flatnonzero(turned)) == {j for g in RIG.legs for j in (g.hip, g.knee, g.ankle)}


def test_slides_leave_no_jump():
    truth = TRUTHS["flat"]
    joints = [leg.ankle for leg in RIG.legs]
    clip = inject(truth, "constant", 0.02)
    moved = clip.model_pose()[0][:, joints] - truth.clip.model_pose()[0][:, joints]
    assert np.linalg.norm(np.diff(moved, axis=0), axis=-1).max() < 0.004


def test_drift_carries_the_whole_body():
    truth = TRUTHS["flat"]
    clip = inject(truth, "drift", 0.08)
    moved = soles(clip) - truth.soles
    assert np.ptp(moved[:, 0], axis=1).max() < 1e-9
    way = moved[-1, 0, 0] - moved[0, 0, 0]
    assert np.linalg.norm(way) == pytest.approx(0.08)
    assert (clip.rotations == truth.clip.rotations).all()


def test_same_seed_same_clip():
    truth = TRUTHS["flat"]
    a, b, c = (inject(truth, "noise", 0.004, seed=s) for s in (5, 5, 6))
    assert (a.rotations == b.rotations).all()
    assert (a.rotations != c.rotations).any()
    assert (inject(truth, "constant", 0.0).root_positions == truth.clip.root_positions).all()


def test_places_are_those_of_the_flat_foot():
    truth = TRUTHS["flat"]
    places = truth.places(0)
    assert len(places) >= 4
    for start, stop, place in places:
        flat = truth.phases[start:stop, 0] == Phase.FLAT
        middle = truth.soles[start:stop, 0][flat][:, [HEEL, BALL]].mean(axis=1)
        assert np.abs(middle - place).max() < 1e-9


def test_unknown_names_are_refused():
    with pytest.raises(FootIKError, match="stairs"):
        true_walk(WALK, RIG, ground="stair")
    with pytest.raises(FootIKError, match="constant"):
        inject(TRUTHS["flat"], "constnt", 0.01)
    with pytest.raises(FootIKError, match="size"):
        inject(TRUTHS["flat"], "constant", float("nan"))
    with pytest.raises(FootIKError, match="LeftFootPhase"):
        true_walk(TRUTHS["flat"].clip, RIG)
