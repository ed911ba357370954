"""Runs of the command line in a folder, and their answers."""

import contextlib
import io
import shlex
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import answer


@dataclass(frozen=True)
class Case:
    """Inputs and the command lines that use them.

    **Arguments:**

    - `prepare`: writes the inputs into a folder.
    - `lines`: command lines without `tumblecal`, run in that folder.
    """

    prepare: Callable[[Path], None]
    lines: tuple[str, ...]


def run(line: str) -> int:
    """Exit code of a command line."""
    from tumblecal.cli.run import run as run_command_line

    said, before = io.StringIO(), sys.argv
    sys.argv = ["tumblecal", *shlex.split(line)]
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), warnings.catch_warnings():
        # That the arguments are read from sys.argv is wanted here.
        warnings.filterwarnings("ignore", message="Cyclopts application invoked without tokens")
        try:
            return run_command_line()
        except SystemExit as end:
            return int(end.code or 0)
        finally:
            sys.argv = before


def answer_of(case: Case, folder: Path) -> dict[str, Any]:
    """Exit code of each command, and what the files have that were written."""
    case.prepare(folder)
    before = set(folder.rglob("*"))
    with contextlib.chdir(folder):
        codes = [run(line) for line in case.lines]
    return {"codes": codes, "files": answer.files_of(folder, before)}
