"""The history of units: what is kept, what is said of it, and that nothing is lost."""

import json
import re
import sqlite3
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from history_changes import entries_of
from tumblecal.data import paper, write_positions
from tumblecal.data.calibration import read_calibration
from tumblecal.data.sensor_parameters import SENSOR, of_matrix
from tumblecal.history.database import add, documents, listed, of_unit
from tumblecal.history.repeatability import PAPER_LIMITS, unit_history
from tumblecal.show.history import words_of_history


RNG = np.random.default_rng(2)
SD = np.array([5e-5] * 3 + [5e-5] * 3 + [5e-5] * 3 + [3e-5] * 3)


def covariance():
    mixed = np.eye(12) + 0.3 * RNG.normal(size=(12, 12))
    root = mixed / np.linalg.norm(mixed, axis=1)[:, None] * SD[:, None]
    return root @ root.T


def results(count, *, drift_a_month=0.0, extra=0.0, days=30.4375, own=None):
    """A unit measured every month, its true errors drawn from the stated covariance."""
    own = covariance() if own is None else own
    truth, root = RNG.normal(size=12) * 1e-3, np.linalg.cholesky(own)
    values = [
        truth + root @ RNG.normal(size=12) + drift_a_month * k * days / 30.4375 + extra * RNG.normal(size=12)
        for k in range(count)
    ]
    return entries_of(days * np.arange(count), values, [own] * count)


@pytest.mark.usefixtures("few_effects")
def test_calibrate_and_diagnose_keep_what_they_wrote(tumblecal, tmp_path, table1):
    path, base = tmp_path / "lab.db", tmp_path / "data.csv"
    write_positions(
        base, replace(table1, comments={"serial_number": "A-17", "measured_utc": "2024-05-06T07:08:09+02:00"})
    )
    for command in ("calibrate", "diagnose"):
        outcome = tumblecal(command, base, "--no-figures", "--history", path, "--out", tmp_path / command)
        assert outcome.code == 0 and not outcome.lines
    kept = listed(path)
    assert [(entry.kind, entry.serial, entry.date_utc) for entry in kept] == [
        ("calibration", "A-17", "2024-05-06T05:08:09Z"),
        ("diagnosis", "A-17", "2024-05-06T05:08:09Z"),
    ]
    for entry, name in zip(kept, ("result.json", "diagnosis.json"), strict=True):
        folder = tmp_path / entry.kind.replace("calibration", "calibrate").replace("diagnosis", "diagnose")
        assert documents(path, entry.number)[0][name] == (folder / name).read_text()
    fitted = json.loads((tmp_path / "calibrate" / "result.json").read_text())["methods"]["exact"]["parameters"]
    parameters = of_unit(path, "A-17")[0].parameters
    assert [fitted[name]["value"] for name in parameters.names] == parameters.values.tolist()
    np.testing.assert_allclose(parameters.sd, [fitted[name]["sd"] for name in parameters.names], rtol=1e-12)
    # The same data twice is one measurement; the same folder once more is nothing new.
    assert len(unit_history(of_unit(path, "A-17"), PAPER_LIMITS).entries) == 1
    outcome = tumblecal("history", path, "--add", tmp_path / "calibrate", "--add", tmp_path / "diagnose")
    assert "0 of 2 added" in outcome.out and "2 results of 1 unit" in outcome.out
    again = tmp_path / "again"
    assert tumblecal("history", path, "--files", kept[0].number, "--out", again).code == 0
    for name in ("result.json", "calibration.json"):
        assert (again / name).read_bytes() == (tmp_path / "calibrate" / name).read_bytes()
    outcome = tumblecal("history", path, "--files", kept[0].number, "--out", again)
    assert outcome.code == 2 and "has calibration.json" in outcome.lines[0]


def test_the_parameters_of_a_calibration_file_are_those_of_its_matrix(tumblecal, tmp_path, table1_file):
    tumblecal("calibrate", table1_file, "--no-figures", "--out", tmp_path)
    own = read_calibration(tmp_path / "calibration.json")
    derived = of_matrix(own.matrix, own.bias, own.covariance)
    np.testing.assert_allclose(own.sensor.of(SENSOR).values, derived.values, rtol=0, atol=1e-14)
    np.testing.assert_allclose(
        own.sensor.of(SENSOR).covariance, derived.covariance, rtol=0, atol=1e-9 * own.covariance.max()
    )
    angle = 0.3
    turn = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    turned = of_matrix(turn @ own.matrix, own.bias, np.zeros((12, 12)))
    np.testing.assert_allclose(turned.values, derived.values, rtol=0, atol=1e-14)


