"""Terrain: what is built is what was asked for, for rays, for physics and for `height`."""

from __future__ import annotations

import functools

import mujoco
import numpy as np
import pytest

from footik_runtime.errors import FootIKError
from footik_runtime.terrain import (
    TERRAIN_GROUP,
    TERRAINS,
    Flat,
    Gap,
    Hills,
    Ledge,
    Platform,
    Ramp,
    Rubble,
    Stairs,
    Step,
    Stones,
    Terrain,
    make_terrain,
)

ANALYTIC = ("flat", "slope", "stairs", "hills", "ledge", "gap")
SEEDED = ("hills", "rubble", "stones", "course")
WALKED = 30.0  # m: 20 s at 1.5 m/s
BALL = 0.1


@functools.cache
def scene(name: str, seed: int = 0) -> tuple[Terrain, mujoco.MjModel, mujoco.MjData]:
    return compiled_scene(make_terrain(name, seed=seed))


def compiled_scene(terrain: Terrain) -> tuple[Terrain, mujoco.MjModel, mujoco.MjData]:
    spec = mujoco.MjSpec()
    terrain.add_to(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return terrain, model, data


def ray_down(model, data, x: float, y: float) -> tuple[float, np.ndarray, str]:
    """Height, normal and geom name of the first ground below 20 m, in the terrain's group."""
    groups = np.zeros(6, dtype=np.uint8)
    groups[TERRAIN_GROUP] = 1
    geom, normal = np.full(1, -1, dtype=np.int32), np.zeros(3)
    origin, down = np.array([x, y, 20.0]), np.array([0.0, 0.0, -1.0])
    distance = mujoco.mj_ray(model, data, origin, down, groups, 1, -1, geom, normal)
    if geom[0] < 0:
        return float("nan"), normal, ""
    return 20.0 - distance, normal, model.geom(geom[0]).name


def edges_of(terrain: Terrain) -> np.ndarray:
    """The x of all edges between pieces and of all risers of stairs."""
    edges = []
    for piece, site in zip(terrain.pieces, terrain.sites, strict=True):
        edges.append(site.x)
        if isinstance(piece, Stairs):
            edges += [site.x + i * piece.step_depth for i in range(piece.steps)]
    return np.array(edges)


def off_edges(terrain: Terrain, x: np.ndarray) -> np.ndarray:
    """The x that are no edge."""
    return x[np.abs(x[:, None] - edges_of(terrain)[None, :]).min(axis=1) > 1e-6]


def model_bits(model: mujoco.MjModel) -> bytes:
    buffer = np.zeros(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def test_every_issue_terrain_is_named():
    assert set(TERRAINS) == {*ANALYTIC, "rubble", "stones", "platform", "course"}
    assert all(make_terrain(name).name == name for name in TERRAINS)


@pytest.mark.parametrize("name", TERRAINS)
def test_is_long_and_wide_enough_and_has_ground_everywhere_along_the_way(name):
    terrain, model, data = scene(name)
    x_min, x_max, y_min, y_max = terrain.extent
    assert x_min == -4.0
    assert x_max > WALKED + 1.0
    assert y_min <= -4.0
    assert y_max >= 4.0
    # On every seam, and to both sides of it: no ray may fall through.
    seams = edges_of(terrain)[1:]
    along = np.concatenate([seams, seams - 1e-9, seams + 1e-9, np.arange(-3.95, x_max, 0.513)])
    for x in along:
        for y in (-3.9, 0.0, 3.9):
            height, _, _ = ray_down(model, data, x, y)
            assert terrain.sites[0].base + 0.49 < height < 3.0, (name, x, y)


@pytest.mark.parametrize("name", TERRAINS)
def test_is_level_within_a_metre_of_the_start(name):
    terrain, model, data = scene(name)
    assert np.array_equal(terrain.start_w, np.zeros(3))
    for x, y in np.random.default_rng(1).uniform(-0.999, 0.999, (60, 2)):
        height, normal, _ = ray_down(model, data, x, y)
        assert height == pytest.approx(0.0, abs=1e-12)
        np.testing.assert_allclose(normal, [0.0, 0.0, 1.0], atol=1e-9)


@pytest.mark.parametrize("name", ANALYTIC)
def test_height_is_what_rays_meet(name):
    terrain, model, data = scene(name)
    x_min, x_max, y_min, y_max = terrain.extent
    xs = off_edges(terrain, np.linspace(x_min + 0.01, x_max - 0.01, 311))
    ys = np.linspace(y_min + 0.012, y_max - 0.013, 9)
    heights = terrain.height(xs[:, None], ys[None, :])
    rays = np.array([[ray_down(model, data, x, y)[0] for y in ys] for x in xs])
    # Only hills are triangles under a curve; for those, see the bound by curvature below.
    np.testing.assert_allclose(rays, heights, atol=1e-3 if name == "hills" else 1e-9)


def test_hills_differ_from_their_triangles_by_no_more_than_their_curvature_allows():
    terrain, model, data = scene("hills")
    x, y = np.arange(1.2, 31.5, 0.05), np.arange(-4.9, 4.9, 0.05)
    heights = terrain.height(x[:, None], y[None, :])
    along = np.gradient(np.gradient(heights, 0.05, axis=0), 0.05, axis=0)
    across = np.gradient(np.gradient(heights, 0.05, axis=1), 0.05, axis=1)
    mixed = np.gradient(np.gradient(heights, 0.05, axis=0), 0.05, axis=1)
    bend = (np.abs(0.5 * (along + across)) + np.hypot(0.5 * (along - across), mixed)).max()
    bound = bend * (2.0 * 0.1**2) / 8.0
    assert bound < 1e-3
    points = np.random.default_rng(2).uniform((1.2, -4.9), (31.5, 4.9), (2000, 2))
    off = [ray_down(model, data, *p)[0] - terrain.height(*p) for p in points]
    assert np.abs(off).max() <= bound + 1e-6


def test_hills_are_smooth_and_as_high_as_asked():
    terrain = make_terrain("hills", amplitude=0.25)
    x = np.linspace(0.0, 32.5, 6501)
    y = np.linspace(-5.0, 5.0, 41)
    heights = terrain.height(x[:, None], y[None, :])
    assert 0.22 < np.abs(heights).max() < 0.2505
    step = x[1] - x[0]
    slope = np.diff(heights, axis=0) / step
    bend = np.diff(slope, axis=0) / step
    assert np.abs(slope).max() < 0.5
    assert np.abs(np.diff(bend, axis=0)).max() < 0.02  # the second derivative has no jump
    crossings = np.diff(np.sign(heights[500:6000]), axis=0) != 0
    wavelength = 2.0 * (x[6000] - x[500]) / crossings.sum(axis=0).mean()
    assert 4.0 < wavelength < 10.0


@pytest.mark.parametrize("angle_deg", [5.0, 15.0, 30.0])
def test_slope_has_the_normal_of_its_angle_and_ends_as_high_as_it_began(angle_deg):
    terrain, model, data = compiled_scene(make_terrain("slope", angle_deg=angle_deg))
    angle = np.radians(angle_deg)
    _, up, _ = ray_down(model, data, 2.5, 0.3)
    _, down, _ = ray_down(model, data, 7.5, -0.3)
    np.testing.assert_allclose(up, [-np.sin(angle), 0.0, np.cos(angle)], atol=1e-9)
    np.testing.assert_allclose(down, [np.sin(angle), 0.0, np.cos(angle)], atol=1e-9)
    assert terrain.height(5.0, 0.0) == pytest.approx(3.0 * np.tan(angle))
    assert terrain.height(10.0, 0.0) == pytest.approx(0.0, abs=1e-12)


def test_stairs_climb_step_by_step_to_a_landing_and_down_again():
    _, model, data = compiled_scene(
        make_terrain("stairs", steps=3, step_height=0.2, step_depth=0.5, landing=1.0)
    )
    xs = 0.75 + 0.5 * np.arange(12)
    expected = 0.2 * np.array([0, 1, 2, 3, 3, 3, 2, 1, 0, 0, 0, 1])
    heights = [ray_down(model, data, x, 0.0)[0] for x in xs]
    np.testing.assert_allclose(heights, expected, atol=1e-12)


def test_ledge_is_high_left_and_low_right_and_then_a_step_across():
    _, model, data = scene("ledge")
    assert ray_down(model, data, 4.0, 0.1)[0] == pytest.approx(0.0)
    assert ray_down(model, data, 4.0, -0.1)[0] == pytest.approx(-0.2)
    after = [ray_down(model, data, x, y)[0] for x in (7.5, 9.0) for y in (0.1, -0.1)]
    np.testing.assert_allclose(after, [-0.2, -0.2, 0.0, 0.0], atol=1e-12)


def test_gap_is_as_wide_and_deep_as_asked():
    _, model, data = compiled_scene(make_terrain("gap", width=0.4, depth=0.8))
    xs = np.arange(0.9005, 1.6, 0.001)
    heights = np.array([ray_down(model, data, x, 0.0)[0] for x in xs])
    assert set(np.round(heights, 9)) == {0.0, -0.8}
    assert np.count_nonzero(heights < -0.1) == 400


def test_rubble_blocks_are_within_their_heights_and_tilt():
    _, model, data = scene("rubble")
    blocks = [i for i in range(model.ngeom) if "block" in model.geom(i).name]
    assert len(blocks) > 100
    turns = []
    for i in blocks:
        x, y = data.geom_xpos[i, :2]
        axes = data.geom_xmat[i].reshape(3, 3)
        middle = data.geom_xpos[i, 2] + model.geom_size[i, 2]
        assert 0.02 - 0.006 < middle < 0.12 + 0.006  # a tilted box's top middle lies beside it
        assert axes[2, 2] >= np.cos(np.radians(6.0)) - 1e-12
        corners = [
            data.geom_xpos[i] + axes @ (model.geom_size[i] * [sx, sy, -1.0])
            for sx in (-1, 1)
            for sy in (-1, 1)
        ]
        assert max(corner[2] for corner in corners) < 0.0  # no corner hangs over the floor
        assert np.hypot(x, y) - np.hypot(*model.geom_size[i, :2]) > 1.0
        turns.append(np.arctan2(axes[1, 0], axes[0, 0]))
    assert np.ptp(turns) > 5.0


def test_stones_offer_footholds_over_a_pit():
    _, model, data = scene("stones")
    xs = np.arange(1.05, 5.95, 0.02)
    heights = np.array([[ray_down(model, data, x, y)[0] for y in (-0.11, 0.11)] for x in xs])
    on_stone = heights > -0.1
    assert on_stone.mean() > 0.75
    assert np.abs(heights[on_stone]).max() <= 0.04 + 1e-9
    assert np.ptp(heights[on_stone]) > 0.04
    assert heights[~on_stone] == pytest.approx(-0.5)
    middle = np.array([ray_down(model, data, x, 0.0)[0] for x in xs])
    assert (middle > -0.1).mean() > 0.8  # where a root looks for its ground
    assert ray_down(model, data, 3.0, 2.0)[0] == pytest.approx(-0.5)


@pytest.mark.parametrize("name", TERRAINS)
def test_a_dropped_ball_comes_to_rest_on_it(name):
    terrain = make_terrain(name)
    _, bare, at_rest = scene(name)
    x, y = 2.2, 0.1
    ground, normal, _ = ray_down(bare, at_rest, x, y)
    spec = mujoco.MjSpec()
    terrain.add_to(spec)
    body = spec.worldbody.add_body(pos=[x, y, ground + 1.1 * BALL / normal[2]])
    # Rubber that hardly rolls, so that it rests on slopes too.
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[BALL, 0, 0],
        group=2,
        condim=6,
        priority=1,
        friction=[1.0, 0.1, 0.2],
        solref=[0.02, 1.0],
    )
    body.add_freejoint()
    spec.option.timestep = 0.005
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 100)
    assert data.ncon >= 1
    assert np.linalg.norm(data.qvel[:3]) < 0.02
    place = data.qpos[:3]
    ground, normal, _ = ray_down(bare, at_rest, place[0], place[1])
    assert (place[2] - ground) * normal[2] == pytest.approx(BALL, abs=0.02)


