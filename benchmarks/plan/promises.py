"""Promises of a plan against simulations: the forecast that an effect is detected, named, identified.

Readings are simulated in plain numpy (`blind_instrument.py`), with random errors of the instrument, of settings, and of
settings that are set again.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import blind_instrument as blind
from blind.acting import direction
from command_line import print_head, print_row
from tumblecal.chain.rig import Rig
from tumblecal.chain.rig_file import rig_of
from tumblecal.data import PositionSet
from tumblecal.diagnosis import Diagnoser
from tumblecal.effects import catalogue
from tumblecal.effects.catalogue import links_and_units
from tumblecal.estimation.position_problem import where_of
from tumblecal.estimation.visits import with_repeatability
from tumblecal.ground.errors import InputError
from tumblecal.plan.cells import cells_of
from tumblecal.plan.criterion import of_parameters
from tumblecal.plan.effect_criteria import effects_of_cells, naming_term
from tumblecal.plan.exchange import Term, exchange
from tumblecal.plan.forecast.effects_of_plan import EffectsOfPlan, effects_of_plan
from tumblecal.plan.forecast.naming import Rates
from tumblecal.plan.information import one_visit
from tumblecal.plan.limits import Limits, schedule
from tumblecal.plan.planned_rig import planned_rig
from tumblecal.plan.responses import Responses, responses_of


ENTRIES = catalogue()
LINKS = links_and_units(ENTRIES)
WORDS = ("detected", "named", "identified")
PRIOR, AGAIN = "3 arcmin", {"repeatability": {"pitch": "3 arcsec"}}
POSITIONS = 24
# g, rad or rad/rad of one unit of the catalogue: mg/g^2, mg/g^3, mrad.
UNIT = 1e-3
# The catalogue of `loop`, without effects of time, settings and path: every head has its own programs to compile.
_KINDS = {"second", "third", "fifth", "cross", "scale", "bias_asymmetry", "base", "axis", "index", "spindle", "fixture"}
FEW = {
    id: effect
    for id, effect in ENTRIES.items()
    if effect.make is None or (not effect.needs and {id.partition("_")[0], id.partition(".")[0]} & _KINDS)
}
EFFECTS = [
    *(f"{kind}.{axis}" for kind in ("second_order", "third_order", "scale_asymmetry") for axis in "xyz"),
    *(f"cross_coupling.{axis}.{pair}" for axis in "xyz" for pair in ("xy", "xz", "yz")),
    *(f"cross_axis_square.{axis}" for axis in "xyz"),
    *("axis_perpendicularity", "index_eccentricity", "index_ellipticity", "spindle_wobble_1", "spindle_wobble_2"),
]
TURNS = {"A": (0, 0, 0), "B": (0, 0, 90), "C": (0, 90, 0)}


def head(
    step_deg: float,
    beta_deg: Sequence[float],
    turns: dict[str, Sequence[float]],
    *extensions,
    sd_mg: float = 0.15,
    prior: str = "",
    **ability: object,
) -> Rig:
    """A head with a step of its spindle, pitch settings and orientations of its mountings (Rx Ry Rz, deg).

    `prior`: of the pitch errors. `ability`: further tables of [head]. `extensions`: links and units of effects.
    """
    alpha = {"start": 0, "step": step_deg, "count": round(360 / step_deg)}
    table = {
        "schema": "tumblecal.rig/1",
        "plan": {"alpha_deg": alpha, "beta_deg": list(beta_deg), "mounts": list(turns)},
        "chain": {"leaves": {"dbeta": {"by": "mount.pitch"}, "dtheta": {"by": "mount"}}},
        "mounts": {name: {"rotation_deg": list(turn)} for name, turn in turns.items()},
        "noise": {"sd": f"{sd_mg} mg"},
        "head": {"alpha_deg": alpha, "beta_deg": list(beta_deg), **ability},
    }
    return rig_of(table | ({"priors": {"dbeta": prior}} if prior else {}), Path("rig.toml"), *extensions)


def rig_with(step: float, beta_deg, mounts: str, **options) -> Rig:
    """A head with some of the mountings of `TURNS`."""
    return head(step, beta_deg, {name: TURNS[name] for name in mounts}, *LINKS, **options)


class Head:
    """A rig with a schedule of some of its cells, and diagnoses of simulated data."""

    def __init__(self, rig: Rig, responses: Responses, taken: np.ndarray):
        assert rig.ability is not None
        self.responses, self.schedule = responses, schedule(responses.cells, taken, rig.ability.times)
        names = tuple(f"p{k}" for k in range(len(taken)))
        self.rig = planned_rig(rig, responses, self.schedule, rig.ability, names)
        self.prior = None if "dbeta" not in rig.priors else rig.priors["dbeta"][1]
        self.again = rig.ability.repeatability.pitch or 0.0
        self.chain = self.rig.chain(self.rig.where)
        self.priors = with_repeatability(self.rig.priors, rig.ability.repeatability, self.chain, self.rig.where)

    def setup(self, rng: np.random.Generator) -> blind.Setup:
        """The measurement of a random instrument."""
        plan, visit = self.rig.plan, self.schedule.pitch_visit
        cells = self.responses.cells.chosen(self.schedule.cells)
        labels = sorted(set(plan.mounts))
        mounting = np.array([labels.index(label) for label in plan.mounts])
        # With a repeatability a pitch setting has the same error in every mounting, and an addition at each visit.
        settings = cells.pitch + (0 if self.again else 100) * mounting
        first = np.unique(visit, return_index=True)[1]
        of_setting = {
            int(own): rng.normal(0, self.prior) if self.prior else rng.uniform(-3e-3, 3e-3)
            for own in np.unique(settings)
        }
        errors = np.array([of_setting[int(settings[k])] for k in first]) + self.again * rng.standard_normal(len(first))
        mounts = [np.radians(1.0) * rng.uniform() ** (1 / 3) * direction(rng) for _ in labels]
        nominal = {name: rng.normal(0, size, 3) for name, size in (("dK", 3e-3), ("bias", 3e-3), ("gamma", 1e-3))}
        return blind.Setup(
            alpha=np.radians(cells.alpha_deg),
            beta=np.radians(cells.beta_deg),
            time_s=np.asarray(plan.time_s),
            temperature_degc=np.full(len(plan), 25.0),
            approach=np.ones(len(plan)),
            pitch=visit,
            nominal=nominal | {"dtheta": np.concatenate(mounts), "dbeta": np.tile(errors, len(labels))},
            names=list(plan.names),
            mounting=mounting,
            turns=Rotation.from_euler("XYZ", [-np.radians(self.rig.mounts[label]) for label in labels]).as_matrix(),
        )

    def data(self, rng: np.random.Generator, setup: blind.Setup, effects: dict[str, np.ndarray]) -> PositionSet:
        """Its readings."""
        plan = self.rig.plan
        return PositionSet(
            names=plan.names,
            alpha_deg=np.asarray(plan.alpha_deg, float),
            beta_deg=np.asarray(plan.beta_deg, float),
            readings=blind.readings(setup, setup.nominal, effects)
            + self.rig.noise_sd_g * rng.standard_normal((len(plan), 3)),
            mount=plan.mounts if len(set(plan.mounts)) > 1 else None,
            time_s=np.asarray(plan.time_s),
            source="simulated",
        )

    def judged(self, diagnoser: Diagnoser, rng: np.random.Generator, id: str, size: float) -> list[float]:
        """Whether an effect is detected, named, identified in one simulated measurement."""
        count = (blind.COEFFICIENTS | blind.RARE)[id]
        data = self.data(rng, self.setup(rng), {id: np.full(count, size * UNIT)})
        found = diagnoser(data, chain=self.chain, noise_sd=self.rig.noise_sd_g, priors=self.priors)
        best, detected = found.best, bool(found.labels)
        named = {label for labels in (best.labels, *best.equivalents) for label in labels}
        right = best.labels == (id,) or (id,) in best.identical
        return [float(own) for own in (detected, detected and id in named, right and found.verdict == "identified")]


class OfModel(Diagnoser):
    """A diagnoser of one plan, whose model exists."""

    def __init__(self, of: EffectsOfPlan):
        super().__init__(of.entries, nested=False)
        self._of = of

    def _model(self, given, data, problem):
        return self._of.model.started(where_of(data, given))


def promised(of: EffectsOfPlan, id: str, size: float, draws: int) -> list[float]:
    """The forecast of a plan for an effect of a size."""
    return list(Rates(of, id, np.random.default_rng(0).standard_normal((draws, of.pool.dof)))(size))


def random_head(rng: np.random.Generator) -> Head:
    """A random head with a plan for it, by the worst uncertainty or by naming."""
    while True:
        beta = np.sort(rng.choice(np.arange(0, 91, 15), size=rng.integers(3, 6), replace=False)).tolist()
        mounts = str(rng.choice(["A", "AB", "AC"]))
        rig = rig_with(
            float(rng.choice([15.0, 30.0, 45.0])),
            beta,
            mounts,
            sd_mg=float(np.round(np.exp(rng.uniform(np.log(0.05), np.log(0.3))), 3)),
            prior=PRIOR if rng.integers(2) else "",
            **(AGAIN if rng.uniform() < 0.3 else {}),
        )
        responses = responses_of(rig, cells_of(rig.ability))
        try:
            if rng.integers(2):
                term = Term(((one_visit(responses), of_parameters("largest", responses)),))
            else:
                wanted = str(rng.choice(["second_order.y", "third_order.z", "cross_coupling.z.xz"]))
                effects = effects_of_cells(rig, responses.cells, FEW, 3600.0)
                term = naming_term(effects, responses, np.zeros(0, int), {wanted: 0.5})
            limits = Limits(responses.cells, rig.ability.times, np.ones(len(responses.cells), bool), POSITIONS)
            chosen = exchange(limits, [term], restarts=1)
            return Head(rig, responses, np.array(chosen.cells))
        except InputError:
            continue


def closed_loop(heads: int, runs: int, seed: int) -> None:
    """Promised against observed rates on random heads (plan, simulation, diagnosis), by bins of the promise."""
    promises, observed = [], []
    for number in range(heads):
        rng = np.random.default_rng([seed, number])
        own = random_head(rng)
        of = effects_of_plan(own.rig, FEW)
        shown = [id for id in EFFECTS if len(of.causes(id))]
        shown = [id for id in shown if np.linalg.norm(of.shown(id)) >= 0.05 * np.linalg.norm(of.signal(id))]
        id = shown[rng.integers(len(shown))]
        size = rng.uniform(4.0, 11.0) / float(np.linalg.norm(of.shown(id)))
        try:
            rates = np.mean([own.judged(OfModel(of), rng, id, size) for _ in range(runs)], axis=0)
        except InputError as error:
            print(f"head {number} is not diagnosed: {error}", flush=True)
            continue
        promises.append(promised(of, id, size, 400))
        observed.append(rates)
    promise, rate = np.array(promises), np.array(observed)
    print_head("", "heads", "promised", "observed", "standard error")
    for column, word in enumerate(WORDS):
        for low, high in ((0.0, 1.01), (0.0, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 0.95), (0.95, 1.01)):
            here = (promise[:, column] >= low) & (promise[:, column] < high)
            if np.any(here):
                p = promise[here, column]
                error = np.sqrt(np.sum(p * (1 - p)) / runs) / len(p)
                shares = (f"{own:.1%}" for own in (p.mean(), rate[here, column].mean(), error))
                print_row(f"{word}, promised {low:.0%} to {min(high, 1):.0%}", len(p), *shares)
