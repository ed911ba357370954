"""The whole diagnosis of one data set: detect, identify, adapt, and say what cannot be said."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache

import jax
import numpy as np
from threadpoolctl import ThreadpoolController

from tumblecal.capture.position_samples import PositionSamples
from tumblecal.chain import Chain, Where
from tumblecal.data import PositionSet
from tumblecal.diagnosis import limits as say
from tumblecal.diagnosis import mixups, show
from tumblecal.diagnosis.adapt import Fit, Gain, gain
from tumblecal.diagnosis.candidates import Candidate
from tumblecal.diagnosis.explanations import UNEXPLAINED, Explanation
from tumblecal.diagnosis.joint_noise import most_probable, noise_change
from tumblecal.diagnosis.linear import Weighting, weighted
from tumblecal.diagnosis.model import Model, model_of
from tumblecal.diagnosis.nested import nested_left_out
from tumblecal.diagnosis.next_grid import Allowed
from tumblecal.diagnosis.next_positions import NextPlan, NextPosition, next_plan
from tumblecal.diagnosis.reference import References
from tumblecal.diagnosis.sample_noise import SampleNoise, sample_noises, with_samples
from tumblecal.diagnosis.screen import Measured, Screened, screen
from tumblecal.diagnosis.whitening import corrected, leftover
from tumblecal.effects import Catalogue, catalogue
from tumblecal.errors import InputError
from tumblecal.estimation.identifiability import identifiability
from tumblecal.estimation.problem import default_chain, problem_of, where_of


# From this probability on an explanation without equivalents is called identified.
SURE = 0.8
LEAST_DOF = 3
_MOST_REWEIGHTINGS = 3


@dataclass(frozen=True)
class Diagnosis:
    """Everything found about one data set.

    - `verdict`: adequate, identified, ambiguous or unexplained.
    - `mix_ups`: units and axes put right first. `noise_found`: what was wrong with the noise, by catalogue id, in
      words; the tests were made under the noise so corrected. `assumed_p_value`: of the test before that.
    - `screened`: test, explanations, visibility. `best`: the explanation acted on; `labels` its names with the mix-ups
      and the noise.
    - `nominal`, `extended`: exact fits before and after (the same where nothing was inserted).
    - `gain`, `limits`, `invisible`, `next_plan`, `harmonics`, `checks`: as in their own modules; `checks` of the
      nominal fit, `checks_after` of the extended one.
    - `samples`: the noise as the raw samples tell it, where there are any.
    """

    data: PositionSet
    where: Where
    model: Model
    how: Weighting
    entries: Catalogue
    verdict: str
    mix_ups: tuple[mixups.MixUp, ...]
    noise_found: dict[str, str]
    assumed_p_value: float
    screened: Screened
    best: Explanation
    members: tuple[Candidate, ...]
    nominal: Fit
    extended: Fit
    gain: Gain
    limits: dict[str, say.DetectionLimit]
    invisible: dict[str, say.Invisible]
    next_plan: NextPlan
    harmonics: list[show.Harmonic]
    checks: list[show.Check]
    checks_after: list[show.Check]
    samples: SampleNoise | None = None

    @property
    def noise_labels(self) -> tuple[str, ...]:
        """What was wrong with the noise: catalogue ids."""
        return tuple(self.noise_found)

    @property
    def noise_words(self) -> str:
        """The noise model the tests were made under, "" for the stated or equal white one."""
        return "; ".join(self.noise_found.values())

    @property
    def labels(self) -> tuple[str, ...]:
        """All causes named: mix-ups, noise, effects; positions after a colon."""
        mixed = tuple(dict.fromkeys(one.label for one in self.mix_ups))
        return (*mixed, *self.noise_labels, *(label for label in self.best.labels if label not in self.noise_labels))

    @property
    def next_positions(self) -> tuple[NextPosition, ...]:
        """The most useful positions to measure next, each for itself, best first."""
        return self.next_plan.singles

    @property
    def sigma_g(self) -> float:
        """Residual sd after the best explanation, g."""
        return float(self.extended.sigma / np.mean(self.how.weights))

    @property
    def chain(self) -> Chain:
        """The extended chain with its fitted values: nominal links and the winning ones."""
        from tumblecal.diagnosis.extended import extended_chain

        return extended_chain(self.model, self.extended, self.members)


@dataclass
class Diagnoser:
    """Diagnoses data sets; what they share (compiled model, references of plans) is made once.

    **Arguments:**

    - `entries`: the catalogue, with the user's effects if any.
    - `plan_next`: whether to propose next positions. `allowed`: angles and mountings that they may use.
    - `nested`: whether the choice of causes is repeated in every fold of the cross-validation (a second or more).
    """

    entries: Catalogue = field(default_factory=catalogue)
    plan_next: bool = True
    nested: bool = True
    allowed: Allowed = field(default_factory=Allowed)
    references: References = field(default_factory=References)
    _models: dict[tuple, Model] = field(default_factory=dict)

    def __call__(
        self,
        data: PositionSet,
        *,
        chain: Chain | None = None,
        noise_sd: float | None = None,
        priors: Mapping[str, tuple[float, float]] | None = None,
        holdout: tuple[str, str] | None = None,
        samples: PositionSamples | None = None,
    ) -> Diagnosis:
        """Diagnose one data set.

        **Arguments:**

        - `data`: positions. `chain`: the nominal model, the default one where left out.
        - `noise_sd`: sd of every reading, g; else the sd columns; else the noise counts as unknown.
        - `priors`: (mean, sd) by parameter name, base units.
        - `holdout`: column (`run`, `mount` or `position`) and value of the data kept out of the fit for the gain.
        - `samples`: raw samples of the positions; the noise is then theirs, in place of `noise_sd` and the sd columns.

        **Raises:** `InputError` for data that cannot be diagnosed.
        """
        # Matrices of a hundred rows: threads would only wait for each other.
        with _threads().limit(limits=1, user_api="blas"):
            return self._diagnosed(data, chain, noise_sd, priors, holdout, samples)

    def _diagnosed(
        self,
        data: PositionSet,
        chain: Chain | None,
        noise_sd: float | None,
        priors: Mapping[str, tuple[float, float]] | None,
        holdout: tuple[str, str] | None,
        samples: PositionSamples | None,
    ) -> Diagnosis:
        if len(data) < 3:
            raise InputError(f"{data.source}: {len(data)} positions are too few for any test; measure a whole plan")
        fold, kind = folds(data, holdout)
        where = where_of(data)
        model = self._model(chain, where, data)
        at_start = model.evaluate(where, model.start)
        readings, mixed = mixups.put_right(data.readings, at_start.predicted, data.names)
        noises = [] if samples is None else sample_noises(samples, data)
        stated = with_samples(data, noises[0]) if noises else data
        problem = problem_of(stated, model.nominal_chain, noise_sd=None if noises else noise_sd, priors=priors)
        how = Weighting(
            np.asarray(problem.weights),
            problem.noise == "stated",
            np.asarray(problem.prior_mean),
            np.asarray(problem.prior_weights),
        )
        _check(data, model, weighted(model, at_start, readings, how, model.start)[1][:, : model.nominal])
        measured = Measured(model, where, readings, data.names, how, how, self.references, at_start)
        noise = _sample_noise(measured, noises)
        if noise is not None:
            data, how = with_samples(data, noise), noise.weighting(how)
            measured = replace(measured, how=how, given=how)
        screened, how, noise_found, assumed_p = screen_with_noise(measured)
        best = screened.best
        members = tuple(screened.pool.candidates[k] for k in best.members)
        if best.noise:
            members = ()
        measured = replace(measured, how=how)
        before = measured.fit(screened.linear, [])
        after = (screened.fit or measured.fit(screened.linear, members)) if members else before
        nested = None
        if members and self.nested:
            nested = nested_left_out(screened.linear, screened.pool, how, fold, best.members)
        weights = {
            one.label: float(weight)
            for one, weight in zip(screened.pool.candidates, screened.pool.test_log_weights, strict=True)
            if one.family == "effect"
        }
        sigma = 1.0 if how.known else after.sigma
        found_limits = say.limits(model, screened.seen, self.entries, screened.detection, weights, how.known, sigma)
        proposed = NextPlan()
        if self.plan_next and not data.hand_held:
            proposed = next_plan(
                screened, members, after, model, where, readings, how, data, self.allowed, chain is not None
            )
        spread = sigma / how.weights
        checks = show.predictive(before, where, how)
        return Diagnosis(
            data=data,
            where=where,
            model=model,
            how=how,
            entries=self.entries,
            verdict=_verdict(screened, best, mixed, noise_found),
            mix_ups=tuple(mixed),
            noise_found=noise_found,
            assumed_p_value=assumed_p,
            screened=screened,
            best=best,
            members=members,
            nominal=before,
            extended=after,
            gain=gain(before, after, how, fold, kind, nested),
            limits=found_limits,
            invisible=say.invisible(model, screened.linear, screened.seen, self.entries, sigma),
            next_plan=proposed,
            harmonics=show.harmonics(where, before.residuals, spread),
            checks=checks,
            checks_after=checks if after is before else show.predictive(after, where, how),
            samples=noise,
        )

    def _model(self, given: Chain | None, where: Where, data: PositionSet) -> Model:
        key = (id(given), data.hand_held, *_where_key(where))
        if key not in self._models:
            self._models[key] = model_of(default_chain(data) if given is None else given, where, self.entries)
        return self._models[key].started(where)


def _check(data: PositionSet, model: Model, jacobian: np.ndarray) -> None:
    """Refuse designs that leave nominal parameters undetermined or nothing to test with."""
    chain = model.nominal_chain
    identifiability(jacobian, model.names, chain.scales).require_full_rank(data.source)
    dof = jacobian.shape[0] - jacobian.shape[1]
    if dof < LEAST_DOF:
        raise InputError(
            f"{data.source}: {len(data)} positions leave {dof} degrees of freedom beside {model.nominal} "
            f"parameters; a test needs at least {LEAST_DOF}: measure more positions"
        )


def _sample_noise(measured: Measured, noises: list[SampleNoise]) -> SampleNoise | None:
    """The one of the raw samples' noise models that goes best with the scatter of the positions, causes allowed."""
    chosen = noises[0] if noises else None
    for _ in noises:
        assert chosen is not None
        # The levels, too, tell them apart: all of them count as known here.
        now = replace(chosen.weighting(measured.how), known=True)
        screened = screen(replace(measured, how=now, given=now))
        listed = [one.alternative(screened.linear, now) for one in noises if one is not chosen]
        # Scatter that no samples show (a head that repeats less well) is no reason to take their noise for slow.
        best = most_probable(screened, [*listed, *screened.noise])
        if best is None or best.log_odds < chosen.log_weight or not any(best.alternative is one for one in listed):
            break
        chosen = next(one for one in noises if one.lasts == best.alternative.label)
    return chosen