@pytest.mark.parametrize("name", TERRAINS)
def test_the_same_seed_makes_the_same_bits_and_another_seed_another_model(name):
    first = model_bits(compiled_scene(make_terrain(name, seed=3))[1])
    assert first == model_bits(compiled_scene(make_terrain(name, seed=3))[1])
    other = model_bits(compiled_scene(make_terrain(name, seed=4))[1])
    assert (first != other) == (name in SEEDED)


@pytest.mark.parametrize("name", TERRAINS)
def test_geoms_are_named_few_static_and_in_the_group_that_rays_see(name):
    terrain, model, _ = scene(name)
    assert model.ngeom <= 300
    assert (model.geom_group == TERRAIN_GROUP).all()
    assert (model.geom_contype == 1).all()
    assert (model.geom_conaffinity == 1).all()
    assert all(model.geom(i).name.startswith("terrain_") for i in range(model.ngeom))
    assert (model.geom_bodyid[[m == -1 for m in model.body_mocapid[model.geom_bodyid]]] == 0).all()
    assert terrain.static == (model.nmocap == 0)
    assert terrain.static == (name not in ("platform", "course"))


def test_platform_follows_time_in_the_scene():
    terrain, model, data = scene("platform")
    i = next(i for i, piece in enumerate(terrain.pieces) if isinstance(piece, Platform))
    piece, site = terrain.pieces[i], terrain.sites[i]
    assert isinstance(piece, Platform)
    turned = []
    for time in (0.0, 1.3, 40.0):
        terrain.move(model, data, time)
        mujoco.mj_kinematics(model, data)
        position, quat = piece.pose_w(site, time)
        np.testing.assert_allclose(data.body(f"{site.name}/platform").xpos, position, atol=1e-12)
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, quat)
        height, normal, geom = ray_down(model, data, position[0], position[1])
        assert geom == f"{site.name}/slab"
        assert height == pytest.approx(position[2], abs=1e-9)
        np.testing.assert_allclose(normal, rotation.reshape(3, 3)[:, 2], atol=1e-9)
        turned.append(np.degrees(np.arctan2(rotation[3], rotation[0])))
    assert turned[0] == 0.0
    assert abs(turned[1]) > 5.0
    terrain.move(model, data, 0.0)
    mujoco.mj_kinematics(model, data)


