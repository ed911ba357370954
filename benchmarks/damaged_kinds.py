"""Each kind of file that tumblecal reads: a valid one, the command that takes it, its numbers, and which damage it can show."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl

import damaged_made as made
import damaged_written as written
from damaged_run import ran
from tumblecal.capture.capture_plan import read_plan
from tumblecal.capture.emulator.config import read_emulation
from tumblecal.capture.protocols import protocols
from tumblecal.capture.recordings.options import RecordingOptions
from tumblecal.capture.reduction.position_samples import read_position_samples
from tumblecal.capture.rows.sample_file import write_samples
from tumblecal.chain.rig_file import read_rig
from tumblecal.data.calibration import Calibration, calibration_text
from tumblecal.data.files import read_positions, write_positions
from tumblecal.devices import TARGETS
from tumblecal.effects.catalogue import catalogue, links_and_units
from tumblecal.studies.study_tables import read_study, rig_of_study


CONFIGS = Path(__file__).parents[1] / "configs"
_TERMS = [
    {"axis": "z", "coefficient": 2e-4, "powers": [0, 0, 2], "kind": "product"},
    {"axis": "x", "coefficient": 1e-4, "powers": [1, 0, 0]},
]
_OWN = Calibration(np.eye(3) * 1.02, np.full(3, 2e-3), np.eye(12) * 1e-10, extra={"terms": _TERMS})
CALIBRATION = calibration_text(_OWN).encode()
# The command's words, given the damaged file, the folder of the trial and the folder for results.
Words = Callable[[Path, Path, Path], Sequence[object]]
# Whether a reader can see the damage, by the file before and after it.
Seen = Callable[[bytes, bytes], bool]


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    **Arguments:**

    - `name`: of the file that is damaged, within the folder of a trial; `beside`: the other files there.
    - `words`: of the command; `read` is called in its place where a command takes too long. `results`: the files whose
      numbers count; none: what the command prints.
    - `seen`: which damage the format shows: a checksum, a length, an end of line.
    """

    name: str
    content: bytes
    words: Words | None
    seen: Seen
    results: tuple[str, ...] = ()
    beside: dict[str, bytes] = field(default_factory=dict)
    read: Callable[[Path], object] | None = None


def always(before: bytes, after: bytes) -> bool:
    """A checksum covers all of the file."""
    return True


def shorter(before: bytes, after: bytes) -> bool:
    """The format has a length or an end, and no checksum."""
    return before.startswith(after)


def cut_in_line(before: bytes, after: bytes) -> bool:
    """A text that was cut within a line, by more than the last digits that other lines do not have either."""
    if not before.startswith(after) or after.endswith((b"\n", b"\r")) or before == after:
        return False
    return before[len(after) :].strip() != b""


def broken_ulog(before: bytes, after: bytes) -> bool:
    """The messages of a log do not follow one another to its end."""
    return not made.ulog_is_whole(after)


def broken_frames(before: bytes, after: bytes) -> bool:
    """Frames with checks of their own: an end within a frame does not show whether more came."""
    return not before.startswith(after)


def broken_log(before: bytes, after: bytes) -> bool:
    """The records of a journal do not follow one another to its end."""
    return not made.log_is_whole(after)


def never(before: bytes, after: bytes) -> bool:
    """A file that people write: another value is another value."""
    return False


def numbers(path: Path) -> np.ndarray | str:
    """The numbers of a result: those of a table, or the text of a document without what names the file or the day."""
    if path.suffix == ".parquet":
        frame = pl.read_parquet(path).select(pl.col(pl.Float64))
        return frame.to_numpy()
    text = path.read_text()
    if path.suffix == ".json":
        whole = json.loads(text)
        whole = whole if "matrix" in whole else {"parameters": whole.get("parameters")}
        return json.dumps({key: whole.get(key) for key in ("matrix", "bias", "covariance", "parameters")})
    return "\n".join(line for line in text.splitlines() if not line.startswith("#"))


def _import(path: Path, folder: Path, out: Path) -> Sequence[object]:
    return ("import", path, "--out", out / "samples.parquet")


