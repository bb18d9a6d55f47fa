"""Rigs: hips, legs and soles found by name, by shape, in models, or given."""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from footik_runtime.errors import FootIKError
from footik_runtime.math3d import quat_axis_angle, quat_mul, rotate
from footik_runtime.rig import Rig, Sole, find_rig
from footik_runtime.rig_model import find_rig_in_model
from footik_runtime.skeleton import Skeleton

SHARED = Path(os.environ.get("FOOTIK_SHARED", Path(__file__).parents[1] / "../shared"))
needs_shared = pytest.mark.skipif(
    not (SHARED / "data").exists(), reason="needs the shared data (FOOTIK_SHARED)"
)

# A leg's places from the hip down: (x, y, z) with y outwards to the left.
_PLACES = {"hip": (0, 0.1, 0.9), "knee": (0.01, 0.1, 0.5), "ankle": (0, 0.1, 0.1)}
_PLACES |= {"toe": (0.14, 0.1, 0.03), "end": (0.2, 0.1, 0.03)}


def skeleton_at(joints: list[tuple[str, str | None, tuple[float, float, float]]]) -> Skeleton:
    """Joints (name, parent's name, place in the model frame), unturned in the rest pose."""
    names = [name for name, _, _ in joints]
    places = np.array([place for _, _, place in joints], dtype=float)
    parents = np.array([-1 if parent is None else names.index(parent) for _, parent, _ in joints])
    offsets = np.where(parents[:, None] >= 0, places - places[parents], places)
    return Skeleton(names=tuple(names), parents=parents, offsets=offsets)


def person(
    hips: str,
    leg: list[tuple[str, str]],
    sides: tuple[str, str],
    arm: tuple[str, str, str] = ("{}Arm", "{}ForeArm", "{}Hand"),
    scale: float = 1.0,
) -> Skeleton:
    """A standing figure: `leg` is a list of (name pattern, part), top down, in one chain."""

    def at(x: float, y: float, z: float) -> tuple[float, float, float]:
        return (scale * x, scale * y, scale * z)

    joints: list[tuple[str, str | None, tuple[float, float, float]]] = [(hips, None, at(0, 0, 1))]
    joints += [("Spine", hips, at(0, 0, 1.2)), ("Head", "Spine", at(0, 0, 1.6))]
    for sign, side in zip((1.0, -1.0), sides, strict=True):
        parent = hips
        for pattern, part in leg:
            x, y, z = _PLACES.get(part, (0.0, 0.0, 1.0))
            joints.append((pattern.format(side), parent, at(x, sign * y, z)))
            parent = pattern.format(side)
        parent = "Spine"
        for out, pattern in zip((0.2, 0.5, 0.7), arm, strict=True):
            joints.append((pattern.format(side), parent, at(0, sign * out, 1.4)))
            parent = pattern.format(side)
    return skeleton_at(joints)


def parts(*names: str) -> list[tuple[str, str]]:
    """Patterns of hip, knee, ankle, toe joint, in that order."""
    return list(zip(names, ("hip", "knee", "ankle", "toe"), strict=False))


