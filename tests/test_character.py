"""Characters in MuJoCo: their bodies, masses and names, and poses written to them and moved."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from footik_runtime.anthropometry import MASS_FRACTIONS, Segment, body_mass, find_anatomy
from footik_runtime.character import (
    CHARACTER_GROUP,
    Character,
    build_character,
    model_path,
    skeleton_from_model,
    write_qpos,
)
from footik_runtime.errors import FootIKError
from footik_runtime.quat_arrays import conj, from_rotvec, mul, rotate
from footik_runtime.rig import Leg, Rig, Sole
from footik_runtime.skeleton import Skeleton

SEEDS = st.integers(0, 2**32 - 1)

# Like the CMU database's: legs spread, hip joints and spine that start at the root itself.
# name, parent, offset (x forward, y left, z up), m
_MIDDLE = [
    ("root", None, (0.0, 0.0, 0.0)),
    ("lowerback", "root", (0.0, 0.0, 0.0)),
    ("upperback", "lowerback", (-0.01, 0.0, 0.116)),
    ("thorax", "upperback", (0.0, 0.0, 0.117)),
    ("lowerneck", "thorax", (0.0, 0.0, 0.117)),
    ("upperneck", "lowerneck", (0.01, 0.0, 0.088)),
    ("head", "upperneck", (-0.006, 0.0, 0.088)),
]
_SIDE = [
    ("hipjoint", "root", (0.0, 0.0, 0.0)),
    ("femur", "hipjoint", (0.035, 0.093, -0.102)),
    ("tibia", "femur", (0.0, 0.146, -0.402)),
    ("foot", "tibia", (0.0, 0.140, -0.386)),
    ("toes", "foot", (0.121, 0.011, -0.031)),
    ("clavicle", "thorax", (0.0, 0.0, 0.117)),
    ("humerus", "clavicle", (-0.01, 0.2, 0.051)),
    ("radius", "humerus", (0.0, 0.275, 0.0)),
    ("wrist", "radius", (0.0, 0.189, 0.0)),
    ("hand", "wrist", (0.0, 0.095, 0.0)),
    ("fingers", "hand", (0.0, 0.037, 0.0)),
    ("thumb", "wrist", (0.0, 0.095, 0.0)),
]
_TIPS = {"head": (0.0, 0.0, 0.092), "toes": (0.063, 0.0, 0.0), "fingers": (0.0, 0.03, 0.0)}


def cmu_like(**moved: tuple[float, float, float]) -> Skeleton:
    """The skeleton, with some offsets replaced."""
    rows = list(_MIDDLE)
    for side, sign in (("l", 1.0), ("r", -1.0)):
        for name, parent, (x, y, z) in _SIDE:
            above = parent if parent in ("root", "thorax") else side + parent
            rows.append((side + name, above, (x, sign * y, z)))
    names = [name for name, _, _ in rows]
    tips = {}
    for j, name in enumerate(names):
        if (tip := _TIPS.get(name, _TIPS.get(name[1:]))) is not None:
            tips[j] = np.array(tip) * [1.0, -1.0 if name[0] == "r" else 1.0, 1.0]
    return Skeleton(
        names=tuple(names),
        parents=np.array([-1 if p is None else names.index(p) for _, p, _ in rows]),
        offsets=np.array([moved.get(name, offset) for name, _, offset in rows]),
        tips=tips,
    )


def rig_of(skeleton: Skeleton, ankle_height: float = 0.06) -> Rig:
    sole = Sole(
        frame=np.array([1.0, 0.0, 0.0, 0.0]),
        height=ankle_height,
        heel=0.05,
        ball=0.12,
        tip=0.19,
        half_width=0.045,
    )
    legs = tuple(
        Leg(
            name=name,
            hip=skeleton.index(side + "femur"),
            knee=skeleton.index(side + "tibia"),
            ankle=skeleton.index(side + "foot"),
            toe=skeleton.index(side + "toes"),
            sole=sole,
        )
        for name, side in (("left", "l"), ("right", "r"))
    )
    return Rig(skeleton=skeleton, hips=0, legs=legs, forward=np.array([1.0, 0.0, 0.0]))


def bare_rig(skeleton: Skeleton) -> Rig:
    return Rig(skeleton=skeleton, hips=0, legs=(), forward=np.array([1.0, 0.0, 0.0]))


def built(rig: Rig, **options) -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    build_character(spec, rig, **options)
    return spec.compile()


def random_pose(joints: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    rotations = random.normal(size=(joints, 4))
    return random.normal(size=3), rotations / np.linalg.norm(rotations, axis=1, keepdims=True)


def humanoid() -> tuple[mujoco.MjModel, Rig]:
    model = mujoco.MjModel.from_xml_path(str(model_path("humanoid")))
    return model, bare_rig(skeleton_from_model(model))


RIG = rig_of(cmu_like())
MODEL = built(RIG)
HUMANOID, HUMANOID_RIG = humanoid()


def masses_by_segment(model: mujoco.MjModel, rig: Rig) -> dict[tuple[str, int], float]:
    anatomy = find_anatomy(rig)
    sums: dict[tuple[str, int], float] = {}
    bodies = Character.bind(model, rig).bodies
    for body, segment, side in zip(bodies, anatomy.segments, anatomy.sides, strict=True):
        key = (str(segment), int(side))
        sums[key] = sums.get(key, 0.0) + float(model.body_mass[body])
    return sums


def lowest_point(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Of all shapes, m; exact for level boxes and for capsules."""
    heights = []
    for geom in range(model.ngeom):
        size, up = model.geom_size[geom], np.abs(data.geom_xmat[geom][6:])
        kind = model.geom_type[geom]
        if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            reach = size[0] + size[1] * up[2]
        elif kind == mujoco.mjtGeom.mjGEOM_BOX:
            reach = up @ size
        else:
            reach = np.linalg.norm(up * (size if size[1] else size[0]))
        heights.append(data.geom_xpos[geom][2] - reach)
    return float(min(heights))


