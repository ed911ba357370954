"""Each kind of file that tumblecal reads: a valid one, the command that reads it, its numbers, and the damage that it shows.

Commands are templates: `{file}` is the damaged file, `{folder}` that of the trial, `{out}` that of the results.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl

import damaged_made as made
import damaged_written as written
from in_process import ran
from tumblecal.capture.capture_plan import read_plan
from tumblecal.capture.emulator.config import read_emulation
from tumblecal.capture.protocols import protocols
from tumblecal.chain.rig_file import read_rig
from tumblecal.data.calibration import Calibration, calibration_text
from tumblecal.data.files import read_positions, write_positions
from tumblecal.devices import TARGETS
from tumblecal.effects.catalogue import catalogue, links_and_units
from tumblecal.recordings.dwells.by_columns import read_position_samples
from tumblecal.recordings.options import RecordingOptions
from tumblecal.recordings.reading import read_recording as write_samples
from tumblecal.studies.study_tables import read_study, rig_of_study


CONFIGS = written.CONFIGS
_TERMS = [
    {"axis": "z", "coefficient": 2e-4, "powers": [0, 0, 2], "kind": "product"},
    {"axis": "x", "coefficient": 1e-4, "powers": [1, 0, 0]},
]
_OWN = Calibration(np.eye(3) * 1.02, np.full(3, 2e-3), np.eye(12) * 1e-10, extra={"terms": _TERMS})
CALIBRATION = calibration_text(_OWN).encode()
# Whether a reader can see the damage, given the file before and after it.
Seen = Callable[[bytes, bytes], bool]
IMPORT = "import {file} --out {out}/samples.parquet"
IMPORT_FOLDER = "import {folder}/log --out {out}/samples.parquet"
CALIBRATE = "calibrate {file} --no-figures -q --out {out}"
WITH_HEAD = "calibrate {folder}/p.csv --no-figures -q --out {out} --head {file}"
APPLY = "apply {file} {folder}/samples.csv --out {out}/corrected.parquet"
BUDGET = "budget {folder}/p.csv {file} -q --out {out}"
CERTIFICATE = "certificate {folder}/c --admin {folder}/lab.toml --out {out}"
ADDED = "history {out}/h.db U1 --add {folder}/c"
SAMPLES, MEANS, CALIBRATED, CORRECTED = (
    (name,) for name in ("samples.parquet", "positions.csv", "calibration.json", "corrected.parquet")
)


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    - `name`: of the damaged file in the folder of a trial; `others`: the other files there.
    - `command`: its template; `read` is called instead if a command takes too long. `results`: files whose numbers count; none:
      the printed text.
    - `seen`: the damage that the format shows: a checksum, a length, an end of line.
    """

    name: str
    content: bytes
    command: str
    seen: Seen
    results: tuple[str, ...] = ()
    others: dict[str, bytes] = field(default_factory=dict)
    read: Callable[[Path], object] | None = None


def always(before: bytes, after: bytes) -> bool:
    """A checksum covers all of the file."""
    return True


def never(before: bytes, after: bytes) -> bool:
    """A file that people write: a different value is a different value."""
    return False


def shorter(before: bytes, after: bytes) -> bool:
    """The format has a length or an end, and no checksum."""
    return before.startswith(after)


def cut_in_line(before: bytes, after: bytes) -> bool:
    """A text that was cut within a line."""
    if not before.startswith(after) or after.endswith((b"\n", b"\r")) or before == after:
        return False
    return before[len(after) :].strip() != b""


def broken_frames(before: bytes, after: bytes) -> bool:
    """Frames with checks: an end within a frame does not show whether more came."""
    return not before.startswith(after)


def unless(whole: Callable[[bytes], bool]) -> Seen:
    """A format whose parts follow one another to its end."""
    return lambda before, after: not whole(after)


def numbers(path: Path) -> np.ndarray | str:
    """The numbers of a result: those of a table, or a document without names and dates."""
    if path.suffix == ".parquet":
        return pl.read_parquet(path).select(pl.col(pl.Float64)).to_numpy()
    if path.suffix == ".json":
        whole = json.loads(path.read_text())
        whole = whole if "matrix" in whole else {"parameters": whole.get("parameters")}
        return json.dumps({key: whole.get(key) for key in ("matrix", "bias", "covariance", "parameters")})
    return "\n".join(line for line in path.read_text().splitlines() if not line.startswith("#"))


def _study(path: Path) -> object:
    return rig_of_study(read_study(path, written.kind_of_study(path.read_bytes())))