def test_platform_lies_level_in_its_middle_at_time_zero_and_there_it_is_compiled():
    terrain, model, _ = scene("platform")
    fresh = mujoco.MjData(model)
    mujoco.mj_forward(model, fresh)
    before = fresh.mocap_pos.copy(), fresh.mocap_quat.copy()
    terrain.move(model, fresh, 0.0)
    np.testing.assert_array_equal(fresh.mocap_pos, before[0])
    np.testing.assert_array_equal(fresh.mocap_quat, before[1])
    np.testing.assert_array_equal(fresh.mocap_quat[0], [1.0, 0.0, 0.0, 0.0])


def test_platform_moves_in_every_way_without_a_jump():
    piece = Platform()
    terrain = Terrain(name="one", pieces=(Flat(length=5.0), piece))
    site = terrain.sites[1]
    poses = [piece.pose_w(site, t) for t in np.arange(0.0, 30.0, 0.01)]
    positions = np.array([p for p, _ in poses])
    quats = np.array([q for _, q in poses])
    speed = np.linalg.norm(np.diff(positions, axis=0), axis=1) / 0.01
    turn = 2.0 * np.arccos(np.clip((quats[1:] * quats[:-1]).sum(axis=1), -1.0, 1.0)) / 0.01
    assert speed.max() < 0.6
    assert turn.max() < 0.6
    assert np.abs(np.diff(positions, n=2, axis=0)).max() / 0.01**2 < 1.0
    assert (np.ptp(positions, axis=0) > [0.5, 0.5, 0.07]).all()
    assert positions[:, 2].min() >= piece.top - 1e-12
    assert (np.ptp(quats[:, 1:], axis=0) > [0.04, 0.04, 0.3]).all()
    np.testing.assert_allclose(np.linalg.norm(quats, axis=1), 1.0, atol=1e-12)


