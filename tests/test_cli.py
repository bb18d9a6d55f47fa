"""The command line: its tables and files, and the one clear error for each bad input."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from footik_runtime import FootIKError, FootIKSettings, cli, write_bvh
from footik_runtime.builtin import HUMANOID, builtin_motion, humanoid_rig
from footik_runtime.gait import walk as gait_walk
from footik_runtime.metrics import MEASURES
from footik_runtime.plot import require_plot
from footik_runtime.rig_model import find_rig_in_model
from footik_runtime.scene import Scene
from footik_runtime.walk import record_walk

SHARED = Path(os.environ.get("FOOTIK_SHARED", Path(__file__).parents[2] / "shared"))


@pytest.fixture(scope="module")
def walk_bvh(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("clips") / "walk.bvh"
    write_bvh(gait_walk(humanoid_rig(), speed=1.2), path)
    return path


def run(monkeypatch, capsys, *arguments: str | Path) -> tuple[int, str, str]:
    monkeypatch.setattr(sys, "argv", ["footik", *map(str, arguments)])
    code = 0
    try:
        cli.main()
    except SystemExit as stop:
        code = int(stop.code or 0)
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_walk_prints_every_measure_without_and_with_ik(monkeypatch, capsys):
    code, out, _ = run(monkeypatch, capsys, "walk", "--terrain", "flat", "--seconds", "1")
    assert code == 0
    for measure in MEASURES:
        assert measure.label in out
    assert "without IK" in out
    assert "with IK" in out


def test_walk_of_a_clip_writes_json_run_and_plot(monkeypatch, capsys, walk_bvh, tmp_path):
    pytest.importorskip("matplotlib")
    before = walk_bvh.read_bytes()
    files = {name: tmp_path / f"run.{name}" for name in ("json", "npz", "png")}
    arguments = ["walk", "--clip", walk_bvh, "--terrain", "slope", "--seconds", "1.5"]
    arguments += ["--json", files["json"], "--out", files["npz"], "--plot", files["png"]]
    code, _, err = run(monkeypatch, capsys, *arguments)
    assert code == 0, err
    table = json.loads(files["json"].read_text())
    assert table["terrain"] == "slope"
    assert set(table["measures"]) == {"without IK", "with IK"}
    assert set(table["measures"]["with IK"]) >= {measure.key for measure in MEASURES}
    with np.load(files["npz"]) as arrays:
        frames = len(arrays["times"])
        assert frames == 90
        joints = len(arrays["joint_names"])
        assert arrays["rotations"].shape == (frames, joints, 4)
        assert arrays["foot_state"].shape == (frames, 2)
    assert files["png"].read_bytes().startswith(b"\x89PNG")
    assert walk_bvh.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run.json", "run.npz", "run.png"]


def test_inspect_tells_frames_phases_and_rig(monkeypatch, capsys, walk_bvh):
    code, out, _ = run(monkeypatch, capsys, "inspect", walk_bvh)
    assert code == 0
    assert "left_thigh > left_shin > left_foot > left_toes" in out
    assert "speed, m/s" in out
    assert "swing" in out


def test_inspect_of_a_captured_walk_finds_its_cycle(monkeypatch, capsys, tmp_path):
    clip = SHARED / "data" / "bvh" / "cmu_02_01_walk.bvh"
    if not clip.is_file():
        pytest.skip(f"no shared data at {SHARED}: set FOOTIK_SHARED")
    facts = tmp_path / "facts.json"
    code, out, _ = run(monkeypatch, capsys, "inspect", clip, "--json", facts)
    assert code == 0
    assert "lfemur > ltibia > lfoot > ltoes" in out
    told = json.loads(facts.read_text())
    assert told["frames"] == 343
    assert 1.0 < told["cycle, s"] < 1.2
    assert 1.1 < told["speed, m/s"] < 1.3


def broken(text: str, tmp_path: Path) -> Path:
    path = tmp_path / "broken.bvh"
    path.write_text(text)
    return path


def test_missing_clip_is_named(monkeypatch, capsys):
    code, out, err = run(monkeypatch, capsys, "walk", "--clip", "no/such.bvh")
    assert code == 1
    assert out == ""
    assert err == "footik: no/such.bvh: there is no such file.\n"


def test_truncated_clip_is_one_line(monkeypatch, capsys, walk_bvh, tmp_path):
    text = walk_bvh.read_text()
    clip = broken(text[: text.index("MOTION") // 2], tmp_path)
    code, _, err = run(monkeypatch, capsys, "walk", "--clip", clip)
    assert code == 1
    assert err.count("\n") == 1
    assert "broken.bvh" in err
    assert "line" in err


def test_nan_in_the_motion_names_line_frame_and_joint(monkeypatch, capsys, walk_bvh, tmp_path):
    lines = walk_bvh.read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("Frame Time")) + 1
    numbers = lines[first + 4].split()
    numbers[7] = "nan"
    lines[first + 4] = " ".join(numbers)
    clip = broken("\n".join(lines), tmp_path)
    code, _, err = run(monkeypatch, capsys, "walk", "--clip", clip)
    assert code == 1
    assert err.count("\n") == 1
    assert "frame 4" in err
    assert f"line {first + 5}" in err
    assert "joint" in err


def test_clip_without_legs_lists_its_joints(monkeypatch, capsys, tmp_path):
    snake = """HIERARCHY
