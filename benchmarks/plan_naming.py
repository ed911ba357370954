"""Promises of a plan against what happens: standard deviations, probabilities that an effect is detected, named, identified.

    python benchmarks/plan_naming.py sd --runs 2000
    python benchmarks/plan_naming.py agreement --runs 2000
    python benchmarks/plan_naming.py loop --heads 200 --runs 5 --out loop.jsonl

`sd`: predicted standard deviations against the errors of fits. `agreement`: three plans. `loop`: random heads, each with its
plan (search, schedule, forecast), then measured and diagnosed. Readings are simulated in plain numpy (`blind_instrument`), with
random errors of the instrument, of settings, and of settings that are set again.
"""

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import blind_instrument as blind
import tumblecal
from tumblecal.chain import Where
from tumblecal.chain.rig import Rig
from tumblecal.chain.rig_file import rig_of
from tumblecal.data import PositionSet
from tumblecal.design.criteria.criterion import worst
from tumblecal.design.criteria.measure import measures
from tumblecal.design.criteria.naming_measures import naming_measures
from tumblecal.design.forecast.effects_of_plan import EffectsOfPlan, effects_of_plan
from tumblecal.design.forecast.naming import Rates
from tumblecal.design.model.cells import cells_of
from tumblecal.design.model.evaluation import uncertainties
from tumblecal.design.model.limits import limits_of
from tumblecal.design.model.one_visit import one_visit
from tumblecal.design.model.planned_rig import planned_rig
from tumblecal.design.model.responses import Responses, responses_of
from tumblecal.design.model.schedule import Schedule, schedule
from tumblecal.design.positions.exchange import exchange
from tumblecal.diagnosis import Diagnoser
from tumblecal.effects import catalogue
from tumblecal.effects.catalogue import links_and_units
from tumblecal.estimation.position_problem import problem_of, where_of
from tumblecal.estimation.visits import with_repeatability
from tumblecal.ground.errors import InputError


ENTRIES = catalogue()
TURNS = ((0.0, 0.0, 0.0), (0.0, 0.0, 90.0), (0.0, 90.0, 0.0))
# The catalogue of `loop`, without effects of time, settings and path: every head has programs of its own to compile.
_KINDS = {"second", "third", "fifth", "cross", "scale", "bias_asymmetry", "base", "axis", "index", "spindle", "fixture"}
FEW = {
    id: effect
    for id, effect in ENTRIES.items()
    if effect.make is None or (not effect.needs and {id.partition("_")[0], id.partition(".")[0]} & _KINDS)
}
_POSITIONS = 24
# g, rad or rad/rad of one unit of the catalogue: mg/g^2, mg/g^3, mrad.
UNIT = 1e-3
EFFECTS = [
    *(f"{kind}.{axis}" for kind in ("second_order", "third_order", "scale_asymmetry") for axis in "xyz"),
    *(f"cross_coupling.{axis}.{pair}" for axis in "xyz" for pair in ("xy", "xz", "yz")),
    *(f"cross_axis_square.{axis}" for axis in "xyz"),
    "axis_perpendicularity",
    "index_eccentricity",
    "index_ellipticity",
    "spindle_wobble_1",
    "spindle_wobble_2",
]
# Plans of `agreement` and `sd`: spindle angles, pitch settings, mountings; effects with the norms of their visible signals.
PLANS = {
    "4 x 12": ((30.0, 12), (0, 30, 60, 90), ("A",), {"second_order.z": 6.0, "index_eccentricity": 5.5}),
    "3 x 8, two mountings": ((45.0, 8), (0, 45, 90), ("A", "B"), {"second_order.x": 6.0, "axis_perpendicularity": 8.0}),
    "3 x 8": ((45.0, 8), (0, 45, 90), ("A",), {"second_order.z": 7.0, "index_ellipticity": 5.0}),
}