MIXAMO = parts("{}UpLeg", "{}Leg", "{}Foot", "{}ToeBase")
LR, LONG, SHORT, SMALL = ("l", "r"), ("Left", "Right"), ("L", "R"), ("left", "right")
CONVENTIONS = {
    "cmu": ("root", [("{}hipjoint", ""), *parts("{}femur", "{}tibia", "{}foot", "{}toes")], LR),
    "cmu names of motionbuilder": ("Hips", [("{}Joint", ""), *MIXAMO], LONG),
    "mixamo": ("mixamorig:Hips", [("mixamorig:" + p, w) for p, w in MIXAMO], LONG),
    "mixamo numbered": ("mixamorig9:Hips", [("mixamorig9:" + p, w) for p, w in MIXAMO], LONG),
    "mixamo with end": ("Hips", [*MIXAMO, ("{}Toe_End", "end")], LONG),
    "mixamo in a namespace": ("a|b:Hips", [("a|b:" + p, w) for p, w in MIXAMO], LONG),
    "human ik": ("Character1_Hips", [("Character1_" + p, w) for p, w in MIXAMO], LONG),
    "unity": ("Hips", parts("{}UpperLeg", "{}LowerLeg", "{}Foot", "{}Toes"), LONG),
    "vrm": (
        "J_Bip_C_Hips",
        [
            (f"J_Bip_{p}", w)
            for p, w in parts("{}_UpperLeg", "{}_LowerLeg", "{}_Foot", "{}_ToeBase")
        ],
        SHORT,
    ),
    "unreal": ("pelvis", parts("thigh_{}", "calf_{}", "foot_{}", "ball_{}"), LR),
    "lafan1": ("Hips", parts("{}UpLeg", "{}Leg", "{}Foot", "{}Toe"), LONG),
    "smpl": ("Pelvis", parts("{}_Hip", "{}_Knee", "{}_Ankle", "{}_Foot"), SHORT),
    "smpl long": ("pelvis", parts("{}_hip", "{}_knee", "{}_ankle", "{}_foot"), SMALL),
    "smpl fbx": ("m_avg_Pelvis", parts("m_avg_{}_Hip", "m_avg_{}_Knee", "m_avg_{}_Ankle"), SHORT),
    "kaykit": ("hips", parts("upperleg.{}", "lowerleg.{}", "foot.{}", "toes.{}"), LR),
    "blender": ("hips", parts("thigh.{}", "shin.{}", "foot.{}", "toe.{}"), SHORT),
    "vicon": ("Hips", parts("{}Hip", "{}Knee", "{}Ankle", "{}Toe"), LONG),
    "vicon, foot and toes": ("Hips", parts("{}Hip", "{}Knee", "{}Foot", "{}Toes"), LONG),
    "biped": (
        "Bip01 Pelvis",
        parts(*(f"Bip01 {{}} {w}" for w in ("Thigh", "Calf", "Foot", "Toe0"))),
        SHORT,
    ),
    "cesium man": ("torso_joint_1", parts(*(f"leg_joint_{{}}_{n}" for n in (1, 2, 3, 5))), SHORT),
    "our humanoid": ("pelvis", parts("{}_thigh", "{}_shin", "{}_foot", "{}_toes"), SMALL),
    "ozz": ("Hips", parts("{}UpLeg", "{}Leg", "{}Foot", "{}FootThumb1"), LONG),
    "mujoco": ("torso", parts("thigh_{}", "shin_{}", "foot_{}"), SMALL),
    "lower case": ("hips", parts("{}upleg", "{}leg", "{}foot", "{}toebase"), SMALL),
    "deepmimic": ("root", parts("{}_hip", "{}_knee", "{}_ankle"), SMALL),
}


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_each_convention_names_its_legs(convention: str) -> None:
    hips, leg, sides = CONVENTIONS[convention]
    rig = find_rig(person(hips, leg, sides))
    named = {part: pattern for pattern, part in leg}
    assert rig.skeleton.names[rig.hips] == hips
    assert [leg.name for leg in rig.legs] == ["left", "right"]
    for found, side in zip(rig.legs, sides, strict=True):
        joints = (found.hip, found.knee, found.ankle, found.toe)
        for part, joint in zip(("hip", "knee", "ankle", "toe"), joints, strict=True):
            expected = named[part].format(side) if part in named else None
            assert (rig.skeleton.names[joint] if joint >= 0 else None) == expected, part
    assert not any("guess:" in note for note in rig.notes)
    np.testing.assert_allclose(rig.forward, [1.0, 0.0, 0.0], atol=1e-12)


def test_twist_roll_and_control_joints_are_passed_over() -> None:
    leg = [("thigh_{}", "hip"), ("thigh_twist_01_{}", "hip"), ("calf_{}", "knee")]
    leg += [("calf_roll_{}", "knee"), ("foot_{}", "ankle"), ("foot_IK_{}", "ankle")]
    rig = find_rig(person("pelvis", [*leg, ("ball_{}", "toe")], LR))
    found = [rig.skeleton.names[j] for j in (rig.legs[0].hip, rig.legs[0].knee, rig.legs[0].ankle)]
    assert found == ["thigh_l", "calf_l", "foot_l"]


def test_a_robots_leg_runs_from_its_first_hip_joint_to_its_last_ankle() -> None:
    leg = [("{}_hip_pitch_link", "hip"), ("{}_hip_roll_link", "hip"), ("{}_knee_link", "knee")]
    leg += [("{}_ankle_pitch_link", "ankle"), ("{}_ankle_roll_link", "ankle")]
    rig = find_rig(person("pelvis", leg, SMALL))
    found = [rig.skeleton.names[j] for j in (rig.legs[1].hip, rig.legs[1].ankle)]
    assert found == ["right_hip_pitch_link", "right_ankle_roll_link"]


def test_hips_carry_the_head_even_where_the_pelvis_is_below_the_torso() -> None:
    joints = [("torso", None, (0, 0, 1.3)), ("head", "torso", (0, 0, 1.6))]
    joints += [("pelvis", "torso", (0, 0, 1.0))]
    for side, y in (("left", 0.1), ("right", -0.1)):
        joints += [
            (f"thigh_{side}", "pelvis", (0, y, 0.9)),
            (f"shin_{side}", f"thigh_{side}", (0, y, 0.5)),
        ]
        joints += [(f"foot_{side}", f"shin_{side}", (0, y, 0.1))]
    rig = find_rig(skeleton_at(joints))
    assert rig.skeleton.names[rig.hips] == "torso"


