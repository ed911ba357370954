"""The diagnosis of one data set: set-up errors corrected, noise and causes screened, the leading explanation inserted."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tumblecal.chain import Chain, Forward
from tumblecal.chain.head_ability import HeadAbility
from tumblecal.data import PositionSet
from tumblecal.diagnosis.diagnosis import Diagnosis
from tumblecal.diagnosis.findings.determined import contradicted_priors, require_determined, require_enough
from tumblecal.diagnosis.findings.gain import folds
from tumblecal.diagnosis.findings.location import located
from tumblecal.diagnosis.noise.rounding import with_rounding
from tumblecal.diagnosis.priors import HAND_HELD_SIZE, RECORDED_SIZE, SIZE
from tumblecal.diagnosis.refine.insert import fit_with
from tumblecal.diagnosis.screening.noise_change import NoiseFault, chosen_mean_noise, screen_with_noise
from tumblecal.diagnosis.screening.screen import Screening
from tumblecal.diagnosis.screening.screened import Screened
from tumblecal.diagnosis.screening.slips import Credence, of_angles
from tumblecal.diagnosis.screening.tilts import fit_with_tilts, tilt_faults
from tumblecal.diagnosis.sets.explanation import all_labels, verdict_of
from tumblecal.effects import Catalogue, Effect, catalogue
from tumblecal.effects.catalogue import with_effects
from tumblecal.estimation.attitude_scatter import AttitudeScatter
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.mean_noise import MeanNoise, recorded_noises, sample_noises
from tumblecal.estimation.mountings import turned_mountings
from tumblecal.estimation.plausibility import Implausible, implausible
from tumblecal.estimation.position_problem import problem_of, where_of
from tumblecal.estimation.priors import Priors
from tumblecal.estimation.problem import Problem
from tumblecal.estimation.setup.correction import correct_setup_errors
from tumblecal.estimation.setup.error import SetupError, undone_by_fit
from tumblecal.estimation.slow_noise import with_slow_noise
from tumblecal.full_model.full_model import FullModel, model_of, settings_key
from tumblecal.full_model.layout import key_of
from tumblecal.full_model.tangent import robust_start, tangent, white_rows
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted
from tumblecal.ground.precision import single_blas_thread


if TYPE_CHECKING:
    from tumblecal.recordings.dwells.dwell_samples import DwellSamples

# Kinds of plans whose compiled models are kept; one needs 60 to 100 MB.
_MOST_MODELS = 8


class Begun(NamedTuple):
    """The screen of one data set; fields as in `Diagnosis`. `contradicted`: stated parameters (priors) that the data
    contradict, without which the screen was made."""

    screened: Screened
    noise_wrong: dict[str, NoiseFault]
    assumed_p_value: float
    setup_errors: tuple[SetupError, ...]
    samples: MeanNoise | None
    extended: Fit
    contradicted: tuple[Implausible, ...] = ()

    @property
    def labels(self) -> tuple[str, ...]:
        """Ids of all named causes; positions after a colon."""
        return all_labels((error.label for error in self.setup_errors), self.noise_wrong, self.screened.best)

    @property
    def adequate(self) -> bool:
        """Whether nothing is wrong: no cause is named, and no parameter is larger than usual."""
        return not (self.labels or self.contradicted or implausible(self.extended))


def _extended(screened: Screened) -> Fit:
    """The exact fit of the leading explanation."""
    fit = screened.fit if screened.members else None
    return fit or fit_with(screened.at, screened.members)


@dataclass
class Diagnoser:
    """Diagnoses data sets. Compiled models are made once and reused.

    **Arguments:**

    - `entries`: the catalogue, with the user's effects if any.
    - `nested`: whether the selection of causes is repeated in every fold of the cross-validation (a second or more).
    - `usual`: largest usual sizes of parameters, base units, for those that differ from `estimation.plausibility.USUAL`.

    Examples:
        >>> import tumblecal
        >>> from tumblecal.diagnosis import Diagnoser
        >>> rig, diagnoser = tumblecal.read_rig("hidden_effect"), Diagnoser(nested=False)
        >>> files = [tumblecal.simulate(rig, seed=seed, noise_sd=0.1e-3) for seed in (4, 5)]
        >>> [diagnoser(data, noise_sd=0.1e-3).verdict for data in files]
        ['ambiguous', 'ambiguous']
    """

    entries: Catalogue = field(default_factory=catalogue)
    nested: bool = True
    usual: Mapping[str, float] = field(default_factory=dict)
    _models: dict[tuple, FullModel] = field(default_factory=dict)

    def __post_init__(self) -> None:
        with_effects((), self.entries)

    def __call__(
        self,
        data: PositionSet,
        *,
        chain: Chain | None = None,
        noise_sd: float | None = None,
        priors: Priors | None = None,
        holdout: tuple[str, str] | None = None,
        samples: "DwellSamples | None" = None,
        ability: HeadAbility | None = None,
        from_rig: bool = True,
    ) -> Diagnosis:
        """Diagnose one data set.

        **Arguments:**

        - `data`: positions; readings (positions, 3) in g. `chain`: nominal model; if omitted, the default one.
        - `noise_sd`: standard deviation of every reading, g. If omitted, the sd columns are used; without them, the noise is
          estimated.
        - `priors`: Gaussian priors of parameters.
        - `holdout`: column (`run`, `mount` or `position`) and value of the held-out data.
        - `samples`: raw samples of the positions. Their noise replaces `noise_sd` and the sd columns.
        - `ability`: of the head, as `rig.ability` states it: its slow noise is added to `noise_sd` or the sd columns. Its
          repeatability is a part of `priors` (`estimation.visits.with_repeatability`).
        - `from_rig`: whether `chain` comes from a rig file, and is not the default chain with fixed parameters.

        **Raises:** `InputError` for data that cannot be diagnosed: too few positions, set-up errors with several possible
        corrections, parameters that are not determined.
        """
        if len(data) < 3:
            few = f"{counted(len(data), 'position')} {'is' if len(data) == 1 else 'are'}"
            raise InputError(f"{data.source}: {few} too few for any test; measure a whole plan")
        fold = folds(data, holdout)
        with single_blas_thread():
            begun = self.begun(data, chain, noise_sd, priors, samples, ability)
            return self._finished(begun, fold, from_rig and chain is not None)

    def begun(
        self,
        data: PositionSet,
        chain: Chain | None = None,
        noise_sd: float | None = None,
        priors: Priors | None = None,
        samples: "DwellSamples | None" = None,
        ability: HeadAbility | None = None,
    ) -> Begun:
        """Screen one data set and insert its leading explanation; arguments and errors as for a call."""
        noises = sample_noises(samples, data) if samples is not None else []
        if samples is None and noise_sd is None:
            noises = recorded_noises(data)
        users_model = chain is not None and any(isinstance(link, Forward) for link in chain.links)
        mended, mixed = (data, []) if users_model else correct_setup_errors(data, chain)
        begun = self._begun(mended, mixed, chain, noise_sd, priors, noises, ability)
        slips = of_angles(mixed)
        if not slips or begun.extended.computed:
            return begun
        told = data.weighing_sd
        sd = np.ones(data.readings.shape) if told is None or noise_sd is not None else told
        credence = self._credence(begun, data, sd, len(slips))
        verdict = verdict_of(begun.screened.best, False, credence.usual < 0.0, False)
        if verdict in ("adequate", "identified") and credence.usual == 0.0 and not begun.noise_wrong:
            return begun
        # An effect on whole pitch settings may resemble an error of the angles.
        as_written = replace(mended, alpha_deg=data.alpha_deg, beta_deg=data.beta_deg)
        others = [slip for slip in mixed if slip not in slips]
        try:
            written = self._begun(as_written, others, chain, noise_sd, priors, noises, ability)
        except InputError:
            return begun
        return written if self._credence(written, data, sd, len(of_angles(others))) > credence else begun

    def _credence(self, begun: Begun, written: PositionSet, sd: np.ndarray, slips: int) -> Credence:
        """Score of one interpretation of the angles, with so many corrected errors."""
        fit = begun.extended
        credence = Credence.of(begun.screened, fit, sd, implausible(fit, self.usual), slips)
        return credence._replace(usual=-np.inf) if slips and undone_by_fit(written, fit) else credence

    def _begun(
        self,
        data: PositionSet,
        mixed: Sequence[SetupError],
        chain: Chain | None,
        noise_sd: float | None,
        priors: Priors | None,
        noises: list[MeanNoise],
        ability: HeadAbility | None,
    ) -> Begun:
        """`begun` for corrected data."""
        stated, noise_sd = (replace(data, sd=noises[0].sd), None) if noises else (data, noise_sd)
        model = self._model(chain, stated, lambda: problem_of(stated, chain, noise_sd=noise_sd, priors=priors))
        problem = problem_of(stated, model.nominal_chain, noise_sd=noise_sd, priors=priors)
        problem, rounded = replace(problem.independent, data=data), dict[str, str]()
        if problem.known and not noises:
            problem, rounded = with_rounding(problem)
            problem = with_slow_noise(problem, ability)
        require_determined(problem, white_rows(model, problem, model.start, model.at_start(problem.where))[1])
        size = RECORDED_SIZE if noises else HAND_HELD_SIZE if model.hand_held else SIZE

        screening = Screening(model, size, found=len(mixed), usual=self.usual)
        noise = screened = None
        if noises:
            at = tangent(model, problem, robust_start(model, problem))
            noise, screened = chosen_mean_noise(at, noises, screening)
            problem = noise.applied(problem)
        screened, noise_wrong, assumed_p_value = screen_with_noise(screening, problem, screened)
        if contradicted := contradicted_priors(screened):
            problem = problem.without_priors({stated.parameter for stated in contradicted})
            screened, noise_wrong, _ = screen_with_noise(screening, problem)
        extended = _extended(screened)
        if noise_wrong and extended.computed:
            standing = replace(screening, noise_stands=True)
            screened, noise_wrong, assumed_p_value = screen_with_noise(standing, problem)
            extended = _extended(screened)
        noise_wrong = {label: NoiseFault(words, "") for label, words in rounded.items()} | noise_wrong
        begun = Begun(screened, noise_wrong, assumed_p_value, tuple(mixed), noise, extended, contradicted)
        tilted = fit_with_tilts(model, problem, screened, noise_wrong, extended)
        return begun if tilted is None else self._with_tilts(begun, *tilted)

    def _with_tilts(self, begun: Begun, fit: Fit, scatter: AttitudeScatter) -> Begun:
        """The screen with a tilt of each position, around their fit."""
        model = self._model(fit.problem.chain, fit.data, lambda: fit.problem)
        problem = replace(fit.problem, chain=model.nominal_chain)
        screening = Screening(model, HAND_HELD_SIZE, found=len(begun.setup_errors) + 1, usual=self.usual)
        # A tilt acts in second order too: around the fit, not around a start with the Jacobian of the nominal angles.
        first = screening.around(model.with_nominal(fit.values), problem)
        screened, noise_wrong, _ = screen_with_noise(screening, problem, screening(problem, first))
        faults = tilt_faults(scatter) | noise_wrong
        return begun._replace(screened=screened, noise_wrong=faults, extended=_extended(screened))

    def _finished(self, begun: Begun, fold: tuple[np.ndarray, str], from_rig: bool) -> Diagnosis:
        """The verdict and its basis."""
        screened = begun.screened
        unusual = (*begun.contradicted, *implausible(begun.extended, self.usual))
        elsewhere = located(screened)
        doubtful = bool(elsewhere) or any(fault.doubtful for fault in begun.noise_wrong.values())
        verdict = verdict_of(screened.best, bool(begun.setup_errors or begun.noise_wrong), bool(unusual), doubtful)
        return Diagnosis(
            screened=screened,
            entries=self.entries,
            verdict="unexplained" if screened.contradicted else verdict,
            setup_errors=begun.setup_errors,
            implausible=unusual,
            noise_wrong=begun.noise_wrong,
            assumed_p_value=begun.assumed_p_value,
            extended=begun.extended,
            located=elsewhere,
            samples=begun.samples,
            from_rig=from_rig,
            fold=fold,
            nested=self.nested,
        )

    def _model(self, given: Chain | None, data: PositionSet, made: Callable[[], Problem]) -> FullModel:
        """The compiled model of data of this kind, started for these; `made`: gives their problem if there is no model yet."""
        where, turns = where_of(data, given), turned_mountings(data) if given is None else {}
        key = (None if given is None else key_of(given), data.hand_held, tuple(turns.items()), *settings_key(where))
        if key not in self._models:
            while len(self._models) >= _MOST_MODELS:
                self._models.pop(next(iter(self._models)))
            problem = made()
            require_enough(problem)
            self._models[key] = model_of(problem.chain, where, self.entries)
        return self._models[key].started(where)


def diagnose(
    data: PositionSet,
    effects: Iterable[Effect] = (),
    *,
    entries: Catalogue | None = None,
    chain: Chain | None = None,
    noise_sd: float | None = None,
    priors: Priors | None = None,
    holdout: tuple[str, str] | None = None,
    samples: "DwellSamples | None" = None,
    ability: HeadAbility | None = None,
) -> Diagnosis:
    """Diagnose one data set.

    **Arguments:**

    - `data`: positions, for example from `read_positions`.
    - `effects`: further effects to test, in addition to the catalogue. `entries`: another catalogue in its place.
    - the others as of `Diagnoser.__call__`.

    **Raises:** `InputError` for data that cannot be diagnosed, or an effect with the id of another one.

    Examples:
        >>> import tumblecal
        >>> data = tumblecal.simulate(tumblecal.read_rig("hidden_effect"), seed=4, noise_sd=0.1e-3)
        >>> diagnosis = tumblecal.diagnose(data, noise_sd=0.1e-3)
        >>> diagnosis.verdict, diagnosis.labels
        ('ambiguous', ('bias_drift.x', 'second_order.z'))
    """
    diagnoser = Diagnoser(with_effects(effects, entries))
    return diagnoser(
        data, chain=chain, noise_sd=noise_sd, priors=priors, holdout=holdout, samples=samples, ability=ability
    )
