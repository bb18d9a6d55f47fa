"""What Khronos' glTF validator says of files before and after `footik clean`.

    python benchmarks/validate_gltf.py [FILE.glb ...]

Cleans every animation of each file with its curves baked in (without files: a sliding walk
and those of FOOTIK_SHARED), and prints errors and warnings before and after; exits 1 where there
are new ones. The validator is fetched by npm into a temporary folder, unless FOOTIK_GLTF_VALIDATOR
names a folder that has it. Without node there is nothing to do, which is said.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import tyro

from footik_runtime import gait
from footik_runtime.builtin import humanoid_rig
from footik_runtime.commands.clean import clean
from footik_runtime.commands.files import ALL, Reading
from footik_runtime.errors import FootIKError
from footik_runtime.formats import save_clip
from footik_runtime.offline.skate import inject, true_walk

PACKAGE = "gltf-validator@2.0.0-dev.3.10"
LONGEST_FETCH = 120  # s

VALIDATE = """
const validator = require('gltf-validator'), fs = require('fs'), path = require('path');
const file = process.argv[1], folder = path.dirname(file);
validator.validateBytes(new Uint8Array(fs.readFileSync(file)), {
  maxIssues: 0,
  externalResourceFunction: (uri) =>
    Promise.resolve(new Uint8Array(fs.readFileSync(path.join(folder, decodeURIComponent(uri))))),
}).then((report) => console.log(JSON.stringify(report.issues)));
"""
SEVERITIES = ("errors", "warnings")


def validator(into: Path) -> tuple[Path | None, str]:
    """The folder that node finds the validator in, or None and why there is none."""
    if shutil.which("node") is None:
        return None, "node is not installed"
    given = os.environ.get("FOOTIK_GLTF_VALIDATOR")
    if given:
        return Path(given), ""
    if shutil.which("npm") is None:
        return None, "npm is not installed and FOOTIK_GLTF_VALIDATOR names no validator"
    command = ["npm", "install", "--silent", "--no-audit", "--no-fund", "--prefix", str(into)]
    try:
        done = subprocess.run(
            [*command, PACKAGE], capture_output=True, text=True, timeout=LONGEST_FETCH
        )
    except subprocess.TimeoutExpired:
        return None, f"npm did not install {PACKAGE} within {LONGEST_FETCH} s"
    if done.returncode:
        return None, f"npm could not install {PACKAGE}: {done.stderr.strip()[-200:]}"
    return into, ""


def issues(path: Path, folder: Path) -> Counter[tuple[int, str]]:
    """(severity, code) of the validator's errors (0) and warnings (1), and how often they come."""
    node = shutil.which("node")
    assert node is not None, "ask validator() first"
    done = subprocess.run(
        [node, "-e", VALIDATE, str(path)],
        env={**os.environ, "NODE_PATH": str(folder / "node_modules")},
        capture_output=True,
        text=True,
        check=True,
    )
    messages = json.loads(done.stdout)["messages"]
    return Counter((m["severity"], m["code"]) for m in messages if m["severity"] < 2)


def sliding_walk(folder: Path) -> Path:
    """A .glb of a walk whose feet slide."""
    rig = humanoid_rig()
    truth = true_walk(gait.walk(rig, speed=1.2), rig, cycles=2)
    save_clip(inject(truth, "constant", 0.06), folder / "sliding walk.glb")
    return folder / "sliding walk.glb"


def table(files: list[Path], folder: Path, made_in: Path) -> tuple[list[str], int]:
    """A line for each file, and the number of files with new errors or warnings."""
    lines, worse = [f"{'file':24} {'errors':>14} {'warnings':>14}   new"], 0
    for path in files:
        cleaned = made_in / f"cleaned {path.name}"
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                clean((path,), cleaned, reading=Reading(animation=ALL))
        except (FootIKError, SystemExit) as error:  # SystemExit: what is wrong was printed
            lines.append(f"{path.name:24} not cleaned {'' if str(error) == '1' else error}".strip())
            continue
        before, after = issues(path, folder), issues(cleaned, folder)
        new = after - before
        worse += bool(new)
        counts = [
            f"{sum(n for (s, _), n in found.items() if s == severity)}"
            for severity in range(len(SEVERITIES))
            for found in (before, after)
        ]
        words = ", ".join(sorted(code for _, code in new)) or "none"
        lines.append(
            f"{path.name:24} {counts[0] + ' -> ' + counts[1]:>14} "
            f"{counts[2] + ' -> ' + counts[3]:>14}   {words}"
        )
    return lines, worse


def main(files: tyro.conf.Positional[tuple[Path, ...]] = ()) -> None:
    """Clean glTF files and print what the validator says before and after."""
    with tempfile.TemporaryDirectory() as scratch:
        made_in = Path(scratch)
        folder, why = validator(made_in / "npm")
        if folder is None:
            print(f"glTF files are not validated: {why}.")
            return
        shared = Path(os.environ.get("FOOTIK_SHARED", "")) / "data" / "gltf"
        wanted = list(files) or [sliding_walk(made_in), *sorted(shared.glob("*.glb"))]
        lines, worse = table(wanted, folder, made_in)
    print("\n".join(lines))
    sys.exit(1 if worse else 0)


if __name__ == "__main__":
    tyro.cli(main)
