"""`footik bake`: contacts are found in clips and baked into them as IK-weight curves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import tyro

from footik_runtime.clip import Clip
from footik_runtime.commands.files import (
    Job,
    Reading,
    ReadingOptions,
    fail_if_any,
    jobs,
    require_places,
    work_through,
    write_json,
)
from footik_runtime.commands.outputs import Outputs
from footik_runtime.errors import FootIKError, listed
from footik_runtime.offline.bake import bake as bake_clip
from footik_runtime.offline.bake import curve_names
from footik_runtime.offline.clean import clean
from footik_runtime.offline.curve_exports import require_export
from footik_runtime.offline.curve_files import curves_to_json
from footik_runtime.offline.curve_keys import CURVE_KEYS
from footik_runtime.offline.stages import BakeSettings, CleanSettings
from footik_runtime.rig import Rig


def bake(
    clips: tyro.conf.Positional[tuple[Path, ...]],
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="PATH")],
    preset: str = "default",
    ease_in: float = BakeSettings.ease_in,
    ease_out: float = BakeSettings.ease_out,
    replace: bool = False,
    redetect: bool = False,
    export: str | None = None,
    json_file: Annotated[Path | None, tyro.conf.arg(name="json", metavar="FILE")] = None,
    reading: ReadingOptions = Reading(),  # noqa: B008 - frozen
) -> None:
    """Find the contacts of clips and bake them into IK-weight curves; the motion stays as it is.

    Args:
        clips: motion files or folders: .bvh, .glb, .gltf, .npz (ours, AMASS or joint values), .csv.
        out: a file for one clip, a folder for several. Inputs are never changed.
        preset: default, or openkcc: OpenKCC's own baking.
        ease_in: s over which a weight rises, about the strike.
        ease_out: s over which it falls, about the release.
        replace: replace curves of these names that the clip has; without, that is an error.
        redetect: find contacts anew, whatever the clip's curves say.
        export: curves for an engine beside the result: unity, unity-meta, unreal or csv.
        json_file: write the keys of all curves to this file, for machines.
        reading: how files are read; with --animation all, every animation of a .glb or .gltf.
    """
    settings = BakeSettings(
        preset=preset,  # pyright: ignore[reportArgumentType]
        ease_in=ease_in,
        ease_out=ease_out,
        replace=replace,
    )
    if preset == "openkcc":
        _require_openkccs_own(settings, redetect)
    if export is not None:
        require_export(export)
    todo = jobs(clips, out)
    outputs = Outputs(todo, reading, export=export, json_file=json_file)
    require_places(out, json_file)

    def one(job: Job) -> dict[str, Any]:
        baked = [
            _bake_one(clip, reading.rig(clip), settings, redetect)
            for clip in reading.clips(job.source)
        ]
        exports = outputs.write(job, baked)
        for clip in baked:
            print(_told(job, clip, named=len(baked) > 1))
        told = zip(baked, exports, strict=True)
        return {"clips": [_as_json(clip, names) for clip, names in told]}

    entries = work_through("baking", todo, one)
    if json_file is not None:
        write_json(json_file, {"command": "bake", "preset": preset, "files": entries})
    fail_if_any(entries)


def _require_openkccs_own(settings: BakeSettings, redetect: bool) -> None:
    """Raise FootIKError for options that OpenKCC's baking knows nothing of."""
    asked = {
        "--ease-in": settings.ease_in != BakeSettings.ease_in,
        "--ease-out": settings.ease_out != BakeSettings.ease_out,
        "--redetect": redetect,
    }
    given = [name for name, is_given in asked.items() if is_given]
    if given:
        raise FootIKError(f"--preset openkcc takes no {listed(given)}: its baking is fixed.")


def _bake_one(clip: Clip, rig: Rig, settings: BakeSettings, redetect: bool) -> Clip:
    there = [name for name in curve_names(rig, settings) if name in clip.curves]
    if there and not settings.replace:  # else old curves would stand beside new ones
        raise FootIKError(
            f"{clip.name}: has the curves {listed(there)} already; --replace bakes new ones."
        )
    if settings.preset == "openkcc":
        return bake_clip(clip, None, rig, settings)
    how = CleanSettings(redetect=redetect)
    found = clean(clip, rig, settings=how)
    return bake_clip(clip, found.held, rig, settings)


def _told(job: Job, clip: Clip, *, named: bool) -> str:
    counts = [f"{name} {len(keys.times)} keys" for name, keys in clip.extras[CURVE_KEYS].items()]
    name = f"{clip.name}, " if named else ""
    return f"{job.source} -> {job.target}: {name}{', '.join(counts) or 'no curves'}"


def _as_json(clip: Clip, exports: list[str]) -> dict[str, Any]:
    return {
        "clip": clip.name,
        "frames": len(clip),
        "seconds": round(clip.duration, 3),
        "curves": curves_to_json(clip)["curves"],
        "exports": exports,
    }
