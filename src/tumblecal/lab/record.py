"""`result.json` and `calibration.json` of a calibration."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator

from tumblecal.chain import followings_of
from tumblecal.data.calibration import Calibration, write_calibration
from tumblecal.data.calibration_file import GravityOrNone
from tumblecal.data.calibration_use import Use
from tumblecal.data.source_of import SourceRecord
from tumblecal.effects import Catalogue, catalogue
from tumblecal.estimation.attitude_scatter import AttitudeScatter
from tumblecal.estimation.contradicted import ContradictedLevel
from tumblecal.estimation.curves_of_fit import reported
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.identifiability import Direction
from tumblecal.estimation.intrinsic import Intrinsic, intrinsic, one_sensor
from tumblecal.estimation.linear_calibration import linear_calibration
from tumblecal.estimation.methods import Calibrated
from tumblecal.estimation.mountings import Mountings, turns_of
from tumblecal.estimation.plausibility import Implausible, implausible
from tumblecal.estimation.setup.error import SetupErrorRecord
from tumblecal.ground.errors import InputError
from tumblecal.ground.record import LEFT_OUT, Estimate, Estimates, ResultRecord, at, estimates, rows
from tumblecal.lab.terms import terms_of_chain


# Pairs of parameters whose correlation is above this are listed.
STRONG_CORRELATION = 0.9


class MethodParameter(Estimate):
    """A parameter of a fit, with its interval at a coverage probability of 0.95."""

    interval_95: tuple[float, float]


class MethodRecord(ResultRecord):
    """`Fit`."""

    parameters: Annotated[
        dict[str, MethodParameter], BeforeValidator(lambda fit: estimates(fit, interval_95=fit.interval(0.95)))
    ] = at("result")
    covariance: list[list[float]]
    code: str = at("code.name")
    message: str
    sigma_g: float = at("sigma")
    dof: int
    statistics: dict[str, float]


class ModelRecord(ResultRecord):
    """The chain of a fit."""

    links: Annotated[list[str], BeforeValidator(lambda links: [type(link).__name__ for link in links])] = at(
        "chain.links"
    )
    parameters: list[str] = at("names")
    mountings: Annotated[Mountings, BeforeValidator(lambda at: turns_of(at.chain, at.where))] = at("problem")


class NoiseRecord(ResultRecord):
    """The noise of a calibration."""

    sigma_g: float = at("exact.sigma")
    kind: str = at("exact.noise")
    chi2: float | None = at("exact.stated_chi2")
    dof: int = at("exact.dof")
    chi2_p_value: float | None = at("exact.chi2_p_value")
    contradicted_level: ContradictedLevel | None = at("level")
    attitude_scatter: AttitudeScatter | None = at("scatter")
    floor_g: float | None = at("floor.floor_g", None)
    rms_g: float = at("exact.rms")


class ResidualRecord(ResultRecord):
    """Residuals of a position, g."""

    position: str
    alpha_deg: float
    beta_deg: float
    x_g: float
    y_g: float
    z_g: float


def _residuals(fit: Fit) -> list[dict[str, Any]]:
    data, (x, y, z) = fit.data, fit.residuals.T
    return rows(position=data.names, alpha_deg=data.alpha_deg, beta_deg=data.beta_deg, x_g=x, y_g=y, z_g=z)


class Correlation(ResultRecord):
    """A pair of parameters."""

    first: str
    second: str
    correlation: float


def strong_correlations(fit: Fit) -> list[Correlation]:
    """Pairs of parameters correlated above 0.9, the strongest first."""
    correlation, shared = fit.correlation, fit.shared
    pairs = [
        Correlation(first=fit.names[i], second=fit.names[j], correlation=correlation[i, j])
        for number, i in enumerate(shared)
        for j in shared[number + 1 :]
        if abs(correlation[i, j]) > STRONG_CORRELATION
    ]
    return sorted(pairs, key=lambda pair: -abs(pair.correlation))


class IdentifiabilityRecord(ResultRecord):
    """`Identifiability` of a fit."""

    rank: int = at("identifiability.rank")
    free: int = at("identifiability.free")
    singular_values: list[float] = at("identifiability.singular_values")
    weak: list[Direction] = at("identifiability.weak")
    correlations: Annotated[list[Correlation], BeforeValidator(strong_correlations)] = at("result")


class TemperatureRecord(ResultRecord):
    """The physical coefficients of the parameters that follow temperature."""

    reference_degc: float
    range_degc: tuple[float, float]
    coefficients: dict[str, Estimate]


def _temperature(fit: Fit) -> TemperatureRecord | None:
    followings = followings_of(fit.problem.chain)
    if not followings:
        return None
    coefficients = {name: one for name, one in estimates(reported(fit)).items() if name not in fit.names}
    return TemperatureRecord.of(followings[0].functions, coefficients=coefficients)


def _intrinsic(fit: Fit) -> Intrinsic | None:
    return intrinsic(fit) if one_sensor(fit) else None


class JudgementRecord(ResultRecord):
    """`Judgement`."""

    tone: str
    headline: str
    advice: str
    refused: bool
    use: Use


class CalibratedRecord(ResultRecord):
    """`result.json`: a `Calibrated`."""

    schema_: Literal["tumblecal.result/1"] = "tumblecal.result/1"
    source: SourceRecord = at("exact.data")
    gravity: GravityOrNone = at("exact.data.gravity")
    model: ModelRecord = at("exact")
    methods: dict[str, MethodRecord] = at("fits")
    skipped: dict[str, str]
    set_up: list[SetupErrorRecord] = at("setup_errors")
    implausible: list[Implausible]
    judgement: JudgementRecord = at("judgements.0")
    judgements: list[JudgementRecord]
    use: Use
    noise: NoiseRecord = at("result")
    residuals: Annotated[list[ResidualRecord], BeforeValidator(_residuals)] = at("exact")
    identifiability: IdentifiabilityRecord = at("exact")
    intrinsic: Annotated[Estimates, BeforeValidator(_intrinsic)] = at("exact")
    temperature: Annotated[TemperatureRecord | None, BeforeValidator(_temperature), LEFT_OUT] = at("exact")


def write_calibrated(folder: Path, calibrated: Calibrated, stated: Mapping[str, Any] | None = None) -> list[str]:
    """Write `result.json` into `folder`, and `calibration.json` of an exact fit that converged.

    `stated`: further entries of its provenance, such as that of the head (`MeasuredHead.record`).

    **Returns:** their names.
    """
    CalibratedRecord.of(calibrated).write(folder / "result.json")
    level, scatter, floor = calibrated.level, calibrated.scatter, calibrated.floor
    if (calibration := written_calibration(calibrated)) is None:
        return ["result.json"]
    noise = {
        "stated_noise": level and level.words,
        "attitude_scatter_rad": scatter and scatter.tilt_rad,
        "between_position_sd_g": floor and floor.floor_g,
    }
    provenance = {key: entry for key, entry in noise.items() if entry is not None} | dict(stated or {})
    calibration = replace(calibration, provenance=calibration.provenance | provenance)
    write_calibration(folder / "calibration.json", calibration)
    return ["result.json", "calibration.json"]


def written_calibration(calibrated: Calibrated) -> Calibration | None:
    """The calibration that is written; None if the exact fit did not converge, or is of more or less than one sensor."""
    exact = calibrated.exact
    if not exact.code.good or not one_sensor(exact):
        return None
    return replace(calibration_of(exact, calibrated.entries), use=calibrated.use)


def save_fit(path: Path, fit: Fit, entries: Catalogue | None = None, use: Use | None = None) -> None:
    """Write a fit's `calibration.json`; `entries`: as of `calibration_of`; `use`: by default judged from this fit alone.

    **Raises:** `InputError` for a fit that did not converge, or of more or less than one sensor.
    """
    if not fit.code.good or not one_sensor(fit):
        why = fit.message if not fit.code.good else "dK, bias and gamma are not one for all data, or all are fixed"
        raise InputError(f"{fit.data.source}: no calibration to save: {why}")
    use = use or Calibrated({"exact": fit}, {}, implausible(fit)).use
    write_calibration(path, replace(calibration_of(fit, entries), use=use))


def calibration_of(fit: Fit, entries: Catalogue | None = None) -> Calibration:
    """The calibration of a fit: matrix and bias of the sensor, and the terms of the effects in its chain.

    `entries`: the catalogue of the effects in the chain; by default that of the program.

    **Raises:** `KeyError` when the sensor's parameters are not all estimated, one for all data; `InputError` for a form of a
    user effect that no file can contain.
    """
    terms = terms_of_chain(fit, fit.problem.chain, catalogue() if entries is None else entries)
    return terms.put_into(linear_calibration(fit), fit.data.temperature_degc)
