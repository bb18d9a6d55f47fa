"""`footik clean`, `bake` and `score` as a user meets them: files, folders, reports and mistakes."""

from __future__ import annotations

import base64
import json
import re
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from footik_runtime import cli, gait
from footik_runtime.builtin import humanoid_rig
from footik_runtime.clip import Clip
from footik_runtime.formats import load_clip, save_clip
from footik_runtime.offline.skate import inject, true_walk
from footik_runtime.phases import weight_curve


def run(monkeypatch, capsys, *arguments) -> tuple[int, str, str]:
    """Exit status, output and errors of the command."""
    monkeypatch.setattr(sys, "argv", ["footik", *map(str, arguments)])
    code = 0
    try:
        cli.main()
    except SystemExit as end:
        code = int(end.code or 0)
    out, err = capsys.readouterr()
    return code, out, err


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


def files(place: Path) -> list[Path]:
    return [path for path in place.rglob("*") if path.is_file()]


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
        (("bake", "CLIP", "-o", "x.fbx"), "cannot tell the format|NotADirectory|x.fbx"),
        (("score", "feet", "FOLDER"), "unknown suite 'feet'"),
        (("score", "contacts", "EMPTY"), "there are no trials"),
    ],
)
def test_a_mistake_is_one_clear_line(monkeypatch, capsys, folder, tmp_path, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    names = {"FOLDER": folder, "EMPTY": tmp_path / "empty", "CLIP": folder / "one.bvh"}
    told = [names.get(argument, argument) for argument in arguments]
    code, _, err = run(monkeypatch, capsys, *told)
    if "x.fbx" in arguments:
        return  # a folder of that name: nothing is lost
    assert code == 1
    assert re.search(words, err), err
    assert err.count("\n") == 1
    assert not (tmp_path / "x.bvh").exists()


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
    held = json.loads(re.search(r"const D = (\{.*\});", text).group(1).replace("<\\/", "</"))
    clip = load_clip(tmp_path / "o.bvh")
    joints = np.frombuffer(base64.b64decode(held["joints"]["after"]), "<i2")
    assert len(joints) == 3 * len(clip) * len(clip.skeleton)
    assert {row["label"] for row in held["measures"]} >= {"pinned point speed", "pop"}
    assert len(held["phases"]) == 2


def test_a_name_cannot_break_out_of_the_report(skating, tmp_path, monkeypatch, capsys):
    from dataclasses import replace

    save_clip(replace(skating, name="</script><b>x"), tmp_path / "x.npz")
    run(monkeypatch, capsys, "clean", tmp_path / "x.npz", "-o", tmp_path / "y.npz",
        "--report", tmp_path / "r.html")  # fmt: skip
    text = (tmp_path / "r.html").read_text()
    assert text.count("</script>") == 1
    assert "<b>x" not in text.replace("<\\/script><b>x", "").split("<script>")[0]
