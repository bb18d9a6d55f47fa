"""Broken files by the thousand: a reader may refuse one with FootIKError, and nothing else.

    python benchmarks/fuzz_formats.py [--count 1000] [--seconds 300] [--seed 0] [--keep FOLDER]

Whole files (of every kind, made here, and those of --folder) are mutated and read. A reader fails
a case where it raises anything but FootIKError, takes over a second of processor time, or more
memory than ten times the file and 16 MB. What was read is written back, as it is and moved, and
read again, under the same rules. The same seed makes the same files; failures are put into --keep.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import tempfile
import time
import tracemalloc
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import mujoco
import numpy as np
import tyro
from mutated_files import mutated

from footik_runtime.builtin import HUMANOID, builtin_motion
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.formats import (
    read_bvh,
    read_gltf,
    read_npz,
    read_qpos,
    write_bvh,
    write_gltf,
    write_npz,
    write_qpos,
)
from footik_runtime.formats.amass import read_amass
from footik_runtime.offline.curve_files import read_curves, write_curves

MOST_SECONDS = 1.0
HANGS_AFTER = 20  # s: the case is broken off
TIMES_THE_FILE, FLOOR = 10, 16 << 20
LARGEST_SEED = 700_000  # bytes of a file that is mutated

Reader = Callable[[Path], Clip]
Writer = Callable[[Clip, Path], Any]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What reading one file came to: how it ended, and what is wrong with that, if anything is."""

    ended: str
    wrong: str = ""


class HangError(BaseException):
    """A case took so long that it was broken off."""


@dataclass(frozen=True, kw_only=True)
class Format:
    """One kind of file: its suffix, what reads, writes and makes it."""

    suffix: str
    read: Reader
    write: Writer | None
    make: Writer


@dataclass(frozen=True, kw_only=True)
class Whole:
    """A whole file, and the name of its kind in `formats()`."""

    path: Path
    kind: str


def formats() -> dict[str, Format]:
    """All kinds of files that are read, by name."""
    model = mujoco.MjModel.from_xml_path(str(HUMANOID))

    def rows(path: Path) -> Clip:
        return read_qpos(path, model, fps=30.0)

    def write_rows(clip: Clip, path: Path) -> None:
        write_qpos(clip, path)

    def qpos_of(clip: Clip) -> np.ndarray:
        wave = np.sin(np.arange(len(clip))[:, None] / 7.0 + np.arange(model.nq))
        return model.qpos0 + 0.1 * wave

    def make_archive(clip: Clip, path: Path) -> None:
        np.savez(path, qpos=qpos_of(clip), qvel=np.zeros((len(clip), model.nv)), fps=30.0)

    def make_table(clip: Clip, path: Path) -> None:
        np.savetxt(path, qpos_of(clip), delimiter=",")

    def make_amass(clip: Clip, path: Path) -> None:
        poses = 0.1 * np.sin(np.arange(len(clip))[:, None] / 7.0 + np.arange(72))
        np.savez(path, poses=poses, trans=clip.root_positions, mocap_framerate=60.0)

    walk = _plain_walk()

    def curves(path: Path) -> Clip:
        return read_curves(path, walk)

    def made_curves(clip: Clip, path: Path) -> None:
        write_curves(path, clip)

    made: dict[str, tuple[str, Reader, Writer | None, Writer]] = {
        "bvh": (".bvh", read_bvh, write_bvh, write_bvh),
        "glb": (".glb", read_gltf, write_gltf, write_gltf),
        "gltf": (".gltf", read_gltf, write_gltf, write_gltf),
        "npz": (".npz", read_npz, write_npz, write_npz),
        "amass": (".npz", read_amass, None, make_amass),
        "qpos": (".npz", rows, write_rows, make_archive),
        "qpos table": (".csv", rows, write_rows, make_table),
        "curves": (".json", curves, made_curves, made_curves),
        "curve table": (".csv", curves, made_curves, made_curves),
    }
    return {
        kind: Format(suffix=suffix, read=read, write=write, make=make)
        for kind, (suffix, read, write, make) in made.items()
    }


def _plain_walk() -> Clip:
    """20 frames of the built-in walk with its curves, as nothing but a clip."""
    walk = builtin_motion("walk").clip.cut(0, 20)
    return replace(walk, extras={}, loop=False)


def seeds(folder: Path | None, made_in: Path) -> list[Whole]:
    """Whole files to mutate: the built-in walk in each kind, and those of a folder."""
    walk, found = _plain_walk(), []
    for kind, known in formats().items():
        path = made_in / f"{kind}{known.suffix}"
        known.make(walk, path)
        found.append(Whole(path=path, kind=kind))
    for path in sorted(folder.rglob("*")) if folder is not None else []:
        if path.is_file() and path.stat().st_size <= LARGEST_SEED:
            for kind, known in formats().items():
                with contextlib.suppress(FootIKError):  # a file of another kind
                    if path.suffix == known.suffix:
                        known.read(path)
                        found.append(Whole(path=path, kind=kind))
    return found