def screen_with_noise(measured: Measured) -> tuple[Screened, Weighting, dict[str, str], float]:
    """Screen; where the noise model is wrong as well, correct the weights and screen again.

    **Returns:** the screen, its weights, what was wrong with the noise in words, first p-value.
    """
    screened = screen(measured)
    found, assumed_p = {}, screened.detection.p_value
    used: list[tuple[str, bool]] = []
    for _ in range(_MOST_REWEIGHTINGS):
        # Once the level is corrected, unequal axes may still be found.
        tried = tuple(label for label, known in used if known == measured.how.known)
        change = noise_change(screened, tried) if screened.detection.detected else None
        if change is None:
            break
        base = screened.search.base(change.members)
        label = change.alternative.label
        used.append((label, measured.how.known))
        how, said = corrected(measured.how, leftover(measured.how, screened.linear, base.z, base.q), change.alternative)
        found[label] = "; ".join([*([found[label]] if label in found else []), said])
        measured = replace(measured, how=how)
        screened = screen(measured)
    return screened, measured.how, found, assumed_p


@cache
def _threads() -> ThreadpoolController:
    return ThreadpoolController()


def diagnose(data: PositionSet, entries: Catalogue | None = None, **options) -> Diagnosis:
    """Diagnose one data set; options as of `Diagnoser.__call__`."""
    return Diagnoser(catalogue() if entries is None else entries)(data, **options)