# --- by shape -------------------------------------------------------------------------------


def test_legs_without_telling_names_are_found_by_shape_and_noted_as_a_guess() -> None:
    leg = [("{}1", "hip"), ("{}2", "knee"), ("{}3", "ankle"), ("{}4", "toe"), ("{}5", "end")]
    rig = find_rig(person("p", leg, ("a", "b"), arm=("{}7", "{}8", "{}9")))
    names = rig.skeleton.names
    assert [names[j] for j in (rig.legs[0].hip, rig.legs[0].knee, rig.legs[0].ankle)] == [
        "a1",
        "a2",
        "a3",
    ]
    assert names[rig.legs[0].toe] == "a4"
    assert rig.legs[1].name == "right"
    assert names[rig.legs[1].knee] == "b2"
    assert any("a guess" in note for note in rig.notes)


def test_arms_alone_are_no_legs() -> None:
    with pytest.raises(FootIKError, match="no legs found"):
        find_rig(person("p", [], ("a", "b"), arm=("{}7", "{}8", "{}9")))


# --- directions -----------------------------------------------------------------------------


def turned(skeleton: Skeleton, yaw: float) -> Skeleton:
    """The same figure, its root turned about z."""
    rest = skeleton.rest_rotations.copy()
    rest[0] = quat_mul(quat_axis_angle((0.0, 0.0, 1.0), yaw), tuple(rest[0]))
    return Skeleton(
        names=skeleton.names,
        parents=skeleton.parents,
        offsets=skeleton.offsets,
        rest_rotations=rest,
    )


@pytest.mark.parametrize("yaw", [0.5, 2.0, -3.0])
def test_forward_and_sole_turn_with_the_figure(yaw: float) -> None:
    rig = find_rig(turned(person("Hips", MIXAMO, LONG), yaw))
    np.testing.assert_allclose(rig.forward, [np.cos(yaw), np.sin(yaw), 0.0], atol=1e-12)
    _, rotations = rig.skeleton.rest_pose()
    for leg in rig.legs:
        world = quat_mul(tuple(rotations[leg.ankle]), tuple(leg.sole.frame))
        np.testing.assert_allclose(rotate(world, (1.0, 0.0, 0.0)), rig.forward, atol=1e-12)
        np.testing.assert_allclose(rotate(world, (0.0, 0.0, 1.0)), [0, 0, 1], atol=1e-12)
        toes = quat_mul(tuple(rotations[leg.toe]), tuple(leg.sole.toe_frame))
        np.testing.assert_allclose(toes, world, atol=1e-12)


def test_swapped_sides_are_noted_as_mirrored() -> None:
    rig = find_rig(person("Hips", MIXAMO, ("Right", "Left")))
    assert any("mirrored" in note for note in rig.notes)
    assert not any("mirrored" in n for n in find_rig(person("Hips", MIXAMO, LONG)).notes)


def test_feet_that_point_away_from_the_hips_facing_are_noted() -> None:
    skeleton = person("Hips", MIXAMO, LONG)
    offsets = skeleton.offsets.copy()
    for side in LONG:
        offsets[skeleton.index(f"{side}ToeBase")] = (0.1, 0.1, -0.07)
    bent = Skeleton(names=skeleton.names, parents=skeleton.parents, offsets=offsets)
    assert any("45 deg away" in note for note in find_rig(bent).notes)


def test_given_forward_wins_and_a_vertical_one_is_refused() -> None:
    skeleton = person("Hips", MIXAMO, LONG)
    np.testing.assert_allclose(find_rig(skeleton, forward=(3, 3, 5)).forward[:2], [0.5**0.5] * 2)
    with pytest.raises(FootIKError, match="not vertical"):
        find_rig(skeleton, forward=(0, 0, 1))


# --- soles ----------------------------------------------------------------------------------


def test_a_figure_standing_on_zero_has_its_sole_there() -> None:
    rig = find_rig(person("Hips", [*MIXAMO, ("{}Toe_End", "end")], LONG))
    sole = rig.legs[0].sole
    assert sole.height == pytest.approx(0.1)
    assert sole.ball == pytest.approx(0.14)
    assert sole.tip == pytest.approx(0.2)
    assert sole.heel == pytest.approx(0.2 / 3)
    assert 0.04 < sole.half_width < 0.06


def test_off_the_ground_the_height_comes_from_the_toe_and_its_thickness() -> None:
    skeleton = person("Hips", [*MIXAMO, ("{}Toe_End", "end")], LONG)
    offsets = skeleton.offsets.copy()
    offsets[0] = 0.0
    rig = find_rig(Skeleton(names=skeleton.names, parents=skeleton.parents, offsets=offsets))
    # 7 cm down to the toe joint, which lies 13 % of the foot's length of 0.2 / 0.75 m up
    assert rig.legs[1].sole.height == pytest.approx(0.07 + 0.13 * 0.2 / 0.75)


