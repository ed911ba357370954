"""The cases: for each command some inputs, and its command lines."""

import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import recordings_made

import inputs
from commands import Case


ROOT = Path(__file__).parents[2]
CONFIGS = ROOT / "configs"
_EXPORTS = ("c-header", "json", "csv", "matlab", "px4", "ardupilot", "kalibr", "imu_tk", "imucal", "ros", "vectornav")


def _file(name: str, write: Callable[..., None], *values, **options) -> Callable[[Path], None]:
    return lambda folder: write(folder / name, *values, **options)


def _all(*parts: Callable[[Path], None]) -> Callable[[Path], None]:
    def prepare(folder: Path) -> None:
        for part in parts:
            part(folder)

    return prepare


def _configs(*names: str) -> Callable[[Path], None]:
    return _all(*(lambda folder, name=name: shutil.copy(CONFIGS / name, folder) and None for name in names))


def _exchanged(path: Path, rows: tuple[int, int]) -> None:
    plan, turns = inputs.plan_of()
    values = inputs.readings(plan, turns, 31)
    values[list(rows)] = values[list(rows[::-1])]
    inputs.write_table(path, inputs.positions_table(plan, values))


def _in_ms2(path: Path) -> None:
    plan, turns = inputs.plan_of()
    columns = inputs.positions_table(plan, 9.8123 * inputs.readings(plan, turns, 32))
    inputs.write_table(path, {name.replace("_g", "_ms2"): values for name, values in columns.items()})


def _negated(path: Path) -> None:
    plan, turns = inputs.plan_of()
    values = inputs.readings(plan, turns, 33) * [1, -1, 1]
    inputs.write_table(path, inputs.positions_table(plan, values))


_SERIAL = {"serial_number": "A-17"}
POSITIONS = _file("p.csv", inputs.write_positions, 1, comments=_SERIAL | {"measured_utc": "2026-01-05"})
_LATER = _file("q.csv", inputs.write_positions, 1, ("bias_temperature",), comments=_SERIAL)


def _hand(seed: int, count: int = 6) -> Callable[[Path], None]:
    return _file("p.csv", inputs.write_by_hand, seed, tilt_deg=0.4, count=count, angles=count == 6)


def _of_effects(seed: int, *effects: str, **options) -> Callable[[Path], None]:
    return _file("p.csv", inputs.write_positions, seed, effects, **options)


def _months(folder: Path) -> None:
    for k in range(3):
        stated = {"serial_number": "A-17", "measured_utc": f"2026-0{k + 1}-01T00:00:00Z"}
        inputs.write_positions(folder / f"r{k}.csv", 1, comments=stated)


def _calibrate(options: str = "", file: str = "p.csv", out: str = "c") -> str:
    return f"calibrate {file} {options} --out {out} --no-figures"


_STATED = "--noise-sd 0.1mg"
_CALIBRATED = _calibrate(_STATED)
CALIBRATE = {
    "noise estimated": Case(POSITIONS, (_calibrate(),)),
    "noise stated": Case(POSITIONS, (_CALIBRATED,)),
    "an effect": Case(_of_effects(2, "second_order", size=60), (_CALIBRATED,)),
    "m/s2": Case(_file("p.csv", _in_ms2), (_calibrate("--gravity 9.8123"),)),
    "m/s2 without gravity": Case(_file("p.csv", _in_ms2), (_calibrate(),)),
    "exchanged rows": Case(_file("p.csv", _exchanged, (4, 5)), (_calibrate(),)),
    "negated axis": Case(_file("p.csv", _negated), (_calibrate(),)),
    "six faces": Case(_hand(5), (_calibrate("--attitudes hand"),)),
    "six faces unstated": Case(_hand(6), (_calibrate(),)),
    "too few": Case(_hand(8, 4), (_calibrate("--attitudes unknown"),)),
}
_LAB = _all(POSITIONS, _configs("certificate_lab.toml", "certificate_limits.toml"))
_CERTIFICATE = "certificate c --admin certificate_lab.toml --limits certificate_limits.toml --out cert"
_CHECK = "check c/calibration.json n.csv --extrapolate --out k"
OF_RESULTS = {
    "apply": Case(_all(POSITIONS, _LATER), (_CALIBRATED, "apply c/calibration.json q.csv --out a.csv")),
    "compare": Case(
        _all(POSITIONS, _LATER),
        (_CALIBRATED, _calibrate(_STATED, "q.csv", "d"), "compare c/calibration.json d/calibration.json"),
    ),
    "export": Case(
        POSITIONS, (_CALIBRATED, *(f"export c/calibration.json --to {name} --out e.{name}" for name in _EXPORTS))
    ),
    "certificate": Case(_LAB, (_CALIBRATED, _CERTIFICATE)),
    "budget of positions": Case(
        _all(POSITIONS, _configs("considered_lab.toml")), (f"budget p.csv considered_lab.toml {_STATED} --out b",)
    ),
    "budget of a rig": Case(_configs("budget_gimbal.toml"), ("budget budget_gimbal.toml --out b",)),
    "history": Case(
        _months,
        (
            *(_calibrate("--history lab.db", f"r{k}.csv", f"h{k}") for k in range(3)),
            "history lab.db A-17",
            "history lab.db --check",
        ),
    ),
    "check unchanged": Case(
        _all(POSITIONS, _file("n.csv", inputs.write_positions, 1, plan="cube")), (_CALIBRATED, _CHECK)
    ),
    "check another unit": Case(
        _all(POSITIONS, _file("n.csv", inputs.write_positions, 9, plan="cube")), (_CALIBRATED, _CHECK)
    ),
    "diagnose units": Case(
        lambda folder: (
            [inputs.write_positions(folder / f"u{k}.csv", 40 + k, conditions=False) for k in range(4)] and None
        ),
        ("diagnose u0.csv u1.csv u2.csv u3.csv --units --noise-sd 0.1mg --out u --no-figures",),
    ),
}

