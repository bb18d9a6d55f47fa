"""Files of the commands: clips read, results written, and whole folders worked through."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import mujoco
import tyro

from footik_runtime.clip import Clip
from footik_runtime.errors import FootIKError
from footik_runtime.files import make_folder, require_writable, write_whole
from footik_runtime.formats import SUFFIXES, load_clip
from footik_runtime.formats.gltf import read_animations
from footik_runtime.formats.qpos import read_model, rig_of
from footik_runtime.hinge_character import has_hinges
from footik_runtime.offline.curve_exports import is_export
from footik_runtime.progress import Progress
from footik_runtime.rig import Rig, find_rig

ALL = "all"
GLTF = (".glb", ".gltf")
_LARGE, _LONG = 30.0, 20_000  # MB, frames
_FRAME_RATES = (1.0, 10000.0)
_FILE_SUFFIX = re.compile(r"\.[A-Za-z]\w{2,3}")  # .fbx or .json, but not that of "takes.v2"


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How files are read, and whose legs they hold.

    Attributes:
        animation: of a .glb or .gltf: its name; the first otherwise.
        model: the MuJoCo model that joint values belong to.
        frame_rate: of files that do not tell, frames a second.
        legs: the legs, where their names tell of none: left=HIP,KNEE,ANKLE,TOE right=... (a toe may
            be left out).
    """

    animation: str | None = None
    model: Annotated[Path | None, tyro.conf.arg(metavar="FILE.xml")] = None
    frame_rate: float | None = None
    legs: Annotated[tuple[str, ...], tyro.conf.arg(metavar="LEG=JOINTS ...")] = ()

    def __post_init__(self) -> None:
        if self.frame_rate is not None:
            _require_rate("--frame-rate", self.frame_rate)

    def clip(self, path: Path) -> Clip:
        """The clip of a file. Raises FootIKError for a rate that no motion has."""
        _announce(path)
        return _with_rate(
            path, load_clip(path, animation=self.animation, model=self.model, fps=self.frame_rate)
        )

    def clips(self, path: Path) -> list[Clip]:
        """That clip, or with `--animation all` every one of a .glb or .gltf."""
        if self.animation == ALL and path.suffix.lower() in GLTF:
            return [_with_rate(path, clip) for clip in read_animations(path, fps=self.frame_rate)]
        return [self.clip(path)]

    def rig(self, clip: Clip) -> Rig:
        """The legs that were named; else a robot's, by its model, or those found in the skeleton.

        Raises FootIKError for a leg that is no NAME=HIP,KNEE,ANKLE or names a missing joint.
        """
        if self.legs:
            return find_rig(clip.skeleton, legs=_legs(self.legs))
        return rig_of(clip) or find_rig(clip.skeleton)


def robot_model(clip: Clip, file: Path | None) -> mujoco.MjModel | None:
    """The model of a clip of joint values, from its file, where it has hinges; None otherwise."""
    rig = rig_of(clip)
    if file is None or rig is None:
        return None
    model = read_model(file)
    return model if has_hinges(model, rig) else None


ReadingOptions = tyro.conf.OmitArgPrefixes[Reading]
"""Of a command that reads clips."""


def _announce(path: Path) -> None:
    """Say that a file is read, where that takes a while."""
    megabytes = path.stat().st_size / 1e6 if path.is_file() else 0.0
    if megabytes > _LARGE:
        print(f"footik: reading {path} ({megabytes:.0f} MB)", file=sys.stderr, flush=True)


def announce(what: str, clip: Clip) -> None:
    """Say what is done with a clip, where that takes a while."""
    if len(clip) > _LONG:
        print(f"footik: {what} {clip.name} ({len(clip)} frames)", file=sys.stderr, flush=True)


def _legs(texts: Sequence[str]) -> dict[str, list[str]]:
    legs: dict[str, list[str]] = {}
    for name, chain in map(_leg, texts):
        if name in legs:
            raise FootIKError(f"--legs: {name!r} is there twice.")
        taken = [joint for other in legs.values() for joint in other]
        twice = next((joint for joint in chain if (taken + chain).count(joint) > 1), None)
        if twice is not None:
            raise FootIKError(f"--legs: joint {twice!r} is there twice; each leg has its own.")
        legs[name] = chain
    return legs


def _leg(text: str) -> tuple[str, list[str]]:
    name, _, joints = text.partition("=")
    chain = [joint.strip() for joint in joints.split(",") if joint.strip()]
    if not name.strip() or len(chain) not in (3, 4):
        raise FootIKError(
            f"--legs {text}: a leg is NAME=HIP,KNEE,ANKLE or NAME=HIP,KNEE,ANKLE,TOE."
        )
    return name.strip(), chain


def _with_rate(path: Path, clip: Clip) -> Clip:
    _require_rate(str(path), clip.fps, " is its frame time in seconds?")
    return clip


