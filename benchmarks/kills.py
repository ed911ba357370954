"""Kill -9 at random moments while something is recorded or written: nothing acknowledged is lost, nothing half-written.

python benchmarks/kills.py [--kills 1000] [--kinds recorder,guide,reduce,study,simulate,calibrate,diagnose]

The kills are shared out over the kinds. `recorder`: the recorder at 2000 Hz, torn tails added to its log. `guide`: a whole
guided run, resumed after each kill. `study`: a study of 200 chunks, resumed after each kill; then it ends, and its result
must be that of an undisturbed one. The others write their files again and again, two versions in turn: after a kill each
file must be one of the two, whole, and all files of one set of results must be of the same version. Ends with code 1 when
anything was lost, half-written or mixed.
"""

import argparse
import contextlib
import os
import re
import select
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import polars as pl

from capture_losses import sequence_of, sequence_rates
from tumblecal.capture.decoding.framing import decode_all
from tumblecal.capture.decoding.samples import Settings
from tumblecal.capture.emulator.config import Emulation
from tumblecal.capture.emulator.device import VirtualDevice
from tumblecal.capture.emulator.instrument import VirtualInstrument
from tumblecal.capture.emulator.operator import Follower
from tumblecal.capture.journal import RAW_NAME, read_journal, replayed, sha256_of
from tumblecal.capture.log import LogWriter, RecordKind, read_log
from tumblecal.capture.port.recording import Recording
from tumblecal.capture.protocols import protocol
from tumblecal.capture.run.run_folder import begin, resume
from tumblecal.capture.run.session import capture
from tumblecal.ground.atomic import write_text
from tumblecal.ground.result_set import result_set


CONFIGS = Path(__file__).parents[1] / "configs"
KINDS = {"recorder": 15, "guide": 10, "reduce": 20, "study": 20, "simulate": 12, "calibrate": 12, "diagnose": 11}
PLAN = """
[port]
url = "IMU"
speed = 20.0
[positions]
beta_deg = [0, 30, 60]
alpha_deg = [ALPHAS]
[dwell]
seconds = 1.0
settle_s = 0.2
"""


def fast_instrument(link: str) -> None:
    config = Emulation.model_validate({"instrument": {"rate_hz": 2000.0}})
    VirtualInstrument(VirtualDevice(config, rates=sequence_rates), Path(link)).run(36000.0)


def following_instrument(link: str, folder: str) -> None:
    config = Emulation.model_validate({"head": {"turn_s": 0.5, "reaction_s": 0.1}})
    VirtualInstrument(VirtualDevice(config), Path(link), speed=20.0, operator=Follower(Path(folder), config)).run(
        720000.0
    )


@contextlib.contextmanager
def instrument(target: Callable[..., None], link: Path, *arguments: str):
    process = get_context("spawn").Process(target=target, args=(str(link), *arguments), daemon=True)
    process.start()
    while not link.exists():
        time.sleep(0.01)
    try:
        yield
    finally:
        process.kill()
        process.join()


def started(work: Callable[[], object]) -> tuple[int, int]:
    """`work` in a process of its own: its number, and where to read what it says on its output.

    The first process neither writes nor reads tables: their library's threads would not live on in a child.
    """
    reader, writer = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # nor do those of JAX: children only write what is computed already
        child = os.fork()
    if child == 0:
        os.dup2(writer, 1)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        try:
            work()
        except BaseException as error:
            os.write(1, f"\nFAILED {type(error).__name__} {error}\n".encode())
        os._exit(0)
    os.close(writer)
    return child, reader


def ended(child: int, reader: int) -> bytes:
    """What a process had said when it ended."""
    with open(reader, "rb") as file:
        said = file.read()
    os.waitpid(child, 0)
    return said


def killed(work: Callable[[], object], wait_s: float, word: bytes = b"") -> bytes:
    """What `work` had said when it was killed, this time after it said a word (at the latest 300 s after its start)."""
    child, reader = started(work)
    said, deadline = b"", time.monotonic() + 300.0
    while word not in said and time.monotonic() < deadline:
        if select.select([reader], [], [], 0.1)[0]:
            data = os.read(reader, 65536)
            said += data
            deadline = deadline if data else 0.0
    time.sleep(wait_s)
    os.kill(child, signal.SIGKILL)
    return said + ended(child, reader)


def undisturbed(work: Callable[[], object]) -> None:
    """`work` to its end."""
    faults = failures(ended(*started(work)))
    if faults:
        raise SystemExit("\n".join(faults))


