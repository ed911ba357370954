"""Bad input: exit code 2, one line a fault with file, line and column, no traceback, nothing written."""

import json
import shlex
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest


pytestmark = pytest.mark.usefixtures("few_effects")
CONFIGS = Path(__file__).parents[2] / "configs"
_EFFECT = "from tumblecal.effects import *\nA = dict(typical=1.0, physics='p', cause='c')\nEFFECTS = "
_OUTPUT = _EFFECT + "[output_effect('{id}', 'x', {term}, unit='{unit}', **A{more})]\n"
_POSITIONS = "position,alpha_deg,beta_deg,ax_g,ay_g,az_g\na,0,0,0.01,0.02,1.0\nb,90,0,0.01,1.0,0.02\n"
_INPUT = 'schema = "tumblecal.budget/1"\n[considered.a]\n'
_DEEP = "[" * 100_000


def _effect(term: str, id: str = "my.x", unit: str = "mg", more: str = "") -> str:
    return _OUTPUT.format(id=id, term=term, unit=unit, more=more)


def _rig(old: str, new: str) -> str:
    return (CONFIGS / "paper24.toml").read_text().replace(old, new)


def _budget(*lines: str) -> str:
    return _INPUT + "\n".join(lines)


_U = "lambda u, w: u[0]"
_LISTED, _BUDGETED = "effects --effects f.py", "budget good.csv f.toml --noise-sd 1mg"
# File and its text; the command; what its message contains.
REFUSED: dict[str, tuple[str | bytes, str, str]] = {
    "effects: not Python": ("EFFECTS = [\n", _LISTED, "f.py:line 1: not Python"),
    "effects: no list": ("a = 1\n", _LISTED, "no list EFFECTS"),
    "effects: a number": ("EFFECTS = 3\n", _LISTED, "line 1: EFFECTS is a int"),
    "effects: an entry": ("EFFECTS = [3]\n", _LISTED, "entry 1 of EFFECTS is a int"),
    "effects: no file": ("", "effects --effects g.py", "g.py: no such file"),
    "effects: no Python file": ("", "effects --effects f.txt", "its name must end in .py"),
    "effects: no text": (b"\xff\xfe\x00", _LISTED, "not text in UTF-8"),
    "effects: fails": ("1 / 0\n", _LISTED, "line 1: ZeroDivisionError"),
    "effects: id of two words": (_effect(_U, "my x"), _LISTED, "must be one word"),
    "effects: id exists": (_effect(_U, "bias_drift.x"), _LISTED, "exists already"),
    "effects: unknown column": (_effect(_U, more=", needs=('moon',)"), _LISTED, "columns in needs: moon"),
    "effects: unit": (_effect(_U, unit="parsec"), _LISTED, "parsec"),
    "effects: column not listed": (_effect("lambda u, w: w.time_s"), _LISTED, "add one of time_s"),
    "effects: half forms": (
        _effect(f"({_U}, lambda u, w: u[1])", more=", components=('a', 'b'), forms=({},)"),
        _LISTED, "1 form for 2 coefficients",
    ),
    "effects: no link": (
        f"{_EFFECT}[output_effect('my.x', 'x', {_U}, unit='mg', **A).__class__(id='my.x', make=None, unit='mg', **A)]\n",
        _LISTED, "f.py:line",
    ),
    "effects: no module": ("import no_such_module\n", _LISTED, "f.py:line 1: ModuleNotFoundError"),
    "effects: id of the model": (_effect(_U, "dK"), _LISTED, "the coefficient's name 'dK' exists already"),
    "effects: axis": (_effect(_U).replace("'x'", "'w'"), _LISTED, "axis 'w' is not one of x, y, z"),
    "effects: argument missing": (_effect(_U).replace(", unit='mg'", ""), _LISTED, "f.py:line 3: TypeError"),
    "effects: raises": (_effect("lambda u, w: u[7]"), _LISTED, "f.py:line 3: effect 'my.x': IndexError"),
    "effects: branches": (_effect("lambda u, w: u[1] if u[1][0] > 0 else 0"), _LISTED, "'my.x': Tracer"),
    "effects: shape": (_effect("lambda u, w: u[0][:2]"), _LISTED, "f.py:line 3: effect 'my.x': TypeError"),
    "effects: not a number": (_effect("lambda u, w: u[1] ** 0.5"), _LISTED, "it gives no finite value or derivative at alpha"),
    "budget: few trials": (
        _budget('what = "base_levelling"', 'size = "1 deg"'), f"{_BUDGETED} --monte-carlo 3", "at least 100",
    ),
    "budget: two quantities": (_budget('what = "x"', 'adds_to = "bias"', 'size = "1 mg"'), _BUDGETED, "considered.a"),
    "budget: half a degree of freedom": (
        _budget('what = "gravity_value"', 'size = "1 ppm"', "dof = 0.1"), "budget good.csv f.toml", "considered.a.dof: ",
    ),
    "budget: fitted": (_budget('what = "bias"', 'size = "1 mg"'), _BUDGETED, "bias is fitted"),
    "budget: size 0": (_budget('what = "base_levelling"', 'size = "0 deg"'), _BUDGETED, "must be above 0"),
    "budget: implausible": (_budget('what = "base_levelling"', 'size = "1e9 deg"'), _BUDGETED, "implausible"),
    "budget: unknown": (_budget('what = "base_leveling"', 'size = "1 deg"'), _BUDGETED, "base_levelling"),
    "budget: twice": (
        _budget(*('what = "base_levelling"', 'size = "1 deg"', "[considered.b]", 'what = "base_levelling"', 'size = "2 deg"')),
        _BUDGETED, "stated twice",
    ),
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
        "calibrate --join f.csv good.csv", "no sd columns, but other files have them",
    ),
    "positions: gravity differs": (
        "# gravity_ms2: 9.79\n" + _POSITIONS, "calibrate --join f.csv g.csv", "one g differs between these files",
    ),
    "rig: a large number": (_rig("count = 8", "count = 1e300"), "simulate f.toml --out s.csv", "f.toml:line 6"),
    "rig: control character": (_rig("24 positions", "24\\u0007"), "simulate f.toml --out s.csv", "control characters"),
    "rig: no TOML": ("schema = [", "simulate f.toml --out s.csv", "not TOML"),
    "rig: no schema": ("[plan]\nalpha_deg = [0]\nbeta_deg = [0]\n", "simulate f.toml --out s.csv", "schema: is missing"),
    "rig: half a plan": (
        'schema = "tumblecal.rig/1"\n[plan]\nalpha_deg = [0]\n', "simulate f.toml --out s.csv", "give either alpha_deg and",
    ),
    "rig: deep": (f"a = {_DEEP}", "simulate f.toml --out s.csv", "nested too deeply"),
    "rig: temperature": (
        _rig("[noise]", "[temperature.moon]\nknots_degc = [0, 1]\n[noise]"), "simulate f.toml --out s.csv", "temperature",
    ),
    "json: deep": (_DEEP, "apply f.json good.csv", "nested too deeply"),
    "json: a long integer": ('{"a": ' + "9" * 5000 + "}", "apply f.json good.csv", "not JSON"),
    "json: a key twice": ('{"a": 1, "a": 2}', "apply f.json good.csv", "given twice in one object"),
    "raw: two units": ("ax_g,ay_g,az_g,ax_mg\n1,2,3,4\n", "apply cal.json f.csv", "the readings are in two units"),
    "raw: different units": ("ax_g,ay_mg,az_g\n1,2,3\n", "apply cal.json f.csv", "f.csv: ax_g, ay_mg, az_g"),
    "raw: no axes": ("a,b,c\n1,2,3\n", "apply cal.json f.csv", "f.csv"),
    "raw: impossible": ("ax_g,ay_g,az_g\n1,2,3e7\n", "apply cal.json f.csv", "f.csv:line 2"),
    "raw: no Parquet": ("PAR1", "apply cal.json f.parquet", "f.parquet"),
    "history: a folder": ("", "history .", ".: a folder; give a file"),
    "history: other database": ("", "history other.db", "not a history of tumblecal"),
    "history: other version": ("", "history older.db", "written by a different version"),
    "history: text": ("x" * 2000, "history f.db", "not a history"),
    "history: check of a unit": ("", "history h.db paper --check", "--check tests the whole file"),
    "history: limits of all": ("", "history h.db --limit bias=1mg", "are for one unit"),
    "history: no files": ("", "history h.db paper --files 1", "has no such files"),
    "history: no such result": ("", "history h.db --files 99 --out o", "no such files"),
    "history: files of nothing": ("", "history h.db paper --files 9 --out o", "not a result of unit paper"),
    "diagnose: two noises": ("", "diagnose good.csv --samples s.csv --noise-sd 1mg", "both state the noise"),
    "diagnose: samples of two": ("", "diagnose good.csv g.csv --samples s.csv", "--samples is for one position file"),
    "import: ULog": (b"ULog\x01\x12\x35\x01" + bytes(range(256)) * 8, "import f.ulg --out x.csv", "f.ulg: "),
    "import: ROS bag": (b"#ROSBAG V2.0\n" + bytes(range(256)) * 8, "import f.bag --out x.csv", "f.bag: "),
    "import: Parquet": (b"PAR1" + bytes(range(256)) * 8, "import f.parquet --out x.csv", "f.parquet: not a complete Parquet"),
    "import: PDF": (b"%PDF-1.7\n" + bytes(99), "import f.pdf --out x.csv", "f.pdf: this is a PDF"),
    "decode: nothing": (b"", "decode f.bin --out x.csv", "is empty"),
    "decode: noise": (bytes(range(256)) * 20, "decode f.bin --out x.csv", "no protocol fits these bytes"),
    "decode: into a text": (b"x", "decode f.bin --out x.txt", "must end in .csv or .parquet"),
    "sniff: nothing": (b"", "sniff f.bin", "the file is empty"),
    "sniff: unknown": (bytes(range(256)) * 9, "sniff f.bin", "unknown protocol in the first megabyte"),
    "a value with a sign": ("", "calibrate good.csv --noise-sd -1mg", "is written --option=-1mg"),
    "control characters": ("", "calibrate 'a\nb'", "has control characters; rename it"),
}  # fmt: skip

