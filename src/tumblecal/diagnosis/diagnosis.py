"""The result of a diagnosis: verdict, evidence and consequences."""

from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from jaxtyping import Int

from tumblecal.chain import Chain
from tumblecal.data import PositionSet
from tumblecal.data.calibration import Calibration
from tumblecal.diagnosis.causes.cause import UNEXPLAINED, Cause
from tumblecal.diagnosis.findings import residuals
from tumblecal.diagnosis.findings.determined import Combination, combinations
from tumblecal.diagnosis.findings.factors import Factor, factors
from tumblecal.diagnosis.findings.gain import Gain, chosen_anew, gain, testable_folds
from tumblecal.diagnosis.findings.in_use import in_use
from tumblecal.diagnosis.findings.limits import DetectionLimit, Invisible, Unseen, invisible, limits, unseen
from tumblecal.diagnosis.findings.location import Located
from tumblecal.diagnosis.findings.model_average import Average
from tumblecal.diagnosis.findings.unexplained import Unnamed, unnamed
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.diagnosis.screening.noise_change import NoiseFault
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.sets.explanation import Explanation, all_labels
from tumblecal.effects import Catalogue
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.mean_noise import MeanNoise
from tumblecal.estimation.mountings import turns_of
from tumblecal.estimation.plausibility import Implausible
from tumblecal.estimation.problem import Problem
from tumblecal.estimation.setup.error import SetupError
from tumblecal.full_model.effect_directions import EffectDirections, effect_directions
from tumblecal.full_model.full_model import FullModel
from tumblecal.ground.pickled import Pickled
from tumblecal.ground.precision import single_blas_thread
from tumblecal.ground.showing import Drawing, Screen, Shown, drawn_by, function_named
from tumblecal.ground.units import shown


if TYPE_CHECKING:
    import polars as pl


@dataclass(frozen=True)
class Shift:
    """Change of a parameter in `unit` as shown, and in standard uncertainties of the calibration file (`in_sd`);
    `determined`: whether the data determine the parameter."""

    shift: float
    unit: str
    in_sd: float
    determined: bool


