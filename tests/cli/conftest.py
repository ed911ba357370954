"""The command line as it is installed, called in this process."""

import sys
import warnings
from dataclasses import dataclass

import pytest


@dataclass(frozen=True)
class Outcome:
    """What a command left: exit code, what it printed, its error lines."""

    code: int
    out: str
    lines: list[str]


@pytest.fixture
def tumblecal(monkeypatch, capsys):
    """Run a command by its arguments."""
    import jax

    from tumblecal.cli import run as run_command_line

    kept = {name: getattr(jax.config, name) for name in ("jax_compilation_cache_dir",)}

    def run(*arguments) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["tumblecal", *map(str, arguments)])
        try:
            with warnings.catch_warnings():
                # That the arguments are read from sys.argv is what is wanted here.
                warnings.filterwarnings("ignore", message="Cyclopts application invoked without tokens")
                code = run_command_line()
        except SystemExit as end:
            code = int(end.code or 0)
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err.splitlines())

    yield run
    for name, value in kept.items():
        jax.config.update(name, value)


@pytest.fixture
def table1_file(tmp_path, table1):
    """Table 1 as a user's file."""
    from tumblecal.data import write_positions

    path = tmp_path / "table1.csv"
    write_positions(path, table1)
    return path