# Poses -------------------------------------------------------------------------------------------


@settings(max_examples=25)
@given(SEEDS)
def test_bodies_stand_where_forward_kinematics_puts_the_joints(seed):
    for model, rig, character in (
        (MODEL, RIG, Character.bind(MODEL, RIG)),
        (HUMANOID, HUMANOID_RIG, Character.from_model(HUMANOID, HUMANOID_RIG)),
    ):
        root, rotations = random_pose(len(rig.skeleton), seed)
        data = mujoco.MjData(model)
        character.write_pose(data, root, rotations)
        mujoco.mj_forward(model, data)
        positions, turns = rig.skeleton.forward(rotations[None], root[None])
        np.testing.assert_allclose(data.xpos[character.bodies], positions[0], atol=1e-9)
        dots = np.einsum("jk,jk->j", data.xquat[character.bodies], turns[0])
        np.testing.assert_allclose(np.abs(dots), 1.0, atol=1e-9)


@settings(max_examples=25)
@given(SEEDS)
def test_bodies_with_rotations_of_their_own_take_the_same_poses(seed):
    spec = mujoco.MjSpec()
    above = spec.worldbody
    random = np.random.default_rng(seed)
    for name in ("hips", "thigh", "brace", "shin", "shoe"):
        above = above.add_body(name=name, pos=random.normal(size=3), quat=random.normal(size=4))
        above.add_geom(size=[0.1, 0.1, 0.1])
        if name == "hips":
            above.add_freejoint()
        elif name not in ("brace", "shoe"):
            above.add_joint(type=mujoco.mjtJoint.mjJNT_BALL)
    model = spec.compile()
    skeleton = skeleton_from_model(model)
    character = Character.from_model(model, bare_rig(skeleton))
    assert character.qpos_address.tolist() == [0, 7, -1, 11, -1]
    root, rotations = random_pose(5, seed)
    rotations[[2, 4]] = skeleton.rest_rotations[[2, 4]]
    data = mujoco.MjData(model)
    character.write_pose(data, root, rotations)
    mujoco.mj_forward(model, data)
    positions, _ = skeleton.forward(rotations[None], root[None])
    np.testing.assert_allclose(data.xpos[character.bodies], positions[0], atol=1e-9)


