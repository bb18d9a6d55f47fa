"""What a frame costs: microseconds per character, room by room, beside two baselines.

    python benchmarks/step.py [--clip FILE] [--terrain hills] [--quick] [--json FILE]

Every figure is taken in this one process, ours and the baselines by turns, again and again, from
the same state: the least and the median are printed. README.md says what each line means.
"""

from __future__ import annotations

import json
import os
import platform
import time
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import mujoco
import numpy as np
import tyro
from mink_legs import MinkLegs, mink
from timed_rooms import ROOMS, TimedCrowd, write_rows

from footik_runtime.builtin import HUMANOID, builtin_motion
from footik_runtime.compiled import announce_compilation, jit_enabled
from footik_runtime.crowd import Crowd
from footik_runtime.errors import FootIKError
from footik_runtime.files import require_writable, write_whole
from footik_runtime.formats import load_clip
from footik_runtime.ground import SceneGround
from footik_runtime.humanoid import HumanoidFootIK
from footik_runtime.motion import Motion
from footik_runtime.probes import HIT
from footik_runtime.rig import find_rig
from footik_runtime.scene import Scene

DT = 1.0 / 60.0
FRAME, WRITTEN, CONTROLLER = "whole frame", "frame + write", "HumanoidFootIK.step"
BARE, RAY, RAYS, MINK = "bare rays", "one bare ray", "rays a character", "mink legs"
WARM_UP = 45  # frames until feet have been planted and released
MINK_FRAMES = 24

Samples = dict[str, list[float]]


class Case:
    """One number of characters on one number of threads, measured over and over.

    Attributes:
        count, threads: as given.
        samples: line -> microseconds per character and frame, one a round.
    """

    def __init__(self, scene: Scene, count: int, threads: int, frames: int, seed: int) -> None:
        self.count, self.threads, self._frames = count, threads, frames
        self.samples: Samples = defaultdict(list)
        self._scene, self._ground = scene, scene.ground()
        self._crowd = scattered_crowd(scene, self._ground, count, threads, seed)
        for _ in range(WARM_UP):
            self._crowd.step(DT)
        self._start = [a.copy() for a in (self._crowd.bodies, self._crowd.feet)]
        self._timed = TimedCrowd(self._crowd, scene, keep=max(count * frames * 20, 1000))
        self._pool = ThreadPoolExecutor(threads)
        self._timed.run(1, DT)
        self._rewind()

    def _rewind(self) -> None:
        self._crowd.bodies[:], self._crowd.feet[:] = self._start

    def _add(self, line: str, seconds: float) -> None:
        self.samples[line].append(seconds * 1e6 / (self.count * self._frames))

    def measure(self) -> None:
        """One round: the whole frame, its rooms, and its rays alone, from the same state."""
        self._rewind()
        self._add(FRAME, seconds_of(self._step_all))
        self._rewind()
        self._add(WRITTEN, seconds_of(self._step_and_write_all))
        self._rewind()
        self._timed.clear()
        self._timed.run(self._frames, DT)
        for room, seconds in zip(ROOMS, self._timed.seconds, strict=True):
            self._add(room, float(seconds))
        self._measure_rays()

    def _step_all(self) -> None:
        for _ in range(self._frames):
            self._crowd.step(DT)

    def _step_and_write_all(self) -> None:
        crowd, character, qpos = self._crowd, self._scene.character, self._timed.qpos
        for _ in range(self._frames):
            crowd.step(DT)
            write_rows(qpos, character.qpos_address, crowd.roots, crowd.rotations, character.rest)

    def _measure_rays(self) -> None:
        probes = self._timed.rays
        hits = np.zeros(len(probes), HIT)
        parts = list(zip(*(np.array_split(a, self.threads) for a in (probes, hits)), strict=True))

        def cast_all() -> None:
            for job in [self._pool.submit(self._ground.cast, *part) for part in parts]:
                job.result()

        rays = self._timed.cast / (self.count * self._frames)
        seconds = seconds_of(cast_all) / max(len(probes), 1)
        self.samples[RAY].append(seconds * 1e6)
        self.samples[BARE].append(seconds * 1e6 * rays)
        self.samples[RAYS].append(rays)


class MinkCase:
    """Legs solved by mink, on one thread."""

    def __init__(self, scene: Scene, builtin: bool, seed: int) -> None:
        crowd = scattered_crowd(scene, scene.ground(), MINK_FRAMES, 1, seed)
        for _ in range(WARM_UP):
            crowd.step(DT)
        self._legs = MinkLegs(crowd, builtin, MINK_FRAMES)
        self.samples: Samples = defaultdict(list)
        self.solved = self._legs.solve()

    def measure(self) -> None:
        """One round."""
        seconds = seconds_of(self._legs.solve)
        self.samples[MINK].append(seconds * 1e6 / self._legs.frames)


class ControllerCase:
    """`HumanoidFootIK.step`: a character with its qpos, qvel and kinematics."""

    def __init__(self, scene: Scene, frames: int) -> None:
        self._ik, self._frames = HumanoidFootIK(scene), frames
        self.samples: Samples = defaultdict(list)

    def measure(self) -> None:
        """One round, from the start of the terrain."""
        self._ik.place(np.asarray(self._ik.scene.terrain.start_w))
        for _ in range(WARM_UP):
            self._ik.step(DT)
        self.samples[CONTROLLER].append(seconds_of(self._step_all) * 1e6 / self._frames)

    def _step_all(self) -> None:
        for _ in range(self._frames):
            self._ik.step(DT)


def seconds_of(work: Callable[[], Any]) -> float:
    """Seconds that it takes once."""
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


