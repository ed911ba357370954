"""What people do wrong in the first hour: one line each, exit code 2, nothing written."""

import gzip
import json
import re
from pathlib import Path

import pytest


HEADER = "position,alpha_deg,beta_deg,ax_g,ay_g,az_g"
ROWS = [
    f"{k}-{n},{a},{b},{x},{y},{z}"
    for k, (b, x, r) in enumerate(((0, 0, 1), (45, -0.70710678, 0.70710678), (90, -1, 0)))
    for n, (a, y, z) in enumerate(((0, 0, r), (90, r, 0), (180, 0, -r), (270, -r, 0)))
]
SCHEMA = '"schema": "tumblecal.calibration/1"'
LAB = 'schema = "tumblecal.budget/1"\n[considered.a]\nwhat = "base_levelling"\nsize = "1 mrad"\n'
UNIT = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]


def calibration(**changed) -> str:
    content = {
        "schema": "tumblecal.calibration/1",
        "matrix": UNIT,
        "bias": [0, 0, 0],
        "covariance": [[1e-12 * (i == k) for k in range(12)] for i in range(12)],
        "serial_number": "A1",
    }
    return json.dumps(content | changed)


def with_row(row: int, text: str) -> str:
    return "\n".join((HEADER, *ROWS[:row], text, *ROWS[row + 1 :])) + "\n"


def scaled(factor: float) -> str:
    rows = (row.split(",") for row in ROWS)
    return "\n".join((HEADER, *(",".join([*r[:3], *(repr(float(v) * factor) for v in r[3:])]) for r in rows))) + "\n"


def read_other_way(*order: int, sign: float = 1.0) -> str:
    """The axes' columns exchanged, or one of them turned round."""
    rows = (row.split(",") for row in ROWS)
    axes = ([r[3 + order[0]], r[3 + order[1]], repr(sign * float(r[3 + order[2]]))] for r in map(list, rows))
    return (
        "\n".join((HEADER, *(",".join([*row.split(",")[:3], *own]) for row, own in zip(ROWS, axes, strict=True))))
        + "\n"
    )