def test_static_terrain_moves_nothing_and_is_no_error():
    terrain, model, data = scene("stairs")
    before = data.geom_xpos.copy()
    terrain.move(model, data, 3.0)
    mujoco.mj_forward(model, data)
    np.testing.assert_array_equal(data.geom_xpos, before)


def test_pieces_follow_each_other_in_x_and_height():
    pieces = (
        Flat(length=5.0),
        Stairs(steps=3, step_height=0.2, step_depth=0.4),
        Ramp(angle_deg=10.0, length=2.0),
        Step(height_change=-0.1),
        Flat(length=1.0),
        Ledge(drop=0.3, length=1.0),
        Flat(length=1.0),
    )
    terrain, model, data = compiled_scene(Terrain(name="own", pieces=pieces))
    top = 0.6 + 2.0 * np.tan(np.radians(10.0))
    assert [site.x for site in terrain.sites] == pytest.approx([-4, 1, 2.2, 4.2, 4.2, 5.2, 6.2])
    levels = [0.0, 0.0, 0.6, top, top - 0.1, top - 0.1, top - 0.4]
    assert [site.z for site in terrain.sites] == pytest.approx(levels)
    for x, y in ((4.5, 1.0), (5.5, 1.0), (5.5, -1.0), (6.5, 1.0)):
        assert ray_down(model, data, x, y)[0] == pytest.approx(float(terrain.height(x, y)))
    assert terrain.height(4.5, 0.0) == pytest.approx(top - 0.1)