HEADER = "position,alpha_deg,beta_deg,ax_g,ay_g,az_g"
ROWS = [
    f"{k}-{n},{a},{b},{x},{y},{z}"
    for k, (b, x, r) in enumerate(((0, 0, 1), (45, -0.70710678, 0.70710678), (90, -1, 0)))
    for n, (a, y, z) in enumerate(((0, 0, r), (90, r, 0), (180, 0, -r), (270, -r, 0)))
]
LAB = 'schema = "tumblecal.budget/1"\n[considered.a]\nwhat = "base_levelling"\nsize = "1 mrad"\n'


def calibration(**changed) -> str:
    content = {
        "schema": "tumblecal.calibration/1",
        "matrix": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        "bias": [0, 0, 0],
        "covariance": [[1e-12 * (i == k) for k in range(12)] for i in range(12)],
        "serial_number": "A1",
    }
    return json.dumps(content | changed)


def scaled(*factors: float) -> str:
    """The readings of each axis times its factor."""
    rows = (row.split(",") for row in ROWS)
    scaled = ([*r[:3], *(repr(float(v) * factor) for v, factor in zip(r[3:], factors, strict=True))] for r in rows)
    return "\n".join((HEADER, *map(",".join, scaled))) + "\n"


# Files that several commands are given.
FILES = {
    "unspoken.toml": '[port]\nprotocol = "stim"\nurl = "imu"\n[positions]\nalpha_deg = [0]\nbeta_deg = [0]\n',
    "head.toml": (CONFIGS / "plan_head.toml").read_text(),
    "good.csv": "\n".join((HEADER, *ROWS)) + "\n",
    "result.json": "\n".join((HEADER, *ROWS)) + "\n",
    "sheet.xlsx": b"PK\x03\x04\x14\x00\x06\x00\x08",
    "parquet.csv": b"PAR1\x15\x04",
    "utf16.csv": "\n".join((HEADER, *ROWS)).encode("utf-16-le"),
    "latin.csv": "\n".join((HEADER.replace("alpha_deg", "alpha °"), *ROWS)).encode("latin-1"),
    "counts.csv": scaled(16384.0, 16384.0, 16384.0),
    "gravity.csv": "# gravity_ms2: 3.7\n" + "\n".join((HEADER, *ROWS)),
    "zero_sd.csv": HEADER
    + ",ax_sd_g,ay_sd_g,az_sd_g\n"
    + "\n".join(f"{row},{int(k > 0)},1,1" for k, row in enumerate(ROWS)),
    "radians.csv": "\n".join([HEADER, "a,0,0,0,0,1", "b,1.5708,0,0,1,0", "c,3.1416,0,0,0,-1", "d,0,1.5708,-1,0,0"]),
    "one_setting.csv": "\n".join((HEADER, *ROWS[:4])),
    "few.csv": "\n".join((HEADER, ROWS[0], ROWS[1], ROWS[4], ROWS[8])),
    "flipped.csv": scaled(1.0, 1.0, -1.0),
    "samples.csv": "\n".join((HEADER, *(row for row in ROWS for _ in range(20)))),
    "cal.json": calibration(),
    "short.json": calibration(bias=[0, 0]),
    "g.csv": "# gravity_ms2: 9.81\n" + _POSITIONS,
    "log.csv": "# serial_number: B2\nax_g,ay_g,az_g\n0,0,1\n",
    "corrected.csv": "# corrected_by: cal.json\nax_g,ay_g,az_g\n0,0,1\n",
    "plan.toml": "[positions\n",
    "lab.toml": LAB,
    "misspelt.toml": LAB.replace("size", "sise"),
    "daily.toml": LAB + 'per = "day"\n',
    "nothing.toml": 'schema = "tumblecal.budget/1"\n',
    "backwards.toml": "[positions]\nalpha_deg = [0, 90]\nbeta_deg = [0]\n[dwell]\nseconds = -1\n",
    "params.txt": "CAL_ACC0_XOFF 0.1\n",
    "short.csv": "time_s,ax_g,ay_g,az_g\n" + "\n".join(f"{k / 100},0,0,1" for k in range(50)) + "\n",
    "junk.bin": bytes(range(256)) * 20,
}
# The command, which is given no file of its own; what its message contains.
MISTAKES = {
    "no command of that name": ("calibrat good.csv", 'Unknown command "calibrat". Did you mean "calibrate"?'),
    "a folder": ("calibrate .", ".: a folder; give a file of positions"),
    "a calibration for a head": ("calibrate good.csv --head cal.json", "cal.json: this is JSON, not TOML"),
    "missing file": ("calibrate none.csv", "none.csv: no such file"),
    "unknown option": ("calibrate good.csv --nose-sd 1mg", "Unknown option: --nose-sd"),
    "option without value": ("calibrate good.csv --noise-sd", "--noise-sd requires an argument"),
    "negative noise written so": ("calibrate good.csv --noise-sd=-0.1mg", "must be above 0"),
    "noise without unit": ("calibrate good.csv --noise-sd 0.1", "'0.1' has no unit"),
    "no gravity": ("calibrate good.csv --gravity 3.7", "--gravity 3.7: 3.7 is not a gravity"),
    "noise with a decimal comma": ("calibrate good.csv --noise-sd 0,1mg", "'0,1mg' has a decimal comma; write '0.1mg'"),
    "columns that are not there": ("calibrate good.csv --columns ax_g=AccX", "column AccX (--columns ax_g=AccX) is mi"),
    "one column for two axes": (
        "calibrate good.csv --columns ax_g=ax_g,ay_g=ax_g,az_g=az_g",
        "--columns ay_g=ax_g: column ax_g is ax_g already; name a different column for each quantity",
    ),
    "columns that are no list": (
        "calibrate good.csv --columns AccX",
        "--columns AccX: write pairs such as ax_g=AccX",
    ),
    "prior without a size": (
        "calibrate good.csv --prior dbeta",
        "--prior dbeta: write pairs such as 'dbeta=3 arcmin'",
    ),
    "one run of one file": ("calibrate good.csv --same-run", "--same-run is for joined files only; add --join"),
    "a pause of one file": ("calibrate good.csv --pause 2h", "--pause is for joined files only; add --join"),
    "simulated as a text": ("simulate head.toml --out x.txt", "x.txt: must end in .csv or .parquet"),
    "simulated in any noise": ("simulate head.toml --noise-sd x --out x.csv", "--noise-sd: 'x'"),
    "corrected as a text": ("apply cal.json good.csv --out x.txt", "x.txt: must end in .csv or .parquet"),
    "a plan of nothing": (
        "plan head.toml --positions 0 --out x",
        "--positions. Must be >= 1; see tumblecal plan --help",
    ),
    "a criterion of a word": (
        "plan head.toml --criterion worst=a --out x",
        "--criterion worst: 'a': write numbers, such as worst=1",
    ),
    "a criterion of no weight": ("plan head.toml --criterion worst=0 --out x", "a weight must be above 0; remove"),
    "parameters of no criterion": (
        "plan head.toml --criterion in_use --parameters bias --out x",
        "contradict each other",
    ),
    "an effect of no size": ("plan head.toml --effects second_order.z=0mg/g^2 --out x", "must be above 0"),
    "prior on nothing": ("calibrate good.csv --prior warp=1mrad", "--prior warp: no such parameter; parameters: "),
    "prior without noise": ("calibrate good.csv --prior dbeta=3arcmin", "a prior needs a stated noise"),
    "fixed nothing": ("calibrate good.csv --fix warp", "--fix warp: no such parameter"),
    "study not writable": ("reproduce --out /proc/study", "/proc/study: cannot write to this folder"),
    "quiet and JSON": ("calibrate good.csv -q --json", "contradict each other"),
    "an output over an input": ("calibrate result.json --out .", "result.json"),
    "spreadsheet": ("calibrate sheet.xlsx", "this is a spreadsheet (.xlsx, .ods)"),
    "Parquet called CSV": ("calibrate parquet.csv", "give it a name that ends in .parquet"),
    "UTF-16 that does not say so": ("calibrate utf16.csv", "text in UTF-16 without a byte order mark; save it as UTF-"),
    "Latin-1": ("calibrate latin.csv", "line 1: not text in UTF-8 (byte 0xb0: ° in Latin-1 or Windows-1252); save the"),
    "counts called g": ("calibrate counts.csv", "If they are counts, divide them by the counts per g"),
    "gravity of Mars": ("calibrate gravity.csv", "comment gravity_ms2: '3.7' is not a gravity"),
    "sd of nothing": ("calibrate zero_sd.csv", "standard deviation must be above 0"),
    "radians": ("calibrate radians.csv", "these look like radians; write degrees"),
    "fewer rows than parameters": ("calibrate few.csv", "15 parameters, but rank"),
    "one pitch setting": ("calibrate one_setting.csv", "cannot determine dK_x"),
    "axis turned round": ("calibrate flipped.csv", "flipped.csv: "),
    "raw samples": ("calibrate samples.csv", "so these look like raw samples. Reduce them first, then give reduced/po"),
    "means to be reduced": ("reduce good.csv", "A table of means needs no reduction: give it to calibrate"),
    "no calibration": ("apply good.csv good.csv", "not JSON"),
    "a bias too short": ("apply short.json good.csv", "bias: must have 3 or more entries, not 2"),
    "another unit's log": ("apply cal.json log.csv", "serial number B2, but cal.json is of A1"),
    "corrected twice": ("apply cal.json corrected.csv", "these data are corrected already"),
    "workers of none": ("diagnose good.csv --workers 0", "--workers. Must be >= 1"),
    "units and joined files": ("diagnose good.csv result.json --units --join", "--units treats each file as a differe"),
    "a calibration for a recording": (
        "check cal.json cal.json",
        "cal.json: this is a calibration, not a recording; give",
    ),
    "an example of no name": ("example papr24", "did you mean paper24?"),
    "a seed beyond 64 bits": ("reproduce --out study --seed 99999999999999999999", "seed"),
    "no criterion of that name": ("plan head.toml --criterion best --out x", "no 'best'; names: worst, mean"),
    "a criterion of no effects": ("plan head.toml --criterion naming --out x", "no effect is stated; add for example"),
    "a plan with an unknown mounting": (
        "plan head.toml --allow-mount A,C --out x",
        "--allow-mount: mounting 'C' is not in",
    ),
    "a plan at angles beyond the head": ("plan head.toml --allow-beta 0,120 --out x", "--allow-beta: 120 deg"),
    "a plan for an effect of nobody": (
        "plan head.toml --effects second_ordr.z=1mg/g^2 --out x",
        "did you mean second_order.z",
    ),
    "one unit alone": ("diagnose good.csv --units", "at least two units"),
    "angles that are none": ("diagnose good.csv --allow-alpha x", "'x' is not an angle"),
    "half a plan": ("capture plan.toml --out run", "plan.toml: not TOML"),
    "a protocol of nobody in a plan": ("capture unspoken.toml --out run", "unspoken.toml:line 2: port.protocol: proto"),
    "no noise at all": ("calibrate good.csv", "follow the model to rounding"),
    "nothing measured": ("diagnose good.csv --noise-sd 0.1mg", "computed, not measured"),
    "a calibration for positions": ("budget cal.json lab.toml", "cal.json: this is JSON, not a table"),
    "a recording of no format": ("import junk.bin --out x.csv", "junk.bin: no format recognises it"),
    "half a spreadsheet": ("import sheet.xlsx --out x.csv", "not a complete spreadsheet"),
    "too short to be still": ("reduce short.csv --static --out r", "50 samples are too few to find intervals at rest"),
    "a plan that runs backwards": ("reduce short.csv --plan backwards.toml --out r", "line 5: dwell.seconds: must be"),
    "an export at one temperature": ("export cal.json --to px4 --temperatures 60", "--temperatures 60: write LOW:HIGH"),
    "an export to the moon": ("export cal.json --to px4 --gravity 3", "is not a gravity"),
    "a run without its unit": ("export cal.json --to csv --run-time 30", "--run-time: '30' has no unit"),
    "a run of no time": ("export cal.json --to csv --run-time 0h", "--run-time: '0h': must be above 0"),
    "a recording that is missing": ("import none.csv --out x.csv", "none.csv: no such file or folder"),
    "a recording as a spreadsheet": ("import short.csv --out x.xls", "x.xls: must end in .csv or .parquet"),
    "bytes that are missing": ("decode none.bin --out x.csv", "cannot be read"),
    "an export to nothing": ("export cal.json --to px5", 'Did you mean "px4"?'),
    "an export over its input": ("export cal.json --to px4 --out cal.json", "would overwrite the input cal.json"),
    "noise of no recording": ("export cal.json --to kalibr --noise cal.json", "no noise of three axes"),
    "no history": ("history none.db", "no such history; create it by calibrate or diagnose with --history none.db"),
    "a folder of nothing": ("history lab.db --add none", "no result.json or diagnosis.json"),
    "a limit without its unit": ("history lab.db A-17 --limit bias=1", "--limit bias: '1' has no unit"),
    "a topic of a table": ("import short.csv --topic x --out x.csv", "no topic x; the file has a table without a name"),
    "half a parameter file": ("compare px4:params.txt cal.json", "params.txt: CAL_ACC0_YOFF is missing"),
    "a format of nobody": ("compare px5:params.txt cal.json", "no format 'px5'; formats: c-header"),
    "an empty budget": ("budget good.csv nothing.toml", "nothing.toml: considered: is missing"),
    "a budget's key misspelt": ("budget good.csv misspelt.toml", "considered.a.sise: unknown key; did you mean size?"),
    "a budget of computed readings": ("budget good.csv lab.toml", "the readings follow the model to rounding"),
    "an input for each day": ("budget good.csv daily.toml", "considered.a.per: must be 'position', 'pitch', 'run' or"),
    "a certificate of a file": ("certificate cal.json --admin lab.toml", "cal.json: a file; give the output folder"),
    "a certificate of nothing": ("certificate none --admin lab.toml", "lab.toml: schema is 'tumblecal.budget/1', not"),
    "a wait without end": ("capture plan.toml --out run --wait nan", "--wait. Must be <= 86400"),
    "a capture that is none": ("capture --resume none", "none: no journal.log here"),
    "a port that is none": ("sniff none", "port none: there is no such device"),
}
CASES = REFUSED | {name: ("", *row) for name, row in MISTAKES.items()}