def test_a_ball_joint_holds_the_clips_local_rotation_itself():
    character = Character.bind(MODEL, RIG)
    root, rotations = random_pose(len(RIG.skeleton), 3)
    data = mujoco.MjData(MODEL)
    character.write_pose(data, root, rotations)
    assert character.rest.shape == (0, 4)
    for joint, address in enumerate(character.qpos_address[1:], start=1):
        np.testing.assert_array_equal(data.qpos[address : address + 4], rotations[joint])


def test_rows_of_a_crowd_get_their_poses_without_a_data():
    character = Character.bind(MODEL, RIG)
    rows = np.zeros((3, MODEL.nq))
    for c in range(3):
        root, rotations = random_pose(len(RIG.skeleton), c)
        write_qpos(rows[c], character.qpos_address, root, rotations, character.rest)
        data = mujoco.MjData(MODEL)
        character.write_pose(data, root, rotations)
        np.testing.assert_array_equal(rows[c], data.qpos)


# Velocities --------------------------------------------------------------------------------------


@settings(max_examples=25)
@given(SEEDS, st.sampled_from([1 / 240, 1 / 60, 0.5]))
def test_the_velocity_leads_from_the_last_pose_to_this_one(seed, dt):
    character = Character.bind(MODEL, RIG)
    data = mujoco.MjData(MODEL)
    root, rotations = random_pose(len(RIG.skeleton), seed)
    character.write_pose(data, root, rotations)
    before = data.qpos.copy()
    random = np.random.default_rng(seed)
    turns = from_rotvec(random.normal(size=(len(rotations), 3)) * 0.5)
    character.write_pose(data, root + random.normal(size=3), mul(rotations, turns))
    character.write_pose_velocity(MODEL, data, before, dt)
    reached = before.copy()
    mujoco.mj_integratePos(MODEL, reached, data.qvel, dt)
    np.testing.assert_allclose(reached[:3], data.qpos[:3], atol=1e-12)
    dots = np.sum(reached[3:].reshape(-1, 4) * data.qpos[3:].reshape(-1, 4), axis=1)
    np.testing.assert_allclose(np.abs(dots), 1.0, atol=1e-12)


@settings(max_examples=25)
@given(SEEDS, st.sampled_from([1e-3, 1 / 60, 0.5]), st.sampled_from([0.0, 1e-12, 0.1, 3.0]))
def test_velocities_are_mujocos_own(seed, dt, most):
    model = built(RIG)
    character = Character.bind(model, RIG)
    random = np.random.default_rng(seed)
    data = mujoco.MjData(model)
    root, rotations = random_pose(len(RIG.skeleton), seed)
    character.write_pose(data, root, rotations)
    before = data.qpos.copy()
    turns = from_rotvec(random.normal(size=(len(rotations), 3)) * most)
    turns *= random.choice([-1.0, 1.0], size=(len(turns), 1))  # the same rotations
    character.write_pose(data, root + most * random.normal(size=3), mul(rotations, turns))
    character.write_pose_velocity(model, data, before, dt)
    expected = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, expected, dt, before, data.qpos)
    np.testing.assert_allclose(data.qvel, expected, rtol=1e-12, atol=1e-14 / dt)