def failures(said: bytes) -> list[str]:
    return [line.decode() for line in said.splitlines() if line.startswith(b"FAILED")]


def recorder(kills: int, folder: Path, random: np.random.Generator) -> list[str]:
    """Samples come once and in order, and every place that was told to be on the disk is still there."""
    log, acknowledged = folder / "raw.log", []
    with instrument(fast_instrument, folder / "imu"):
        for _ in range(kills):
            recording = Recording(log, str(folder / "imu"), 921600)
            time.sleep(float(random.uniform(0, 0.4)))
            recording.poll()
            os.kill(recording.pid, signal.SIGKILL)
            recording.stop()
            if recording.synced:
                acknowledged.append((recording.synced, log.read_bytes()[recording.synced - 16 : recording.synced]))
            if random.random() < 0.5:  # what a power cut may leave behind: an unfinished record
                with open(log, "ab") as file:
                    file.write(log.read_bytes()[-200:][: int(random.integers(1, 150))])
    LogWriter(log).close()
    content, records = log.read_bytes(), read_log(log)
    bad = [f"place {stop} is lost" for stop, tail in acknowledged if content[stop - 16 : stop] != tail]
    decoder = protocol("stim300").decoder(Settings((10.0,) * 3))
    samples = decode_all(decoder, b"".join(r.payload for r in records if r.kind == RecordKind.BYTES)).samples
    numbers = sequence_of(samples.rate)
    bad += ["samples twice or out of order"] * bool((np.diff(numbers) <= 0).any())
    print(f"  recorder: {len(acknowledged)} places were told to be on the disk; {len(numbers)} samples in the log")
    return bad


def guide(kills: int, folder: Path, random: np.random.Generator) -> list[str]:
    """What the screen called done stays done, bit for bit, over kills and resumptions."""
    run, plan, bad = folder / "run", folder / "plan.toml", []
    alphas = ", ".join(f"{a:.2f}" for a in np.arange(max(8, 5 * kills)) * 360.0 * 0.381966 % 360.0)
    plan.write_text(PLAN.replace("IMU", str(folder / "imu")).replace("ALPHAS", alphas))
    before, shown = {}, 0
    with instrument(following_instrument, folder / "imu", str(run)):
        begin(plan, run).journal.close()
        for kill in range(kills):

            def work() -> None:
                with resume(run) as held:
                    capture(held, plain=True)

            # Most kills fall into the measuring, some into the start.
            word = b"SETTLING" if random.random() < 0.7 else b""
            said = killed(work, float(random.uniform(0.0, 1.5)), word)
            bad += failures(said)
            shown = max(
                [shown, *(int(line.split(b" of ")[0].split()[-1]) for line in said.splitlines() if b" of " in line)]
            )
            accepted = replayed(read_journal(run)).accepted
            if len(accepted) < shown:
                bad.append(f"{shown} positions were shown as done, {len(accepted)} are")
            bad += [f"position {k} has changed" for k in before if accepted.get(k) != before[k]]
            before = accepted
            if kill % 10 == 9:
                print(
                    f"    {kill + 1} of {kills} kills, {len(accepted)} positions accepted, {len(bad)} faults",
                    flush=True,
                )
    for k, attempt in before.items():
        if sha256_of(run / RAW_NAME, attempt.log_start, attempt.log_stop) != attempt.sha256:
            bad.append(f"position {k}: its bytes are not those that were accepted")
    bad += ["no position was accepted: this shows nothing"] * (kills > 10 and not before)
    print(f"  guide: {shown} positions were shown as done, {len(before)} are accepted, all with their bytes")
    return bad


def undated(path: Path) -> bytes:
    """A file's bytes but for the second in which it was written."""
    return re.sub(rb"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", b"DATE", path.read_bytes())