def test_table2_s_runs_are_within_the_paper_s_limits_and_too_few_for_a_change(tumblecal, tmp_path):
    """The biases of the runs disperse by three times the noise."""
    outcome = tumblecal("history", tmp_path / "lab.db", "paper", "--example", "--out", tmp_path / "page")
    assert outcome.code == 0
    assert "paper: 3 results from 2016-06-01 to 2016-06-01, too few to detect a change (4 are needed)" in outcome.out
    assert "biases 0.097 mg" in outcome.out
    page = (tmp_path / "page" / "history.html").read_text()
    assert "Control charts" in page and page.count("<svg") == 4
    row = re.search(r"<td[^>]*>2016-06-01 \(result 2\)</td>.*?</tr>", page, re.S)[0]
    assert row.count("<td") == 13 and "E_n of each result" in page
    limits = ["--limit", "bias=0.3 mg", "--limit", "dK=200ppm", "--limit", "dtheta=1e-9 rad"]
    outcome = tumblecal("history", tmp_path / "lab.db", "paper", *limits)
    said = [line for line in outcome.out.splitlines() if line.startswith("paper: ")]
    assert said == [
        "paper: scale factors of two results differ by 0.239e-3, more than the limit of 0.2e-3, but agree within their "
        "uncertainties.",
        "paper: biases of two results differ by 0.358 mg, more than the limit of 0.3 mg.",
    ]
    table = paper.table2()
    judged = unit_history(of_unit(tmp_path / "lab.db", "paper"), PAPER_LIMITS)
    assert judged.repeats[1].largest == pytest.approx(max(np.ptp(table[f"bias_{axis}"]) for axis in "xyz"))


@pytest.mark.long
def test_e_n_beyond_1_are_as_many_as_k_says():
    en = [trend.en for _ in range(40) for trend in unit_history(results(5), PAPER_LIMITS).trends]
    assert np.mean(np.abs(en) > 1) == pytest.approx(
        0.025, abs=0.02
    )  # k = 2, and a small sd between dates; 0.025 of 2 880 results
    scattered = [trend.en for _ in range(40) for trend in unit_history(results(5, extra=3e-4), PAPER_LIMITS).trends]
    assert np.mean(np.abs(scattered) > 1) == pytest.approx(0.0455, abs=0.025)  # with the repeatability


def test_drift_its_sd_and_the_interval():
    drift, pulls, due = 4e-5, [], []
    for _ in range(15):
        judged = unit_history(results(12, drift_a_month=drift), PAPER_LIMITS)
        pulls += [(trend.drift - drift) / trend.drift_sd for trend in judged.trends[:9]]
        due.append(judged.interval(0.05)[0])
    assert np.mean(pulls) == pytest.approx(0, abs=0.25) and np.std(pulls) == pytest.approx(1, abs=0.2)
    # 5e-4 of scale at 4e-5 a month are 12.5 months, less the dispersion and the standard uncertainty of the drift.
    assert 8 < np.median(due) < 11.1 and max(due) <= 11.1
    still = unit_history(results(12), PAPER_LIMITS)
    assert still.interval(0.05)[0] == pytest.approx(11.0)  # as long as the history
    assert np.isnan(unit_history(results(2), PAPER_LIMITS).interval(0.05)[0])
    jumpy = unit_history(results(8, extra=1e-3), PAPER_LIMITS)
    assert "already exceeds its limit" in words_of_history("A-17", jumpy, 0.05).text("interval")
    assert jumpy.repeats[0].sd == pytest.approx(1e-3, rel=0.4)
    assert jumpy.interval(0.05)[0] == 0.0 and jumpy.repeats[0].beyond_limit


def test_a_drift_and_its_uncertainty_are_those_of_weighted_least_squares():
    """A drift of 0.2 mg a month: slope by the closed form, u by the dispersion of all biases."""
    rng, entries = np.random.default_rng(1), results(12, own=1e-8 * np.eye(12))
    for k, entry in enumerate(entries):
        entry.parameters.values[:] = 1e-4 * rng.normal(size=12)
        entry.parameters.values[3] += 2e-4 * k
    months = np.array([(entry.when - entries[0].when).total_seconds() for entry in entries]) * 12 / 365.25 / 86400
    values, centred = np.array([entry.parameters.values[3] for entry in entries]), months - months.mean()
    slope = np.sum(centred * values) / np.sum(centred**2) * 1e3
    judged = unit_history(entries, PAPER_LIMITS)
    u = np.hypot(0.1, judged.repeats[1].between * 1e3) / np.sqrt(np.sum(centred**2))
    ((drift, step),) = words_of_history("A-17", judged, 0.05).pairs("findings")
    assert drift == (
        f"bias_x drifts by {12 * slope:.2f} +- {12 * u:.2f} mg per year from 2024-01-01 (result 1) to "
        f"{entries[-1].date_utc[:10]} (result 12)"
    )
    assert "recalibrate more often" in step


