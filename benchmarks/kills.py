"""Kill -9 at random moments of a guided run, which is resumed after each: nothing that was shown as done is lost.

    python benchmarks/kills.py --kills 100

Exit code 1: an accepted position is missing or has changed, or its bytes are not those that were accepted. Other kills are in
`tests/capture/test_recorder.py`, `tests/studies/test_resumed_studies.py` and `tests/data/test_result_sets.py`.
"""

import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from command_line import asked
from tumblecal.capture.emulator.config import Emulation
from tumblecal.capture.emulator.device import VirtualDevice
from tumblecal.capture.emulator.instrument import VirtualInstrument
from tumblecal.capture.emulator.operator import Follower
from tumblecal.capture.journal import RAW_NAME, read_journal, replayed, sha256_of
from tumblecal.capture.run.run_folder import begin


PLAN = """
[port]
url = "{link}"
speed = 20.0
[positions]
beta_deg = [0, 30, 60]
alpha_deg = {alpha}
[dwell]
seconds = 1.0
settle_s = 0.2
"""
GUIDED = """
import sys
from pathlib import Path
from tumblecal.capture.run.run_folder import resume
from tumblecal.capture.run.session import capture
with resume(Path(sys.argv[1])) as run:
    capture(run, plain=True)
"""


def device(link: str, folder: str) -> None:
    """A virtual device that is turned as its run asks."""
    config = Emulation.model_validate({"head": {"turn_s": 0.5, "reaction_s": 0.1}})
    operator = Follower(Path(folder), config)
    VirtualInstrument(VirtualDevice(config), Path(link), speed=20.0, operator=operator).run(720000.0)


def killed(run: Path, wait_s: float, word: bytes) -> bytes:
    """The output of the resumed run, which is killed this time after it printed a word."""
    command = [sys.executable, "-u", "-c", GUIDED, str(run)]
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    assert process.stdout is not None
    printed, deadline = b"", time.monotonic() + 300.0
    while word not in printed and time.monotonic() < deadline:
        if select.select([process.stdout], [], [], 0.1)[0]:
            data = os.read(process.stdout.fileno(), 65536)
            printed += data
            deadline = deadline if data else 0.0
    time.sleep(wait_s)
    process.send_signal(signal.SIGKILL)
    return printed + process.communicate()[0]


def guide(kills: int, folder: Path, random: np.random.Generator) -> list[str]:
    """A position that the screen showed as done remains so, bit for bit."""
    run, plan, bad, before, shown = folder / "run", folder / "plan.toml", [], {}, 0
    alpha = (np.arange(max(8, 5 * kills)) * 360.0 * 0.381966 % 360.0).round(2).tolist()
    plan.write_text(PLAN.format(link=folder / "imu", alpha=alpha))
    with begin(plan, run):
        pass
    for kill in range(kills):
        # Most kills fall into the measuring, some into the start.
        word = b"SETTLING" if random.random() < 0.7 else b""
        printed = killed(run, float(random.uniform(0.0, 1.5)), word)
        bad += [line.decode() for line in printed.splitlines() if b"Error" in line]
        done = [int(line.split(b" of ")[0].split()[-1]) for line in printed.splitlines() if b" of " in line]
        shown = max([shown, *done])
        accepted = replayed(read_journal(run)).accepted
        if len(accepted) < shown:
            bad.append(f"{shown} positions were shown as done, {len(accepted)} are")
        bad += [f"position {k} has changed" for k in before if accepted.get(k) != before[k]]
        before = accepted
        if kill % 10 == 9:
            print(f"{kill + 1} of {kills} kills, {len(accepted)} positions, {len(bad)} faults", flush=True)
    for k, attempt in before.items():
        if sha256_of(run / RAW_NAME, attempt.log_start, attempt.log_stop) != attempt.sha256:
            bad.append(f"position {k}: its bytes are not those that were accepted")
    bad += ["no position was accepted: this shows nothing"] * (kills > 10 and not before)
    print(f"{shown} positions were shown as done, {len(before)} are accepted")
    return bad


def main() -> int:
    """Kill and count the faults."""
    given = asked(__doc__, kills=100, seed=1)
    with tempfile.TemporaryDirectory(prefix="tumblecal-kills-") as name:
        folder = Path(name)
        process = get_context("spawn").Process(
            target=device, args=(str(folder / "imu"), str(folder / "run")), daemon=True
        )
        process.start()
        while not (folder / "imu").exists():
            time.sleep(0.01)
        try:
            faults = guide(given.kills, folder, np.random.default_rng(given.seed))
        finally:
            process.kill()
            process.join()
    print(f"{given.kills} kills; lost or different: {len(faults)}")
    print("\n".join(faults[:20]))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
