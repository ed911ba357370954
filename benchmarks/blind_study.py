"""Blind study of the diagnosis: hidden effects of random size in random instruments, found or not.

    python benchmarks/blind_study.py --cases 3600 --rivals --workers 2

prints the targets with what was measured, how well the stated probabilities and intervals hold, the confusion table,
and the same cases done by stepwise regression, by the lasso (needs scikit-learn) and by a clairvoyant. Sizes are d, the
norm of the part that the nominal model cannot reach, in sigma. An unknown cause that an entry of the catalogue
describes to within 5 sigma is drawn again.
"""

import argparse
import json
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
from scipy import stats

import blind_instrument as blind
import blind_rivals as versus
import tumblecal


tumblecal.enable_float64()
from blind_judge import interval, print_reliability, right, stated, sure, with_unexplained  # noqa: E402
from blind_noise import position_set  # noqa: E402
from tumblecal.diagnosis.causes.cause import Cause  # noqa: E402
from tumblecal.diagnosis.detection.reference import References  # noqa: E402
from tumblecal.diagnosis.exact.insert import fit_with  # noqa: E402
from tumblecal.diagnosis.findings.determined import combinations  # noqa: E402
from tumblecal.diagnosis.findings.gain import gain  # noqa: E402
from tumblecal.diagnosis.model.full_model import FullModel, model_of  # noqa: E402
from tumblecal.diagnosis.screening.noise_change import screen_with_noise  # noqa: E402
from tumblecal.diagnosis.screening.screen import Screening  # noqa: E402
from tumblecal.diagnosis.screening.screened import Screened  # noqa: E402
from tumblecal.diagnosis.sets.classes import verdict_of  # noqa: E402
from tumblecal.effects import catalogue  # noqa: E402
from tumblecal.estimation import default_chain, problem_of, where_of  # noqa: E402
from tumblecal.estimation.fit import Fit  # noqa: E402


PLANS = {"3x8": (3, 8), "4x12": (4, 12)}


@dataclass
class Case:
    """What was hidden: `truth` are the names to be found, `clean` the readings without noise."""

    setup: blind.Setup
    measured: np.ndarray
    truth: tuple[str, ...]
    clean: np.ndarray
    effects: dict[str, np.ndarray]


