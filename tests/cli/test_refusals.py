"""Bad input: exit code 2, one line a fault with file, line and column, no traceback, nothing written."""

import shlex
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest


pytestmark = pytest.mark.usefixtures("few_effects")
HERE = Path(__file__).parents[2]
_EFFECT = "from tumblecal.effects import *\nA = dict(typical=1.0, physics='p', cause='c')\nEFFECTS = "
_OUTPUT = _EFFECT + "[output_effect('{id}', 'x', {term}, unit='{unit}', **A{more})]\n"
_POSITIONS = "position,alpha_deg,beta_deg,ax_g,ay_g,az_g\na,0,0,0.01,0.02,1.0\nb,90,0,0.01,1.0,0.02\n"
_INPUT = 'schema = "tumblecal.budget/1"\n[considered.a]\n'
_DEEP = "[" * 100_000


def _effect(term: str, id: str = "my.x", unit: str = "mg", more: str = "") -> str:
    return _OUTPUT.format(id=id, term=term, unit=unit, more=more)


def _rig(old: str, new: str) -> str:
    return (HERE / "configs/paper24.toml").read_text().replace(old, new)


def _budget(*lines: str) -> str:
    return _INPUT + "\n".join(lines)


_U = "lambda u, w: u[0]"
# File and its text; the command; what its message contains.
REFUSED: dict[str, tuple[str | bytes, str, str]] = {
    "effects: not Python": ("EFFECTS = [\n", "effects --effects f.py", "f.py:line 1: not Python"),
    "effects: no list": ("a = 1\n", "effects --effects f.py", "no list EFFECTS"),
    "effects: a number": ("EFFECTS = 3\n", "effects --effects f.py", "line 1: EFFECTS is a int"),
    "effects: an entry": ("EFFECTS = [3]\n", "effects --effects f.py", "entry 1 of EFFECTS is a int"),
    "effects: no file": ("", "effects --effects g.py", "g.py: no such file"),
    "effects: no Python file": ("", "effects --effects f.txt", "its name must end in .py"),
    "effects: no text": (b"\xff\xfe\x00", "effects --effects f.py", "not text in UTF-8"),
    "effects: fails": ("1 / 0\n", "effects --effects f.py", "line 1: ZeroDivisionError"),
    "effects: id of two words": (_effect(_U, "my x"), "effects --effects f.py", "must be one word"),
    "effects: id exists": (_effect(_U, "bias_drift.x"), "effects --effects f.py", "exists already"),
    "effects: unknown column": (_effect(_U, more=", needs=('moon',)"), "effects --effects f.py", "columns in needs: moon"),
    "effects: unit": (_effect(_U, unit="parsec"), "effects --effects f.py", "parsec"),
    "effects: column not listed": (_effect("lambda u, w: w.time_s"), "effects --effects f.py", "add one of time_s"),
    "effects: half forms": (
        _effect(f"({_U}, lambda u, w: u[1])", more=", components=('a', 'b'), forms=({},)"),
        "effects --effects f.py", "1 form for 2 coefficients",
    ),
    "effects: no link": (
        f"{_EFFECT}[output_effect('my.x', 'x', {_U}, unit='mg', **A).__class__(id='my.x', make=None, unit='mg', **A)]\n",
        "effects --effects f.py", "f.py:line",
    ),
    "budget: fitted": (_budget('what = "bias"', 'size = "1 mg"'), "budget t.csv f.toml", "bias is fitted"),
    "budget: size 0": (_budget('what = "base_levelling"', 'size = "0 deg"'), "budget t.csv f.toml", "must be above 0"),
    "budget: implausible": (_budget('what = "base_levelling"', 'size = "1e9 deg"'), "budget t.csv f.toml", "implausible"),
    "budget: unknown": (_budget('what = "base_leveling"', 'size = "1 deg"'), "budget t.csv f.toml", "base_levelling"),
    "budget: twice": (
        _budget(*('what = "base_levelling"', 'size = "1 deg"', "[considered.b]", 'what = "base_levelling"', 'size = "2 deg"')),
        "budget t.csv f.toml", "stated twice",
    ),
    "positions: a folder": ("", "calibrate .", ".: a folder; give a file"),
    "positions: empty": ("", "calibrate f.csv", "the file is empty"),
    "positions: zero byte": (b"position,a\x00lpha_deg\n", "calibrate f.csv", "f.csv:line 1"),
    "positions: HTML": ("<!DOCTYPE html><html></html>", "calibrate f.csv", "this is HTML or XML"),
    "positions: attitudes": ("# attitudes: perhaps\n" + _POSITIONS, "calibrate f.csv", "comment attitudes: 'perhaps'"),
    "positions: no unit": (_POSITIONS.replace("ax_g", "ax"), "calibrate f.csv", "its unit is unknown"),
    "positions: column without a name": (
        _POSITIONS.replace("az_g", "az_g,").replace("2\n", "2,3\n").replace("1.0\n", "1.0,3\n"),
        "calibrate f.csv", "possible names",
    ),
    "positions: sd in one file": (
        _POSITIONS.replace("az_g", "az_g,ax_sd_g,ay_sd_g,az_sd_g").replace("1.0\n", "1.0,1,1,1\n").replace("2\n", "2,1,1,1\n"),
        "calibrate --join f.csv t.csv", "no sd columns, but other files have them",
    ),
    "positions: gravity differs": (
        "# gravity_ms2: 9.79\n" + _POSITIONS, "calibrate --join f.csv g.csv", "one g differs between these files",
    ),
    "rig: a large number": (_rig("count = 8", "count = 1e300"), "simulate f.toml --out s.csv", "f.toml:line 6"),
    "rig: control character": (_rig("24 positions", "24\\u0007"), "simulate f.toml --out s.csv", "control characters"),
    "rig: deep": (f"a = {_DEEP}", "simulate f.toml --out s.csv", "nested too deeply"),
    "rig: temperature": (
        _rig("[noise]", "[temperature.moon]\nknots_degc = [0, 1]\n[noise]"), "simulate f.toml --out s.csv", "temperature",
    ),
    "json: deep": (_DEEP, "apply f.json t.csv", "nested too deeply"),
    "json: a long integer": ('{"a": ' + "9" * 5000 + "}", "apply f.json t.csv", "not JSON"),
    "json: a key twice": ('{"a": 1, "a": 2}', "apply f.json t.csv", "given twice in one object"),
    "raw: two units": ("ax_g,ay_g,az_g,ax_mg\n1,2,3,4\n", "apply c.json f.csv", "the readings are in two units"),
    "raw: different units": ("ax_g,ay_mg,az_g\n1,2,3\n", "apply c.json f.csv", "f.csv: ax_g, ay_mg, az_g"),
    "raw: no axes": ("a,b,c\n1,2,3\n", "apply c.json f.csv", "f.csv"),
    "raw: impossible": ("ax_g,ay_g,az_g\n1,2,3e7\n", "apply c.json f.csv", "f.csv:line 2"),
    "raw: no Parquet": ("PAR1", "apply c.json f.parquet", "f.parquet"),
    "history: a folder": ("", "history .", ".: a folder; give a file"),
    "history: no file": ("", "history lab.db", "no such history; create it by calibrate"),
    "history: other database": ("", "history other.db", "not a history of tumblecal"),
    "history: other version": ("", "history older.db", "written by a different version"),
    "history: text": ("x" * 2000, "history f.db", "not a history"),
    "history: check of a unit": ("", "history h.db paper --check", "--check tests the whole file"),
    "history: limits of all": ("", "history h.db --limit bias=1mg", "are for one unit"),
    "history: no files": ("", "history h.db paper --files 1", "has no such files"),
    "history: files of nothing": ("", "history h.db paper --files 9 --out o", "not a result of unit paper"),
    "diagnose: two noises": ("", "diagnose t.csv --samples s.csv --noise-sd 1mg", "both state the noise"),
    "diagnose: samples of two": ("", "diagnose t.csv g.csv --samples s.csv", "--samples is for one position file"),
    "sniff: nothing": (b"", "sniff f.bin", "the file is empty"),
    "sniff: unknown": (bytes(range(256)) * 9, "sniff f.bin", "unknown protocol"),
    "a value with a sign": ("", "calibrate t.csv --noise-sd -1mg", "is written --option=-1mg"),
    "control characters": ("", "calibrate 'a\nb'", "has control characters; rename it"),
}  # fmt: skip


