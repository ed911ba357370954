"""The results of a certificate: the sensor's parameters with expanded uncertainty and covariance, their conformity, and the
words that its page and its DCC share."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from tumblecal.certificate.admin import Admin
from tumblecal.certificate.judged import head_covariance, head_words, reservation
from tumblecal.data.budget_result import NAME, BudgetResult, read_budget
from tumblecal.data.calibration import Calibration, read_calibration
from tumblecal.data.coverage_factor import coverage_factors
from tumblecal.data.noise_dof import with_dof_beside
from tumblecal.data.not_applied import losses_words
from tumblecal.data.positions import ATTITUDES, UNKNOWN
from tumblecal.data.sensor_parameters import GROUPS, SENSOR, leaf_of
from tumblecal.data.uncertainty_parts import PARTS
from tumblecal.ground.errors import InputError
from tumblecal.ground.json_file import read_json_object


LEVEL = 0.95
RULE = (
    "Non-binary acceptance with a guard band of the expanded uncertainty U (ILAC-G8:09/2019): pass where |value| + U is "
    "within the limit; conditional pass where only |value| is; conditional fail where |value| is beyond it but |value| - U "
    "is not; else fail"
)
SCOPE = "The results relate only to the item calibrated and hold for the time and conditions of the calibration."
# From best to worst: as a DCC names them, and in words.
VERDICTS = {
    "pass": "pass",
    "conditionalPass": "conditional pass",
    "conditionalFail": "conditional fail",
    "fail": "fail",
}
_RANKED = tuple(VERDICTS)


@dataclass(frozen=True)
class Result:
    """One parameter: value, expanded uncertainty, limit (None: no limit) in base units, and coverage factor."""

    name: str
    unit: str
    value: float
    expanded: float
    k: float
    limit: float | None = None

    @property
    def conformity(self) -> str | None:
        """One of `VERDICTS`."""
        if self.limit is None:
            return None
        size = abs(self.value)
        within = (size + self.expanded <= self.limit, size <= self.limit, size - self.expanded <= self.limit)
        return _RANKED[within.index(True) if any(within) else 3]


@dataclass(frozen=True)
class Results:
    """What is certified: results, their covariance (base units), the calibration itself, and words on both.

    `budgeted`: whether uncertainties hold a budget's inputs; else the noise of the data alone. `reservation`: what speaks
    against the calibration; "" where nothing does. `other_noise`: in words how the budget's noise differs from the
    calibration's, "" where it does not.
    """

    results: tuple[Result, ...]
    covariance: Float[np.ndarray, "n n"]
    level: float
    calibration: Calibration
    outcome: str
    budgeted: bool
    reservation: str = ""
    other_noise: str = ""

    @property
    def conformity(self) -> str | None:
        """The worst verdict of all that have a limit."""
        given = [_RANKED.index(result.conformity) for result in self.results if result.conformity]
        return _RANKED[max(given)] if given else None

    @property
    def uncertainty_words(self) -> str:
        """What the uncertainties are."""
        head = head_covariance(self.calibration)
        more = ["the covariance of the head's measured errors"] * head
        more += ["the contributions of other explanations and undetected effects"] * (
            PARTS in self.calibration.provenance
        )
        more += ["the inputs of the budget"] * self.budgeted
        held = f"data and {' and '.join(more)}" if more else "data alone (type A)"
        undetermined = ", ".join(self.calibration.sensor.of(SENSOR).undetermined)
        left = (
            f" The data do not determine {undetermined} by themselves: their U holds what is assumed of an effect beside them, "
            "of which the data show a part."
        )
        level = f" {self.noise_level}" if self.noise_level else ""
        return (
            f"U is the standard uncertainty times the coverage factor k stated beside it, for a coverage probability of about "
            f"{self.level:.4g}, evaluated according to JCGM 100 (GUM) from the noise of the {held}.{level}"
        ) + (left if undetermined else "")

    @property
    def noise_level(self) -> str:
        """Which noise level the uncertainties use, and why, in a sentence or two; "" for files that do not state it."""
        dof, contradicted = self.calibration.dof, self.calibration.provenance.get("stated_noise")
        if dof is None:
            return ""
        if math.isinf(dof):
            return "The noise level is the stated one."
        reason = f" {contradicted}." if isinstance(contradicted, str) else ""
        return f"The noise level is estimated from the residuals, with {dof:.4g} degrees of freedom.{reason}"


def method_words(admin: Admin, results: Results) -> str:
    """How it was calibrated, as the laboratory states it, else as the data were taken; and what was known of the head."""
    unknown = results.calibration.provenance.get(ATTITUDES) == UNKNOWN
    where = "Attitudes by hand, not known and estimated with the rest," if unknown else "Positions of a dividing head"
    usual = f"{where} in the local gravity field; least squares over the chain of exact rotations"
    return "; ".join(filter(None, [admin.performance.method or usual, head_words(results.calibration)]))


def serial_number(admin: Admin, results: Results) -> str:
    """The unit's, as the laboratory states it, else as the data do."""
    return admin.item.serial_number or results.calibration.serial_number or "not stated"


