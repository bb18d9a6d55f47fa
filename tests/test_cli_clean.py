"""`footik clean`, `bake` and `score` as a user meets them: files, folders, reports and mistakes."""

from __future__ import annotations

import base64
import json
import re
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from gltf_files import walker

from footik_runtime import cli, gait
from footik_runtime.builtin import humanoid_rig
from footik_runtime.clip import Clip
from footik_runtime.commands import bake as bake_command
from footik_runtime.commands import clean as clean_command
from footik_runtime.commands.claims import require_apart
from footik_runtime.errors import FootIKError
from footik_runtime.formats import load_clip, save_clip
from footik_runtime.formats.glb_container import pack_glb, read_container
from footik_runtime.formats.gltf import read_animations
from footik_runtime.motion import Motion
from footik_runtime.offline.curve_keys import Keys, sample
from footik_runtime.offline.skate import inject, true_walk
from footik_runtime.phases import phase_curve, weight_curve
from footik_runtime.rig import find_rig


def run(monkeypatch, capsys, *arguments) -> tuple[int, str, str]:
    """Exit status, output and errors of the command."""
    monkeypatch.setattr(sys, "argv", ["footik", *map(str, arguments)])
    code = 0
    try:
        cli.main()
    except SystemExit as end:
        code = int(end.code or 0)
    out, err = capsys.readouterr()
    told = [line for line in err.splitlines(keepends=True) if "compiling the kernels" not in line]
    return code, out, "".join(told)


@pytest.fixture(scope="module")
def skating() -> Clip:
    rig = humanoid_rig()
    truth = true_walk(gait.walk(rig, speed=1.2), rig, cycles=3)
    return inject(truth, "constant", 0.06)


@pytest.fixture
def folder(skating, tmp_path) -> Path:
    place = tmp_path / "takes"
    (place / "more").mkdir(parents=True)
    save_clip(skating, place / "one.bvh")
    save_clip(skating, place / "more" / "two.npz")
    (place / "notes.txt").write_text("not a clip")
    return place


def test_a_clip_is_cleaned_baked_and_measured(monkeypatch, capsys, folder, tmp_path):
    source = folder / "one.bvh"
    before = source.read_bytes()
    code, out, err = run(
        monkeypatch, capsys, "clean", source, "-o", tmp_path / "out.bvh",
        "--json", tmp_path / "out.json", "--redetect",
    )  # fmt: skip
    assert (code, err) == (0, "")
    assert "pinned point speed" in out
    assert source.read_bytes() == before
    told = json.loads((tmp_path / "out.json").read_text())
    measures = told["files"][0]["clips"][0]["measures"]
    key = "pinned_point_speed"
    assert measures["after"][key] < 0.05 * measures["before"][key]
    cleaned = load_clip(tmp_path / "out.bvh")
    assert weight_curve("left") in cleaned.curves
    assert len(cleaned) == len(load_clip(source))


def test_a_folder_goes_on_past_a_file_that_fails(monkeypatch, capsys, folder, tmp_path):
    (folder / "broken.bvh").write_text("HIERARCHY\nROOT")
    code, out, err = run(monkeypatch, capsys, "clean", folder, "-o", tmp_path / "done")
    assert code == 1
    assert err.count("\n") == 1
    assert "broken.bvh" in err
    assert "2 done, 1 failed" in out
    written = sorted(p.relative_to(tmp_path / "done").as_posix() for p in files(tmp_path / "done"))
    assert written == ["more/two.npz", "one.bvh", "one.curves.json"]


def test_a_folder_may_be_worked_through_again(monkeypatch, capsys, folder):
    out = folder / "done"
    for name in ("x.curves.csv", "x.curve_table.csv", "x.Y.curve.csv"):  # of curves, not clips
        (folder / name).write_text("0,1\n")
    for note in ("", f"footik: 2 clips in {out}, where results go, are taken for earlier ones\n"):
        code, told, err = run(monkeypatch, capsys, "bake", folder, "-o", out, "--export", "unreal")
        assert (code, err) == (0, note)
        assert "2 done, 0 failed" in told
    assert len(list(out.rglob("*.bvh"))) == 1
    code, told, err = run(monkeypatch, capsys, "bake", out, "-o", folder.parent, "--replace")
    assert (code, err) == (0, "")
    assert (folder.parent / "one.bvh").exists()
    code, _, err = run(monkeypatch, capsys, "bake", folder, "-o", folder)
    assert code == 1
    assert "would replace an input" in err


