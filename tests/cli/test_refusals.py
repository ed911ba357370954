"""Bad input: exit code 2, one line a fault with file, line and column, no traceback, nothing written."""

import polars as pl
import pytest
from test_mistakes import HEADER, ROWS, with_row


pytestmark = pytest.mark.usefixtures("few_effects")


def test_good_rows_are_good(tumblecal, tmp_path):
    """The rows that cases spoil are accepted, and so are repeated positions."""
    path = tmp_path / "data.csv"
    path.write_text("\n".join((HEADER, *ROWS, *ROWS)))
    assert tumblecal("calibrate", path, "--no-figures", "--out", tmp_path / "out", "--noise-sd", "0.1mg").code == 0
    assert (tmp_path / "out" / "result.json").exists()


@pytest.mark.parametrize(
    ("sd", "words"),
    [("-0.15 mg", "'-0.15 mg': a standard deviation must be above 0"), ("0 mg", "readings without noise")],
)
def test_noise_of_a_rig_is_refused_by_its_file_and_key(tumblecal, tmp_path, configs, table1_file, sd, words):
    """No noise at all may be simulated; nothing can be weighed by it."""
    rig = tmp_path / "rig.toml"
    rig.write_text((configs / "paper24.toml").read_text().replace("0.15 mg", sd))
    outcome = tumblecal("calibrate", table1_file, "--rig", rig, "--out", tmp_path / "out")
    assert outcome.code == 2 and len(outcome.lines) == 1 and f"noise.sd: {words}" in outcome.lines[0]
    assert outcome.lines[0].startswith(f"tumblecal: {rig}:line 20: ")
    assert tumblecal("simulate", rig, "--out", tmp_path / "x.csv").code == (0 if sd == "0 mg" else 2)


def test_nothing_left_to_fit_is_refused(tumblecal, tmp_path, table1_file):
    fixed = [word for name in ("dK", "bias", "gamma", "dtheta", "dbeta") for word in ("--fix", name)]
    outcome = tumblecal("diagnose", table1_file, *fixed, "--out", tmp_path / "out")
    assert outcome.code == 2 and "every parameter is fixed" in outcome.lines[0] and not (tmp_path / "out").exists()


def test_one_bad_file_among_several_stops_none_of_the_others(tumblecal, tmp_path, table1_file):
    bad = tmp_path / "bad.csv"
    bad.write_text(with_row(2, "x,180,0,0,0,?"))
    table1_file.write_text("# serial_number: A17\n" + table1_file.read_text())
    outcome = tumblecal("calibrate", bad, table1_file, "--out", tmp_path / "out")
    fault = f"{bad}:line 4, column az_g: '?' is not a number; write one"
    assert outcome.code == 2 and outcome.lines == [f"tumblecal: {fault}"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["summary.csv", "table1"]
    summary = pl.read_csv(tmp_path / "out" / "summary.csv")
    assert summary["serial_number"].to_list() == [None, "A17"] and summary["fault"].to_list() == [fault, None]
    assert summary["judgement"][0] == "refused" and summary["dK_x"][1] == pytest.approx(0.3536e-3, abs=1e-7)
