"""Every demo runs as it is and prints what it says; every Python block of the documents runs."""

from __future__ import annotations

import re
import runpy
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from footik_runtime import write_bvh
from footik_runtime.builtin import GAITS, humanoid_rig
from footik_runtime.metrics import MEASURES

ROOT = Path(__file__).resolve().parents[1]
DEMOS = ROOT / "demos"
pytestmark = pytest.mark.skipif(not DEMOS.is_dir(), reason="the demos are not here")


@pytest.fixture
def demo(monkeypatch, capsys):
    """Runs a demo by the beginning of its name, with arguments; what it printed."""

    def run(number: str, *arguments: object) -> str:
        (path,) = DEMOS.glob(f"{number}_*.py")
        monkeypatch.setattr(sys, "argv", [str(path), *map(str, arguments)])
        runpy.run_path(str(path), run_name="__main__")
        return capsys.readouterr().out

    return run


def figure(text: str, pattern: str) -> float:
    """The number that a pattern's group finds in what was printed."""
    found = re.search(pattern, text)
    assert found, f"{pattern!r} is not in:\n{text}"
    return float(found[1])


def cells(table: str, label: str) -> list[str]:
    """What stands in one row of a printed table after the label: the unit, if any, and figures."""
    (row,) = (line for line in table.splitlines() if re.match(re.escape(label) + r" {2}", line))
    return re.split(r" {2,}", row[len(label) :].strip())


def test_demos_are_numbered_and_each_is_tested():
    numbers = sorted(path.name[:2] for path in DEMOS.glob("*.py"))
    assert numbers == [f"{i + 1:02d}" for i in range(len(numbers))]
    tested = set(re.findall(r'demo\("(\d\d)"', Path(__file__).read_text()))
    assert set(numbers) == tested


def test_ten_lines_go_up_the_stairs_and_tell_of_both_feet(demo):
    out = demo("01")
    assert re.findall(r"^(left|right): (?:released|grounded|bump stride)", out, re.M) == [
        "left",
        "right",
    ]
    # 4 s at 1.3 m/s.
    assert figure(out, r"at x = ([\d.]+) m") == pytest.approx(5.2, abs=0.05)


def test_without_a_path_a_walk_is_written_read_and_walked(demo):
    out = demo("02")
    assert out.startswith("walk.bvh: 65 frames")
    assert figure(out, r"speed ([\d.]+) m/s") == pytest.approx(1.3, abs=0.02)
    assert out.count("grounded on terrain_01_hills/hills") >= 2


def test_a_path_names_the_clip_that_is_walked(demo, tmp_path):
    write_bvh(GAITS["walk"](humanoid_rig(), 0.8), tmp_path / "slow.bvh")
    out = demo("02", tmp_path / "slow.bvh")
    assert out.startswith("slow.bvh: ")
    assert figure(out, r"speed ([\d.]+) m/s") == pytest.approx(0.8, abs=0.02)


def test_side_by_side_prints_every_measure_and_the_presets_differ(demo):
    out = demo("03")
    assert re.split(r" {2,}", out.splitlines()[0])[2:] == [
        "without IK",
        "default",
        "openkcc",
        "no hip drop",
    ]
    assert len(out.splitlines()) == 1 + len(MEASURES)
    without, default, openkcc, stiff = map(float, cells(out, "float in contact, mean")[1:])
    assert default < without
    assert default < stiff
    assert default != openkcc
    assert float(cells(out, "pop")[1]) < float(cells(out, "pop")[2])


def test_a_locked_print_moves_in_the_world_and_not_on_the_slab(demo):
    out = demo("04")
    assert figure(out, r"([\d.]+) mm in the world") > 0.5
    assert figure(out, r"([\d.]+) mm on the slab") == 0.0
    # The slab turns by 60 degrees either way, a bump stride starts at 45.
    assert figure(out, r"bump strides in \d+ s: (\d+)") >= 2


def test_feet_that_are_read_land_alternately_and_further_along(demo):
    out = demo("05")
    plants = re.findall(r"s +(left|right) +stands on (\S+) at \(([-\d.]+),", out)
    assert len(plants) == figure(out, r"(\d+) plants") >= 7
    walked = plants[2:]  # the first two are those it starts on
    assert all(a[0] != b[0] for a, b in pairwise(walked))
    assert all(float(a[2]) < float(b[2]) for a, b in pairwise(walked))
    assert {name.split("/")[0] for _, name, _ in plants} >= {"terrain_00_flat", "terrain_01_ramp"}


def test_crowd_has_feet_on_the_ground_and_most_of_them_locked(demo):
    out = demo("06")
    grounded = figure(out, r"(\d+) of 1000 feet on the ground")
    assert 500 < grounded < 950
    assert 300 < figure(out, r"(\d+) of them locked") <= grounded


# --- the blocks of Python in the documents ------------------------------------------------------


def test_a_cleaned_clip_slides_no_more_and_keeps_its_curves_in_a_file(demo, tmp_path):
    text = demo("07")
    assert figure(text, r"slid at ([\d.]+) mm/s") > 30.0
    assert figure(text, r"now at ([\d.]+)") < 1.0
    assert figure(text, r"(\d+) plants") >= 8
    read = re.search(r"read again: (.*)", text)
    assert read is not None
    assert "LeftFootIKWeight" in read[1].split(", ")
    write_bvh(GAITS["walk"](humanoid_rig(), None), tmp_path / "own.bvh")
    assert demo("07", tmp_path / "own.bvh").startswith("own:")


def blocks(path: Path) -> list[str]:
    """The ```python blocks of a Markdown file."""
    return re.findall(r"^```python\n(.*?)^```", path.read_text(encoding="utf-8"), re.M | re.S)


def runnable() -> list:
    """The blocks of the documents that need no file of the reader's."""
    return [
        pytest.param(block, id=f"{page.stem}-{i}")
        for page in sorted((ROOT / "docs").glob("*.md"))
        for i, block in enumerate(blocks(page))
        if '"your' not in block
    ]


@pytest.mark.parametrize("block", runnable())
def test_a_block_of_the_documentation_runs(block, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(block, "block", "exec"), {"__name__": "block"})


def test_blocks_about_a_file_of_your_own_run_with_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_bvh(GAITS["walk"](humanoid_rig(), None), tmp_path / "your.bvh")
    names: dict = {"__name__": "block"}
    (clip,) = (b for b in blocks(ROOT / "docs" / "your-own-character.md") if '"your.bvh"' in b)
    exec(compile(clip, "block", "exec"), names)
    names["walker"].step(1 / 60)
    assert names["scene"].motion.speed == pytest.approx(1.3, abs=0.02)


def test_the_ten_lines_of_the_readme_run_and_tell_of_both_feet(tmp_path, monkeypatch, capsys):
    found = [b for b in blocks(ROOT / "README.md") if "HumanoidFootIK" in b]
    if not found:
        pytest.skip("README.md has no Python block with HumanoidFootIK")
    monkeypatch.chdir(tmp_path)
    write_bvh(GAITS["walk"](humanoid_rig(), None), tmp_path / "your.bvh")
    exec(compile(found[0], "README.md", "exec"), {"__name__": "block"})
    printed = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in printed] == ["left", "right"]
    code = [line for line in found[0].splitlines() if line.strip() and line.strip()[0] != "#"]
    assert len(code) <= 10