def writing(
    name: str,
    write: list[Callable[[Path], object]],
    kills: int,
    folder: Path,
    random: np.random.Generator,
    names: tuple[str, ...] = (),
) -> list[str]:
    """Two versions written in turn: each file is one of them, whole; with `names` they are sets that are never mixed."""
    versions = []
    for number, version in enumerate(write):
        whole = folder / f"version{number}" / "written"
        whole.mkdir(parents=True)
        undisturbed(partial(version, whole))
        versions.append({path.name: undated(path) for path in whole.iterdir()})
    if names:  # what takes long is done, so that kills fall into the writing
        write = [partial(as_set, folder / f"version{number}" / "written", names) for number in range(len(write))]
    place, bad, rounds = folder / "written", [], 0
    place.mkdir()

    def work() -> None:
        for number in range(1_000_000):
            write[number % len(write)](place)
            os.write(1, b".")

    aside, whole_sets, parts = 0, 0, 0
    for _ in range(kills):
        said = killed(work, float(random.uniform(0.005, 0.3)))
        bad, rounds = bad + failures(said), rounds + said.count(b".")
        if names:
            there = {path.name: undated(path) for path in place.iterdir() if path.is_file()}
            whole_sets += there in versions
            parts += there not in versions
            if not any(there.items() <= version.items() for version in versions):
                bad.append(f"files of two sets: {', '.join(sorted(there))}")
        for path in place.iterdir():
            if path.name.startswith("."):
                aside += 1
                path.is_dir() or path.unlink()
            elif undated(path) not in [version.get(path.name) for version in versions]:
                bad.append(f"{path.name} is half-written")
    if names:
        undisturbed(partial(write[0], place))
        left = {path.name: undated(path) if path.is_file() else b"" for path in place.iterdir()}
        bad += ["what killed processes left is still there"] * (left != versions[0])
        print(f"  {name}: {whole_sets} whole sets after a kill, {parts} parts of one set")
    seen = sum(p.exists() for p in (place / n for n in versions[0]))
    print(
        f"  {name}: {rounds} rounds written, {seen} of {len(versions[0])} files there; {aside} were being written aside"
    )
    return bad


def as_set(source: Path, names: tuple[str, ...], folder: Path) -> None:
    """Write the files of another folder as one set of results."""
    with result_set(folder, names) as aside:
        for path in source.iterdir():
            write_text(aside / path.name, path.read_text("utf-8"))


def reduce(kills: int, folder: Path, random: np.random.Generator) -> list[str]:
    """positions.csv, positions.parquet and reduction.json of a small run."""
    from tumblecal.capture.reduction.reduce import reduce as reduced
    from tumblecal.capture.reduction.reduction import write_reduction

    run, plan = folder / "run", folder / "plan.toml"
    text = PLAN.replace("IMU", str(folder / "imu")).replace("ALPHAS", "0, 90").replace("seconds = 1.0", "seconds = 4.0")
    plan.write_text(text.replace("[0, 30, 60]", "[0]"))
    with instrument(following_instrument, folder / "imu", str(run)):
        undisturbed(partial(captured, plan, run))
    result = reduced(run)

    return writing("reduce", [partial(write_reduction, result)], kills, folder, random)


def captured(plan: Path, run: Path) -> None:
    with begin(plan, run) as held:
        capture(held, plain=True)


class ChunksOfNumbers:
    """A study whose chunks are quick to make, so that kills fall into the writing."""

    chunks, trials, chunk_bytes, seconds, programs = 200, 200, 8000, 1.0, 1

    def trials_of(self, chunk: int) -> int:
        """One trial."""
        return 1

    def trials_in(self, arrays: dict[str, np.ndarray]) -> float:
        """One trial."""
        return 1.0

    def compute(self, chunk: int) -> dict[str, np.ndarray]:
        """Numbers that depend on the chunk alone."""
        return {"values": np.random.default_rng(chunk).normal(size=1000)}

    def summary(self, chunks):
        """Their sums."""
        sums = [float(arrays["values"].sum()) for arrays in chunks]
        return {"schema": "tumblecal.study.coverage/1", "sum": sum(sums)}, {"sums": pl.DataFrame({"sum": sums})}


