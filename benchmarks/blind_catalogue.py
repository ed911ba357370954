"""Effects of the catalogue, and a few that it lacks, hidden in random instruments: the first simulator of `blind_study.py`.

Sizes are d, the norm of the part that the nominal model cannot reach, in sigma. An unknown cause that an entry of the
catalogue describes to within 5 sigma is drawn again. Measures: how often the intervals of the coefficients contain the truth,
and the improvement on fresh data of the same instrument with the one that was stated.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import stats

import blind_instrument as blind
import blind_rivals as versus
import tumblecal


tumblecal.enable_float64()
from blind_judge import UNEXPLAINED, Answer, Case, Outcome, answer_of, interval  # noqa: E402
from blind_noise import position_set  # noqa: E402
from tumblecal.diagnosis.causes.cause import Cause  # noqa: E402
from tumblecal.diagnosis.detection.reference import References  # noqa: E402
from tumblecal.diagnosis.findings.determined import combinations  # noqa: E402
from tumblecal.diagnosis.findings.gain import gain  # noqa: E402
from tumblecal.diagnosis.model.full_model import FullModel, model_of  # noqa: E402
from tumblecal.diagnosis.refine.insert import fit_with  # noqa: E402
from tumblecal.diagnosis.screening.noise_change import screen_with_noise  # noqa: E402
from tumblecal.diagnosis.screening.screen import Screening  # noqa: E402
from tumblecal.diagnosis.screening.screened import Screened  # noqa: E402
from tumblecal.diagnosis.sets.explanation import verdict_of  # noqa: E402
from tumblecal.effects import catalogue  # noqa: E402
from tumblecal.estimation import default_chain, problem_of, where_of  # noqa: E402
from tumblecal.estimation.fit import Fit  # noqa: E402


PLANS = {"3x8": (3, 8), "4x12": (4, 12)}


@dataclass
class Hidden:
    """What was hidden: `truth` are the names to be found, `clean` the readings without noise."""

    setup: blind.Setup
    measured: np.ndarray
    truth: tuple[str, ...]
    clean: np.ndarray
    effects: dict[str, np.ndarray]


def hidden(rng, plan, names_of, sizes, gross=None, most_cosine=None, soaks=()):
    """An instrument with effects drawn by `names_of(rng)`, each of its size, and perhaps a gross fault, at one of the soaks
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
        return Hidden(setup, measured, tuple(sorted(truth)), clean, effects)