def hidden(rng, plan, names_of, sizes, gross=None, most_cosine=None, soaks=()):
    """A case with effects drawn by `names_of(rng)`, each of its size, and perhaps a gross fault, at one of the soaks
    (degC; none: about 25)."""
    while True:
        setup = blind.random_setup(rng, *map(int, plan.split("x")))
        projector = blind.unreachable(setup)
        names = names_of(rng)
        drawn = [blind.sized(setup, projector, name, d, rng) for name, d in zip(names, sizes, strict=True)]
        if any(sized is None for sized in drawn):
            continue
        signals = [signal / np.linalg.norm(signal) for _, signal, *_ in drawn]
        if most_cosine is not None and any(
            abs(a @ b) > most_cosine for i, a in enumerate(signals) for b in signals[:i]
        ):
            continue
        if names and names[0] in blind.UNKNOWN and not blind.resembles_none(setup, projector, drawn[0][1], 5.0):
            continue
        effects = {name: sized[0] for name, sized in zip(names, drawn, strict=True)}
        setup.temperature_degc += rng.choice(soaks) - 25.0 if soaks else 0.0
        clean = blind.readings(setup, setup.nominal, effects)
        measured = clean + blind.SIGMA * rng.normal(size=clean.shape)
        begins = setup.names[len(setup.names) // 2]
        truth = [
            f"{'mount_slip' if 'slip' in name else 'bias_jump'}:{begins}" if name in blind.JUMPS else name
            for own in names
            for name in blind.POLYNOMIALS.get(own, (own,))
        ]
        if gross == "outlier":
            measured, label = blind.knocked(setup, projector, measured, rng.integers(len(measured)), rng)
            truth.append(label)
        if gross == "swap":
            if (swap := blind.exchanged(setup, projector, measured, rng)) is None:
                continue
            measured, label = swap
            truth.append(label)
        return Case(setup, measured, tuple(sorted(truth)), clean, effects)


class Bench:
    """Runs the screen on cases; what a plan alone decides is made once."""

    def __init__(self):
        self.references, self.entries = References(), catalogue()
        self.models: dict[int, FullModel] = {}

    def __call__(self, case: Case, known: bool) -> tuple[Screened, tuple[str, ...]]:
        """The screen of a case under the noise model arrived at, and what was found wrong with the noise."""
        data = position_set(case.setup, case.measured, known)
        where = where_of(data)
        if len(data) not in self.models:
            self.models[len(data)] = model_of(default_chain(data), where, self.entries)
        model = self.models[len(data)].started(where)
        problem = problem_of(data, model.nominal_chain)
        screening = Screening(model, self.references.of(model, problem))
        screened, noise_wrong, _ = screen_with_noise(screening, problem)
        return screened, tuple(noise_wrong)


def one_of(names):
    names = list(names)
    return lambda rng: (names[rng.integers(len(names))],)


def several(count):
    names = list(blind.COEFFICIENTS)
    return lambda rng: tuple(names[k] for k in rng.choice(len(names), count, replace=False))


def on_all_axes(rng):
    family = ALIKE[rng.integers(len(ALIKE))]
    return tuple(f"{family}.{axis}" for axis in blind.AXES)


ALIKE = sorted({name.rpartition(".")[0] for name in blind.COEFFICIENTS if name.endswith(".y") and name.count(".") == 1})
THERMAL = [name for name in blind.COEFFICIENTS if "_temperature" in name]
GROUPS = {
    "adequate": (lambda rng: (), (), {}),
    "one d=5": (one_of(blind.COEFFICIENTS), (5,), {}),
    "one d=7": (one_of(blind.COEFFICIENTS), (7,), {}),
    "one d=10": (one_of(blind.COEFFICIENTS), (10,), {}),
    "two d=8": (several(2), (8, 8), {"most_cosine": 0.5}),
    "three d=12": (several(3), (12, 12, 12), {"most_cosine": 0.5}),
    "all axes d=7 each": (on_all_axes, (7, 7, 7), {"most_cosine": 0.5}),
    "outlier + one d=8": (several(1), (8,), {"gross": "outlier"}),
    "swap + one d=8": (several(1), (8,), {"gross": "swap"}),
    "unknown d=10": (one_of(blind.UNKNOWN), (10,), {}),
    "rare d=10": (one_of(blind.RARE), (10,), {}),
    "rare d=30": (one_of(blind.RARE), (30,), {}),
    "polynomial d=7": (one_of(blind.POLYNOMIALS), (7,), {}),
    "polynomial d=12": (one_of(blind.POLYNOMIALS), (12,), {}),
    "jump d=10": (one_of(blind.JUMPS), (10,), {}),
    "soak d=7": (one_of(THERMAL), (7,), {"soaks": (-40.0, 45.0, 60.0, 85.0)}),
    "one d=15": (one_of(blind.COEFFICIENTS), (15,), {}),
    "rare d=15": (one_of(blind.RARE), (15,), {}),
}


# What is asked of the diagnosis: group, what is counted, at least or at most, share.
TARGETS = (
    ("adequate", "detected", "at most", 0.01),
    ("one d=5", "right", "at least", 0.80),
    ("one d=7", "right", "at least", 0.95),
    ("one d=10", "right", "at least", 0.98),
    ("one d=7", "identified", "at least", 0.70),
    ("one d=15", "identified", "at least", 0.85),
    ("soak d=7", "right", "at least", 0.95),
    ("one d=5", "wrong&sure", "at most", 0.02),
    ("one d=7", "wrong&sure", "at most", 0.02),
    ("one d=10", "wrong&sure", "at most", 0.02),
    ("two d=8", "right", "at least", 0.85),
    ("three d=12", "right", "at least", 0.70),
    ("outlier + one d=8", "right", "at least", 0.90),
    ("swap + one d=8", "right", "at least", 0.90),
    ("unknown d=10", "right", "at least", 0.90),
    ("unknown d=10", "wrong&sure", "at most", 0.03),
)


@dataclass
class Outcome:
    """One case judged. `right`: the hidden set is the best explanation or among its equivalents; `strict`: it is the
    best explanation itself; `stated`: the statement whose probability is given is true; `identified`: the verdict is the
    hidden set, alone or with what is one function with it at 1 g; `separable`: the equivalents that the verdict lists."""

    group: str
    plan: str
    known: bool
    truth: tuple[str, ...]
    named: tuple[str, ...]
    members: int
    probability: float
    detected: bool
    p_value: float
    right: bool
    strict: bool
    stated: bool
    identified: bool
    separable: tuple[tuple[str, ...], ...]
    sure: bool
    covered: list[bool]
    gain: tuple[float, float, float] | None
    rivals: dict[str, bool]


def judged(group: str, plan: str, known: bool, case: Case, bench: Bench, rng, rivals: bool, clairvoyant) -> Outcome:
    """Run the diagnosis, and the rivals where asked, on one case."""
    screened, noise = bench(case, known)
    best, unknown = screened.best, group.startswith("unknown")
    detected = screened.detection.detected or bool(noise)
    if unknown:
        # One of several stories for the same signal, of which one has no name, is no name either.
        strict = "unexplained" in best.labels
        ok = with_unexplained(best, noise)
    elif group == "adequate":
        ok = strict = not detected
    else:
        ok, strict = right(best, case.truth, noise), best.labels == case.truth and not noise
    covered, gained = [], None
    if group.startswith(("one", "rare", "soak", "two")) and strict:
        covered, gained = exact(case, screened, rng)
    others = {}
    if rivals and group.startswith(("adequate", "one", "two", "three", "unknown")):
        projector = blind.unreachable(case.setup)
        rest = versus.residual(case.setup, projector, case.measured)
        dof = round(float(np.trace(projector)))
        listed = versus.terms(case.setup, projector)
        truth = set() if unknown else set(case.truth)
        others = {
            "stepwise": versus.stepwise(listed, rest, dof) == truth,
            "lasso": versus.lasso(listed, rest, dof) == truth,
        }
        if group.startswith("one"):
            others["clairvoyant"] = clairvoyant(listed, rest, float(group.partition("=")[2]), rng) == case.truth[0]
    return Outcome(
        group=group,
        plan=plan,
        known=known,
        truth=case.truth,
        named=(*noise, *best.labels),
        members=1 + len(best.equivalents),
        probability=best.probability,
        detected=detected,
        p_value=screened.detection.p_value,
        right=bool(ok),
        strict=bool(strict),
        stated=bool(ok and (unknown or strict or stated(best, case.truth, noise))),
        identified=verdict_of(best, bool(noise), False, False) == "identified" and stated(best, case.truth, noise),
        separable=best.separable,
        sure=sure(best),
        covered=covered,
        gain=gained,
        rivals=others,
    )


def exact(case: Case, screened: Screened, rng) -> tuple[list[bool], tuple[float, float, float]]:
    """Whether the 95 % intervals of what is determined hold the truth, and the held-out gain beside that on fresh data."""
    before, after = fit_with(screened.at, []), fit_with(screened.at, screened.members)
    said = gain(before, after, np.arange(len(case.measured)), "position")
    covered = [
        inside for cause in screened.members for inside in held(screened, after, cause, case.effects[cause.label])
    ]
    fresh = case.clean + blind.SIGMA * rng.normal(size=case.clean.shape)
    ahead = [np.mean((fresh - case.measured + fit.residuals) ** 2) for fit in (before, after)]
    held_out = said.fresh_rms_before_g**2 - said.fresh_rms_after_g**2
    sd_gain = said.fresh_gain_sd_g * (said.fresh_rms_before_g + said.fresh_rms_after_g)
    return covered, (held_out / blind.SIGMA**2, sd_gain / blind.SIGMA**2, float(ahead[0] - ahead[1]) / blind.SIGMA**2)


def held(screened: Screened, fit: Fit, cause: Cause, truth: np.ndarray) -> list[bool]:
    """Whether the 95 % interval of each coefficient that is determined, by itself or in combination, holds the truth."""
    wide = 1.96 if screened.problem.known else stats.t.ppf(0.975, fit.dof)
    hidden_sizes = dict(zip(cause.slot.names, truth, strict=True))
    return [
        bool(abs(own.value - sum(w * hidden_sizes[name] for name, w in own.weights.items())) < wide * own.sd)
        for own in combinations(fit, cause, screened.at.model.scales)
    ]


def run_block(job) -> list[Outcome]:
    """All cases of one cell of the study."""
    group, plan, known, count, seed, rivals = job
    names_of, sizes, options = GROUPS[group]
    rng = np.random.default_rng([seed, list(GROUPS).index(group), list(PLANS).index(plan), known])
    bench, clairvoyant = Bench(), versus.Clairvoyant()
    return [
        judged(
            group,
            plan,
            known,
            hidden(rng, plan, names_of, sizes, **options),
            bench,
            rng,
            3 * k < rivals * count,
            clairvoyant,
        )
        for k in range(count)
    ]


def share(outcomes: list[Outcome], what: str) -> float:
    """Share of the outcomes that are right, detected, or wrong with more than 90 %."""
    if what == "wrong&sure":
        return float(np.mean([outcome.sure and not outcome.stated for outcome in outcomes]))
    return float(np.mean([getattr(outcome, what) for outcome in outcomes]))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=720)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="groups whose name holds this text")
    parser.add_argument("--detail", action="store_true", help="list what was missed, or not identified")
    parser.add_argument(
        "--rivals", action="store_true", help="stepwise, lasso (scikit-learn) and clairvoyant on a third of the cases"
    )
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--json", default="", help="file for all outcomes")
    args = parser.parse_args()
    groups = [name for name in GROUPS if args.only in name]
    per = max(1, args.cases // (len(groups) * 4))
    jobs = [
        (group, plan, known, per, args.seed, args.rivals)
        for group in groups
        for plan in PLANS
        for known in (True, False)
    ]
    started, outcomes = time.time(), []
    with ProcessPoolExecutor(args.workers, mp_context=get_context("spawn")) as pool:
        for job, done in zip(jobs, pool.map(run_block, jobs), strict=True):
            outcomes += done
            print(
                f"{job[0]:20s} {job[1]:5s} {'known' if job[2] else 'unknown':8s} right {share(done, 'right'):6.1%} "
                f"strictly {share(done, 'strict'):6.1%} identified {share(done, 'identified'):6.1%} "
                f"detected {share(done, 'detected'):6.1%} "
                f"wrong&sure {share(done, 'wrong&sure'):5.1%} class size {np.mean([outcome.members for outcome in done]):4.1f}",
                flush=True,
            )
            if args.detail:
                for outcome in done:
                    if not outcome.right or (not outcome.identified and group_of_one(outcome.group)):
                        others = [" + ".join(own) for own in outcome.separable]
                        print(
                            "     ", outcome.truth, "->", outcome.named, f"{outcome.probability:.2f}", *others, sep="  "
                        )
    print(
        f"\n{len(outcomes)} cases, {len(outcomes) / (time.time() - started):.1f} a second with {args.workers} workers\n"
    )
    summary(outcomes)
    if args.json:
        with open(args.json, "w") as file:
            json.dump([vars(outcome) for outcome in outcomes], file)


def summary(outcomes: list[Outcome]) -> None:
    """Targets, calibration, rivals and the confusion table."""
    print("target                                             measured  (95 % interval)")
    for group, what, sense, limit in TARGETS:
        own = [outcome for outcome in outcomes if outcome.group == group]
        if not own:
            continue
        value = share(own, what)
        low, high = interval(round(value * len(own)), len(own))
        met = value >= limit if sense == "at least" else value <= limit
        said = "met" if met else "NOT MET"
        print(f"{group:20s} {what:11s} {sense} {limit:5.0%}   {value:7.1%}  ({low:.1%} to {high:.1%})  {said}")
    print_reliability((outcome.probability, outcome.stated) for outcome in outcomes if outcome.detected)
    covered = [value for outcome in outcomes for value in outcome.covered]
    if covered:
        print(
            f"\n95 % intervals of coefficients and combinations hold the truth: {np.mean(covered):.3f} of {len(covered)}"
        )
    gains = np.array([outcome.gain for outcome in outcomes if outcome.gain])
    if len(gains):
        off = (gains[:, 0] - gains[:, 2]) / np.maximum(gains[:, 1], 1e-9)
        print(
            f"gain on a new measurement, mean square in sigma^2: said {gains[:, 0].mean():.3f}, "
            f"on fresh data {gains[:, 2].mean():.3f}; "
            f"median |difference| / stated error {np.median(np.abs(off)):.2f}, "
            f"within two errors {np.mean(np.abs(off) < 2):.1%} of {len(gains)}"
        )
    if any(outcome.rivals for outcome in outcomes):
        print("\nexactly the hidden set named (adequate and unknown: nothing named)")
        print(f"{'group':20s} {'this':>7s} {'strict':>7s} {'stepwise':>9s} {'lasso':>7s} {'clairvoyant':>12s}")
        for group in dict.fromkeys(outcome.group for outcome in outcomes if outcome.rivals):
            own = [outcome for outcome in outcomes if outcome.group == group and outcome.rivals]
            cells = [
                np.mean([outcome.rivals[name] for outcome in own]) if name in own[0].rivals else np.nan
                for name in ("stepwise", "lasso", "clairvoyant")
            ]
            cells = [share(own, "right"), share(own, "strict"), *cells]
            print(
                f"{group:20s} "
                + " ".join(f"{cell:{width}.1%}" for cell, width in zip(cells, (7, 7, 9, 7, 12), strict=True))
            )
    confusion = Counter()
    for outcome in outcomes:
        if group_of_one(outcome.group):
            confusion[_kind(outcome.truth), "right" if outcome.right else _kind(outcome.named) or "adequate"] += 1
    print("\nsingle effects: hidden -> named (an effect's axes together)")
    for hidden_one in sorted({pair[0] for pair in confusion}):
        row = {name: count for (first, name), count in confusion.items() if first == hidden_one}
        print(
            f"{hidden_one:24s}",
            ", ".join(f"{name} {count}" for name, count in sorted(row.items(), key=lambda item: -item[1])),
        )


def group_of_one(group: str) -> bool:
    """Whether one effect is hidden in the cases of a group."""
    return group.startswith(("one", "rare", "jump"))


def _kind(labels: tuple[str, ...]) -> str:
    return " + ".join(sorted(label.split(":")[0].partition(".")[0] for label in labels))


if __name__ == "__main__":
    main()
