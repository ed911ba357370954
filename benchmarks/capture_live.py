"""Processor time of a guided capture at 2000 Hz in real time: recorder and guide with its redrawn screen.

python benchmarks/capture_live.py [--seconds 60]
"""

import argparse
import fcntl
import os
import pty
import struct
import subprocess
import sys
import tempfile
import termios
import threading
import time
from multiprocessing import get_context
from pathlib import Path

from tumblecal.capture.emulator.config import Emulation
from tumblecal.capture.emulator.device import VirtualDevice
from tumblecal.capture.emulator.instrument import VirtualInstrument
from tumblecal.capture.journal import read_journal


PLAN = """
[port]
url = "imu"
[positions]
listed = [{ alpha_deg = 0, beta_deg = 0 }]
[dwell]
seconds = SECONDS
settle_s = 2.0
"""
COMMAND = (
    "from pathlib import Path; from tumblecal.cli.capture import capture; capture(Path('plan.toml'), out=Path('run'))"
)


def instrument(link: str) -> None:
    VirtualInstrument(VirtualDevice(Emulation.model_validate({"instrument": {"rate_hz": 2000.0}})), Path(link)).run()


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def child_of(pid: int) -> int:
    """The recorder: the one child of the guide."""
    return int(Path(f"/proc/{pid}/task/{pid}/children").read_text().split()[0])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=60.0)
    seconds = parser.parse_args().seconds
    folder = Path(tempfile.mkdtemp(prefix="tumblecal-live-"))
    (folder / "plan.toml").write_text(PLAN.replace("SECONDS", str(seconds + 10)))
    process = get_context("spawn").Process(target=instrument, args=(str(folder / "imu"),), daemon=True)
    process.start()
    while not (folder / "imu").exists():
        time.sleep(0.01)
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 45, 110, 0, 0))
    environment = {**os.environ, "TERM": "xterm-256color"}
    guide = subprocess.Popen(
        [sys.executable, "-c", COMMAND], cwd=folder, stdin=slave, stdout=slave, stderr=slave, env=environment
    )
    threading.Thread(target=lambda: [os.read(master, 65536) for _ in iter(int, 1)], daemon=True).start()
    while not (folder / "run" / "journal.log").exists() or read_journal(folder / "run")[-1]["entry"] != "recording":
        time.sleep(0.2)
    recorder = child_of(guide.pid)
    before, start = (cpu_s(recorder), cpu_s(guide.pid)), time.monotonic()
    time.sleep(seconds)
    spent = [after - b for after, b in zip((cpu_s(recorder), cpu_s(guide.pid)), before, strict=True)]
    wall = time.monotonic() - start
    guide.kill()
    process.kill()
    print(
        f"2000 Hz for {wall:.0f} s: recorder {100 * spent[0] / wall:.1f} % of a core, guide {100 * spent[1] / wall:.1f} %"
    )
    print(f"together {100 * sum(spent) / wall:.1f} % of a core")


if __name__ == "__main__":
    main()