def _rig(path: Path) -> object:
    rig = read_rig(path, *links_and_units(catalogue()))
    return rig, len(rig.plan)


def recordings() -> dict[str, Kind]:
    """Recordings of other programs."""
    listed = {
        "ulog": ("log.ulg", made.ulog(), unless(made.ulog_is_whole)),
        "ros1 bag": ("log.bag", made.ros1_bag(), shorter),
        "mcap": ("log.mcap", made.with_mcap_checks(made.ros2_bag(mcap=True)), always),
        "mcap unchecked": ("log.mcap", made.ros2_bag(mcap=True), shorter),
        "ros2 sqlite": ("log.db3", made.ros2_bag(mcap=False), shorter),
        "hdf5": ("log.h5", made.hdf5(checked=False), shorter),
        "hdf5 checked": ("log.h5", made.hdf5(checked=True), shorter),
        "mat": ("log.mat", made.matlab(compressed=False), shorter),
        "mat compressed": ("log.mat", made.matlab(compressed=True), shorter),
        "xlsx": ("log.xlsx", made.spreadsheet(), unless(made.zip_is_whole)),
        "json lines": ("log.jsonl", made.json_lines(), cut_in_line),
        "labelled text": ("log.txt", made.labelled(), cut_in_line),
        "dataflash": ("log.bin", made.dataflash(), unless(made.dataflash_is_whole)),
        "mtb": ("log.mtb", made.mtb(), broken_frames),
        "text, commas": ("log.csv", made.text(), cut_in_line),
        "text, semicolons": ("log.txt", made.text(";", "{:.9g}", comma=True), cut_in_line),
        "text, spaces": ("log.log", made.text(" ", "{:.5e}"), cut_in_line),
    }
    kinds = {name: Kind(file, content, IMPORT, seen, SAMPLES) for name, (file, content, seen) in listed.items()}
    for name, mcap in (("mcap", True), ("sqlite", False)):
        files = made.ros2_folder(mcap=mcap)
        for file, content in files.items():
            words = f"ros2 folder, {name}" + (", metadata" if file.endswith("yaml") else "")
            kinds[words] = Kind(file, content, IMPORT_FOLDER, shorter, SAMPLES, files)
    for name in ("ulog", "text, commas"):
        file, content, seen = listed[name]
        kinds[f"{name}, static"] = Kind(file, content, "reduce {file} --static --no-figures --out {out}", seen, MEANS)
    return kinds


def tables() -> dict[str, Kind]:
    """Position files and tables of samples."""
    table, positions = made.table_of_samples(), made.positions()
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "log.csv").write_bytes(made.text())
        write_samples(folder / "log.csv", folder / "samples.parquet", RecordingOptions())
        pl.DataFrame(made.position_rows()).write_parquet(folder / "foreign.parquet")
        (folder / "p.csv").write_bytes(positions)
        write_positions(folder / "p.parquet", read_positions(folder / "p.csv"))
        parquet = {path.stem: path.read_bytes() for path in folder.glob("*.parquet")}
    applied = "apply {folder}/c.json {file} --out {out}/corrected.parquet"
    return {
        "positions": Kind("p.csv", positions, CALIBRATE, cut_in_line, CALIBRATED),
        "positions, tabs": Kind("p.txt", made.positions("\t", "\r\n"), CALIBRATE, cut_in_line, CALIBRATED),
        "positions, m/s2": Kind("p.csv", made.positions_ms2(), CALIBRATE, cut_in_line, CALIBRATED),
        "positions, Parquet": Kind("p.parquet", parquet["p"], CALIBRATE, always, CALIBRATED),
        "positions, other Parquet": Kind("p.parquet", parquet["foreign"], CALIBRATE, shorter, CALIBRATED),
        "samples, Parquet": Kind("log.parquet", parquet["samples"], IMPORT, always, SAMPLES),
        "samples of positions": Kind("t.csv", table, "", cut_in_line, read=read_position_samples),
        "table of samples": Kind("t.csv", table, "reduce {file} --no-figures --out {out}", cut_in_line, MEANS),
        "table to apply": Kind("t.csv", table, applied, cut_in_line, CORRECTED, {"c.json": CALIBRATION}),
    }