def test_a_tip_of_the_skeleton_counts_as_the_toes_end() -> None:
    skeleton = person("Hips", MIXAMO, LONG)
    toe = skeleton.index("LeftToeBase")
    with_tip = Skeleton(
        names=skeleton.names,
        parents=skeleton.parents,
        offsets=skeleton.offsets,
        tips={toe: np.array([0.08, 0.0, 0.0])},
    )
    left, right = find_rig(with_tip).legs
    assert left.sole.tip == pytest.approx(0.22)
    assert right.sole.tip == pytest.approx(1.45 * 0.14)


def test_feet_that_hang_in_the_rest_pose_get_a_sole_that_is_flat_when_they_are() -> None:
    skeleton = person("Hips", MIXAMO, LONG)
    offsets = skeleton.offsets.copy()
    offsets[0] = (0.0, 0.0, 0.0)
    for side in LONG:
        offsets[skeleton.index(f"{side}ToeBase")] = (0.0, 0.0, -0.15)
    rig = find_rig(Skeleton(names=skeleton.names, parents=skeleton.parents, offsets=offsets))
    for leg in rig.legs:
        frame = tuple(leg.sole.frame)
        assert rotate(frame, (1.0, 0.0, 0.0))[2] < -0.95  # forward is along the hanging foot
        assert rotate(frame, (0.0, 0.0, 1.0))[0] > 0.95  # and up is where its instep faces
        np.testing.assert_allclose(rotate(frame, (0.0, 1.0, 0.0)), [0, 1, 0], atol=1e-9)
        assert 0.14 < leg.sole.ball < 0.15
        toes = tuple(leg.sole.toe_frame)  # straight toes go on along the bone
        np.testing.assert_allclose(rotate(toes, (1.0, 0.0, 0.0)), [0, 0, -1], atol=1e-9)
    assert any("not flat" in note for note in rig.notes)


def splayed(angle: float) -> Skeleton:
    """A figure whose legs were splayed sideways by `angle` radians, feet rolled with them."""
    skeleton = person("Hips", [*MIXAMO, ("{}Toe_End", "end")], LONG)
    offsets = skeleton.offsets.copy()
    offsets[0] = 0.0
    for sign, side in ((1.0, "Left"), (-1.0, "Right")):
        turn = quat_axis_angle((1.0, 0.0, 0.0), sign * angle)
        for part in ("Leg", "Foot", "ToeBase", "Toe_End"):
            joint = skeleton.index(side + part)
            offsets[joint] = rotate(turn, tuple(offsets[joint]))
    return Skeleton(names=skeleton.names, parents=skeleton.parents, offsets=offsets)


def test_feet_rolled_with_splayed_legs_keep_their_sole_square_to_the_leg() -> None:
    straight, rolled = find_rig(splayed(0.0)), find_rig(splayed(0.35))
    for sign, before, after in zip((1.0, -1.0), straight.legs, rolled.legs, strict=True):
        turn = quat_axis_angle((1.0, 0.0, 0.0), sign * 0.35)
        up = rotate(turn, (0.0, 0.0, 1.0))
        np.testing.assert_allclose(rotate(tuple(after.sole.frame), (0.0, 0.0, 1.0)), up, atol=1e-9)
        assert after.sole.height == pytest.approx(before.sole.height)
        assert after.sole.ball == pytest.approx(before.sole.ball)


def test_flat_feet_under_splayed_legs_stay_flat() -> None:
    skeleton = splayed(0.35)
    offsets = skeleton.offsets.copy()
    for side in LONG:
        offsets[skeleton.index(f"{side}ToeBase")] = (0.14, 0.0, -0.07)
    rig = find_rig(Skeleton(names=skeleton.names, parents=skeleton.parents, offsets=offsets))
    for leg in rig.legs:
        np.testing.assert_allclose(rotate(tuple(leg.sole.frame), (0, 0, 1)), [0, 0, 1], atol=1e-9)


