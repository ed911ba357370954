"""Mistakes made in setting up, through the command line: each is named or refused in a line, and stops no other file."""

import json
import shutil

import numpy as np
import polars as pl
import pytest

import blind_instrument as blind
from blind.conditions import columns_of, write
from blind.mistakes import MISTAKES


def measured(seed: int, mistake: str = "", **nominal):
    """Columns of a position file of 3 x 8 positions, stated noise, with a mistake in them."""
    rng = np.random.default_rng(seed)
    setup = blind.random_setup(rng, 3, 8)
    setup.nominal.update(nominal)
    readings = blind.readings(setup, setup.nominal, {})
    columns = columns_of(setup, readings + blind.SIGMA * rng.normal(size=readings.shape), known=True)
    if mistake:
        MISTAKES[mistake][0](columns, rng)
    return columns


IMPLAUSIBLE = {
    "dbeta_1": {"dbeta": np.radians([0.0, 2.7, 0.0])},
    "dtheta_x": {"dtheta": np.radians([18.0, 0.0, 0.0])},
    "bias_y": {"bias": np.array([0.0, 0.8, 0.0])},
    "dK_z": {"dK": np.array([0.0, 0.0, 0.2])},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A file for each mistake, for each parameter that no instrument has, and a good one."""
    path = tmp_path_factory.mktemp("mistakes")
    for number, mistake in enumerate(MISTAKES):
        write(path / f"{mistake}.csv", measured(number, mistake))
    for number, (name, nominal) in enumerate(IMPLAUSIBLE.items(), start=20):
        write(path / f"{name}.csv", measured(number, **nominal))
    write(path / "triad turned in its fixture.csv", measured(98, dtheta=np.radians([60.0, 0.0, 0.0])))
    write(path / "good.csv", measured(99))
    (path / "no table.csv").write_bytes(b"\x89PNG\r\n\x00")
    return path


NAMED = {
    "pitch from the other end": ("pitch_reversed", "from the other end"),
    "spindle reversed": ("axis_map", "column y is -y"),
    "spindle reversed at one setting": ("spindle_reversed", "has the opposite sign at beta"),
    "settings exchanged": ("settings_exchanged", "are exchanged"),
    "setting mislabelled": ("mislabelled_setting", "was at 45 deg"),
    "time restarts": ("time_restarts", "restarts at position 1-5"),
    "temperature in kelvin": ("temperature_unit", "are in kelvin"),
    "angle columns exchanged": ("angles_exchanged", "beta_deg are exchanged"),
    "spindle from another hole": ("index_offset", "from the recorded angles at beta"),
    "spindle turned back": ("spindle_reversed", "are in reverse order at"),
    "readings a row late": ("rows_shifted", "are one row late"),
    "a reading left out": ("rows_shifted", "on are one row early"),
    "sign lost at one setting": ("axis_map", "has the wrong sign at beta"),
    "sign lost from some row on": ("axis_map", "has the wrong sign from position"),
    "columns exchanged at one setting": ("axis_map", "are exchanged at beta"),
    "decimal point lost": ("decimal_slip", "its decimal point is misplaced"),
    "some rows in another unit": ("unit_error", "in m/s^2"),
    "triad turned in its fixture": ("index_offset", "the triad is turned"),
}
REFUSED = {
    "dead axis": "at every position (it varies by 0 g",
    "doubled channel": "a channel or a column was used twice",
    "counts labelled g": "If they are counts, divide them by the counts per g",
    "code for a missing reading": "impossible at rest (perhaps a code for a missing reading)",
    "clipped": "it is clipped at the end of its range",
    "logger stuck": "have identical readings at different attitudes",
}


# Slips that leave the same data at 0, 45 and 90 deg.
SAME = {"pitch from the other end": "settings_exchanged", "spindle reversed": "spindle_reversed"}
SAME |= {"triad turned in its fixture": "triad_turned"}


@pytest.mark.long
@pytest.mark.parametrize("catalogue", ["few_effects", pytest.param("tmp_path", marks=pytest.mark.long)])
def test_mistakes_are_named_or_refused_and_stop_no_other_file(tumblecal, folder, tmp_path, request, catalogue):
    """Among few effects, and among all."""
    request.getfixturevalue(catalogue)
    listed = dict.fromkeys((*MISTAKES, *NAMED, *IMPLAUSIBLE, "good"))
    files = [folder / "no table.csv", *(folder / f"{name}.csv" for name in listed)]
    outcome = tumblecal("diagnose", *files, "--out", tmp_path / "out")
    assert outcome.code == 2 and len(outcome.lines) == 1 + len(REFUSED)
    rows = {row["file"]: row for row in pl.read_csv(tmp_path / "out" / "summary.csv").rows(named=True)}
    assert list(rows) == [str(file) for file in files]
    assert rows[str(folder / "good.csv")]["verdict"] == "adequate"
    assert rows[str(folder / "no table.csv")]["verdict"] == "refused"
    for name, words in REFUSED.items():
        row = rows[str(folder / f"{name}.csv")]
        assert row["verdict"] == "refused" and words in row["fault"], row
    for name, (label, words) in NAMED.items():
        row = rows[str(folder / f"{name}.csv")]
        assert row["verdict"] == "identified" and row["causes"].split(" + ") == [label], row
        assert words.lower() in said(tmp_path / "out" / name)
        # Put right, they are as good as any.
        assert row["sigma_g"] < 1.4 * blind.SIGMA
    for name, label in SAME.items():
        (slip,) = json.loads((tmp_path / "out" / name / "diagnosis.json").read_text())["set_up"]
        assert [equal["id"] for equal in slip["equal"]] == [label]
        assert slip["equal"][0]["words"].lower() in said(tmp_path / "out" / name)
    for name in IMPLAUSIBLE:
        record = json.loads((tmp_path / "out" / name / "diagnosis.json").read_text())
        assert [entry["parameter"] for entry in record["implausible"]] == [name] and record["verdict"] == "unexplained"
        assert record["text"].startswith("UNEXPLAINED Implausible parameter values") and record["use"]["answer"] == "no"
        assert record["findings"][0]["words"].startswith(f"{name} = ")


def said(folder) -> str:
    """The verdict's words, whatever their lines and capitals."""
    return " ".join((folder / "verdict.txt").read_text().lower().split())


@pytest.mark.usefixtures("few_effects")
def test_calibrate_looks_for_mistakes_before_it_fits(tumblecal, folder, tmp_path):
    """What it depends on is refused in a line, with nothing written; what it does not is said."""
    out = tmp_path / "out"
    for name, words in (REFUSED | {name: words for name, (_, words) in NAMED.items()}).items():
        outcome = tumblecal("calibrate", folder / f"{name}.csv", "--no-figures", "--out", out)
        if name in ("time restarts", "temperature in kelvin"):
            assert (
                outcome.code == 0
                and "corrected in this calibration" in " ".join(outcome.out.split())
                and words.split()[0] in outcome.out
            )
            assert json.loads((out / "result.json").read_text())["set_up"][0]["id"] == NAMED[name][0]
            shutil.rmtree(out)
            continue
        assert outcome.code == 2 and len(outcome.lines) == 1 and not out.exists()
        assert words in outcome.lines[0] or "the readings' norm is about" in outcome.lines[0]


@pytest.mark.long
@pytest.mark.usefixtures("few_effects")
def test_readings_far_from_any_fit_are_no_adequate_set_unless_its_rig_says_so(tumblecal, folder, configs, tmp_path):
    """Their noise unknown, they were: 50 mg from position to position contradict nothing."""
    columns, data, rng = measured(7), tmp_path / "far.csv", np.random.default_rng(7)
    far = {name: columns[name] + 0.05 * rng.normal(size=24) for name in ("ax_g", "ay_g", "az_g")}
    write(data, {name: values for name, values in (columns | far).items() if "_sd_" not in name})
    assert tumblecal("diagnose", data, "--out", tmp_path / "out").code == 0
    record = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert record["verdict"] == "unexplained" and "scatter" in [entry["parameter"] for entry in record["implausible"]]
    rig, text = tmp_path / "rig.toml", (configs / "paper24.toml").read_text()
    rig.write_text(text + '\n[usual]\nscatter = "0.2 g"\nbias = "0.9 g"\n')
    assert "scatter = " not in tumblecal("diagnose", data, "--rig", rig, "--out", tmp_path / "other").out
    command = ["diagnose", folder / "bias_y.csv", folder / "dK_z.csv", "--rig", rig, "--noise-sd", "0.1mg"]
    assert tumblecal(*command, "--out", tmp_path / "two").code == 0
    assert pl.read_csv(tmp_path / "two" / "summary.csv")["verdict"].to_list() == ["adequate", "unexplained"]
    for line, words in (
        ("beta = '0.6 g'", "usual.beta: no such"),
        ("scatter = '-3 mg'", "usual.scatter: '-3 mg': must be above 0"),
    ):
        rig.write_text(f"{text}\n[usual]\n{line}\n")
        assert words in tumblecal(*command, "--out", tmp_path / "none").lines[-1]
