"""Throughput of simulated calibrations, beside what a user would pick instead; one run, ratios printed.

    python benchmarks/study_throughput.py              everything that fits in a few minutes on two cores
    python benchmarks/study_throughput.py --only device     trials/s of whatever jax.devices()[0] is
    python benchmarks/study_throughput.py --only memory     10 million trials: time and peak memory (a minute)

Work: the paper's plan, 72 numbers a trial, 15 parameters, exact chain to 1e-10, float64, noise 0.15 mg, a new
instrument every trial. Every ratio is of best times taken in turns in this one run, on one core (the process keeps to
one core unless --free is given), so that load from elsewhere hits both sides.
"""

import argparse
import os
import resource
import subprocess
import sys
import time


SD = 1.5e-4
SIZE = 1e-3


def best(*functions, rounds=5):
    """Best time of each function, taken in turns."""
    times = [float("inf")] * len(functions)
    for function in functions:
        function()
    for _ in range(rounds):
        for place, function in enumerate(functions):
            start = time.perf_counter()
            function()
            times[place] = min(times[place], time.perf_counter() - start)
    return times


def line(text, value, unit, wanted=None):
    goal = "" if wanted is None else f"   wanted {wanted}"
    print(f"  {text:<66} {value:>12.4g} {unit:<10}{goal}", flush=True)


def paper(uniform=True):
    import numpy as np

    from tumblecal.chain import nominal_chain, settings

    alpha = np.tile(np.arange(8) * 45.0, 3)
    if not uniform:
        alpha = np.random.default_rng(3).uniform(0, 360, 24)
    where = settings(np.radians(alpha), np.radians(np.repeat([0.0, 45.0, 90.0], 8)))
    return nominal_chain(where), where


def extended():
    """The paper's plan with two more effects in the fitted chain: 19 parameters."""
    from tumblecal.effects.catalogue import catalogue, links

    chain, where = paper()
    made = links(catalogue(), ("index_eccentricity", "base_levelling", "second_order.y"), where)
    for found in made.values():
        chain = chain + found[0]
    return chain, where


def readings_of(chain, where, lanes, seed=0):
    import jax
    import jax.numpy as jnp
    import numpy as np

    generator = np.random.default_rng(seed)
    truth = generator.normal(size=(lanes, len(chain.vector))) * SIZE
    exact = jax.jit(jax.vmap(lambda vector: chain.at(vector)(where)))(jnp.asarray(truth))
    return np.asarray(exact) + SD * generator.normal(size=exact.shape)


def numpy_chain(where):
    """The nominal chain in plain numpy, as a user of scipy writes it."""
    import numpy as np

    alpha, beta, group = where.alpha, where.beta, where.index("pitch")
    sa, ca = np.sin(alpha), np.cos(alpha)

    def predict(p):
        dK, bias, (wx, wy, wz), (g21, g31, g32), dbeta = p[:3], p[3:6], p[6:9], p[9:12], p[12:]
        b = beta + dbeta[group]
        f = np.stack([-np.sin(b), np.cos(b) * sa, np.cos(b) * ca])
        (cx, sx), (cy, sy), (cz, sz) = ((np.cos(w), np.sin(w)) for w in (wx, wy, wz))
        rx = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
        ry = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
        rz = np.array([[cz, sz, 0], [-sz, cz, 0], [0, 0, 1]])
        triad = np.array([[1, 0, 0], [g21, 1, 0], [g31, g32, 1]])
        return ((1 + dK)[:, None] * (triad @ (rx @ ry @ rz) @ f) + bias[:, None]).T

    return predict


def by_scipy(where, readings):
    import numpy as np
    from scipy.optimize import least_squares

    predict = numpy_chain(where)
    return np.array([least_squares(lambda p, y=y: (predict(p) - y).ravel() / SD, np.zeros(15)).x for y in readings])


def optimistix_fit(chain, where):
    import jax
    import jax.numpy as jnp
    import optimistix as optx

    def one(measured):
        def residual(scaled, _):
            return ((chain.at(scaled * SIZE)(where) - measured) / SD).ravel()

        solver = optx.GaussNewton(rtol=1e-10, atol=1e-10)
        start = jnp.zeros(len(chain.vector))
        return optx.least_squares(residual, solver, start, throw=False).value * SIZE

    return jax.jit(jax.vmap(one))