def rig_with(
    step: tuple[float, int],
    beta_deg: Sequence[float],
    mounts: Sequence[str],
    turn: int = 1,
    *,
    sd_mg: float = 0.15,
    prior: bool = False,
    again: bool = False,
) -> Rig:
    """A head: step and number of its spindle angles, pitch settings, mountings, number of the turn of the second, noise,
    a prior of 3 arcmin on the pitch errors, a repeatability of 3 arcsec of a pitch setting."""
    alpha = {"start": 0, "step": step[0], "count": step[1]}
    table = {
        "schema": "tumblecal.rig/1",
        "plan": {"alpha_deg": alpha, "beta_deg": list(beta_deg), "mounts": list(mounts)},
        "chain": {"leaves": {"dbeta": {"by": "mount.pitch"}, "dtheta": {"by": "mount"}}},
        "mounts": {name: {"rotation_deg": list(TURNS[turn * k])} for k, name in enumerate(mounts)},
        "noise": {"sd": f"{sd_mg} mg"},
        "head": {"alpha_deg": alpha, "beta_deg": list(beta_deg)},
    }
    if prior:
        table["priors"] = {"dbeta": "3 arcmin"}
    if again:
        table["head"]["repeatability"] = {"pitch": "3 arcsec"}
    return rig_of(table, Path("rig.toml"), *links_and_units(ENTRIES))


class Head:
    """A rig with a schedule on it, its forecasts, and its diagnoses of simulated data."""

    def __init__(self, rig: Rig, responses: Responses, taken: np.ndarray):
        assert rig.ability is not None
        self.responses: Responses = responses
        self.schedule: Schedule = schedule(responses.cells, taken, rig.ability.times)
        names = tuple(f"p{k}" for k in range(len(taken)))
        self.rig: Rig = planned_rig(rig, responses, self.schedule, rig.ability, names)
        self.where: Where = self.rig.where
        self.prior: float | None = None if "dbeta" not in rig.priors else rig.priors["dbeta"][1]
        self.again: float = rig.ability.repeatability.pitch or 0.0
        chain = self.rig.chain(self.where)
        self.chain = chain
        self.priors = with_repeatability(self.rig.priors, self.rig.ability.repeatability, chain, self.where)

    @classmethod
    def whole(cls, rig: Rig) -> "Head":
        """Every cell in turn."""
        responses = responses_of(rig, cells_of(rig.ability))
        return cls(rig, responses, np.arange(len(responses.cells)))

    def setup(self, rng: np.random.Generator) -> blind.Setup:
        """The measurement of a random instrument."""
        plan, visit = self.rig.plan, self.schedule.pitch_visit
        cells = self.responses.cells.chosen(self.schedule.cells)
        labels = sorted(set(plan.mounts))
        mounting = np.array([labels.index(label) for label in plan.mounts])
        # Where the repeatability is stated, a pitch setting has the same error in every mounting, and what each visit adds.
        settings = cells.pitch + (0 if self.again else 100) * mounting
        first = np.unique(visit, return_index=True)[1]
        of_setting = {
            int(own): rng.normal(0, self.prior) if self.prior else rng.uniform(-3e-3, 3e-3)
            for own in np.unique(settings)
        }
        errors = np.array([of_setting[int(settings[k])] for k in first]) + self.again * rng.standard_normal(len(first))
        mounts = [np.radians(1.0) * rng.uniform() ** (1 / 3) * direction(rng) for _ in labels]
        return blind.Setup(
            alpha=np.radians(cells.alpha_deg),
            beta=np.radians(cells.beta_deg),
            time_s=np.asarray(plan.time_s),
            temperature_degc=np.full(len(plan), 25.0),
            approach=np.ones(len(plan)),
            pitch=visit,
            nominal={
                "dK": rng.normal(0, 3e-3, 3),
                "bias": rng.normal(0, 3e-3, 3),
                "gamma": rng.normal(0, 1e-3, 3),
                "dtheta": np.concatenate(mounts),
                "dbeta": np.tile(errors, len(labels)),
            },
            names=list(plan.names),
            mounting=mounting,
            turns=Rotation.from_euler("XYZ", [-np.radians(self.rig.mounts[label]) for label in labels]).as_matrix(),
        )

    def data(self, rng: np.random.Generator, setup: blind.Setup, effects: dict[str, np.ndarray]) -> PositionSet:
        """Its readings."""
        plan = self.rig.plan
        noise = self.rig.noise_sd_g * rng.standard_normal((len(plan), 3))
        return PositionSet(
            names=plan.names,
            alpha_deg=np.asarray(plan.alpha_deg, float),
            beta_deg=np.asarray(plan.beta_deg, float),
            readings=blind.readings(setup, setup.nominal, effects) + noise,
            mount=plan.mounts if len(set(plan.mounts)) > 1 else None,
            time_s=np.asarray(plan.time_s),
            source="simulated",
        )

    def judged(self, diagnoser: Diagnoser, rng: np.random.Generator, id: str, size: float) -> np.ndarray:
        """Whether an effect is detected, named, identified in one simulated measurement."""
        count = (blind.COEFFICIENTS | blind.RARE)[id]
        data = self.data(rng, self.setup(rng), {id: np.full(count, size * UNIT)})
        found = diagnoser(data, chain=self.chain, noise_sd=self.rig.noise_sd_g, priors=self.priors)
        best = found.best
        detected = bool(found.labels)
        named = {label for labels in (best.labels, *best.equivalents) for label in labels}
        right = best.labels == (id,) or (id,) in best.identical
        return np.array([detected, detected and id in named, right and found.verdict == "identified"], float)