def test_a_stance_stands_in_for_a_rest_pose_that_does_not_stand() -> None:
    standing = person("Hips", MIXAMO, LONG)
    rest = standing.rest_rotations.copy()
    rest[0] = quat_axis_angle((0.0, 1.0, 0.0), 1.5)  # lies on its face
    lying = Skeleton(
        names=standing.names,
        parents=standing.parents,
        offsets=standing.offsets,
        rest_rotations=rest,
    )
    guessed, known = find_rig(lying), find_rig(lying, stance=standing.rest_rotations)
    assert any("does not stand" in note for note in guessed.notes)
    assert not any("does not stand" in note for note in known.notes)
    np.testing.assert_allclose(known.forward, [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(known.legs[0].sole.frame, [1, 0, 0, 0], atol=1e-12)
    # The guess is square to the shin, which is all but upright in this figure.
    assert abs(guessed.legs[0].sole.frame[0]) > 0.99


def test_a_rest_pose_of_bones_along_one_axis_takes_left_from_the_hips() -> None:
    joints: list[tuple[str, str | None, tuple[float, float, float]]]
    joints = [("Hips", None, (0, 0, 0)), ("Spine", "Hips", (0.3, 0, 0))]
    for sign, side in ((1.0, "Left"), (-1.0, "Right")):
        parent = "Hips"
        for part, x in (("UpLeg", 0.1), ("Leg", 0.5), ("Foot", 0.9), ("Toe", 1.05)):
            joints.append((side + part, parent, (x, 0.0, 0.1 * sign)))
            parent = side + part
    rig = find_rig(skeleton_at(joints))
    for leg in rig.legs:
        frame = tuple(leg.sole.frame)
        np.testing.assert_allclose(rotate(frame, (0, 1, 0)), [0, 0, 1], atol=1e-9)
        assert rotate(frame, (1, 0, 0))[0] > 0.95
        assert leg.sole.height == pytest.approx(0.07, abs=0.02)
    assert any("does not stand" in note for note in rig.notes)


def test_given_soles_win_and_the_others_are_guessed() -> None:
    mine = Sole(
        frame=np.array([1.0, 0, 0, 0]), height=0.5, heel=0.1, ball=0.2, tip=0.3, half_width=0.04
    )
    rig = find_rig(person("Hips", MIXAMO, LONG), soles={"left": mine})
    assert rig.legs[0].sole is mine
    assert rig.legs[1].sole.height == pytest.approx(0.1)


@settings(max_examples=25, deadline=None)
@given(scale=st.floats(0.01, 200.0), toes=st.booleans(), lift=st.sampled_from([0.0, 3.0]))
def test_soles_scale_with_the_figure(scale: float, toes: bool, lift: float) -> None:
    def rig_of(s: float) -> Rig:
        skeleton = person("Hips", MIXAMO if toes else MIXAMO[:3], LONG, scale=s)
        offsets = skeleton.offsets.copy()
        offsets[0] += (0.0, 0.0, lift * s)
        return find_rig(Skeleton(names=skeleton.names, parents=skeleton.parents, offsets=offsets))

    one, other = rig_of(1.0), rig_of(scale)
    assert one.notes == other.notes
    for a, b in zip(one.legs, other.legs, strict=True):
        for number in ("height", "heel", "ball", "tip", "half_width"):
            assert getattr(b.sole, number) == pytest.approx(scale * getattr(a.sole, number))
        np.testing.assert_allclose(a.sole.frame, b.sole.frame, atol=1e-9)
        assert 0 < a.sole.height < 0.2
        assert 0 < a.sole.ball <= a.sole.tip


place = st.tuples(*[st.floats(-1.0, 1.0, width=32)] * 3)


@settings(max_examples=60, deadline=None)
@given(places=st.lists(place, min_size=8, max_size=8))
def test_any_rest_pose_gives_finite_soles_or_one_clear_error(
    places: list[tuple[float, float, float]],
) -> None:
    joints: list[tuple[str, str | None, tuple[float, float, float]]]
    joints = [("Hips", None, (0.0, 0.0, 0.0))]
    for k, side in enumerate(LONG):
        parent = "Hips"
        for i, (pattern, _) in enumerate(MIXAMO):
            joints.append((pattern.format(side), parent, places[4 * k + i]))
            parent = pattern.format(side)
    try:
        rig = find_rig(skeleton_at(joints))
    except FootIKError:
        return
    assert np.isfinite(rig.forward).all()
    for leg in rig.legs:
        sole = leg.sole
        numbers = [sole.height, sole.heel, sole.ball, sole.tip, sole.half_width]
        assert np.isfinite(numbers).all()
        assert min(numbers) > 0
        assert np.linalg.norm(sole.frame) == pytest.approx(1.0)


# --- given legs, and wrong input ----------------------------------------------------------------


def test_given_legs_and_hips_are_taken() -> None:
    skeleton = person("Hips", [("{}A", "hip"), ("{}B", "knee"), ("{}C", "ankle")], LONG)
    rig = find_rig(
        skeleton,
        hips="Spine",
        legs={"right": ("RightA", "RightB", "RightC", None), "left": ("LeftA", "LeftB", "LeftC")},
    )
    assert [leg.name for leg in rig.legs] == ["left", "right"]
    assert rig.legs[0].toe == -1
    assert skeleton.names[rig.hips] == "Spine"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"legs": {"left": ("LeftUpLeg", "LeftLeg", "LeftFot")}}, "mean 'LeftFoot'"),
        ({"legs": {"left": ("LeftUpLeg", "RightLeg", "RightFoot")}}, "not a chain: 'RightLeg'"),
        ({"legs": {"left": ("LeftLeg", "LeftLeg", "LeftFoot")}}, "not a chain"),
        ({"legs": {"left": ("LeftUpLeg", "LeftLeg")}}, "needs the names of hip, knee, ankle"),
        ({"legs": {"left": "LeftUpLeg"}}, "needs the names"),
        ({"legs": {}}, "at least one leg"),
        ({"hips": "Hip"}, "mean 'Hips'"),
        ({"soles": {"lefty": None}}, r"unknown leg 'lefty'\. Did you mean 'left'"),
        ({"stance": np.zeros((3, 4))}, "stance must be"),
        ({"forward": (1.0, 0.0)}, "forward must be 3 numbers"),
    ],
)
def test_wrong_arguments_say_what_would_be_right(arguments: dict, message: str) -> None:
    with pytest.raises(FootIKError, match=message):
        find_rig(person("Hips", MIXAMO, LONG), **arguments)


