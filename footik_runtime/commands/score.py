"""`footik score`: what this library finds, beside others, against a known truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import tyro

from footik_runtime.commands.files import write_json
from footik_runtime.errors import FootIKError, unknown_name
from footik_runtime.files import require_writable
from footik_runtime.metrics import as_json
from footik_runtime.offline.clean_bench import (
    cleanup_table,
    files_as_cases,
    generated_cases,
    score_case,
)
from footik_runtime.offline.contact_bench import contact_table, read_trials, score_contacts
from footik_runtime.progress import Progress

SUITES = ("contacts", "cleanup")


def score(
    suite: tyro.conf.Positional[str],
    clips: tyro.conf.Positional[tuple[Path, ...]] = (),
    noise: float = 0.03,
    drift: float = 0.08,
    seeds: int = 5,
    json_file: Annotated[Path | None, tyro.conf.arg(name="json", metavar="FILE")] = None,
) -> None:
    """Score contacts or cleanup, and print one table.

    `contacts` scores the detector on recorded trials, beside simpler ones. `cleanup` cleans clips:
    generated walks and runs whose feet slide in a known way, and those that are given.

    Args:
        suite: contacts or cleanup.
        clips: for contacts a folder of trials, or one: .npz of heel, ankle and toe (T, F, 3),
            contact and known (T, F); for cleanup clips, or folders of them, if any.
        noise: m of white noise, for the rows with noise.
        drift: m of the root's drift, for the row with drift.
        seeds: of the noise, averaged.
        json_file: write the table to this file, for machines.
    """
    if suite not in SUITES:
        raise unknown_name("suite", suite, SUITES)
    if json_file is not None:
        require_writable(json_file)
    told = _contacts(clips, noise, drift, seeds) if suite == "contacts" else _cleanup(clips)
    if json_file is not None:
        write_json(json_file, {"command": "score", "suite": suite, **told})


def _contacts(folders: tuple[Path, ...], noise: float, drift: float, seeds: int) -> dict[str, Any]:
    if len(folders) != 1:
        raise FootIKError("score contacts wants one folder of trials.")
    scores = score_contacts(read_trials(folders[0]), noise=noise, drift=drift, seeds=seeds)
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
