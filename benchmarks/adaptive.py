"""Positions chosen during the measurement against fixed ones: how many until a target is reached.

    python benchmarks/adaptive.py --targets 16

Three sequences on one head (24 spindle angles, 3 pitch settings, one mounting), each repeated from its start if it is over:
the paper's 24 positions in their order, the best 24 positions of an exchange (`tumblecal plan`), and those of
`capture --adaptive`.

`--targets`: instruments whose noise is 0.7 to 2 times the stated one, on which a tenth of the settings cannot be used. Counted
are the positions and minutes until all nine uncertainties are reached, by generalised least squares in plain numpy with the
noise of the instrument.
"""

import argparse
import time
import tomllib
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

import tumblecal
from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.run.choice import Choice, DonePosition, Progress
from tumblecal.chain.rig_file import rig_of
from tumblecal.design.adaptive import AdaptiveChooser, chooser_of
from tumblecal.design.exchange import exchange
from tumblecal.design.limits import limits_of
from tumblecal.design.measure import measures
from tumblecal.design.one_visit import one_visit
from tumblecal.design.target import Target


RIG = """
schema = "tumblecal.rig/1"
[plan]
alpha_deg = { start = 0, step = 45, count = 8 }
beta_deg = [0, 45, 90]
[noise]
sd = "0.1 mg"
[priors]
dbeta = "6 arcmin"
[head]
times = { turn_s = 15, pitch_change_s = 120 }
repeatability = { pitch = "0 arcsec" }
"""
PRIOR_RAD, DWELL_S, SETTLE_S, TURN_S, PITCH_S = np.radians(0.1), 60.0, 10.0, 15.0, 120.0
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


def reached(angles: list[tuple[float, float]], noise_g: float) -> int | None:
    """The number of positions after which all targets are reached; None if never."""
    information = np.diag(np.r_[np.full(12, 1.0), np.full(3, 1 / PRIOR_RAD**2)])
    wanted = np.array([WANTED[name] for name in NAMES])
    for count, row in enumerate(rows_of(angles), 1):
        information = information + row.T @ row / noise_g**2
        if count > 8 and np.all(np.sqrt(np.diag(np.linalg.inv(information))[:9]) <= wanted):
            return count
    return None


def minutes_of(angles: list[tuple[float, float]]) -> float:
    """Duration."""
    total = len(angles) * (DWELL_S + SETTLE_S)
    for before, after in pairwise(angles):
        total += TURN_S * (before[0] != after[0]) + PITCH_S * (before[1] != after[1])
    return total / 60


def adaptive(chooser: AdaptiveChooser, count: int, noise_g: float, blocked: set[tuple[float, float]]) -> list:
    """The positions of an adaptive capture from (0, 0) on; it does not end by time."""
    done, now = [DonePosition(0.0, 0.0, 0.0, (noise_g,) * 3)], DWELL_S
    skipped = tuple(blocked)
    while len(done) < count:
        chosen = chooser(Progress(tuple(done), now, 1e9, skipped))
        if not isinstance(chosen, Choice):
            break
        before = done[-1]
        now += (
            SETTLE_S + TURN_S * (chosen.alpha_deg != before.alpha_deg) + PITCH_S * (chosen.beta_deg != before.beta_deg)
        )
        done.append(DonePosition(chosen.alpha_deg, chosen.beta_deg, now, (noise_g,) * 3))
        now += DWELL_S
    return [(one.alpha_deg, one.beta_deg) for one in done]


def best_plan(chooser: AdaptiveChooser) -> list[tuple[float, float]]:
    """The best 24 positions by exchange, in the order that visits each pitch setting once."""
    here = chooser.here
    found = exchange(
        limits_of(here.cells, chooser.ability, count=24), measures(one_visit(here), chooser.criterion), restarts=4
    )
    cells = here.cells
    return list(zip(cells.alpha_deg[found.cells].tolist(), cells.beta_deg[found.cells].tolist(), strict=True))


def targets(chooser: AdaptiveChooser, best: list[tuple[float, float]], cases: int, rng: np.random.Generator) -> None:
    """The table of positions and minutes until the target."""
    every = [(15.0 * k, beta) for beta in (0.0, 45.0, 90.0) for k in range(24)][1:]
    found: dict[str, list[tuple[float, float]]] = {}
    slowest = 0.0
    for _ in range(cases):
        noise = 1e-4 * np.exp(rng.uniform(np.log(0.7), np.log(2.0)))
        blocked = {every[k] for k in rng.choice(len(every), len(every) // 10, replace=False)}
        seen = max(noise, 1e-4)
        begun = time.perf_counter()
        chosen = adaptive(chooser, MOST, noise, blocked)
        slowest = max(slowest, (time.perf_counter() - begun) / len(chosen))
        sequences = [
            Sequence("the paper's 24, repeated", [at for at in PAPER if at not in blocked] * 20),
            Sequence("best 24 of a search, repeated", [at for at in best if at not in blocked] * 20),
            Sequence("adaptive", chosen),
        ]
        for one in sequences:
            count = reached(one.angles, seen)
            value = (np.inf, np.inf) if count is None else (float(count), minutes_of(one.angles[:count]))
            found.setdefault(one.name, []).append(value)
    print("| positions | median number (10 to 90 %) | median minutes | not reached |\n|---|---|---|---|")
    for name, values in found.items():
        numbers, minutes = np.array(values).T
        low, middle, high = np.percentile(numbers, [10, 50, 90], method="nearest")
        missing = int(np.isinf(numbers).sum())
        print(f"| {name} | {middle:.0f} ({low:.0f} to {high:.0f}) | {np.median(minutes):.0f} | {missing} of {cases} |")
    print(f"a choice takes {slowest:.3f} s at most (mean of a run)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--targets", type=int, default=16, help="number of instruments")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    tumblecal.enable_float64()
    from tumblecal.cli.start import start

    start()
    listed = {
        "positions": {"listed": [{"alpha_deg": 0, "beta_deg": 0}]},
        "dwell": {"seconds": DWELL_S, "settle_s": SETTLE_S},
    }
    plan = CapturePlan.model_validate(listed)
    chooser = replace(chooser_of(rig_of(tomllib.loads(RIG), Path("rig.toml")), plan), target=Target(WANTED))
    targets(chooser, best_plan(chooser), options.targets, np.random.default_rng(options.seed))


if __name__ == "__main__":
    main()
