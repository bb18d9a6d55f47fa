"""`footik clean`: footskate is taken out of clips, and contact curves are baked into them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import replace as replaced
from pathlib import Path
from typing import Annotated, Any

import tyro

from footik_runtime.clip import Clip
from footik_runtime.commands.files import (
    Job,
    Reading,
    ReadingOptions,
    announce,
    fail_if_any,
    jobs,
    require_places,
    work_through,
    write_json,
)
from footik_runtime.commands.outputs import Outputs
from footik_runtime.errors import FootIKError, listed
from footik_runtime.files import write_whole
from footik_runtime.formats.qpos import SOURCE as QPOS
from footik_runtime.formats.qpos_posed import posed, unreached
from footik_runtime.metrics import as_json, format_table
from footik_runtime.offline.bake import BAKE_NOTES, bake
from footik_runtime.offline.clean import clean as clean_clip
from footik_runtime.offline.curve_exports import require_export
from footik_runtime.offline.grounds import LevelGround, TerrainGround
from footik_runtime.offline.measure_clip import compare
from footik_runtime.offline.report import index_page, report_page
from footik_runtime.offline.stages import BakeSettings, Cleaned, CleanSettings, Ground
from footik_runtime.rig import Rig

_FARTHEST = 1e5  # m


def clean(
    clips: tyro.conf.Positional[tuple[Path, ...]],
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="PATH")],
    preset: str = "default",
    terrain: str | None = None,
    floor: float | None = None,
    stretch: float = 0.0,
    snap: bool = True,
    level: bool = False,
    redetect: bool = False,
    ease: float = CleanSettings.ease,
    leave_above: float = CleanSettings.leave_above,
    curves: bool = True,
    replace: bool = False,
    export: str | None = None,
    report: Annotated[Path | None, tyro.conf.arg(metavar="FILE.html")] = None,
    json_file: Annotated[Path | None, tyro.conf.arg(name="json", metavar="FILE")] = None,
    reading: ReadingOptions = Reading(),  # noqa: B008 - frozen
) -> None:
    """Take footskate out of clips, bake their contact curves, and measure both.

    Args:
        clips: motion files or folders: .bvh, .glb, .gltf, .npz (ours, AMASS or joint values), .csv.
        out: a file for one clip, a folder for several. Inputs are never changed.
        preset: default, or footplant: the FootPlant tool's own pass.
        terrain: the true ground: a terrain of `footik walk`, in the clip's frame.
        floor: the true ground: a level floor at this height, m.
        stretch: largest share of a leg's length that may be added against popping knees.
        snap: put soles onto the ground; without, each plant keeps its own height.
        level: write the clip with its floor's tilt taken out.
        redetect: find contacts anew, whatever the clip's curves say.
        ease: s over which an adjustment fades into a swing.
        leave_above: m, for a leg of 0.85 m; a contact that would move its foot farther is none.
        curves: bake the contact curves.
        replace: replace curves of these names that the clip has; without, those stay.
        export: curves for an engine beside the result: unity, unity-meta, unreal or csv.
        report: write a page with measures, contacts, plots and a figure to scrub; of several
            clips a table of all, whose pages go beside it.
        json_file: write what was found to this file, for machines.
        reading: how files are read; with --animation all, every animation of a .glb or .gltf.
    """
    settings = CleanSettings(
        preset=preset,  # pyright: ignore[reportArgumentType]
        stretch=stretch,
        snap=snap,
        level=level,
        redetect=redetect,
        ease=ease,
        leave_above=leave_above,
    )
    if preset == "footplant":
        _require_footplants_own(settings, terrain, floor)
    baking = BakeSettings(replace=replace) if curves else None
    ground = _ground(terrain, floor)
    if export is not None:
        require_export(export)
    todo = jobs(clips, out)
    outputs = Outputs(todo, reading, export=export, report=report, json_file=json_file)
    require_places(out, report, json_file)

    def one(job: Job) -> dict[str, Any]:
        found = [
            _clean_one(clip, reading.rig(clip), settings, baking, ground)
            for clip in reading.clips(job.source)
        ]
        for done in found:
            announce("writing", done.cleaned.clip)
        exports = outputs.write(job, [done.cleaned.clip for done in found])
        pages = _write_pages(outputs.pages(job), found)
        for done in found:
            print(_told(job, done, short=outputs.several))
        told = zip(found, pages, exports, strict=True)
        return {"clips": [_as_json(done, page, names) for done, page, names in told]}

    entries = work_through("cleaning", todo, one)
    if report is not None and outputs.several:
        write_whole(report, index_page(entries).encode(errors="replace"))
    if json_file is not None:
        write_json(json_file, {"command": "clean", "preset": preset, "files": entries})
    fail_if_any(entries)


def _require_footplants_own(
    settings: CleanSettings, terrain: str | None, floor: float | None
) -> None:
    """Raise FootIKError for options that the FootPlant tool's pass knows nothing of."""
    asked = {
        "--terrain": terrain is not None,
        "--floor": floor is not None,
        "--stretch": settings.stretch != CleanSettings.stretch,
        "--no-snap": not settings.snap,
        "--level": settings.level,
        "--redetect": settings.redetect,
        "--ease": settings.ease != CleanSettings.ease,
    }
    given = [name for name, is_given in asked.items() if is_given]
    if given:
        raise FootIKError(f"--preset footplant takes no {listed(given)}: its pass is fixed.")


