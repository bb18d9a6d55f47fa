"""Outputs: where all that a command makes of its clips goes, told before the first is written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path

from footik_runtime.clip import Clip
from footik_runtime.commands.claims import Claims
from footik_runtime.commands.files import ALL, GLTF, Job, Reading
from footik_runtime.errors import FootIKError
from footik_runtime.files import is_device, unique_parts
from footik_runtime.formats import save_clip
from footik_runtime.formats.glb_container import Gltf, read_container
from footik_runtime.formats.gltf import names_in
from footik_runtime.formats.gltf_additions import copies, named_files
from footik_runtime.formats.gltf_write import write_gltf
from footik_runtime.offline.curve_exports import export_curves, export_files, require_curves
from footik_runtime.offline.curve_files import sidecar

_JOINT_VALUES = {".npz", ".csv"}  # with a model


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where what belongs to the clips of one file goes.

    Attributes:
        exports: what each clip's exports are named after.
        pages: of the report, each clip's own.
    """

    exports: tuple[Path, ...]
    pages: tuple[Path, ...]


@dataclass(frozen=True, kw_only=True)
class _Content:
    """What a file's results are called after, and the other files that it takes along.

    labels: tell its clips apart; an empty one where there is one clip alone. named: the files that
    it names. copies: those, and where they go.
    """

    labels: tuple[str, ...] = ("",)
    named: tuple[Path, ...] = ()
    copies: tuple[tuple[Path, Path], ...] = ()


class Outputs:
    """The outputs of a command that makes clips of clips: names are unique, and all are claimed.

    Raises FootIKError where an output would replace an input or another output.
    """

    def __init__(
        self,
        todo: Sequence[Job],
        reading: Reading,
        *,
        export: str | None = None,
        report: Path | None = None,
        json_file: Path | None = None,
    ) -> None:
        self.several = len(todo) > 1 or reading.animation == ALL
        self._export, self._report = export, report
        self._taken: set[tuple[Path, str]] = set()
        contents = [(job, _content(job, reading)) for job in todo]
        self._claims = Claims(_inputs(contents, reading))
        self._claim_results(contents, reading)
        for path, what in ((report, "--report"), (json_file, "--json")):
            if path is not None:
                self._claims.claim(path, what)
        self._places = {job: self._place(job, content.labels) for job, content in contents}

    def _claim_results(self, contents: Sequence[tuple[Job, _Content]], reading: Reading) -> None:
        for job, content in contents:
            self._claims.claim(job.target, f"the result of {job.source}")
            if _has_sidecar(job.target, reading, source=job.source):
                self._claims.claim(sidecar(job.target), f"the curves of {job.source}")
            for found, copied in content.copies:
                what = f"the copy of {found.resolve()}"
                self._claims.claim(copied, what, shared=True)

    def _place(self, job: Job, labels: Sequence[str]) -> Place:
        exports, pages = [], []
        for label in labels:
            ending = label and f".{label}"
            if self._export is not None:
                stem = self._free(job.target.parent, _called(job), ending)
                exports.append(stem.with_name(stem.name + job.target.suffix))
                self._claim_exports(job, export_files(exports[-1], (), self._export))
            if self._report is not None:
                pages.append(self._page(job, ending, self._report))
        return Place(exports=tuple(exports), pages=tuple(pages))

    def _claim_exports(self, job: Job, paths: Iterable[Path]) -> None:
        for path in paths:
            self._claims.claim(path, f"the exports of {job.source}")

    def _page(self, job: Job, ending: str, report: Path) -> Path:
        if not self.several or is_device(report):
            return report
        folder = job.target.parent.name
        called = [f"{report.stem}.{folder}_{name}" for name in _called(job)]
        called = [f"{report.stem}.{job.target.stem}", *called]
        page = self._free(report.parent, called, ending + (report.suffix or ".html"))
        self._claims.claim(page, f"the page of {job.source}")
        return page

    def _free(self, folder: Path, names: Sequence[str], ending: str) -> Path:
        """The first name that nothing here has, else the last with a number."""
        numbered = (f"{names[-1]}_{n}" for n in count(2))
        for name in chain(names, numbered):
            key = (folder.resolve(), (name + ending).casefold())
            if key not in self._taken:
                self._taken.add(key)
                return folder / (name + ending)
        raise AssertionError("numbers do not end")

    def pages(self, job: Job) -> tuple[Path, ...]:
        """Of a report: the page of each of the file's clips, or none."""
        return self._places[job].pages

    def write(self, job: Job, clips: Sequence[Clip]) -> list[list[str]]:
        """Write the clips that a file became. Returns the names of each one's exports."""
        kind, places = self._export, self._places[job].exports
        if kind is None:
            _save(clips, job.target)
            return [[] for _ in clips]
        for clip, place in zip(clips, places, strict=True):
            require_curves(clip)
            planned = export_files(place, (), kind)
            found = export_files(place, clip.curves, kind)  # curves are known only now
            self._claim_exports(job, [path for path in found if path not in planned])
        _save(clips, job.target)
        return [
            [path.name for path in export_curves(place, clip, kind)]
            for clip, place in zip(clips, places, strict=True)
        ]


def _content(job: Job, reading: Reading) -> _Content:
    """What a file holds, as far as names need it; a broken one's reading tells what is wrong."""
    if job.source.suffix.lower() not in GLTF:
        return _Content()
    try:
        document = read_container(job.source)
        return _Content(
            labels=_labels(names_in(document)) if reading.animation == ALL else ("",),
            named=tuple(path for _, _, path in named_files(document)),
            copies=tuple(_copies(document, job.target)),
        )
    except FootIKError:
        return _Content()


def _labels(names: Sequence[str]) -> tuple[str, ...]:
    """The names as parts of file names, each another; empty where there is one alone."""
    return tuple(unique_parts(names)) if len(names) > 1 else ("",)


def _copies(document: Gltf, target: Path) -> Iterator[tuple[Path, Path]]:
    suffix = target.suffix.lower()
    if suffix not in GLTF:
        return
    for found, copied in copies(document, target, as_glb=suffix == ".glb"):
        if not (copied.exists() and copied.samefile(found)):
            yield found, copied


def _inputs(contents: Sequence[tuple[Job, _Content]], reading: Reading) -> Iterator[Path]:
    """All files that are read, and the sidecars that would be if they were there."""
    if reading.model is not None:
        yield reading.model
    for job, content in contents:
        yield job.source
        yield from content.named
        if _has_sidecar(job.source, reading, source=job.source):
            yield sidecar(job.source)


def _has_sidecar(path: Path, reading: Reading, *, source: Path) -> bool:
    """Whether the curves of a clip that was read from `source` lie beside its file at `path`."""
    if path.suffix.lower() == ".bvh":
        return True
    values = {each.suffix.lower() for each in (path, source)}
    return reading.model is not None and values <= _JOINT_VALUES


def _called(job: Job) -> list[str]:
    """What a result is called in other names, and what where another has that name."""
    stem, kind = job.target.stem, job.target.suffix.lower().removeprefix(".")
    return [stem, f"{stem}_{kind}"]


def _save(clips: Sequence[Clip], path: Path) -> None:
    if len(clips) == 1:
        save_clip(clips[0], path)
    elif path.suffix.lower() in GLTF:
        write_gltf(clips, path)
    else:
        raise FootIKError(f"{path}: all animations of a file go to a .glb or .gltf.")
