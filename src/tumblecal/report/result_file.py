"""`result.json` and `calibration.json` of a calibration."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.chain import followings_of
from tumblecal.data.calibration import Calibration, write_calibration
from tumblecal.data.source_of import source_of
from tumblecal.effects import Catalogue, catalogue
from tumblecal.estimation.curves_of_fit import reported
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import intrinsic, one_sensor
from tumblecal.estimation.linear_calibration import linear_calibration
from tumblecal.estimation.methods import Calibrated
from tumblecal.estimation.mountings import turns_of
from tumblecal.ground.atomic import write_text
from tumblecal.ground.gravity import record_of
from tumblecal.ground.json_file import json_text
from tumblecal.lab.sensor_terms import terms_of_chain


SCHEMA = "tumblecal.result/1"
# Pairs of parameters whose correlation is above this are listed.
STRONG_CORRELATION = 0.9


def write_calibrated(folder: Path, calibrated: Calibrated, said: Mapping[str, Any] | None = None) -> list[str]:
    """Write `result.json` into `folder`, and `calibration.json` of an exact fit that converged.

    `said`: further entries of its provenance, such as that of the head (`MeasuredHead.record`).

    **Returns:** their names.
    """
    write_text(folder / "result.json", json_text(result_content(calibrated)))
    if not calibrated.exact.code.good or not one_sensor(calibrated.exact):
        return ["result.json"]
    calibration, use = calibration_of(calibrated.exact, calibrated.entries), calibrated.use
    if calibrated.level is not None:
        said = {"stated_noise": calibrated.level.words} | dict(said or {})
    if calibrated.scatter is not None:
        said = {"attitude_scatter_rad": calibrated.scatter.tilt_rad} | dict(said or {})
    if calibrated.floor is not None:
        said = {"between_position_sd_g": calibrated.floor.floor_g} | dict(said or {})
    write_calibration(
        folder / "calibration.json", replace(calibration, provenance=calibration.provenance | dict(said or {}), use=use)
    )
    return ["result.json", "calibration.json"]


def result_content(calibrated: Calibrated) -> dict[str, Any]:
    """Contents of `result.json` (DESIGN section 6)."""
    exact, judged = calibrated.exact, calibrated.judgements
    data = exact.data
    turns, seen = turns_of(exact.problem.chain, exact.problem.where), exact.identifiability
    assert seen is not None  # the exact fit always has it
    return {
        "schema": SCHEMA,
        "source": source_of(data),
        "gravity": record_of(data.gravity),
        "model": {
            "links": [type(link).__name__ for link in exact.chain.links] if exact.chain else [],
            "parameters": list(exact.names),
            "mountings": {label: {"rotation_deg": list(turn)} for label, turn in turns.items()},
        },
        "methods": {name: _method(result) for name, result in calibrated.fits.items()},
        "skipped": calibrated.skipped,
        "set_up": [setup_error.record() for setup_error in calibrated.setup_errors],
        "implausible": [vars(unusual) for unusual in calibrated.implausible],
        "judgement": judged[0].record(),
        "judgements": [judgement.record() for judgement in judged],
        "use": calibrated.use.record(),
        "noise": {
            "sigma_g": exact.sigma,
            "kind": exact.noise,
            "chi2": exact.chi2 if exact.noise == "stated" else None,
            "dof": exact.dof,
            "chi2_p_value": exact.chi2_p_value,
            "contradicted_level": None if calibrated.level is None else vars(calibrated.level),
            "attitude_scatter": None if calibrated.scatter is None else vars(calibrated.scatter),
            "floor_g": None if calibrated.floor is None else calibrated.floor.floor_g,
            "rms_g": exact.rms,
        },
        "residuals": [
            {"position": name, "alpha_deg": alpha, "beta_deg": beta, "x_g": x, "y_g": y, "z_g": z}
            for name, alpha, beta, (x, y, z) in zip(
                data.names, data.alpha_deg.tolist(), data.beta_deg.tolist(), exact.residuals.tolist(), strict=True
            )
        ],
        "identifiability": {
            "rank": seen.rank,
            "free": seen.free,
            "singular_values": seen.singular_values.tolist(),
            "weak": [
                {"words": weak.words, "coefficients": weak.coefficients, "sd_ratio": weak.sd_ratio}
                for weak in seen.weak
            ],
            "correlations": strong_correlations(exact),
        },
        "intrinsic": _intrinsic(exact),
        **_temperature(exact),
    }


def _temperature(result: Fit) -> dict[str, Any]:
    """The physical coefficients of the parameters that follow temperature, if any."""
    followings, stated = followings_of(result.problem.chain), reported(result)
    if not followings:
        return {}
    coefficients = {
        name: {"value": value, "sd": sd, "unit": unit}
        for name, value, sd, unit in zip(
            stated.names, stated.values.tolist(), stated.sd.tolist(), stated.units, strict=True
        )
        if name not in result.names
    }
    functions = followings[0].functions
    return {
        "temperature": {
            "reference_degc": functions.reference_degc,
            "range_degc": list(functions.range_degc),
            "coefficients": coefficients,
        }
    }


def calibration_of(result: Fit, entries: Catalogue | None = None) -> Calibration:
    """The calibration of a fit: matrix and bias of the sensor, and the terms of the effects in its chain.

    `entries`: the catalogue of the effects in the chain; by default that of the program.

    **Raises:** `KeyError` when the sensor's parameters are not all estimated, one for all data; `InputError` for a form of a
    user effect that no file can contain.
    """
    terms = terms_of_chain(result, result.problem.chain, catalogue() if entries is None else entries)
    return terms.put_into(linear_calibration(result), result.data.temperature_degc)


def strong_correlations(result: Fit) -> list[dict[str, Any]]:
    """Pairs of parameters correlated above 0.9, the strongest first."""
    correlation = result.correlation
    shared = np.array(result.shared, int)
    first, second = (shared[index] for index in np.triu_indices(len(shared), 1))
    pairs = [
        {"first": result.names[i], "second": result.names[j], "correlation": float(correlation[i, j])}
        for i, j in zip(first, second, strict=True)
        if abs(correlation[i, j]) > STRONG_CORRELATION
    ]
    return sorted(pairs, key=lambda pair: -abs(pair["correlation"]))


def _method(result: Fit) -> dict[str, Any]:
    level = result.interval(0.95)
    return {
        "parameters": {
            name: {"value": value, "sd": sd, "unit": unit, "interval_95": interval}
            for name, value, sd, unit, interval in zip(
                result.names, result.values.tolist(), result.sd.tolist(), result.units, level.tolist(), strict=True
            )
        },
        "covariance": result.covariance.tolist(),
        "code": result.code.name,
        "message": result.message,
        "sigma_g": result.sigma,
        "dof": result.dof,
        "statistics": result.statistics,
    }


def _intrinsic(result: Fit) -> dict[str, Any]:
    if not one_sensor(result):
        return {}
    triad = intrinsic(result)
    sizes = zip(
        triad.names, triad.values.tolist(), np.sqrt(np.diag(triad.covariance)).tolist(), triad.units, strict=True
    )
    return {name: {"value": value, "sd": sd, "unit": unit} for name, value, sd, unit in sizes}
