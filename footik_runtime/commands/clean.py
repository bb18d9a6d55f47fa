"""`footik clean`: footskate is taken out of clips, and contact curves are baked into them."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated, Any

import tyro

from footik_runtime.clip import Clip
from footik_runtime.commands.files import Job, fail_if_any, jobs, load, work_through, write_json
from footik_runtime.errors import FootIKError
from footik_runtime.files import require_writable, write_whole
from footik_runtime.formats import save_clip
from footik_runtime.formats.gltf import read_animations
from footik_runtime.formats.gltf_write import write_gltf
from footik_runtime.formats.qpos import SOURCE as QPOS
from footik_runtime.formats.qpos import rig_of
from footik_runtime.formats.qpos_posed import posed, unreached
from footik_runtime.metrics import as_json, format_table
from footik_runtime.offline.bake import BAKE_NOTES, bake
from footik_runtime.offline.clean import clean as clean_clip
from footik_runtime.offline.curve_exports import export_curves, require_export
from footik_runtime.offline.grounds import LevelGround, TerrainGround
from footik_runtime.offline.measure_clip import compare
from footik_runtime.offline.report import report_page
from footik_runtime.offline.stages import BakeSettings, Cleaned, CleanSettings, Ground
from footik_runtime.rig import find_rig

ALL = "all"


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
    ease: float = 0.15,
    curves: bool = True,
    replace: bool = False,
    animation: str | None = None,
    model: Annotated[Path | None, tyro.conf.arg(metavar="FILE.xml")] = None,
    fps: float | None = None,
    export: str | None = None,
    report: Annotated[Path | None, tyro.conf.arg(metavar="FILE.html")] = None,
    json_file: Annotated[Path | None, tyro.conf.arg(name="json", metavar="FILE")] = None,
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
        curves: bake the contact curves.
        replace: replace curves of these names that the clip has; without, those stay.
        animation: of a .glb or .gltf: its name, or all; the first otherwise.
        model: the MuJoCo model that joint values belong to.
        fps: frames a second, where a file does not tell.
        export: curves for an engine beside the result: unity, unity-meta, unreal or csv.
        report: write a page with measures, contacts, plots and a figure to scrub; a folder's
            pages go beside it, named after the clips.
        json_file: write what was found to this file, for machines.
    """
    settings = CleanSettings(
        preset=preset,  # pyright: ignore[reportArgumentType]
        stretch=stretch,
        snap=snap,
        level=level,
        redetect=redetect,
        ease=ease,
    )
    baking = BakeSettings(replace=replace) if curves else None
    ground = _ground(terrain, floor)
    if export is not None:
        require_export(export)
    todo = jobs(clips, out)
    for path in (report, json_file):
        if path is not None:
            require_writable(path)

    def one(job: Job) -> dict[str, Any]:
        found = [
            _clean_one(clip, settings, baking, ground)
            for clip in _read(job.source, animation, model, fps)
        ]
        _write(job.target, [cleaned.clip for _, cleaned, _ in found])
        tables = []
        for i, (before, cleaned, table) in enumerate(found):
            name = cleaned.clip.name
            if export is not None:
                stem = job.target if len(found) == 1 else job.target.with_name(f"{name}.x")
                export_curves(stem, cleaned.clip, export)
            if report is not None:
                page = _page_path(report, job, name, len(todo) * len(found))
                write_whole(page, report_page(before, cleaned, table).encode())
            print(_told(job, cleaned, table, short=len(todo) > 1 or len(found) > 1))
            tables.append(
                {
                    "clip": name,
                    "measures": {key: as_json(column) for key, column in table.items()},
                    "report": cleaned.report,
                    "curve notes": list(cleaned.clip.extras.get(BAKE_NOTES, ())),
                    "index": i,
                }
            )
        return {"clips": tables}

    entries = work_through("cleaning", todo, one)
    if json_file is not None:
        write_json(json_file, {"command": "clean", "preset": preset, "files": entries})
    fail_if_any(entries)


def _ground(terrain: str | None, floor: float | None) -> Ground | None:
    if terrain is not None and floor is not None:
        raise FootIKError("give the true ground as a terrain or as a floor, not as both.")
    if terrain is not None:
        return TerrainGround(terrain)
    return None if floor is None else LevelGround(floor)


def _read(path: Path, animation: str | None, model: Path | None, fps: float | None) -> list[Clip]:
    if animation == ALL and path.suffix.lower() in (".glb", ".gltf"):
        return list(read_animations(path, fps=fps))
    return [load(path, animation=animation, model=model, fps=fps)]


def _clean_one(
    clip: Clip, settings: CleanSettings, baking: BakeSettings | None, ground: Ground | None
) -> tuple[Clip, Cleaned, dict[str, dict[str, float]]]:
    rig = rig_of(clip) or find_rig(clip.skeleton)
    cleaned = clean_clip(clip, rig, settings=settings, ground=ground)
    if QPOS in clip.extras:
        cleaned = _on_joints(cleaned)
    table = compare(clip, cleaned)
    if baking is not None:
        baked = bake(cleaned.clip, cleaned.contacts, cleaned.rig, baking)
        cleaned = dataclasses.replace(cleaned, clip=baked)
    return clip, cleaned, table


def _on_joints(cleaned: Cleaned) -> Cleaned:
    """The result as the robot's joints can pose it, with what they do not reach in its notes."""
    clip = posed(cleaned.clip)
    notes = [*cleaned.report.get("notes", ()), *unreached(clip)]
    joints = clip.extras[QPOS].posed.report
    report = {**cleaned.report, "notes": notes, "joint values": joints}
    return dataclasses.replace(cleaned, clip=clip, report=report)


def _write(path: Path, clips: list[Clip]) -> None:
    if len(clips) > 1 and path.suffix.lower() not in (".glb", ".gltf"):
        raise FootIKError(f"{path}: all animations of a file go to a .glb or .gltf.")
    if len(clips) > 1:
        write_gltf(clips, path)
    else:
        save_clip(clips[0], path)


def _page_path(report: Path, job: Job, name: str, pages: int) -> Path:
    if pages == 1:
        return report
    return report.with_name(f"{report.stem}.{job.source.stem}.{name}{report.suffix or '.html'}")


def _told(job: Job, cleaned: Cleaned, table: dict[str, dict[str, float]], *, short: bool) -> str:
    before, after = table["before"], table["after"]
    key = "pinned_point_speed"
    line = (
        f"{job.source} -> {job.target}: {cleaned.clip.name}, {len(cleaned.clip)} frames, "
        f"{len(cleaned.plants)} plants, pinned point {before[key]:.1f} -> {after[key]:.2f} mm/s"
    )
    told = [*cleaned.report.get("notes", ()), *cleaned.clip.extras.get(BAKE_NOTES, ())]
    notes = "".join(f"\n  note: {note}" for note in told)
    return line + notes if short else f"{line}{notes}\n{format_table(table)}"
