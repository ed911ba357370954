"""The results of a certificate: sensor parameters with expanded uncertainty, covariance and conformity, and words that its
page and its DCC share."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from tumblecal.certificate.admin import Admin
from tumblecal.certificate.judged import head_covariance, head_words, reservation
from tumblecal.data.budget_result import NAME, BudgetResult, read_budget
from tumblecal.data.calibration import Calibration, read_calibration
from tumblecal.data.coverage_factor import coverage_factors
from tumblecal.data.not_applied import losses_words
from tumblecal.data.position_comments import ATTITUDES, BY_HAND, UNKNOWN
from tumblecal.data.result_records import DIAGNOSIS, REMEDY, DiagnosisFile
from tumblecal.data.sensor_parameters import SENSOR, UNITS
from tumblecal.data.uncertainty_parts import PARTS
from tumblecal.ground.errors import InputError
from tumblecal.ground.strict_json import read_record


LEVEL = 0.95
RULE = (
    "Non-binary acceptance with a guard band of the expanded uncertainty U (ILAC-G8:09/2019): pass if |value| + U is "
    "within the limit; conditional pass if only |value| is; conditional fail if |value| is beyond it but |value| - U is "
    "not; otherwise fail"
)
SCOPE = "The results relate only to the item calibrated, and to the time and conditions of the calibration."
# From best to worst: names in a DCC, and in words.
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
class ResultTable:
    """The results at one temperature, their covariance (base units), and the calibration there.

    `temperature_degc`: None if the parameters do not follow temperature.
    """

    results: tuple[Result, ...]
    covariance: Float[np.ndarray, "n n"]
    calibration: Calibration
    temperature_degc: float | None = None

    @property
    def at(self) -> str:
        """The temperature in words: ` at 25 degC`; "" without one."""
        return "" if self.temperature_degc is None else f" at {self.temperature_degc:.4g} degC"


@dataclass(frozen=True)
class Results:
    """Content of a certificate: a table of results for each stated temperature, the calibration, and words on both.

    `budgeted`: whether uncertainties include the inputs of a budget, or only the noise of the data. `reservation`:
    reservations about the calibration; "" if there are none. `other_noise`: words on the noise of a budget that differs from
    that of the calibration; "" if it does not.
    """

    tables: tuple[ResultTable, ...]
    level: float
    calibration: Calibration
    outcome: str
    budgeted: bool
    reservation: str = ""
    other_noise: str = ""

    @property
    def conformity(self) -> str | None:
        """The worst verdict of all results with a limit."""
        given = [
            _RANKED.index(result.conformity) for table in self.tables for result in table.results if result.conformity
        ]
        return _RANKED[max(given)] if given else None

    @property
    def temperatures_degc(self) -> list[float]:
        """The temperatures of the tables; none if the parameters do not follow temperature."""
        return [table.temperature_degc for table in self.tables if table.temperature_degc is not None]

    @property
    def uncertainty_words(self) -> str:
        """The definition and the parts of the uncertainties."""
        head = head_covariance(self.calibration)
        more = ["the covariance of the measured errors of the head"] * head
        more += ["the contributions of other explanations and undetected effects"] * (
            PARTS in self.calibration.provenance
        )
        curves = self.calibration.temperature
        at_reference = "" if curves is None else f" (their contributions at {curves.reference_degc:.4g} degC)"
        more += [f"the inputs of the budget{at_reference}"] * self.budgeted
        if curves is not None and curves.hysteresis:
            more.append("half of the difference between rising and falling temperature, as a uniform distribution")
        sources = f"data and {' and '.join(more)}" if more else "data only (type A)"
        undetermined = ", ".join(self.calibration.sensor.of(SENSOR).undetermined)
        caveat = (
            f" The data do not determine {undetermined} separately: their U includes the assumed size of an effect that the "
            "data show only in part."
        )
        level = f" {self.noise_level}" if self.noise_level else ""
        corrected = self.calibration.use.expanded_words
        level += f" {corrected}, including effects that the data may have missed." if corrected else ""
        return (
            f"U is the standard uncertainty times the stated coverage factor k, for a coverage probability of about "
            f"{self.level:.4g}, evaluated according to JCGM 100 (GUM) from the noise of the {sources}.{level}"
        ) + (caveat if undetermined else "")

    @property
    def noise_level(self) -> str:
        """The noise level of the uncertainties, with its reason, in one or two sentences; "" for files that do not state it."""
        dof, contradicted = self.calibration.dof, self.calibration.provenance.get("stated_noise")
        if dof is None:
            return ""
        if math.isinf(dof):
            return "The noise level is the stated one."
        reason = f" {contradicted}." if isinstance(contradicted, str) else ""
        return f"The noise level is estimated from the residuals, with {dof:.4g} degrees of freedom.{reason}"


def method_words(admin: Admin, results: Results) -> str:
    """The method: as stated by the laboratory, otherwise a standard text; and the measured errors of the head."""
    by = {
        UNKNOWN: "Hand-held attitudes, unknown and estimated with the other parameters,",
        BY_HAND: "Attitudes set by hand, their tilts estimated with the other parameters,",
    }
    where = by.get(results.calibration.provenance.get(ATTITUDES, ""), "Positions of a dividing head")
    usual = f"{where} in the local gravity field; least squares over the chain of exact rotations"
    return "; ".join(filter(None, [admin.performance.method or usual, head_words(results.calibration)]))


def serial_number(admin: Admin, results: Results) -> str:
    """Serial number of the unit: as stated by the laboratory, otherwise by the data."""
    return admin.item.serial_number or results.calibration.serial_number or "not stated"


def results_of(
    folder: Path,
    budget: Path | None,
    limits: Mapping[str, float],
    *,
    use_anyway: bool = False,
    temperatures_degc: Sequence[float] = (),
) -> Results:
    """The results in a folder of calibrate or diagnose.

    **Arguments:**

    - `budget`: budget.json of the same data; None: that of `folder`, if any. `limits`: by parameter, base units.
    - `use_anyway`: whether to accept a calibration that must not be used.
    - `temperatures_degc`: of the tables; none: the reference temperature of parameters that follow temperature.

    **Raises:** `InputError` for a missing calibration, one that must not be used, a budget of different data, or temperatures
    at which the calibration was not measured.
    """
    path = folder / "calibration.json"
    calibration = read_calibration(path)
    reserved = reservation(folder, calibration, use_anyway=use_anyway)
    in_folder = folder / NAME
    budget = in_folder if budget is None and in_folder.exists() else budget
    used = None if budget is None else _of_same(budget, calibration)
    tables = tuple(
        _table(calibration if degc is None else calibration.at(degc), used, limits, degc)
        for degc in _temperatures(path, calibration, temperatures_degc)
    )
    if fixed := [result.name for result in tables[0].results if not result.expanded > 0]:
        raise InputError(
            f"{path}: no standard uncertainty of {', '.join(fixed)} (fixed, not measured), so they cannot be certified; repeat "
            "the calibration without --fix"
        )
    lacking = [f"{words[:1].upper()}{words[1:]}." for words in losses_words(calibration.not_applied)]
    outcome = " ".join([_outcome(folder, calibration), *lacking])
    level, other = (LEVEL, "") if used is None else (used.level, used.other_noise(calibration))
    return Results(tables, level, calibration, outcome, budget is not None, reserved, other)


def _temperatures(path: Path, calibration: Calibration, stated: Sequence[float]) -> Sequence[float | None]:
    """The temperatures of the tables; one None if the parameters do not follow temperature."""
    curves = calibration.temperature
    if curves is None:
        if stated:
            raise InputError(f"{path}: its parameters do not follow temperature; remove --temperatures")
        return [None]
    if np.any(beyond := curves.beyond(np.array(stated, float))):
        first = stated[int(np.argmax(beyond))]
        raise InputError(
            f"--temperatures: {first:g} degC is outside the measured {curves.range_words} of {path}; a certificate states "
            "values at measured temperatures only"
        )
    return stated or [curves.reference_degc]


def _table(
    calibration: Calibration, budget: BudgetResult | None, limits: Mapping[str, float], degc: float | None
) -> ResultTable:
    """The results of a calibration with its noise, and the inputs of a budget if there is one."""
    sensor = calibration.sensor.of(SENSOR)
    if budget is None:
        factors = coverage_factors(sensor.effective_dof, LEVEL)
    else:
        factors, sensor = budget.coverage(sensor, sensor.dof), budget.combined(sensor)
    results = tuple(
        Result(name, UNITS[name], float(value), float(k * sd), float(k), limits.get(name))
        for name, value, sd, k in zip(sensor.names, sensor.values, sensor.sd, factors, strict=True)
    )
    return ResultTable(results, sensor.covariance, calibration, degc)


def _outcome(folder: Path, calibration: Calibration) -> str:
    """The result for the model, in words: the verdict of a diagnosis, otherwise that of the fit."""
    path = folder / DIAGNOSIS
    if not path.exists():
        return "The nominal model was fitted; no diagnosis was made."
    diagnosis = read_record(path, DiagnosisFile, REMEDY)
    causes = ", ".join(diagnosis.causes)
    words = {
        "adequate": "The data are consistent with the nominal model.",
        "identified": f"In addition to the nominal model the data show {causes}; the fitted model includes it.",
        "ambiguous": f"In addition to the nominal model the data show {_explanations(calibration, causes)}.",
    }
    return words.get(diagnosis.verdict, "The data contradict the nominal model; the cause was not identified.")


def _explanations(calibration: Calibration, causes: str) -> str:
    """The possible causes that the data cannot distinguish, and those of the stated values."""
    averaged = calibration.provenance.get("averaged_over")
    if averaged is None:
        return f"{causes}, or an indistinguishable explanation; the values apply to the former"
    each = [" and ".join(member.get("causes") or ["no further effect"]) for member in averaged]
    listed = f"one of: {'; '.join(each)}"
    mean = "The values are the probability-weighted mean over these models, and the uncertainty includes their spread"
    return f"{listed}. {mean}"


def _of_same(path: Path, calibration: Calibration) -> BudgetResult:
    """The budget of a file.

    **Raises:** `InputError` for a budget of different data or of a different model, or with a missing parameter.
    """
    budget = read_budget(path)
    if not budget.is_of(calibration):
        raise InputError(
            f"{path}: its data differ from those of the calibration; run tumblecal budget for the same file"
        )
    if budget.lacks(calibration):
        raise InputError(
            f"{path}: a budget with --diagnosis, but the calibration is not from a diagnosis; give the folder of the "
            "diagnosis, or run tumblecal budget without --diagnosis"
        )
    if moved := budget.moved(calibration):
        raise InputError(
            f"{path}: its model differs from that of the calibration ({', '.join(moved)} differ); run tumblecal budget with "
            "the options of the calibration (--rig, --fix, --prior, --head)"
        )
    return budget
