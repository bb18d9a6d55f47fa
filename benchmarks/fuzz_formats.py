"""Broken files by the thousand: a reader may refuse one with FootIKError, and nothing else.

    python benchmarks/fuzz_formats.py [--count 1000] [--seconds 300] [--seed 0] [--keep FOLDER]

Whole files (made here, and those of --folder) are mutated and read. A reader fails a case where it
raises anything but FootIKError, takes over a second of processor time, or more memory than ten
times the file and 16 MB. What was read is written back and read again, under the same rules. The
same seed makes the same files; failures are put into --keep.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import signal
import sys
import tempfile
import time
import tracemalloc
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from mutated_files import mutated

from footik_runtime.builtin import builtin_motion
from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError

MOST_SECONDS = 1.0
HANGS_AFTER = 20  # s: the case is broken off
TIMES_THE_FILE, FLOOR = 10, 16 << 20
LARGEST_SEED = 700_000  # bytes of a file that is mutated
FORMATS = {".bvh": "bvh", ".glb": "gltf", ".npz": "npz"}

Reader = Callable[[Path], Clip]
Writer = Callable[[Clip, Path], None]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What reading one file came to: how it ended, and what is wrong with that, if anything is."""

    ended: str
    wrong: str = ""


class HangError(BaseException):
    """A case took so long that it was broken off."""


def formats() -> dict[str, tuple[Reader, Writer]]:
    """Suffix -> reader and writer of each format that there is."""
    found: dict[str, tuple[Reader, Writer]] = {}
    for suffix, name in FORMATS.items():
        with contextlib.suppress(ModuleNotFoundError):
            module = importlib.import_module(f"footik_runtime.formats.{name}")
            writer = "gltf_write" if name == "gltf" else name
            written = importlib.import_module(f"footik_runtime.formats.{writer}")
            write = getattr(written, f"write_{name}")
            found[suffix] = (getattr(module, f"read_{name}"), _clip_first(write))
    return found


def _clip_first(write: Callable[..., Any]) -> Writer:
    """A writer as (clip, path), whichever of them it takes first."""
    first = write.__code__.co_varnames[0]
    return (lambda clip, path: write(path, clip)) if first == "path" else write


def seeds(folder: Path | None, made_in: Path) -> list[Path]:
    """Whole files to mutate: the built-in walk in each format, and those of a folder."""
    walk = builtin_motion("walk").clip.cut(0, 20)
    plain = Clip(
        skeleton=walk.skeleton,
        fps=walk.fps,
        root_positions=walk.root_positions,
        rotations=walk.rotations,
        curves=walk.curves,
    )
    found = []
    for suffix, (_, write) in formats().items():
        write(plain, made_in / f"walk{suffix}")
        found.append(made_in / f"walk{suffix}")
    if folder is not None:
        for path in sorted(folder.rglob("*")):
            if path.suffix in formats() and path.stat().st_size <= LARGEST_SEED:
                with contextlib.suppress(FootIKError):  # a file of another layout
                    formats()[path.suffix][0](path)
                    found.append(path)
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
        writer(clip, again)
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
    files: list[Path],
    known: dict[str, tuple[Reader, Writer]],
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
    whole = [(path, path.read_bytes()) for path in files]
    stop = time.monotonic() + seconds
    with tempfile.TemporaryDirectory() as folder:
        for path, _ in whole:  # compiles what is compiled at first use
            _way(path, known[path.suffix][0], None)
        for case in range(first, first + count):
            if time.monotonic() > stop:
                break
            rng = np.random.default_rng([seed, case])
            path, data = whole[case % len(whole)]
            data = mutated(data, path.suffix, rng)
            broken = Path(folder) / f"case{path.suffix}"
            broken.write_bytes(data)
            reader, writer = known[path.suffix]
            outcome = judge(broken, reader, writer, len(data))
            ends[f"{path.suffix} {outcome.ended}"] += 1
            if outcome.wrong:
                failures.append(f"case {case} of seed {seed} ({path.name}): {outcome.wrong}")
                if keep is not None:
                    keep.mkdir(parents=True, exist_ok=True)
                    (keep / f"{seed}_{case}{path.suffix}").write_bytes(data)
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
        print("whole files:", ", ".join(path.name for path in files))
        ends, failures = fuzz(
            files, formats(), count=count, seed=seed, first=first, seconds=seconds, keep=keep
        )
    for line in failures:
        print(line)
    for end, times in sorted(ends.items()):
        print(f"{times:8} {end}")
    print(f"{sum(ends.values())} files, {len(failures)} failures")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    tyro.cli(main)