THERMAL = {
    "two soaks": Case(lambda folder: inputs.write_soaks(folder, (14, 38), 1), ("thermal . --out t",)),
    "ramps": Case(lambda folder: inputs.write_ramps(folder, 3), ("thermal . --out t",)),
}

_STUDY = """schema = "tumblecal.study.{kind}/1"
rig = "{rig}"
seed = 1
{more}
"""


def _study(kind: str, more: str, rig: str = "paper24.toml") -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        (folder / "study.toml").write_text(_STUDY.format(kind=kind, more=more, rig=rig))

    return _all(_configs("paper24.toml"), write)


_SPREAD = '[truth.spread]\ndK = "0.5 1e-3"\nbias = "2 mg"\ndtheta = "1 mrad"\ngamma = "0.5 mrad"\ndbeta = "3 arcmin"\n'
_RIGS = ("paper24", "remount", "hand_held")
_PLAN = "plan plan_head.toml --no-forecast --restarts 1 --seed 2 --out p"
# Each compiles programs that no other case uses: for the long job.
MORE = {
    "two mountings": Case(_of_effects(3, plan="two mountings"), (_CALIBRATED,)),
    "angles alone": Case(_of_effects(4, conditions=False), (_CALIBRATED,)),
    "prior and fixed": Case(POSITIONS, (_calibrate(f"{_STATED} --prior 'dbeta=3 arcmin' --fix gamma"),)),
    "unknown attitudes": Case(_hand(7, 20), (_calibrate("--attitudes unknown"),)),
    "plan in order": Case(_configs("plan_head.toml"), (f"{_PLAN} --minutes 60 --order keep --allow-mount A",)),
    "plan with forecast": Case(
        _configs("plan_head.toml"), ("plan plan_head.toml --restarts 1 --out p --positions 18",)
    ),
    "plan for two criteria": Case(
        _all(_configs("plan_head.toml"), _study("coverage", "trials = 500", "p/rig.toml")),
        (
            f"{_PLAN} --positions 12 --criterion worst=1,in_use=2",
            "study coverage study.toml --out s --workers 1",
            f"{_PLAN}2 --positions 18 --criterion mean=1,naming=2 --effects 'second_order.z=0.2 mg/g^2'",
        ),
    ),
}
_SMALL = "instruments = 2\nsizes = 3\nsmallest = '0.3 mrad'\nlargest = '30 mrad'\ndata_sets = [1, 100]"
_METHODS = "methods = ['single', 'mean', 'kalman', 'exact']\nprior_sd = [1e-3]"
_FEW = f"runs = 20\ndata_sets = 10\nthresholds = [3e-3, 1e-3]\n{_METHODS}"
_COLOURED = "[noise]\nfigures = [{ tau = '1 s', sd = '1.2 mg' }, { tau = '100 s', sd = '0.7 mg' }]\nrate = '125 Hz'"
_GRID = '[grid]\n"rig.noise.sd" = ["0.05 mg", "0.5 mg"]\n"study.inject.second_order.y" = [0, 1.0]'
_POWER = 'runs = 3\nnoise_stated = true\n[effects]\n"second_order.z" = [0, 5.0]'
STUDIES = {
    "linearization": _SMALL,
    "convergence": f"{_FEW}\n{_COLOURED}\ndwell = '1200 s'\nmove = '60 s'\n{_SPREAD}",
    "sweep": f"trials = 500\n{_GRID}",
    "power": _POWER,
}
MORE |= {
    f"study {kind}": Case(_study(kind, more), (f"study {kind} study.toml --out s --workers 1",))
    for kind, more in STUDIES.items()
}
SIMULATION = {
    "simulate": Case(
        _configs(*(f"{name}.toml" for name in _RIGS)),
        tuple(f"simulate {name}.toml --seed 3 --out {name}.csv" for name in _RIGS),
    ),
    "plan": Case(
        _configs("plan_head.toml"),
        (
            f"{_PLAN} --positions 12",
            "simulate p/rig.toml --seed 1 --out m.csv",
            f"{_PLAN}2 --positions 15 --augment m.csv --compare m.csv --compare p/rig.toml --compare p/plan_A.toml",
        ),
    ),
    "study coverage": Case(
        _study("coverage", f"trials = 2000\n{_SPREAD}"), ("study coverage study.toml --out s --workers 1",)
    ),
    "example": Case(lambda folder: None, ("example paper24", "example study_power", "ports")),
}


