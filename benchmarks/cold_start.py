"""Cold start of `tumblecal calibrate` on Table 1 against a numpy-and-scipy script, in turn, and where the time goes.

    python benchmarks/cold_start.py [--runs 7]

Whole processes, wall time; the ratio is taken pair by pair. "first ever" starts with an empty cache of compiled
programs, the others find it filled, as every call after a user's first one does.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from importlib.resources import files
from pathlib import Path


TABLE1 = str(files("tumblecal.data.paper") / "table1.csv")
HERE = Path(__file__).parent

STAGES = """
import time
start = time.perf_counter()
stages = []
def stage(name):
    global start
    now = time.perf_counter(); stages.append((name, now - start)); start = now
import tumblecal.cli, rich.table; stage("imports: command line, tables")
import jax, equinox; stage("imports: JAX, equinox")
from tumblecal.cli.start import start as start_jax; start_jax()
from tumblecal.cli.model_options import StatedModel
from tumblecal.estimation.methods import all_methods
from tumblecal.report.result_file import write_calibrated
from tumblecal.report.terminal import print_calibration; stage("imports: the rest")
from tumblecal.data import read_positions
data = read_positions({table!r}); stage("reading")
from tumblecal.estimation import exact, problem_of
from tumblecal.estimation.linearised import linearised
problem = problem_of(data); first = problem.chain.vector
exact._gauss_newton(problem, first); linearised(problem, first); stage("tracing and compiling, or loading")
done = all_methods(problem_of(data)); stage("running all methods")
import pathlib, rich.console
print_calibration(done, rich.console.Console(file=open("/dev/null", "w")))
write_calibrated(pathlib.Path({out!r}), done); stage("writing")
for name, seconds in stages: print(f"{{seconds:8.3f}} s  {{name}}")
"""


FIRST_EVER = """
import time, jax
from tumblecal.ground.precision import enable_float64; enable_float64()
from tumblecal.data import read_positions
from tumblecal.estimation import exact, problem_of
problem = problem_of(read_positions({table!r})); first = problem.chain.vector
begin = time.perf_counter(); lowered = jax.jit(exact.solve).lower(problem, first)
traced = time.perf_counter(); program = lowered.compile()
compiled = time.perf_counter(); jax.block_until_ready(program(problem, first))
print(f"{{traced - begin:8.3f}} s  tracing")
print(f"{{compiled - traced:8.3f}} s  compiling")
print(f"{{time.perf_counter() - compiled:8.3f}} s  running")
"""


def wall(command: list[str], environment: dict[str, str]) -> float:
    begin = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
    return time.perf_counter() - begin


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--runs", type=int, default=7)
    runs = arguments.parse_args().runs
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"TUMBLECAL_CACHE": f"{folder}/cache"}
        ours = [sys.executable, "-m", "tumblecal.cli", "calibrate", TABLE1, "--no-figures", "--out", f"{folder}/out"]
        plain = [sys.executable, str(HERE / "scipy_fit.py"), TABLE1]
        first = wall(ours, environment)
        wall(plain, environment)
        pairs = [(wall(ours, environment), wall(plain, environment)) for _ in range(runs)]
        ratios = [a / b for a, b in pairs]
        print(f"tumblecal calibrate: median {statistics.median(a for a, _ in pairs):.2f} s (first ever {first:.2f} s)")
        print(f"numpy and scipy:     median {statistics.median(b for _, b in pairs):.2f} s")
        print(
            f"ratio: median {statistics.median(ratios):.2f}, {min(ratios):.2f} to {max(ratios):.2f} (required: at most 4)"
        )
        for title, script in (("a cold start", STAGES), ("the solver, the first time ever", FIRST_EVER)):
            command = [sys.executable, "-c", script.format(table=TABLE1, out=folder)]
            print(f"\nwhere the time of {title} goes:")
            print(subprocess.run(command, check=True, text=True, capture_output=True, env=environment).stdout, end="")


if __name__ == "__main__":
    main()