def _import_folder(path: Path, folder: Path, out: Path) -> Sequence[object]:
    return _import(path.parent, folder, out)


def _import_bytes(more: Sequence[str], path: Path, folder: Path, out: Path) -> Sequence[object]:
    return (*_import(path, folder, out), "--rate", "50", *more)


def _decode(path: Path, folder: Path, out: Path) -> Sequence[object]:
    return ("decode", path, "--rate-hz", "50", "--out", out / "samples.parquet")


def _reduce_static(path: Path, folder: Path, out: Path) -> Sequence[object]:
    return ("reduce", path, "--static", "--no-figures", "--out", out)


def _reduce(path: Path, folder: Path, out: Path) -> Sequence[object]:
    return ("reduce", path, "--no-figures", "--out", out)


def _calibrate(path: Path, folder: Path, out: Path) -> Sequence[object]:
    return ("calibrate", path, "--no-figures", "-q", "--out", out)


def _reduce_run(path: Path, folder: Path, out: Path) -> Sequence[object]:
    return ("reduce", folder, "--out", out)


def _apply(path: Path, folder: Path, out: Path) -> Sequence[object]:
    return ("apply", path, folder / "samples.csv", "--out", out / "corrected.parquet")


def _corrected(path: Path, folder: Path, out: Path) -> Sequence[object]:
    return ("apply", folder / "c.json", path, "--out", out / "corrected.parquet")


def _certificate(path: Path, folder: Path, out: Path) -> Sequence[object]:
    return ("certificate", folder / "c", "--admin", folder / "lab.toml", "--out", out)


def _certificate_limits(path: Path, folder: Path, out: Path) -> Sequence[object]:
    return (*_certificate(path, folder, out), "--limits", path)


def _added(path: Path, folder: Path, out: Path) -> Sequence[object]:
    return ("history", out / "h.db", "U1", "--add", path.parent)


def _history(path: Path, folder: Path, out: Path) -> Sequence[object]:
    return ("history", path, "U1")


def _with_head(path: Path, folder: Path, out: Path) -> Sequence[object]:
    return (*_calibrate(folder / "p.csv", folder, out), "--head", path)


def _simulate(path: Path, folder: Path, out: Path) -> Sequence[object]:
    return ("simulate", path, "--out", out / "s.csv")


def _budget(path: Path, folder: Path, out: Path) -> Sequence[object]:
    return ("budget", folder / "p.csv", path, "-q", "--out", out)


def _compare(name: str, path: Path, folder: Path, out: Path) -> Sequence[object]:
    return ("compare", f"{name}:{path}", folder / "c.json")


def _study(path: Path) -> object:
    study = read_study(path, written.kind_of_study(path.read_bytes()))
    return rig_of_study(study)


def _rig(path: Path) -> object:
    rig = read_rig(path, *links_and_units(catalogue()))
    return rig, len(rig.plan)


