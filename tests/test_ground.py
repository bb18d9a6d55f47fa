"""Rays in a MuJoCo scene: native and Python alike, masks, back faces, seams, recordings."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from copy import copy

import mujoco
import numpy as np
import pytest

import footik_runtime.ground as ground_module
from footik_runtime.errors import FootIKError
from footik_runtime.ground import NATIVE_RAYS, RecordedGround, SceneGround, group_mask
from footik_runtime.probes import HIT, PROBE, set_miss, set_probe

SCENE = """
<mujoco>
  <asset><hfield name="bumps" nrow="21" ncol="21" size="2 2 .5 .1"/></asset>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <geom name="box" type="box" size=".5 .5 .2" pos="3 0 .2"/>
    <geom name="ball" type="sphere" size=".4" pos="-3 0 .4"/>
    <geom name="bumps" type="hfield" hfield="bumps" pos="0 6 0"/>
    <geom name="ghost" type="box" size=".5 .5 .2" pos="0 -3 .2" rgba="1 1 1 0"/>
    <geom name="other" type="box" size=".5 .5 .2" pos="3 -3 .2" group="2"/>
    <body name="lift" mocap="true" pos="-3 -3 .5">
      <geom name="deck" type="box" size=".5 .5 .1"/>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def scene():
    model = mujoco.MjModel.from_xml_string(SCENE)
    model.hfield_data[:] = np.random.default_rng(0).random(len(model.hfield_data))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def rays(origins, direction=(0.0, 0.0, -1.0), length=10.0):
    probes = np.zeros(len(origins), dtype=PROBE)
    probes["origin"], probes["direction"], probes["length"] = origins, direction, length
    probes["active"] = 1
    return probes


def answered(ground, probes):
    hits = np.zeros(len(probes), dtype=HIT)
    ground.cast(probes, hits)
    return hits


def test_native_and_python_rays_agree_to_the_bit(scene):
    if not NATIVE_RAYS:
        pytest.skip("kernels are off: there are no native rays to compare")
    rng = np.random.default_rng(1)
    probes = rays(rng.uniform([-5, -5, 0.05], [5, 9, 2.0], (3000, 3)))
    probes["direction"][1000:] = rng.normal(size=(2000, 3))
    probes["direction"] /= np.linalg.norm(probes["direction"], axis=1, keepdims=True)
    native = answered(SceneGround(*scene), probes)
    python = answered(SceneGround(*scene, native=False), probes)
    assert native["hit"].sum() > 1000
    for name in HIT.names or ():
        assert native[name].tobytes() == python[name].tobytes()


def test_hit_names_geom_body_point_and_normal(scene):
    model, _ = scene
    (hit,) = answered(SceneGround(*scene), rays([[3.1, 0.2, 2.0]]))
    assert model.geom(int(hit["geom"])).name == "box"
    assert hit["body"] == 0
    np.testing.assert_allclose(hit["point"], [3.1, 0.2, 0.4], atol=1e-6)
    np.testing.assert_allclose(hit["normal"], [0, 0, 1], atol=1e-9)
    assert hit["distance"] == pytest.approx(1.6, abs=1e-6)


def test_ray_that_starts_inside_a_box_does_not_see_that_box(scene):
    model, _ = scene
    (hit,) = answered(SceneGround(*scene), rays([[3.0, 0.0, 0.2]]))
    assert model.geom(int(hit["geom"])).name == "floor"
    assert hit["normal"] @ [0, 0, -1] <= 0.0


def test_miss_is_empty_and_length_ends_a_ray(scene):
    ground = SceneGround(*scene)
    short, far, sky = answered(
        ground,
        np.concatenate(
            [rays([[3.0, 0.0, 2.0]], length=1.5), rays([[3.0, 0.0, 2.0]], length=1.7),
             rays([[3.0, 0.0, 2.0]], direction=(0.0, 0.0, 1.0))]
        ),
    )  # fmt: skip
    assert far["hit"] == 1
    for miss in (short, sky):
        assert (miss["hit"], miss["geom"], miss["body"]) == (0, -1, -1)
        assert not miss["point"].any()
        assert not miss["normal"].any()


