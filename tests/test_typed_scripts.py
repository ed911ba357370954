"""Scripts as users write them: each runs, and pyright checks them in its strict mode (`[tool.pyright]`)."""

import runpy
from pathlib import Path

import pytest


SCRIPTS = sorted((Path(__file__).parent / "typed").glob("*.py"))


@pytest.mark.parametrize("script", SCRIPTS, ids=[script.stem for script in SCRIPTS])
def test_a_script_runs(script, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(script), run_name="__main__")
    assert capsys.readouterr().out