class OfModel(Diagnoser):
    """A diagnoser of one plan, whose model is made already."""

    def __init__(self, of: EffectsOfPlan):
        super().__init__(of.entries, nested=False)
        self._of = of

    def _model(self, given, data, sd, priors):
        return self._of.model.started(where_of(data, given))


def direction(rng: np.random.Generator) -> np.ndarray:
    """A random unit vector."""
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def promised(of: EffectsOfPlan, id: str, size: float, draws: int) -> np.ndarray:
    """The forecast of a plan for an effect of a size."""
    return np.array(Rates(of, id, np.random.default_rng(0).standard_normal((draws, of.pool.dof)))(size))


def standard_deviations(runs: int) -> None:
    """Errors of fits over predicted standard deviations, by sensor parameter."""
    for name, (step, beta, mounts, _) in PLANS.items():
        for again in (False, True):
            head = Head.whole(rig_with(step, beta, mounts, prior=again, again=again))
            predicted = uncertainties(head.responses, head.schedule, head.rig.ability)
            rng, errors = np.random.default_rng(1), []
            for _ in range(runs):
                setup = head.setup(rng)
                data = head.data(rng, setup, {})
                fit = tumblecal.fit(problem_of(data, head.chain, noise_sd=head.rig.noise_sd_g, priors=head.priors))
                truth = np.concatenate([setup.nominal[leaf] for leaf in ("gamma", "dK", "bias")])
                names = [f"gamma_{k}" for k in (21, 31, 32)] + [
                    f"{leaf}_{axis}" for leaf in ("dK", "bias") for axis in "xyz"
                ]
                errors.append([fit.value(own) - one for own, one in zip(names, truth, strict=True)])
            sd = dict(zip(predicted.names, predicted.sd, strict=True))
            ratios = np.std(errors, axis=0) / [sd[own] for own in names]
            kind = "prior and repeatability" if again else "free pitch errors"
            print(
                f"{name}, {kind}: observed / predicted sd {ratios.min():.3f} to {ratios.max():.3f} ({runs} runs)",
                flush=True,
            )


def agreement(runs: int) -> None:
    """Promised and observed rates of three plans."""
    for name, (step, beta, mounts, effects) in PLANS.items():
        head = Head.whole(rig_with(step, beta, mounts))
        of, diagnoser = effects_of_plan(head.rig, ENTRIES), Diagnoser(ENTRIES, nested=False)
        for id, norm in effects.items():
            size = norm / float(np.linalg.norm(of.shown(id)))
            rng = np.random.default_rng(3)
            observed = np.mean([head.judged(diagnoser, rng, id, size) for _ in range(runs)], axis=0)
            rates = promised(of, id, size, 4000)
            words = ", ".join(
                f"{word} {100 * a:.1f} / {100 * b:.1f}"
                for word, a, b in zip(("detected", "named", "identified"), rates, observed, strict=True)
            )
            print(
                f"{name}, {id} of {size:.3g} {ENTRIES[id].unit}: promised / observed % {words} ({runs} runs)",
                flush=True,
            )


def random_head(rng: np.random.Generator) -> Head:
    """A random head with a plan for it, by the worst uncertainty or by naming."""
    while True:
        beta = np.sort(rng.choice(np.arange(0, 91, 15), size=rng.integers(3, 6), replace=False)).tolist()
        mounts = [["A"], ["A", "B"], ["A", "B"]][rng.integers(3)]
        step = float(rng.choice([15.0, 30.0, 45.0]))
        rig = rig_with(
            (step, round(360 / step)),
            beta,
            mounts,
            int(rng.integers(1, 3)),
            sd_mg=float(np.round(np.exp(rng.uniform(np.log(0.05), np.log(0.3))), 3)),
            prior=bool(rng.integers(2)),
            again=bool(rng.uniform() < 0.3),
        )
        responses = responses_of(rig, cells_of(rig.ability))
        model = one_visit(responses)
        try:
            if rng.integers(2):
                factory = measures(model, worst(responses))
            else:
                wanted = rng.choice(["second_order.y", "third_order.z", "cross_coupling.z.xz"], 1)
                factory = naming_measures(rig, responses, (), {str(wanted[0]): 0.5}, FEW)
            chosen = exchange(limits_of(responses.cells, rig.ability, count=_POSITIONS), factory, restarts=1)
            return Head(rig, responses, chosen.cells)
        except InputError:
            continue