def test_a_folder_goes_on_past_a_fault_of_ours(monkeypatch, capsys, folder, tmp_path):
    def breaks(clip, *_arguments, **_options):
        if clip.name == "one":
            raise ValueError("no such\nthing")
        return baked(clip, *_arguments, **_options)

    baked = bake_command.bake_clip
    monkeypatch.setattr(bake_command, "bake_clip", breaks)
    code, out, err = run(monkeypatch, capsys, "bake", folder, "-o", tmp_path / "done")
    assert code == 1
    assert "1 done, 1 failed" in out
    assert err == f"footik: {folder / 'one.bvh'}: failed with ValueError: no such thing\n"
    with pytest.raises(ValueError, match="no such"):
        run(monkeypatch, capsys, "bake", folder / "one.bvh", "-o", tmp_path / "o.bvh")


def data_of(text: str, pattern: str):
    """The data that a page holds."""
    found = re.search(pattern, text)
    assert found is not None
    return json.loads(found[1].replace("<\\/", "</"))


def files(place: Path) -> list[Path]:
    return [path for path in place.rglob("*") if path.is_file()]


def contents(place: Path) -> dict[str, bytes]:
    return {path.relative_to(place).as_posix(): path.read_bytes() for path in files(place)}


@pytest.mark.parametrize(
    "arguments",
    [
        "clean one.bvh -o o.bvh --json one.bvh",
        "clean one.bvh -o o.bvh --report link.bvh",
        "clean one.bvh -o o.bvh --json one.curves.json",
        "clean one.bvh -o o.bvh --json o.bvh",
        "clean one.bvh -o o.bvh --json o.curves.json",
        "clean one.bvh -o o.bvh --report o.bvh",
        "clean one.bvh -o o.bvh --report r --json ./r",
        "clean one.bvh -o o.bvh --export csv --json o.curves.csv",
        "clean one.bvh -o o.npz --model one.curves.json --json one.curves.json",
        "clean one.bvh one.bvh -o out",
        "clean . -o out --json more/two.npz",
        "clean . -o out --report out/one.bvh",
        "clean . -o out --report r.html --json r.one.html",
        "bake one.bvh -o o.bvh --json one.bvh",
        "bake one.bvh -o o.bvh --json o.bvh",
        "bake one.bvh -o o.bvh --export unity --json o.anim",
        "inspect one.bvh --json link.bvh",
        "walk --clip one.bvh --out one.bvh",
        "walk --clip one.bvh --out o.npz --json o.npz",
        "score cleanup --clips . --json one.bvh",
    ],
)
def test_no_output_replaces_an_input_or_another_output(monkeypatch, capsys, folder, arguments):
    (folder / "one.curves.json").write_text("curves")
    (folder / "link.bvh").symlink_to(folder / "one.bvh")
    if "." in arguments.split()[1:3]:
        (folder / "link.bvh").unlink()
    monkeypatch.chdir(folder)
    before = contents(folder)
    code, out, err = run(monkeypatch, capsys, *arguments.split())
    assert (code, out) == (1, "")
    assert re.search("would replace an input|would go to the same file", err), err
    assert err.count("\n") == 1
    assert contents(folder) == before


def test_devices_may_be_written_to_more_than_once(monkeypatch, capsys, folder):
    null = "/dev/null"
    code, _, err = run(monkeypatch, capsys, "bake", folder / "one.bvh", "-o", folder / "o.npz",
                       "--json", null)  # fmt: skip
    assert (code, err) == (0, "")
    require_apart([], {"--json": Path(null), "--out": Path(null)})


