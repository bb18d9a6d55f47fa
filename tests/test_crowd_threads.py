"""A crowd on several threads: the same bits as on one, whatever the number."""

from copy import deepcopy

import numpy as np
import pytest

from footik_runtime.builtin import HUMANOID, builtin_motion
from footik_runtime.crowd import Crowd
from footik_runtime.errors import FootIKError
from footik_runtime.ground import NATIVE_RAYS, SceneGround
from footik_runtime.rooms import BLOCK
from footik_runtime.scene import Scene

COUNT = 2 * BLOCK + 7


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene.build(builtin_motion(), "hills", body=HUMANOID)


def scattered(scene: Scene, count: int, threads: int) -> Crowd:
    """A crowd all over the hills, all over the cycle; the feet of the last one are left alone."""
    rng = np.random.default_rng(5)
    ground = scene.ground()
    crowd = Crowd(scene.motion, ground, count=count, threads=threads)
    at = rng.uniform((2.0, -3.0, 0.0), (28.0, 3.0, 0.0), (count, 3))
    at[:, 2] = ground.height(at)
    crowd.place(at, rng.uniform(-np.pi, np.pi, count))
    crowd.bodies["time"] = rng.uniform(0.0, scene.motion.clip.duration, count)
    crowd.bodies["enabled"][-1] = 0
    return crowd


def bits(crowd: Crowd) -> list[bytes]:
    fields = [a[name] for a in (crowd.bodies, crowd.feet) for name in a.dtype.names or ()]
    return [np.ascontiguousarray(a).tobytes() for a in (*fields, crowd.roots, crowd.rotations)]


@pytest.mark.parametrize("threads", [2, 3, 7])
def test_threads_change_no_bit(scene: Scene, threads: int) -> None:
    one, many = scattered(scene, COUNT, 1), scattered(scene, COUNT, threads)
    for _ in range(40):
        one.step(1.0 / 60.0)
        many.step(1.0 / 60.0)
        assert bits(one) == bits(many)
    assert (one.feet["locked"] == 1).any()


def test_a_copy_of_a_crowd_goes_on_by_itself(scene: Scene) -> None:
    crowd = scattered(scene, 3, 1)
    crowd.step(1.0 / 60.0)
    copy, before = deepcopy(crowd), bits(crowd)
    copy.step(1.0 / 60.0)
    assert bits(crowd) == before
    assert bits(copy) != before
    crowd.step(1.0 / 60.0)
    assert bits(copy) == bits(crowd)


def test_more_threads_than_characters(scene: Scene) -> None:
    one, many = scattered(scene, 2, 1), scattered(scene, 2, 16)
    for crowd in (one, many):
        crowd.step(1.0 / 60.0)
    assert bits(one) == bits(many)


def test_every_row_is_stepped_by_one_thread(scene: Scene) -> None:
    crowd = scattered(scene, COUNT, 4)
    before = crowd.bodies["time"].copy()
    crowd.step(0.01)
    moved = (crowd.bodies["time"] - before) % scene.motion.clip.duration
    assert moved == pytest.approx(np.full(COUNT, 0.01))


@pytest.mark.parametrize("threads", [0, -2])
def test_no_thread_is_refused(scene: Scene, threads: int) -> None:
    with pytest.raises(FootIKError, match="at least one thread"):
        Crowd(scene.motion, scene.ground(), threads=threads)


def test_threads_with_rays_through_python_give_the_same_bits(walk):
    def after_steps(threads: int, native: bool) -> bytes:
        scene = Scene.build(walk, "slope", body=HUMANOID)
        ground = SceneGround(scene.model, scene.data, native=native)
        crowd = Crowd(walk, ground, 40, threads=threads)
        crowd.place(np.stack([np.linspace(0, 4, 40), np.zeros(40), np.zeros(40)], axis=1))
        for _ in range(4):
            crowd.step(1 / 60)
        return crowd.rotations.tobytes()

    assert after_steps(3, native=False) == after_steps(1, native=NATIVE_RAYS)