def _written(name: str) -> Callable[[Path], None]:
    """The recording in one of nine formats."""

    def write(folder: Path) -> None:
        columns = inputs.recording()
        frame = pl.DataFrame(columns)
        made = type("Recorded", (), {
            "time_s": columns["time_s"], "force": frame.select("ax", "ay", "az").to_numpy(),
            "rate": frame.select("gx", "gy", "gz").to_numpy(), "warmth": columns["temperature"],
        })  # fmt: skip
        match name:
            case "csv":
                frame.write_csv(folder / "log.csv")
            case "tabs":
                frame.write_csv(folder / "log.txt", separator="\t")
            case "jsonl":
                frame.write_ndjson(folder / "log.jsonl")
            case "parquet":
                frame.write_parquet(folder / "log.parquet")
            case "matlab":
                import scipy.io

                scipy.io.savemat(folder / "log.mat", {key: value[:, None] for key, value in columns.items()})
            case "hdf5":
                import h5py

                with h5py.File(folder / "log.h5", "w") as file:
                    for key, value in columns.items():
                        file[key] = value
            case "ulog":
                recordings_made.ulog(folder / "log.ulg", made)
            case "mcap":
                recordings_made.ros2_bag(folder / "log", made, mcap=True)
            case "bag":
                recordings_made.ros1_bag(folder / "log.bag", made)

    return write


FORMATS = {"csv": "log.csv", "tabs": "log.txt", "jsonl": "log.jsonl", "parquet": "log.parquet", "matlab": "log.mat",
           "hdf5": "log.h5", "ulog": "log.ulg", "mcap": "log", "bag": "log.bag"}  # fmt: skip


def _samples(path: Path) -> None:
    plan, turns = inputs.plan_of()
    values = inputs.readings(plan, turns, 34)
    noise = 1e-3 * np.random.default_rng(5).normal(size=(len(values), 50, 3))
    rows = inputs.positions_table(plan, values, conditions=False)
    columns = {name: [cell for cell in rows[name] for _ in range(50)] for name in ("position", "alpha_deg", "beta_deg")}
    every = (values[:, None] + noise).reshape(-1, 3)
    columns |= {f"a{axis}_g": every[:, k].round(6).tolist() for k, axis in enumerate("xyz")}
    inputs.write_table(path, columns | {"time_s": (np.arange(len(every)) / 10).tolist()})


REDUCE = {
    name: Case(_written(name), (f"reduce {file} --static --out r --no-figures",)) for name, file in FORMATS.items()
}


def _witmotion(path: Path) -> None:
    """Frames of force (16 g full scale), with a damaged one and foreign bytes."""
    rng = np.random.default_rng(6)
    frames = []
    for force in 2048 * np.array([0.1, -0.2, 1.0]) + rng.normal(0, 5, (300, 3)):
        body = b"\x55\x51" + struct.pack("<4h", *np.rint(force).astype(int), 2512)
        frames.append(body + bytes([sum(body) % 256]))
    frames[100] = frames[100][:5] + b"\x00" + frames[100][6:]
    path.write_bytes(b"noise" + b"".join(frames))


REDUCE |= {
    "decode": Case(_file("w.bin", _witmotion), ("sniff w.bin", "decode w.bin --out d.csv --rate-hz 100")),
    "samples": Case(_file("s.csv", _samples), ("reduce s.csv --out r --no-figures",)),
    "import": Case(_written("csv"), ("import log.csv --out i.csv", "import log.csv --unit counts --out j.csv")),
}
GROUPS = {
    "calibrate": CALIBRATE,
    "results": OF_RESULTS,
    "thermal": THERMAL,
    "simulation": SIMULATION,
    "reduce": REDUCE,
    "more": MORE,
}
