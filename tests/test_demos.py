"""The demos and the README's ten lines run, and print what they promise."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

SAID = {
    "01_ten_lines": r"left: .*\nright: .*",
    "02_your_own_clip": r"at 1\.10 m/s\nfeet were held still in [4-7]\d %",
    "03_settings_side_by_side": r"no IK +openkcc +default",
    "04_moving_platform": r"locked on the platform in [1-9]\d+ of 480 frames",
    "05_steering": r"arrived at \[ ?[34]\.\d+ +[23]\.\d+\] after",
    "06_crowd": r"[5-9]\d % of the feet are locked",
}


def test_every_demo_is_tested():
    assert {path.stem for path in (ROOT / "demos").glob("*.py")} == set(SAID)


@pytest.mark.parametrize("name", SAID)
def test_demo_prints_what_it_promises(name, monkeypatch, capsys):
    script = ROOT / "demos" / f"{name}.py"
    assert len(script.read_text().splitlines()) < 60
    monkeypatch.setattr(sys, "argv", [str(script)])
    runpy.run_path(str(script), run_name="__main__")
    assert re.search(SAID[name], capsys.readouterr().out)


def test_readme_ten_lines_walk_and_tell_each_foot(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)
    exec(compile(code, "README.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["left", "right"]
    assert all(re.search(r"released|grounded|bump stride", line) for line in lines)


def test_readme_is_short_and_holds_the_commands_that_ci_runs():
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 120
    assert "python -m pytest" in text
    assert "&& footik walk" in text
