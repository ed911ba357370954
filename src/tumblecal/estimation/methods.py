"""All estimators on one problem: what `tumblecal calibrate` runs."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from tumblecal.chain import Chain
from tumblecal.data import PositionSet
from tumblecal.data.calibration_use import Judgement, Use
from tumblecal.data.repeats import require_few_attitudes
from tumblecal.effects import Catalogue, catalogue
from tumblecal.estimation import exact, harmonic, kalman
from tumblecal.estimation.attitude_scatter import AttitudeScatter, fit_with_scatter
from tumblecal.estimation.between_position_sd import BetweenPositionSd, between_position_sd
from tumblecal.estimation.contradicted import ContradictedLevel, contradicted_level
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.kalman import Prior
from tumblecal.estimation.leave_out import Contradicted, contradicted
from tumblecal.estimation.plausibility import Implausible, implausible
from tumblecal.estimation.position_problem import problem_of
from tumblecal.estimation.priors import Priors
from tumblecal.estimation.problem import Problem
from tumblecal.estimation.setup.correction import correct_setup_errors
from tumblecal.estimation.setup.error import HARMLESS, SetupError
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head
from tumblecal.ground.pickled import Pickled
from tumblecal.ground.showing import Drawing, Screen, Shown, drawn_by, function_named
from tumblecal.ground.suggested_command import suggested


if TYPE_CHECKING:
    import polars as pl
    from matplotlib.figure import Figure

    from tumblecal.estimation.mean_noise import MeanNoise


# Residuals below this, g, are rounding of numbers typed with eight digits, not noise of a measurement.
_TYPED_G = 1e-8


@dataclass(frozen=True, repr=False)
class Calibrated(Pickled, Shown):
    """Fits by method (`exact` first), and the methods that do not apply with the reason.

    `implausible`: implausible parameters of the exact fit. `setup_errors`: corrected before the fit. `scatter`:
    of the attitudes, if tilts are in the fit. `floor`: dispersion between positions in addition to the sd columns, if any.
    `level`: the stated noise level, if the residuals contradict it. `noise`: of the recording of the means,
    if it is used. `entries`: the catalogue of the chain's effects.

    Examples:
        >>> import tumblecal
        >>> data = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
        >>> calibrated = tumblecal.calibrate(data, noise_sd=0.15e-3)
        >>> calibrated.table().columns
        ['parameter', 'value', 'sd', 'unit', 'harmonic', 'kalman']
        >>> calibrated.implausible, calibrated.setup_errors, calibrated.exact.chi2_p_value > 0.01
        ((), (), True)
    """

    fits: dict[str, Fit]
    skipped: dict[str, str]
    implausible: tuple[Implausible, ...] = ()
    setup_errors: tuple[SetupError, ...] = ()
    scatter: AttitudeScatter | None = None
    floor: BetweenPositionSd | None = None
    level: ContradictedLevel | None = None
    noise: "MeanNoise | None" = None
    entries: Catalogue = field(default_factory=catalogue)

    @property
    def exact(self) -> Fit:
        """The exact fit."""
        return self.fits["exact"]

    @cached_property
    def contradicted(self) -> tuple[Contradicted, ...]:
        """Outlier and exchanged positions of the exact fit."""
        return contradicted(self.exact)

    @cached_property
    def _judged(self) -> tuple[tuple[Judgement, ...], Use]:
        return function_named("lab.use.judged")(self)

    @property
    def judgements(self) -> tuple[Judgement, ...]:
        """Judgements on the exact fit, the most serious first; never empty."""
        return self._judged[0]

    @property
    def use(self) -> Use:
        """Whether the calibration may be used, and its uncertainty: the strictest of all judgements and limits."""
        return self._judged[1]

    plot_methods: ClassVar[Drawing] = drawn_by(
        "show.figures.calibration.methods_figure", "Each method minus the exact fit, in its standard uncertainty."
    )

    def plot_residuals(self) -> "Figure":
        """The exact fit's residuals."""
        return self.exact.plot_residuals()

    def table(self) -> "pl.DataFrame":
        """The parameters of the exact fit, as `Fit.table`, and the value by each other method (null if it has none)."""
        import polars as pl

        columns = []
        for name, fit in self.fits.items():
            if name != "exact":
                values = dict(
                    zip(*fit.table().select("parameter", "value").to_dict(as_series=False).values(), strict=True)
                )
                columns.append(pl.Series(name, [values.get(parameter) for parameter in self.exact.names], pl.Float64))
        return self.exact.table().with_columns(columns)

    def save(self, path: Path | str) -> None:
        """Write `calibration.json` of the exact fit, as `Fit.save`, with the permitted use."""
        function_named("lab.record.save_fit")(Path(path), self.exact, self.entries, self.use)

    def screen(self) -> Screen:
        """Permitted use with reasons, parameters, and the other methods."""
        return function_named("show.notebook.calibrated_screen")(self)