def test_inactive_probe_keeps_its_answer(scene):
    probes = rays([[3.0, 0.0, 2.0]])
    probes["active"] = 0
    hits = np.zeros(1, dtype=HIT)
    hits["geom"] = 77
    SceneGround(*scene).cast(probes, hits)
    assert hits["geom"] == 77


def test_only_geoms_of_the_asked_groups_are_seen(scene):
    above = rays([[3.0, -3.0, 2.0]])
    assert answered(SceneGround(*scene), above)["point"][0, 2] == pytest.approx(0.0, abs=1e-6)
    both = answered(SceneGround(*scene, groups=(0, 2)), above)
    assert both["point"][0, 2] == pytest.approx(0.4, abs=1e-6)


def test_transparent_geom_is_invisible(scene):
    assert SceneGround(*scene).height(np.array([[0.0, -3.0, 1.0]]))[0] == pytest.approx(
        0.0, abs=1e-6
    )


def test_moved_body_is_seen_where_it_is_now(scene):
    model, data = scene
    ground = SceneGround(model, data)
    place = np.array([[-3.0, -3.0, 1.0]])
    assert ground.height(place)[0] == pytest.approx(0.6, abs=1e-6)
    data.mocap_pos[0] = [-3.0, -3.0, 0.8]
    mujoco.mj_kinematics(model, data)
    hit = answered(ground, rays([[-3.0, -3.0, 2.0]]))[0]
    assert hit["point"][2] == pytest.approx(0.9, abs=1e-6)
    assert model.body(int(hit["body"])).name == "lift"


def test_no_ray_falls_through_a_height_field_on_its_grid_lines(scene):
    x = np.linspace(-1.9, 1.9, 1001)
    places = np.stack([x, np.full_like(x, 6.0), np.full_like(x, 1.0)], axis=1)
    heights = SceneGround(*scene).height(places)
    assert (heights > 1e-3).mean() > 0.99
    beside = SceneGround(*scene).height(places + np.array([0.0, 1e-5, 0.0]))
    np.testing.assert_allclose(heights, beside, atol=1e-3)


def test_threads_give_the_same_bits(scene):
    ground = SceneGround(*scene, native=NATIVE_RAYS)
    rng = np.random.default_rng(2)
    probes = rays(rng.uniform([-5, -5, 0.05], [5, 9, 2.0], (4000, 3)))
    alone = answered(ground, probes)
    with ThreadPoolExecutor(4) as pool:
        parts = list(pool.map(lambda part: answered(ground, part), np.split(probes, 8)))
    together = np.concatenate(parts)
    for name in HIT.names or ():
        assert together[name].tobytes() == alone[name].tobytes()


def test_recording_plays_back_in_order_and_says_when_it_has_run_out():
    hits = np.zeros(3, dtype=HIT)
    hits["geom"] = [5, 6, 7]
    ground = RecordedGround(hits)
    probes = rays(np.zeros((3, 3)))
    probes["active"] = [1, 0, 1]
    assert answered(ground, probes)["geom"].tolist() == [5, 0, 6]
    with pytest.raises(FootIKError, match="holds 3 hits"):
        answered(ground, probes)


def test_data_of_another_model_is_an_error(scene):
    model, _ = scene
    other = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>"
    )
    with pytest.raises(FootIKError, match="does not belong"):
        SceneGround(model, mujoco.MjData(other))


def test_geom_group_outside_its_range_is_an_error(scene):
    with pytest.raises(FootIKError, match="geom groups 0 to 5, not 6"):
        SceneGround(*scene, groups=(6,))


