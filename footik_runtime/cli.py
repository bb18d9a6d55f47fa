"""Foot IK on any ground: walk clips over terrain, clean them, bake their curves, and measure."""

from __future__ import annotations

import io
import os
import sys

import tyro

from footik_runtime.commands.bake import bake
from footik_runtime.commands.clean import clean
from footik_runtime.commands.inspect import inspect
from footik_runtime.commands.score import score
from footik_runtime.commands.walk import walk
from footik_runtime.compiled import announce_compilation
from footik_runtime.errors import FootIKError

COMMANDS = {"walk": walk, "clean": clean, "bake": bake, "inspect": inspect, "score": score}


def main() -> None:
    """The `footik` command."""
    announce_compilation(lambda text: print(f"footik: {text}", file=sys.stderr, flush=True))
    _escape_what_cannot_be_shown()
    try:
        tyro.extras.subcommand_cli_from_dict(COMMANDS, prog="footik", description=__doc__)
        sys.stdout.flush()
    except FootIKError as error:
        print(f"footik: {error}", file=sys.stderr)
        sys.exit(1)
    except BrokenPipeError:
        # Whoever read our output has enough (`footik walk | head`): end as quietly as others do.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(141)
    except OSError as error:  # a path that is too long, a folder that may not be looked into
        named = f"{error.filename}: " if error.filename else ""
        print(f"footik: {named}{error.strerror or error}.", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)


def _escape_what_cannot_be_shown() -> None:
    """Names come from files: a terminal without their letters shows escapes instead of failing."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