def test_kills_and_two_writers_lose_nothing():
    """The short version of benchmarks/history_file.py."""
    script = Path(__file__).parents[2] / "benchmarks" / "history_file.py"
    counts = ["--kills", "2", "--creations", "12"]
    done = subprocess.run([sys.executable, script, *counts], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 kills; lost or torn: 0" in done.stdout and "at once; refused or lost: 0" in done.stdout


def three_kept(path):
    """A history of one unit with three results, each with its documents."""
    for k, entry in enumerate(results(3)):
        texts = {"result.json": json.dumps({"number": k}) + " " * 500, "more.txt": f"{k} " * 50}
        assert add(path, replace(entry, documents=texts))
    return path


def damage(path, statement, *values):
    with sqlite3.connect(path) as database:
        assert database.execute(statement, values).rowcount == 1


FLIPPED = b"\x00not what was packed"
# What is done to the second of three results, and the part that must be named.
DAMAGES = {
    "document": (
        "UPDATE document SET content = ? WHERE number = 2 AND name = 'result.json'",
        (FLIPPED,),
        "result.json",
    ),
    "document lost": ("DELETE FROM document WHERE number = 2 AND name = 'result.json'", (), "result.json"),
    "parameters": ("UPDATE parameters SET estimate = ? WHERE number = 2", (b"123",), "its parameters"),
    "one number": ("UPDATE parameters SET estimate = ? WHERE number = 2", (np.zeros(12).tobytes(),), "its parameters"),
    "names": ("UPDATE parameters SET names = '[' WHERE number = 2", (), "its parameters"),
    "date": ("UPDATE entry SET date_utc = '2020-13-77' WHERE number = 2", (), "its row"),
    "serial number": ("UPDATE entry SET serial = 'A-18' WHERE number = 2", (), "its row"),
    "rms": ("UPDATE entry SET rms_g = 'x' WHERE number = 2", (), "its row"),
    "text": ("UPDATE entry SET outcome = CAST(x'ff1b' AS TEXT) WHERE number = 2", (), "its row"),
}


@pytest.mark.parametrize(("statement", "values", "part"), DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_result_is_named_and_the_others_are_used(tumblecal, tmp_path, statement, values, part):
    path = three_kept(tmp_path / "lab.db")
    assert tumblecal("history", path, "--check").code == 0
    damage(path, statement, *values)
    for arguments in ((), ("A-17",)):
        outcome = tumblecal("history", path, *arguments)
        listed_only = not arguments and part != "its row"  # the list needs no more than the rows
        said = [] if listed_only else [f"WARNING: {path}: result 2"]
        assert outcome.code == 0 and [line[: len(said[0])] for line in outcome.lines] == said, outcome
        assert all(part in line for line in outcome.lines)
    assert [entry.number for entry in of_unit(path, "A-17") if entry.parameters is not None] == [1, 3]
    outcome = tumblecal("history", path, "--check")
    assert outcome.code == 1 and not outcome.lines
    assert outcome.out.startswith("result 2") and part in outcome.out and "3 results, 1 fault" in outcome.out
    again = tumblecal("history", path, "--files", 2, "--out", tmp_path / "files")
    lost = {"result.json"} & {part}
    assert again.code == (1 if lost else 0) and len(again.lines) == len(lost)
    assert {path.name for path in (tmp_path / "files").iterdir()} == {"result.json", "more.txt"} - lost
    assert documents(path, 3)[0]["more.txt"] == "2 " * 50


def test_a_history_without_checksums_is_read_and_given_checksums(tumblecal, tmp_path):
    path = three_kept(tmp_path / "lab.db")
    with sqlite3.connect(path) as database:
        database.execute("DROP TABLE checksum")
    before = path.read_bytes()
    assert "none damaged" in tumblecal("history", path, "--check").out
    assert [entry.number for entry in of_unit(path, "A-17") if entry.parameters is not None] == [1, 2, 3]
    assert path.read_bytes() == before
    assert add(path, replace(results(4)[3], number=0))
    damage(path, "UPDATE parameters SET estimate = ? WHERE number = 1", np.zeros(12).tobytes())
    said = tumblecal("history", path, "--check").out.splitlines()
    assert [line.partition(":")[0][:8] for line in said] == ["result 1", str(path)[:8]]


def test_a_damaged_page_of_the_file_takes_only_its_own_results(tumblecal, tmp_path):
    """Every page of the file in turn is overwritten: no traceback, and --check never says that all is well."""
    path = three_kept(tmp_path / "lab.db")
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        size = database.execute("PRAGMA page_size").fetchone()[0]
    whole, seen = path.read_bytes(), 0
    for page in range(len(whole) // size):
        broken = tmp_path / "broken.db"
        broken.write_bytes(whole[: page * size] + b"\x5a" * size + whole[(page + 1) * size :])
        checked = tumblecal("history", broken, "--check")
        assert checked.code in (1, 2) and (checked.code == 1 or len(checked.lines) == 1), (page, checked)
        outcome = tumblecal("history", broken, "A-17")
        assert outcome.code in (0, 2) and all("broken.db" in line for line in outcome.lines)
        seen += outcome.code == 0
    assert seen > 0
