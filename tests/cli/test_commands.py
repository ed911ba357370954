"""The commands on good input: what they write, and that one undoes the other."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import polars as pl
import pytest

import independent
from tumblecal import __version__
from tumblecal.data import paper, read_positions


def test_calibrate_table1(tumblecal, tmp_path, table1_file, table1_fit):
    """The paper's table as a user's file: Table 1's known answers in result.json, and in words on the screen."""
    outcome = tumblecal("calibrate", table1_file, "--out", tmp_path / "out")
    assert outcome.code == 0 and not outcome.lines
    written = ["calibration.html", "calibration.json", "methods.svg", "residuals.svg", "result.json"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == written
    content = json.loads((tmp_path / "out" / "result.json").read_text())
    assert content["schema"] == "tumblecal.result/1"
    assert {"methods", "noise", "residuals", "identifiability"} <= set(content)
    assert set(content["methods"]) == {"exact", "harmonic", "kalman"}
    exact = content["methods"]["exact"]["parameters"]
    assert list(exact) == list(table1_fit.names)
    for name, value, sd, unit in zip(exact, table1_fit.values, table1_fit.sd, table1_fit.units, strict=True):
        assert exact[name]["value"] == pytest.approx(value, abs=1e-13)
        assert exact[name]["sd"] == pytest.approx(sd, rel=1e-9)
        assert exact[name]["unit"] == unit
        for other in ("harmonic", "kalman"):
            # All methods agree on the paper's magnitudes: within a third of a standard deviation.
            assert abs(content["methods"][other]["parameters"][name]["value"] - value) < sd / 3
    assert content["noise"]["sigma_g"] == pytest.approx(0.0978e-3, abs=5e-8)
    assert content["identifiability"]["rank"] == 15
    assert len(content["residuals"]) == 24
    assert content["residuals"][0]["x_g"] == pytest.approx(table1_fit.residuals[0, 0], abs=1e-13)
    text = outcome.out
    assert "rms 0.0870 mg" in text and "sd 0.0978 mg" in text and "57 degrees of freedom" in " ".join(text.split())
    weak = next(line for line in text.splitlines() if line.startswith("poorly determined combination"))
    assert all(name in weak for name in ("dK_x", "bias_x", "dbeta_0"))


def test_simulate_calibrate_apply_gives_the_specific_force_back(tumblecal, tmp_path, configs):
    data, out = tmp_path / "data.csv", tmp_path / "out"
    assert tumblecal("simulate", configs / "paper24.toml", "--out", data, "--seed", 3, "--noise-sd", "1e-6mg").code == 0
    assert (
        tumblecal(
            "calibrate",
            data,
            "--rig",
            configs / "paper24.toml",
            "--noise-sd",
            "1e-6mg",
            "--no-figures",
            "--out",
            out,
        ).code
        == 0
    )
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


def test_simulation_by_seed_is_the_same_to_the_byte(tumblecal, tmp_path, configs):
    for name, seed in (("a.csv", 5), ("b.csv", 5), ("c.csv", 6)):
        assert tumblecal("simulate", configs / "grid48.toml", "--out", tmp_path / name, "--seed", seed).code == 0
    first, again, other = ((tmp_path / name).read_bytes() for name in ("a.csv", "b.csv", "c.csv"))
    assert first == again != other
    assert b"# seed: 5" in first
    assert tumblecal("simulate", configs / "grid48.toml", "--out", tmp_path / "a.parquet", "--seed", 5).code == 0
    np.testing.assert_array_equal(
        read_positions(tmp_path / "a.parquet").readings, read_positions(tmp_path / "a.csv").readings
    )


def test_rig_with_priors_and_two_mountings(tumblecal, tmp_path, configs):
    for name in ("grid48", "remount"):
        data, out = tmp_path / f"{name}.csv", tmp_path / name
        assert tumblecal("simulate", configs / f"{name}.toml", "--out", data, "--seed", 1).code == 0
        outcome = tumblecal("calibrate", data, "--rig", configs / f"{name}.toml", "--no-figures", "--out", out)
        assert outcome.code == 0
        content = json.loads((out / "result.json").read_text())
        assert content["noise"]["kind"] == "stated" and content["noise"]["chi2_p_value"] > 1e-3
        assert len(content["model"]["parameters"]) == {"grid48": 16, "remount": 21}[name]


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


def test_single_pitch_setting_with_what_is_known(tumblecal, tmp_path, configs):
    """Two pitch settings cannot tell dbeta_0 from bias_x; a prior, or keeping dbeta, lets the rest be estimated."""
    data = tmp_path / "data.csv"
    assert tumblecal("simulate", configs / "paper24.toml", "--out", tmp_path / "all.csv").code == 0
    rows = (tmp_path / "all.csv").read_text().splitlines()
    data.write_text(
        "\n".join(row for row in rows if ",90.0," not in row.split(",", 2)[-1] and not row.startswith("2-"))
    )
    refused = tumblecal("calibrate", data, "--out", tmp_path / "out")
    assert refused.code == 2 and "dK_x, bias_x, dbeta_0" in refused.lines[0]
    options = ["--noise-sd", "0.15mg", "--prior", "dbeta=3 arcmin"]
    assert tumblecal("calibrate", data, "--no-figures", "--out", tmp_path / "prior", *options).code == 0
    # The true pitch errors are up to 2 mrad: without them the data contradict the model.
    assert tumblecal("calibrate", data, "--no-figures", "--out", tmp_path / "fixed", "--fix", "dbeta").code == 3
    fixed = json.loads((tmp_path / "fixed" / "result.json").read_text())
    assert not any(name.startswith("dbeta") for name in fixed["model"]["parameters"])
    assert fixed["use"]["answer"] == "no" and "the data contradict the model" in fixed["use"]["reason"]


def test_figures_are_drawn(tumblecal, tmp_path, table1_file):
    assert tumblecal("calibrate", table1_file, "--out", tmp_path / "out", "--figures").code == 0
    for name in ("residuals.svg", "methods.svg"):
        assert (tmp_path / "out" / name).read_text().lstrip().startswith("<?xml")


GROUND = """import importlib, pkgutil, tumblecal.ground
for module in pkgutil.iter_modules(tumblecal.ground.__path__):
    importlib.import_module(f"tumblecal.ground.{module.name}")"""
HEAVY = ("jax", "jaxlib", "equinox", "optimistix", "matplotlib", "scipy", "polars")


@pytest.mark.parametrize(
    "program",
    [
        "import tumblecal",
        GROUND,
        "from tumblecal.cli.commands import app; app(['--help'], result_action='return_value')",
    ],
)
def test_import_and_help_load_neither_jax_nor_matplotlib(program):
    code = f"{program}\nimport sys; print('loaded', *(name for name in {HEAVY} if name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600, check=True)
    assert done.stdout.splitlines()[-1] == "loaded"
    if "--help" in program:
        assert all(name in done.stdout for name in ("reproduce", "calibrate", "apply", "simulate"))


@pytest.mark.parametrize("module", ["tumblecal", "tumblecal.cli"])
def test_python_runs_the_package_as_the_command(module):
    command = [sys.executable, "-m", module]
    done = subprocess.run([*command, "--version"], capture_output=True, text=True, timeout=600, check=True)
    assert done.stdout.strip() == __version__
    wrong = subprocess.run([*command, "export", "no.json", "--to", "json"], capture_output=True, text=True, timeout=600)
    assert wrong.returncode == 2 and wrong.stderr.startswith("tumblecal: no.json: no such file")


def test_an_interrupt_leaves_no_half_written_file(tmp_path):
    """SIGINT at two moments of a real process (imports, computing): every file that is there is whole."""
    # A test run in the background ignores SIGINT and its children would too.
    command = ["env", "--default-signal=INT", sys.executable, "-m", "tumblecal.cli", "reproduce"]
    command += ["--out", str(tmp_path / "study")]
    for delay in (0.1, 2.5):
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ)
        limit = time.monotonic() + 600
        while not (tmp_path / "study").exists() and time.monotonic() < limit and process.poll() is None:
            time.sleep(0.01)
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        try:
            _, errors = process.communicate(timeout=600)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        assert process.returncode == 130, errors
        assert errors == "tumblecal: interrupted; no file was left half-written\n"
        for path in tmp_path.rglob("*"):
            assert not path.name.startswith("."), path
            if path.suffix == ".json":
                json.loads(path.read_text())


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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("module", ["cyclopts", "tumblecal.cli.effects", "tumblecal.effects.catalogue"])
def test_a_signal_while_modules_are_imported_is_one_line(module, number):
    """Before the command begins, as it is loaded, and within its own first imports."""
    command = ["env", "--default-signal=INT", sys.executable, "-c", EARLY, module, str(int(number)), "effects"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    word = "interrupted" if number == signal.SIGINT else "terminated"
    assert done.stderr == f"tumblecal: {word}; no file was left half-written\n" and done.stdout == ""
    assert done.returncode == (130 if number == signal.SIGINT else -number)


def test_an_interrupt_inside_a_weak_reference_s_callback_is_not_lost():
    """Python prints and drops what such a callback raises; Ctrl-C has to come out all the same."""
    program = """
import signal, time, weakref
from tumblecal.cli.interrupts import interrupts_kept
interrupts_kept()
thing = type("Thing", (), {})()
seen = weakref.ref(thing, lambda _: signal.raise_signal(signal.SIGINT))
try:
    del thing
    time.sleep(20)
    print("lost")
except KeyboardInterrupt:
    print("interrupted")
"""
    command = ["env", "--default-signal=INT", sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True)
    assert done.stdout.split() == ["interrupted"] and done.stderr == ""


def test_an_interrupt_that_a_compiled_module_turned_into_its_own_error():
    """As pybind11 does where Ctrl-C meets the conversion of an argument: TypeError."""
    program = """
import signal, sys
from tumblecal.cli import commands, main
from tumblecal.cli.interrupts import interrupts_kept
def command():
    interrupts_kept()
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        raise TypeError("incompatible arguments") from None
commands.app.command(command, name="broken")
sys.argv = ["tumblecal", "broken"]
main()
"""
    command = ["env", "--default-signal=INT", sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 130 and "interrupted" in done.stderr and "Traceback" not in done.stderr


def test_an_interrupt_while_a_file_is_renamed(tumblecal, tmp_path, monkeypatch, table1_file):
    """Ctrl-C between writing aside and renaming: the older result stays as it was."""
    out = tmp_path / "out"
    assert tumblecal("calibrate", table1_file, "--no-figures", "--out", out).code == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("tumblecal.ground.atomic.os.replace", interrupted)
    outcome = tumblecal("calibrate", table1_file, "--no-figures", "--out", out)
    assert outcome.code == 130
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


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