def test_bodies_welded_to_their_parents_have_no_velocity():
    spec = mujoco.MjSpec()
    above = spec.worldbody
    for name in ("hips", "brace", "shin"):
        above = above.add_body(name=name, pos=[0.0, 0.0, -0.2])
        above.add_geom(size=[0.1, 0.1, 0.1])
        if name == "hips":
            above.add_freejoint()
        elif name == "shin":
            above.add_joint(type=mujoco.mjtJoint.mjJNT_BALL)
    model = spec.compile()
    character = Character.from_model(model, bare_rig(skeleton_from_model(model)))
    data = mujoco.MjData(model)
    before = data.qpos.copy()
    turned = np.array([[1.0, 0, 0, 0], [1.0, 0, 0, 0], [np.cos(0.1), 0.0, np.sin(0.1), 0.0]])
    character.write_pose(data, before[:3], turned)
    character.write_pose_velocity(model, data, before, 0.1)
    np.testing.assert_allclose(data.qvel, [0, 0, 0, 0, 0, 0, 0, 2.0, 0], atol=1e-12)


@pytest.mark.parametrize("dt", [0.0, -0.01])
def test_no_time_is_no_velocity(dt):
    character = Character.bind(MODEL, RIG)
    data = mujoco.MjData(MODEL)
    before = data.qpos.copy()
    data.qvel[:] = 5.0
    character.write_pose(data, *random_pose(len(RIG.skeleton), 1))
    character.write_pose_velocity(MODEL, data, before, dt)
    assert not data.qvel.any()


def test_other_bodies_keep_their_velocities():
    spec = mujoco.MjSpec()
    ball = spec.worldbody.add_body(name="ball", pos=[5, 0, 1])
    ball.add_freejoint()
    ball.add_geom(size=[0.1, 0, 0])
    build_character(spec, RIG)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qvel[:6] = 1.5
    before = data.qpos.copy()
    character = Character.bind(model, RIG)
    character.write_pose(data, *random_pose(len(RIG.skeleton), 2))
    character.write_pose_velocity(model, data, before, 0.01)
    np.testing.assert_array_equal(data.qvel[:6], 1.5)
    assert data.qvel[6:].any()


def test_a_foot_pushes_a_loose_box_ahead_of_it():
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 0.1])
    box = spec.worldbody.add_body(name="box", pos=[0.45, 0.38, 0.1])
    box.add_freejoint()
    box.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1], mass=1.0)
    build_character(spec, RIG)
    model = spec.compile()
    data = mujoco.MjData(model)
    character = Character.bind(model, RIG)
    still = RIG.skeleton.rest_rotations
    start = model.body_pos[character.bodies[0]] + [0.0, 0.0, 0.01]
    for frame in range(60):
        before = data.qpos.copy()
        character.write_pose(data, start + np.array([0.01 * frame, 0.0, 0.0]), still)
        character.write_pose_velocity(model, data, before, 0.01 if frame else 0.0)
        for _ in range(5):
            mujoco.mj_step(model, data)
    assert np.isfinite(data.qpos).all()
    assert data.body("box").xpos[0] > 0.7


def test_between_two_poses_gravity_does_not_pull_the_character_down():
    data = mujoco.MjData(MODEL)
    height = data.qpos[2]
    for _ in range(50):
        mujoco.mj_step(MODEL, data)
    assert data.qpos[2] == pytest.approx(height, abs=1e-4)
    falling = built(RIG, afloat=False)
    data = mujoco.MjData(falling)
    for _ in range(50):
        mujoco.mj_step(falling, data)
    assert data.qpos[2] < height - 0.02


# Masses and shapes -------------------------------------------------------------------------------


def test_each_joint_is_the_part_of_the_body_it_looks_like():
    anatomy = find_anatomy(RIG)
    part = dict(zip(RIG.skeleton.names, map(str, anatomy.segments), strict=True))
    side = dict(zip(RIG.skeleton.names, anatomy.sides, strict=True))
    expected = {
        "root": "pelvis",
        "lhipjoint": "pelvis",
        "lowerback": "trunk",
        "thorax": "trunk",
        "lowerneck": "neck",
        "head": "head",
        "lfemur": "thigh",
        "rtibia": "shank",
        "lfoot": "foot",
        "rtoes": "toes",
        "lclavicle": "clavicle",
        "lhumerus": "upper_arm",
        "rradius": "forearm",
        "lwrist": "hand",
        "rthumb": "hand",
    }
    assert {name: part[name] for name in expected} == expected
    assert [side[n] for n in ("lfemur", "rfemur", "lwrist", "rwrist", "head")] == [1, -1, 1, -1, 0]


