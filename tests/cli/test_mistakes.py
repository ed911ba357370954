"""What people do wrong in the first hour: one line each, exit code 2, nothing written."""

import json
from pathlib import Path

import pytest


pytestmark = pytest.mark.usefixtures("few_effects")


HEADER = "position,alpha_deg,beta_deg,ax_g,ay_g,az_g"
ROWS = [
    f"{k}-{n},{a},{b},{x},{y},{z}"
    for k, (b, x, r) in enumerate(((0, 0, 1), (45, -0.70710678, 0.70710678), (90, -1, 0)))
    for n, (a, y, z) in enumerate(((0, 0, r), (90, r, 0), (180, 0, -r), (270, -r, 0)))
]
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


def flipped() -> str:
    """The axis z turned round."""
    rows = (row.split(",") for row in ROWS)
    return "\n".join((HEADER, *(",".join([*row[:5], repr(-float(row[5]))]) for row in rows))) + "\n"


RIGS = Path(__file__).parents[2] / "configs"
FILES = {
    "unspoken.toml": '[port]\nprotocol = "stim"\nurl = "imu"\n[positions]\nalpha_deg = [0]\nbeta_deg = [0]\n',
    "head.toml": (RIGS / "plan_head.toml").read_text(),
    "good.csv": "\n".join((HEADER, *ROWS)) + "\n",
    "result.json": "\n".join((HEADER, *ROWS)) + "\n",
    "sheet.xlsx": b"PK\x03\x04\x14\x00\x06\x00\x08",
    "parquet.csv": b"PAR1\x15\x04",
    "utf16.csv": "\n".join((HEADER, *ROWS)).encode("utf-16-le"),
    "latin.csv": "\n".join((HEADER.replace("alpha_deg", "alpha °"), *ROWS)).encode("latin-1"),
    "counts.csv": scaled(16384.0),
    "gravity.csv": "# gravity_ms2: 3.7\n" + "\n".join((HEADER, *ROWS)),
    "zero_sd.csv": HEADER
    + ",ax_sd_g,ay_sd_g,az_sd_g\n"
    + "\n".join(f"{row},{int(k > 0)},1,1" for k, row in enumerate(ROWS)),
    "radians.csv": "\n".join([HEADER, "a,0,0,0,0,1", "b,1.5708,0,0,1,0", "c,3.1416,0,0,0,-1", "d,0,1.5708,-1,0,0"]),
    "one_setting.csv": "\n".join((HEADER, *ROWS[:4])),
    "few.csv": "\n".join((HEADER, ROWS[0], ROWS[1], ROWS[4], ROWS[8])),
    "flipped.csv": flipped(),
    "samples.csv": "\n".join((HEADER, *(row for row in ROWS for _ in range(20)))),
    "cal.json": calibration(),
    "short.json": calibration(bias=[0, 0]),
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


def test_there_are_eighty():
    assert len(MISTAKES) >= 80
