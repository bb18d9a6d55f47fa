"""Directives that write tables from the code while the documentation is built.

settings-table: every field of FootIKSettings. measures-table: every row of MEASURES.
names-table: every public name. command-help COMMAND: what `footik COMMAND --help` prints.
"""

# ruff: noqa: D102 - what directives override is documented by Sphinx

from __future__ import annotations

import contextlib
import inspect
import io
import re
import sys
from dataclasses import fields
from typing import Any
from unittest import mock

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import footik_runtime
from footik_runtime import cli, settings
from footik_runtime.metrics import MEASURES


def attribute_texts(docstring: str) -> dict[str, str]:
    """Name -> text of each entry under "Attributes:" in a docstring."""
    _, _, section = inspect.cleandoc(docstring).partition("Attributes:\n")
    texts: dict[str, str] = {}
    name = ""
    for line in section.splitlines():
        entry = re.match(r" {4}(\w+): (.*)", line)
        if entry:
            name = entry[1]
            texts[name] = entry[2]
        elif line.startswith(" " * 8) and name:
            texts[name] += " " + line.strip()
        elif line.strip():
            break
    return texts


def settings_rows() -> list[list[str]]:
    """Setting, default, openkcc's, range, whether it scales, what it is."""
    texts = attribute_texts(settings.FootIKSettings.__doc__ or "")
    default, openkcc = settings.FootIKSettings(), settings.FootIKSettings.openkcc()
    rows = []
    for field in fields(settings.FootIKSettings):
        name = field.name
        if name not in texts:
            raise LookupError(f"FootIKSettings.{name} has no text in the class's docstring.")
        low_high = settings.RANGES.get(name)
        rows.append(
            [
                f"`{name}`",
                _plain(getattr(default, name)),
                _plain(getattr(openkcc, name)),
                f"{low_high[0]:g} to {low_high[1]:g}" if low_high else "",
                "yes" if name in settings._LENGTHS else "",
                texts[name],
            ]
        )
    return rows


def _plain(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def measures_rows() -> list[list[str]]:
    """Key, label, unit, what it is, whether it needs the input."""
    return [
        [
            f"`{m.key}`",
            m.label,
            m.unit or "ratio",
            m.explanation,
            "yes" if m.compares else "",
        ]
        for m in MEASURES
    ]


def names_rows() -> list[list[str]]:
    """Public name with a link, and the first line of its docstring."""
    rows = []
    for name in footik_runtime.__all__:
        value = getattr(footik_runtime, name)
        if not callable(value):
            rows.append([f"{{py:obj}}`{name} <footik_runtime.terrain.named.{name}>`", "Terrains."])
            continue
        doc = inspect.getdoc(value) or ""
        link = f"{{py:obj}}`{name} <{value.__module__}.{value.__qualname__}>`"
        rows.append([link, doc.splitlines()[0]])
    return rows


class _Table(SphinxDirective):
    """A table of a header and rows, written as Markdown and parsed as the page is."""

    header: tuple[str, ...] = ()

    def rows(self) -> list[list[str]]:
        raise NotImplementedError

    def run(self) -> list[nodes.Node]:
        lines = [self.header, ["---"] * len(self.header), *self.rows()]
        text = ["| " + " | ".join(c.replace("|", r"\|") for c in line) + " |" for line in lines]
        holder = nodes.container(classes=["footik-table"])
        self.state.nested_parse(StringList(text, "generated"), 0, holder)
        return holder.children


class SettingsTable(_Table):
    """`settings-table`."""

    header = ("setting", "default", "openkcc", "range", "scales", "what it is")

    def rows(self) -> list[list[str]]:
        return settings_rows()


class MeasuresTable(_Table):
    """`measures-table`."""

    header = ("key", "row of the table", "unit", "what is measured", "against the input")

    def rows(self) -> list[list[str]]:
        return measures_rows()


class NamesTable(_Table):
    """`names-table`."""

    header = ("name", "what it is")

    def rows(self) -> list[list[str]]:
        return names_rows()


class CommandHelp(SphinxDirective):
    """`command-help walk`: the text of `footik walk --help`."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        printed = io.StringIO()
        argv = ["footik", self.arguments[0], "--help"]
        with (
            mock.patch.object(sys, "argv", argv),
            mock.patch.dict("os.environ", {"COLUMNS": "88", "NO_COLOR": "1", "TERM": "dumb"}),
            contextlib.redirect_stdout(printed),
            contextlib.suppress(SystemExit),
        ):
            cli.main()
        text = re.sub(r"\x1b\[[0-9;]*m", "", printed.getvalue()).rstrip()
        if not text:
            raise self.error(f"footik {self.arguments[0]} --help printed nothing.")
        return [nodes.literal_block(text, text, language="text")]


def tame(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text: a star or a bar in one is a star or a bar."""
    for i, line in enumerate(lines):
        parts = re.split(r"(`[^`]*`)", line)
        parts[::2] = [re.sub(r"(?<!\\)([*|])", r"\\\1", part) for part in parts[::2]]
        parts[::2] = [re.sub(r"(\w)_(?=\W|$)", r"\1\\_", part) for part in parts[::2]]
        lines[i] = "".join(parts)


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.add_directive("settings-table", SettingsTable)
    app.add_directive("measures-table", MeasuresTable)
    app.add_directive("names-table", NamesTable)
    app.add_directive("command-help", CommandHelp)
    # Before napoleon, which writes stars and bars that are markup.
    app.connect("autodoc-process-docstring", tame, priority=100)
    return {"parallel_read_safe": True}
