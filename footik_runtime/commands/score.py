"""`footik score`: what this library finds, beside others, against a known truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from footik_runtime.commands.files import write_json
from footik_runtime.errors import unknown_name
from footik_runtime.files import require_writable
from footik_runtime.metrics import as_json
from footik_runtime.offline.contact_bench import contact_table, read_trials, score_contacts

SUITES = ("contacts",)


def score(
    suite: tyro.conf.Positional[str],
    folder: tyro.conf.Positional[Path],
    noise: float = 0.03,
    drift: float = 0.08,
    seeds: int = 5,
    json_file: Annotated[Path | None, tyro.conf.arg(name="json", metavar="FILE")] = None,
) -> None:
    """Score the contact detector on recorded trials, beside simpler ones, and print one table.

    Args:
        suite: contacts.
        folder: of trials, or one: .npz of heel, ankle and toe (T, F, 3), contact and known (T, F).
        noise: m of white noise, for the rows with noise.
        drift: m of the root's drift, for the row with drift.
        seeds: of the noise, averaged.
        json_file: write the table to this file, for machines.
    """
    if suite not in SUITES:
        raise unknown_name("suite", suite, SUITES)
    if json_file is not None:
        require_writable(json_file)
    scores = score_contacts(read_trials(folder), noise=noise, drift=drift, seeds=seeds)
    print(contact_table(scores))
    if json_file is not None:
        told = {
            label: {name: as_json(row) for name, row in rows.items()}
            for label, rows in scores.items()
        }
        write_json(json_file, {"command": "score", "suite": suite, "detectors": told})