def test_no_legs_lists_joints_nearest_guesses_and_the_way_out() -> None:
    names = ["LeftUpLeg", "LeftLag", "LeftFoot", "RightUpLeg", "RightFoot"]
    skeleton = skeleton_at([("Hips", None, (0, 0, 1)), *((n, "Hips", (0, 0, 1)) for n in names)])
    with pytest.raises(FootIKError) as caught:
        find_rig(skeleton)
    message = str(caught.value)
    assert "no legs found" in message
    assert "6 joints (Hips, LeftUpLeg" in message
    assert "left shin 'LeftLag'" in message
    assert 'legs={"left": ("thigh", "shin", "foot", "toes")' in message


def test_a_leg_without_length_is_refused() -> None:
    skeleton = skeleton_at(
        [(n, p, (0, 0, 0)) for n, p in zip("abc", (None, "a", "b"), strict=True)]
    )
    with pytest.raises(FootIKError, match="leg 'left' has no length"):
        find_rig(skeleton, legs={"left": ("a", "b", "c")})


def test_describe_names_joints_lengths_and_soles() -> None:
    text = find_rig(person("Hips", MIXAMO, LONG)).describe()
    assert "LeftUpLeg > LeftLeg > LeftFoot > LeftToeBase, 80.0 cm" in text
    assert "sole 10.0 cm under the ankle" in text
    assert "forward (1.00, 0.00, 0.00)" in text
    assert "note" in text


# --- MuJoCo models ----------------------------------------------------------------------------

LEG_XML = """<body name="{s}_thigh" pos="0 {y} 0"><joint axis="0 1 0" name="{s}_a"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".05"/>
  <body name="{s}_shin" pos="0 0 -.4"><joint axis="0 1 0" name="{s}_b"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".04"/>
    <body name="{s}_foot" pos="0 0 -.4"><joint axis="0 1 0" name="{s}_c"/>
      <geom type="box" pos=".05 0 -.04" size=".1 .04 .03"/>
      <geom type="sphere" pos="0 0 .3" size=".5" contype="0" conaffinity="0"/>
    </body></body></body>"""


def model_of(body: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody><body name='ball' pos='5 0 0'><freejoint/><geom size='.1'/></body>"
        f"<body name='pelvis' pos='0 0 1'><freejoint/><geom size='.1'/>{body}</body>"
        "</worldbody></mujoco>"
    )


def test_soles_of_a_model_are_measured_from_the_geoms_that_touch() -> None:
    model = model_of(LEG_XML.format(s="left", y=0.1) + LEG_XML.format(s="right", y=-0.1))
    rig = find_rig_in_model(model)
    assert rig.skeleton.names[rig.hips] == "pelvis"
    for leg in rig.legs:
        assert leg.sole.height == pytest.approx(0.07)
        assert leg.sole.heel == pytest.approx(0.05)
        assert leg.sole.tip == pytest.approx(0.15)
        assert leg.sole.half_width == pytest.approx(0.04)
    assert any("measured from the geoms" in note for note in rig.notes)


def test_bodies_without_telling_names_are_read_by_their_joints() -> None:
    xml = LEG_XML.format(s="left", y=0.1) + LEG_XML.format(s="right", y=-0.1)
    for part, joint in (("thigh", "a"), ("shin", "b"), ("foot", "c")):
        for side, tag in (("left", "q"), ("right", "w")):
            xml = xml.replace(f'name="{side}_{part}"', f'name="{tag}{joint}"')
            xml = xml.replace(f'name="{side}_{joint}"', f'name="{side}_{part}"')
    rig = find_rig_in_model(model_of(xml))
    assert rig.skeleton.names[rig.legs[0].ankle] == "qc"
    assert not any("a guess" in note for note in rig.notes)


