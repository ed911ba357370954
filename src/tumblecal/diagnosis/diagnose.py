"""The whole diagnosis of one data set: detect, identify, adapt, and say what cannot be said."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tumblecal.capture.position_samples import PositionSamples
from tumblecal.chain import Chain
from tumblecal.data import PositionSet
from tumblecal.diagnosis import residuals
from tumblecal.diagnosis.causes import Cause
from tumblecal.diagnosis.classes import Explanation, verdict_of
from tumblecal.diagnosis.determined import require_determined, require_enough
from tumblecal.diagnosis.fold_search import chosen_anew
from tumblecal.diagnosis.full_model import FullModel, key_of, model_of, settings_key
from tumblecal.diagnosis.gain import Gain, folds, gain
from tumblecal.diagnosis.generic_causes import UNEXPLAINED
from tumblecal.diagnosis.insert import fit_with
from tumblecal.diagnosis.limits import DetectionLimit, Invisible, invisible, limits
from tumblecal.diagnosis.location import Located, located
from tumblecal.diagnosis.noise_change import NoiseFault, chosen_mean_noise, screen_with_noise
from tumblecal.diagnosis.reference import References
from tumblecal.diagnosis.screen import Screened, Screening
from tumblecal.diagnosis.tangent import robust_start, tangent, white_rows
from tumblecal.diagnosis.tuning import HAND_HELD_SIZE, RECORDED_SIZE, SIZE
from tumblecal.effects import Catalogue, catalogue
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.mean_noise import MeanNoise, recorded_noises, sample_noises
from tumblecal.estimation.mixups import MixUp, put_right
from tumblecal.estimation.mountings import turned_mountings, turns_of
from tumblecal.estimation.plausibility import Implausible, implausible
from tumblecal.estimation.priors import Priors
from tumblecal.estimation.problem import Problem, default_chain, problem_of, where_of
from tumblecal.ground.blas import one_thread
from tumblecal.ground.errors import InputError
from tumblecal.ground.showing import Screen, Shown, drawn_by, of_report


if TYPE_CHECKING:
    import polars as pl

# Kinds of plans whose compiled models are remembered.
_MOST_MODELS = 16


@dataclass(frozen=True, repr=False)
class Diagnosis(Shown):
    """What was made of one data set.

    - `verdict`: adequate, identified, ambiguous or unexplained.
    - `mix_ups`: what was mixed up in setting up, put right first. `implausible`: parameters that no instrument has.
    - `noise_wrong`: what was wrong with the noise, by id; the tests are under it. `assumed_p_value`: before that.
    - `screened`: test, explanations, visibility, and the problem as it was screened.
    - `nominal`, `extended`: exact fits before and after (the same where nothing was inserted).
    - `located`: effects that act in a part of the data alone.
    - `gain`, `limits`, `invisible`, `harmonics`, `checks`: as in their own modules; `checks_after` of the extended fit.
    - `samples`: the noise as the recording tells it, by its samples or its noise model, where there is either.
    - `from_rig`: whether the chain is a rig file's own, which says what its parameters are indexed by.
    """

    screened: Screened
    entries: Catalogue
    verdict: str
    mix_ups: tuple[MixUp, ...]
    implausible: tuple[Implausible, ...]
    noise_wrong: dict[str, NoiseFault]
    assumed_p_value: float
    nominal: Fit
    extended: Fit
    located: list[Located]
    gain: Gain
    limits: dict[str, DetectionLimit]
    invisible: dict[str, Invisible]
    harmonics: list[residuals.Harmonic]
    checks: list[residuals.Check]
    checks_after: list[residuals.Check]
    samples: MeanNoise | None
    from_rig: bool

    @property
    def problem(self) -> Problem:
        """The problem that was diagnosed: readings put right, noise corrected."""
        return self.screened.problem

    @property
    def data(self) -> PositionSet:
        """The position set, what was mixed up in it put right."""
        return self.problem.measured_data

    @property
    def model(self) -> FullModel:
        """The nominal chain with every testable effect."""
        return self.screened.at.model

    @property
    def best(self) -> Explanation:
        """The explanation acted on."""
        return self.screened.best

    @property
    def members(self) -> tuple[Cause, ...]:
        """Its causes."""
        return self.screened.members

    @property
    def noise_labels(self) -> tuple[str, ...]:
        """What was wrong with the noise: catalogue ids."""
        return tuple(self.noise_wrong)

    @property
    def noise_words(self) -> str:
        """The noise model the tests were made under, "" for the stated or equal white one."""
        return "; ".join(fault.words for fault in self.noise_wrong.values())

    @property
    def labels(self) -> tuple[str, ...]:
        """All causes named: mix-ups, noise, effects; positions after a colon."""
        mixed = tuple(dict.fromkeys(mix_up.label for mix_up in self.mix_ups))
        return (*mixed, *self.noise_labels, *(label for label in self.best.labels if label not in self.noise_labels))

    @property
    def mountings(self) -> dict[str, tuple[float, float, float]]:
        """The quarter turn (deg about x, y, z) from which each mounting's dtheta counts, where any is turned."""
        return turns_of(self.problem.chain, self.problem.where)

    @property
    def level(self) -> float:
        """Sd of the white rows: 1 where the noise is known, else as the best explanation leaves it."""
        return 1.0 if self.problem.known else self.extended.level

    @property
    def sigma_g(self) -> float:
        """Residual sd after the best explanation, g."""
        return float(self.extended.level / np.mean(1.0 / self.problem.sd))

    @property
    def chain(self) -> Chain:
        """The extended chain with its fitted values: nominal links and the winning ones."""
        return self.extended.chain

    plot_residuals = drawn_by("diagnosis_figures.angle_figure", "Residuals by spindle angle, before and after.")
    plot_columns = drawn_by("diagnosis_figures.column_figure", "The same by input, beta, time and temperature.")
    plot_harmonics = drawn_by("diagnosis_harmonics.harmonics_figure", "Harmonics of alpha in the residuals.")
    plot_explanations = drawn_by("diagnosis_figures.explanations_figure", "Probabilities of the explanations.")
    plot_predictive = drawn_by("diagnosis_predictive.predictive_figure", "The residuals beside simulated ones.")
    plot_limits = drawn_by("diagnosis_limits.limits_figure", "What each effect's size must be to be found.")

    def screen(self) -> Screen:
        """The verdict and its reasons."""
        return of_report("notebook.diagnosis_screen")(self)

    def table(self) -> "pl.DataFrame":
        """The explanations: `explanation`, its `probability`, that of it `alone`, and the `equivalents` (number)."""
        return of_report("notebook.explanations")(self)

    def save(self, path: Path | str) -> None:
        """Write the extended model's `calibration.json`; `InputError` where it has none."""
        of_report("notebook.save_extended")(Path(path), self)