def test_parts_are_found_without_helpful_names():
    skeleton = cmu_like()
    nameless = replace(skeleton, names=tuple(f"bone{j}" for j in range(len(skeleton))))
    found = find_anatomy(replace(RIG, skeleton=nameless))
    assert found.segments == find_anatomy(RIG).segments


def test_masses_are_de_levas():
    sums = masses_by_segment(MODEL, RIG)
    whole = sum(sums.values())
    stature = find_anatomy(RIG).stature
    assert stature == pytest.approx(1.62, abs=0.1)
    assert whole == pytest.approx(body_mass(stature), rel=1e-3)

    def share(side: int, *parts: str) -> float:
        return sum(sums.get((p, side), 0.0) for p in parts) / whole

    for side in (1, -1):
        assert share(side, "thigh") == pytest.approx(0.1416, abs=1e-3)
        assert share(side, "shank") == pytest.approx(0.0433, abs=1e-3)
        assert share(side, "foot", "toes") == pytest.approx(0.0137, abs=1e-3)
        assert share(side, "upper_arm") == pytest.approx(0.0271, abs=1e-3)
        assert share(side, "forearm") == pytest.approx(0.0162, abs=1e-3)
        assert share(side, "hand") == pytest.approx(0.0061, abs=1e-3)
    assert share(0, "head", "neck") == pytest.approx(0.0694, abs=1e-3)
    assert share(0, "pelvis") == pytest.approx(0.1117, abs=1e-3)


def test_the_table_of_masses_is_a_whole_body():
    both_sides = (Segment.HEAD, Segment.TRUNK, Segment.PELVIS)
    total = sum(f * (1 if s in both_sides else 2) for s, f in MASS_FRACTIONS.items())
    assert total == pytest.approx(1.0, abs=1e-12)


def test_a_given_mass_is_kept_whatever_parts_there_are():
    assert built(RIG, mass=50.0).body_subtreemass[0] == pytest.approx(50.0, rel=1e-9)
    kept = [j for j, n in enumerate(RIG.skeleton.names) if "wrist" not in n]
    kept = [j for j in kept if RIG.skeleton.names[j][1:] not in ("hand", "fingers", "thumb")]
    skeleton = RIG.skeleton
    handless = Skeleton(
        names=tuple(skeleton.names[j] for j in kept),
        parents=np.array([kept.index(p) if p >= 0 else -1 for p in skeleton.parents[kept]]),
        offsets=skeleton.offsets[kept],
        tips={skeleton.names.index("head"): skeleton.tips[skeleton.index("head")]},
    )
    model = built(rig_of(handless), mass=50.0)
    assert model.body_subtreemass[0] == pytest.approx(50.0, rel=1e-9)
    thigh, forearm = (model.body(f"character/{n}").mass[0] for n in ("lfemur", "lradius"))
    assert thigh / 50.0 == pytest.approx(0.1416, abs=1e-3)
    assert forearm / 50.0 == pytest.approx(0.0162 + 0.0061, abs=1e-3)  # it holds the hand's


def test_bones_of_no_length_have_light_bodies_that_step():
    squeezed = {"ltibia": (0.0, 0.0, 0.0), "thorax": (0.0, 0.0, 0.0), "rradius": (0.0, 0.0, 0.0)}
    model = built(rig_of(cmu_like(**squeezed)))
    assert (model.body_mass[1:] > 0.0).all()
    assert (model.body_inertia[1:] > 0.0).all()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    assert np.isfinite(data.qacc).all()