def test_a_model_without_legs_and_an_unknown_root_say_so() -> None:
    with pytest.raises(FootIKError, match="no legs found in the MuJoCo model"):
        find_rig_in_model(model_of(""))
    with pytest.raises(FootIKError, match=r"unknown body 'pelvs'\. Did you mean 'pelvis'"):
        find_rig_in_model(model_of(""), root_body="pelvs")
    empty = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(FootIKError, match="no bodies"):
        find_rig_in_model(empty)


# --- real files ---------------------------------------------------------------------------------

HUMAN = ["left", "right"]
ANIMAL = ["left_front", "right_front", "left_hind", "right_hind"]


@needs_shared
@pytest.mark.parametrize(
    ("file", "legs", "first", "heights"),
    [
        ("humanoid.xml", HUMAN, ("thigh_left", "shin_left", "foot_left"), (0.02, 0.04)),
        ("humanoid_CMU.xml", HUMAN, ("lfemur", "ltibia", "lfoot"), (0.04, 0.07)),
        ("humanoid_CMU_V2020.xml", HUMAN, ("lfemur", "ltibia", "lfoot"), (0.04, 0.07)),
        (
            "g1_collision_only.xml",
            HUMAN,
            ("left_hip_pitch_link", "left_knee_link", "left_ankle_roll_link"),
            (0.03, 0.04),
        ),
        ("go1_collision_only.xml", ANIMAL, ("FL_thigh", "FL_calf", "FL_calf_foot"), (0.02, 0.03)),
        (
            "quadruped.xml",
            ANIMAL,
            ("hip_front_left", "knee_front_left", "ankle_front_left"),
            (0.3, 0.45),
        ),
    ],
)
def test_real_models(file: str, legs: list, first: tuple, heights: tuple) -> None:
    rig = find_rig_in_model(mujoco.MjModel.from_xml_path(str(SHARED / "data/mjcf" / file)))
    assert [leg.name for leg in rig.legs] == legs
    leg = rig.legs[0]
    assert tuple(rig.skeleton.names[j] for j in (leg.hip, leg.knee, leg.ankle)) == first
    for leg in rig.legs:
        assert heights[0] < leg.sole.height < heights[1]
    if "CMU" not in file:  # those face -y
        np.testing.assert_allclose(rig.forward, [1.0, 0.0, 0.0], atol=0.01)


def glb_skeleton(file: Path, scale: float = 1.0) -> Skeleton:
    """Joints of a GLB file's first skin at their nodes' rest places, z up, all unturned."""
    data = file.read_bytes()
    chunk = json.loads(data[20 : 20 + struct.unpack("<I", data[12:16])[0]])
    nodes = chunk["nodes"]
    parent = {c: i for i, node in enumerate(nodes) for c in node.get("children", [])}

    def world(i: int) -> np.ndarray:
        node, local = nodes[i], np.eye(4)
        if "matrix" in node:
            local = np.array(node["matrix"], dtype=float).reshape(4, 4).T
        else:
            x, y, z, w = node.get("rotation", (0, 0, 0, 1))
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, np.array([w, x, y, z], dtype=float))
            local[:3, :3] = turn.reshape(3, 3) * np.array(node.get("scale", (1, 1, 1)))
            local[:3, 3] = node.get("translation", (0, 0, 0))
        return world(parent[i]) @ local if i in parent else local

    skin = set(chunk["skins"][0]["joints"])
    joints: list[tuple[str, str | None, tuple[float, float, float]]] = []

    def visit(i: int, above: str | None) -> None:
        x, y, z = scale * world(i)[:3, 3]
        joints.append((nodes[i]["name"], above, (z, x, y)))
        for child in nodes[i].get("children", []):
            if child in skin:
                visit(child, nodes[i]["name"])

    visit(next(j for j in chunk["skins"][0]["joints"] if parent.get(j) not in skin), None)
    return skeleton_at(joints)


@needs_shared
@pytest.mark.parametrize(
    ("file", "scale", "legs", "last"),
    [
        ("Knight.glb", 1.0, HUMAN, ("upperleg.r", "lowerleg.r", "foot.r", "toes.r")),
        ("CesiumMan.glb", 1.0, HUMAN, tuple(f"leg_joint_R_{n}" for n in (1, 2, 3, 5))),
        (
            "Fox.glb",
            0.01,
            ANIMAL,
            # What it calls the first foot is the hock.
            ("b_RightLeg01_019", "b_RightLeg02_020", "b_RightFoot02_022"),
        ),
    ],
)
def test_real_game_characters(file: str, scale: float, legs: list, last: tuple) -> None:
    rig = find_rig(glb_skeleton(SHARED / "data/gltf" / file, scale))
    assert [leg.name for leg in rig.legs] == legs
    leg = rig.legs[-1]
    joints = [leg.hip, leg.knee, leg.ankle] + ([leg.toe] if leg.toe >= 0 else [])
    assert tuple(rig.skeleton.names[j] for j in joints) == last
    np.testing.assert_allclose(rig.forward, [1.0, 0.0, 0.0], atol=0.05)
    positions, _ = rig.skeleton.rest_pose()
    for leg in rig.legs:  # all three stand on z = 0, so their soles are there
        assert positions[leg.ankle, 2] - leg.sole.height == pytest.approx(0.0, abs=0.01)