def test_no_ray_falls_between_two_hills():
    for k in range(24):  # whether a bare seam is open hangs on how its ends round
        hill = Hills(length=3.0 + 0.0137 * k, blend=1.0)
        pieces = (Flat(length=5.1 + 0.0071 * k), hill, hill, hill, Flat())
        terrain, model, data = compiled_scene(Terrain(name="own", pieces=pieces, half_width=1.0))
        for site in terrain.sites[1:]:
            for x in (np.nextafter(site.x, -9.0), site.x, np.nextafter(site.x, 99.0)):
                assert ray_down(model, data, x, 0.3)[0] == pytest.approx(0.0, abs=1e-6)


def test_height_is_nan_where_only_rays_know_and_beyond_the_ground():
    rubble = make_terrain("rubble")
    assert np.isnan(rubble.height([2.0, -4.1, 0.0, 99.0], [0.0, 0.0, 5.1, 0.0])).all()
    assert rubble.height(0.0, 0.0) == 0.0
    assert np.isnan(make_terrain("stones").height(2.0, 0.0))
    assert np.isnan(make_terrain("platform").height(3.0, 0.0))
    assert make_terrain("flat").height(np.zeros((4, 1)), np.zeros(3)).shape == (4, 3)


def test_unknown_terrain_lists_the_valid_names_and_the_nearest():
    with pytest.raises(FootIKError, match=r"'stair'.*Did you mean 'stairs'") as caught:
        make_terrain("stair")
    assert all(name in str(caught.value) for name in TERRAINS)