def _documents(folder: Path) -> dict[str, bytes]:
    """What the commands write of one position file of the unit U1."""
    data, inputs = folder / "p.csv", CONFIGS / "considered_lab.toml"
    data.write_bytes(b"# serial_number: U1\n" + made.positions())
    (folder / "c.json").write_bytes(CALIBRATION)
    commands = [
        ("calibrate", data, "--no-figures", "--out", folder / "c", "--history", folder / "h.db"),
        ("diagnose", data, "--no-figures", "--out", folder / "d"),
        ("budget", data, inputs, "--out", folder / "c"),
    ]
    commands += [
        ("export", folder / "c.json", "--to", name, "--gravity", "9.81", "--out", folder / f"to {name}")
        for name in TARGETS
    ]
    for words in commands:
        outcome = ran(words)
        assert outcome.code == 0 and not outcome.traceback, (words, outcome)
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def recordings() -> dict[str, Kind]:
    """Recordings made elsewhere."""
    samples, means = ("samples.parquet",), ("positions.csv",)
    own = {
        "ulog": ("log.ulg", made.ulog(), broken_ulog),
        "ros1 bag": ("log.bag", made.ros1_bag(), shorter),
        "mcap": ("log.mcap", made.with_mcap_checks(made.ros2_bag(mcap=True)), always),
        "mcap unchecked": ("log.mcap", made.ros2_bag(mcap=True), shorter),
        "ros2 sqlite": ("log.db3", made.ros2_bag(mcap=False), shorter),
        "hdf5": ("log.h5", made.hdf5(checked=False), shorter),
        "hdf5 checked": ("log.h5", made.hdf5(checked=True), shorter),
        "mat": ("log.mat", made.matlab(compressed=False), shorter),
        "mat compressed": ("log.mat", made.matlab(compressed=True), shorter),
        "xlsx": ("log.xlsx", made.spreadsheet(), lambda before, after: not made.zip_is_whole(after)),
        "json lines": ("log.jsonl", made.json_lines(), cut_in_line),
        "labelled text": ("log.txt", made.labelled(), cut_in_line),
        "dataflash": ("log.bin", made.dataflash(), lambda before, after: not made.dataflash_is_whole(after)),
        "mtb": ("log.mtb", made.mtb(), broken_frames),
        "text, commas": ("log.csv", made.text(), cut_in_line),
        "text, semicolons": ("log.txt", made.text(";", "{:.9g}", comma=True), cut_in_line),
        "text, spaces": ("log.log", made.text(" ", "{:.5e}"), cut_in_line),
    }
    kinds = {name: Kind(file, content, _import, seen, samples) for name, (file, content, seen) in own.items()}
    for name, mcap in (("mcap", True), ("sqlite", False)):
        files = made.ros2_folder(mcap=mcap)
        (log,) = (own for own in files if own.endswith((".mcap", ".db3")))
        for own, damaged in ((log, log), ("metadata", "log/metadata.yaml")):
            title = f"ros2 folder, {name}" + (", metadata" if own == "metadata" else "")
            kinds[title] = Kind(damaged, files[damaged], _import_folder, shorter, samples, files)
    for name in ("ulog", "text, commas"):
        kinds[f"{name}, static"] = Kind(kinds[name].name, kinds[name].content, _reduce_static, kinds[name].seen, means)
    return kinds


def tables() -> dict[str, Kind]:
    """Position files and tables of samples."""
    calibrated, reduced, table = ("calibration.json",), ("positions.csv",), made.table_of_samples()
    frame = pl.DataFrame(made.position_rows())
    in_ms2 = made.positions_ms2()
    with TemporaryDirectory() as name:
        path, foreign = Path(name) / "samples.parquet", Path(name) / "foreign.parquet"
        (Path(name) / "log.csv").write_bytes(made.text())
        write_samples(Path(name) / "log.csv", path, RecordingOptions())
        frame.write_parquet(foreign)
        (Path(name) / "p.csv").write_bytes(made.positions())
        write_positions(Path(name) / "p.parquet", read_positions(Path(name) / "p.csv"))
        own, other, positions = path.read_bytes(), foreign.read_bytes(), (Path(name) / "p.parquet").read_bytes()
    return {
        "positions": Kind("p.csv", made.positions(), _calibrate, cut_in_line, calibrated),
        "positions, tabs": Kind("p.txt", made.positions("\t", "\r\n"), _calibrate, cut_in_line, calibrated),
        "positions, m/s2": Kind("p.csv", in_ms2, _calibrate, cut_in_line, calibrated),
        "positions, Parquet": Kind("p.parquet", positions, _calibrate, always, calibrated),
        "positions, other Parquet": Kind("p.parquet", other, _calibrate, shorter, calibrated),
        "samples, Parquet": Kind("log.parquet", own, _import, always, ("samples.parquet",)),
        "samples of positions": Kind("t.csv", table, None, cut_in_line, read=read_position_samples),
        "table of samples": Kind("t.csv", table, _reduce, cut_in_line, reduced),
        "table to apply": Kind(
            "t.csv", table, _corrected, cut_in_line, ("corrected.parquet",), {"c.json": CALIBRATION}
        ),
    }