def test_ray_that_starts_inside_hits_what_is_under_it_with_the_whole_way_told(scene):
    model, data = scene
    model.geom("ball").pos[2] = 0.5
    mujoco.mj_forward(model, data)
    inside = rays([[-3.0, -3.0, 0.5], [-3.0, 0.0, 0.5]])  # in the lift's deck, in the ball
    for native in {NATIVE_RAYS, False}:
        hits = answered(SceneGround(model, data, native=native), inside)
        assert [model.geom(int(g)).name for g in hits["geom"]] == ["floor", "floor"]
        np.testing.assert_allclose(hits["distance"], 0.5, atol=1e-6)
        np.testing.assert_allclose(hits["point"][:, 2], 0.0, atol=1e-6)


def test_length_counts_from_the_origin_through_what_was_passed(scene):
    ground = SceneGround(*scene)
    inside = [[-3.0, -3.0, 0.5]]  # in the lift's deck, whose bottom is at 0.4
    assert answered(ground, rays(inside, length=0.51))["hit"][0] == 1
    assert answered(ground, rays(inside, length=0.49))["hit"][0] == 0


def test_every_normal_faces_its_ray_and_every_point_lies_on_it(scene):
    rng = np.random.default_rng(5)
    probes = rays(rng.uniform([-5, -5, 0.05], [5, 9, 2.0], (1000, 3)), length=4.0)
    probes["direction"] = rng.normal(size=(1000, 3))
    probes["direction"] /= np.linalg.norm(probes["direction"], axis=1, keepdims=True)
    hits = answered(SceneGround(*scene), probes)
    hit = hits["hit"] == 1
    assert 200 < hit.sum() < 1000
    assert (np.einsum("ij,ij->i", hits["normal"], probes["direction"])[hit] <= 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(hits["normal"][hit], axis=1), 1.0, atol=1e-6)
    along = probes["origin"] + probes["direction"] * hits["distance"][:, None]
    np.testing.assert_allclose(hits["point"][hit], along[hit], atol=1e-12)
    assert (hits["distance"][hit] <= 4.0).all()
    assert not hits["point"][~hit].any()
    assert (hits["geom"][~hit] == -1).all()


@pytest.mark.parametrize("native", sorted({NATIVE_RAYS, False}))
def test_ray_without_direction_or_of_nan_is_a_miss(scene, native):
    probes = rays(np.tile([3.0, 0.0, 2.0], (5, 1)))
    probes["direction"][:3] = [[0, 0, 0], [0, 0, -1e-20], [0, 0, np.nan]]
    probes["origin"][3] = np.nan
    assert answered(SceneGround(*scene, native=native), probes)["hit"].tolist() == [0, 0, 0, 0, 1]


def test_a_miss_wipes_the_answer_before_it(scene):
    hits = np.ones(1, dtype=HIT)
    SceneGround(*scene).cast(rays([[3.0, 0.0, 2.0]], length=0.1), hits)
    assert hits[0]["geom"] == hits[0]["body"] == -1
    for name in ("hit", "distance", "point", "normal"):
        assert not hits[name].any()


def test_a_turned_platform_shows_its_turned_normal(scene):
    model, data = scene
    data.mocap_quat[0] = [np.cos(0.1), np.sin(0.1), 0.0, 0.0]  # 0.2 rad about x
    ground = SceneGround(model, data)
    mujoco.mj_kinematics(model, data)
    (hit,) = answered(ground, rays([[-3.0, -3.0, 2.0]]))
    np.testing.assert_allclose(hit["normal"], [0, -np.sin(0.2), np.cos(0.2)], atol=1e-9)


def test_heights_keep_the_shape_of_their_points_and_are_nan_on_a_miss(scene):
    ground = SceneGround(*scene)
    grid = np.array([[[3.0, 0.0, 0.4], [8.0, 0.0, 0.0]], [[-3.0, 0.0, 0.8], [8.0, 0.0, 9.0]]])
    heights = ground.height(grid)
    np.testing.assert_allclose(heights, [[0.4, 0.0], [0.8, np.nan]], atol=1e-6)
    under, geoms = ground.under(grid.reshape(-1, 3))
    np.testing.assert_array_equal(under, heights.reshape(-1))
    assert geoms[3] == -1