def _database(path: Path, application: int, version: int) -> None:
    with sqlite3.connect(path) as database:
        database.execute(f"PRAGMA application_id = {application}")
        database.execute(f"PRAGMA user_version = {version}")
        database.execute("CREATE TABLE a (b)")
    database.close()


@pytest.fixture
def inputs(tumblecal, tmp_path, monkeypatch, table1_file) -> Callable[[str], None]:
    """Valid files for the commands of the table."""
    monkeypatch.chdir(tmp_path)

    def write(line: str) -> None:
        (tmp_path / "t.csv").write_bytes(table1_file.read_bytes())
        (tmp_path / "g.csv").write_text("# gravity_ms2: 9.81\n" + _POSITIONS)
        if "c.json" in line:
            from tumblecal.data.calibration import Calibration, write_calibration

            write_calibration(Path("c.json"), Calibration(*_ideal()))
        if ".db" in line:
            tumblecal("history", "h.db", "--example")
            with sqlite3.connect("h.db") as database:
                application = database.execute("PRAGMA application_id").fetchone()[0]
            database.close()
            _database(Path("other.db"), 3, 1)
            _database(Path("older.db"), application, 999)

    return write


def _ideal():
    import numpy as np

    return np.eye(3), np.zeros(3), np.zeros((12, 12))


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_in_a_line_a_fault_and_nothing_is_written(tumblecal, tmp_path, inputs, name):
    text, line, says = REFUSED[name]
    inputs(line)
    for word in shlex.split(line):
        if word.startswith("f.") and text:
            Path(word).write_bytes(text if isinstance(text, bytes) else text.encode())
        elif word == "f.csv" or word == "f.bin":
            Path(word).touch()
    before = {path.name for path in tmp_path.iterdir()}
    outcome = tumblecal(*shlex.split(line))
    assert outcome.code == 2 and says in " ".join(outcome.lines), outcome
    assert all(words.startswith("tumblecal: ") for words in outcome.lines)
    assert {path.name for path in tmp_path.iterdir()} == before


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
