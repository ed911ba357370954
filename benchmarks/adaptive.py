"""Positions chosen during the measurement against fixed ones: how many until a target is reached, or an effect is named.

    python benchmarks/adaptive.py --targets 16
    python benchmarks/adaptive.py --targets 8 --pitch-s 600 --spread 1.5 --seed 2
    python benchmarks/adaptive.py --named 500 --whole 30 --out named.jsonl

Sequences on one head (24 spindle angles, 3 pitch settings, one mounting), each repeated from its start if it is over: the
paper's 24 positions in their order, the best 24 positions of an exchange (`tumblecal plan`), the shortest plan for the target
at the stated noise, and those of `capture --adaptive`.

`--targets`: instruments whose noise is 0.7 to 2 times the stated one, on which a tenth of the settings cannot be used. Counted
are the positions and minutes until all nine uncertainties are reached, by generalised least squares in plain numpy with the
noise of the instrument (at least the stated one). `--spread`: each target is multiplied by a random factor up to this.

`--named`: share of instruments with a hidden effect whose diagnosis names it (`adaptive_named`). The adaptive sequence has the
targets of `--targets`; whenever they are reached, all are divided by the square root of 2.
"""

import argparse
import time
import tomllib
from collections.abc import Collection
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

import tumblecal
from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.run.choice import Choice, DonePosition, Progress
from tumblecal.chain.rig import Rig
from tumblecal.chain.rig_file import rig_of
from tumblecal.design.criteria.measure import measures
from tumblecal.design.model.limits import limits_of
from tumblecal.design.model.one_visit import one_visit
from tumblecal.design.positions.exchange import exchange
from tumblecal.design.sequential.adaptive import AdaptiveChooser, chooser_of
from tumblecal.design.sequential.ahead import Planner
from tumblecal.design.sequential.target import Target
from tumblecal.effects import catalogue
from tumblecal.effects.catalogue import links_and_units


RIG = """
schema = "tumblecal.rig/1"
[plan]
alpha_deg = { start = 0, step = 45, count = 8 }
beta_deg = [0, 45, 90]
[mounts]
1 = { rotation_deg = [0, 0, 0] }
[noise]
sd = "0.1 mg"
[priors]
dbeta = "6 arcmin"
[head]
times = { turn_s = 15, pitch_change_s = PITCH_S }
repeatability = { pitch = "0 arcsec" }
"""
PRIOR_RAD, DWELL_S, SETTLE_S, TURN_S = np.radians(0.1), 60.0, 10.0, 15.0
WANTED = {"bias_x": 2.5e-4, "bias_y": 4e-5, "bias_z": 4e-5, "dK_x": 3e-4, "dK_y": 6e-5, "dK_z": 6e-5}
WANTED |= {"gamma_21": 1.5e-4, "gamma_31": 1.5e-4, "gamma_32": 1.5e-4}
NAMES = [f"{kind}_{axis}" for kind in ("dK", "bias") for axis in "xyz"] + ["gamma_21", "gamma_31", "gamma_32"]
MOST = 90
PAPER = [(45.0 * k, beta) for beta in (0.0, 45.0, 90.0) for k in range(8)]


@dataclass(frozen=True)
class Sequence:
    """A name, and its positions (alpha, beta), deg, in order."""

    name: str
    angles: list[tuple[float, float]]


def rows_of(angles: list[tuple[float, float]]) -> np.ndarray:
    """Responses (positions, 3, 15) to `NAMES`, the mount, and the errors of the three pitch settings."""
    alpha, beta = np.radians(angles).T
    force = np.stack([-np.sin(beta), np.cos(beta) * np.sin(alpha), np.cos(beta) * np.cos(alpha)], axis=1)
    pitch = np.stack([-np.cos(beta), -np.sin(beta) * np.sin(alpha), -np.sin(beta) * np.cos(alpha)], axis=1)
    rows = np.zeros((len(angles), 3, 15))
    for axis in range(3):
        rows[:, axis, axis], rows[:, axis, 3 + axis] = force[:, axis], 1.0
        rows[:, :, 9 + axis] = np.cross(force, np.eye(3)[axis])
    rows[:, 1, 6] = rows[:, 2, 7] = force[:, 0]
    rows[:, 2, 8] = force[:, 1]
    for k, setting in enumerate((0.0, 45.0, 90.0)):
        rows[:, :, 12 + k] = pitch * (np.degrees(beta).round(6) == setting)[:, None]
    return rows