def test_an_animal_of_four_legs_has_the_density_of_water():
    names = ["hips", "chest", "head"]
    parents, offsets = [-1, 0, 1], [(0, 0, 0), (0.6, 0, 0), (0.3, 0, 0.2)]
    for leg, (parent, x, y) in {"fl": (1, 0, 0.1), "fr": (1, 0, -0.1), "hl": (0, 0, 0.1)}.items():
        names += [leg + part for part in ("hip", "knee", "ankle")]
        first = len(parents)
        parents += [parent, first, first + 1]
        offsets += [(x, y, 0), (0.02, 0, -0.3), (-0.02, 0, -0.3)]
    skeleton = Skeleton(
        names=tuple(names), parents=np.array(parents), offsets=np.array(offsets, dtype=float)
    )
    sole = replace(RIG.legs[0].sole, height=0.02, heel=0.02, ball=0.03, tip=0.05)
    legs = tuple(
        Leg(name=n[:2], hip=j, knee=j + 1, ankle=j + 2, toe=-1, sole=sole)
        for j, n in enumerate(names)
        if n.endswith("hip")
    )
    rig = Rig(skeleton=skeleton, hips=0, legs=legs, forward=np.array([1.0, 0.0, 0.0]))
    model = built(rig)
    assert 10.0 < model.body_subtreemass[0] < 80.0
    assert built(rig, mass=30.0).body_subtreemass[0] == pytest.approx(30.0)


def test_shapes_are_the_characters_group_and_touch_others_only():
    assert (MODEL.geom_group == CHARACTER_GROUP).all()
    assert (HUMANOID.geom_group == CHARACTER_GROUP).all()
    for model in (MODEL, HUMANOID):
        kinds, wanted = model.geom_contype, model.geom_conaffinity
        assert not (kinds[:, None] & wanted[None, :]).any()  # not each other
        assert ((wanted & 1) | (kinds == 0)).all()  # the world's default contype


@pytest.mark.parametrize("ankle_height", [0.03, 0.06, 0.1])
def test_feet_lie_on_their_soles_and_the_body_stands_on_the_ground(ankle_height):
    rig = rig_of(cmu_like(), ankle_height)
    model = built(rig)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    boxes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_BOX)
    assert len(boxes) == 4
    under = data.geom_xpos[boxes, 2] - model.geom_size[boxes, 2]
    np.testing.assert_allclose(under, 0.0, atol=1e-12)
    assert lowest_point(model, data) == pytest.approx(0.0, abs=1e-12)
    foot = Character.bind(model, rig).bodies[rig.legs[0].ankle]
    heel = data.geom_xpos[boxes, 0].min() - model.geom_size[boxes, 0].max()
    assert heel == pytest.approx(data.xpos[foot][0] - 0.05, abs=1e-9)


def test_shapes_do_not_depend_on_the_frames_the_rest_pose_is_told_in():
    """A skeleton whose joints are turned in the rest pose has the same shapes in the world."""
    skeleton = cmu_like()
    turned = from_rotvec(np.random.default_rng(5).normal(size=(len(skeleton), 3)))
    above = np.array([[1.0, 0, 0, 0], *(turned[p] for p in skeleton.parents[1:])])
    other = Skeleton(
        names=skeleton.names,
        parents=skeleton.parents,
        offsets=rotate(conj(above), skeleton.offsets),
        rest_rotations=mul(conj(above), turned),
        tips={j: rotate(conj(turned[j]), tip) for j, tip in skeleton.tips.items()},
    )
    legs = tuple(
        replace(
            leg,
            sole=replace(leg.sole, frame=conj(turned[leg.ankle]), toe_frame=conj(turned[leg.toe])),
        )
        for leg in RIG.legs
    )
    rig = replace(RIG, skeleton=other, legs=legs)
    places = []
    for model, own in ((MODEL, RIG), (built(rig), rig)):
        data = mujoco.MjData(model)
        character = Character.bind(model, own)
        character.write_pose(data, np.zeros(3), own.skeleton.rest_rotations)
        mujoco.mj_forward(model, data)
        places.append(np.concatenate([data.geom_xpos, data.geom_xmat[:, 2::3]], axis=1))
        assert (model.geom_size > -1e-12).all()
    np.testing.assert_allclose(places[1], places[0], atol=1e-6)


