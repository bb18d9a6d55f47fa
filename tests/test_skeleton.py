"""Skeletons: what is refused, and kinematics against a naive walk along each chain."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from footik_runtime.errors import FootIKError
from footik_runtime.skeleton import Skeleton

GIVEN = {
    "names": ("hips", "knee", "foot"),
    "parents": np.array([-1, 0, 1]),
    "offsets": np.zeros((3, 3)),
}


def tree(joints: int, seed: int) -> Skeleton:
    """A random tree, parents before children."""
    rng = np.random.default_rng(seed)
    rest = rng.normal(size=(joints, 4))
    return Skeleton(
        names=tuple(f"j{i}" for i in range(joints)),
        parents=np.array([-1, *(rng.integers(0, i) for i in range(1, joints))]),
        offsets=rng.normal(size=(joints, 3)),
        rest_rotations=rest / np.linalg.norm(rest, axis=-1, keepdims=True),
    )


def naive(skeleton: Skeleton, rotations, root, translations):
    """Places and turns of one pose, each joint from the root down by itself."""
    places, turns = [], []
    for joint in range(len(skeleton)):
        place, turn = np.array(root), None
        for link in reversed(skeleton.chain(joint)):
            if turn is None:
                turn = Rotation.from_quat(np.roll(rotations[link], -1))
            else:
                place = place + turn.apply(translations[link])
                turn = turn * Rotation.from_quat(np.roll(rotations[link], -1))
        places.append(place)
        turns.append(turn)
    return np.array(places), turns


@given(st.integers(1, 12), st.integers(0, 1000), st.booleans())
def test_forward_is_the_naive_walk_along_every_chain(joints, seed, moved):
    skeleton, rng = tree(joints, seed), np.random.default_rng(seed)
    rotations = rng.normal(size=(2, joints, 4))
    rotations /= np.linalg.norm(rotations, axis=-1, keepdims=True)
    roots = rng.normal(size=(2, 3))
    translations = rng.normal(size=(2, joints, 3)) if moved else None
    positions, turns = skeleton.forward(rotations, roots, translations)
    for f in range(2):
        local = skeleton.offsets if translations is None else translations[f]
        places, oracles = naive(skeleton, rotations[f], roots[f], local)
        np.testing.assert_allclose(positions[f], places, atol=1e-11)
        for turn, oracle in zip(turns[f], oracles, strict=True):
            assert (Rotation.from_quat(np.roll(turn, -1)).inv() * oracle).magnitude() < 1e-7


def test_forward_takes_any_layout_of_its_arrays():
    skeleton, rng = tree(5, 1), np.random.default_rng(1)
    rotations, roots = rng.normal(size=(6, 5, 4)), rng.normal(size=(6, 3))
    every_other, _ = skeleton.forward(rotations[::2], np.asfortranarray(roots)[::2])
    np.testing.assert_array_equal(every_other, skeleton.forward(rotations, roots)[0][::2])


def test_forward_of_no_frames_is_empty():
    positions, turns = tree(4, 0).forward(np.zeros((0, 4, 4)), np.zeros((0, 3)))
    assert positions.shape == (0, 4, 3)
    assert turns.shape == (0, 4, 4)


@pytest.mark.parametrize(
    ("rotations", "roots", "translations", "words"),
    [
        ((2, 3, 4), (2, 3), None, r"rotations must be \(2, 4, 4\), not \(2, 3, 4\)"),
        ((2, 4, 4), (1, 3), None, r"root_positions must be \(2, 3\), not \(1, 3\)"),
        ((2, 4, 4), (2, 3), (1, 4, 3), r"translations must be \(2, 4, 3\), not \(1, 4, 3\)"),
        ((2, 4, 4), (2, 3), (0, 4, 3), "translations"),
        ((4, 4), (4, 3), None, r"rotations must be \(4, 4, 4\)"),
    ],
)
def test_arrays_that_are_too_short_are_refused_and_never_read_past(
    rotations, roots, translations, words
):
    moved = None if translations is None else np.zeros(translations)
    with pytest.raises(FootIKError, match=words):
        tree(4, 0).forward(np.ones(rotations), np.zeros(roots), moved)


def test_rest_pose_is_forward_of_the_rest():
    skeleton = tree(6, 2)
    places, turns = skeleton.rest_pose()
    expected, oracles = naive(
        skeleton, skeleton.rest_rotations, skeleton.offsets[0], skeleton.offsets
    )
    np.testing.assert_allclose(places, expected, atol=1e-12)
    assert turns.shape == (6, 4)
    np.testing.assert_allclose(
        [abs(np.roll(t, -1) @ o.as_quat()) for t, o in zip(turns, oracles, strict=True)], 1.0
    )


def test_rest_rotations_are_identities_unless_given():
    np.testing.assert_array_equal(Skeleton(**GIVEN).rest_rotations, [[1.0, 0, 0, 0]] * 3)


def test_children_and_chain_follow_the_parents():
    skeleton = Skeleton(
        names=("hips", "left", "right", "foot"),
        parents=np.array([-1, 0, 0, 2]),
        offsets=np.zeros((4, 3)),
    )
    assert len(skeleton) == 4
    assert [skeleton.children(j) for j in range(4)] == [[1, 2], [], [3], []]
    assert skeleton.chain(3) == [3, 2, 0]
    assert [skeleton.index(name) for name in skeleton.names] == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"names": (), "parents": np.zeros(0), "offsets": np.zeros((0, 3))},
            "a skeleton needs at least one joint.",
        ),
        (
            {"names": ("b", "a", "b"), "parents": np.array([-1, 0, 0])},
            "joint names must be unique; these are not: b.",
        ),
        (
            {"parents": np.array([-1, 0])},
            "3 joints need parents (3,) and offsets (3, 3), not (2,) and (3, 3).",
        ),
        (
            {"offsets": np.zeros((3, 2))},
            "3 joints need parents (3,) and offsets (3, 3), not (3,) and (3, 2).",
        ),
        ({"rest_rotations": np.ones((2, 4))}, "rest_rotations must be (3, 4), not (2, 4)."),
        (
            {"parents": np.array([-1, 2, 1])},
            "joint 'knee' (index 1) has parent 2; joint 0 is the only root (-1), and every other "
            "parent comes before its child.",
        ),
        ({"parents": np.array([-1, 0, -1])}, "joint 'foot' (index 2) has parent -1; joint 0"),
        ({"parents": np.array([0, 0, 1])}, "joint 'hips' (index 0) has parent 0; joint 0"),
        ({"parents": np.array([-1, 1, 1])}, "joint 'knee' (index 1) has parent 1; joint 0"),
        (
            {"offsets": np.array([[0, 0, 0], [0, 0, 0], [0, np.inf, 0]])},
            "the offset of joint 'foot' is not finite.",
        ),
        (
            {"rest_rotations": np.array([[1.0, 0, 0, 0], [np.nan, 0, 0, 0], [1, 0, 0, 0]])},
            "the rest rotation of joint 'knee' is not finite.",
        ),
    ],
)
def test_impossible_skeleton_is_refused_with_its_one_message(change, message):
    with pytest.raises(FootIKError) as refused:
        Skeleton(**(GIVEN | change))
    assert str(refused.value).startswith(message)


def test_unknown_joint_suggests_the_nearest():
    with pytest.raises(FootIKError, match=r"unknown joint 'Knee'\. Did you mean 'knee'\?"):
        Skeleton(**GIVEN).index("Knee")