def study(kills: int, folder: Path, random: np.random.Generator) -> list[str]:
    """Chunks that were counted are there after the kill; the resumed study ends as an undisturbed one."""
    from tumblecal.studies.run import run
    from tumblecal.studies.study_tables import read_study

    tables, bad, studies = read_study(CONFIGS / "study_coverage.toml", "coverage"), [], 0
    counted = 0
    undisturbed(partial(run, tables, folder / "whole", study=ChunksOfNumbers()))
    place = folder / "study0"
    whole = {
        p.name: p.read_bytes()
        for p in (folder / "whole").iterdir()
        if p.is_file() and p.suffix in (".json", ".parquet")
    }
    for kill in range(kills):

        def work(place: Path = place) -> None:
            run(tables, place, study=ChunksOfNumbers(), progress=lambda done: os.write(1, f"{done}\n".encode()))
            os.write(1, b"ended\n")

        said = killed(work, float(random.uniform(0.01, 0.3)))
        bad += failures(said)
        told = [int(line) for line in said.split() if line.isdigit()]
        if counted and told and max(told) < counted:
            bad.append(f"{counted} chunks were counted before, {max(told)} now")
        counted = max([counted, *told])
        there = len(list((place / "chunks").glob("[0-9]*"))) if (place / "chunks").exists() else 0
        if there < counted:
            bad.append(f"{counted} chunks were counted, {there} are there")
        if b"ended" in said or kill == kills - 1:
            undisturbed(partial(run, tables, place, study=ChunksOfNumbers()))
            studies += 1
            bad += [
                f"{name} is not that of an undisturbed study"
                for name in whole
                if (place / name).read_bytes() != whole[name]
            ]
            place, counted = folder / f"study{studies}", 0
    print(f"  study: {studies} studies of {ChunksOfNumbers.chunks} chunks ended as undisturbed ones")
    return bad


def simulate(kills: int, folder: Path, random: np.random.Generator) -> list[str]:
    """Position files of two seeds."""
    from tumblecal.data import write_positions

    sets = [position_set(seed) for seed in (1, 2)]

    def writer(data):
        return lambda place: [write_positions(place / f"positions.{end}", data) for end in ("csv", "parquet")]

    return writing("simulate", [writer(data) for data in sets], kills, folder, random)


def position_set(seed: int):
    from tumblecal.effects import catalogue
    from tumblecal.effects.catalogue import read_rig_with_effects
    from tumblecal.simulation.position_means import simulated

    return simulated(read_rig_with_effects(CONFIGS / "paper24.toml", catalogue()), seed, None)


def calibrate(kills: int, folder: Path, random: np.random.Generator) -> list[str]:
    """Calibrations of two seeds, with figures and page and without."""
    from tumblecal.cli.calibrate import _SET as names
    from tumblecal.cli.model_options import StatedModel
    from tumblecal.cli.options import ModelOptions
    from tumblecal.estimation.methods import all_methods
    from tumblecal.report.calibration_figures import draw_calibration
    from tumblecal.report.calibration_page import write_calibration_page
    from tumblecal.report.result_file import write_calibrated

    model = StatedModel.of(ModelOptions())

    def writer(data, drawn):
        result = all_methods(model.problem(data))

        def write(place):
            write_calibrated(place, result)
            if drawn:
                write_calibration_page(place / "calibration.html", result, draw_calibration(place, result))

        return write

    write = [writer(position_set(seed), drawn) for seed, drawn in ((1, True), (2, False))]
    return writing("calibrate", write, kills, folder, random, names)


def diagnose(kills: int, folder: Path, random: np.random.Generator) -> list[str]:
    """Diagnoses of two seeds, without the figures."""
    from tumblecal.cli.diagnosis_batch import DIAGNOSIS_SET
    from tumblecal.diagnosis import Diagnoser
    from tumblecal.effects import catalogue
    from tumblecal.planning import NextPlan
    from tumblecal.report.diagnosis_files import write_diagnosis

    diagnoser = Diagnoser(catalogue())

    def writer(data):
        result = diagnoser(data)
        return lambda place: write_diagnosis(place, result, NextPlan(), figures=False)

    return writing("diagnose", [writer(position_set(seed)) for seed in (1, 2)], kills, folder, random, DIAGNOSIS_SET)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--kills", type=int, default=1000)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    kinds = arguments.kinds.split(",")
    if any(kind in ("study", "simulate", "calibrate", "diagnose") for kind in kinds):
        from tumblecal.cli.start import start

        start()
    share = arguments.kills / sum(KINDS[kind] for kind in kinds)
    random, total, faults = np.random.default_rng(arguments.seed), 0, []
    with tempfile.TemporaryDirectory(prefix="tumblecal-kills-") as folder:
        for kind in kinds:
            kills, begun = max(1, round(share * KINDS[kind])), time.monotonic()
            (Path(folder) / kind).mkdir()
            bad = globals()[kind](kills, Path(folder) / kind, random)
            total, faults = total + kills, faults + [f"{kind}: {text}" for text in bad]
            print(f"  {kind}: {kills} kills in {time.monotonic() - begun:.0f} s, {len(bad)} faults", flush=True)
    print(f"{total} kills; lost, half-written or mixed: {len(faults)}")
    print("\n".join(faults[:20]))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