def test_two_characters_share_a_scene():
    spec = mujoco.MjSpec()
    build_character(spec, RIG, name="ann")
    build_character(spec, RIG, name="bob")
    model = spec.compile()
    ann, bob = (Character.bind(model, RIG, name) for name in ("ann", "bob"))
    assert not set(ann.bodies) & set(bob.bodies)
    assert not set(ann.dofs) & set(bob.dofs)
    data = mujoco.MjData(model)
    bob.write_pose(data, *random_pose(len(RIG.skeleton), 4))
    np.testing.assert_array_equal(data.qpos[: MODEL.nq], model.qpos0[: MODEL.nq])


# The humanoid ------------------------------------------------------------------------------------


def test_the_humanoid_weighs_and_measures_what_it_says():
    data = mujoco.MjData(HUMANOID)
    mujoco.mj_forward(HUMANOID, data)
    assert HUMANOID.body_subtreemass[0] == pytest.approx(body_mass(1.78), abs=0.05)
    head = HUMANOID.body("head").id
    skull = np.flatnonzero(HUMANOID.geom_bodyid == head)[0]
    assert data.geom_xpos[skull, 2] + HUMANOID.geom_size[skull, 2] == pytest.approx(1.78)
    for name in ("left_sole", "left_toe_sole", "right_sole", "right_toe_sole"):
        geom = HUMANOID.geom(name)
        assert data.geom_xpos[geom.id, 2] - geom.size[2] == pytest.approx(0.0, abs=1e-12)
    assert lowest_point(HUMANOID, data) == pytest.approx(0.0, abs=1e-12)


def test_the_humanoids_parts_weigh_de_levas_shares():
    mass = {HUMANOID.body(b).name: HUMANOID.body_mass[b] for b in range(1, HUMANOID.nbody)}
    whole = sum(mass.values())
    parts = {
        ("neck", "head"): 0.0694,
        ("chest", "left_clavicle", "right_clavicle"): 0.1596,
        ("spine",): 0.1633,
        ("pelvis",): 0.1117,
        ("left_upper_arm",): 0.0271,
        ("left_forearm",): 0.0162,
        ("left_hand",): 0.0061,
        ("left_thigh",): 0.1416,
        ("left_shin",): 0.0433,
        ("left_foot", "left_toes"): 0.0137,
    }
    for bodies, share in parts.items():
        assert sum(mass[b] for b in bodies) / whole == pytest.approx(share, abs=1e-4), bodies


def test_the_humanoid_is_its_own_mirror_image():
    flip = np.array([1.0, -1.0, 1.0])
    for body in range(1, HUMANOID.nbody):
        name = HUMANOID.body(body).name
        if not name.startswith("left_"):
            assert name.startswith("right_") or HUMANOID.body_pos[body][1] == 0.0
            continue
        twin = HUMANOID.body(name.replace("left_", "right_")).id
        np.testing.assert_allclose(HUMANOID.body_pos[twin], HUMANOID.body_pos[body] * flip)
        np.testing.assert_allclose(
            HUMANOID.body_ipos[twin], HUMANOID.body_ipos[body] * flip, atol=1e-9
        )
        assert HUMANOID.body_mass[twin] == pytest.approx(HUMANOID.body_mass[body])
        np.testing.assert_allclose(HUMANOID.body_inertia[twin], HUMANOID.body_inertia[body])


def test_the_humanoids_skeleton_has_a_chain_from_hips_to_toes():
    skeleton = HUMANOID_RIG.skeleton
    chain = [skeleton.names[j] for j in skeleton.chain(skeleton.index("left_toes"))]
    assert chain == ["left_toes", "left_foot", "left_shin", "left_thigh", "pelvis"]
    assert (skeleton.rest_rotations == [1.0, 0.0, 0.0, 0.0]).all()


# Bad input ---------------------------------------------------------------------------------------


