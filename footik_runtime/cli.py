"""The command line: `footik walk`, `footik inspect`."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from footik_runtime.builtin import GAITS, HUMANOID, builtin_motion
from footik_runtime.clip import Clip
from footik_runtime.compiled import announce_compilation
from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.files import require_writable, write_whole
from footik_runtime.formats import load_clip
from footik_runtime.ground import ABOVE, REACH
from footik_runtime.metrics import as_json, format_table, score
from footik_runtime.motion import Motion
from footik_runtime.phases import Phase, phase_curve
from footik_runtime.progress import Progress
from footik_runtime.rig import Rig, find_rig
from footik_runtime.scene import Scene
from footik_runtime.settings import FootIKSettings, body_size
from footik_runtime.walk import Recording, record_walk

WITHOUT, WITH = "without IK", "with IK"
_FRAME_RATES = (1.0, 10000.0)


def walk(
    clip: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    gait: str = "walk",
    terrain: str = "hills",
    seconds: float = 10.0,
    preset: str = "default",
    fps: float = 60.0,
    speed: float | None = None,
    seed: int = 0,
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE.npz")] = None,
    plot: Annotated[Path | None, tyro.conf.arg(metavar="FILE.png")] = None,
    json_file: Annotated[Path | None, tyro.conf.arg(name="json", metavar="FILE")] = None,
) -> None:
    """Walk a clip over a terrain, headless, and print every measure without foot IK and with it.

    Args:
        clip: a motion file (.bvh); the built-in humanoid's own gait otherwise.
        gait: of the built-in humanoid: walk, run, idle or turn. Ignored with --clip.
        terrain: flat, slope, stairs, hills, rubble, stones, ledge, gap, platform or course.
        seconds: how long to walk.
        preset: settings: default or openkcc.
        fps: frames a second of the simulation; scored at 120 whatever it is.
        speed: m/s at which to walk; the clip's own otherwise.
        seed: of the terrain.
        out: write the run with IK to this file, as NumPy arrays.
        plot: draw heights, weights and hips to this file (needs the extra `plot`).
        json_file: write the table to this file, for machines.
    """
    for path in (out, plot, json_file):
        if path is not None:
            require_writable(path)
    settings = FootIKSettings.preset(preset)
    if gait not in GAITS:
        raise unknown_name("gait", gait, GAITS)
    if plot is not None:
        from footik_runtime.plot import require_plot

        require_plot(plot)
    motion, body = _motion(clip, gait, speed if clip is None else None)
    runs = {}
    for name, ik in ((WITHOUT, False), (WITH, True)):
        scene = Scene.build(motion, terrain, seed=seed, body=body)
        progress = Progress(f"walking {name}")
        runs[name] = record_walk(
            scene,
            seconds=seconds,
            fps=fps,
            settings=settings,
            ik=ik,
            speed=speed,
            each_frame=progress,
        )
        progress.close()
    table = _score(runs, scene, settings)
    print(_heading(motion, terrain, seconds, fps, preset))
    print(format_table(table))
    if json_file is not None:
        _write_json(
            json_file,
            {
                "command": "walk",
                "clip": str(clip) if clip else gait,
                "terrain": terrain,
                "seed": seed,
                "seconds": seconds,
                "fps": fps,
                "preset": preset,
                "measures": {name: as_json(column) for name, column in table.items()},
            },
        )
    if out is not None:
        _write_run(out, motion, runs[WITH])
    if plot is not None:
        from footik_runtime.plot import plot_walk

        plot_walk(plot, motion, runs[WITHOUT], runs[WITH])


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
    loaded = _load(clip)
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
        _write_json(json_file, {"command": "inspect", "clip": str(clip), **facts, **_rig(rig)})


def _motion(clip: Path | None, gait: str, speed: float | None) -> tuple[Motion, Path | None]:
    """The motion to walk, and the model file of its body where it has one."""
    if clip is None:
        return builtin_motion(gait, speed=speed), HUMANOID
    loaded = _load(clip)
    return Motion.prepare(loaded, find_rig(loaded.skeleton)), None


def _load(path: Path) -> Clip:
    """The clip of a file. Raises FootIKError for a frame rate that no motion has."""
    clip = load_clip(path)
    slowest, fastest = _FRAME_RATES
    if not slowest <= clip.fps <= fastest:
        raise FootIKError(
            f"{path}: a motion has {slowest:g} to {fastest:g} frames a second, not {clip.fps:g}: "
            "is its frame time in seconds?"
        )
    return clip


def _score(
    runs: Mapping[str, Recording], scene: Scene, settings: FootIKSettings
) -> dict[str, dict[str, float]]:
    ground, size = scene.ground(settings.groups), body_size(scene.motion.rig)

    def height(points: np.ndarray, _: np.ndarray) -> np.ndarray:
        return ground.height(points, above=ABOVE * size, reach=REACH * size)

    # Ground that moves is known only at the frames of the run; what stands is asked anew.
    asked = height if scene.terrain.static else None
    reference = runs[WITHOUT].run
    table = {n: score(r.run, reference, ground_height=asked) for n, r in runs.items()}
    for name, recording in runs.items():
        table[name]["largest hip drop, cm"] = 100.0 * float(recording.bodies["hip_drop"].max())
        contact = recording.phases != Phase.SWING
        held = recording.feet["locked"][contact].astype(bool)
        table[name]["contact held still, %"] = 100.0 * float(held.mean()) if contact.any() else 0.0
    return table


def _heading(motion: Motion, terrain: str, seconds: float, fps: float, preset: str) -> str:
    return (
        f"{motion.clip.name} at {motion.speed:.2f} m/s over {terrain}, "
        f"{seconds:g} s at {fps:g} Hz, settings {preset}; scored at 120 Hz"
    )


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


def _write_json(path: Path, value: Mapping[str, Any]) -> None:
    text = json.dumps(value, indent=2, allow_nan=False)
    write_whole(path, (text + "\n").encode())


def _write_run(path: Path, motion: Motion, recording: Recording) -> None:
    """The run as arrays: times, pose, feet and ground, with the names that belong to them."""
    feet = recording.feet
    arrays: dict[str, Any] = {
        "fps": recording.fps,
        "times": recording.times,
        "joint_names": np.array(motion.rig.skeleton.names),
        "leg_names": np.array([leg.name for leg in motion.rig.legs]),
        "root_positions": recording.roots,
        "rotations": recording.rotations,
        "hip_drop": recording.bodies["hip_drop"],
        "contact_phase": recording.phases,
        "sole_points": recording.run.sole,
        "ground_heights": recording.run.ground,
    }
    for name in ("state", "bump", "weight", "locked", "pin", "reached", "goal", "goal_turn"):
        arrays[f"foot_{name}"] = feet[name]
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    write_whole(path, buffer.getvalue())


def main() -> None:
    """The `footik` command."""
    announce_compilation(lambda text: print(f"footik: {text}", file=sys.stderr, flush=True))
    try:
        tyro.extras.subcommand_cli_from_dict(
            {"walk": walk, "inspect": inspect}, prog="footik", description=__doc__
        )
        sys.stdout.flush()
    except FootIKError as error:
        print(f"footik: {error}", file=sys.stderr)
        sys.exit(1)
    except BrokenPipeError:
        # Whoever read our output has enough (`footik walk | head`): end as quietly as others do.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(141)
    except KeyboardInterrupt:
        sys.exit(130)
