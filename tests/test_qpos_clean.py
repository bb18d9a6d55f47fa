"""`footik clean` and `bake` on joint values: feet of hinges stop sliding, within their limits.

Feet are measured by MuJoCo's own kinematics from the files that are written.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from qpos_robot import FPS, beyond_limits, robot_xml, save, sliding_walk, sole_speeds

from footik_runtime import cli
from footik_runtime.formats import load_clip
from footik_runtime.offline.curve_files import sidecar
from footik_runtime.phases import weight_curve

SHARED = Path(os.environ.get("FOOTIK_SHARED", Path(__file__).parents[1] / "../shared"))
G1 = SHARED / "data" / "mjcf" / "g1_collision_only.xml"
FEET = {
    "small": ("left_foot", "right_foot"),
    "g1": ("left_ankle_roll_link", "right_ankle_roll_link"),
}


@pytest.fixture(scope="module", params=["small", "g1"])
def robot_walk(request, tmp_path_factory):
    """The model's file, the names of its feet, rows of qpos that slide, and which foot stands."""
    path = G1
    if request.param == "small":
        path = tmp_path_factory.mktemp("robot") / "robot.xml"
        path.write_text(robot_xml())
    elif not path.is_file():
        pytest.skip("FOOTIK_SHARED holds no data/mjcf")
    model = mujoco.MjModel.from_xml_path(str(path))
    return path, FEET[request.param], *sliding_walk(model, FEET[request.param])


def footik(monkeypatch, capsys, *arguments) -> str:
    monkeypatch.setattr(sys, "argv", ["footik", *map(str, arguments)])
    cli.main()
    out, err = capsys.readouterr()
    # The first kernels of a fresh machine say that they are compiled.
    assert "".join(line for line in err.splitlines() if "compiling the kernels" not in line) == ""
    return out


def written(qpos, folder: Path, suffix: str) -> Path:
    path = folder / f"walk{suffix}"
    if suffix == ".npz":
        return save(path, qpos=qpos, fps=FPS)
    path.write_text("".join(",".join(map(repr, row.tolist())) + "\n" for row in qpos))
    return path


def rows_of(path: Path) -> np.ndarray:
    if path.suffix == ".csv":
        return np.loadtxt(path, delimiter=",")
    with np.load(path) as held:
        return held["qpos"]


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_a_robots_feet_stop_sliding(robot_walk, suffix, tmp_path, monkeypatch, capsys):
    xml, feet, qpos, standing = robot_walk
    model = mujoco.MjModel.from_xml_path(str(xml))
    source = written(qpos, tmp_path, suffix)
    before = source.read_bytes()
    out = tmp_path / f"clean{suffix}"
    footik(
        monkeypatch, capsys, "clean", source, "-o", out, "--model", xml, "--frame-rate", FPS,
        "--json", tmp_path / "found.json",
    )  # fmt: skip
    assert source.read_bytes() == before
    cleaned = rows_of(out)
    assert cleaned.shape == qpos.shape
    assert beyond_limits(model, qpos) <= 0.0
    assert beyond_limits(model, cleaned) <= 1e-12
    slid, slides = (sole_speeds(model, rows, feet, standing).mean() for rows in (qpos, cleaned))
    print(f"{xml.stem} {suffix}: soles at {1e3 * slid:.2f} -> {1e3 * slides:.6f} mm/s")
    assert slid > 0.09
    assert slides < 0.01 * slid
    legs = [j for j in range(model.njnt) if any(w in model.joint(j).name for w in LEG_WORDS)]
    others = sorted(set(range(7, model.nq)) - set(model.jnt_qposadr[legs].tolist()))
    np.testing.assert_array_equal(cleaned[:, others], qpos[:, others])
    told = json.loads((tmp_path / "found.json").read_text())["files"][0]["clips"][0]
    assert told["report"]["joint values"]["unreached_frames"] == 0
    assert told["measures"]["after"]["pinned_point_speed"] < 5.0


LEG_WORDS = ("hip", "knee", "ankle")


@pytest.mark.parametrize("command", ["clean", "bake"])
@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_a_robots_curves_lie_beside_its_joint_values(
    robot_walk, command, suffix, tmp_path, monkeypatch, capsys
):
    xml, _, qpos, standing = robot_walk
    source = written(qpos, tmp_path, suffix)
    out = tmp_path / f"out{suffix}"
    footik(monkeypatch, capsys, command, source, "-o", out, "--model", xml, "--frame-rate", FPS)
    if command == "bake":
        assert out.read_bytes() == source.read_bytes()
    assert sidecar(out).is_file()
    clip = load_clip(out, model=xml, fps=FPS)
    for foot, side in enumerate(("left", "right")):
        down = clip.curves[weight_curve(side)] >= 0.5
        assert np.mean(down == standing[:, foot]) > 0.8


def test_goals_beyond_the_limits_are_told_and_not_faked(robot_walk, tmp_path, monkeypatch, capsys):
    xml, feet, qpos, standing = robot_walk
    spec = mujoco.MjSpec.from_file(str(xml))
    free = spec.compile()
    for joint in spec.joints:
        if any(word in joint.name for word in LEG_WORDS):
            # Only what the sliding walk itself needs.
            values = qpos[:, free.joint(joint.name).qposadr[0]]
            joint.range = [values.min() - 1e-3, values.max() + 1e-3]
            joint.limited = True
    narrow = tmp_path / "narrow.xml"
    spec.compile()
    narrow.write_text(spec.to_xml())
    model = mujoco.MjModel.from_xml_path(str(narrow))
    source = written(qpos, tmp_path, ".npz")
    out = footik(
        monkeypatch, capsys, "clean", source, "-o", tmp_path / "out.npz", "--model", narrow,
        "--json", tmp_path / "found.json",
    )  # fmt: skip
    assert "foot is up to" in out
    assert "its joints' limits reach no further" in out
    cleaned = rows_of(tmp_path / "out.npz")
    assert beyond_limits(model, cleaned) <= 1e-12
    told = json.loads((tmp_path / "found.json").read_text())["files"][0]["clips"][0]
    joints = told["report"]["joint values"]
    assert joints["unreached_frames"] > 0
    # The measures are of the file, not of the pose that was asked for.
    slides = sole_speeds(model, cleaned, feet, standing).mean()
    print(f"{xml.stem}: {joints}; soles at {1e3 * slides:.2f} mm/s")
    assert slides > 1e-4
    measured = told["measures"]["after"]["pinned_point_speed"]
    assert measured > 0.5 * 1e3 * slides