def results_of(folder: Path, budget: Path | None, limits: Mapping[str, float], *, use_anyway: bool = False) -> Results:
    """The results in a folder of calibrate or diagnose.

    **Arguments:**

    - `budget`: budget.json of the same data; where None, `folder`'s own if it has one. `limits`: by parameter, base units.
    - `use_anyway`: certify a calibration that must not be used by its own judgement.

    **Raises:** `InputError` where there is no calibration, or one not to be used, or the budget is of other data.
    """
    path = folder / "calibration.json"
    calibration = with_dof_beside(path, read_calibration(path))
    reserved = reservation(folder, calibration, use_anyway=use_anyway)
    sensor, level, other = calibration.sensor.of(SENSOR), LEVEL, ""
    factors = coverage_factors(np.full(len(SENSOR), sensor.dof), level)
    own = folder / NAME
    budget = own if budget is None and own.exists() else budget
    if budget is not None:
        taken = _of_same(budget, calibration)
        factors, level, other = taken.coverage(sensor, sensor.dof), taken.level, taken.other_noise(calibration)
        sensor = taken.combined(sensor)
    results = tuple(
        Result(name, GROUPS[leaf_of(name)][1], float(value), float(k * sd), float(k), limits.get(name))
        for name, value, sd, k in zip(sensor.names, sensor.values, sensor.sd, factors, strict=True)
    )
    lacking = [f"{words[:1].upper()}{words[1:]}." for words in losses_words(calibration.not_applied)]
    outcome = " ".join([_outcome(folder, calibration), *lacking])
    return Results(results, sensor.covariance, level, calibration, outcome, budget is not None, reserved, other)


def _outcome(folder: Path, calibration: Calibration) -> str:
    """What was found of the model, in words: a diagnosis' verdict, else that of the fit."""
    path = folder / "diagnosis.json"
    if not path.exists():
        return "The nominal model was fitted; no diagnosis was made."
    content = read_json_object(path)
    causes = ", ".join(map(str, content.get("causes") or []))
    said = {
        "adequate": "The data do not contradict the nominal model.",
        "identified": f"Beside the nominal model the data show: {causes}; it is in the fitted model.",
        "ambiguous": f"Beside the nominal model the data show {_explanations(calibration, causes)}.",
    }
    return said.get(str(content.get("verdict")), "The data contradict the nominal model; the cause was not identified.")


def _explanations(calibration: Calibration, causes: str) -> str:
    """What may be the cause, where the data cannot tell, and for which of it the values hold."""
    averaged = calibration.provenance.get("averaged_over")
    if not isinstance(averaged, list):
        return f"{causes}, or what they cannot tell from it; the values hold for the former"
    each = [" and ".join(map(str, own.get("causes") or ["nothing else"])) for own in averaged if isinstance(own, dict)]
    listed = f"one of: {'; '.join(each)}"
    return f"{listed}. The values are the mean over these, by their probabilities, and the uncertainty has their spread in it"


def _of_same(path: Path, calibration: Calibration) -> BudgetResult:
    """The budget of a file.

    **Raises:** `InputError` for a budget of other data or of another model, or one that lacks a parameter.
    """
    budget = read_budget(path)
    if not budget.is_of(calibration):
        raise InputError(f"{path}: a budget of other data than the calibration; make one of the same file")
    if budget.lacks(calibration):
        raise InputError(
            f"{path}: a budget made with --diagnosis, but the calibration is of no diagnosis; give the folder of the "
            "diagnosis, or make the budget without --diagnosis"
        )
    if moved := budget.moved(calibration):
        raise InputError(
            f"{path}: a budget of another model than the calibration ({', '.join(moved)} differ); make one with the "
            "calibration's options (--rig, --fix, --prior, --head)"
        )
    return budget
