"""`footik walk`: a clip walks over a terrain; every measure is printed without IK and with it."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from footik_runtime.builtin import GAITS, builtin_body, builtin_motion
from footik_runtime.commands.claims import require_apart
from footik_runtime.commands.files import Reading, ReadingOptions, robot_model, write_json
from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.feet.record import GROUNDED
from footik_runtime.files import require_writable, write_whole
from footik_runtime.ground import ABOVE, REACH
from footik_runtime.hinge_character import HingeCharacter
from footik_runtime.hinge_values import hinge_motion
from footik_runtime.metrics import as_json, format_table, score
from footik_runtime.motion import Motion
from footik_runtime.offline.curve_files import sidecar
from footik_runtime.phases import Phase
from footik_runtime.progress import Progress
from footik_runtime.scene import Scene
from footik_runtime.settings import FootIKSettings, body_size
from footik_runtime.walk import Recording, record_walk

WITHOUT, WITH = "without IK", "with IK"


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
    reading: ReadingOptions = Reading(),  # noqa: B008 - frozen
) -> None:
    """Walk a clip over a terrain, headless, and print every measure without foot IK and with it.

    Args:
        clip: a motion file: .bvh, .glb, .gltf, .npz or .csv; a built-in character's own gait
            otherwise. Its contact curves are used where it has them. Joint values of a robot
            (--model) are walked by the robot's own joints, within their limits.
        gait: of the built-in humanoid: walk, run, idle or turn; of the built-in quadruped:
            "quadruped walk" or trot. Ignored with --clip.
        terrain: flat, slope, stairs, hills, rubble, stones, ledge, gap, platform or course.
        seconds: how long to walk.
        preset: settings: default or openkcc.
        fps: frames a second of the simulation; scored at 120 whatever it is.
        speed: m/s at which to walk; the clip's own otherwise.
        seed: of the terrain.
        out: write the run with IK to this file, as NumPy arrays.
        plot: draw heights, weights and hips to this file (needs the extra `plot`).
        json_file: write the table to this file, for machines.
        reading: how the clip's file is read.
    """
    require_apart(
        (clip, clip and sidecar(clip), reading.model),
        {"--out": out, "--plot": plot, "--json": json_file},
    )
    for path in (out, plot, json_file):
        if path is not None:
            require_writable(path)
    settings = FootIKSettings.preset(preset)
    if gait not in GAITS:
        raise unknown_name("gait", gait, GAITS)
    if plot is not None:
        from footik_runtime.plot import require_plot

        require_plot(plot)
    motion, body = _motion(clip, gait, speed if clip is None else None, reading)
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
        write_json(
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


def _motion(
    clip: Path | None, gait: str, speed: float | None, reading: Reading
) -> tuple[Motion, Path | None]:
    """The motion to walk, and the model file of its body where it has one."""
    if clip is None:
        return builtin_motion(gait, speed=speed), builtin_body(gait)
    loaded = reading.clip(clip)
    robot = robot_model(loaded, reading.model)
    if robot is not None:
        if reading.legs:
            raise FootIKError("--legs: a robot's are found in its model; leave it out.")
        return hinge_motion(loaded, robot), reading.model
    return Motion.prepare(loaded, reading.rig(loaded)), None


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
        if isinstance(scene.character, HingeCharacter):
            table[name] |= _missed(recording, ik=name == WITH)
    return table


def _missed(recording: Recording, *, ik: bool) -> dict[str, float]:
    """How far a robot's feet were off their goals; NaN where they had none."""
    feet = recording.feet
    standing = (recording.phases != Phase.SWING) & (feet["state"] == GROUNDED)
    missing, turned = 1e3 * feet["missing"], np.degrees(feet["turned_off"])
    found = {
        "goal missed, largest, mm": float(missing.max()),
        "goal missed on the ground, largest, mm": float(missing[standing].max(initial=0.0)),
        "foot turned off, largest, deg": float(turned.max()),
        "foot turned off on the ground, largest, deg": float(turned[standing].max(initial=0.0)),
    }
    return found if ik else dict.fromkeys(found, float("nan"))


def _heading(motion: Motion, terrain: str, seconds: float, fps: float, preset: str) -> str:
    return (
        f"{motion.clip.name} at {motion.speed:.2f} m/s over {terrain}, "
        f"{seconds:g} s at {fps:g} Hz, settings {preset}; scored at 120 Hz"
    )


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
    for name in (
        "state", "bump", "weight", "locked", "pin", "reached", "missing", "turned_off",
        "goal", "goal_turn",
    ):  # fmt: skip
        arrays[f"foot_{name}"] = feet[name]
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    write_whole(path, buffer.getvalue())
