"""Spoilt files of every kind through the functions that the commands read them with.

python benchmarks/fuzz_readers.py --files 100000 --seed 1

Each file ends in values that are finite or in the program's own `InputError` of short lines; anything else is printed with
its traceback, kept in --keep, and makes the exit code 1.
"""

import argparse
import collections
import dataclasses
import random
import re
import sys
import tempfile
import time
import traceback
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import polars as pl
from pydantic import BaseModel

from spoilt_files import spoilt
from tumblecal.budget.budget_file import read_considered
from tumblecal.capture.capture_plan import read_plan
from tumblecal.capture.correction import Correction, uncorrected, write_corrected
from tumblecal.capture.emulator.config import read_emulation
from tumblecal.capture.journal import JOURNAL_NAME, Journal, read_journal, replayed
from tumblecal.capture.position_samples import read_position_samples
from tumblecal.certificate.admin import read_admin, read_limits
from tumblecal.chain.rig_file import read_rig
from tumblecal.data.calibration import Calibration, read_calibration, write_calibration
from tumblecal.data.calibration_extended import corrected
from tumblecal.data.files import read_positions
from tumblecal.data.raw import read_raw
from tumblecal.devices import TARGETS, Export, Target, read_any
from tumblecal.effects.catalogue import catalogue, links_and_units
from tumblecal.ground.errors import InputError
from tumblecal.ground.precision import enable_float64
from tumblecal.studies.study_tables import read_study, rig_of_study, table_of
from tumblecal.studies.sweep import points_of


CONFIGS = Path(__file__).parents[1] / "configs"
HEADER = (
    "position,alpha_deg,beta_deg,ax_g,ay_g,az_g,run,mount,time_s,temperature_degc,approach,n,ax_sd_g,ay_sd_g,az_sd_g"
)
ROW = "{p},{a},{b},{x:.9f},{y:.9f},{z:.9f},1,A,{t},25.5,1,100,1e-5,2e-5,3e-5"
LONGEST_FAULT = 2000
READINGS = np.array([[0.0, 0.0, 1.0], [0.6, -0.8, 0.0], [1.0, 1.0, 1.0]])
TERMS = [
    {"axis": "z", "coefficient": 2e-4, "powers": [0, 0, 2], "kind": "product"},
    {"axis": "x", "coefficient": 1e-5, "powers": [1, 0, 0], "per_degc": True, "reference_degc": 25.0},
]


_NO_RIG = ("study", "capture", "considered", "certificate")


def _exported(target: Target) -> bytes:
    own = Calibration(np.eye(3) * 1.02, np.full(3, 2e-3), np.eye(12) * 1e-10, extra={"terms": TERMS})
    return target.write(Export(target.carried(own), 9.81, ("about",))).encode()


def tables() -> dict[str, list[bytes]]:
    """Valid files of every kind, to be spoilt."""
    rows = [
        dict(p=f"{n}-{k}", a=a, b=b, x=-np.sin(r), y=np.cos(r) * np.sin(s), z=np.cos(r) * np.cos(s), t=60 * k + n)
        for k, (b, r) in enumerate((b, np.radians(b)) for b in (0, 45, 90))
        for n, (a, s) in enumerate((a, np.radians(a)) for a in (0, 90, 180, 270))
    ]
    text = "\n".join((HEADER, *(ROW.format(**row) for row in rows))) + "\n"
    ms2 = "# gravity_ms2: 9.8123\n# operator: me\n" + text.replace("_g", "_ms2")
    frame = pl.read_csv(text.encode())
    samples = "position,time_s,ax_g,ay_g,az_g\n" + "".join(
        f"{k // 40},{k / 100},0.01,0.02,{k % 7}\n" for k in range(120)
    )
    return {
        "positions": [text.encode(), ms2.encode()],
        "parquet": [_parquet(frame), _parquet(frame.with_columns(pl.col("run").cast(pl.String)))],
        "raw": [text.encode(), ms2.encode()],
        "samples": [samples.encode(), ("# rate_hz: 100\n" + re.sub(r",[\d.]+(?=,0.01)|time_s,", "", samples)).encode()],
        "calibration": [_calibration({}), _calibration({"terms": TERMS})],
        "rig": [path.read_bytes() for path in CONFIGS.glob("*.toml") if not path.name.startswith(_NO_RIG)],
        "plan": [(CONFIGS / "capture_demo.toml").read_bytes()],
        "emulation": [(CONFIGS / "capture_emulator.toml").read_bytes()],
        "study": [path.read_bytes() for path in sorted(CONFIGS.glob("study*.toml"))],
        "journal": [_journal()],
        "considered": [(CONFIGS / "considered_lab.toml").read_bytes()],
        "admin": [(CONFIGS / "certificate_lab.toml").read_bytes()],
        "limits": [(CONFIGS / "certificate_limits.toml").read_bytes()],
    } | {f"device.{name}": [_exported(target)] for name, target in TARGETS.items()}


