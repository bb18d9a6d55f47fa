"""Sphinx configuration; the pages in `generated/` are written from the code at every build."""

from __future__ import annotations

import inspect
import re
from dataclasses import fields
from pathlib import Path

from footik_runtime import FootIKSettings, __version__
from footik_runtime.metrics import MEASURES
from footik_runtime.settings import RANGES

project = "footik_runtime"
release = __version__
copyright = "the footik_runtime authors"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["build"]
html_theme = "sphinx_book_theme"
html_title = "footik_runtime"
autodoc_member_order = "bysource"
autodoc_typehints = "description"
nitpicky = False

_GENERATED = Path(__file__).parent / "generated"


def _settings_page() -> str:
    text = inspect.getdoc(FootIKSettings) or ""
    told = dict(re.findall(r"^    (\w+): (.*?)(?=^    \w+: |\Z)", text, re.M | re.S))
    rows = ["| setting | default | range | meaning |", "|---|---|---|---|"]
    for field in fields(FootIKSettings):
        low, high = RANGES.get(field.name, (None, None))
        limits = "" if low is None else f"{low:g} to {high:g}"
        meaning = " ".join(told[field.name].split())
        rows.append(f"| `{field.name}` | {field.default} | {limits} | {meaning} |")
    return "\n".join(
        [
            "# Settings",
            "",
            "`FootIKSettings` holds every number that can be tuned; it is frozen, and",
            "`settings.changed(name=value)` gives another. Lengths hold for a leg of 0.85 m and",
            "scale with the leg; times do not. `FootIKSettings.openkcc()` is the preset that",
            "behaves as OpenKCC does.",
            "",
            *rows,
            "",
        ]
    )


def _measures_page() -> str:
    rows = ["| measure | key | unit | what it is |", "|---|---|---|---|"]
    rows += [f"| {m.label} | `{m.key}` | {m.unit} | {m.explanation} |" for m in MEASURES]
    return "\n".join(
        [
            "# Measures",
            "",
            "`metrics.score(run, reference)` brings a run to 120 Hz and takes every measure below;",
            "the reference is the same walk without foot IK. Heights are over the terrain under",
            "each point, speeds in the frame of the body that a foot stands on.",
            "",
            *rows,
            "",
        ]
    )


_GENERATED.mkdir(exist_ok=True)
for _name, _page in (("settings", _settings_page()), ("measures", _measures_page())):
    _file = _GENERATED / f"{_name}.md"
    if not _file.exists() or _file.read_text() != _page:
        _file.write_text(_page)
