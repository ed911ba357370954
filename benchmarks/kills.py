"""Kill -9 at random moments while something is recorded, measured or studied: nothing acknowledged is lost.

    python benchmarks/kills.py --kills 1000 --kinds recorder,guide,study

The kills are distributed over the kinds. `recorder`: the recorder at 2000 Hz, torn tails added to its log. `guide`: a whole
guided run, resumed after each kill. `study`: a study of 200 chunks, resumed after each kill; its result must be that of an
undisturbed one. Exit code 1: something was lost or differs. Sets of results: `tests/data/test_result_sets.py` kills the
process that writes them at each event.
"""

import argparse
import contextlib
import os
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


CONFIGS = Path(__file__).parents[1] / "configs"
# Weights of the kinds.
KINDS = {"recorder": 15, "guide": 10, "study": 20}
PLAN = """
[port]
url = "{link}"
speed = 20.0
[positions]
beta_deg = {beta}
alpha_deg = {alpha}
[dwell]
seconds = {seconds}
settle_s = 0.2
"""


def sequence_rates(numbers: np.ndarray) -> np.ndarray:
    """Sample numbers hidden in the angular rates: the truth is in the data."""
    return np.stack([numbers // 65536 - 100.0, numbers % 65536, 0 * numbers], axis=1) / 2**14


def sequence_of(rates: np.ndarray) -> np.ndarray:
    """The numbers hidden in angular rates."""
    hidden = np.rint(rates[:, :2] * 2**14).astype(np.int64)
    return (hidden[:, 0] + 100) * 65536 + hidden[:, 1]


def device(link: str, folder: str) -> None:
    """A virtual device: with a folder, one that is turned as its run asks; without one, at 2000 Hz."""
    if folder:
        config = Emulation.model_validate({"head": {"turn_s": 0.5, "reaction_s": 0.1}})
        operator = Follower(Path(folder), config)
        VirtualInstrument(VirtualDevice(config), Path(link), speed=20.0, operator=operator).run(720000.0)
        return
    config = Emulation.model_validate({"instrument": {"rate_hz": 2000.0}})
    VirtualInstrument(VirtualDevice(config, rates=sequence_rates), Path(link)).run(36000.0)


@contextlib.contextmanager
def instrument(link: Path, folder: str = ""):
    """The device in a process of its own."""
    process = get_context("spawn").Process(target=device, args=(str(link), folder), daemon=True)
    process.start()
    while not link.exists():
        time.sleep(0.01)
    try:
        yield
    finally:
        process.kill()
        process.join()


def started(work: Callable[[], object]) -> tuple[int, int]:
    """`work` in a process of its own: its number, and the descriptor of its output.

    The first process neither writes nor reads tables: the threads of their library would not exist in a child.
    """
    reader, writer = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # nor do those of JAX: children only write results that exist
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
    """The output of a process that ends."""
    with open(reader, "rb") as file:
        printed = file.read()
    os.waitpid(child, 0)
    return printed


def killed(work: Callable[[], object], wait_s: float, word: bytes = b"") -> bytes:
    """The output of `work`, which is killed this time after it printed a word (at the latest 300 s after its start)."""
    child, reader = started(work)
    printed, deadline = b"", time.monotonic() + 300.0
    while word not in printed and time.monotonic() < deadline:
        if select.select([reader], [], [], 0.1)[0]:
            data = os.read(reader, 65536)
            printed += data
            deadline = deadline if data else 0.0
    time.sleep(wait_s)
    os.kill(child, signal.SIGKILL)
    return printed + ended(child, reader)


def failures(printed: bytes) -> list[str]:
    """Exceptions in the output of a process."""
    return [line.decode() for line in printed.splitlines() if line.startswith(b"FAILED")]


def undisturbed(work: Callable[[], object]) -> None:
    """`work` to its end."""
    if faults := failures(ended(*started(work))):
        raise SystemExit("\n".join(faults))


def recorder(kills: int, folder: Path, random: np.random.Generator) -> list[str]:
    """Samples are there once and in order, and every acknowledged place is still there."""
    log, acknowledged = folder / "raw.log", []
    with instrument(folder / "imu"):
        for _ in range(kills):
            recording = Recording(log, str(folder / "imu"), 921600)
            time.sleep(float(random.uniform(0, 0.4)))
            recording.poll()
            os.kill(recording.pid, signal.SIGKILL)
            recording.stop()
            if recording.synced:
                acknowledged.append((recording.synced, log.read_bytes()[recording.synced - 16 : recording.synced]))
            if random.random() < 0.5:  # a power cut may leave an unfinished record
                with open(log, "ab") as file:
                    file.write(log.read_bytes()[-200:][: int(random.integers(1, 150))])
    LogWriter(log).close()
    content = log.read_bytes()
    bad = [f"place {stop} is lost" for stop, tail in acknowledged if content[stop - 16 : stop] != tail]
    payload = b"".join(record.payload for record in read_log(log) if record.kind == RecordKind.BYTES)
    numbers = sequence_of(decode_all(protocol("stim300").decoder(Settings((10.0,) * 3)), payload).samples.rate)
    bad += ["samples twice or out of order"] * bool((np.diff(numbers) <= 0).any())
    print(f"  recorder: {len(acknowledged)} places were acknowledged; {len(numbers)} samples in the log")
    return bad


def guided(run: Path) -> None:
    """Resume a guided run."""
    with resume(run) as held:
        capture(held, plain=True)


def guide(kills: int, folder: Path, random: np.random.Generator) -> list[str]:
    """A position that the screen showed as done remains so, bit for bit."""
    run, plan, bad, before, shown = folder / "run", folder / "plan.toml", [], {}, 0
    alpha = (np.arange(max(8, 5 * kills)) * 360.0 * 0.381966 % 360.0).round(2).tolist()
    plan.write_text(PLAN.format(link=folder / "imu", beta=[0, 30, 60], alpha=alpha, seconds=1.0))
    with instrument(folder / "imu", str(run)):
        begin(plan, run).journal.close()
        for kill in range(kills):
            # Most kills fall into the measuring, some into the start.
            word = b"SETTLING" if random.random() < 0.7 else b""
            printed = killed(partial(guided, run), float(random.uniform(0.0, 1.5)), word)
            bad += failures(printed)
            done = [int(line.split(b" of ")[0].split()[-1]) for line in printed.splitlines() if b" of " in line]
            shown = max([shown, *done])
            accepted = replayed(read_journal(run)).accepted
            if len(accepted) < shown:
                bad.append(f"{shown} positions were shown as done, {len(accepted)} are")
            bad += [f"position {k} has changed" for k in before if accepted.get(k) != before[k]]
            before = accepted
            if kill % 10 == 9:
                print(f"    {kill + 1} of {kills} kills, {len(accepted)} positions, {len(bad)} faults", flush=True)
    for k, attempt in before.items():
        if sha256_of(run / RAW_NAME, attempt.log_start, attempt.log_stop) != attempt.sha256:
            bad.append(f"position {k}: its bytes are not those that were accepted")
    bad += ["no position was accepted: this shows nothing"] * (kills > 10 and not before)
    print(f"  guide: {shown} positions were shown as done, {len(before)} are accepted, all with their bytes")
    return bad


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

    tables, bad, studies, counted = read_study(CONFIGS / "study_coverage.toml", "coverage"), [], 0, 0
    undisturbed(partial(run, tables, folder / "whole", study=ChunksOfNumbers()))
    results = [path for path in (folder / "whole").iterdir() if path.suffix in (".json", ".parquet")]
    place = folder / "study0"

    def work(place: Path) -> None:
        run(tables, place, study=ChunksOfNumbers(), progress=lambda done: os.write(1, f"{done}\n".encode()))
        os.write(1, b"ended\n")

    for kill in range(kills):
        printed = killed(partial(work, place), float(random.uniform(0.01, 0.3)))
        bad += failures(printed)
        done = [int(line) for line in printed.split() if line.isdigit()]
        if counted and done and max(done) < counted:
            bad.append(f"{counted} chunks were counted before, {max(done)} now")
        counted = max([counted, *done])
        there = len([*(place / "chunks").glob("[0-9]*")])
        if there < counted:
            bad.append(f"{counted} chunks were counted, {there} are there")
        if b"ended" in printed or kill == kills - 1:
            undisturbed(partial(run, tables, place, study=ChunksOfNumbers()))
            differ = [path.name for path in results if (place / path.name).read_bytes() != path.read_bytes()]
            bad += [f"{name} is not that of an undisturbed study" for name in differ]
            studies, counted = studies + 1, 0
            place = folder / f"study{studies}"
    print(f"  study: {studies} studies of {ChunksOfNumbers.chunks} chunks ended as undisturbed ones")
    return bad


def main() -> int:
    """Kill and count the faults."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=1000)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    kinds = asked.kinds.split(",")
    if "study" in kinds:
        from tumblecal.cli.start import start

        start()
    share = asked.kills / sum(KINDS[kind] for kind in kinds)
    random, total, faults = np.random.default_rng(asked.seed), 0, []
    tests = {own.__name__: own for own in (recorder, guide, study)}
    with tempfile.TemporaryDirectory(prefix="tumblecal-kills-") as folder:
        for kind in kinds:
            kills, begun = max(1, round(share * KINDS[kind])), time.monotonic()
            (Path(folder) / kind).mkdir()
            bad = tests[kind](kills, Path(folder) / kind, random)
            total, faults = total + kills, faults + [f"{kind}: {text}" for text in bad]
            print(f"  {kind}: {kills} kills in {time.monotonic() - begun:.0f} s, {len(bad)} faults", flush=True)
    print(f"{total} kills; lost or different: {len(faults)}")
    print("\n".join(faults[:20]))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