RIGS = Path(__file__).parents[2] / "configs"
FILES = {
    "unspoken.toml": '[port]\nprotocol = "stim"\nurl = "imu"\n[positions]\nalpha_deg = [0]\nbeta_deg = [0]\n',
    "nobody.toml": '[instrument]\nprotocol = "stim"\n',
    "warped.toml": f'rig = "{RIGS / "paper24.toml"}"\n[effects]\n"second_ordr.y" = [0.4]\n',
    "crowded.toml": f'rig = "{RIGS / "paper24.toml"}"\n[effects]\n"second_order.y" = [0.4, 1.0]\n',
    "good.csv": "\n".join((HEADER, *ROWS)) + "\n",
    "result.json": "\n".join((HEADER, *ROWS)) + "\n",
    "sheet.csv": b"PK\x03\x04\x14\x00\x06\x00\x08",
    "sheet.xlsx": b"PK\x03\x04\x14\x00\x06\x00\x08",
    "old.xls": b"\xd0\xcf\x11\xe0\xa1\xb1",
    "matlab.csv": b"MATLAB 5.0 MAT-file",
    "hdf.csv": b"\x89HDF\r\n\x1a\n",
    "parquet.csv": b"PAR1\x15\x04",
    "page.csv": b"%PDF-1.7",
    "utf16.csv": "\n".join((HEADER, *ROWS)).encode("utf-16-le"),
    "packed.csv": gzip.compress("\n".join((HEADER, *ROWS)).encode()),
    "torn.csv": "\n".join((HEADER, *ROWS)).encode() + bytes(9),
    "latin.csv": "\n".join((HEADER.replace("alpha_deg", "alpha °"), *ROWS)).encode("latin-1"),
    "minutes.csv": "\n".join((HEADER, *(re.sub(",(\\d+),", r",\1°00',", row, count=1) for row in ROWS))),
    "saved.csv": "\n<!DOCTYPE html>\n<html><body><p>0,0</p></body></html>\n",
    "empty.csv": b"",
    "comments.csv": "# only a comment\n",
    "no_unit.csv": "position,alpha_deg,beta_deg,ax_g,ay_g,az\n" + "\n".join(ROWS),
    "twice.csv": HEADER + ",az_g\n" + "\n".join(row + ",1" for row in ROWS),
    "ragged.csv": with_row(2, "x,0,0,1"),
    "word.csv": with_row(2, "x,0,0,0,0,one"),
    "comma.csv": with_row(2, 'x,0,0,0,0,"1,0"'),
    "nan.csv": with_row(2, "x,0,0,0,0,nan"),
    "inf.csv": with_row(2, "x,0,0,0,0,inf"),
    "empty_cell.csv": with_row(2, "x,0,0,0,0,"),
    "huge.csv": with_row(2, "x,0,0,0,0,1e30"),
    "ms2.csv": scaled(9.81),
    "mg.csv": scaled(1000.0),
    "counts.csv": scaled(16384.0),
    "gravity.csv": "# gravity_ms2: 3.7\n" + "\n".join((HEADER, *ROWS)),
    "gravity_word.csv": "# gravity_ms2: local\n" + "\n".join((HEADER, *ROWS)),
    "attitudes.csv": "# attitudes: known\n" + "\n".join((HEADER, *ROWS)),
    "approach.csv": HEADER + ",approach\n" + "\n".join(f"{row},{int(k > 0)}" for k, row in enumerate(ROWS)),
    "zero_sd.csv": HEADER
    + ",ax_sd_g,ay_sd_g,az_sd_g\n"
    + "\n".join(f"{row},{int(k > 0)},1,1" for k, row in enumerate(ROWS)),
    "radians.csv": "\n".join([HEADER, "a,0,0,0,0,1", "b,1.5708,0,0,1,0", "c,3.1416,0,0,0,-1", "d,0,1.5708,-1,0,0"]),
    "one_setting.csv": "\n".join((HEADER, *ROWS[:4])),
    "few.csv": "\n".join((HEADER, ROWS[0], ROWS[1], ROWS[4], ROWS[8])),
    "rig.toml": (RIGS / "paper24.toml").read_text(),
    "flipped.csv": read_other_way(0, 1, 2, sign=-1.0),
    "exchanged.csv": read_other_way(1, 0, 2),
    "samples.csv": "\n".join((HEADER, *(row for row in ROWS for _ in range(20)))),
    "cal.json": calibration(),
    "newer.json": calibration(schema="tumblecal.calibration/9"),
    "singular.json": calibration(matrix=[[1, 0, 0], [1, 0, 0], [0, 0, 1]]),
    "short.json": calibration(bias=[0, 0]),
    "broken.json": "{" + SCHEMA,
    "log.csv": "# serial_number: B2\nax_g,ay_g,az_g\n0,0,1\n",
    "corrected.csv": "# corrected_by: cal.json\nax_g,ay_g,az_g\n0,0,1\n",
    "no_axes.csv": "time,temperature\n0,20\n",
    "plan.toml": "[positions\n",
    "study.toml": "runs = many\n",
    "lab.toml": LAB,
    "misspelt.toml": LAB.replace("size", "sise"),
    "no_unit.toml": LAB.replace("1 mrad", "1"),
    "daily.toml": LAB + 'per = "day"\n',
    "nothing.toml": 'schema = "tumblecal.budget/1"\n',
    "limits.toml": 'schema = "tumblecal.limits/1"\n[limits]\nbias = "1 mg"\n',
    "backwards.toml": "[positions]\nalpha_deg = [0, 90]\nbeta_deg = [0]\n[dwell]\nseconds = -1\n",
    "params.txt": "CAL_ACC0_XOFF 0.1\n",
    "short.csv": "time_s,ax_g,ay_g,az_g\n" + "\n".join(f"{k / 100},0,0,1" for k in range(50)) + "\n",
    "junk.bin": bytes(range(256)) * 20,
}
MISTAKES = {
    "no command of that name": ("calibrat good.csv", 'Unknown command "calibrat". Did you mean "calibrate"?'),
    "no file": ("calibrate", "parameter DATA requires an argument; see tumblecal calibrate --help"),
    "a folder": ("calibrate .", ".: a folder; give a file of positions"),
    "a folder for a rig": ("calibrate good.csv --rig .", ".: a folder; give a file"),
    "a folder for bytes": ("decode .", ".: a folder; give a file of bytes"),
    "a web page": ("calibrate saved.csv", "this is HTML or XML, not a table"),
    "a web page for a rig": ("calibrate good.csv --rig saved.csv", "this is HTML or XML, not TOML"),
    "a calibration for a head": ("calibrate good.csv --head cal.json", "cal.json: this is JSON, not TOML"),
    "missing file": ("calibrate none.csv", "none.csv: no such file"),
    "unknown option": ("calibrate good.csv --nose-sd 1mg", "Unknown option: --nose-sd"),
    "option without value": ("calibrate good.csv --noise-sd", "--noise-sd requires an argument"),
    "negative noise": ("calibrate good.csv --noise-sd -0.1mg", "is written --option=-0.1mg"),
    "negative noise written so": ("calibrate good.csv --noise-sd=-0.1mg", "must be above 0"),
    "noise of nothing": ("calibrate good.csv --noise-sd 0mg", "'0mg': a standard deviation must be above 0"),
    "noise beyond any digits": ("calibrate good.csv --noise-sd 1e-16g", "(1e-12 to 1e6 g)"),
    "noise without measure": ("diagnose good.csv --noise-sd 1e300g", "(1e-12 to 1e6 g)"),
    "noise drawn below zero": ("simulate rig.toml --noise-sd=-1mg --out x.csv", "--noise-sd: '-1mg'"),
    "noise without unit": ("calibrate good.csv --noise-sd 0.1", "'0.1' has no unit"),
    "noise in another unit": ("calibrate good.csv --noise-sd 1mrad", "their dimensions differ"),
    "no gravity": ("calibrate good.csv --gravity 3.7", "--gravity 3.7: 3.7 is not a gravity"),
    "a site that is none": ("calibrate good.csv --gravity lat=95", "write m/s^2, such as 9.8123, or a site"),
    "gravity with a decimal comma": ("calibrate good.csv --gravity 9,81", "has a decimal comma; write --gravity 9.81"),
    "a site with a decimal comma": (
        "apply cal.json good.csv --gravity lat=48,14,height=520",
        "has a decimal comma; write --gravity lat=48.14,height=520",
    ),
    "noise with a decimal comma": ("calibrate good.csv --noise-sd 0,1mg", "'0,1mg' has a decimal comma; write '0.1mg'"),
    "columns that are none": ("calibrate good.csv --columns ax_g", "write NAME=COLUMN"),
    "columns that are not there": (
        "calibrate good.csv --columns ax_g=AccX",
        "column AccX (--columns ax_g=AccX) is missing",
    ),
    "columns by no name": ("calibrate good.csv --columns warp=ax_g", "--columns warp=...: no such column"),
    "one column for two axes": (
        "calibrate good.csv --columns ax_g=ax_g,ay_g=ax_g,az_g=az_g",
        "--columns ay_g=ax_g: column ax_g is ax_g already; name a different column for each quantity",
    ),
    "two columns for one axis": ("calibrate good.csv --columns ax_g=ax_g,ax_g=ay_g", "ax_g is given twice; keep one"),
    "one column for two axes of a recording": (
        "apply cal.json good.csv --columns ax=ax_g,ay=ax_g,az=az_g",
        "--columns ay=ax_g: column ax_g is ax already",
    ),
    "prior without a size": ("calibrate good.csv --prior dbeta", "write NAME=SIZE"),
    "prior on nothing": ("calibrate good.csv --prior warp=1mrad", "no parameter 'warp'"),
    "prior in another unit": (
        "calibrate good.csv --prior dbeta=3mg",
        "--prior 'dbeta=3mg': 'mg' cannot be converted to 'rad'",
    ),
    "prior without noise": ("calibrate good.csv --prior dbeta=3arcmin", "a prior needs a stated noise"),
    "fixed nothing": ("calibrate good.csv --fix warp", "--fix warp: no such parameter"),
    "no such rig": ("calibrate good.csv --rig none.toml", "none.toml: no such file"),
    "no such config": ("simulate none.toml --out x.csv", "none.toml: no such file"),
    "output in the way": ("calibrate good.csv --out good.csv/out", "cannot write to this folder"),
    "study not writable": ("reproduce --out /proc/study", "/proc/study: cannot write to this folder"),
    "rig that is a table": ("calibrate good.csv --rig good.csv", "good.csv: not TOML"),
    "head that is a table": ("calibrate good.csv --head good.csv", "good.csv: not TOML"),
    "effects that are none": ("calibrate good.csv --effects none.py", "none.py"),
    "quiet and JSON": ("calibrate good.csv -q --json", "contradict each other"),
    "an output over an input": ("calibrate result.json --out .", "result.json"),
    "spreadsheet": ("calibrate sheet.xlsx", "this is a spreadsheet (.xlsx, .ods)"),
    "spreadsheet called CSV": ("diagnose sheet.csv", "this is a spreadsheet (.xlsx, .ods)"),
    "old spreadsheet": ("calibrate old.xls", "this is an old spreadsheet"),
    "MATLAB": ("calibrate matlab.csv", "this is a MATLAB file"),
    "HDF5": ("calibrate hdf.csv", "this is an HDF5 file"),
    "Parquet called CSV": ("calibrate parquet.csv", "give it a name that ends in .parquet"),
    "PDF": ("calibrate page.csv", "this is a PDF"),
    "UTF-16 that does not say so": (
        "calibrate utf16.csv",
        "text in UTF-16 without a byte order mark; save it as UTF-8",
    ),
    "a recording in it": ("import utf16.csv --out x.csv", "text in UTF-16 without a byte order mark; save it as UTF-8"),
    "compressed": ("calibrate packed.csv", "this is compressed by gzip; unpack it (gunzip)"),
    "a compressed recording": ("import packed.csv --out x.csv", "this is compressed by gzip; unpack it (gunzip)"),
    "zero bytes": ("apply cal.json torn.csv", "torn.csv:line 13: not text (a zero byte)"),
    "zero bytes of a recording": ("import torn.csv --out x.csv", "torn.csv:line 13: not text (a zero byte)"),
    "Latin-1": (
        "calibrate latin.csv",
        "line 1: not text in UTF-8 (byte 0xb0: ° in Latin-1 or Windows-1252); save the file",
    ),
    "minutes of arc": (
        "reduce minutes.csv --means --out r",
        'column alpha_deg: "0°00\'": no number; write degrees with dec',
    ),
    "empty": ("calibrate empty.csv", "the file is empty"),
    "comments alone": ("calibrate comments.csv", "no header line"),
    "axis without a unit": (
        "calibrate no_unit.csv",
        "column az: unknown column; its unit is unknown; name it az_g,",
    ),
    "column twice": ("calibrate twice.csv", "column az_g: the column is given twice"),
    "ragged": ("calibrate ragged.csv", "ragged.csv:line 4: 4 cells, but the header has 6"),
    "a word": ("calibrate word.csv", "word.csv:line 4, column az_g: 'one' is not a number"),
    "decimal comma in quotes": ("calibrate comma.csv", "'1,0' is not a number; use a decimal point"),
    "NaN": ("calibrate nan.csv", "line 4, column az_g: 'nan' is not a finite number"),
    "infinity": ("diagnose inf.csv", "line 4, column az_g: 'inf' is not a finite number"),
    "empty cell": ("calibrate empty_cell.csv", "line 4, column az_g: the cell is empty"),
    "no reading": ("calibrate huge.csv", "1e+30 g is not a possible reading"),
    "m/s^2 called g": ("calibrate ms2.csv", "so they look like m/s^2; name the columns ax_ms2"),
    "mg called g": ("calibrate mg.csv", "so they look like mg"),
    "counts called g": ("calibrate counts.csv", "If they are counts, divide them by the counts per g"),
    "gravity of Mars": ("calibrate gravity.csv", "comment gravity_ms2: '3.7' is not a gravity"),
    "gravity in words": ("calibrate gravity_word.csv", "comment gravity_ms2: 'local' is not a gravity"),
    "attitudes known": ("calibrate attitudes.csv", "write 'head', 'hand' or 'unknown'"),
    "sd of nothing": ("calibrate zero_sd.csv", "standard deviation must be above 0"),
    "approach from nowhere": ("calibrate approach.csv", "must be +1 or -1"),
    "radians": ("calibrate radians.csv", "these look like radians; write degrees"),
    "fewer rows than parameters": ("calibrate few.csv", "15 parameters, but rank"),
    "one pitch setting": ("calibrate one_setting.csv", "cannot determine dK_x"),
    "axis turned round": ("calibrate flipped.csv", "flipped.csv: "),
    "axes exchanged": ("calibrate exchanged.csv", "exchanged.csv: "),
    "raw samples": (
        "calibrate samples.csv",
        "so these look like raw samples. Reduce them first, then give reduced/positions.csv: tumblecal reduce samples.csv",
    ),
    "means to be reduced": ("reduce good.csv", "A table of means needs no reduction: give it to calibrate"),
    "nothing captured": ("reduce .", "give the folder of a capture"),
    "no calibration": ("apply good.csv good.csv", "not JSON"),
    "a later calibration": ("apply newer.json good.csv", "schema is 'tumblecal.calibration/9'"),
    "a matrix that is none": ("apply singular.json good.csv", "matrix: a matrix with scales from"),
    "a bias too short": ("apply short.json good.csv", "bias: must have 3 or more entries, not 2"),
    "half a calibration": ("apply broken.json good.csv", "not JSON"),
    "another unit's log": ("apply cal.json log.csv", "serial number B2, but cal.json is of A1"),
    "corrected into a spreadsheet": (
        "apply cal.json good.csv --out corrected.xlsx",
        "corrected.xlsx: must end in .csv or .parquet",
    ),
    "corrected twice": ("apply cal.json corrected.csv", "these data are corrected already"),
    "a log without axes": ("apply cal.json no_axes.csv", "no_axes.csv: text without rows of three or more numbers"),
    "workers of none": ("diagnose good.csv --workers 0", "--workers 0: at least 1"),
    "one unit alone": ("diagnose good.csv --units", "at least two units"),
    "held out nothing": ("diagnose good.csv --holdout run", "write a column and a value, such as run=3"),
    "angles that are none": ("diagnose good.csv --allow-alpha x", "'x' is not an angle"),
    "an effect that is none": ("effects warp_drive", "no effect 'warp_drive'"),
    "half a plan": ("capture plan.toml --out run", "plan.toml: not TOML"),
    "a protocol of nobody in a plan": (
        "capture unspoken.toml --out run",
        "unspoken.toml:line 2: port.protocol: protocol 'stim': not known; there are",
    ),
    "an instrument of nobody": (
        "emulate nobody.toml --port imu",
        "nobody.toml:line 2: instrument.protocol: protocol 'stim': not known; there are",
    ),
    "an effect of nobody emulated": (
        "emulate warped.toml --port imu",
        "warped.toml:line 3: effects.second_ordr.y: no effect 'second_ordr.y'; did you mean second_order.y",
    ),
    "more values than an effect has": (
        "emulate crowded.toml --port imu",
        "crowded.toml:line 3: effects.second_order.y: 2 values, but it has 1 coefficient",
    ),
    "a study in words": ("study power study.toml --out power", "study.toml: not TOML"),
    "a rig for simulate": ("simulate good.csv --out x.csv", "good.csv: not TOML"),
    "no noise at all": ("calibrate good.csv", "follow the model to rounding"),
    "nothing measured": ("diagnose good.csv --noise-sd 0.1mg", "computed, not measured"),
    "a folder for its calibration": ("compare . cal.json", ".: a folder; give the file, calibration.json"),
    "a calibration for positions": ("budget cal.json lab.toml", "cal.json: this is JSON, not a table"),
    "simulated into a spreadsheet": ("simulate plan.toml --out x.xlsx", "must end in .csv or .parquet"),
    "samples backwards": ("import short.csv --rate -5 --out x.csv", "--rate -5: not a sample rate"),
    "a recording of no format": ("import junk.bin --out x.csv", "junk.bin: no format recognises it"),
    "half a spreadsheet": ("import sheet.xlsx --out x.csv", "not a complete spreadsheet"),
    "imported as text": ("import short.csv --out x.txt", "must end in .csv or .parquet"),
    "a folder imported": ("import . --out x.csv", ".: no format recognises it"),
    "too short to be still": ("reduce short.csv --static --out r", "50 samples are too few to find intervals at rest"),
    "both known and unknown": ("reduce short.csv --static --plan plan.toml --out r", "give only one of these options"),
    "a plan that runs backwards": (
        "reduce short.csv --plan backwards.toml --out r",
        "line 5: dwell.seconds: must be above 0 (got -1)",
    ),
    "inputs of a budget for a plan": (
        "reduce short.csv --plan lab.toml --out r",
        "check that this is the correct file",
    ),
    "an export to nothing": ("export cal.json --to px5", 'Did you mean "px4"?'),
    "an export of a table": ("export good.csv --to px4", "good.csv:line 1, column 1: not JSON"),
    "an export over its input": ("export cal.json --to px4 --out cal.json", "would overwrite the input cal.json"),
    "temperatures downwards": ("export cal.json --to px4 --temperatures 60:0", "write LOW:HIGH in degC"),
    "noise of no recording": ("export cal.json --to kalibr --noise cal.json", "no noise of three axes"),
    "no history": ("history none.db", "no such history; create it by calibrate or diagnose with --history none.db"),
    "a table for a history": ("history good.csv", "not a history (file is not a database)"),
    "a folder of nothing": ("history lab.db --add none", "no result.json or diagnosis.json"),
    "a limit of nothing": ("history lab.db A-17 --limit warp=1mg", "write NAME=SIZE with dK, bias, gamma, dtheta"),
    "a limit without its unit": ("history lab.db A-17 --limit bias=1", "--limit 'bias=1': '1' has no unit"),
    "a limit of no unit": ("history lab.db --limit bias=1mg", "apply to one unit; give its serial number after lab.db"),
    "a risk of no unit": ("history lab.db --risk 0.1", "apply to one unit; give its serial number after lab.db"),
    "a topic of a table": (
        "import short.csv --topic x --out x.csv",
        "no topic x: the file has one table, without a name; remove --topic",
    ),
    "one calibration compared": ("compare cal.json", "NEW requires an argument"),
    "compared with a table": ("compare cal.json good.csv", "good.csv:line 1, column 1: not JSON"),
    "half a parameter file": ("compare px4:params.txt cal.json", "params.txt: CAL_ACC0_YOFF is missing"),
    "a format without a file": ("compare px4: cal.json", "no file after the colon; write px4:FILE"),
    "a format of nobody": ("compare px5:params.txt cal.json", "no format 'px5'; formats: c-header"),
    "a budget of nothing": ("budget good.csv", "no inputs to consider: give a file of inputs"),
    "an empty budget": ("budget good.csv nothing.toml", "nothing.toml: considered: is missing"),
    "a budget's key misspelt": ("budget good.csv misspelt.toml", "considered.a.sise: unknown key; did you mean size?"),
    "a budget's size without unit": ("budget good.csv no_unit.toml --noise-sd 0.1mg", "considered.a: '1' has no unit"),
    "a budget of computed readings": ("budget good.csv lab.toml", "the readings follow the model to rounding"),
    "an input for each day": (
        "budget good.csv daily.toml",
        "considered.a.per: must be 'position', 'pitch', 'run' or 'mount' (got 'day')",
    ),
    "95 for 0.95": ("budget good.csv lab.toml --level 95", "--level 95: a probability"),
    "budget and data exchanged": ("budget lab.toml good.csv", "lab.toml: schema is 'tumblecal.budget/1', not"),
    "a certificate of a file": ("certificate cal.json --admin lab.toml", "cal.json: a file; give the output folder"),
    "a certificate of nothing": ("certificate none --admin lab.toml", "lab.toml: schema is 'tumblecal.budget/1', not"),
    "a certificate by nobody": ("certificate .", "--admin requires an argument"),
    "a study of nothing": ("study warp study.toml", 'Unknown command "warp"'),
    "a study of a budget": ("study linearization lab.toml --out x", "lab.toml: schema is 'tumblecal.budget/1', not"),
    "a head of a budget": ("diagnose good.csv --head lab.toml", "lab.toml: schema is 'tumblecal.budget/1', not"),
    "a wait without end": ("capture plan.toml --out run --wait nan", "--wait nan: seconds, from 0 to 86400"),
    "a folder for a history": ("calibrate good.csv --history .", ".: a folder; give a file, such as"),
    "a capture that is none": ("capture --resume none", "none: no journal.log here"),
    "a protocol of nobody": ("decode junk.bin --protocol warp", "protocol 'warp': not known; there are"),
    "a port that is none": ("sniff none", "port none: there is no such device"),
}