def _parquet(frame: pl.DataFrame) -> bytes:
    with tempfile.NamedTemporaryFile() as file:
        frame.write_parquet(file.name, metadata={"gravity_ms2": "9.81"})
        return Path(file.name).read_bytes()


def _calibration(extra: dict) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibration.json"
        write_calibration(path, Calibration(np.eye(3), np.full(3, 1e-3), np.eye(12) * 1e-10, np.eye(3), extra=extra))
        return path.read_bytes()


def _journal() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        journal = Journal(Path(folder))
        journal.write("session", mount="1", run="1")
        journal.write("device", serial_number="N1", events=[], log_position=0)
        for position in range(3):
            journal.write("recording", position=position, attempt=1)
            told = {"log_start": 0, "log_stop": 10, "sha256": "0", "summary": {}}
            journal.write("accepted", position=position, attempt=1, **told)
        journal.close()
        return (Path(folder) / JOURNAL_NAME).read_bytes()


class Readers:
    """What each kind of file is read with; returns all that came out of it."""

    def __init__(self, folder: Path):
        self.folder = folder
        for rig in CONFIGS.glob("*.toml"):
            (folder / rig.name).write_bytes(rig.read_bytes())
        self.links = links_and_units(catalogue())

    def read(self, kind: str, content: bytes) -> object:
        """Write the file and read it as its command does."""
        names = {"parquet": "x.parquet", "journal": JOURNAL_NAME}
        path = self.folder / names.get(kind, "x.csv")
        path.write_bytes(content)
        kind, _, name = kind.partition(".")
        return getattr(self, kind)(path, *([name] if name else []))

    def positions(self, path: Path) -> object:
        """As `calibrate` and `diagnose`."""
        return read_positions(path, check_size=path.stat().st_size % 2 == 0)

    def parquet(self, path: Path) -> object:
        """As all commands that take tables."""
        return [read_positions(path), read_raw(path).readings]

    def raw(self, path: Path) -> object:
        """As `reduce`, and as `apply`, which takes other layouts for recordings."""
        plain = Correction(Calibration(np.eye(3), np.zeros(3), np.zeros((12, 12))), path)
        write_corrected(path.with_name("corrected.parquet"), uncorrected(path), plain)
        raw = read_raw(path)
        return [raw.readings, raw.temperature_degc()]

    def samples(self, path: Path) -> object:
        """As `diagnose --samples`."""
        return read_position_samples(path)

    def calibration(self, path: Path) -> object:
        """As `apply`, with readings corrected by it."""
        calibration = read_calibration(path)
        return [calibration, corrected(calibration, READINGS, np.full(3, 21.0))]

    def rig(self, path: Path) -> object:
        """As `simulate` and `--rig`."""
        rig = read_rig(path, *self.links)
        return [rig, len(rig.plan)]

    def plan(self, path: Path) -> object:
        """As `capture` and `reduce`."""
        plan = read_plan(path)
        return [plan, plan.site.gravity.value_ms2, [plan.expected(k) for k in range(min(len(plan.steps), 9))]]

    def emulation(self, path: Path) -> object:
        """As `emulate`."""
        return read_emulation(path)

    def study(self, path: Path) -> object:
        """As `study`."""
        kinds = re.findall(
            r"study\.(coverage|sweep|convergence|linearization|power)/1", path.read_text("utf-8", "replace")
        )
        study = read_study(path, kinds[0] if kinds else "coverage")
        if kinds and kinds[0] == "sweep":
            points_of(study)
        return [table_of(study), table_of(study).model_dump(), rig_of_study(study)]

    def considered(self, path: Path) -> object:
        """As `budget`."""
        return list(read_considered(path).items())

    def admin(self, path: Path) -> object:
        """As `certificate --admin`."""
        return read_admin(path)

    def limits(self, path: Path) -> object:
        """As `certificate --limits`."""
        return read_limits(path)

    def device(self, path: Path, name: str) -> object:
        """As `compare FORMAT:FILE`."""
        own = read_any(f"{name}:{path}")
        return [own, own.sensor]

    def journal(self, path: Path) -> object:
        """As `capture --resume` and `reduce`."""
        return replayed(read_journal(path.parent))


