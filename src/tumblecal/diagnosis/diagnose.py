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
from tumblecal.diagnosis.adapt import Fit
from tumblecal.diagnosis.candidates import Candidate
from tumblecal.diagnosis.explanations import UNEXPLAINED, Explanation
from tumblecal.diagnosis.gain import Gain, folds, gain
from tumblecal.diagnosis.linear import Weighting, weighted
from tumblecal.diagnosis.model import Model, model_of
from tumblecal.diagnosis.nested import nested_left_out
from tumblecal.diagnosis.next_grid import Allowed
from tumblecal.diagnosis.next_positions import NextPlan, NextPosition, next_plan
from tumblecal.diagnosis.reference import References
from tumblecal.diagnosis.sample_noise import SampleNoise, recorded_noises, sample_noises, with_samples
from tumblecal.diagnosis.screen import Measured, Screened
from tumblecal.diagnosis.screen_noise import chosen_sample_noise, screen_with_noise
from tumblecal.effects import Catalogue, catalogue
from tumblecal.errors import InputError
from tumblecal.estimation.identifiability import identifiability
from tumblecal.estimation.mountings import turned_mountings, turns_of
from tumblecal.estimation.problem import default_chain, problem_of, where_of


# From this probability on an explanation without equivalents is called identified.
SURE = 0.8
LEAST_DOF = 3


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
    - `samples`: the noise as the recording tells it, by its samples or its noise model, where there is either.
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
    def mountings(self) -> dict[str, tuple[float, float, float]]:
        """The quarter turn (deg about x, y, z) from which each mounting's dtheta counts, where any is turned."""
        return turns_of(self.model.nominal_chain, self.where)

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
        from_rig: bool = True,
    ) -> Diagnosis:
        """Diagnose one data set.

        **Arguments:**

        - `data`: positions. `chain`: the nominal model, the default one where left out.
        - `noise_sd`: sd of every reading, g; else the sd columns; else the noise counts as unknown.
        - `priors`: (mean, sd) by parameter name, base units.
        - `holdout`: column (`run`, `mount` or `position`) and value of the data kept out of the fit for the gain.
        - `samples`: raw samples of the positions; the noise is then theirs, in place of `noise_sd` and the sd columns.
        - `from_rig`: whether a given `chain` is a rig's own, not the default one with parameters fixed; a rig says what its
          parameters are indexed by, and next positions keep to that.

        **Raises:** `InputError` for data that cannot be diagnosed.
        """
        # Matrices of a hundred rows: threads would only wait for each other.
        with _threads().limit(limits=1, user_api="blas"):
            return self._diagnosed(data, chain, noise_sd, priors, holdout, samples, from_rig and chain is not None)

    def _diagnosed(
        self,
        data: PositionSet,
        chain: Chain | None,
        noise_sd: float | None,
        priors: Mapping[str, tuple[float, float]] | None,
        holdout: tuple[str, str] | None,
        samples: PositionSamples | None,
        from_rig: bool,
    ) -> Diagnosis:
        if len(data) < 3:
            raise InputError(f"{data.source}: {len(data)} positions are too few for any test; measure a whole plan")
        fold, kind = folds(data, holdout)
        noises = sample_noises(samples, data) if samples is not None else []
        if samples is None and noise_sd is None:
            noises = recorded_noises(data)
        where = where_of(data)
        model = self._model(chain, where, data)
        at_start = model.evaluate(where, model.start)
        readings, mixed = mixups.put_right(data.readings, at_start.predicted, data.names)
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
        noise = chosen_sample_noise(measured, noises)
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
            proposed = next_plan(screened, members, after, model, where, readings, how, data, self.allowed, from_rig)
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
        turns = turned_mountings(data) if given is None else {}
        key = (_chain_key(given), data.hand_held, tuple(turns.items()), *_where_key(where))
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


@cache
def _threads() -> ThreadpoolController:
    return ThreadpoolController()


def diagnose(data: PositionSet, entries: Catalogue | None = None, **options) -> Diagnosis:
    """Diagnose one data set; options as of `Diagnoser.__call__`."""
    return Diagnoser(catalogue() if entries is None else entries)(data, **options)


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
