"""What cleaning a clip costs: microseconds a frame, room by room, on one core, and what files do.

    python benchmarks/offline.py [--clip FILE] [--frames 10000] [--rounds 7] [--json FILE]

Every room is timed in this one process, all of them by turns, again and again: the least and the
median are printed. README.md says what each line means.
"""

from __future__ import annotations

import gc
import json
import os
import platform
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from footik_runtime import quat_arrays
from footik_runtime.builtin import humanoid_rig
from footik_runtime.clip import Clip
from footik_runtime.compiled import announce_compilation
from footik_runtime.errors import FootIKError
from footik_runtime.files import require_writable, write_whole
from footik_runtime.formats import load_clip
from footik_runtime.formats.bvh import read_bvh, write_bvh
from footik_runtime.gait import walk
from footik_runtime.offline import detect, footing, plants, root, solve_legs, spread
from footik_runtime.offline.bake import bake
from footik_runtime.offline.clean import clean
from footik_runtime.offline.skate import inject, true_walk
from footik_runtime.offline.stages import CleanSettings
from footik_runtime.offline.working import working
from footik_runtime.rig import Rig, find_rig
from footik_runtime.skeleton import Skeleton

JOINTS = 31
SKATE = 0.03  # m
WHOLE, PUT_BACK, BAKE = "clean + bake", "put back, report", "bake curves"
FEW, MANY = 5, 50  # clips, after which memory is looked at
SHORT = 600  # frames of each of them

Samples = dict[str, list[float]]