@dataclass(frozen=True, repr=False)
class Diagnosis(Pickled, Shown):
    """The result of a diagnosis.

    - `verdict`: adequate, identified, ambiguous or unexplained.
    - `setup_errors`: set-up errors, corrected first. `implausible`: parameters beyond the usual range.
    - `noise_wrong`: faults of the assumed noise, by id; the tests use the corrected noise. `assumed_p_value`: p-value under
      the assumed noise.
    - `screened`: test, explanations, visibility, and the problem as it was screened.
    - `extended`: exact fit with the named causes; equal to `nominal` if no cause was inserted.
    - `located`: effects that act in a part of the data only.
    - `samples`: noise estimated from the recording, by its samples or its noise model; None without these.
    - `from_rig`: whether the chain comes from a rig file, which states the columns that index its parameters.
    - `fold`: fold of each position (positions,) in the cross-validation (-1: always in the fit), and the kind of folds in
      words.
    - `nested`: whether the selection of causes is repeated in every fold.

    Quantities that only a report needs are computed at first access.

    Examples:
        >>> import tumblecal
        >>> data = tumblecal.simulate(tumblecal.read_rig("hidden_effect"), seed=4, noise_sd=0.1e-3)
        >>> diagnosis = tumblecal.diagnose(data, noise_sd=0.1e-3)
        >>> diagnosis.table()["probability"][0] == diagnosis.best.probability
        True
        >>> diagnosis.extended.rms < diagnosis.nominal.rms
        True
    """

    screened: Screened
    entries: Catalogue
    verdict: str
    setup_errors: tuple[SetupError, ...]
    implausible: tuple[Implausible, ...]
    noise_wrong: dict[str, NoiseFault]
    assumed_p_value: float
    extended: Fit
    located: list[Located]
    samples: MeanNoise | None
    from_rig: bool
    fold: tuple[Int[np.ndarray, " positions"], str]
    nested: bool

    @cached_property
    def nominal(self) -> Fit:
        """Exact fit of the nominal model."""
        return fit_with(self.screened.at, []) if self.members else self.extended

    @cached_property
    def gain(self) -> Gain:
        """Improvement of the extended model for held-out data."""
        groups, kind = testable_folds(self.extended, *self.fold)
        with single_blas_thread():
            # The selection is repeated among causes only; processes (lack of fit) remain.
            anew = self.nested and self.members and self.best.members
            errors = chosen_anew(self.screened, groups) if anew else None
            return gain(self.nominal, self.extended, groups, kind, errors)

    @cached_property
    def limits(self) -> dict[str, DetectionLimit]:
        """Detection limit of each effect: the smallest size that these data would show."""
        return limits(self.screened, self.entries, self.level)

    @cached_property
    def invisible(self) -> dict[str, Invisible]:
        """Undetectable effects (absorbed by the nominal model), and their influence on the parameters."""
        return invisible(self.screened, self.entries, self.level)

    @cached_property
    def directions(self) -> EffectDirections:
        """The directions of the coefficients of all effects, of typical size."""
        return effect_directions(
            self.screened.at, self.screened.seen.groups, self.entries, [cause.slot for cause in self.members]
        )

    @cached_property
    def unseen(self) -> dict[str, Unseen]:
        """Uncertainty of each parameter if undetected effects are present at their typical sizes."""
        return unseen(self.screened, self.directions, self.extended, self.level)

    @cached_property
    def in_use(self) -> Average:
        """Parameters of `calibration.json`, with their covariance."""
        return in_use(self.screened, self.entries, self.directions, self.extended, self.level, self.verdict)

    @cached_property
    def calibration(self) -> Calibration | None:
        """Contents of `calibration.json`; None if no calibration is written."""
        return function_named("lab.diagnosed.extended_calibration")(self)

    @cached_property
    def unnamed(self) -> Unnamed | None:
        """Location of an unexplained error, and its candidate law; None for other verdicts and for unknown attitudes."""
        if self.verdict != "unexplained" or self.model.hand_held or not self.screened.detection.detected:
            return None
        named = [] if self.screened.contradicted else [cause for cause in self.members if cause.named]
        with single_blas_thread():
            return unnamed(self.screened.at, fit_with(self.screened.at, named) if named else self.nominal)

    @cached_property
    def determined(self) -> dict[str, list[Combination]]:
        """Determined combinations of the coefficients of each cause, by its label."""
        return {cause.label: combinations(self.extended, cause, self.model.scales) for cause in self.members}

    @cached_property
    def factors(self) -> tuple[Factor, ...]:
        """The best explanation with its equivalents as a product: one factor for each finding."""
        return factors(self.best, self.entries, self.data)

    @cached_property
    def harmonics(self) -> list[residuals.Harmonic]:
        """Harmonics of the spindle angle in the residuals of the nominal model."""
        return residuals.harmonics(self.nominal, self.level)

    @cached_property
    def checks(self) -> list[residuals.Check]:
        """Residual statistics of the nominal model, compared with those expected for a correct model."""
        return residuals.predictive(self.nominal)

    @cached_property
    def checks_after(self) -> list[residuals.Check]:
        """Residual statistics of the extended model."""
        return self.checks if self.extended is self.nominal else residuals.predictive(self.extended)

    @property
    def problem(self) -> Problem:
        """The diagnosed problem: set-up errors and noise corrected."""
        return self.screened.problem

    @property
    def data(self) -> PositionSet:
        """The position set, with set-up errors corrected."""
        return self.problem.measured_data

    @property
    def model(self) -> FullModel:
        """The nominal chain with every testable effect."""
        return self.screened.at.model

    @cached_property
    def best(self) -> Explanation:
        """The leading explanation."""
        return self.screened.best

    @cached_property
    def members(self) -> tuple[Cause, ...]:
        """Causes of the leading explanation."""
        return self.screened.members

    @cached_property
    def shifts(self) -> dict[str, Shift]:
        """Change of each nominal parameter from the nominal fit to the calibration file."""
        used, nominal, undetermined = self.in_use, self.nominal, self.extended.undetermined
        listed = {}
        for k, name in enumerate(nominal.names):
            if self.model.layout.of_positions[k]:
                continue
            unit, scale = shown(nominal.units[k])
            change, idle = float(used.values[k] - nominal.values[k]), bool(used.idle[k])
            in_sd = 0.0 if idle else change / float(used.sd[k])
            listed[name] = Shift(change * scale, unit, in_sd, name not in undetermined and not idle)
        return listed

    @property
    def unexplained_terms(self) -> list[str]:
        """The variables that each unexplained part depends on, in words: of a generic term, or of the lack-of-fit test."""
        terms = [member.words for member in self.members if member.label == UNEXPLAINED]
        return [self.screened.unexplained_by_repeats] if self.best.unexplained and not terms else terms

    def leading(self, least: float, most: int) -> list[Explanation]:
        """Explanations more probable than `least`, and the one acted on; the first `most` of them."""
        listed = (one for one in self.screened.explanations if one.more_probable_than(least) or one is self.best)
        return list(islice(listed, most))

    @property
    def noise_labels(self) -> tuple[str, ...]:
        """Faults of the assumed noise: catalogue ids."""
        return tuple(self.noise_wrong)

    @property
    def noise_words(self) -> str:
        """Noise model of the tests, in words; "" for the stated or equal white one."""
        return "; ".join(fault.words for fault in self.noise_wrong.values())

    @property
    def labels(self) -> tuple[str, ...]:
        """Ids of all named causes: set-up errors, noise, effects; positions after a colon."""
        return all_labels((error.label for error in self.setup_errors), self.noise_wrong, self.best)

    @cached_property
    def mountings(self) -> dict[str, tuple[float, float, float]]:
        """Quarter turn (deg about x, y, z) from which dtheta of each mounting counts; empty if none is rotated."""
        return turns_of(self.problem.chain, self.problem.where)

    @property
    def level(self) -> float:
        """Standard deviation of the white rows: 1 for known noise, otherwise estimated from the residuals of the best
        explanation."""
        return 1.0 if self.problem.known else self.extended.level

    @property
    def sigma_g(self) -> float:
        """Residual standard deviation after the best explanation, g."""
        return float(self.extended.level / np.mean(1.0 / self.problem.sd))

    @property
    def chain(self) -> Chain:
        """The extended chain with its fitted values: nominal links and those of the leading explanation."""
        return self.extended.chain

    plot_residuals: ClassVar[Drawing] = drawn_by(
        "show.figures.diagnosis.angle_figure", "Residuals by spindle angle, before and after."
    )
    plot_columns: ClassVar[Drawing] = drawn_by(
        "show.figures.diagnosis.column_figure", "The same by input, beta, time and temperature."
    )
    plot_harmonics: ClassVar[Drawing] = drawn_by(
        "show.figures.diagnosis.harmonics_figure", "Harmonics of alpha in the residuals."
    )
    plot_explanations: ClassVar[Drawing] = drawn_by(
        "show.figures.diagnosis.explanations_figure", "Probabilities of the explanations."
    )
    plot_predictive: ClassVar[Drawing] = drawn_by(
        "show.figures.evidence.predictive_figure", "The residuals, with simulated ones."
    )
    plot_limits: ClassVar[Drawing] = drawn_by("show.figures.evidence.limits_figure", "Detection limit of each effect.")

    def screen(self) -> Screen:
        """The verdict and its reasons."""
        return function_named("show.notebook.diagnosis_screen")(self)

    def table(self) -> "pl.DataFrame":
        """The explanations: `explanation`, its `probability`, that of the explanation `alone`, and the number of
        `equivalents`."""
        return function_named("show.notebook.explanations")(self)

    def save(self, path: Path | str) -> None:
        """Write `calibration.json` of the extended model. Raises `InputError` if it has none."""
        function_named("lab.diagnosed.save_extended")(Path(path), self)