def test_unknown_setting_lists_the_valid_ones():
    with pytest.raises(FootIKError, match=r"'angle'.*'slope'|'slope'.*'angle'") as caught:
        make_terrain("slope", angle=20.0)
    assert "angle_deg" in str(caught.value)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: make_terrain("slope", angle_deg=50.0), r"slope angle_deg .*\[0, 45\], not 50"),
        (lambda: make_terrain("slope", angle_deg=float("nan")), "angle_deg .* not nan"),
        (lambda: make_terrain("stairs", steps=0), r"Stairs steps .*whole .*\[1, 200\], not 0"),
        (lambda: make_terrain("stairs", steps=2.5), r"Stairs steps .*whole .* not 2.5"),
        (lambda: make_terrain("stairs", step_height=-0.1), r"step_height .* not -0.1"),
        (lambda: make_terrain("stairs", landing=-1.0), r"stairs landing .* not -1"),
        (lambda: make_terrain("gap", width="wide"), r"Gap width .* not 'wide'"),
        (lambda: make_terrain("flat", seed=-1), r"seed .* not -1"),
        (lambda: make_terrain("hills", seed=1.5), r"seed .* not 1.5"),  # type: ignore
        (lambda: Terrain(name="t", pieces=(Flat(),), half_width=0.0), r"half_width .* not 0"),
        (lambda: Terrain(name="t", pieces=()), "at least one piece"),
        (lambda: Flat(length=float("inf")), r"Flat length .* not inf"),
        (lambda: Ramp(length=True), r"Ramp length .* not True"),
        (lambda: Ledge(drop=0.0), r"Ledge drop .* not 0"),
        (lambda: Gap(depth=-1.0), r"Gap depth .* not -1"),
        (lambda: Step(height_change=2.0), r"Step height_change .* not 2"),
        (lambda: Hills(amplitude=-1.0), r"Hills amplitude .* not -1"),
        (lambda: Hills(cell=0.2), r"Hills cell .*\[0.02, 0.1\], not 0.2"),
        (lambda: Hills(length=4.0), r"Hills blend must be at most .* not 2.5"),
        (lambda: Rubble(heights=(0.2, 0.1)), r"Rubble heights .* order, not \(0.2, 0.1\)"),
        (lambda: Rubble(heights=(0.1, 9.0)), r"Rubble heights .*, not \(0.1, 9"),
        (lambda: Rubble(sizes=0.3), r"Rubble sizes must be a pair"),  # type: ignore
        (lambda: Stones(part_filled=1.0), r"Stones part_filled .* not 1"),
        (lambda: Platform(period=0.0), r"Platform period .* not 0"),
        (lambda: Platform(size=(1.0,)), r"Platform size must be a pair"),  # type: ignore
        (lambda: Platform(travel=(0.1, -1.0)), r"Platform travel .* not \(0.1, -1"),
    ],
)
def test_a_bad_setting_is_named_with_its_value_and_range(make, message):
    with pytest.raises(FootIKError, match=message):
        make()


def test_a_second_terrain_in_one_spec_and_a_move_without_it_are_told():
    spec = mujoco.MjSpec()
    make_terrain("flat").add_to(spec)
    with pytest.raises(FootIKError, match=r"'gap'.*has a terrain already"):
        make_terrain("gap").add_to(spec)
    model = spec.compile()
    with pytest.raises(FootIKError, match="no body 'terrain_01_platform/platform'"):
        make_terrain("platform").move(model, mujoco.MjData(model), 0.0)
    with pytest.raises(FootIKError, match="time must be finite"):
        make_terrain("flat").move(model, mujoco.MjData(model), float("nan"))


@pytest.mark.parametrize("pieces", [Flat(), ("flat",), 5])
def test_pieces_that_are_none_are_an_error(pieces):
    with pytest.raises(FootIKError, match="needs a tuple of pieces"):
        Terrain(name="odd", pieces=pieces)


@pytest.mark.parametrize("name", [[], None, 5])
def test_a_terrain_that_is_no_name_is_an_error(name):
    with pytest.raises(FootIKError, match="unknown terrain"):
        make_terrain(name)


def test_times_and_places_that_are_none_are_errors():
    terrain = make_terrain("flat")
    with pytest.raises(FootIKError, match="time must be finite"):
        terrain.move(None, None, "now")  # pyright: ignore[reportArgumentType]
    for x, y in (("here", 0.0), ([1.0, 2.0], [1.0, 2.0, 3.0])):
        with pytest.raises(FootIKError, match="x and y must be numbers"):
            terrain.height(x, y)
