"""Ctrl-C and SIGTERM at random moments of commands: each ends with one line and 130 (143), and leaves no file half-written.

python benchmarks/interrupts.py [--each 60] [--within 3.0] [--commands simulate,calibrate,diagnose] [--signals INT,TERM]

Each command runs in a process of its own, which gets the signal after a random time below `--within` seconds. `in order`: one
line on stderr and the status that a shell shows as 130 or 143. `Python's own start`: the interpreter had not yet run a line of
the program (no module of it is in the traceback, or the signal's default ended the process). `finished`: the command was done
before. Anything else is a fault, shown with its last line; the program ends with code 1 then.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np


CONFIGS = Path(__file__).parents[1] / "configs"
# Within so many seconds of its start Python may not have come to the program, on a busy machine.
EARLY, EARLY_S = "Python's own start", 0.15
LINES = {signal.SIGINT: "tumblecal: interrupted; ", signal.SIGTERM: "tumblecal: terminated; "}


def commands(folder: Path) -> dict[str, list[str]]:
    """What is interrupted; the data of two of them is the output of the first."""
    data = folder / "positions.csv"
    simulated = ["simulate", str(CONFIGS / "paper24.toml"), "--seed", "1", "--out"]
    subprocess.run([sys.executable, "-m", "tumblecal", *simulated, str(data)], check=True, capture_output=True)
    return {
        "simulate": [*simulated, str(folder / "out" / "simulated.csv")],
        "calibrate": ["calibrate", str(data), "--out", str(folder / "out" / "calibration")],
        "diagnose": ["diagnose", str(data), "--out", str(folder / "out" / "diagnosis")],
        "effects": ["effects"],
    }


def outcome(arguments: list[str], number: signal.Signals, after_s: float) -> str:
    """How a command ended that got a signal."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tumblecal", *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    time.sleep(after_s)
    process.send_signal(number)
    said = process.communicate()[1].strip()
    lines = said.splitlines()
    if process.returncode == 0:
        return "finished"
    if process.returncode == -number and not lines and after_s < EARLY_S:
        return EARLY
    if lines and lines[-1] == "KeyboardInterrupt" and f"{os.sep}tumblecal{os.sep}" not in said:
        return EARLY
    if process.returncode in (128 + number, -number) and len(lines) == 1 and lines[0].startswith(LINES[number]):
        return "in order"
    return f"status {process.returncode}, {len(lines)} lines, last: {lines[-1][:90] if lines else ''}"


def left_behind(folder: Path) -> list[str]:
    """Files that were being written."""
    return [str(path.relative_to(folder)) for path in folder.rglob(".*")]


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--each", type=int, default=60)
    parser.add_argument("--within", type=float, default=3.0)
    parser.add_argument("--commands", default="simulate,calibrate,diagnose")
    parser.add_argument("--signals", default="INT,TERM")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    # In a background job these are ignored, and would be by the commands.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    random, bad = np.random.default_rng(asked.seed), 0
    os.environ.setdefault("TUMBLECAL_CACHE", tempfile.mkdtemp(prefix="tumblecal-interrupts-"))
    with tempfile.TemporaryDirectory(prefix="tumblecal-interrupts-") as name:
        folder = Path(name)
        every = commands(folder)
        for own in asked.commands.split(","):
            subprocess.run([sys.executable, "-m", "tumblecal", *every[own]], capture_output=True)  # programs compiled
            for word in asked.signals.split(","):
                number = signal.Signals[f"SIG{word}"]
                counts = Counter(
                    outcome(every[own], number, float(after)) for after in random.uniform(0, asked.within, asked.each)
                )
                left = left_behind(folder / "out")
                good = ("in order", "finished", EARLY)
                faults = counts.total() - sum(counts[word] for word in good) + len(left)
                bad += faults
                print(f"{own} SIG{word}: {asked.each} signals, {faults} faults", flush=True)
                for words, count in counts.most_common():
                    print(f"  {count:3d}  {words}")
                if left:
                    print(f"  left behind: {', '.join(left[:5])}")
    print(f"faults: {bad}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