def test_recording_of_a_scene_answers_as_the_scene_did(scene):
    ground, rng = SceneGround(*scene), np.random.default_rng(4)
    asked = [rays(rng.uniform([-5, -5, 1], [5, 9, 2], (7, 3))) for _ in range(3)]
    recorded = [answered(ground, probes) for probes in asked]
    played = RecordedGround(recorded)
    for probes, hits in zip(asked, recorded, strict=True):
        assert answered(played, probes).tobytes() == hits.tobytes()
    with pytest.raises(FootIKError, match="holds 21 hits, but ray 22 was asked for"):
        played.cast(asked[0], recorded[0])


def test_probe_and_miss_are_written_whole():
    probe, hit = np.zeros(1, dtype=PROBE)[0], np.ones(1, dtype=HIT)[0]
    set_probe(probe, (1.0, 2.0, 3.0), (0.0, 0.0, -1.0), 0.7)
    assert (probe["active"], probe["length"]) == (1, 0.7)
    assert probe["origin"].tolist() == [1.0, 2.0, 3.0]
    assert probe["direction"].tolist() == [0.0, 0.0, -1.0]
    set_miss(hit)
    assert hit.tolist()[:4] == (0, -1, -1, 0.0)
    assert not hit["point"].any()


def test_native_rays_are_refused_where_there_are_none(scene, monkeypatch):
    monkeypatch.setattr(ground_module, "NATIVE_RAYS", False)
    with pytest.raises(FootIKError, match="native rays are not available"):
        SceneGround(*scene, native=True)
    assert SceneGround(*scene, native=False).caster() is None


def test_an_unknown_ray_function_is_not_called_natively(monkeypatch):
    monkeypatch.setattr(mujoco, "mj_version", lambda: 3_010_000)
    assert not ground_module._load_native_ray()


@pytest.mark.parametrize("group", [-1, 6])
def test_group_mask_holds_its_groups_and_refuses_others(group):
    assert group_mask((0, 5)).tolist() == [1, 0, 0, 0, 0, 1]
    with pytest.raises(FootIKError, match=f"geom groups 0 to 5, not {group}"):
        group_mask((0, group))


def test_data_of_a_model_of_equal_counts_is_an_error_and_of_a_copy_is_not(scene):
    model, _ = scene
    other = mujoco.MjModel.from_xml_string(SCENE.replace('pos="3 0 .2"', 'pos="3 1 .2"'))
    with pytest.raises(FootIKError, match="made from another, with other geom_pos"):
        SceneGround(model, mujoco.MjData(other))
    SceneGround(model, mujoco.MjData(copy(model)))
    with pytest.raises(FootIKError, match="an MjModel and its MjData"):
        SceneGround(None, None)  # pyright: ignore[reportArgumentType]


def test_a_geom_that_changes_its_body_is_known_by_its_new_one(scene):
    model, data = scene
    ground = SceneGround(model, data)
    ground.height(np.zeros(3))
    model.geom_bodyid[model.geom("floor").id] = 1
    assert answered(ground, rays([[1.0, 1.0, 1.0]]))["body"][0] == 1


@pytest.mark.parametrize("points", [np.zeros((2, 2)), "here", [[0.0, 0.0]], 1.0])
def test_points_that_are_none_are_an_error(scene, points):
    ground = SceneGround(*scene)
    for ask in (ground.under, ground.height):
        with pytest.raises(FootIKError, match="points must be"):
            ask(points)


@pytest.mark.parametrize("how", [{"above": np.nan}, {"reach": 0.0}, {"reach": "far"}])
def test_a_reach_that_is_none_is_an_error(scene, how):
    with pytest.raises(FootIKError, match="above and reach must be finite"):
        SceneGround(*scene).height(np.zeros(3), **how)


def test_a_recording_of_something_else_is_an_error():
    with pytest.raises(FootIKError, match="recorded hits must be of HIT"):
        RecordedGround(np.zeros(3))