# `dof` may be infinite: stated noise.
NOT_LOOKED_AT = ("extra", "provenance", "dof")


def not_finite(value: object, at: str = "") -> str | None:
    """Where a value that came out of a reader is not finite; None when all is."""
    if isinstance(value, float | np.floating):
        return None if np.isfinite(value) else at or "the value"
    if isinstance(value, np.ndarray):
        return None if value.dtype.kind not in "fc" or np.all(np.isfinite(value)) else at
    if isinstance(value, BaseModel):
        return not_finite(value.model_dump(), at)
    if dataclasses.is_dataclass(value):
        parts = [(field.name, getattr(value, field.name)) for field in dataclasses.fields(value)]
    elif isinstance(value, Mapping):
        parts = [(str(key), part) for key, part in value.items()]
    elif isinstance(value, list | tuple):
        parts = [(str(number), part) for number, part in enumerate(value)]
    else:
        return None
    faults = (not_finite(part, f"{at}.{name}") for name, part in parts if name not in NOT_LOOKED_AT)
    return next((fault for fault in faults if fault), None)


def outcome(readers: Readers, kind: str, content: bytes) -> tuple[str, str]:
    """`read`, `refused` or `FAILED`, and the traceback or what was wrong with what came out."""
    try:
        value = readers.read(kind, content)
    except InputError as error:
        long = [fault for fault in error.faults if len(fault) > LONGEST_FAULT]
        return ("FAILED", f"a fault of {len(long[0])} characters: {long[0][:200]}") if long else ("refused", "")
    except Exception:
        return "FAILED", traceback.format_exc()
    fault = not_finite(value)
    return ("FAILED", f"not finite: {fault}") if fault else ("read", "")


def main() -> int:
    """Run; exit code 1 when a file failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--files", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", help="only this kind")
    parser.add_argument("--keep", type=Path, help="folder for the files that failed")
    options = parser.parse_args()
    enable_float64()
    sources, counts, seen = tables(), collections.Counter(), collections.Counter()
    kinds = [options.kind] if options.kind else list(sources)
    begin, slowest = time.monotonic(), (0.0, "", 0)
    with tempfile.TemporaryDirectory() as folder:
        readers = Readers(Path(folder))
        for kind in kinds:
            for content in sources[kind]:
                assert outcome(readers, kind, content) == ("read", ""), (kind, outcome(readers, kind, content)[1])
        for number in range(options.files):
            chance = random.Random(f"{options.seed} {number}")
            kind = kinds[number % len(kinds)]
            content = spoilt(chance.choice(sources[kind]), chance)
            started = time.monotonic()
            word, told = outcome(readers, kind, content)
            slowest = max(slowest, (time.monotonic() - started, kind, number))
            counts[kind, word] += 1
            if word == "FAILED":
                last = told.strip().splitlines()[-1][:150]
                seen[kind, last] += 1
                if seen[kind, last] == 1:
                    print(f"{kind}, file {number}: {told}", file=sys.stderr)
                    if options.keep:
                        options.keep.mkdir(parents=True, exist_ok=True)
                        (options.keep / f"{kind}-{number}").write_bytes(content)
    print(f"{'kind':12} {'read':>8} {'refused':>8} {'failed':>8}")
    for kind in kinds:
        print(f"{kind:12} " + " ".join(f"{counts[kind, word]:8d}" for word in ("read", "refused", "FAILED")))
    failed = sum(count for (_, word), count in counts.items() if word == "FAILED")
    took = time.monotonic() - begin
    slow = f"the slowest {slowest[0]:.2f} s ({slowest[1]}, file {slowest[2]})"
    print(f"{options.files} files in {took:.0f} s, {slow}; {failed} failed")
    for (kind, last), count in seen.most_common():
        print(f"  {count} {kind}: {last}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