def reached(angles: list[tuple[float, float]], noise_g: float, target: dict[str, float]) -> int | None:
    """The number of positions after which all targets are reached; None if never."""
    information = np.diag(np.r_[np.full(12, 1.0), np.full(3, 1 / PRIOR_RAD**2)])
    wanted = np.array([target[name] for name in NAMES])
    for count, row in enumerate(rows_of(angles), 1):
        information = information + row.T @ row / noise_g**2
        if count > 8 and np.all(np.sqrt(np.diag(np.linalg.inv(information))[:9]) <= wanted):
            return count
    return None


def minutes_of(angles: list[tuple[float, float]], pitch_s: float) -> float:
    """Duration."""
    total = len(angles) * (DWELL_S + SETTLE_S)
    for before, after in pairwise(angles):
        total += TURN_S * (before[0] != after[0]) + pitch_s * (before[1] != after[1])
    return total / 60


def adaptive(
    chooser: AdaptiveChooser, count: int, noise_g: float, blocked: Collection[tuple[float, float]], *, on: bool = False
) -> list[tuple[float, float]]:
    """The positions of an adaptive capture from (0, 0) on; it does not end by time. `on`: nor by its targets, which are divided
    by the square root of 2 whenever they are reached."""
    times = chooser.ability.times
    done, now = [DonePosition(0.0, 0.0, 0.0, (noise_g,) * 3)], DWELL_S
    while len(done) < count:
        chosen = chooser(Progress(tuple(done), now, 1e9, tuple(blocked)))
        if not isinstance(chosen, Choice):
            if not on:
                break
            assert chooser.target is not None
            chooser = replace(chooser, target=Target({name: sd / 2**0.5 for name, sd in chooser.target.sd.items()}))
            continue
        before = done[-1]
        turn, change = chosen.alpha_deg != before.alpha_deg, chosen.beta_deg != before.beta_deg
        now += SETTLE_S + TURN_S * turn + times.pitch_change_s * change
        done.append(DonePosition(chosen.alpha_deg, chosen.beta_deg, now, (noise_g,) * 3))
        now += DWELL_S
    return [(one.alpha_deg, one.beta_deg) for one in done]


def best_plan(chooser: AdaptiveChooser) -> list[tuple[float, float]]:
    """The best 24 positions by exchange, in the order that visits each pitch setting once."""
    here = chooser.here
    found = exchange(
        limits_of(here.cells, chooser.ability, count=24), measures(one_visit(here), chooser.criterion), restarts=4
    )
    return angles_of(chooser, found.cells)


def shortest_plan(chooser: AdaptiveChooser) -> list[tuple[float, float]]:
    """The shortest plan that reaches the targets at the stated noise."""
    here = chooser.here
    planner = Planner(here, chooser.ability, chooser.criterion, None, np.ones(len(here.cells), bool))
    found = planner.plan(np.inf, 1.0)
    assert found is not None
    return angles_of(chooser, found.cells)


def angles_of(chooser: AdaptiveChooser, taken: np.ndarray) -> list[tuple[float, float]]:
    """The angles of some cells."""
    cells = chooser.here.cells
    return list(zip(cells.alpha_deg[taken].tolist(), cells.beta_deg[taken].tolist(), strict=True))