def calibrate(
    data: PositionSet,
    *,
    chain: Chain | None = None,
    noise_sd: float | None = None,
    priors: Priors | None = None,
    entries: Catalogue | None = None,
) -> Calibrated:
    """Calibrate positions by all methods, as the command does.

    **Arguments:** as of `problem_of`: `noise_sd` in g, `priors` in base units; `entries`: the catalogue with which a chain with
    user effects was made.

    **Raises:** `InputError` for set-up errors in readings or angles, and for positions that cannot determine the parameters.

    Examples:
        >>> import tumblecal
        >>> data = tumblecal.simulate(tumblecal.read_rig("paper24"), seed=1)
        >>> calibrated = tumblecal.calibrate(data, noise_sd=0.15e-3)
        >>> list(calibrated.fits)
        ['exact', 'harmonic', 'kalman']
        >>> fit = calibrated.exact
        >>> f"bias_z = {1e3 * fit.value('bias_z'):.2f} mg, u = {1e3 * fit.sd[fit.names.index('bias_z')]:.2f} mg"
        'bias_z = 0.81 mg, u = 0.05 mg'
    """
    entries = entries or catalogue()
    corrected, setup_errors = checked(data, chain, entries)
    problem = problem_of(corrected, chain, noise_sd=noise_sd, priors=priors)
    fitted = all_methods(problem, by_columns=noise_sd is None)
    return replace(fitted, setup_errors=tuple(setup_errors), entries=entries)


def checked(
    data: PositionSet, chain: Chain | None = None, entries: Catalogue | None = None
) -> tuple[PositionSet, list[SetupError]]:
    """The set with harmless set-up errors corrected, and these errors.

    **Arguments:**

    - `chain`: the model given for the data, None for the default one. `entries`: the catalogue, for advice.

    **Raises:** `InputError` for no positions, and for set-up errors in readings or angles: a calibration is for the columns as
    they are in the file.
    """
    if not len(data):
        raise InputError(f"{data.source}: no positions")
    require_few_attitudes(data)
    corrected, setup_errors = correct_setup_errors(data, chain)
    entries, diagnose = entries or catalogue(), suggested("diagnose", *data.as_arguments)
    faults = [
        f"{data.source}: {setup_error.description}. {entries[setup_error.label].advice} To correct it automatically, "
        f"run: {diagnose}"
        for setup_error in setup_errors
        if setup_error.label not in HARMLESS
    ]
    if faults:
        raise InputError(faults)
    return corrected, setup_errors


def require_noise(fit: Fit) -> None:
    """Reject data whose noise must be estimated from the residuals, if these show no noise: no degree of freedom, or
    computed data.

    **Raises:** `InputError`.
    """
    if fit.noise == "estimated" and fit.dof <= 0:
        raise InputError(
            f"{fit.data.source}: {fit.no_freedom_words}, and no noise is stated, so the uncertainties are unknown; measure "
            "more positions, state the noise (--noise-sd), or fix parameters at their nominal values (--fix)"
        )
    if fit.noise == "estimated" and fit.computed:
        raise InputError(
            f"{fit.data.source}: the readings follow the model to rounding ({fit.rms:.1g} g rms): computed, not measured? "
            "State the noise that they represent: --noise-sd 0.1mg"
        )