def write_histories(tumblecal) -> None:
    """A history, a database of another program, and a history of another version."""
    tumblecal("history", "h.db", "--example")
    for name, changed in (("other.db", "application_id = 3"), ("older.db", "user_version = 999")):
        shutil.copyfile("h.db", name)
        with closing(sqlite3.connect(name)) as database:
            database.execute(f"PRAGMA {changed}")


@pytest.mark.parametrize("name", CASES)
def test_it_is_refused_in_a_line_a_fault_and_nothing_is_written(tumblecal, tmp_path, monkeypatch, name):
    text, line, says = CASES[name]
    monkeypatch.chdir(tmp_path)
    if ".db" in line:
        write_histories(tumblecal)
    words = line.replace(":", " ").split()
    for file, content in FILES.items() | {(word, text) for word in words if word.startswith("f.")}:
        if file in words:
            Path(file).write_bytes(content if isinstance(content, bytes) else content.encode())
    before = sorted(tmp_path.rglob("*"))
    outcome = tumblecal(*shlex.split(line))
    assert outcome.code == 2 and len(outcome.lines) == 1 and says in outcome.lines[0], outcome
    assert all(words.startswith("tumblecal: ") for words in outcome.lines)
    assert outcome.out == "" and sorted(tmp_path.rglob("*")) == before


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