def logs() -> dict[str, Kind]:
    """Byte logs, and the files of a capture's run."""
    with TemporaryDirectory() as name:
        run = written.capture(Path(name))
    kinds = {}
    for name, spoken in protocols().items():
        command = IMPORT + " --rate 50" + " --range-g 10" * (10.0 in spoken.ranges_g)
        if spoken.checked:
            kinds[f"bytes, {name}"] = Kind("log.bin", written.byte_log(name), command, broken_frames, SAMPLES)
        else:
            command = "decode {file} --rate-hz 50 --out {out}/samples.parquet"
            kinds[f"bytes, {name}"] = Kind("log.txt", written.byte_log(name), command, never, SAMPLES)
    kinds["bytes, mimu"] = Kind("log.bin", made.mimu(), IMPORT, broken_frames, SAMPLES)
    for name, seen in {"raw.log": always, "journal.log": unless(made.log_is_whole), "plan.toml": always}.items():
        kinds[f"run, {name}"] = Kind(name, run[name], "reduce {folder} --out {out}", seen, MEANS, run)
    return kinds


def _documents(folder: Path) -> dict[str, bytes]:
    """The files that the commands write for one position file of the unit U1."""
    data = folder / "p.csv"
    data.write_bytes(b"# serial_number: U1\n" + made.positions())
    (folder / "c.json").write_bytes(CALIBRATION)
    commands = [
        ("calibrate", data, "--no-figures", "--out", folder / "c", "--history", folder / "h.db"),
        ("diagnose", data, "--no-figures", "--out", folder / "d"),
        ("budget", data, CONFIGS / "considered_lab.toml", "--out", folder / "c"),
    ]
    for name in TARGETS:
        out = ("--to", name, "--gravity", "9.81", "--out", folder / f"to {name}")
        commands.append(("export", folder / "c.json", *out))
    for words in commands:
        outcome = ran(words)
        assert outcome.code == 0 and not outcome.traceback, (words, outcome)
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def documents() -> dict[str, Kind]:
    """Files of tumblecal, and files that people write for it."""
    with TemporaryDirectory() as name:
        done = _documents(Path(name))
    config = {path.stem: path.read_bytes() for path in CONFIGS.glob("*.toml")}
    admin, limits = config["certificate_lab"], config["certificate_limits"]
    calibrated = {f"c/{name}.json": done[f"c/{name}.json"] for name in ("calibration", "result", "budget")}
    diagnosed = {f"c/{name}.json": done[f"d/{name}.json"] for name in ("calibration", "diagnosis")}
    with_admin, positions = calibrated | {"lab.toml": admin}, {"p.csv": made.positions()}
    kinds = {
        "calibration": Kind("c.json", CALIBRATION, APPLY, shorter, CORRECTED, {"samples.csv": made.table_of_samples()}),
        "history": Kind("h.db", done["h.db"], "history {file} U1", shorter),
        "head": Kind("head.toml", written.HEAD, WITH_HEAD, never, CALIBRATED, positions),
        "rig": Kind("rig.toml", config["paper24"], "simulate {file} --out {out}/s.csv", never, ("s.csv",)),
        "considered": Kind("inputs.toml", config["considered_lab"], BUDGET, never, ("budget.json",), positions),
        "admin": Kind("lab.toml", admin, CERTIFICATE, never, (), with_admin),
        "limits": Kind("limits.toml", limits, CERTIFICATE + " --limits {file}", never, ("dcc.xml",), with_admin),
        "plan": Kind("plan.toml", config["capture_demo"], "", never, read=read_plan),
        "emulation": Kind("e.toml", config["capture_emulator"], "", never, read=read_emulation),
    }
    for name, file, command, others in (
        ("calibration, certificate", "c/calibration.json", CERTIFICATE, with_admin),
        ("result", "c/result.json", ADDED, calibrated),
        ("budget", "c/budget.json", CERTIFICATE, with_admin),
        ("diagnosis", "c/diagnosis.json", CERTIFICATE, diagnosed | {"lab.toml": admin}),
        ("diagnosis, history", "c/diagnosis.json", ADDED, diagnosed),
    ):
        kinds[name] = Kind(file, others[file], command, shorter, (), others)
    for name in ("budget_gimbal", "grid48", "hand_held", "hidden_effect", "remount"):
        kinds[f"rig, {name}"] = Kind("r.toml", config[name], "", never, read=_rig)
    for name in sorted(own for own in config if own.startswith("study")):
        kinds[name] = Kind(f"{name}.toml", config[name], "", never, (), written.configs(), _study)
    for name in TARGETS:
        command = f"compare {name}:{{file}} {{folder}}/c.json"
        kinds[f"device, {name}"] = Kind("device.txt", done[f"to {name}"], command, never, (), {"c.json": CALIBRATION})
    return kinds


def all_kinds() -> dict[str, Kind]:
    """All kinds by their names."""
    return recordings() | tables() | logs() | documents()
