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
    work_through,
    write_json,
)
from footik_runtime.commands.outputs import Outputs
from footik_runtime.errors import FootIKError, listed
from footik_runtime.files import require_writable
from footik_runtime.offline.bake import bake as bake_clip
from footik_runtime.offline.bake import curve_names
from footik_runtime.offline.clean import clean
from footik_runtime.offline.curve_exports import require_export
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
        json_file: write the keys to this file, for machines.
        reading: how files are read.
    """
    settings = BakeSettings(
        preset=preset,  # pyright: ignore[reportArgumentType]
        ease_in=ease_in,
        ease_out=ease_out,
        replace=replace,
    )
    if export is not None:
        require_export(export)
    todo = jobs(clips, out)
    outputs = Outputs(todo, reading, export=export, json_file=json_file)
    if json_file is not None:
        require_writable(json_file)

    def one(job: Job) -> dict[str, Any]:
        clip = reading.clip(job.source)
        baked = _bake_one(clip, reading.rig(clip), settings, redetect)
        outputs.write(job, [baked])
        keys = baked.extras["curve_keys"]
        counts = {name: len(keys[name].times) for name in keys}
        told = ", ".join(f"{name} {count} keys" for name, count in counts.items())
        print(f"{job.source} -> {job.target}: {told or 'no curves'}")
        return {"clip": clip.name, "keys": counts}

    entries = work_through("baking", todo, one)
    if json_file is not None:
        write_json(json_file, {"command": "bake", "preset": preset, "files": entries})
    fail_if_any(entries)


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