def logs() -> dict[str, Kind]:
    """Byte logs, and the files of a capture's run."""
    with TemporaryDirectory() as name:
        run = written.capture(Path(name))
    samples, kinds = ("samples.parquet",), dict[str, Kind]()
    for name, spoken in protocols().items():
        content, more = written.byte_log(name), ("--range-g", "10") if 10.0 in spoken.ranges_g else ()
        if spoken.checked:
            kinds[f"bytes, {name}"] = Kind("log.bin", content, partial(_import_bytes, more), broken_frames, samples)
        else:
            kinds[f"bytes, {name}"] = Kind("log.txt", content, _decode, never, samples)
    kinds["bytes, mimu"] = Kind("log.bin", made.mimu(), _import, broken_frames, samples)
    seen = {"raw.log": always, "journal.log": broken_log, "plan.toml": always}
    for name, own in seen.items():
        kinds[f"run, {name}"] = Kind(name, run[name], _reduce_run, own, ("positions.csv",), run)
    return kinds


def documents() -> dict[str, Kind]:
    """What tumblecal writes, and what people write for it."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        done = _documents(folder)
    admin, limits = ((CONFIGS / f"certificate_{name}.toml").read_bytes() for name in ("lab", "limits"))
    folder = {f"c/{name}": done[f"c/{name}"] for name in ("calibration.json", "result.json", "budget.json")}
    diagnosed = {"c/calibration.json": done["d/calibration.json"], "c/diagnosis.json": done["d/diagnosis.json"]}
    both = folder | {"lab.toml": admin}
    positions = {"p.csv": made.positions()}
    kinds = {
        "calibration": Kind(
            "c.json", CALIBRATION, _apply, shorter, ("corrected.parquet",), {"samples.csv": made.table_of_samples()}
        ),
        "calibration, certificate": Kind(
            "c/calibration.json", folder["c/calibration.json"], _certificate, shorter, (), both
        ),
        "result": Kind("c/result.json", folder["c/result.json"], _added, shorter, (), folder),
        "budget": Kind("c/budget.json", folder["c/budget.json"], _certificate, shorter, (), both),
        "diagnosis": Kind(
            "c/diagnosis.json",
            diagnosed["c/diagnosis.json"],
            _certificate,
            shorter,
            (),
            diagnosed | {"lab.toml": admin},
        ),
        "diagnosis, history": Kind("c/diagnosis.json", diagnosed["c/diagnosis.json"], _added, shorter, (), diagnosed),
        "history": Kind("h.db", done["h.db"], _history, shorter),
        "head": Kind("head.toml", written.HEAD, _with_head, never, ("calibration.json",), positions),
        "rig": Kind("rig.toml", (CONFIGS / "paper24.toml").read_bytes(), _simulate, never, ("s.csv",)),
        "considered": Kind(
            "inputs.toml", (CONFIGS / "considered_lab.toml").read_bytes(), _budget, never, ("budget.json",), positions
        ),
        "admin": Kind("lab.toml", admin, _certificate, never, (), both),
        "limits": Kind("limits.toml", limits, _certificate_limits, never, ("dcc.xml",), both),
        "plan": Kind("plan.toml", (CONFIGS / "capture_demo.toml").read_bytes(), None, never, read=read_plan),
        "emulation": Kind("e.toml", (CONFIGS / "capture_emulator.toml").read_bytes(), None, never, read=read_emulation),
    }
    for name in ("budget_gimbal", "grid48", "hand_held", "hidden_effect", "remount"):
        kinds[f"rig, {name}"] = Kind("r.toml", (CONFIGS / f"{name}.toml").read_bytes(), None, never, read=_rig)
    for path in sorted(CONFIGS.glob("study*.toml")):
        own = path.read_bytes()
        kinds[path.stem] = Kind(path.name, own, None, never, (), written.configs(), _study)
    for name in TARGETS:
        words = partial(_compare, name)
        kinds[f"device, {name}"] = Kind("device.txt", done[f"to {name}"], words, never, (), {"c.json": CALIBRATION})
    return kinds


def all_kinds() -> dict[str, Kind]:
    """All kinds by their names."""
    return recordings() | tables() | logs() | documents()