def test_pages_of_several_clips_may_all_go_to_a_device(monkeypatch, capsys, folder, tmp_path):
    pages = []
    monkeypatch.setattr(clean_command, "write_whole", lambda path, _data: pages.append(str(path)))
    code, _, err = run(monkeypatch, capsys, "clean", folder, "-o", tmp_path / "o", "--report",
                       "/dev/null")  # fmt: skip
    assert (code, err) == (0, "")
    assert pages == ["/dev/null"] * 3


@pytest.mark.parametrize(
    "arguments",
    [
        "a/w.gltf b/v.gltf -o out",
        "a/w.gltf -o o.gltf --json a/w.bin",
        "a/w.gltf -o out --json out/w.bin",
    ],
)
def test_files_that_a_gltf_names_are_not_replaced(monkeypatch, capsys, tmp_path, arguments):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        walker().gltf(tmp_path / folder / "w.gltf")
    (tmp_path / "b" / "w.gltf").rename(tmp_path / "b" / "v.gltf")
    monkeypatch.chdir(tmp_path)
    before = contents(tmp_path)
    code, _, err = run(monkeypatch, capsys, "bake", *arguments.split())
    assert code == 1
    assert re.search(r"w\.bin: .* would (replace an input|go to the same file)", err), err
    assert contents(tmp_path) == before


def test_files_with_the_same_curves_file_are_not_mixed(monkeypatch, capsys, folder):
    (folder / "one.csv").write_text("0,1\n")
    (folder / "model.xml").write_text("<mujoco/>")
    code, _, err = run(monkeypatch, capsys, "clean", folder, "-o", folder / "out", "--model",
                       folder / "model.xml")  # fmt: skip
    assert code == 1
    assert re.search(r"one.curves.json: the curves of .*one\.\w+ and .*one\.\w+ would go to", err)
    assert not (folder / "out").exists()


@pytest.mark.parametrize("out", ["one.bvh", "link.bvh", "."])
def test_an_input_is_never_replaced(monkeypatch, capsys, folder, out):
    (folder / "link.bvh").symlink_to(folder / "one.bvh")
    before = (folder / "one.bvh").read_bytes()
    code, _, err = run(monkeypatch, capsys, "clean", folder / "one.bvh", "-o", folder / out)
    assert code == 1
    assert "would replace an input" in err
    assert (folder / "one.bvh").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("clean", "nowhere.bvh", "-o", "x.bvh"), "no such file or folder"),
        (("clean", "FOLDER", "-o", "x.bvh"), "several clips need a folder"),
        (("clean", "EMPTY", "-o", "x"), "there are no clips"),
        (("clean", "CLIP", "-o", "x.bvh", "--preset", "kovar"), "unknown preset 'kovar'"),
        (("clean", "CLIP", "-o", "x.bvh", "--stretch", "-1"), "stretch must be in"),
        (("clean", "CLIP", "-o", "x.bvh", "--terrain", "moon"), "unknown terrain 'moon'"),
        (("clean", "CLIP", "-o", "x.bvh", "--terrain", "flat", "--floor", "0"), "not as both"),
        (("clean", "CLIP", "-o", "x.bvh", "--export", "maya"), "unknown export"),
        (("bake", "CLIP", "-o", "x.bvh", "--preset", "kovar"), "unknown preset 'kovar'"),
        *[
            (("clean", "CLIP", "-o", "x.bvh", "--preset", "footplant", *option), f"no {option[0]}:")
            for option in (
                ("--level",),
                ("--terrain", "flat"),
                ("--floor", "0"),
                ("--stretch", "0.1"),
                ("--ease", "0.1"),
                ("--no-snap",),
                ("--redetect",),
            )
        ],
        (
            ("bake", "CLIP", "-o", "x.bvh", "--preset", "openkcc", "--redetect", "--ease-in", "0"),
            "--preset openkcc takes no --ease-in, --redetect:",
        ),
        (("bake", "CLIP", "-o", "x.fbx"), "x.fbx: clips are written as .bvh, .*, not '.fbx'"),
        (("clean", "FOLDER", "-o", "x.json"), "x.json: clips are written as"),
        (("clean", "CLIP", "-o", "FILE"), "is no folder that results can go to"),
        (("clean", "CLIP", "-o", "x.bvh", "--frame-rate", "0"), "--frame-rate: a motion has 1 to"),
        (("inspect", "CLIP", "--frame-rate", "nan"), "--frame-rate: a motion has 1 to .*not nan"),
        (("inspect", "CLIP", "--legs", "l=a,b,c", "r=d,b,e"), "joint 'b' is there twice"),
        (("inspect", "CLIP", "--legs", "l=a,b,a"), "joint 'a' is there twice"),
        (("inspect", "CLIP", "--legs", "l=a,b,c", "l=d,e,f"), "'l' is there twice"),
        (("clean", "CLIP", "-o", "x.bvh", "--floor", "1e300"), "a floor lies within 100000 m"),
        (("bake", "CLIP", "-o", "x.bvh", "--json", "a" * 300), "aaa: File name too long"),
        (("bake", "a" * 300, "-o", "x.bvh"), "aaa: File name too long"),
        (("inspect", "nowhere"), "nowhere: there is no such file"),
        (("inspect", "FOLDER"), "takes: is a folder"),
        (("inspect", "NPZ", "--model", "empty"), "empty: there is no such model file"),
        (("inspect", "NPZ", "--model", "FILE"), "not a model that MuJoCo reads"),
        (("score", "feet", "FOLDER"), "unknown suite 'feet'"),
        (("score", "contacts", "EMPTY"), "there are no trials"),
    ],
)
def test_a_mistake_is_one_clear_line(monkeypatch, capsys, folder, tmp_path, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    names = {"FOLDER": folder, "EMPTY": tmp_path / "empty", "CLIP": folder / "one.bvh"}
    names["NPZ"] = folder / "more" / "two.npz"
    names["FILE"] = folder / "notes.txt"
    told = [names.get(argument, argument) for argument in arguments]
    code, _, err = run(monkeypatch, capsys, *told)
    assert code == 1
    assert re.search(words, err), err
    assert err.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} == {"takes", "empty"}