def targets(chooser: AdaptiveChooser, cases: int, spread: float, rng: np.random.Generator) -> None:
    """The table of positions and minutes until the target."""
    every = [(15.0 * k, beta) for beta in (0.0, 45.0, 90.0) for k in range(24)][1:]
    found: dict[str, list[tuple[float, float]]] = {}
    slowest, best = 0.0, best_plan(chooser)
    for _ in range(cases):
        noise = 1e-4 * np.exp(rng.uniform(np.log(0.7), np.log(2.0)))
        blocked = {every[k] for k in rng.choice(len(every), len(every) // 10, replace=False)}
        seen = max(noise, 1e-4)
        wanted = {name: sd * float(spread ** rng.uniform(-1, 1)) for name, sd in WANTED.items()}
        aimed = replace(chooser, target=Target(wanted))
        begun = time.perf_counter()
        chosen = adaptive(aimed, MOST, noise, blocked)
        slowest = max(slowest, (time.perf_counter() - begun) / len(chosen))
        sequences = [
            Sequence("the paper's 24, repeated", [at for at in PAPER if at not in blocked] * 20),
            Sequence("best 24 of a search, repeated", [at for at in best if at not in blocked] * 20),
            Sequence(
                "shortest plan at the stated noise, repeated",
                [at for at in shortest_plan(aimed) if at not in blocked] * 20,
            ),
            Sequence("`capture --adaptive`", chosen),
        ]
        for one in sequences:
            count, pitch_s = reached(one.angles, seen, wanted), chooser.ability.times.pitch_change_s
            value = (np.inf, np.inf) if count is None else (float(count), minutes_of(one.angles[:count], pitch_s))
            found.setdefault(one.name, []).append(value)
    print("| positions | median number (10 to 90 %) | median minutes | not reached |\n|---|---|---|---|")
    for name, values in found.items():
        numbers, minutes = np.array(values).T
        low, middle, high = np.percentile(numbers, [10, 50, 90], method="nearest")
        missing = int(np.isinf(numbers).sum())
        print(f"| {name} | {middle:.0f} ({low:.0f} to {high:.0f}) | {np.median(minutes):.0f} | {missing} of {cases} |")
    print(f"a choice takes {slowest:.3f} s at most (mean of a run)")


def rig_with(pitch_s: float, prior: str = "6 arcmin") -> Rig:
    """The rig, with the time of a change of the pitch setting, and the prior of its errors."""
    text = RIG.replace("PITCH_S", str(pitch_s)).replace("6 arcmin", prior)
    return rig_of(tomllib.loads(text), Path("rig.toml"), *links_and_units(catalogue()))


def chooser_with(rig: Rig) -> AdaptiveChooser:
    """The chooser of a capture that begins at (0, 0), with the targets."""
    listed = {
        "positions": {"listed": [{"alpha_deg": 0, "beta_deg": 0}]},
        "dwell": {"seconds": DWELL_S, "settle_s": SETTLE_S},
    }
    return replace(chooser_of(rig, CapturePlan.model_validate(listed)), target=Target(WANTED))


def named(rig: Rig, options: argparse.Namespace) -> None:
    """The table of the instruments whose effect is named."""
    from adaptive_named import LENGTHS, named_table

    chooser, longest = chooser_with(rig), max(LENGTHS)
    sequences = {
        "the paper's 24, repeated": (PAPER * 2)[:longest],
        "best 24 of a search, repeated": (best_plan(chooser) * 2)[:longest],
        "`capture --adaptive`": adaptive(chooser, longest, 1e-4, (), on=True),
    }
    named_table(rig, sequences, options.named, options.whole, options.seed, options.out)


def main() -> None:
    parser = argparse.ArgumentParser(description="Positions chosen during the measurement against fixed ones.")
    parser.add_argument("--targets", type=int, default=0, help="number of instruments")
    parser.add_argument("--pitch-s", type=float, default=120.0, help="time of a change of the pitch setting, s")
    parser.add_argument("--spread", type=float, default=1.0, help="largest random factor of each target")
    parser.add_argument("--named", type=int, default=0, help="number of instruments with a hidden effect")
    parser.add_argument("--whole", type=int, default=30, help="instruments that are diagnosed whole, too")
    parser.add_argument("--out", type=Path, default=Path("named.jsonl"), help="results of --named; continued")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    tumblecal.enable_float64()
    from tumblecal.cli.start import start

    start()
    if options.targets:
        chooser = chooser_with(rig_with(options.pitch_s))
        targets(chooser, options.targets, options.spread, np.random.default_rng(options.seed))
    if options.named:
        named(rig_with(options.pitch_s, prior="3 arcmin"), options)


if __name__ == "__main__":
    main()
