"""`footik inspect`: what a clip holds, which rig was found in it, and what its feet do."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from footik_runtime.clip import Clip
from footik_runtime.commands.claims import require_apart
from footik_runtime.commands.files import Reading, ReadingOptions, write_json
from footik_runtime.files import require_writable
from footik_runtime.formats import animation_names
from footik_runtime.motion import Motion
from footik_runtime.offline.clean import clean
from footik_runtime.offline.curve_files import sidecar
from footik_runtime.offline.curve_keys import CURVE_KEYS
from footik_runtime.offline.filters import runs
from footik_runtime.offline.stages import Cleaned
from footik_runtime.phases import Phase, phase_curve
from footik_runtime.rig import Rig

_FEWEST_FRAMES = 3  # of a motion
_SHOWN = 8  # contacts of a foot, and names in a line


def inspect(
    clip: Annotated[Path, tyro.conf.Positional],
    json_file: Annotated[Path | None, tyro.conf.arg(name="json", metavar="FILE")] = None,
    reading: ReadingOptions = Reading(),  # noqa: B008 - frozen
) -> None:
    """Tell what a clip holds, which rig was found in it, and what its feet do.

    Args:
        clip: a motion file: .bvh, .glb, .gltf, .npz (ours, AMASS or joint values) or .csv.
        json_file: write the same, and every contact, to this file, for machines.
        reading: how files are read.
    """
    require_apart((clip, reading.model, sidecar(clip)), {"--json": json_file})
    if json_file is not None:
        require_writable(json_file)
    loaded = reading.clip(clip)
    rig = reading.rig(loaded)
    cleaned = clean(loaded, rig)
    contacts = _contacts(cleaned)
    facts = _clip_facts(loaded, clip) | _contact_facts(cleaned, contacts)
    if len(loaded) >= _FEWEST_FRAMES:
        facts |= _motion_facts(Motion.prepare(loaded, rig))
    notes = [*loaded.extras.get("notes", ()), *cleaned.report["notes"]]
    width = max(len(key) for key in facts)
    print(f"{clip}")
    for key, value in facts.items():
        print(f"  {key.ljust(width)}  {value}")
    for note in notes:
        print(f"  note: {note}")
    print(rig.describe())
    if json_file is not None:
        told = {"command": "inspect", "clip": str(clip), **facts, "contacts": contacts}
        write_json(json_file, {**told, "notes": notes, **_rig(rig)})


def _clip_facts(clip: Clip, path: Path) -> dict[str, Any]:
    facts: dict[str, Any] = {
        "frames": len(clip),
        "frames a second": round(clip.fps, 4),
        "seconds": round(clip.duration, 3),
        "joints": len(clip.skeleton),
        "curves": _shortened([_curve(clip, name) for name in clip.curves]),
    }
    if path.suffix.lower() in (".glb", ".gltf"):
        names = animation_names(path)
        facts["animations"] = f"{len(names)}: {_shortened(names)}"
        facts["this one"] = clip.name
    return facts


def _curve(clip: Clip, name: str) -> str:
    keys = clip.extras.get(CURVE_KEYS, {}).get(name)
    return name if keys is None else f"{name} ({len(keys.times)} keys)"


def _shortened(names: list[str]) -> str:
    if not names:
        return "none"
    more = len(names) - _SHOWN
    return ", ".join(names[:_SHOWN]) + (f" and {more} more" if more > 0 else "")


def _contacts(cleaned: Cleaned) -> dict[str, list[list[float]]]:
    """Leg -> [start, end] of each contact, s."""
    fps = cleaned.contacts.fps
    return {
        leg.name: [
            [round(start / fps, 3), round((stop - 1) / fps, 3)]
            for start, stop in runs(cleaned.contacts.foot[:, i])
        ]
        for i, leg in enumerate(cleaned.rig.legs)
    }


def _contact_facts(
    cleaned: Cleaned, contacts: dict[str, list[list[float]]]
) -> dict[str, str | float]:
    facts: dict[str, str | float] = {
        "noise, mm": round(cleaned.report["contacts"]["noise_mm"], 2),
    }
    for name, spans in contacts.items():
        share = cleaned.report["contacts"]["share"][name]
        times = _shortened([f"{start:.2f}-{end:.2f}" for start, end in spans])
        facts[f"{name} contacts, s"] = f"{len(spans)}, {100 * share:.0f} % of the time: {times}"
    return facts


def _motion_facts(motion: Motion) -> dict[str, Any]:
    facts: dict[str, Any] = {
        "cycle, s": round(motion.clip.duration, 3),
        "seam before closing, cm": round(100.0 * motion.seam, 2),
        "speed, m/s": round(motion.speed, 3),
        "turn rate, deg/s": round(float(np.degrees(motion.yaw_rate)), 2),
    }
    for leg in motion.rig.legs:
        phases = motion.clip.curves[phase_curve(leg.name)][:-1].round().astype(int)
        shares = [f"{p.name.lower()} {100 * np.mean(phases == p):.0f} %" for p in Phase]
        facts[f"{leg.name} foot"] = ", ".join(shares)
    return facts


def _rig(rig: Rig) -> dict[str, Any]:
    names = rig.skeleton.names
    legs = {
        leg.name: {
            part: names[getattr(leg, part)] if getattr(leg, part) >= 0 else None
            for part in ("hip", "knee", "ankle", "toe")
        }
        for leg in rig.legs
    }
    return {"hips": names[rig.hips], "legs": legs, "rig notes": list(rig.notes)}