def judge(path: Path, reader: Reader, writer: Writer | None, size: int) -> Outcome:
    """Read a file of so many bytes (and write it, and read that) as the rules say."""
    ended, seconds, peak, wrong = _measured(lambda: _way(path, reader, writer))
    if wrong:
        return Outcome(ended=ended, wrong=wrong)
    most = TIMES_THE_FILE * size + FLOOR
    if peak > most:
        return Outcome(ended=ended, wrong=f"{peak / 1e6:.0f} MB of memory for {size} bytes")
    if seconds > MOST_SECONDS:
        # Watching memory is slow: the time counts without it.
        began = time.process_time()
        with contextlib.suppress(FootIKError):
            _way(path, reader, writer)
        seconds = time.process_time() - began
        if seconds > MOST_SECONDS:
            return Outcome(ended=ended, wrong=f"{seconds:.1f} s")
    return Outcome(ended=ended)


def _way(path: Path, reader: Reader, writer: Writer | None) -> None:
    clip = reader(path)
    if writer is not None:
        again = path.with_name("again" + path.suffix)
        for places in (clip.root_positions, clip.root_positions + 0.01):
            writer(replace(clip, root_positions=places), again)
            reader(again)


def _measured(run: Callable[[], None]) -> tuple[str, float, int, str]:
    """How a run ended, its processor seconds, its peak of memory in bytes, and what was wrong."""
    ended, wrong = "read", ""
    tracemalloc.start()
    began = time.process_time()
    try:
        with _alarm(HANGS_AFTER), warnings.catch_warnings():
            warnings.simplefilter("error")
            run()
    except FootIKError as error:
        ended = "refused"
        if not str(error).strip() or len(str(error)) > 5000:
            wrong = f"a message of {len(str(error))} letters"
    except HangError:
        ended, wrong = "hangs", f"no end after {HANGS_AFTER} s"
    except Exception as error:  # what must not be
        ended, wrong = "raised", f"{type(error).__name__}: {str(error)[:200]}"
    seconds = time.process_time() - began
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return ended, seconds, peak, wrong


@contextlib.contextmanager
def _alarm(seconds: int) -> Iterator[None]:
    """Break off what takes too long, where the system can do that."""
    if not hasattr(signal, "SIGALRM"):
        yield
        return

    def ring(*_: Any) -> None:
        raise HangError

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def fuzz(
    files: list[Whole],
    *,
    count: int,
    seed: int = 0,
    first: int = 0,
    seconds: float = float("inf"),
    keep: Path | None = None,
) -> tuple[Counter[str], list[str]]:
    """Mutate and read `count` files: how each ended, and a line for each failure."""
    ends: Counter[str] = Counter()
    failures: list[str] = []
    known = formats()
    whole = [(file, file.path.read_bytes()) for file in files]
    stop = time.monotonic() + seconds
    with tempfile.TemporaryDirectory() as folder:
        for file, _ in whole:  # compiles what is compiled at first use
            _way(file.path, known[file.kind].read, None)
        for case in range(first, first + count):
            if time.monotonic() > stop:
                break
            rng = np.random.default_rng([seed, case])
            file, data = whole[case % len(whole)]
            suffix = file.path.suffix
            data = mutated(data, suffix, rng)
            broken = Path(folder) / f"case{suffix}"
            broken.write_bytes(data)
            outcome = judge(broken, known[file.kind].read, known[file.kind].write, len(data))
            ends[f"{file.kind} {outcome.ended}"] += 1
            if outcome.wrong:
                failures.append(f"case {case} of seed {seed} ({file.path.name}): {outcome.wrong}")
                if keep is not None:
                    keep.mkdir(parents=True, exist_ok=True)
                    (keep / f"{seed}_{case}{suffix}").write_bytes(data)
    return ends, failures


def main(
    count: Annotated[int, tyro.conf.arg(help="how many broken files")] = 1000,
    seconds: Annotated[float, tyro.conf.arg(help="stop after so long")] = float("inf"),
    seed: Annotated[int, tyro.conf.arg(help="of the mutations")] = 0,
    first: Annotated[int, tyro.conf.arg(help="the case to begin with")] = 0,
    folder: Annotated[Path | None, tyro.conf.arg(help="more whole files")] = None,
    keep: Annotated[Path | None, tyro.conf.arg(help="where failures are put")] = None,
) -> None:
    """Read broken files until the count or the time is reached; exit 1 where a reader fails."""
    if folder is None and os.environ.get("FOOTIK_SHARED"):
        folder = Path(os.environ["FOOTIK_SHARED"]) / "data"
    with tempfile.TemporaryDirectory() as made_in:
        files = seeds(folder, Path(made_in))
        print("whole files:", ", ".join(file.path.name for file in files), flush=True)
        ends, failures = fuzz(
            files, count=count, seed=seed, first=first, seconds=seconds, keep=keep
        )
    for line in failures:
        print(line)
    for end, times in sorted(ends.items()):
        print(f"{times:8} {end}")
    print(f"{sum(ends.values())} files, {len(failures)} failures")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    tyro.cli(main)
