"""Bad input: exit code 2, one line a fault with file, line and column, no traceback, nothing written."""

import polars as pl
import pytest


HEADER = "position,alpha_deg,beta_deg,ax_g,ay_g,az_g"
GOOD = [
    f"{k}-{n},{a},{b},{x},{y},{z}"
    for k, (b, x, r) in enumerate(((0, 0, 1), (45, -0.70710678, 0.70710678), (90, -1, 0)))
    for n, (a, y, z) in enumerate(((0, 0, r), (90, r, 0), (180, 0, -r), (270, -r, 0)))
]


def table(header=HEADER, rows=GOOD) -> bytes:
    return "\n".join((header, *rows, "")).encode()


def changed(row: int, text: str) -> bytes:
    return table(rows=[*GOOD[:row], text, *GOOD[row + 1 :]])


CASES = {
    "missing column": (table(HEADER.replace("alpha", "alfa")), ":line 1: column alpha_deg is missing; add it"),
    "unknown column": (table(HEADER + ",temp", [row + ",20" for row in GOOD]), ":line 1, column temp: unknown column"),
    "two unit columns": (table(HEADER + ",az_mg", [row + ",1" for row in GOOD]), ":line 1: az_g and az_mg both give axis z"),
    "m/s^2 in g": (
        table(rows=["p,0,0,0,0,9.81", "q,90,0,0,9.81,0", "r,0,90,-9.81,0,0"]),
        "column ax_g, ay_g, az_g: the readings' norm is about 9.81, so they look like m/s^2; name the columns ax_ms2",
    ),
    "no number": (changed(3, "x,270,0,0,-1,zero"), ":line 5, column az_g: 'zero' is not a number; write one"),
    "NaN": (changed(0, "x,0,nan,0,0,1"), ":line 2, column beta_deg: 'nan' is not a finite number"),
    "far too large": (changed(0, "x,0,0,0,0,1e308"), ":line 2, column az_g: 1e+308 g is no reading"),
    "one pitch setting": (table(rows=GOOD[:4]), "cannot determine dK_x, bias_x"),
    "fewer rows than parameters": (table(rows=[GOOD[0], GOOD[1], GOOD[4], GOOD[8]]), "15 parameters, but rank"),
    "empty": (b"", ": the file is empty"),
    "binary": (b"\x89PNG\r\n\x1a\n\x00\xff", ":line 1: not text (byte 0x89)"),
    "header alone": (table(rows=[]), ": no rows below the header"),
}  # fmt: skip


@pytest.mark.parametrize(("content", "words"), CASES.values(), ids=CASES)
def test_bad_position_files(tumblecal, tmp_path, content, words):
    path = tmp_path / "data.csv"
    path.write_bytes(content)
    outcome = tumblecal("calibrate", path, "--out", tmp_path / "out")
    assert outcome.code == 2
    assert all(line.startswith(f"tumblecal: {path}") for line in outcome.lines)
    assert any(words in line for line in outcome.lines), outcome.lines
    assert list(tmp_path.iterdir()) == [path]


def test_good_rows_are_good(tumblecal, tmp_path):
    """The table that the cases spoil is itself accepted, and so are repeated positions."""
    path = tmp_path / "data.csv"
    path.write_bytes(table(rows=GOOD + GOOD))
    assert tumblecal("calibrate", path, "--no-figures", "--out", tmp_path / "out", "--noise-sd", "0.1mg").code == 0
    assert (tmp_path / "out" / "result.json").exists()


OPTIONS = {
    "no such file": (["calibrate", "none.csv"], "none.csv: no such file"),
    "noise without unit": (["calibrate", "{data}", "--noise-sd", "0.1"], "'0.1' has no unit"),
    "noise of nothing": (
        ["calibrate", "{data}", "--noise-sd", "0mg"],
        "--noise-sd: '0mg': a standard deviation must be above 0",
    ),
    "noise beyond any digits": (["calibrate", "{data}", "--noise-sd", "1e-16g"], "(1e-12 to 1e6 g)"),
    "noise without measure": (["diagnose", "{data}", "--noise-sd", "1e300g"], "(1e-12 to 1e6 g)"),
    "noise drawn below zero": (["simulate", "rig.toml", "--noise-sd=-1mg", "--out", "x.csv"], "--noise-sd: '-1mg'"),
    "prior without size": (["calibrate", "{data}", "--prior", "dbeta"], "write NAME=SIZE"),
    "prior on nothing": (["calibrate", "{data}", "--prior", "warp=1mrad"], "no parameter 'warp'"),
    "prior of another kind": (["calibrate", "{data}", "--prior", "dbeta=1mg"], "measure different things"),
    "prior without noise": (["calibrate", "{data}", "--prior", "dbeta=3arcmin"], "a prior needs the noise"),
    "fix of nothing": (["calibrate", "{data}", "--fix", "warp"], "--fix warp: no such parameter"),
    "no such rig": (["calibrate", "{data}", "--rig", "none.toml"], "none.toml: no such file"),
    "output in the way": (["calibrate", "{data}", "--out", "{data}/out"], "cannot write to this folder"),
    "study not writable": (["reproduce", "--out", "/proc/study"], "/proc/study: cannot write to this folder"),
    "not a calibration": (["apply", "{data}", "{data}"], "not JSON"),
    "no such config": (["simulate", "none.toml", "--out", "x.csv"], "none.toml: no such file"),
}