def _ground(terrain: str | None, floor: float | None) -> Ground | None:
    if terrain is not None and floor is not None:
        raise FootIKError("give the true ground as a terrain or as a floor, not as both.")
    if terrain is not None:
        return TerrainGround(terrain)
    if floor is not None and abs(floor) > _FARTHEST:
        raise FootIKError(f"--floor: a floor lies within {_FARTHEST:g} m of 0, not at {floor:g}.")
    return None if floor is None else LevelGround(floor)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Done:
    """A clip, what became of it, and the measures of both."""

    before: Clip
    cleaned: Cleaned
    measures: dict[str, dict[str, float]]


def _clean_one(
    clip: Clip,
    rig: Rig,
    settings: CleanSettings,
    baking: BakeSettings | None,
    ground: Ground | None,
) -> _Done:
    announce("cleaning", clip)
    cleaned = clean_clip(clip, rig, settings=settings, ground=ground)
    if QPOS in clip.extras:
        cleaned = _on_joints(cleaned)
    announce("measuring", clip)
    measures = compare(clip, cleaned)
    if baking is not None:
        baked = bake(cleaned.clip, cleaned.held, cleaned.rig, baking)
        cleaned = replaced(cleaned, clip=baked)
    return _Done(before=clip, cleaned=cleaned, measures=measures)


def _on_joints(cleaned: Cleaned) -> Cleaned:
    """The result as the robot's joints can pose it, with what they do not reach in its notes."""
    clip = posed(cleaned.clip)
    notes = [*cleaned.report.get("notes", ()), *unreached(clip)]
    joints = clip.extras[QPOS].posed.report
    report = {**cleaned.report, "notes": notes, "joint values": joints}
    return replaced(cleaned, clip=clip, report=report)


def _write_pages(pages: Sequence[Path], found: Sequence[_Done]) -> list[str | None]:
    """Write each clip's page. Returns their names; None where no report is wanted."""
    if not pages:
        return [None] * len(found)
    for page, done in zip(pages, found, strict=True):
        write_whole(
            page, report_page(done.before, done.cleaned, done.measures).encode(errors="replace")
        )
    return [page.name for page in pages]


def _as_json(done: _Done, page: str | None, exports: list[str]) -> dict[str, Any]:
    clip = done.cleaned.clip
    return {
        "clip": clip.name,
        "frames": len(clip),
        "seconds": round(clip.duration, 3),
        "measures": {key: as_json(column) for key, column in done.measures.items()},
        "report": done.cleaned.report,
        "curve notes": list(clip.extras.get(BAKE_NOTES, ())),
        "page": page,
        "exports": exports,
    }


def _told(job: Job, done: _Done, *, short: bool) -> str:
    before, after = done.measures["before"], done.measures["after"]
    cleaned, key = done.cleaned, "pinned_point_speed"
    line = (
        f"{job.source} -> {job.target}: {cleaned.clip.name}, {len(cleaned.clip)} frames, "
        f"{len(cleaned.plants)} plants, pinned point {before[key]:.1f} -> {after[key]:.2f} mm/s"
    )
    told = [*cleaned.report.get("notes", ()), *cleaned.clip.extras.get(BAKE_NOTES, ())]
    notes = "".join(f"\n  note: {note}" for note in told)
    return line + notes if short else f"{line}{notes}\n{format_table(done.measures)}"