ROOT head
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT body
  {
    OFFSET 0 0 -50
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 0 -50
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.0333333
0 10 0 0 0 0 0 0 0
0 10 0 0 0 0 0 0 0
0 10 0 0 0 0 0 0 0
"""
    code, _, err = run(monkeypatch, capsys, "walk", "--clip", broken(snake, tmp_path))
    assert code == 1
    assert "legs" in err
    assert "head, body" in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--terrain", "hils"), ("unknown terrain 'hils'", "Did you mean 'hills'", "stairs")),
        (("--preset", "opencc"), ("unknown preset 'opencc'", "openkcc")),
        (("--gait", "wlak"), ("unknown gait", "walk")),
        (("--gait", "wlak", "--clip", "clip.bvh"), ("unknown gait", "walk")),
        (("--seconds", "-1"), ("seconds must be positive",)),
        (("--seconds", "nan"), ("seconds must be positive",)),
        (("--fps", "0"), ("fps must be in",)),
        (("--speed", "99"), ("speed", "99")),
        (("--out", "/no/such/folder/run.npz"), ("there is no folder",)),
        (("--clip", "clip.xyz"), (".bvh", "'.xyz'")),
    ],
)
def test_bad_argument_is_one_clear_line(monkeypatch, capsys, arguments, words):
    code, out, err = run(monkeypatch, capsys, "walk", "--seconds", "1", *arguments)
    assert code == 1
    assert out == ""
    assert err.count("\n") == 1
    assert "Traceback" not in err
    for word in words:
        assert word in err


def test_negative_setting_names_its_range():
    with pytest.raises(FootIKError, match=r"step_height must be in \[0, 1\], not -0.1"):
        FootIKSettings(step_height=-0.1)


def test_model_without_legs_is_an_error():
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body name='ball'><freejoint/><geom size='.1'/></body>"
        "</worldbody></mujoco>"
    )
    with pytest.raises(FootIKError, match="ball"):
        find_rig_in_model(model)


def test_builtin_motion_moves_at_the_speed_asked_for():
    assert builtin_motion("walk", speed=0.8).speed == pytest.approx(0.8, abs=0.01)


def test_output_that_nobody_reads_ends_quietly():
    command = [sys.executable, "-c", "from footik_runtime.cli import main; main()"]
    process = subprocess.Popen(
        [*command, "walk", "--seconds", "1", "--terrain", "flat"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    errors = process.stderr.read().decode()
    process.wait()
    assert "Traceback" not in errors


def test_a_recording_too_long_for_memory_is_refused_at_once() -> None:
    scene = Scene.build(builtin_motion(), "flat", body=HUMANOID)
    with pytest.raises(FootIKError, match="at most 1000000 frames"):
        record_walk(scene, seconds=1e12)


def test_a_plot_of_an_unknown_kind_is_refused_before_the_walk() -> None:
    pytest.importorskip("matplotlib")
    require_plot(Path("run"))
    with pytest.raises(FootIKError, match="'xyz'; png, svg and pdf can"):
        require_plot(Path("run.xyz"))


@pytest.mark.parametrize("frame_time", ["0", "-1", "1e-9", "100", "1e300", "nan"])
@pytest.mark.parametrize("command", [("inspect",), ("walk", "--clip")])
def test_a_frame_time_that_no_motion_has_is_one_clear_line(
    monkeypatch, capsys, walk_bvh, tmp_path, command, frame_time
):
    text = re.sub(r"Frame Time: \S+", f"Frame Time: {frame_time}", walk_bvh.read_text())
    code, out, err = run(monkeypatch, capsys, *command, broken(text, tmp_path))
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert "frame time" in err


def test_a_walk_of_no_time_is_a_walk_of_two_frames(monkeypatch, capsys):
    code, out, err = run(monkeypatch, capsys, "walk", "--terrain", "flat", "--seconds", "1e-9")
    assert (code, err) == (0, "")
    assert "largest hip drop" in out


def test_names_that_a_terminal_cannot_show_are_escaped(walk_bvh, tmp_path):
    clip = tmp_path / "Fuß 歩く.bvh"
    clip.write_bytes(walk_bvh.read_bytes())
    done = subprocess.run(
        [sys.executable, "-c", "from footik_runtime.cli import main; main()", "inspect", clip],
        env=os.environ | {"PYTHONIOENCODING": "ascii"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Fu\\xdf \\u6b69\\u304f.bvh" in done.stdout