def folds(data: PositionSet, holdout: tuple[str, str] | None) -> tuple[np.ndarray, str]:
    """The fold of each position (-1: always in the fit) and what is left out, in words.

    **Raises:** `InputError` for a column or value that the data lack.
    """
    if holdout is not None:
        column, value = holdout
        labels = {"run": data.run, "mount": data.mount, "position": data.names}.get(column)
        if labels is None:
            raise InputError(
                f"--holdout {column}={value}: {data.source} has no column {column}; use run, mount or position"
            )
        here = np.array([label == value for label in labels])
        if not np.any(here) or np.all(here):
            known = list(dict.fromkeys(labels))
            there = ", ".join([*known[:8], *(["..."] if len(known) > 8 else [])])
            raise InputError(f"--holdout {column}={value}: {data.source} has {column} {there}; name one of several")
        return np.where(here, 0, -1), f"{column} {value} left out"
    if len(data.runs) > 1 and data.run is not None:
        return np.array([data.runs.index(label) for label in data.run]), "leave one run out"
    return np.arange(len(data)), "leave one position out"


def _verdict(screened: Screened, best: Explanation, mixed: list[mixups.MixUp], noise: Mapping[str, str]) -> str:
    if not best.labels:
        return "identified" if mixed or noise else "adequate"
    if UNEXPLAINED in best.labels:
        return "unexplained"
    return "identified" if best.single_name and best.probability >= SURE else "ambiguous"


def _chain_key(chain: Chain | None) -> tuple | None:
    """What tells one given chain from another: links, names, values."""
    if chain is None:
        return None
    leaves, structure = jax.tree.flatten(chain)
    return structure, tuple(np.asarray(leaf).tobytes() for leaf in leaves)


def _where_key(where: Where) -> tuple:
    """What a model depends on: how many positions, which columns, which groups; not the columns' values."""
    present = tuple(getattr(where, name) is None for name in ("time_s", "temperature_degc", "approach"))
    return (len(np.asarray(where.alpha)), present, where.labels)
