"""Curves come back from their files to the last bit; what engines import says the same curves."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.formats import load_clip, save_clip
from footik_runtime.offline.bake import BakeSettings, weight_keys
from footik_runtime.offline.curve_exports import EXPORTS, export_curves
from footik_runtime.offline.curve_files import (
    curves_from_json,
    curves_to_json,
    read_curves,
    sidecar,
    write_curves,
)
from footik_runtime.offline.curve_keys import CURVE_KEYS, Keys, keys_of, sample
from footik_runtime.skeleton import Skeleton

FPS = 30.0
TREE = Skeleton(names=("root",), parents=np.array([-1]), offsets=np.zeros((1, 3)))
names = st.text(
    st.characters(min_codepoint=32, exclude_categories=["C", "Z"]), min_size=1, max_size=12
)


def clip_with(curves, frames=60, keys=None, loop=False, fps=FPS):
    return Clip(
        skeleton=TREE,
        fps=fps,
        root_positions=np.zeros((frames, 3)),
        rotations=np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1, 1)),
        curves=curves,
        loop=loop,
        name="walk",
        extras={CURVE_KEYS: keys} if keys else {},
    )


def baked(frames=60, loop=False):
    down = (np.arange(frames) % 30) < 14
    if loop:
        down[-1] = down[0]
    keys = {
        "LeftFootIKWeight": weight_keys(down, FPS, BakeSettings(), loop=loop),
        "LeftFootPhase": Keys(
            times=np.array([0.0, 0.45, 0.95]),
            values=np.array([2.0, 0.0, 3.0]),
            interpolation="step",
        ),
    }
    times = np.arange(frames) / FPS
    curves = {name: sample(k, times) for name, k in keys.items()}
    return clip_with({**curves, "smile": np.sin(times)}, frames, keys, loop)


def bare(clip):
    return replace(clip, curves={}, extras={})


def same_curves(a, b):
    assert list(a.curves) == list(b.curves)
    for name in a.curves:
        assert np.array_equal(a.curves[name], b.curves[name]), name


@pytest.mark.parametrize("suffix", [".json", ".csv", ".curves.json", ".CSV"])
@pytest.mark.parametrize("loop", [False, True])
def test_what_is_written_is_read_to_the_last_bit(tmp_path, suffix, loop):
    clip = baked(61, loop)
    path = tmp_path / f"walk{suffix}"
    write_curves(path, clip)
    read = read_curves(path, bare(clip))
    same_curves(read, clip)
    again = tmp_path / f"again{suffix}"
    write_curves(again, read)
    assert again.read_bytes() == path.read_bytes()


@given(
    st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=20),
    names,
    st.floats(1.0, 1000.0),
)
def test_any_curve_comes_back(tmp_path_factory, values, name, fps):
    values = np.clip(values, -1e14, 1e14)
    clip = clip_with({name: values}, len(values), fps=fps)
    folder = tmp_path_factory.mktemp("curves")
    for suffix in (".json", ".csv"):
        write_curves(folder / f"x{suffix}", clip)
        read = read_curves(folder / f"x{suffix}", bare(clip))
        assert [n.strip() for n in clip.curves] == list(read.curves)
        assert np.array_equal(next(iter(read.curves.values())), values)


def test_keys_stay_keys_and_frames_stay_frames(tmp_path):
    clip = baked()
    write_curves(tmp_path / "x.json", clip)
    told = json.loads((tmp_path / "x.json").read_text())
    assert {k: told[k] for k in ("footik_curves", "fps", "frames", "clip")} == {
        "footik_curves": 1,
        "fps": 30.0,
        "frames": 60,
        "clip": "walk",
    }
    weight = told["curves"]["LeftFootIKWeight"]
    assert weight["interpolation"] == "smooth"
    assert len(weight["times"]) == len(clip.extras[CURVE_KEYS]["LeftFootIKWeight"])
    assert told["curves"]["LeftFootPhase"]["interpolation"] == "step"
    assert len(told["curves"]["smile"]["times"]) == 60
    read = read_curves(tmp_path / "x.json", bare(clip))
    assert set(read.extras[CURVE_KEYS]) == {"LeftFootIKWeight", "LeftFootPhase"}


def test_the_looped_keys_slopes_are_kept():
    clip = baked(61, loop=True)
    data = json.loads(json.dumps(curves_to_json(clip)))
    assert any(data["curves"]["LeftFootIKWeight"]["slopes"])
    assert "slopes" not in data["curves"]["LeftFootPhase"]
    same_curves(curves_from_json(data, bare(clip), "x"), clip)


def test_curves_of_the_file_are_added_to_those_of_the_clip(tmp_path):
    clip = baked()
    write_curves(tmp_path / "x.json", clip)
    mine = clip_with({"smile": np.zeros(60), "own": np.ones(60)})
    read = read_curves(tmp_path / "x.json", mine)
    assert set(read.curves) == {"smile", "own", "LeftFootIKWeight", "LeftFootPhase"}
    assert np.array_equal(read.curves["smile"], clip.curves["smile"])
    assert np.array_equal(read.curves["own"], np.ones(60))
    assert np.array_equal(mine.curves["smile"], np.zeros(60))


def test_a_clip_without_curves_takes_an_earlier_ones_sidecar_away(tmp_path):
    path = tmp_path / "walk.bvh"
    save_clip(clip_with({"weight": np.ones(60)}), path)
    assert load_clip(path).curves
    (tmp_path / "other.curves.json").write_text("another clip's")
    save_clip(clip_with({}, frames=20), path)
    assert not load_clip(path).curves
    assert sorted(p.name for p in tmp_path.iterdir()) == ["other.curves.json", "walk.bvh"]


def test_a_motion_is_not_written_where_its_curves_cannot_be(tmp_path):
    (tmp_path / "walk.curves.json").mkdir()
    with pytest.raises(FootIKError, match=r"walk\.curves\.json: is a folder"):
        save_clip(clip_with({"weight": np.ones(60)}), tmp_path / "walk.bvh")
    assert not (tmp_path / "walk.bvh").exists()


def test_the_sidecar_lies_beside_the_clip():
    assert sidecar("a/walk.bvh").name == "walk.curves.json"
    assert sidecar("a/walk.v2.bvh").as_posix() == "a/walk.v2.curves.json"


def json_of(**changes):
    data = curves_to_json(baked()) | changes
    return json.dumps(data)


def curve_json(**changes):
    curve = {"times": [0.0, 1.0], "values": [0.0, 1.0], "interpolation": "smooth"} | changes
    return json_of(curves={"weight": curve})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not JSON"),
        ("[1, 2", ":1: not JSON"),
        ("[" * 100000, "not JSON"),
        ("[1]", "no curves of version 1"),
        (json_of(footik_curves=2), "no curves of version 1"),
        (json_of(curves=[1]), "must hold name: keys"),
        (json_of(fps="30"), '"fps" must be a number'),
        (json_of(frames=None), '"frames" must be a number'),
        (json_of(frames=59), "of 59 frames at 30 fps, but walk has 60 at 30"),
        (json_of(fps=60), "at 60 fps"),
        (json_of(curves={"": {}}), "1 to 256 printable"),
        (json_of(curves={"x" * 257: {}}), "1 to 256 printable"),
        (json_of(curves={"x\n": {}}), "1 to 256 printable"),
        (json_of(curves={"weight": 3}), "must hold times and values"),
        (curve_json(times=[1.0, 0.0]), "curve 'weight': the times of a curve's keys must increase"),
        (curve_json(values=[1.0]), "as many values as times"),
        (curve_json(values=["a", 1]), "values must be a list of finite numbers"),
        (curve_json(values=[True, 1]), "values must be a list of finite numbers"),
        (curve_json(values=[1e999, 1]), "Infinity"),
        (curve_json(values=[math.nan, 1]), "NaN"),
        (curve_json().replace("1.0]", "1" + "0" * 400 + "]"), "list of finite numbers"),
        (curve_json(interpolation="smoth"), "Did you mean 'smooth'"),
        (curve_json(interpolation=[]), "interpolation must be a name"),
        (curve_json(times=[], values=[]), "at least one"),
    ],
)
def test_what_is_no_curve_file_is_refused(tmp_path, text, message):
    path = tmp_path / "bad.json"
    path.write_text(text)
    with pytest.raises(FootIKError, match=message) as caught:
        read_curves(path, bare(baked()))
    assert str(path) in str(caught.value)


TABLE = "time,weight\n0,0\n0.5,1\n1,0\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "begins with a column named 'time'"),
        ("weight\n1\n", "begins with a column named 'time'"),
        (TABLE.replace("0.5,1", "0.5"), "row 3 has 1 cells, the header 2"),
        (TABLE.replace("0.5,1", "0.5,x"), "row 3, column 'weight': 'x' is no finite number"),
        (TABLE.replace("0.5,1", "0.5,nan"), "'nan' is no finite number"),
        (TABLE.replace("0.5,1", "0.5,1e999"), "no finite number"),
        (TABLE.replace("weight", "a,b"), "row 2 has 2 cells"),
        (TABLE + "1.5,0\n", "the table has 4 rows at 2 a second, but walk has 3 frames at 2"),
        (TABLE.replace("1,0\n", "2,0\n"), "has 3 rows at 1 a second"),
        (TABLE.replace("0.5,1\n1,0", "1e-320,1\n2e-320,0"), "has 3 rows at inf a second"),
        ("time,a,a\n0,0,0\n0.5,1,0\n1,0,0\n", "column 'a' is there twice"),
        ('time,"a\n0,0', "not a CSV table"),
        ("time," + "x" * 300 + "\n0,0", "1 to 256 printable"),
    ],
)
def test_what_is_no_table_of_curves_is_refused(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(FootIKError, match=message):
        read_curves(path, clip_with({}, 3, fps=2.0))


def test_a_good_table_is_read(tmp_path):
    (tmp_path / "x.csv").write_text("\ufeffTime, weight \r\n0,0\r\n0.5,1\r\n1,0\r\n", "utf-8")
    clip = read_curves(tmp_path / "x.csv", clip_with({}, 3, fps=2.0))
    assert clip.curves["weight"].tolist() == [0.0, 1.0, 0.0]


@given(st.data())
def test_mutilated_files_raise_nothing_but_our_error(tmp_path_factory, data):
    clip = baked()
    path = tmp_path_factory.mktemp("fuzz") / f"x{data.draw(st.sampled_from(['.json', '.csv']))}"
    write_curves(path, clip)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 5))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    try:
        read = read_curves(path, bare(clip))
    except FootIKError:
        return
    assert all(np.isfinite(values).all() for values in read.curves.values())


def test_unreadable_files_are_told(tmp_path):
    clip = baked()
    with pytest.raises(FootIKError, match="cannot be read"):
        read_curves(tmp_path / "none.json", clip)
    (tmp_path / "x.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FootIKError, match="byte 0 is not UTF-8"):
        read_curves(tmp_path / "x.json", clip)
    for use in (read_curves, write_curves):
        with pytest.raises(FootIKError, match=r"\.json or \.csv files, not '\.txt'"):
            use(tmp_path / "x.txt", clip)
    with pytest.raises(FootIKError, match="cannot be written"):
        write_curves(tmp_path / "no" / "x.json", clip)


def unity_curves(lines):
    """name -> rows of time, value, inSlope, outSlope, as they stand in the YAML."""
    found, rows, name = {}, [], None
    for line in (line.strip() for line in lines):
        key, _, value = line.removeprefix("- ").partition(": ")
        if key == "name":  # of the importer: before its keys
            name = value
        elif key == "time":
            rows.append([float(value)])
        elif key in ("value", "inSlope", "outSlope"):
            rows[-1].append(float(value.replace("Infinity", "inf")))
        elif key == "m_RotationOrder" and name is not None:
            found[name], rows = np.array(rows), []
        elif key == "attribute":
            found[value], rows = np.array(rows), []
    return found


def unity_value(rows, time):
    """A Unity AnimationCurve at a time: Hermite between keys, held where a slope is infinite."""
    if time <= rows[0, 0]:
        return rows[0, 1]
    if time >= rows[-1, 0]:
        return rows[-1, 1]
    k = int(np.searchsorted(rows[:, 0], time, side="right")) - 1
    (t0, v0, _, out), (t1, v1, into, _) = rows[k], rows[k + 1]
    if math.isinf(out) or math.isinf(into):
        return v0
    d, u = t1 - t0, (time - t0) / (t1 - t0)
    return (
        (2 * u**3 - 3 * u**2 + 1) * v0
        + (u**3 - 2 * u**2 + u) * d * out
        + (3 * u**2 - 2 * u**3) * v1
        + (u**3 - u**2) * d * into
    )


@pytest.mark.parametrize("loop", [False, True])
@pytest.mark.parametrize("kind", ["unity", "unity-meta"])
def test_unity_has_the_same_curve_at_any_time(tmp_path, kind, loop):
    clip = baked(61, loop)
    (path,) = export_curves(tmp_path / "walk.bvh", clip, kind, tolerance=0.005)
    found = unity_curves(path.read_text().splitlines())
    assert list(found) == list(clip.curves)
    times = np.random.default_rng(2).uniform(0.0, clip.duration, 500)
    scale = clip.duration if kind == "unity-meta" else 1.0
    for name, rows in found.items():
        told = np.array([unity_value(rows, t / scale) for t in times])
        keys = keys_of(clip, name, 0.005)
        np.testing.assert_allclose(told, sample(keys, times), atol=1e-6, err_msg=name)
        at_frames = np.array([unity_value(rows, t / scale + 1e-9) for t in clip.times])
        assert np.abs(at_frames - clip.curves[name]).max() <= 0.005 + 1e-6, name


def test_unitys_yaml_has_the_fields_of_an_animation_clip(tmp_path):
    yaml = pytest.importorskip("yaml")
    clip = baked(61, loop=True)
    (path,) = export_curves(tmp_path / "walk.bvh", clip, "unity")
    body = path.read_text().split("\n", 3)[3]  # the tags and the document's name are Unity's own
    told = yaml.safe_load(body)["AnimationClip"]
    assert told["m_Name"] == "walk"
    assert (told["serializedVersion"], told["m_SampleRate"]) == (6, 30)
    for name, held in zip(clip.curves, told["m_FloatCurves"], strict=True):
        assert set(held) == {"curve", "attribute", "path", "classID", "script"}
        assert (held["attribute"], held["path"], held["classID"]) == (name, None, 95)
        assert held["script"] == {"fileID": 0}
        for key in held["curve"]["m_Curve"]:
            assert key["serializedVersion"] == 3
            assert key["weightedMode"] == 0
            assert key["inWeight"] == key["outWeight"] == 0.33333334
            modes = {"LeftFootIKWeight": 0, "LeftFootPhase": 103, "smile": 69}
            assert key["tangentMode"] == modes[name]
    (meta,) = export_curves(tmp_path / "walk.bvh", clip, "unity-meta")
    for name, held in zip(clip.curves, yaml.safe_load(meta.read_text())["curves"], strict=True):
        assert set(held) == {"name", "curve"}
        assert held["name"] == name
        assert {"serializedVersion", "m_Curve", "m_PreInfinity"} <= set(held["curve"])


def test_unreal_has_the_same_curve_between_frames_by_straight_lines(tmp_path):
    clip = baked()
    table, *single = export_curves(tmp_path / "walk.bvh", clip, "unreal")
    head, *rows = csv.reader(table.read_text().splitlines())
    times = np.random.default_rng(3).uniform(0.0, clip.duration, 200)
    for (name, *cells), path in zip(rows, single, strict=True):
        expected = np.interp(times, clip.times, clip.curves[name])
        x, y = np.array(head[1:], dtype=float), np.array(cells, dtype=float)
        np.testing.assert_allclose(np.interp(times, x, y), expected, atol=1e-6)
        x, y = np.loadtxt(path, delimiter=",").T
        np.testing.assert_allclose(np.interp(times, x, y), expected, atol=1e-6)


def test_the_plain_table_is_read_back_exactly(tmp_path):
    clip = baked()
    (path,) = export_curves(tmp_path / "walk.bvh", clip, "csv")
    assert path.name == "walk.curves.csv"
    same_curves(read_curves(path, bare(clip)), clip)


def test_a_unity_clip_has_the_keys_and_their_slopes(tmp_path):
    clip = baked(61, loop=True)
    (path,) = export_curves(tmp_path / "walk.bvh", clip, "unity")
    assert path.name == "walk.anim"
    text = path.read_text()
    assert text.startswith("%YAML 1.1\n%TAG !u! tag:unity3d.com,2011:\n--- !u!74 &7400000\n")
    assert "m_LoopTime: 1\n" in text
    assert "m_StopTime: 2\n" in text
    found = unity_curves(text.splitlines())
    assert list(found) == list(clip.curves)
    keys = clip.extras[CURVE_KEYS]["LeftFootIKWeight"]
    expected = np.stack([keys.times, keys.values, keys.slopes, keys.slopes], axis=-1)
    np.testing.assert_allclose(found["LeftFootIKWeight"], expected, rtol=1e-8, atol=1e-12)
    assert np.isinf(found["LeftFootPhase"][:, 2:]).all()
    smile = found["smile"]
    assert len(smile) < 20  # thinned lines: the slopes are theirs
    assert np.abs(np.interp(clip.times, *smile[:, :2].T) - clip.curves["smile"]).max() <= 0.005
    np.testing.assert_allclose(smile[:-1, 3], np.diff(smile[:, 1]) / np.diff(smile[:, 0]), 1e-6)
    np.testing.assert_allclose(smile[1:, 2], smile[:-1, 3])


def test_unitys_importer_curves_run_from_0_to_1(tmp_path):
    clip = baked(61, loop=True)
    (path,) = export_curves(tmp_path / "walk.glb", clip, "unity-meta")
    lines = path.read_text().splitlines()
    assert lines[0] == "      curves:"
    assert lines[1] == "      - name: LeftFootIKWeight"
    times = [float(line.split()[-1]) for line in lines if line.strip().startswith("time:")]
    assert 0.0 <= min(times) <= max(times) <= 1.0
    slopes = [float(line.split()[-1]) for line in lines if line.strip().startswith("inSlope:")]
    keys = clip.extras[CURVE_KEYS]["LeftFootIKWeight"]
    np.testing.assert_allclose(slopes[: len(keys)], keys.slopes * 2.0, rtol=1e-8)


def test_unreal_gets_a_table_and_a_file_a_curve(tmp_path):
    clip = baked()
    table, *single = export_curves(tmp_path / "walk.bvh", clip, "unreal")
    rows = list(csv.reader(table.read_text().splitlines()))
    np.testing.assert_allclose([float(t) for t in rows[0][1:]], clip.times, rtol=1e-8)
    assert [row[0] for row in rows[1:]] == list(clip.curves)
    np.testing.assert_allclose(
        np.array([row[1:] for row in rows[1:]], dtype=float), list(clip.curves.values()), atol=1e-8
    )
    assert single[0].name == "walk.LeftFootIKWeight.curve.csv"
    values = np.loadtxt(single[0], delimiter=",")
    np.testing.assert_allclose(values[:, 1], clip.curves["LeftFootIKWeight"], atol=1e-8)


def test_odd_names_are_quoted_and_make_no_other_path(tmp_path):
    odd = {"../evil": np.zeros(60), "yes": np.ones(60), "a: [b]": np.zeros(60)}
    clip = clip_with(odd)
    written = [p for kind in EXPORTS for p in export_curves(tmp_path / "x.bvh", clip, kind)]
    assert {p.parent for p in written} == {tmp_path}
    text = (tmp_path / "x.anim").read_text()
    for name in odd:
        assert f"    attribute: {json.dumps(name)}\n" in text


def test_what_cannot_be_exported_is_refused(tmp_path):
    with pytest.raises(FootIKError, match="no curves to export"):
        export_curves(tmp_path / "x.bvh", bare(baked()), "unity")
    with pytest.raises(FootIKError, match="Did you mean 'unreal'"):
        export_curves(tmp_path / "x.bvh", baked(), "unrael")


@pytest.mark.filterwarnings("error")
def test_times_that_hardly_grow_are_refused_without_an_overflow(tmp_path):
    (tmp_path / "x.csv").write_text("time,weight\n0,0\n1e-310,1\n2e-310,0\n")
    with pytest.raises(FootIKError, match="the table has 3 rows"):
        read_curves(tmp_path / "x.csv", clip_with({}, 3, fps=2.0))


def test_every_curve_has_a_file_with_its_own_letters(tmp_path):
    curves = {name: np.full(60, float(i)) for i, name in enumerate(["a/b", "A_b", "Fuß", "足", ""])}
    written = export_curves(tmp_path / "walk.bvh", clip_with(curves), "unreal")
    assert [path.name for path in written] == [
        "walk.curve_table.csv",
        *(f"walk.{name}.curve.csv" for name in ("a_b", "A_b_2", "Fuß", "足", "_")),
    ]
    values = [path.read_text().splitlines()[-1].split(",")[1] for path in written[1:]]
    assert values == ["0", "1", "2", "3", "4"]