def test_curves_are_baked_into_the_motion_as_it_is(monkeypatch, capsys, folder, tmp_path):
    code, out, err = run(
        monkeypatch, capsys, "bake", folder / "one.bvh", "-o", tmp_path / "b.npz",
        "--redetect", "--replace", "--export", "unity",
    )  # fmt: skip
    assert (code, err) == (0, "")
    assert "LeftFootIKWeight" in out
    baked, given = load_clip(tmp_path / "b.npz"), load_clip(folder / "one.bvh")
    np.testing.assert_array_equal(baked.rotations, given.rotations)
    np.testing.assert_array_equal(baked.root_positions, given.root_positions)
    weights = baked.curves["LeftFootIKWeight"]
    assert weights.min() == 0.0
    assert weights.max() == 1.0
    assert (tmp_path / "b.anim").read_text().startswith("%YAML")


def test_the_keys_of_baked_curves_are_told(monkeypatch, capsys, short, tmp_path):
    save_clip(short, tmp_path / "w.npz")
    code, _, err = run(monkeypatch, capsys, "bake", tmp_path / "w.npz", "-o", tmp_path / "b.npz",
                       "--json", tmp_path / "b.json")  # fmt: skip
    assert (code, err) == (0, "")
    (told,) = json.loads((tmp_path / "b.json").read_text())["files"][0]["clips"]
    baked = load_clip(tmp_path / "b.npz")
    assert set(told["curves"]) == set(baked.curves)
    for name, keys in told["curves"].items():
        made = Keys(times=np.array(keys["times"]), values=np.array(keys["values"]),
                    interpolation=keys["interpolation"])  # fmt: skip
        np.testing.assert_array_equal(sample(made, baked.times), baked.curves[name])