def _require_rate(where: str, rate: float, hint: str = "") -> None:
    slowest, fastest = _FRAME_RATES
    if not slowest <= rate <= fastest:  # so written, NaN is none
        end = f":{hint}" if hint else "."
        raise FootIKError(
            f"{where}: a motion has {slowest:g} to {fastest:g} frames a second, not {rate:g}{end}"
        )


def write_json(path: Path, value: Mapping[str, Any]) -> None:
    """Write what a command found, for machines."""
    text = json.dumps(value, indent=2, allow_nan=False)
    write_whole(path, (text + "\n").encode())


@dataclass(frozen=True, kw_only=True)
class Job:
    """A clip's file, and where its result goes."""

    source: Path
    target: Path


def jobs(sources: Sequence[Path], out: Path) -> list[Job]:
    """What is to be done: one file to a file or into a folder, or whole folders, mirrored in `out`.

    Raises FootIKError where a source is missing or nothing is found.
    """
    several = len(sources) != 1 or sources[0].is_dir()
    into_folder = several or out.is_dir() or out.suffix.lower() not in SUFFIXES
    if into_folder:
        _require_folder(out, several)
    found = [
        Job(source=file, target=out / place if into_folder else out)
        for source in sources
        for file, place in _files(source, out)
    ]
    if not found:
        raise FootIKError(
            f"{', '.join(map(str, sources))}: there are no clips ({', '.join(SUFFIXES)}) there."
        )
    return found


def _require_folder(out: Path, several: bool) -> None:
    """Raise FootIKError where results shall go to what looks like a file, or is one."""
    if out.is_dir():
        return
    if several and out.suffix.lower() in SUFFIXES:
        raise FootIKError(f"{out}: several clips need a folder to go to.")
    if out.exists():
        raise FootIKError(f"{out}: is no folder that results can go to.")
    if _FILE_SUFFIX.fullmatch(out.suffix):
        raise FootIKError(
            f"{out}: clips are written as {', '.join(SUFFIXES)}, not {out.suffix!r}; if that is "
            "to be a folder, make it first."
        )


def _files(source: Path, out: Path) -> Iterable[tuple[Path, Path]]:
    """Clips under a source, and where each belongs under the output's folder.

    What is in that folder, and curves that were exported, are results of an earlier run.
    """
    if source.is_file():
        yield source, Path(source.name)
    elif source.is_dir():
        files = [f for f in sorted(source.rglob("*")) if f.suffix.lower() in SUFFIXES]
        files = [f for f in files if f.is_file() and not is_export(f)]
        results = _within(out, files) if source.resolve() in out.resolve().parents else set()
        if results:
            told = f"{len(results)} clips in {out}, where results go, are taken for earlier ones"
            print(f"footik: {told}", file=sys.stderr, flush=True)
        yield from ((file, file.relative_to(source)) for file in files if file not in results)
    else:
        raise FootIKError(f"{source}: there is no such file or folder.")


def _within(folder: Path, files: Iterable[Path]) -> set[Path]:
    place = folder.resolve()
    return {file for file in files if place in file.resolve().parents}


def require_places(out: Path, *files: Path | None) -> None:
    """Find out that files can be written, and make the results' folder for those in it."""
    for path in files:
        if path is not None:
            if path.parent == out and not out.exists():
                make_folder(out)
            require_writable(path)


def work_through(
    what: str, todo: Sequence[Job], work: Callable[[Job], dict[str, Any]]
) -> list[dict[str, Any]]:
    """Do every job in turn, with progress; what fails is told at once and the rest goes on.

    Returns an entry a file: "in", "out", "error" (None where all went well) and what `work` found.
    """
    progress, entries = Progress(what), []
    for done, job in enumerate(todo):
        progress(done, len(todo))
        entry: dict[str, Any] = {"in": str(job.source), "out": str(job.target), "error": None}
        try:
            make_folder(job.target.parent)
            require_writable(job.target)
            entry |= work(job)
        except BrokenPipeError:
            raise  # whoever read our output has enough: that is no fault of the file
        except Exception as error:
            if len(todo) == 1 and not isinstance(error, (FootIKError, OSError)):
                raise  # a fault of ours, whose traceback is worth more than a line
            entry["error"] = _reason(error, job)
            progress.close()
            print(f"footik: {entry['error']}", file=sys.stderr)
        entries.append(entry)
    progress.close()
    return entries


def _reason(error: Exception, job: Job) -> str:
    """What went wrong in one line that names the file."""
    if isinstance(error, FootIKError):
        return str(error)
    what = " ".join(str(error).split())
    return f"{job.source}: failed with {type(error).__name__}: {what}"


def fail_if_any(entries: Sequence[Mapping[str, Any]]) -> None:
    """End with exit status 1 where a file failed: each was told of already."""
    failed = sum(entry["error"] is not None for entry in entries)
    if len(entries) > 1:
        print(f"{len(entries) - failed} done, {failed} failed")
    if failed:
        sys.exit(1)
