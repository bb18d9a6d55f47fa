"""`footik score`: what this library does, measured beside others, in one table."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import tyro

from footik_runtime.commands.claims import require_apart
from footik_runtime.commands.files import robot_model, write_json
from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.files import make_folder, require_writable
from footik_runtime.formats import SUFFIXES
from footik_runtime.hinge_values import hinge_motion
from footik_runtime.metrics import as_json
from footik_runtime.motion import Motion
from footik_runtime.offline.clean_bench import (
    Case,
    cleanup_table,
    files_as_cases,
    generated_cases,
    score_case,
)
from footik_runtime.offline.contact_bench import contact_table, read_trials, score_contacts
from footik_runtime.offline.curve_files import sidecar
from footik_runtime.plot import plot_suite, require_plot
from footik_runtime.progress import Progress
from footik_runtime.score_strips import write_strip
from footik_runtime.score_suite import (
    SceneScore,
    chosen_scenes,
    score_scene,
    suite_json,
    suite_summary,
    suite_table,
)

PLACEMENT, CONTACTS, CLEANUP = SUITES = ("placement", "contacts", "cleanup")
ALL_RATES, QUICK = (60.0, 30.0, 144.0, 240.0), (60.0,)


def score(
    suite: tyro.conf.Positional[str] = PLACEMENT,
    trials: tyro.conf.Positional[Path | None] = None,
    clips: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="PATH ...")] = (),
    scenes: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")] = (),
    quick: bool = False,
    model: Annotated[Path | None, tyro.conf.arg(metavar="FILE.xml")] = None,
    noise: float = 0.03,
    drift: float = 0.08,
    seeds: int = 5,
    plot: Annotated[Path | None, tyro.conf.arg(metavar="FILE.png")] = None,
    pictures: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None,
    json_file: Annotated[Path | None, tyro.conf.arg(name="json", metavar="FILE")] = None,
) -> None:
    """Score foot placement, contacts or cleanup, and print one table.

    `placement` walks 60 scenes without foot IK, with OpenKCC's settings and with ours, and ours
    at 30, 60, 144 and 240 Hz. `contacts` scores the detector on recorded trials, beside simpler
    ones. `cleanup` cleans clips: generated walks and runs whose feet slide in a known way, and
    those that are given.

    Args:
        suite: placement, contacts or cleanup.
        trials: for contacts: a folder of trials, or one: .npz of heel, ankle and toe (T, F, 3),
            contact and known (T, F).
        clips: for placement and cleanup: motion files, or folders of them. Placement walks them
            wherever the built-in walk goes straight on.
        scenes: for placement: those whose names begin so; all otherwise.
        quick: for placement: at 60 Hz alone.
        model: for placement: the MuJoCo model of a robot, where the clips are its joint values;
            its own joints walk them, within their limits.
        noise: for contacts: m of white noise, for the rows with noise.
        drift: for contacts: m of the root's drift, for the row with drift.
        seeds: for contacts: of the noise, averaged.
        plot: for placement: draw every figure to this file (needs the extra `plot`).
        pictures: for placement: render a strip of every scene's feet close up into this folder,
            without foot IK above and with it below, instead of scoring (needs the extra `plot`,
            and a GL: MUJOCO_GL=egl without a display).
        json_file: write the table to this file, for machines.
    """
    if suite not in SUITES:
        raise unknown_name("suite", suite, SUITES)
    if suite != CONTACTS and trials is not None:
        raise FootIKError(f"score {suite} takes no trials; clips are given with --clips.")
    if suite != PLACEMENT and model is not None:
        raise FootIKError(f"score {suite} takes no model: only placement walks robots.")
    if pictures is not None and (suite != PLACEMENT or clips or plot is not None):
        raise FootIKError(
            "--pictures renders the scenes of score placement, with nothing else: leave out other "
            "suites, --clips and --plot."
        )
    read = [file for place in (*clips, trials) for file in _files_at(place)]
    require_apart(read, {"--plot": plot, "--json": json_file})
    for path in (plot, json_file):
        if path is not None:
            require_writable(path)
    if plot is not None:
        require_plot(plot)
    if suite == CONTACTS:
        told = _contacts(trials, noise, drift, seeds)
    elif suite == CLEANUP:
        told = _cleanup(clips)
    elif pictures is not None:
        told = _pictures(scenes, pictures)
    else:
        told = _placement(scenes, clips, model, QUICK if quick else ALL_RATES, plot)
    if json_file is not None:
        write_json(json_file, {"command": "score", "suite": suite, **told})


def _files_at(place: Path | None) -> Iterator[Path]:
    """The clips or trials of a file or folder, with the curves beside them."""
    if place is None:
        return
    for file in place.rglob("*") if place.is_dir() else [place]:
        if file.suffix.lower() in SUFFIXES:
            yield from (file, sidecar(file))


def _contacts(trials: Path | None, noise: float, drift: float, seeds: int) -> dict[str, Any]:
    if trials is None:
        raise FootIKError("score contacts wants a folder of trials.")
    scores = score_contacts(read_trials(trials), noise=noise, drift=drift, seeds=seeds)
    print(contact_table(scores))
    return {
        "detectors": {
            label: {name: as_json(row) for name, row in rows.items()}
            for label, rows in scores.items()
        }
    }


def _cleanup(clips: tuple[Path, ...]) -> dict[str, Any]:
    cases = [*files_as_cases(clips), *generated_cases()]
    progress = Progress("cleaning")
    rows = {}
    for done, case in enumerate(cases):
        progress(done, len(cases))
        rows[case.name] = score_case(case)
    progress.close()
    print(cleanup_table(rows))
    return {"clips": {name: as_json(row) for name, row in rows.items()}}


def _pictures(names: tuple[str, ...], folder: Path) -> dict[str, Any]:
    scenes = chosen_scenes(names)
    make_folder(folder)
    progress, written = Progress("rendering"), {}
    for done, scene in enumerate(scenes):
        progress(done, len(scenes))
        written[scene.name] = str(write_strip(folder, scene))
    progress.close()
    print(f"{len(written)} strips in {folder}")
    return {"pictures": written}


def _placement(
    names: tuple[str, ...],
    clips: tuple[Path, ...],
    model: Path | None,
    rates: tuple[float, ...],
    plot: Path | None,
) -> dict[str, Any]:
    scenes = chosen_scenes(names)
    work: list[tuple[str, Case | None]] = [(scene.name, None) for scene in scenes]
    for case in files_as_cases(clips, model):
        work += [(scene.name, case) for scene in scenes if scene.takes_clips]
    progress, scores = Progress("walking"), []
    for done, one in enumerate(_each_score(work, rates, model)):
        scores.append(one)
        progress(done + 1, len(work))
    progress.close()
    print(suite_table(scores))
    print(suite_summary(scores))
    if plot is not None:
        plot_suite(plot, scores)
    return {"scenes": suite_json(scores)}


def _each_score(
    work: list[tuple[str, Case | None]], rates: tuple[float, ...], model: Path | None
) -> Iterator[SceneScore]:
    """The scores in order, walked by as many processes as there are cores."""
    one = partial(_score_one, rates=rates, model=model)
    # The first alone: it compiles what the others then find on the disk.
    yield one(work[0])
    if len(work) == 1:
        return
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        yield from pool.map(one, work[1:])


def _score_one(
    what: tuple[str, Case | None], *, rates: tuple[float, ...], model: Path | None
) -> SceneScore:
    name, case = what
    scene = next(scene for scene in chosen_scenes((name,)) if scene.name == name)
    if case is None:
        return score_scene(scene, rates=rates)
    robot = robot_model(case.clip, model)
    if robot is None:
        motion, body = Motion.prepare(case.clip, case.rig), None
    else:
        motion, body = hinge_motion(case.clip, robot), model
    return score_scene(scene, rates=rates, motion=motion, clip=case.name, body=body)
