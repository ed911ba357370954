"""Blind study of the diagnosis: hidden effects of random size in random instruments, found or not.

    python benchmarks/blind_study.py --cases 2000

prints the targets with what was measured, and the confusion table.
"""

import argparse
import time
from collections import Counter
from dataclasses import dataclass

import blind_instrument as blind
import numpy as np

import tumblecal


tumblecal.enable_float64()
from tumblecal.chain import nominal_chain, settings  # noqa: E402
from tumblecal.diagnosis.detect import NullDistributions  # noqa: E402
from tumblecal.diagnosis.linear import Weighting  # noqa: E402
from tumblecal.diagnosis.model import model_of  # noqa: E402
from tumblecal.diagnosis.screen import screen  # noqa: E402
from tumblecal.effects import catalogue  # noqa: E402


PLANS = {"3x8": (3, 8), "4x12": (4, 12)}


@dataclass
class Case:
    """What was hidden: `truth` are the names to be found, `signal` the unreachable part in sigma."""

    setup: blind.Setup
    measured: np.ndarray
    truth: tuple[str, ...]
    signal: np.ndarray


def hidden(rng, plan, names_of, sizes, gross=None, most_cosine=None):
    """A case with effects drawn by `names_of(rng)`, each of its size, and perhaps a gross fault."""
    while True:
        setup = blind.random_setup(rng, *PLANS[plan])
        projector = blind.unreachable(setup)
        names = names_of(rng)
        drawn = [blind.sized(setup, projector, name, d, rng) for name, d in zip(names, sizes, strict=True)]
        if any(one is None for one in drawn):
            continue
        signals = [one[1] / np.linalg.norm(one[1]) for one in drawn]
        if most_cosine is not None and any(
            abs(a @ b) > most_cosine for i, a in enumerate(signals) for b in signals[:i]
        ):
            continue
        if names and names[0].startswith("?") and not blind.resembles_none(setup, projector, drawn[0][1], 5.0):
            continue
        effects = {name: one[0] for name, one in zip(names, drawn, strict=True)}
        clean = blind.readings(setup, setup.nominal, effects)
        measured = clean + blind.SIGMA * rng.normal(size=clean.shape)
        truth = list(names)
        if gross == "outlier":
            position = rng.integers(len(measured))
            unit = np.zeros_like(measured)
            unit[position] = rng.normal(size=3)
            size = np.linalg.norm(projector @ unit.ravel())
            measured = measured + unit * 8 * blind.SIGMA / size
            truth.append(f"outlier_position:{setup.names[position]}")
        if gross == "swap":
            i, j = sorted(rng.choice(len(measured), 2, replace=False))
            swapped = measured.copy()
            swapped[[i, j]] = measured[[j, i]]
            if np.linalg.norm(projector @ (swapped - measured).ravel()) < 8 * blind.SIGMA:
                continue
            measured = swapped
            truth.append(f"swapped_positions:{setup.names[i]}+{setup.names[j]}")
        signal = projector @ (clean - blind.readings(setup, setup.nominal, {})).ravel() / blind.SIGMA
        return Case(setup, measured, tuple(sorted(truth)), signal)


class Bench:
    """Runs the screen on cases, drawing each null distribution once."""

    def __init__(self):
        self.nulls, self.entries, self.models = NullDistributions(), catalogue(), {}

    def __call__(self, case: Case, known: bool):
        s = case.setup
        where = settings(s.alpha, s.beta, time_s=s.time_s, temperature_degc=s.temperature_degc, approach=s.approach)
        count = len(s.alpha)
        if count not in self.models:
            self.models[count] = model_of(nominal_chain(where), where, self.entries)
        model = self.models[count]
        weights = np.full((count, 3), 1 / blind.SIGMA if known else 1e3)
        how = Weighting(weights, known, np.zeros(model.nominal), np.zeros(model.nominal))
        return screen(model, where, case.measured, tuple(s.names), how, self.nulls, (count,))


def right(best, truth):
    return best.labels == truth or truth in best.equivalents


def one_of(names):
    names = list(names)
    return lambda rng: (names[rng.integers(len(names))],)


def several(count):
    names = list(blind.COEFFICIENTS)
    return lambda rng: tuple(names[k] for k in rng.choice(len(names), count, replace=False))


GROUPS = {
    "adequate": (lambda rng: (), (), {}),
    "one d=5": (one_of(blind.COEFFICIENTS), (5,), {}),
    "one d=7": (one_of(blind.COEFFICIENTS), (7,), {}),
    "one d=10": (one_of(blind.COEFFICIENTS), (10,), {}),
    "two d=8": (several(2), (8, 8), {"most_cosine": 0.5}),
    "three d=12": (several(3), (12, 12, 12), {"most_cosine": 0.5}),
    "outlier + one d=8": (several(1), (8,), {"gross": "outlier"}),
    "swap + one d=8": (several(1), (8,), {"gross": "swap"}),
    "unknown d=10": (one_of(blind.UNKNOWN), (10,), {}),
}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=360)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="")
    parser.add_argument("--detail", action="store_true")
    args = parser.parse_args()
    bench, statements = Bench(), []
    started, done = time.time(), 0
    groups = {name: spec for name, spec in GROUPS.items() if args.only in name}
    per = max(1, args.cases // (len(groups) * 4))
    for group, (names_of, sizes, options) in groups.items():
        for plan in PLANS:
            for known in (True, False):
                rng = np.random.default_rng([args.seed, len(group), sizes and sizes[0] or 0, len(plan), known])
                good = wrong_sure = detected = members = 0
                missed = Counter()
                for _ in range(per):
                    case = hidden(rng, plan, names_of, sizes, **options)
                    out = bench(case, known)
                    done += 1
                    best = out.best
                    detected += out.detection.detected
                    if group == "adequate":
                        ok = not out.detection.detected
                    elif group.startswith("unknown"):
                        ok = "unexplained" in best.labels
                        wrong = best.single_name and best.probability > 0.9 and not ok and best.labels
                        wrong_sure += bool(wrong)
                    else:
                        ok = right(best, case.truth)
                        wrong_sure += best.single_name and best.probability > 0.9 and not ok
                        members += 1 + len(best.equivalents)
                    if out.detection.detected:
                        statements.append((best.probability, ok))
                    good += ok
                    if not ok:
                        missed[(case.truth, best.labels, round(best.probability, 2), round(out.detection.p_value, 4))] += 1
                print(
                    f"{group:20s} {plan:5s} {'known' if known else 'unknown':8s} right {good / per:6.1%} "
                    f"detected {detected / per:6.1%} wrong&sure {wrong_sure / per:5.1%} class size {members / per:4.1f}",
                    flush=True,
                )
                if args.detail:
                    for what, times in missed.most_common(40):
                        print("     ", times, *what)
    print(f"{done} cases, {done / (time.time() - started):.1f} a second")
    if statements:
        p, ok = np.array(statements, float).T
        for low, high in ((0, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 0.85), (0.85, 0.95), (0.95, 0.99), (0.99, 1.01)):
            here = (p >= low) & (p < high)
            if here.any():
                print(f"said {low:.2f}-{high:.2f}: {here.sum():5d} statements, mean {p[here].mean():.3f}, right {ok[here].mean():.3f}")


if __name__ == "__main__":
    main()