class Bench:
    """Runs the screen on cases; what a plan alone decides is made once."""

    def __init__(self):
        self.references, self.entries = References(), catalogue()
        self.models: dict[int, FullModel] = {}

    def __call__(self, case: Hidden, known: bool) -> tuple[Screened, tuple[str, ...]]:
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
KINDS = {
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


# Requirements: kind, what is counted, at least or at most, share.
TARGETS = (
    ("adequate", "detected", "at most", 0.01),
    ("one d=5", "right", "at least", 0.80),
    ("one d=7", "right", "at least", 0.95),
    ("one d=10", "right", "at least", 0.98),
    ("one d=7", "identified", "at least", 0.70),
    ("one d=15", "identified", "at least", 0.85),
    ("soak d=7", "right", "at least", 0.95),
    ("one d=5", "wrong", "at most", 0.02),
    ("one d=7", "wrong", "at most", 0.02),
    ("one d=10", "wrong", "at most", 0.02),
    ("two d=8", "right", "at least", 0.85),
    ("three d=12", "right", "at least", 0.70),
    ("outlier + one d=8", "right", "at least", 0.90),
    ("swap + one d=8", "right", "at least", 0.90),
    ("unknown d=10", "right", "at least", 0.90),
    ("unknown d=10", "wrong", "at most", 0.03),
)


def cases(kind: str, count: int, seed: int) -> Iterator[Case]:
    """A fourth of the cases each for both plans and for noise stated and unknown."""
    names_of, sizes, options = KINDS[kind]
    unknown, number = kind.startswith("unknown"), 0
    for plan in PLANS:
        for known in (True, False):
            rng = np.random.default_rng([seed, list(KINDS).index(kind), list(PLANS).index(plan), known])
            here, clairvoyant = max(1, count // 4), versus.Clairvoyant()
            for k in range(here):
                own = hidden(rng, plan, names_of, sizes, **options)
                accepted = ((UNEXPLAINED,) if unknown else own.truth,)
                # The other methods take longer: they get a third of the cases.
                of_rivals = (own, rng, clairvoyant if 3 * k < here else None)
                yield Case(kind, number, plan, known, accepted, own.measured, of_rivals)
                number += 1


@cache
def _bench() -> Bench:
    return Bench()


def answered(drawn: Iterable[Case], rivals: bool = False) -> Iterator[tuple[Case, Answer]]:
    """Screened, with what was asked of the same cases in addition."""
    for case in drawn:
        own, rng, clairvoyant = case.hidden
        screened, noise = _bench()(own, case.known)
        best, measures = screened.best, {"class size": 1 + len(screened.best.equivalents)}
        if case.kind.startswith(("one", "rare", "soak", "two")) and best.labels == own.truth and not noise:
            covered, gained = exact(own, screened, rng)
            measures |= {"covered": float(np.sum(covered)), "intervals": float(len(covered))}
            measures |= dict(zip(("gain", "gain sd", "fresh gain"), gained, strict=True))
        detected = screened.detection.detected or bool(noise)
        verdict = verdict_of(best, bool(noise), False, False) if detected else "adequate"
        if rivals and clairvoyant and case.kind.startswith(("adequate", "one", "two", "three", "unknown")):
            measures |= _of_rivals(case)
        yield case, answer_of(best, noise, verdict, detected, measures=measures)


def _of_rivals(case: Case) -> dict[str, float]:
    """Whether each of the other methods names exactly what is hidden."""
    own, rng, clairvoyant = case.hidden
    projector = blind.unreachable(own.setup)
    rest, listed = versus.residual(own.setup, projector, own.measured), versus.terms(own.setup, projector)
    dof, truth = round(float(np.trace(projector))), {*case.accepted[0]} - {UNEXPLAINED}
    named = {
        "stepwise": versus.stepwise(listed, rest, dof) == truth,
        "lasso": versus.lasso(listed, rest, dof) == truth,
    }
    if case.kind.startswith("one"):
        d = float(case.kind.partition("=")[2])
        named["clairvoyant"] = clairvoyant(listed, rest, d, rng) == own.truth[0]
    return {name: float(yes) for name, yes in named.items()}


def exact(case: Hidden, screened: Screened, rng) -> tuple[list[bool], tuple[float, float, float]]:
    """Whether the 95 % intervals of what is determined contain the truth, and the stated improvement with that on
    fresh data."""
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
    """Whether the 95 % interval of each coefficient that is determined, by itself or in combination, contains the truth."""
    wide = 1.96 if screened.problem.known else stats.t.ppf(0.975, fit.dof)
    hidden_sizes = dict(zip(cause.slot.names, truth, strict=True))
    return [
        bool(abs(own.value - sum(w * hidden_sizes[name] for name, w in own.weights.items())) < wide * own.sd)
        for own in combinations(fit, cause, screened.at.model.scales)
    ]


def summary(outcomes: Sequence[Outcome]) -> None:
    """Requirements, intervals, improvement, and what single effects were taken for."""
    print("\nrequirement                                        measured  (95 % interval)")
    for kind, counted, sense, limit in TARGETS:
        if own := [getattr(outcome, counted) for outcome in outcomes if outcome.kind == kind]:
            value, (low, high) = np.mean(own), interval(sum(own), len(own))
            met = "met" if (value >= limit if sense == "at least" else value <= limit) else "NOT MET"
            print(f"{kind:20s} {counted:11s} {sense} {limit:5.0%}   {value:7.1%}  ({low:.1%} to {high:.1%})  {met}")
    exact_ones = [outcome.measures for outcome in outcomes if "gain" in outcome.measures]
    if exact_ones:
        count = sum(own["intervals"] for own in exact_ones)
        share = sum(own["covered"] for own in exact_ones) / count
        print(f"\n95 % intervals of coefficients and combinations that contain the truth: {share:.3f} of {count:.0f}")
        said, sd, fresh = (np.array([own[name] for own in exact_ones]) for name in ("gain", "gain sd", "fresh gain"))
        off = np.abs(said - fresh) / np.maximum(sd, 1e-9)
        print(
            f"improvement for a new measurement, mean square in sigma^2: stated {said.mean():.3f}, on fresh data "
            f"{fresh.mean():.3f}; median |difference| / stated error {np.median(off):.2f}, within two errors "
            f"{np.mean(off < 2):.1%} of {len(off)}"
        )
    confusion = Counter()
    for outcome in outcomes:
        if outcome.kind.startswith(("one", "rare", "jump")):
            confusion[_ids(outcome.truth), "right" if outcome.right else _ids(outcome.labels) or "adequate"] += 1
    print("\nsingle effects: hidden -> named (an effect's axes together)")
    for hidden_one in sorted({pair[0] for pair in confusion}):
        row = sorted(((count, name) for (first, name), count in confusion.items() if first == hidden_one), reverse=True)
        print(f"{hidden_one:24s}", ", ".join(f"{name} {count}" for count, name in row))


def _ids(labels: tuple[str, ...]) -> str:
    return " + ".join(sorted(label.split(":")[0].partition(".")[0] for label in labels))
