"""The population `catalogue`: effects of the catalogue, and a few that it lacks, hidden in random instruments.

Measures: how often the intervals of the coefficients contain the true value, and the improvement for a new measurement: as
stated, and on fresh data of the same instrument.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import stats

import blind_instrument as blind
import tumblecal


tumblecal.enable_float64()
from blind.conditions import FAMILIES, THERMAL, several  # noqa: E402
from blind.judge import UNEXPLAINED, Answer, Case, Outcome, answer_of, interval  # noqa: E402
from blind_noise import position_set  # noqa: E402
from tumblecal.diagnosis.findings.determined import combinations  # noqa: E402
from tumblecal.diagnosis.findings.gain import gain  # noqa: E402
from tumblecal.diagnosis.refine.insert import fit_with  # noqa: E402
from tumblecal.diagnosis.screening.noise_change import screen_with_noise  # noqa: E402
from tumblecal.diagnosis.screening.screen import Screening  # noqa: E402
from tumblecal.diagnosis.sets.explanation import verdict_of  # noqa: E402
from tumblecal.effects import catalogue  # noqa: E402
from tumblecal.estimation import default_chain, problem_of, where_of  # noqa: E402
from tumblecal.full_model.full_model import FullModel, model_of  # noqa: E402


PLANS = ("3x8", "4x12")
APART = {"most_cosine": 0.5}


def one_of(names):
    """One effect of these."""
    names = list(names)
    return lambda rng: (names[rng.integers(len(names))],)


def on_all_axes(rng):
    """One effect on each axis, with a coefficient of its own."""
    family = FAMILIES[rng.integers(len(FAMILIES))]
    return tuple(f"{family}.{axis}" for axis in blind.AXES)


def nothing(rng):
    return ()


# Names of the effects, their sizes in sigma, options of `hidden`.
KINDS = {
    "adequate": (nothing, (), {}),
    "one d=5": (one_of(blind.COEFFICIENTS), (5,), {}),
    "one d=7": (one_of(blind.COEFFICIENTS), (7,), {}),
    "one d=10": (one_of(blind.COEFFICIENTS), (10,), {}),
    "two d=8": (several(2), (8, 8), APART),
    "three d=12": (several(3), (12, 12, 12), APART),
    "all axes d=7 each": (on_all_axes, (7, 7, 7), APART),
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
# Requirements: kind, what is counted, least or largest share.
AT_LEAST = {
    ("one d=5", "right"): 0.80,
    ("one d=7", "right"): 0.95,
    ("one d=10", "right"): 0.98,
    ("one d=7", "identified"): 0.70,
    ("one d=15", "identified"): 0.85,
    ("soak d=7", "right"): 0.95,
    ("two d=8", "right"): 0.85,
    ("three d=12", "right"): 0.70,
    ("outlier + one d=8", "right"): 0.90,
    ("swap + one d=8", "right"): 0.90,
    ("unknown d=10", "right"): 0.90,
}
AT_MOST = {
    ("adequate", "detected"): 0.01,
    **{(f"one d={d}", "wrong"): 0.02 for d in (5, 7, 10)},
    ("unknown d=10", "wrong"): 0.03,
}


@dataclass
class Hidden:
    """A drawn case: `truth` are the names to be found, `clean` the readings without noise."""

    setup: blind.Setup
    measured: np.ndarray
    truth: tuple[str, ...]
    clean: np.ndarray
    effects: dict[str, np.ndarray]


def hidden(rng, plan, names_of, sizes, gross=None, most_cosine=None, soaks=()):
    """An instrument with effects of given sizes, perhaps with a gross fault, at one of the soaks (degC; none: about 25).

    A cause without an entry is drawn again if an entry of the catalogue describes it to within 5 sigma.
    """
    while True:
        setup = blind.random_setup(rng, *map(int, plan.split("x")))
        projector = blind.unreachable(setup)
        names = names_of(rng)
        drawn = [blind.sized(setup, projector, name, d, rng) for name, d in zip(names, sizes, strict=True)]
        if any(sized is None for sized in drawn):
            continue
        signals = [signal / np.linalg.norm(signal) for _, signal, *_ in drawn]
        cosines = [abs(a @ b) for i, a in enumerate(signals) for b in signals[:i]]
        if most_cosine is not None and max(cosines, default=0.0) > most_cosine:
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
        fault = None
        if gross == "outlier":
            fault = blind.knocked(setup, projector, measured, rng.integers(len(measured)), rng)
        if gross == "swap" and (fault := blind.exchanged(setup, projector, measured, rng)) is None:
            continue
        if fault is not None:
            measured, label = fault
            truth.append(label)
        return Hidden(setup, measured, tuple(sorted(truth)), clean, effects)


class Bench:
    """Runs the screen on cases; the model of a plan is made once."""

    def __init__(self):
        self.entries = catalogue()
        self.models: dict[int, FullModel] = {}

    def __call__(self, case: Hidden, known: bool):
        """The screen of a case under the final noise model, and the faults of the noise."""
        data = position_set(case.setup, case.measured, known)
        where = where_of(data)
        if len(data) not in self.models:
            self.models[len(data)] = model_of(default_chain(data), where, self.entries)
        model = self.models[len(data)].started(where)
        problem = problem_of(data, model.nominal_chain)
        screened, noise_wrong, _ = screen_with_noise(Screening(model), problem)
        return screened, tuple(noise_wrong)


def cases(kind: str, count: int, seed: int) -> Iterator[Case]:
    """A fourth of the cases each for both plans and for noise stated and unknown."""
    names_of, sizes, options = KINDS[kind]
    number, unknown = 0, kind.startswith("unknown")
    for plan in PLANS:
        for known in (True, False):
            rng = np.random.default_rng([seed, list(KINDS).index(kind), PLANS.index(plan), known])
            for _ in range(max(1, count // 4)):
                own = hidden(rng, plan, names_of, sizes, **options)
                accepted = ((UNEXPLAINED,) if unknown else own.truth,)
                yield Case(kind, number, plan, known, accepted, own.measured, (own, rng))
                number += 1


@cache
def _bench() -> Bench:
    return Bench()


def answered(drawn: Iterable[Case]) -> Iterator[tuple[Case, Answer]]:
    """Screened; for a named truth of the catalogue with its intervals and the improvement."""
    for case in drawn:
        own, rng = case.hidden
        screened, noise = _bench()(own, case.known)
        best, measures = screened.best, {}
        if case.kind.startswith(("one", "rare", "soak", "two")) and best.labels == own.truth and not noise:
            measures = exact(own, screened, rng)
        detected = screened.detection.detected or bool(noise)
        verdict = verdict_of(best, bool(noise), False, False) if detected else "adequate"
        yield case, answer_of(best, noise, verdict, detected, measures=measures)


def exact(case: Hidden, screened, rng) -> dict[str, float]:
    """Intervals that contain the true value; the improvement in sigma squared, as stated and on fresh data."""
    before, after = fit_with(screened.at, []), fit_with(screened.at, screened.members)
    forecast = gain(before, after, np.arange(len(case.measured)), "position")
    inside = [one for cause in screened.members for one in held(screened, after, cause, case.effects[cause.label])]
    fresh = case.clean + blind.SIGMA * rng.normal(size=case.clean.shape)
    square = [np.mean((fresh - case.measured + fit.residuals) ** 2) for fit in (before, after)]
    stated = forecast.fresh_rms_before_g**2 - forecast.fresh_rms_after_g**2
    sd = forecast.fresh_gain_sd_g * (forecast.fresh_rms_before_g + forecast.fresh_rms_after_g)
    found = {"gain": stated, "gain sd": sd, "fresh gain": float(square[0] - square[1])}
    intervals = {"covered": float(np.sum(inside)), "intervals": float(len(inside))}
    return intervals | {name: value / blind.SIGMA**2 for name, value in found.items()}


def held(screened, fit, cause, truth: np.ndarray) -> list[bool]:
    """Whether the 95 % interval of each determined coefficient or combination contains the true value."""
    wide = 1.96 if screened.problem.known else stats.t.ppf(0.975, fit.dof)
    sizes = dict(zip(cause.slot.names, truth, strict=True))
    return [
        bool(abs(own.value - sum(w * sizes[name] for name, w in own.weights.items())) < wide * own.sd)
        for own in combinations(fit, cause, screened.at.model.scales)
    ]


def summary(outcomes: Sequence[Outcome]) -> None:
    """Requirements, intervals and improvement."""
    print("\n| requirement | limit | measured | 95 % interval | |\n|---|---|---|---|---|")
    for sense, table in (("at least", AT_LEAST), ("at most", AT_MOST)):
        for (kind, counted), limit in table.items():
            if own := [getattr(outcome, counted) for outcome in outcomes if outcome.case.kind == kind]:
                share, (low, high) = np.mean(own), interval(sum(own), len(own))
                met = "met" if (share >= limit if sense == "at least" else share <= limit) else "NOT MET"
                print(f"| {kind}: {counted} | {sense} {limit:.0%} | {share:.1%} | {low:.1%} to {high:.1%} | {met} |")
    own = [outcome.answer.measures for outcome in outcomes if "gain" in outcome.answer.measures]
    if own:
        column = {name: np.array([one[name] for one in own]) for name in own[0]}
        count = column["intervals"].sum()
        print(f"\n95 % intervals that contain the true value: {column['covered'].sum() / count:.1%} of {count:.0f}")
        away = np.abs(column["gain"] - column["fresh gain"]) / np.maximum(column["gain sd"], 1e-9)
        print(
            f"improvement in sigma^2: stated {column['gain'].mean():.3f}, on fresh data {column['fresh gain'].mean():.3f}; "
            f"within two stated errors {np.mean(away < 2):.1%} of {len(away)}"
        )