def fast_fit(where):
    """Readings (positions, 3, lanes) to estimates by the harmonic path."""
    import jax

    from tumblecal.simulation.harmonic_fit import fit_harmonics
    from tumblecal.simulation.uniform import uniform_plan

    plan = uniform_plan(where.alpha, where.beta, where.index("pitch"))

    @jax.jit
    def fit(readings):
        return fit_harmonics(plan.harmonics(readings), plan.pitch, plan.angles)

    return fit


def general_fit(chain, where):
    import jax

    from tumblecal.simulation.chain_fit import expansion, fit_chain
    from tumblecal.simulation.experiment import problem_for

    problem = problem_for(chain, where, SD)
    shared = expansion(problem)
    return jax.jit(lambda readings: fit_chain(problem, shared, readings))


def fits():
    """Fits alone: the same readings, in memory, to the same estimates."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    print("fits a second, one process, readings given", flush=True)
    chain, where = paper()
    lanes, block, few = 4096, 1024, 20
    readings = readings_of(chain, where, lanes)
    lane_last = [jnp.asarray(np.moveaxis(readings[i : i + block], 0, 2)) for i in range(0, lanes, block)]
    lane_first = [jnp.asarray(readings[i : i + block]) for i in range(0, lanes, block)]
    fast, general, stock = fast_fit(where), general_fit(chain, where), optimistix_fit(chain, where)
    t_fast, t_general, t_stock, t_scipy = best(
        lambda: jax.block_until_ready([fast(part) for part in lane_last]),
        lambda: jax.block_until_ready([general(part) for part in lane_first]),
        lambda: jax.block_until_ready([stock(part) for part in lane_first]),
        lambda: by_scipy(where, readings[:few]),
        rounds=4,
    )
    us = [1e6 * t / n for t, n in ((t_fast, lanes), (t_general, lanes), (t_stock, lanes), (t_scipy, few))]
    names = ("harmonic path", "general path", "vmap of optimistix.GaussNewton", "scipy.optimize.least_squares, loop")
    for name, value in zip(names, us, strict=True):
        line(name, value, "us/fit")
    line("scipy / harmonic path", us[3] / us[0], "times", ">= 2000")
    line("optimistix / harmonic path", us[2] / us[0], "times", ">= 60")
    first, second = np.asarray(fast(lane_last[0]).values).T, np.asarray(general(lane_first[0]).values)
    third, fourth = np.asarray(stock(lane_first[0])), by_scipy(where, readings[:few])
    line("harmonic - general path, largest difference", np.max(np.abs(first - second)), "", "<= 1e-10")
    line("harmonic - optimistix, largest difference", np.max(np.abs(first - third)), "", "<= 1e-10")
    line("harmonic - scipy, largest difference (its own tolerance)", np.max(np.abs(first[:few] - fourth)), "")
    for title, (chain, where) in (
        ("non-uniform plan", paper(uniform=False)),
        ("extended chain", extended()),
    ):
        readings = jnp.asarray(readings_of(chain, where, block))
        general, stock = general_fit(chain, where), optimistix_fit(chain, where)
        t_general, t_stock = best(
            lambda g=general, r=readings: jax.block_until_ready(g(r)),
            lambda s=stock, r=readings: jax.block_until_ready(s(r)),
            rounds=4,
        )
        line(f"{title}, {len(chain.names)} parameters: general path", 1e6 * t_general / block, "us/fit")
        line(f"{title}: optimistix / general path", t_stock / t_general, "times", ">= 5")
        line(f"{title}: largest difference", np.max(np.abs(general(readings).values - stock(readings))), "", "<= 1e-10")


def paper_experiment(**options):
    from tumblecal.simulation.experiment import experiment

    chain, where = paper()
    return experiment(chain, where, sd=SD, **options)


SPREAD = {"dK": SIZE, "bias": SIZE, "dtheta": SIZE, "gamma": SIZE, "dbeta": SIZE}


def drawing(setup, seed=0):
    """Only the random numbers of the same trials, drawn and added up."""
    import jax
    import jax.numpy as jnp

    from tumblecal.simulation.experiment import BLOCK
    from tumblecal.simulation.sums import halved

    def run(first, last):
        def one(block, total):
            key = jax.random.fold_in(jax.random.key(seed), block)
            total = total + halved(setup.noise(key))
            if setup.spread is None:
                return total
            instrument = jax.random.normal(jax.random.fold_in(key, 1), (15, BLOCK))
            return total + jnp.sum(halved(instrument))

        return jax.lax.fori_loop(first // BLOCK, last // BLOCK, one, jnp.zeros((24, 3)))

    return jax.jit(run)


def whole():
    """Draw + fit + statistics against drawing alone."""
    import jax

    from tumblecal.simulation.experiment import BLOCK
    from tumblecal.simulation.sums import chunk_sums

    print("draw + fit + statistics, one process", flush=True)
    trials = 32 * BLOCK
    for title, options in (("one instrument", {}), ("a new instrument every trial", {"spread": SPREAD})):
        setup = paper_experiment(**options)
        sums, draw = chunk_sums(setup, 0), drawing(setup)
        t_all, t_draw = best(
            lambda s=sums: jax.block_until_ready(s(0, trials)), lambda d=draw: jax.block_until_ready(d(0, trials))
        )
        line(f"{title}: drawing {72 if not options else 87} normals", 1e6 * t_draw / trials, "us/trial")
        line(f"{title}: draw + fit + statistics", 1e6 * t_all / trials, "us/trial")
        line(f"{title}: ratio", t_all / t_draw, "times", "<= 2.5")


def kalman():
    """1000 runs x 600 data sets by Kalman filters, against drawing their noise."""
    import jax
    import jax.numpy as jnp

    from tumblecal.studies.convergence import CHUNK, Convergence

    print("Kalman, 1000 runs x 600 data sets, errors, NEES, NIS and settling of every run", flush=True)
    root = os.path.join(os.path.dirname(__file__), "..", "configs", "study_convergence.toml")
    from pathlib import Path

    from tumblecal.studies.study_tables import read_study

    study = Convergence(read_study(Path(root), "convergence", {"methods": ["kalman"], "prior_sd": [0.01]}))

    def filtered():
        for chunk in range(study.chunks):
            study.compute(chunk)

    def draw(numbers):
        @jax.jit
        def run(chunk):
            def one(total, key):
                return total + jnp.sum(jax.random.normal(key, (numbers, CHUNK)), axis=1), None

            keys = jax.random.split(jax.random.fold_in(jax.random.key(0), chunk), 600)
            return jax.lax.scan(one, jnp.zeros(numbers), keys)[0]

        return lambda: jax.block_until_ready([run(chunk) for chunk in range(study.chunks)])

    t_filter, t_27, t_72 = best(filtered, draw(27), draw(72), rounds=3)
    line("filter and statistics", t_filter, "s")
    line("drawing the 27 harmonics of each data set, as the study does", t_27, "s")
    line("drawing its 72 readings", t_72, "s")
    line("filter / drawing 27 harmonics", t_filter / t_27, "times", "< 5")
    line("filter / drawing 72 readings", t_filter / t_72, "times", "< 5")


CHILD = """
import os, sys, time
os.sched_setaffinity(0, {{{core}}})
import jax
sys.path.insert(0, {folder!r})
import study_throughput as own
import tumblecal; tumblecal.enable_float64()
from tumblecal.simulation.experiment import BLOCK
from tumblecal.simulation.sums import chunk_sums
sums = chunk_sums(own.paper_experiment(spread=own.SPREAD), 0)
jax.block_until_ready(sums(0, BLOCK))
print("ready", flush=True); sys.stdin.readline()
wall, busy = time.perf_counter(), time.process_time()
jax.block_until_ready(sums(0, {blocks} * BLOCK))
print(time.perf_counter() - wall, time.process_time() - busy, flush=True)
"""


def processes():
    """Two processes on two cores against one."""
    import numpy as np

    print("two processes against one", flush=True)
    blocks, cores = 256, sorted(ALLOWED)
    folder = os.path.dirname(os.path.abspath(__file__))
    environment = os.environ | {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false", "NPROC": "1"}

    def started(core):
        program = CHILD.format(folder=folder, blocks=blocks, core=core)
        child = subprocess.Popen(
            [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )
        assert child.stdout.readline().strip() == "ready"
        return child

    def timed(children):
        for child in children:
            child.stdin.write("go\n")
            child.stdin.flush()
        both = [[float(text) for text in child.stdout.readline().split()] for child in children]
        for child in children:
            child.communicate()
        return max(wall for wall, _ in both), max(busy for _, busy in both)

    if len(cores) < 2:
        print("  only one core here")
        return
    alone, together = [], []
    for _ in range(4):
        alone.append(timed([started(cores[0])]))
        together.append(timed([started(core) for core in cores[:2]]))
    (wall, busy), (wall_both, busy_both) = (np.min(np.array(times), axis=0) for times in (alone, together))
    trials = blocks * 1024
    line("one process", trials / wall, "trials/s")
    line("two processes", 2 * trials / wall_both, "trials/s")
    line("ratio by the clock (true on an idle machine only)", 2 * wall / wall_both, "times", ">= 1.8")
    line("ratio by processor time (what they cost each other)", 2 * busy / busy_both, "times", ">= 1.8")


def memory(trials=10_000_000):
    """10 million trials in one process."""
    import jax

    from tumblecal.simulation.experiment import BLOCK
    from tumblecal.simulation.sums import chunk_sums

    print(f"{trials} trials in one process", flush=True)
    sums = chunk_sums(paper_experiment(), 0)
    start = time.perf_counter()
    total = None
    for first in range(0, trials, 64 * BLOCK):
        part = sums(first, min(first + 64 * BLOCK, trials))
        total = part if total is None else type(part)(*(a + b for a, b in zip(total, part, strict=True)))
    jax.block_until_ready(total)
    seconds = time.perf_counter() - start
    line("time", seconds, "s")
    line("throughput", trials / seconds, "trials/s")
    line("trials, failed", float(total.trials), f"{int(total.failed)} failed")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    line("peak resident memory of the process, everything included", peak, "GiB", "< 2")


def device():
    """Trials a second on whatever device JAX has; wide batches where it is not a CPU."""
    import jax
    import jax.numpy as jnp

    from tumblecal.simulation.sums import added, sums_of

    here = jax.devices()[0]
    wide = 1 if here.platform == "cpu" else 256
    print(f"device {here.device_kind} ({here.platform}), {wide} blocks at a time", flush=True)
    for title, options in (("harmonic path", {}), ("general path", {"path": "chain"})):
        setup = paper_experiment(spread=SPREAD, **options)
        width = wide if title == "harmonic path" else max(1, wide // 8)
        rounds = 64 if wide == 1 else 16
        rounds = max(1, rounds // 8) if (title == "general path" and wide == 1) else rounds

        @jax.jit
        def run(first, setup=setup, width=width, rounds=rounds):
            def of(block):
                return sums_of(setup.trials(0, block), setup)

            def step(total, start, of=of):
                many = jax.vmap(of)(start + jnp.arange(width)) if width > 1 else of(start)
                part = jax.tree.map(lambda p: jnp.sum(p, axis=0), many) if width > 1 else many
                return added(total, part), None

            shapes = jax.eval_shape(of, first)
            nothing = jax.tree.map(lambda p: jnp.zeros(p.shape, p.dtype), shapes)
            return jax.lax.scan(step, nothing, first + width * jnp.arange(rounds))[0]

        (t_run,) = best(lambda r=run: jax.block_until_ready(r(0)), rounds=3)
        found = run(0)
        trials = rounds * width * 1024
        line(f"{title}: draw + fit + statistics", trials / t_run, "trials/s")
        good = float(found.trials - found.failed)
        line(f"{title}: failed", float(found.failed), "trials")
        line(f"{title}: mean chi2 (57 expected)", float(found.chi2) / good, "")
        line(f"{title}: mean NEES (15 expected)", float(found.nees) / good, "")


PARTS = {
    "fits": fits, "whole": whole, "kalman": kalman, "processes": processes, "device": device, "memory": memory,
}  # fmt: skip
ALLOWED = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else {0}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=PARTS, action="append")
    parser.add_argument("--free", action="store_true", help="use all cores in this process")
    given = parser.parse_args()
    if not given.free and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(ALLOWED)})
    import jax

    import tumblecal

    tumblecal.enable_float64()
    print(f"{jax.devices()[0].device_kind}, jax {jax.__version__}, {len(ALLOWED)} cores allowed, "
          f"{'all' if given.free else 'one'} used in this process", flush=True)  # fmt: skip
    for name, part in PARTS.items():
        if given.only is None or name in given.only:
            part()


if __name__ == "__main__":
    main()