def test_curves_that_are_there_are_replaced_only_when_asked(monkeypatch, capsys, folder, tmp_path):
    skates = load_clip(folder / "one.bvh")
    drawn = np.linspace(0.0, 1.0, len(skates))
    save_clip(skates.with_curves(**{weight_curve("left"): drawn, "smile": drawn}), folder / "c.bvh")
    todo = (folder / "c.bvh", "-o", tmp_path / "out.bvh")
    code, _, err = run(monkeypatch, capsys, "bake", *todo)
    assert code == 1
    assert "has the curves LeftFootIKWeight already; --replace" in err
    assert not (tmp_path / "out.bvh").exists()
    code, out, err = run(monkeypatch, capsys, "clean", *todo, "--redetect")
    assert (code, err) == (0, "")
    assert "note: curve 'LeftFootIKWeight' was there already and stays" in out
    np.testing.assert_array_equal(
        load_clip(tmp_path / "out.bvh").curves[weight_curve("left")], drawn
    )
    for command in ("bake", "clean"):
        code, out, _ = run(monkeypatch, capsys, command, *todo, "--redetect", "--replace")
        assert code == 0
        assert "stays" not in out
        curves = load_clip(tmp_path / "out.bvh").curves
        assert not np.array_equal(curves[weight_curve("left")], drawn)
        np.testing.assert_array_equal(curves["smile"], drawn)


def test_baked_curves_are_what_a_walk_uses(monkeypatch, capsys, folder, tmp_path):
    run(monkeypatch, capsys, "bake", folder / "one.bvh", "-o", tmp_path / "b.bvh", "--redetect")
    code, out, _ = run(monkeypatch, capsys, "inspect", tmp_path / "b.bvh")
    assert code == 0
    assert "LeftFootIKWeight" in out


