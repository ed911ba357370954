"""What people type first, and what a notebook shows of it: `docs/notebook.py` as it stands."""

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import tumblecal
from tumblecal.ground.errors import InputError


LONG = pytest.mark.long
ROOT = Path(__file__).parents[1]
SHOWN = ("rig", "positions", "calibrated", "exact", "diagnosis", "calibration")


@pytest.fixture(scope="module")
def cells(tmp_path_factory):
    """The names of the notebook after its last cell."""
    folder = tmp_path_factory.mktemp("notebook")
    (folder / "configs").symlink_to(ROOT / "configs")
    names = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        exec(compile((ROOT / "docs" / "notebook.py").read_text(encoding="utf-8"), "notebook.py", "exec"), names)
    assert (folder / "residuals.png").is_file()
    return names


@LONG
def test_what_a_result_is_made_of_prints_one_screen(cells):
    """Two attributes deep: what somebody looks at who asks a diagnosis where its numbers are from."""
    cells = cells | {"plan": tumblecal.next_plan(cells["diagnosis"])}
    parts = {}
    for name in (*SHOWN, "plan"):
        first = attributes(name, cells[name])
        parts |= first
        for path, part in first.items():
            parts |= attributes(path, part)
    texts = {path: repr(part) for path, part in parts.items()}
    assert "diagnosis.screened.pool" in texts
    assert not [path for path, text in texts.items() if len(text) > 4000 or text.count("\n") > 40]


def attributes(path, thing):
    """What is public of it and this program's own."""
    own = {f"{path}.{name}": getattr(thing, name, None) for name in dir(thing) if not name.startswith("_")}
    return {name: value for name, value in own.items() if type(value).__module__.startswith("tumblecal.")}


@LONG
def test_results_show_a_table_with_units_the_verdict_and_a_figure(cells):
    for name, words in (
        ("calibrated", "the data contradict the model"),
        ("exact", "converged"),
        ("diagnosis", "AMBIGUOUS"),
    ):
        html = cells[name]._repr_html_()
        assert "<table>" in html and "<svg" in html and words in html
        assert words in repr(cells[name])
    assert "mrad" in repr(cells["exact"]) and "bias / mg" in repr(cells["calibration"])


@LONG
def test_what_is_saved_is_what_apply_reads_terms_and_all(cells):
    calibration, positions = cells["calibration"], cells["positions"]
    assert calibration.extra["terms"]  # the second order that was hidden
    by_file = calibration.corrected(positions.readings, positions.temperature_degc)
    assert np.max(np.abs(by_file - calibration.linear(positions.readings))) > 1e-4


@LONG
def test_a_mix_up_is_refused_as_by_the_command(cells):
    from dataclasses import replace

    positions = cells["positions"]
    flipped = replace(positions, readings=positions.readings * [1.0, -1.0, 1.0])
    with pytest.raises(InputError, match="axis"):
        tumblecal.calibrate(flipped, noise_sd=0.1e-3)


def test_the_names_are_there_and_load_nothing_until_they_are_used():
    stub = ast.parse((ROOT / "src" / "tumblecal" / "__init__.pyi").read_text(encoding="utf-8"))
    typed = {alias.asname for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert typed == {"InputError", "enable_float64", *tumblecal._FROM}
    for name in tumblecal._FROM:
        assert callable(getattr(tumblecal, name)) and name in dir(tumblecal)
    with pytest.raises(AttributeError, match="there are read_positions"):
        tumblecal.calibrat  # noqa: B018
    heavy = "import sys, tumblecal; print({'jax', 'matplotlib', 'polars', 'numpy'} & {*sys.modules})"
    said = subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "set()"


def test_an_older_python_is_told_in_a_sentence(monkeypatch):
    source = (ROOT / "src" / "tumblecal" / "__init__.py").read_text(encoding="utf-8")
    tree = ast.parse(source, feature_version=(3, 7))  # an f-string of today's kind would not be read there
    monkeypatch.setattr(sys, "version_info", (3, 10, 13, "final", 0))
    with pytest.raises(SystemExit, match=r"needs Python 3\.11 or later; this is Python 3\.10"):
        exec(compile(tree, "__init__.py", "exec"), {"__name__": "tumblecal"})