@pytest.mark.parametrize(("command", "words"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_one_line(tumblecal, tmp_path, monkeypatch, command, words):
    monkeypatch.chdir(tmp_path)
    for name in {name for name in FILES if name in command.replace(":", " ").split()}:
        content = FILES[name]
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    before = sorted(tmp_path.rglob("*"))
    outcome = tumblecal(*command.split())
    assert outcome.code == 2, outcome
    assert len(outcome.lines) == 1, outcome.lines
    assert outcome.lines[0].startswith("tumblecal: ") and words in outcome.lines[0]
    assert outcome.out == "" and sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("command", "words"),
    {
        "calibrate run": "run: the folder of a capture; give run/positions.csv of this command: tumblecal reduce run",
        "reduce run --static": "For its position means, run: tumblecal reduce run",
        "import run --out x.csv": "For its samples, give run/raw.log",
        "decode run": "run: a folder; give a file of bytes, run/raw.log",
        "diagnose reduced": "reduced: a folder; give the file, reduced/positions.csv",
    }.items(),
)
def test_a_folder_says_which_of_its_files_to_give(tumblecal, tmp_path, monkeypatch, command, words):
    monkeypatch.chdir(tmp_path)
    for name in ("run/journal.log", "run/raw.log", "reduced/positions.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(FILES["good.csv"])
    outcome = tumblecal(*command.split())
    assert outcome.code == 2 and len(outcome.lines) == 1 and words in outcome.lines[0], outcome


def test_there_are_a_hundred():
    assert len(MISTAKES) >= 100