def scattered_crowd(
    scene: Scene, ground: SceneGround, count: int, threads: int, seed: int
) -> Crowd:
    """A crowd all over the terrain, facing +x, each somewhere else in the cycle."""
    rng = np.random.default_rng(seed)
    first, last, _, _ = scene.terrain.extent
    crowd = Crowd(scene.motion, ground, count=count, threads=threads)
    # Room to walk before the terrain ends.
    at = rng.uniform((first + 6.0, -3.0, 0.0), (last - 10.0, 3.0, 0.0), (count, 3))
    height = ground.height(at)
    at[:, 2] = np.where(np.isfinite(height), height, 0.0)
    crowd.place(at)
    crowd.bodies["time"] = rng.uniform(0.0, scene.motion.clip.duration, count)
    return crowd


def table_of(cases: list[Case], mink_case: MinkCase | None, controller: ControllerCase) -> list:
    """One row a case: its lines' least and median, and what mink takes of it."""
    rows = []
    for case in cases:
        row: dict[str, Any] = {"characters": case.count, "threads": case.threads}
        lines = dict(case.samples)
        lines["sum of rooms"] = list(np.sum([lines[room] for room in ROOMS], axis=0))
        if case.count == 1:
            lines |= controller.samples
        if mink_case is not None and case.threads == 1:
            lines |= mink_case.samples
        row["us"] = {
            name: {"min": float(np.min(v)), "median": float(np.median(v))}
            for name, v in lines.items()
        }
        if MINK in lines:
            row["mink / ours"] = {
                name: float(np.median(lines[MINK]) / np.median(lines[name]))
                for name in ("legs", FRAME)
            }
        rows.append(row)
    return rows


def print_table(rows: list) -> None:
    """Lines down, cases across, min and median."""
    names = [*ROOMS, "sum of rooms", FRAME, WRITTEN, CONTROLLER, RAYS, RAY, BARE, MINK]
    names = [name for name in names if any(name in row["us"] for row in rows)]
    width = max(len(name) for name in names) + 2
    heads = [f"{row['characters']:,} on {row['threads']}" for row in rows]
    print("us per character and frame: min, median")
    print(" " * width + "".join(f"{head:>19}" for head in heads))
    for name in names:
        cells = [row["us"].get(name) for row in rows]
        texts = [f"{cell['min']:9.2f} {cell['median']:9.2f}" if cell else "" for cell in cells]
        print(name.ljust(width) + "".join(f"{text:>19}" for text in texts).rstrip())
    for name in ("legs", FRAME):
        cells = [row.get("mink / ours", {}).get(name) for row in rows]
        texts = [f"{cell:.0f} x" if cell else "" for cell in cells]
        if any(texts):
            label = f"mink / {'frame' if name == FRAME else name}"
            print(label.ljust(width) + "".join(f"{text:>19}" for text in texts).rstrip())


def main(
    clip: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    terrain: str = "hills",
    threads: int = os.cpu_count() or 1,
    rounds: int = 15,
    seed: int = 0,
    quick: bool = False,
    json_file: Annotated[Path | None, tyro.conf.arg(name="json", metavar="FILE")] = None,
) -> None:
    """Time a frame of 1, 100 and 10,000 characters, on one thread and on all.

    Args:
        clip: a motion file (.bvh); the built-in walk otherwise.
        terrain: by name, as of `footik walk`.
        threads: what "all" means.
        rounds: how often each is measured; medians are taken over these.
        seed: of where characters stand.
        quick: three rounds, and a tenth of the crowd.
        json_file: write the table to this file, for machines.
    """
    if json_file is not None:
        require_writable(json_file)
    if not jit_enabled():
        raise FootIKError("kernels are off (NUMBA_DISABLE_JIT): there is nothing to time.")
    announce_compilation(print)
    if clip is None:
        motion, body = builtin_motion(), HUMANOID
    else:
        loaded = load_clip(clip)
        motion, body = Motion.prepare(loaded, find_rig(loaded.skeleton)), None
    scene = Scene.build(motion, terrain, body=body)
    cycle = max(round(motion.clip.duration / DT), 1)
    counts = {1: cycle, 100: 20, 1000: 2} if quick else {1: cycle, 100: 20, 10000: 2}
    rounds = 3 if quick else rounds
    cases = [
        Case(scene, count, of, frames, seed)
        for count, frames in counts.items()
        for of in ([1] if count == 1 or threads == 1 else [1, threads])
    ]
    controller = ControllerCase(Scene.build(motion, terrain, body=body), cycle)
    mink_case = MinkCase(scene, body is not None, seed) if mink is not None else None
    for _ in range(rounds):
        for case in (*cases, controller, *([mink_case] if mink_case else [])):
            case.measure()
    rows = table_of(cases, mink_case, controller)
    print(f"{clip or 'built-in walk'} on {terrain}, 60 Hz, {rounds} rounds")
    print_table(rows)
    facts: dict[str, Any] = {"benchmark": "step", "clip": str(clip) if clip else "walk"}
    facts |= {"terrain": terrain, "seed": seed, "rounds": rounds, "rows": rows}
    facts |= {"machine": platform.machine(), "cpus": os.cpu_count(), "mujoco": mujoco.__version__}
    if mink_case is None:
        print("mink: skipped, it is not installed (pip install 'footik-runtime[bench]')")
    else:
        solved = mink_case.solved
        print(
            f"mink {version('mink')}: {solved.rounds:.1f} rounds a frame, "
            f"{solved.missed:.0%} of the frames further off than 1 mm"
        )
        facts["mink"] = {"version": version("mink"), "rounds": solved.rounds}
        facts["mink"]["missed"] = solved.missed
    if json_file is not None:
        write_whole(json_file, (json.dumps(facts, indent=1) + "\n").encode())


if __name__ == "__main__":
    try:
        tyro.cli(main)
    except FootIKError as error:
        raise SystemExit(f"step.py: {error}") from None