def require_measured(data: PositionSet) -> None:
    """Reject readings that equal those of a linear instrument at the commanded angles to rounding: they have no error
    to diagnose.

    **Raises:** `InputError`.
    """
    if len(data) <= 4 or data.hand_held:
        return
    design = np.column_stack([gravity_in_head(data.alpha, data.beta), np.ones(len(data))])
    residuals = data.readings - design @ np.linalg.lstsq(design, data.readings, rcond=None)[0]
    if np.sqrt(np.mean(residuals**2)) < _TYPED_G:
        raise InputError(f"{data.source}: the readings follow the angles to rounding: they were computed, not measured")


class ExactFit(NamedTuple):
    """The exact fit; the scatter of the attitudes and the floor that it includes, the stated noise level that it replaces, and
    the noise of the recording that it uses, if there are any."""

    fit: Fit
    scatter: AttitudeScatter | None = None
    floor: BetweenPositionSd | None = None
    level: ContradictedLevel | None = None
    noise: "MeanNoise | None" = None


def exact_fit(problem: Problem, *, by_columns: bool) -> ExactFit:
    """The exact fit with the noise level that the data support (`estimation.contradicted`).

    **Arguments:** as of `all_methods`.

    **Raises:** `InputError` as `all_methods`.
    """
    fitted = exact.fit(problem)
    require_noise(fitted)
    noise = None
    if fitted.problem.noise_of_recording:
        from tumblecal.estimation.mean_noise import likeliest_noise

        noise = likeliest_noise(fitted)
        fitted = fitted if noise is None else exact.fit(noise.applied(problem), fitted.values)
    fitted, scatter = fit_with_scatter(fitted) or (fitted, None)
    problem = fitted.problem
    floor = between_position_sd(fitted) if by_columns else None
    if floor is not None:
        return ExactFit(exact.fit(floor.applied(problem)), scatter, floor=floor, noise=noise)
    level = contradicted_level(fitted)
    return ExactFit(fitted if level is None else exact.fit(level.applied(problem)), scatter, level=level, noise=noise)


def all_methods(
    problem: Problem,
    *,
    usual: Mapping[str, float] | None = None,
    by_columns: bool = False,
) -> Calibrated:
    """Exact fit, harmonic least squares and Kalman filter of one problem.

    The filter needs the noise: stated, or otherwise as estimated by the exact fit.

    **Arguments:**

    - `problem`: from `problem_of`.
    - `usual`: as of `plausibility.implausible`.
    - `by_columns`: whether the noise is from sd columns, a lower bound: a floor may be added to it.

    **Raises:** `InputError` if the design cannot determine the chain's parameters, and as `require_noise`.
    """
    fitted, scatter, floor, level, noise = exact_fit(problem, by_columns=by_columns)
    problem = fitted.problem
    fits, skipped = {"exact": fitted}, {}
    least = float(np.min(problem.sd)) if problem.known else fitted.sigma
    if not problem.known and not fitted.sigma > 0:
        skipped["kalman"] = "as many readings as parameters: the noise cannot be estimated; give --noise-sd"
    elif not Prior().is_resolved(least):
        skipped["kalman"] = f"an sd of {least:.1g} g is too small compared with the prior of the filter for float64"
    try:
        fits["harmonic"] = harmonic.fit(problem.independent)
        if "kalman" not in skipped:
            fits["kalman"] = kalman.fit(problem.independent, sigma=fitted.sigma)
    except InputError as error:
        skipped |= dict.fromkeys(("harmonic", "kalman"), str(error))
    return Calibrated(fits, skipped, implausible(fitted, usual), scatter=scatter, floor=floor, level=level, noise=noise)