@pytest.mark.parametrize(("arguments", "words"), OPTIONS.values(), ids=OPTIONS)
def test_bad_options(tumblecal, tmp_path, monkeypatch, configs, arguments, words):
    data = tmp_path / "data.csv"
    data.write_bytes(table())
    rig = tmp_path / "rig.toml"
    rig.write_bytes((configs / "paper24.toml").read_bytes())
    monkeypatch.chdir(tmp_path)
    outcome = tumblecal(*(argument.format(data=data) for argument in arguments))
    assert outcome.code == 2
    assert len(outcome.lines) == 1 and words in outcome.lines[0], outcome.lines
    assert set(tmp_path.iterdir()) == {data, rig}


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


@pytest.mark.parametrize("sd", ["1e-12 g", "1e6 g"])
def test_noise_at_its_limits_is_weighed(tumblecal, tmp_path, table1_file, sd):
    outcome = tumblecal("calibrate", table1_file, "--noise-sd", sd, "--no-figures", "--out", tmp_path / "out")
    assert outcome.code == 0 and ("Kalman: not run: an sd of 1e-12 g" in outcome.out) == (sd == "1e-12 g")


def test_a_config_with_several_faults(tumblecal, tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text('schema = "tumblecal.rig/1"\n[plan]\nalpha_deg = ["x"]\nbeta_deg = [0]\n[noise]\nsd = 1\n[chian]\n')
    outcome = tumblecal("simulate", path, "--out", tmp_path / "x.csv")
    assert outcome.code == 2
    places = sorted(line.removeprefix(f"tumblecal: {path}:line ").rpartition(": ")[0] for line in outcome.lines)
    assert places == ["3: plan.alpha_deg.0", "6: noise.sd", "7: chian"]
    assert list(tmp_path.iterdir()) == [path]


def test_one_bad_file_among_several_stops_none_of_the_others(tumblecal, tmp_path, table1_file):
    bad = tmp_path / "bad.csv"
    bad.write_bytes(changed(2, "x,180,0,0,0,?"))
    table1_file.write_text("# serial_number: A17\n" + table1_file.read_text())
    outcome = tumblecal("calibrate", bad, table1_file, "--out", tmp_path / "out")
    fault = f"{bad}:line 4, column az_g: '?' is not a number; write one"
    assert outcome.code == 2 and outcome.lines == [f"tumblecal: {fault}"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["summary.csv", "table1"]
    summary = pl.read_csv(tmp_path / "out" / "summary.csv")
    assert summary["serial_number"].to_list() == [None, "A17"] and summary["fault"].to_list() == [fault, None]
    assert summary["judgement"][0] == "refused" and summary["dK_x"][1] == pytest.approx(0.3536e-3, abs=1e-7)


@pytest.mark.parametrize(
    "arguments", [["apply", "{calibration}", "{data}", "--out", "{folder}"], ["simulate", "{rig}", "--out", "{folder}"]]
)
def test_an_output_that_is_a_folder(tumblecal, tmp_path, configs, table1_file, arguments):
    assert tumblecal("calibrate", table1_file, "--no-figures", "--out", tmp_path / "out").code == 0
    folder = tmp_path / "folder"
    folder.mkdir()
    names = {
        "calibration": tmp_path / "out" / "calibration.json",
        "data": table1_file,
        "folder": folder,
        "rig": configs / "paper24.toml",
    }
    before = sorted(tmp_path.rglob("*"))
    outcome = tumblecal(*(argument.format(**names) for argument in arguments))
    assert outcome.code == 2 and len(outcome.lines) == 1 and str(folder) in outcome.lines[0]
    assert sorted(tmp_path.rglob("*")) == before


def test_raw_data_are_not_overwritten(tumblecal, tmp_path, table1_file):
    assert tumblecal("calibrate", table1_file, "--no-figures", "--out", tmp_path / "out").code == 0
    before = table1_file.read_bytes()
    outcome = tumblecal("apply", tmp_path / "out" / "calibration.json", table1_file, "--out", table1_file)
    assert outcome.code == 2 and "which is an input" in outcome.lines[0]
    assert table1_file.read_bytes() == before