def closed_loop(heads: int, runs: int, seed: int, first: int, out: Path | None) -> None:
    """Promised against observed rates on random heads, by bins of the promise; heads that `out` has are not repeated."""
    results = [] if out is None or not out.exists() else [json.loads(line) for line in out.read_text().splitlines()]
    results = [own for own in results if own["seed"] == seed and first <= own["number"] < first + heads]
    done, began = {own["number"] for own in results}, time.monotonic()
    for number in range(first, first + heads):
        if number not in done:
            results.append(closed_loop_of(number, runs, seed))
            if out is not None:
                with out.open("a") as file:
                    file.write(json.dumps(results[-1]) + "\n")
        if (number + 1 - first) % 10 == 0 or number + 1 == first + heads:
            _print_bins(results, time.monotonic() - began)


def closed_loop_of(number: int, runs: int, seed: int) -> dict:
    """One random head: its promise, and whether each measurement detects, names, identifies the effect, or why not."""
    rng = np.random.default_rng([seed, number])
    head = random_head(rng)
    of = effects_of_plan(head.rig, FEW)
    diagnoser = OfModel(of)
    shown = [id for id in EFFECTS if len(of.causes(id)) and not _hidden(of, id)]
    id = shown[rng.integers(len(shown))]
    size = rng.uniform(4.0, 11.0) / float(np.linalg.norm(of.shown(id)))
    result = {"seed": seed, "number": number, "id": id, "size": size, "unit": ENTRIES[id].unit}
    try:
        outcomes = [head.judged(diagnoser, rng, id, size).tolist() for _ in range(runs)]
    except InputError as error:
        print(f"head {number} is not diagnosed: {error}", flush=True)
        return result | {"error": str(error)}
    return result | {"promise": promised(of, id, size, 400).tolist(), "outcomes": outcomes}


def _hidden(of: EffectsOfPlan, id: str) -> bool:
    return bool(np.linalg.norm(of.shown(id)) < 0.05 * np.linalg.norm(of.signal(id)))


def _print_bins(results: Sequence[dict], seconds: float) -> None:
    """Mean promise and mean rate of each bin of promises."""
    diagnosed = [own for own in results if "promise" in own]
    if not diagnosed:
        return
    promises = np.array([own["promise"] for own in diagnosed])
    runs = len(diagnosed[0]["outcomes"])
    happened = np.array([np.mean(own["outcomes"], axis=0) for own in diagnosed])
    print(f"{len(promises)} heads, {runs} measurements each, {seconds:.0f} s", flush=True)
    for column, word in enumerate(("detected", "named", "identified")):
        parts = [f"all {100 * promises[:, column].mean():.1f} / {100 * happened[:, column].mean():.1f}"]
        for low, high in ((0.0, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 0.95), (0.95, 1.01)):
            own = (promises[:, column] >= low) & (promises[:, column] < high)
            if np.any(own):
                spread = 100 * np.sqrt(np.sum(promises[own, column] * (1 - promises[own, column])) / runs) / own.sum()
                parts.append(
                    f"{100 * promises[own, column].mean():.1f} / {100 * happened[own, column].mean():.1f} "
                    f"({own.sum()} heads, sd {spread:.1f})"
                )
        print(f"  {word}: promised / observed %: {'; '.join(parts)}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=("sd", "agreement", "loop"))
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--heads", type=int, default=200)
    parser.add_argument("--seed", type=int, default=48)
    parser.add_argument("--first", type=int, default=0, help="number of the first head")
    parser.add_argument("--out", type=Path, help="one JSON line for each head; heads that it has are not repeated")
    chosen = parser.parse_args()
    tumblecal.enable_float64()
    if chosen.part == "sd":
        standard_deviations(chosen.runs)
    elif chosen.part == "agreement":
        agreement(chosen.runs)
    else:
        closed_loop(chosen.heads, chosen.runs, chosen.seed, chosen.first, chosen.out)
