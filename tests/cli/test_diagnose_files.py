"""`tumblecal diagnose`: what it leaves for one file and for several."""

import pickle
import re
from dataclasses import replace

import polars as pl
import pytest

from tumblecal.cli import diagnosis_workers
from tumblecal.data import read_positions, write_positions
from tumblecal.diagnosis import Diagnoser


PAGE = {"diagnosis.html", "predictive.svg", "limits.svg", "residuals_by_angle.svg"}


@pytest.fixture(scope="module")
def files(tmp_path_factory, table1):
    """Table 1, the same with a knocked position, and a file too short for any test."""
    files = [tmp_path_factory.mktemp("files") / f"{name}.csv" for name in ("table1", "knocked", "short")]
    readings = table1.readings.copy()
    readings[5] += [2e-3, -2e-3, 2e-3]
    knocked = replace(table1, readings=readings)
    for file, data in zip(files, (table1, knocked, table1.chosen(range(6))), strict=True):
        write_positions(file, data)
    return files


@pytest.fixture(scope="module")
def diagnosed(files):
    """The folder of the results of all files by one process, and what the command printed; made once."""
    return {"out": files[0].parent / "out"}


@pytest.fixture
def one_process(diagnosed, tumblecal, files):
    if "outcome" not in diagnosed:
        diagnosed["outcome"] = tumblecal("diagnose", *files, "--out", diagnosed["out"], "--workers", "1")
    return diagnosed["outcome"], diagnosed["out"]


@pytest.mark.long
@pytest.mark.usefixtures("few_effects")
@pytest.mark.filterwarnings("error")
def test_an_effect_without_any_noise_is_no_measurement(tumblecal, tmp_path, configs):
    rig, exact, text = tmp_path / "rig.toml", tmp_path / "exact.csv", (configs / "hidden_effect.toml").read_text()
    # The paper's plan, as elsewhere: two files of it are compiled once.
    for line in ("alpha_deg = { start = 0, step = 45, count = 8 }", "beta_deg = [0, 45, 90]"):
        text = re.sub(rf"^{line.split()[0]} = .*$", line, text, flags=re.M)
    text = text.replace("[0.6, -0.4, 0.3, -0.7]", "[0.6, -0.4, 0.3]")
    rig.write_text(text)
    assert tumblecal("simulate", rig, "--noise-sd", "0mg", "--out", exact).code == 0
    refused = tumblecal("diagnose", exact, "--out", tmp_path / "refused")
    assert refused.code == 2 and len(refused.lines) == 1 and "State the noise" in refused.lines[0]
    diagnoser = Diagnoser(nested=False)
    stated = diagnoser(read_positions(exact), noise_sd=1e-4)
    assert "second_order.z" in stated.labels and not stated.noise_wrong
    rig.write_text(text.replace("value = 0.6,", "value = 0.0,").replace("value = 0.2,", "value = 0.0,"))
    assert tumblecal("simulate", rig, "--noise-sd", "0mg", "--out", exact).code == 0
    assert diagnoser(read_positions(exact), noise_sd=1e-4).verdict == "adequate"


def test_several_files_get_a_summary_and_progress(one_process, files):
    outcome, out = one_process
    assert outcome.code == 2  # one could not be diagnosed
    assert len(outcome.lines) == 1 and "short.csv" in outcome.lines[0]
    *lines, written = outcome.out.splitlines()
    assert [line.split("  ")[0] for line in lines] == ["1 of 3", "2 of 3", "3 of 3"]
    assert written == f"written: {out}/: summary.csv, a folder for each file"
    assert outcome.out.splitlines()[2].endswith("short.csv: rejected")
    assert sorted(path.name for path in out.iterdir()) == ["knocked", "summary.csv", "table1"]
    assert not PAGE & {path.name for path in (out / "knocked").iterdir()}
    summary = pl.read_csv(out / "summary.csv")
    assert summary["file"].to_list() == [str(file) for file in files]
    assert summary["verdict"].to_list() == ["adequate", "identified", "refused"]
    assert summary["causes"][1] == f"outlier_position:{read_positions(files[0]).names[5]}"
    adequate, knocked, refused = summary.rows(named=True)
    assert adequate["p_value"] > 0.05 and knocked["p_value"] < 1e-3
    assert adequate["cv_gain_g"] == 0 and knocked["cv_gain_g"] > 1e-4
    # Without the knocked position the noise is that of Table 1.
    assert knocked["sigma_g"] == pytest.approx(0.098e-3, rel=0.1) == pytest.approx(adequate["sigma_g"], rel=0.1)
    assert 0.5 < knocked["probability"] <= 1
    assert "short.csv" in refused["fault"] and refused["p_value"] is None


def test_an_interrupted_batch_leaves_the_lines_of_what_was_finished(tumblecal, tmp_path, files, monkeypatch):
    whole, count = Diagnoser.__call__, []

    def interrupted(self, data, **options):
        count.append(data)
        if len(count) > 1:
            raise KeyboardInterrupt
        return whole(self, data, **options)

    monkeypatch.setattr(Diagnoser, "__call__", interrupted)
    assert tumblecal("diagnose", *files, "--out", tmp_path / "out").code == 130
    assert pl.read_csv(tmp_path / "out" / "summary.csv")["verdict"].to_list() == ["adequate"]


def test_a_worker_diagnoses_what_the_command_sends_it(one_process, tumblecal, tmp_path, files, monkeypatch):
    """The pool in this process: what a worker gets is what can be sent; its answers are those of one process."""

    class Pool:
        def __init__(self, workers, context, initializer, initargs):
            assert workers == 2
            initializer(*pickle.loads(pickle.dumps(initargs)))

        def map(self, function, *each):
            return map(function, *pickle.loads(pickle.dumps(each)))

        def shutdown(self, cancel_futures):
            assert cancel_futures

    monkeypatch.setattr(diagnosis_workers, "ProcessPoolExecutor", Pool)
    monkeypatch.setattr(diagnosis_workers.signal, "signal", lambda *_: None)
    outcome = tumblecal("diagnose", *files, "--out", tmp_path, "--workers", "2")
    assert outcome.code == 2 and outcome.lines == one_process[0].lines
    one, two = (pl.read_csv(folder / "summary.csv") for folder in (one_process[1], tmp_path))
    assert one.equals(two)