class Page(HTMLParser):
    """What a page holds, and whether it fetches anything."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.fetched: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.fetched += [value for name, value in attrs if name in ("src", "href") and value]


def test_a_report_is_one_page_that_fetches_nothing(monkeypatch, capsys, folder, tmp_path):
    code, _, _ = run(
        monkeypatch, capsys, "clean", folder / "one.bvh", "-o", tmp_path / "o.bvh",
        "--report", tmp_path / "r.html", "--redetect",
    )  # fmt: skip
    assert code == 0
    text = (tmp_path / "r.html").read_text()
    page = Page()
    page.feed(text)
    assert "canvas" in page.tags
    assert page.fetched == []
    assert "http" not in text
    held = data_of(text, r"const D = (\{.*\});")
    clip = load_clip(tmp_path / "o.bvh")
    joints = np.frombuffer(base64.b64decode(held["joints"]["after"]), "<i2")
    assert len(joints) == 3 * len(clip) * len(clip.skeleton)
    assert {row["label"] for row in held["measures"]} >= {"pinned point speed", "pop"}
    assert len(held["phases"]) == 2


def test_a_name_cannot_break_out_of_the_report(skating, tmp_path, monkeypatch, capsys):
    save_clip(replace(skating, name="</script><b>x"), tmp_path / "x.npz")
    run(monkeypatch, capsys, "clean", tmp_path / "x.npz", "-o", tmp_path / "y.npz",
        "--report", tmp_path / "r.html")  # fmt: skip
    text = (tmp_path / "r.html").read_text()
    assert text.count("</script>") == 1
    assert "<b>x" not in text.replace("<\\/script><b>x", "").split("<script>")[0]


def test_a_folders_report_is_a_table_of_all_clips_with_their_pages(
    monkeypatch, capsys, folder, tmp_path
):
    (folder / "broken.bvh").write_text("HIERARCHY\nROOT")
    out = tmp_path / "done"
    code, _, _ = run(monkeypatch, capsys, "clean", folder, "-o", out, "--report", out / "all.html",
                     "--redetect")  # fmt: skip
    assert code == 1
    text = (out / "all.html").read_text()
    assert "http" not in text
    rows = data_of(text, r"const ROWS = (\[.*\]);")
    by_name = {Path(row["file"]).name: row for row in rows}
    assert sorted(by_name) == ["broken.bvh", "one.bvh", "two.npz"]
    assert "line" in by_name["broken.bvh"]["error"]
    for name in ("one.bvh", "two.npz"):
        row = by_name[name]
        before, after = row["pinned_point_speed"]
        assert after < 0.05 * before
        assert (out / row["page"]).read_text().startswith("<!doctype html>")
        assert row["plants"] > 4


def test_a_job_that_fails_half_way_leaves_nothing_behind(monkeypatch, capsys, folder, tmp_path):
    def breaks(*_arguments, **_options):
        raise FootIKError("the disk is full.")

    monkeypatch.setattr("footik_runtime.formats.write_bvh", breaks)
    source = (folder / "one.bvh").read_bytes()
    code, _, err = run(monkeypatch, capsys, "clean", folder / "one.bvh", "-o", tmp_path / "o.bvh",
                       "--report", tmp_path / "r.html", "--export", "csv")  # fmt: skip
    assert (code, err) == (1, "footik: the disk is full.\n")
    assert [path.name for path in tmp_path.iterdir()] == ["takes"]
    assert (folder / "one.bvh").read_bytes() == source


@pytest.mark.parametrize("command", ["clean", "bake", "inspect", "walk"])
def test_legs_may_be_named(monkeypatch, capsys, skating, tmp_path, command):
    names = tuple(f"joint{i}" for i in range(len(skating.skeleton)))
    skeleton = replace(skating.skeleton, names=names)
    save_clip(replace(skating, skeleton=skeleton), tmp_path / "x.npz")
    legs = [
        f"{leg.name}=" + ",".join(names[getattr(leg, part)] for part in PARTS)
        for leg in humanoid_rig().legs
    ]
    arguments = {
        "clean": ("clean", tmp_path / "x.npz", "-o", tmp_path / "y.npz"),
        "bake": ("bake", tmp_path / "x.npz", "-o", tmp_path / "y.npz"),
        "inspect": ("inspect", tmp_path / "x.npz"),
        "walk": ("walk", "--clip", tmp_path / "x.npz", "--seconds", "0.5"),
    }[command]
    code, out, err = run(monkeypatch, capsys, *arguments, "--legs", *legs)
    assert code == 0, err
    assert out
    wrong = [legs[0], legs[1].replace("joint", "jiont")]
    code, _, err = run(monkeypatch, capsys, *arguments, "--legs", *wrong)
    assert code == 1
    assert re.search(r"unknown joint 'jiont\d+'. Did you mean 'joint", err)
    code, _, err = run(monkeypatch, capsys, *arguments, "--legs", "left=joint1")
    assert "a leg is NAME=HIP,KNEE,ANKLE" in err


PARTS = ("hip", "knee", "ankle", "toe")


def test_inspect_tells_contacts_and_curves_with_their_keys(monkeypatch, capsys, folder, tmp_path):
    run(monkeypatch, capsys, "bake", folder / "one.bvh", "-o", tmp_path / "b.npz", "--redetect")
    code, out, _ = run(
        monkeypatch, capsys, "inspect", tmp_path / "b.npz", "--json", tmp_path / "i.json"
    )
    assert code == 0
    assert re.search(r"LeftFootIKWeight \(\d+ keys\)", out)
    told = json.loads((tmp_path / "i.json").read_text())
    spans = told["contacts"]["left"]
    assert len(spans) >= 3
    assert all(start < end for start, end in spans)
    assert f"{len(spans)}, " in told["left contacts, s"]


def test_a_motion_takes_its_contacts_from_curves(skating):
    rig = humanoid_rig()
    loop = replace(gait.walk(rig), curves={})
    told = (np.arange(len(loop)) > len(loop) // 2).astype(float)
    told[0] = told[-1]
    motion = Motion.prepare(loop.with_curves(**{weight_curve("left"): told}), rig)
    assert np.array_equal(motion.clip.curves[weight_curve("left")], told)
    assert np.array_equal(motion.clip.curves[phase_curve("left")] > 0, told > 0.5)


@pytest.mark.parametrize("suffix", [".bvh", ".glb", ".npz"])
def test_what_is_baked_is_what_the_motion_has(monkeypatch, capsys, skating, tmp_path, suffix):
    save_clip(skating, tmp_path / "in.npz")
    baked = tmp_path / f"baked{suffix}"
    code, _, err = run(monkeypatch, capsys, "clean", tmp_path / "in.npz", "-o", baked)
    assert code == 0, err
    clip = load_clip(baked)
    rig = humanoid_rig() if suffix == ".npz" else find_rig(clip.skeleton)
    motion = Motion.prepare(clip, rig)
    phases = np.asarray(clip.curves[phase_curve("left")])
    cycle = motion.clip.curves[phase_curve("left")][:-1]
    windows = np.lib.stride_tricks.sliding_window_view(phases, len(cycle))
    agree = (windows == cycle).mean(axis=1).max()
    assert agree > 0.97


def walks(names: list[str | None], walk: Clip, path: Path) -> Path:
    """A GLB with a copy of a walk for each name; None has no name."""
    save_clip(replace(walk, name="x"), path)
    gltf = read_container(path)
    animations = [{**gltf.json["animations"][0], "name": name} for name in names]
    for animation in animations:
        if animation["name"] is None:
            del animation["name"]
    path.write_bytes(pack_glb({**gltf.json, "animations": animations}, gltf.chunks))
    return path


@pytest.fixture(scope="module")
def short(skating) -> Clip:
    return skating.cut(0, 40)


@pytest.mark.parametrize("command", ["clean", "bake"])
def test_every_animation_has_its_own_exports_and_page(
    monkeypatch, capsys, short, tmp_path, command
):
    names = ["Geh/Lauf", "Geh_Lauf", None, None, "歩く", "../up", "a" * 400]
    source = walks(names, short, tmp_path / "w.glb")
    out = tmp_path / "out"
    page = ["--report", out / "r.html"] if command == "clean" else []
    code, _, err = run(monkeypatch, capsys, command, source, "-o", out, "--animation", "all",
                       "--export", "unity", "--json", out / "all.json", *page)  # fmt: skip
    assert (code, err) == (0, "")
    labels = ["Geh_Lauf", "Geh_Lauf_2", "animation_2", "animation_3", "歩く", "_up", "a" * 80]
    there = {path.name for path in files(out)}
    assert {f"w.{label}.anim" for label in labels} <= there
    told = json.loads((out / "all.json").read_text())["files"][0]["clips"]
    assert [clip["exports"] for clip in told] == [[f"w.{label}.anim"] for label in labels]
    if command == "clean":
        assert [clip["page"] for clip in told] == [f"r.w.{label}.html" for label in labels]
        assert {clip["page"] for clip in told} <= there
    assert len(list(read_animations(out / "w.glb"))) == len(names)


def test_exports_of_no_curves_leave_nothing_behind(monkeypatch, capsys, short, tmp_path):
    save_clip(short, tmp_path / "w.npz")
    code, _, err = run(monkeypatch, capsys, "clean", tmp_path / "w.npz", "-o", tmp_path / "o.npz",
                       "--no-curves", "--export", "csv")  # fmt: skip
    assert code == 1
    assert "has no curves to export" in err
    assert [path.name for path in tmp_path.iterdir()] == ["w.npz"]


def test_results_of_equal_names_have_their_own_pages_and_exports(
    monkeypatch, capsys, short, tmp_path
):
    takes, out = tmp_path / "takes", tmp_path / "out"
    for place in ("w.bvh", "w.npz", "a/w.npz", "b/w.npz"):
        (takes / place).parent.mkdir(parents=True, exist_ok=True)
        save_clip(short, takes / place)
    code, _, err = run(monkeypatch, capsys, "clean", takes, "-o", out, "--report", out / "r.html",
                       "--export", "csv", "--redetect")  # fmt: skip
    assert (code, err) == (0, "")
    pages = sorted(path.name for path in out.glob("r*.html"))
    assert pages == ["r.b_w.html", "r.html", "r.out_w.html", "r.out_w_npz.html", "r.w.html"]
    exports = sorted(p.relative_to(out).as_posix() for p in out.rglob("*.curves.csv"))
    assert exports == ["a/w.curves.csv", "b/w.curves.csv", "w.curves.csv", "w_npz.curves.csv"]
    rows = data_of((out / "r.html").read_text(), r"const ROWS = (\[.*\]);")
    assert sorted(row["page"] for row in rows) == [page for page in pages if page != "r.html"]