def sliding_walk(frames: int) -> tuple[Clip, Rig]:
    """A walk of 31 joints whose feet slide while they stand."""
    rig = humanoid_rig()
    cycle = walk(rig)
    truth = true_walk(cycle, rig, cycles=-(-frames // (len(cycle) - 1)))
    return with_joints(inject(truth, "constant", SKATE).cut(0, frames), rig, JOINTS)


def with_joints(clip: Clip, rig: Rig, joints: int) -> tuple[Clip, Rig]:
    """The clip with more joints, on the last of its chain, that turn as hands and fingers do."""
    skeleton, more = clip.skeleton, joints - len(clip.skeleton)
    grown = Skeleton(
        names=(*skeleton.names, *(f"finger{i}" for i in range(more))),
        parents=np.concatenate([skeleton.parents, np.full(more, len(skeleton) - 1)]),
        offsets=np.concatenate([skeleton.offsets, np.full((more, 3), 0.02)]),
        rest_rotations=np.concatenate(
            [skeleton.rest_rotations, np.tile([1.0, 0.0, 0.0, 0.0], (more, 1))]
        ),
    )
    angle = 0.3 * np.sin(np.arange(len(clip))[:, None] * 0.1 + np.arange(more))
    fingers = quat_arrays.about([1.0, 0.0, 0.0], angle)
    grown_clip = replace(
        clip, skeleton=grown, rotations=np.concatenate([clip.rotations, fingers], axis=1)
    )
    return grown_clip, replace(rig, skeleton=grown)


def rooms(clip: Clip, rig: Rig) -> list[tuple[str, Callable[[], Any]]]:
    """Each room of cleanup, ready to be run again on the same input."""
    settings = CleanSettings()
    work = working(clip, rig, settings=settings)
    contacts = detect.of_clip(work, settings)
    found = plants.find(work, contacts, settings)
    posed = footing.poses(work, found, settings)
    paths = spread.spread(posed, work, found, settings)
    moves = root.place(work, paths, settings)
    return [
        ("see, tell contacts", lambda: working(clip, rig, settings=settings)),
        ("roll of contacts", lambda: detect.of_clip(work, settings)),
        ("plants", lambda: plants.find(work, contacts, settings)),
        ("footing", lambda: footing.poses(work, found, settings)),
        ("spread", lambda: spread.spread(posed, work, found, settings)),
        ("root", lambda: root.place(work, paths, settings)),
        ("legs", lambda: solve_legs.solve(work, paths, moves, settings)),
    ]


def timed(clip: Clip, rig: Rig, rounds: int) -> Samples:
    """Line -> microseconds a frame, one a round."""
    samples: Samples = defaultdict(list)
    cleaned = clean(clip, rig)
    parts = rooms(clip, rig)

    def both() -> None:
        done = clean(clip, rig)
        bake(done.clip, done.held, done.rig)

    for _ in range(rounds):
        spent = 0.0
        for line, run in parts:
            took = seconds_of(run)
            spent += took
            samples[line].append(took)
        samples[PUT_BACK].append(max(seconds_of(lambda: clean(clip, rig)) - spent, 0.0))
        curves = seconds_of(lambda: bake(cleaned.clip, cleaned.held, cleaned.rig))
        samples[BAKE].append(curves)
        samples[WHOLE].append(seconds_of(both))
    return {line: [1e6 * t / len(clip) for t in times] for line, times in samples.items()}


def seconds_of(run: Callable[[], Any]) -> float:
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def file_speeds(clip: Clip, rounds: int) -> Samples:
    """MB/s at which the clip is written as BVH and read again, one figure a round."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "clip.bvh"
        write_bvh(clip, path)
        size = path.stat().st_size / 1e6
        reads = [size / seconds_of(lambda: read_bvh(path)) for _ in range(rounds)]
        writes = [size / seconds_of(lambda: write_bvh(clip, path)) for _ in range(rounds)]
    return {"read BVH, MB/s": reads, "write BVH, MB/s": writes}


def memory_of_many(clip: Clip, rig: Rig) -> dict[int, float]:
    """Clips cleaned -> resident memory after them, MB."""
    held = {}
    for count in range(1, MANY + 1):
        done = clean(clip, rig)
        bake(done.clip, done.held, done.rig)
        del done
        if count in (FEW, MANY):
            gc.collect()
            held[count] = resident_mb()
    return held


def resident_mb() -> float:
    """Resident memory of this process, MB; NaN where the system does not tell."""
    status = Path("/proc/self/statm")
    if not status.is_file():
        return float("nan")
    return int(status.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def table(samples: Samples) -> str:
    """Least and median of every line."""
    width = max(len(line) for line in samples)
    rows = [f"{'':{width}}   least  median"]
    for line, values in samples.items():
        rows.append(f"{line:{width}}  {min(values):6.2f}  {np.median(values):6.2f}")
    return "\n".join(rows)


def main(
    clip: Path | None = None,
    frames: int = 10000,
    rounds: int = 7,
    json_file: Annotated[Path | None, tyro.conf.arg(name="json")] = None,
) -> None:
    """Time cleanup room by room, BVH files, and memory over many clips.

    Args:
        clip: a motion file; a walk of 31 joints with sliding feet is made otherwise.
        frames: of the walk that is made.
        rounds: how often everything is timed.
        json_file: write the figures to this file, for machines.
    """
    announce_compilation(lambda text: print(text, file=sys.stderr, flush=True))
    if frames < 100 or rounds < 1:
        raise FootIKError("the benchmark wants 100 frames and one round at least.")
    if json_file is not None:
        require_writable(json_file)
    if clip is None:
        motion, rig = sliding_walk(frames)
    else:
        motion = load_clip(clip)
        rig = find_rig(motion.skeleton)
    short = motion.cut(0, min(SHORT, len(motion)))
    samples = timed(motion, rig, rounds)
    files = file_speeds(motion, rounds)
    held = memory_of_many(short, rig)
    best, usual = min(samples[WHOLE]), float(np.median(samples[WHOLE]))
    print(f"{motion.name}: {len(motion)} frames, {len(motion.skeleton)} joints; one thread")
    print("\nmicroseconds a frame")
    print(table(samples))
    print(f"\nframes a second: {1e6 / best:,.0f} at best, {1e6 / usual:,.0f} usually\n")
    print(table(files))
    print(f"\nmemory after {FEW} clips {held[FEW]:.0f} MB, after {MANY} {held[MANY]:.0f} MB")
    if json_file is not None:
        told = {"samples": samples, "files": files, "memory_mb": held}
        told |= {"frames": len(motion), "joints": len(motion.skeleton)}
        told |= {"machine": platform.processor() or platform.machine(), "cores": os.cpu_count()}
        write_whole(json_file, (json.dumps(told, indent=2) + "\n").encode())


if __name__ == "__main__":
    try:
        tyro.cli(main)
    except FootIKError as error:
        sys.exit(f"offline.py: {error}")
