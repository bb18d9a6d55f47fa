"""The one error root of the library, and the nearest-name hint its messages carry."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class FootIKError(Exception):
    """Bad input, said in one sentence: what was wrong, where, and what would be right."""


def listed(valid: Iterable[str], limit: int = 40) -> str:
    """The valid names as one comma-separated line, cut after `limit` names."""
    names = list(valid)
    shown = ", ".join(names[:limit])
    return f"{shown}, … ({len(names)} in all)" if len(names) > limit else shown


def unknown_name(kind: str, name: str, valid: Iterable[str]) -> FootIKError:
    """An error for a name that is not among `valid`: lists them and the nearest match."""
    names = list(valid)
    by_folded = {candidate.casefold(): candidate for candidate in names}
    nearest = difflib.get_close_matches(name.casefold(), list(by_folded), n=1, cutoff=0.5)
    hint = f" Did you mean {by_folded[nearest[0]]!r}?" if nearest else ""
    return FootIKError(f"unknown {kind} {name!r}.{hint} Valid: {listed(names)}.")
