"""A hand-held log of a million rows (text, 1 kHz) to a verdict: processor time, wall time and peak memory of each command.

    python benchmarks/hand_held_million.py --positions 40

Each command runs twice, first on another log of as many positions, so that its programs are compiled: the second is printed.
On a machine busy with other work only the processor time counts. This process imports next to nothing: the system counts its
memory into that of its children.
"""

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory


MAKE = (
    "import sys; sys.path.insert(0, {here!r}); from hand_held_sessions import write_log; write_log({path!r}, {given})"
)


def measured(command: list[str]) -> tuple[float, float, float, str]:
    """Processor time and wall time, s, peak memory, MB, and the last words of a command."""
    began = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    said = process.stdout.read().splitlines()
    _, code, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(code)
    words = next((line for line in said if line.isupper() or line.split(":")[0].isupper()), said[-1] if said else "")
    return used.ru_utime + used.ru_stime, time.monotonic() - began, used.ru_maxrss / 1024, words


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--positions", type=int, nargs="+", default=[40])
    parser.add_argument("--figures", action="store_true", help="draw them as well")
    asked = parser.parse_args()
    figures = [] if asked.figures else ["--no-figures"]
    tumblecal = [sys.executable, "-m", "tumblecal.cli"]
    print(f"{'positions':>9}  {'command':10}{'CPU / s':>9}{'wall / s':>9}{'peak / MB':>10}")
    for positions in asked.positions:
        with TemporaryDirectory() as name:
            total = [0.0, 0.0]
            for seed in (2, 1):
                log, means = Path(name) / f"million{seed}.csv", Path(name) / f"reduced{seed}"
                make = MAKE.format(here=str(Path(__file__).parent), path=str(log), given=f"{positions}, {seed}")
                subprocess.run([sys.executable, "-c", make], check=True, stdout=subprocess.DEVNULL)
                commands = {
                    "reduce": ["reduce", str(log), "--static", "--gravity", "9.80665", "--out", str(means), *figures],
                    "diagnose": ["diagnose", str(means / "positions.csv"), "--out", f"{name}/diagnosis", *figures],
                }
                for own, arguments in commands.items():
                    cpu, wall, peak, words = measured([*tumblecal, *arguments])
                    if seed == 1:
                        total = [total[0] + cpu, total[1] + wall]
                        print(f"{positions:9}  {own:10}{cpu:9.1f}{wall:9.1f}{peak:10.0f}  {words[:80]}", flush=True)
            print(f"{positions:9}  {'together':10}{total[0]:9.1f}{total[1]:9.1f}")


if __name__ == "__main__":
    main()