def test_a_missing_body_is_named_with_the_nearest_one():
    skeleton = HUMANOID_RIG.skeleton
    names = tuple(n.replace("left_shin", "left_shinn") for n in skeleton.names)
    rig = bare_rig(replace(skeleton, names=names))
    with pytest.raises(FootIKError, match=r"unknown body 'left_shinn'.*mean 'left_shin'"):
        Character.from_model(HUMANOID, rig)
    with pytest.raises(FootIKError, match=r"unknown body 'hero/root'.*mean 'character/root'"):
        Character.bind(MODEL, RIG, "hero")


def test_a_rig_of_another_tree_is_told_apart():
    skeleton = HUMANOID_RIG.skeleton
    parents = skeleton.parents.copy()
    parents[skeleton.index("head")] = skeleton.index("chest")
    with pytest.raises(FootIKError, match="'head' hangs on 'chest', its body on 'neck'"):
        Character.from_model(HUMANOID, bare_rig(replace(skeleton, parents=parents)))


def test_hinges_are_listed():
    spec = mujoco.MjSpec()
    hips = spec.worldbody.add_body(name="hips")
    hips.add_freejoint()
    shin = hips.add_body(name="shin", pos=[0, 0, -1])
    shin.add_joint(name="knee", type=mujoco.mjtJoint.mjJNT_HINGE)
    for body in (hips, shin):
        body.add_geom(size=[0.1, 0.1, 0.1])
    with pytest.raises(FootIKError, match=r"one ball joint or none.*knee.*hinge_motion"):
        skeleton_from_model(spec.compile())
    shin.joints[0].type = mujoco.mjtJoint.mjJNT_BALL
    shin.joints[0].pos = [0, 0, 0.1]
    with pytest.raises(FootIKError, match="ball joints must be at their body's origin: knee"):
        skeleton_from_model(spec.compile())


def test_models_without_a_character_say_so():
    spec = mujoco.MjSpec()
    spec.worldbody.add_body(name="table").add_geom(size=[0.1, 0.1, 0.1])
    model = spec.compile()
    with pytest.raises(FootIKError, match="no body with a free joint"):
        skeleton_from_model(model)
    with pytest.raises(FootIKError, match="'table' must have a free joint"):
        skeleton_from_model(model, "table")
    with pytest.raises(FootIKError, match=r"unknown body 'tabel'.*Did you mean 'table'"):
        skeleton_from_model(model, "tabel")


def test_the_skeleton_is_of_the_tree_that_carries_most():
    spec = mujoco.MjSpec()
    crate = spec.worldbody.add_body(name="crate")
    crate.add_freejoint()
    crate.add_geom(size=[0.1, 0.1, 0.1])
    build_character(spec, RIG)
    model = spec.compile()
    assert skeleton_from_model(model).names[0] == "character/root"
    assert skeleton_from_model(model, "crate").names == ("crate",)


@pytest.mark.parametrize("mass", [0.0, -3.0, float("nan"), 1e-3])
def test_a_body_must_weigh_something(mass):
    with pytest.raises(FootIKError, match="mass must be"):
        built(RIG, mass=mass)


def test_two_characters_of_one_name_are_refused():
    spec = mujoco.MjSpec()
    build_character(spec, RIG)
    with pytest.raises(FootIKError, match="has a body 'character/root' already"):
        build_character(spec, RIG)


def test_poses_of_other_shapes_are_refused():
    character = Character.bind(MODEL, RIG)
    data = mujoco.MjData(MODEL)
    with pytest.raises(FootIKError, match=r"\(31, 4\) rotations"):
        character.write_pose(data, np.zeros(3), np.zeros((30, 4)))
    with pytest.raises(FootIKError, match="previous_qpos must be"):
        character.write_pose_velocity(MODEL, data, np.zeros(3), 0.01)


def test_unknown_models_are_named_with_the_shipped_ones():
    with pytest.raises(FootIKError, match=r"unknown model 'humanoyd'.*Did you mean 'humanoid'"):
        model_path("humanoyd")
