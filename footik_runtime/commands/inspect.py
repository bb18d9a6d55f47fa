"""`footik inspect`: what a clip holds, which rig was found in it, and what its feet do."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from footik_runtime.clip import Clip
from footik_runtime.commands.files import load, write_json
from footik_runtime.files import require_writable
from footik_runtime.motion import Motion
from footik_runtime.phases import Phase, phase_curve
from footik_runtime.rig import Rig, find_rig


def inspect(
    clip: Annotated[Path, tyro.conf.Positional],
    json_file: Annotated[Path | None, tyro.conf.arg(name="json", metavar="FILE")] = None,
) -> None:
    """Tell what a clip holds, which rig was found in it, and what its feet do.

    Args:
        clip: a motion file (.bvh).
        json_file: write the same to this file, for machines.
    """
    if json_file is not None:
        require_writable(json_file)
    loaded = load(clip)
    rig = find_rig(loaded.skeleton)
    motion = Motion.prepare(loaded, rig)
    facts = _clip_facts(loaded) | _motion_facts(motion)
    width = max(len(key) for key in facts)
    print(f"{clip}")
    for key, value in facts.items():
        print(f"  {key.ljust(width)}  {value}")
    for note in loaded.extras.get("notes", ()):
        print(f"  note: {note}")
    print(rig.describe())
    if json_file is not None:
        write_json(json_file, {"command": "inspect", "clip": str(clip), **facts, **_rig(rig)})


def _clip_facts(clip: Clip) -> dict[str, Any]:
    return {
        "frames": len(clip),
        "frames a second": round(clip.fps, 4),
        "seconds": round(clip.duration, 3),
        "joints": len(clip.skeleton),
        "curves": ", ".join(clip.curves) or "none",
    }


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
