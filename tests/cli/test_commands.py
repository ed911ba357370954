"""The commands on good input: what they write, and that one undoes the other."""

import json
import signal
import subprocess
import sys

import numpy as np
import polars as pl
import pytest

import independent
from tumblecal import __version__
from tumblecal.cli.commands import COMMANDS
from tumblecal.data import paper, read_positions


pytestmark = pytest.mark.usefixtures("few_effects")


def test_calibrate_table1(tumblecal, tmp_path, table1_file, table1_fit):
    """The paper's table as a user's file: its exact fit in result.json, and figures that are drawn."""
    outcome = tumblecal("calibrate", table1_file, "--out", tmp_path / "out")
    assert outcome.code == 0 and not outcome.lines
    written = ["calibration.html", "calibration.json", "methods.svg", "residuals.svg", "result.json"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == written
    assert all((tmp_path / "out" / name).read_text().lstrip().startswith("<?xml") for name in written[2:4])
    content = json.loads((tmp_path / "out" / "result.json").read_text())
    assert set(content["methods"]) == {"exact", "harmonic", "kalman"}
    exact = content["methods"]["exact"]["parameters"]
    assert list(exact) == list(table1_fit.names)
    for name, value, sd in zip(table1_fit.names, table1_fit.values, table1_fit.sd, strict=True):
        assert exact[name]["value"] == pytest.approx(value, abs=1e-13)
        assert exact[name]["sd"] == pytest.approx(sd, rel=1e-9)
        for other in ("harmonic", "kalman"):
            assert abs(content["methods"][other]["parameters"][name]["value"] - value) < sd / 3
    assert content["residuals"][0]["x_g"] == pytest.approx(table1_fit.residuals[0, 0], abs=1e-13)


def test_simulate_calibrate_apply_gives_the_specific_force_back(tumblecal, tmp_path, configs):
    data, out = tmp_path / "data.csv", tmp_path / "out"
    assert tumblecal("simulate", configs / "paper24.toml", "--out", data, "--seed", 3, "--noise-sd", "1e-6mg").code == 0
    options = ("--rig", configs / "paper24.toml", "--noise-sd", "1e-6mg", "--no-figures", "--out", out)
    assert tumblecal("calibrate", data, *options).code == 0
    assert tumblecal("apply", out / "calibration.json", data).code == 0
    corrected = pl.read_csv(tmp_path / "data_corrected.csv", comment_prefix="#")
    f = corrected.select("ax_g", "ay_g", "az_g").to_numpy()
    truth = np.array(list(paper.SIMULATION_TRUTH.values()))
    positions = read_positions(data)
    v = independent.specific_force(positions.alpha, positions.beta + np.repeat(truth[12:], 8))
    np.testing.assert_allclose(f, independent.mount(truth[6:9]).apply(v), rtol=0, atol=1e-8)
    alignment = np.array(json.loads((out / "calibration.json").read_text())["alignment"])
    np.testing.assert_allclose(f @ alignment.T, v, rtol=0, atol=1e-8)
    assert corrected["position"].to_list() == list(positions.names)
    assert np.max(np.abs(positions.readings - v)) > 1e-3  # there was something to correct


def test_several_files_have_a_subfolder_each(tumblecal, tmp_path, table1_file):
    (tmp_path / "other").mkdir()
    other = tmp_path / "other" / "table1.csv"
    other.write_bytes(table1_file.read_bytes())
    assert tumblecal("calibrate", table1_file, other, "--no-figures", "--out", tmp_path / "out").code == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["summary.csv", "table1", "table1-2"]
    first, second = (
        json.loads((tmp_path / "out" / name / "result.json").read_text()) for name in ("table1", "table1-2")
    )
    assert first["methods"] == second["methods"]


def test_calibrate_loads_neither_the_diagnosis_nor_rigs(table1_file, tmp_path):
    code = """import sys; from tumblecal.cli.run import run
assert run() == 0; print(*(name for name in sys.modules if name.startswith("tumblecal")))"""
    command = [sys.executable, "-c", code, "calibrate", table1_file, "--out", tmp_path / "out", "-q"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True)
    loaded = done.stdout.split()
    assert 100 < len(loaded) <= 170
    assert not [name for name in loaded if name.startswith(("tumblecal.diagnosis", "tumblecal.chain.rig"))]


def test_help_versions_and_examples_are_listed(tumblecal, configs, monkeypatch):
    assert tumblecal("help", "apply").out == tumblecal("apply", "--help").out
    overview = tumblecal().out
    assert tumblecal("-h").out == overview and {line.split(" ")[0] for line in overview.splitlines()} >= {*COMMANDS}
    versions = dict(line.split(" ", 1) for line in tumblecal("--version", "-v").out.splitlines())
    assert versions["tumblecal"] == __version__ and versions["numpy"] == np.__version__
    listed = {line.split()[0] for line in tumblecal("example").out.splitlines()}
    assert listed == {path.stem for path in configs.glob("*.toml")}
    monkeypatch.setattr("tumblecal.ground.examples.example_names", lambda: [bytes(1)] * 10**13)
    outcome = tumblecal("example")
    assert outcome.code == 2 and outcome.lines == [
        "tumblecal: not enough memory for this file or computation; split the file, or close other programs"
    ]


EARLY = """
import signal, sys
from tumblecal.cli import main
module, number = sys.argv[1], int(sys.argv[2])
class Asked:
    def find_spec(self, name, path, target=None):
        if name == module:
            sys.meta_path.remove(self)
            signal.raise_signal(number)
sys.meta_path.insert(0, Asked())
sys.argv[1:] = sys.argv[3:]
main()
"""


@pytest.mark.parametrize(
    ("module", "number"),
    [
        ("cyclopts", signal.SIGTERM),
        ("tumblecal.cli.commands.simulate", signal.SIGINT),
        ("tumblecal.effects.catalogue", signal.SIGTERM),
    ],
)
def test_a_signal_while_modules_are_imported_is_one_line(module, number):
    """Before the command begins, as it is loaded, and within its own first imports."""
    simulate = ["simulate", "none.toml", "--out", "none.csv"]
    command = ["env", "--default-signal=INT", sys.executable, "-c", EARLY, module, str(int(number)), *simulate]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    word = "interrupted" if number == signal.SIGINT else "terminated"
    assert done.stderr == f"tumblecal: {word}; no file was left half-written\n" and done.stdout == ""
    assert done.returncode == (130 if number == signal.SIGINT else -number)


def test_a_fit_that_does_not_converge_ends_with_code_3_and_no_calibration(
    tumblecal, tmp_path, table1_file, monkeypatch
):
    from tumblecal.estimation import Code, exact

    judged = exact._judged
    monkeypatch.setattr(exact, "_judged", lambda *arguments: (Code.NOT_CONVERGED, judged(*arguments)[1]))
    outcome = tumblecal("calibrate", table1_file, "--out", tmp_path / "out")
    assert outcome.code == 3
    assert "did not converge" in outcome.out
    assert not (tmp_path / "out" / "calibration.json").exists()
    page = (tmp_path / "out" / "calibration.html").read_text(encoding="utf-8")
    assert "DO NOT USE" in page and "The exact fit did not converge" in page and "Apply it" not in page