@needs_shared
def test_a_character_without_knees_has_no_legs() -> None:
    with pytest.raises(FootIKError, match="left thigh"):
        find_rig(glb_skeleton(SHARED / "data/gltf/greenman.glb"))


def read_motion(file: Path, scale: float, frames: slice) -> tuple[Skeleton, np.ndarray, np.ndarray]:
    """Skeleton, root positions and local rotations of a BVH file, z up, by the shortest way."""
    words = file.read_text(encoding="latin1").split()
    names, parents, offsets, channels, stack = [], [], [], [], []
    tips: dict[int, np.ndarray] = {}
    at, in_tip = 0, False
    while words[at] != "MOTION":
        if words[at] in ("ROOT", "JOINT"):
            parents.append(stack[-1] if stack else -1)
            names.append(words[at + 1])
        elif words[at] == "End":
            in_tip = True
        elif words[at] == "{":
            stack.append(stack[-1] if in_tip else len(names) - 1)
        elif words[at] == "}":
            stack.pop()
            in_tip = False
        elif words[at] == "OFFSET":
            offset = scale * np.array(words[at + 1 : at + 4], dtype=float)[[2, 0, 1]]
            if in_tip:
                tips[stack[-1]] = offset
            else:
                offsets.append(offset)
        elif words[at] == "CHANNELS":
            channels.append(words[at + 2 : at + 2 + int(words[at + 1])])
        at += 1
    columns = [(joint, channel) for joint, some in enumerate(channels) for channel in some]
    numbers = np.array(words[words.index("Time:") + 2 :], dtype=float)
    numbers = numbers[: len(numbers) // len(columns) * len(columns)].reshape(-1, len(columns))
    numbers = numbers[frames]
    rotations = np.zeros((len(numbers), len(names), 4))
    for joint in range(len(names)):
        mine = [i for i, (j, c) in enumerate(columns) if j == joint and c.endswith("rotation")]
        order = "".join({"X": "Y", "Y": "Z", "Z": "X"}[columns[i][1][0]] for i in mine)
        turn = Rotation.from_euler(order, numbers[:, mine], degrees=True)
        rotations[:, joint] = turn.as_quat()[:, [3, 0, 1, 2]]
    root = [columns.index((0, f"{axis}position")) for axis in "ZXY"]
    skeleton = Skeleton(
        names=tuple(names), parents=np.array(parents), offsets=np.array(offsets), tips=tips
    )
    return skeleton, scale * numbers[:, root], rotations


@needs_shared
@pytest.mark.parametrize(
    ("file", "scale", "ankle", "frames"),
    [
        ("cmu_02_01_walk", 0.01, "lfoot", slice(None)),
        ("cmu_01_01_playground", 0.0564, "LeftFoot", slice(0, None, 2)),
    ],
)
def test_motion_capture_soles_lie_flat_where_the_feet_stand(
    file: str, scale: float, ankle: str, frames: slice
) -> None:
    skeleton, roots, turns = read_motion(SHARED / "data/bvh" / f"{file}.bvh", scale, frames)
    rig = find_rig(skeleton)
    assert skeleton.names[rig.legs[0].ankle] == ankle
    np.testing.assert_allclose(rig.forward, [1.0, 0.0, 0.0], atol=0.02)
    positions, rotations = skeleton.forward(turns, roots)
    rate = 120 / (frames.step or 1)
    for leg in rig.legs:
        foot = positions[:, [leg.ankle, leg.toe]]
        speed = rate * np.linalg.norm(np.gradient(foot, axis=0), axis=2).sum(axis=1)
        low = foot[:, 0, 2] - foot[:, 0, 2].min() < 0.04
        frame = tuple(float(c) for c in leg.sole.frame)
        ups = [
            rotate(quat_mul(tuple(rotations[f, leg.ankle]), frame), (0.0, 0.0, 1.0))
            for f in np.flatnonzero((speed < 0.25) & low)
        ]
        mean = np.mean(ups, axis=0)
        # The rest pose's own z axis would be off by 23 degrees in the walk.
        assert mean[2] / np.linalg.norm(mean) > np.cos(np.radians(6.0))
        assert 0.05 < leg.sole.height < 0.08