class Begun(NamedTuple):
    """One data set screened; fields as in `Diagnosis`."""

    screened: Screened
    noise_wrong: dict[str, NoiseFault]
    assumed_p_value: float
    mix_ups: tuple[MixUp, ...]
    samples: MeanNoise | None


@dataclass
class Diagnoser:
    """Diagnoses data sets; what they share (compiled models, references of plans) is made once.

    **Arguments:**

    - `entries`: the catalogue, with the user's effects if any.
    - `nested`: whether the choice of causes is repeated in every fold of the cross-validation (a second or more).
    - `usual`: the largest usual sizes of parameters, where others than `estimation.plausibility.USUAL`; base units.
    """

    entries: Catalogue = field(default_factory=catalogue)
    nested: bool = True
    usual: Mapping[str, float] = field(default_factory=dict)
    references: References = field(default_factory=References)
    _models: dict[tuple, FullModel] = field(default_factory=dict)

    def __call__(
        self,
        data: PositionSet,
        *,
        chain: Chain | None = None,
        noise_sd: float | None = None,
        priors: Priors | None = None,
        holdout: tuple[str, str] | None = None,
        samples: PositionSamples | None = None,
        from_rig: bool = True,
    ) -> Diagnosis:
        """Diagnose one data set.

        **Arguments:**

        - `data`: positions. `chain`: the nominal model, the default one where left out.
        - `noise_sd`: sd of every reading, g; else the sd columns; else the noise counts as unknown.
        - `priors`: what is known of parameters.
        - `holdout`: column (`run`, `mount` or `position`) and value of the data kept out of the fit for the gain.
        - `samples`: raw samples of the positions; the noise is then theirs, in place of `noise_sd` and the sd columns.
        - `from_rig`: whether a given `chain` is a rig's own, not the default one with parameters fixed.

        **Raises:** `InputError` for data that cannot be diagnosed.
        """
        if len(data) < 3:
            raise InputError(f"{data.source}: {len(data)} positions are too few for any test; measure a whole plan")
        fold = folds(data, holdout)
        with one_thread():
            begun = self.begun(data, chain, noise_sd, priors, samples)
            return self._finished(begun, fold, from_rig and chain is not None)

    def begun(
        self,
        data: PositionSet,
        chain: Chain | None = None,
        noise_sd: float | None = None,
        priors: Priors | None = None,
        samples: PositionSamples | None = None,
    ) -> Begun:
        """One data set screened, nothing inserted yet; arguments and errors as of a call."""
        noises = sample_noises(samples, data) if samples is not None else []
        if samples is None and noise_sd is None:
            noises = recorded_noises(data)
        data, mixed = put_right(data, chain)
        stated, noise_sd = (replace(data, sd=noises[0].sd), None) if noises else (data, noise_sd)
        model = self._model(chain, stated, noise_sd, priors)
        problem = problem_of(stated, model.nominal_chain, noise_sd=noise_sd, priors=priors)
        problem = replace(problem.independent, data=data)
        at_start = model.evaluate(problem.where, model.start)
        require_determined(problem, white_rows(model, problem, model.start, at_start)[1][:, : model.nominal])
        size = RECORDED_SIZE if noises else HAND_HELD_SIZE if model.hand_held else SIZE

        def screening_of(given: Problem) -> Screening:
            return Screening(model, at_start, self.references.of(model, given), size)

        noise = screened = None
        if noises:
            at = tangent(model, problem, robust_start(model, problem, at_start))
            noise, screened = chosen_mean_noise(at, noises, screening_of)
            problem = noise.applied(problem)
        return Begun(*screen_with_noise(screening_of(problem), problem, screened), tuple(mixed), noise)

    def _finished(self, begun: Begun, fold: tuple[np.ndarray, str], from_rig: bool) -> Diagnosis:
        """The leading explanation inserted, its gain, and what the data cannot show."""
        screened = begun.screened
        before = fit_with(screened.at, [])
        after, nested = before, None
        if screened.members:
            after = screened.fit or fit_with(screened.at, screened.members)
            # Among the causes alone is chosen anew: what follows no more than a process is kept.
            nested = chosen_anew(screened, fold[0]) if self.nested and screened.best.members else None
        level, checks = 1.0 if screened.problem.known else after.level, residuals.predictive(before)
        unusual, elsewhere = implausible(after, self.usual), located(screened)
        doubtful = bool(elsewhere) or any(fault.rival == UNEXPLAINED for fault in begun.noise_wrong.values())
        return Diagnosis(
            screened=screened,
            entries=self.entries,
            verdict=verdict_of(screened.best, bool(begun.mix_ups or begun.noise_wrong), bool(unusual), doubtful),
            mix_ups=begun.mix_ups,
            implausible=unusual,
            noise_wrong=begun.noise_wrong,
            assumed_p_value=begun.assumed_p_value,
            nominal=before,
            extended=after,
            located=elsewhere,
            gain=gain(before, after, *fold, nested),
            limits=limits(screened, self.entries, level),
            invisible=invisible(screened, self.entries, level),
            harmonics=residuals.harmonics(before, level),
            checks=checks,
            checks_after=checks if after is before else residuals.predictive(after),
            samples=begun.samples,
            from_rig=from_rig,
        )

    def _model(self, given: Chain | None, data: PositionSet, sd: float | None, priors: Priors | None) -> FullModel:
        """The compiled model of data of this kind, started for these."""
        where, turns = where_of(data), turned_mountings(data) if given is None else {}
        key = (None if given is None else key_of(given), data.hand_held, tuple(turns.items()), *settings_key(where))
        if key not in self._models:
            while len(self._models) >= _MOST_MODELS:
                self._models.pop(next(iter(self._models)))
            require_enough(problem_of(data, given, noise_sd=sd, priors=priors))
            self._models[key] = model_of(default_chain(data) if given is None else given, where, self.entries)
        return self._models[key].started(where)


def diagnose(data: PositionSet, entries: Catalogue | None = None, **options) -> Diagnosis:
    """Diagnose one data set; options as of `Diagnoser.__call__`."""
    return Diagnoser(catalogue() if entries is None else entries)(data, **options)
