"""`result.json` and `calibration.json` of a calibration."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal.chain import followings_of
from tumblecal.data.calibration import Calibration, write_calibration
from tumblecal.data.calibration_use import Use
from tumblecal.data.source_of import source_of
from tumblecal.effects import Catalogue, catalogue
from tumblecal.estimation.curves_of_fit import reported
from tumblecal.estimation.fit import Fit
from tumblecal.estimation.intrinsic import intrinsic, one_sensor
from tumblecal.estimation.linear_calibration import linear_calibration
from tumblecal.estimation.methods import Calibrated
from tumblecal.estimation.mountings import turns_of
from tumblecal.estimation.plausibility import implausible
from tumblecal.ground.atomic import write_text
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import record_of
from tumblecal.ground.json_file import json_text
from tumblecal.lab.sensor_terms import terms_of_chain


SCHEMA = "tumblecal.result/1"
# Pairs of parameters whose correlation is above this are listed.
STRONG_CORRELATION = 0.9


def write_calibrated(folder: Path, calibrated: Calibrated, stated: Mapping[str, Any] | None = None) -> list[str]:
    """Write `result.json` into `folder`, and `calibration.json` of an exact fit that converged.

    `stated`: further entries of its provenance, such as that of the head (`MeasuredHead.record`).

    **Returns:** their names.
    """
    write_text(folder / "result.json", json_text(result_content(calibrated)))
    exact, level, scatter, floor = calibrated.exact, calibrated.level, calibrated.scatter, calibrated.floor
    if not exact.code.good or not one_sensor(exact):
        return ["result.json"]
    noise = {
        "stated_noise": level and level.words,
        "attitude_scatter_rad": scatter and scatter.tilt_rad,
        "between_position_sd_g": floor and floor.floor_g,
    }
    calibration = calibration_of(exact, calibrated.entries)
    provenance = {key: entry for key, entry in noise.items() if entry is not None} | dict(stated or {})
    write_calibration(
        folder / "calibration.json",
        replace(calibration, provenance=calibration.provenance | provenance, use=calibrated.use),
    )
    return ["result.json", "calibration.json"]


def save_fit(path: Path, fit: Fit, entries: Catalogue | None = None, use: Use | None = None) -> None:
    """Write a fit's `calibration.json`; `entries`: as of `calibration_of`; `use`: by default judged from this fit alone.

    **Raises:** `InputError` for a fit that did not converge, or of more or less than one sensor.
    """
    if not fit.code.good or not one_sensor(fit):
        why = fit.message if not fit.code.good else "dK, bias and gamma are not one for all data, or all are fixed"
        raise InputError(f"{fit.data.source}: no calibration to save: {why}")
    use = use or Calibrated({"exact": fit}, {}, implausible(fit)).use
    write_calibration(path, replace(calibration_of(fit, entries), use=use))


def result_content(calibrated: Calibrated) -> dict[str, Any]:
    """Contents of `result.json`."""
    exact, judged, seen = calibrated.exact, calibrated.judgements, calibrated.exact.identifiability
    data, problem = exact.data, exact.problem
    assert seen is not None  # the exact fit always has it
    triad = intrinsic(exact) if one_sensor(exact) else None
    return {
        "schema": SCHEMA,
        "source": source_of(data),
        "gravity": record_of(data.gravity),
        "model": {
            "links": [type(link).__name__ for link in exact.chain.links],
            "parameters": exact.names,
            "mountings": {
                label: {"rotation_deg": turn} for label, turn in turns_of(problem.chain, problem.where).items()
            },
        },
        "methods": {name: _method(fit) for name, fit in calibrated.fits.items()},
        "skipped": calibrated.skipped,
        "set_up": [setup_error.record() for setup_error in calibrated.setup_errors],
        "implausible": calibrated.implausible,
        "judgement": judged[0].record(),
        "judgements": [judgement.record() for judgement in judged],
        "use": calibrated.use.record(),
        "noise": {
            "sigma_g": exact.sigma,
            "kind": exact.noise,
            "chi2": exact.chi2 if exact.noise == "stated" else None,
            "dof": exact.dof,
            "chi2_p_value": exact.chi2_p_value,
            "contradicted_level": calibrated.level,
            "attitude_scatter": calibrated.scatter,
            "floor_g": None if calibrated.floor is None else calibrated.floor.floor_g,
            "rms_g": exact.rms,
        },
        "residuals": [
            {"position": name, "alpha_deg": alpha, "beta_deg": beta, "x_g": x, "y_g": y, "z_g": z}
            for name, alpha, beta, (x, y, z) in zip(
                data.names, data.alpha_deg, data.beta_deg, exact.residuals, strict=True
            )
        ],
        "identifiability": {
            "rank": seen.rank,
            "free": seen.free,
            "singular_values": seen.singular_values.tolist(),
            "weak": [{"words": direction.words, **vars(direction)} for direction in seen.weak],
            "correlations": strong_correlations(exact),
        },
        "intrinsic": {} if triad is None else _estimates(triad.names, triad.values, triad.sd, triad.units),
        **_temperature(exact),
    }


def _estimates(
    names: Iterable[str], values: Float[np.ndarray, " names"], sd: Float[np.ndarray, " names"], units: Iterable[str]
) -> dict[str, dict[str, Any]]:
    columns = zip(names, values, sd, units, strict=True)
    return {name: {"value": value, "sd": sd, "unit": unit} for name, value, sd, unit in columns}


def _method(fit: Fit) -> dict[str, Any]:
    parameters = _estimates(fit.names, fit.values, fit.sd, fit.units)
    intervals = dict(zip(fit.names, fit.interval(0.95).tolist(), strict=True))
    return {
        "parameters": {name: entry | {"interval_95": intervals[name]} for name, entry in parameters.items()},
        "covariance": fit.covariance.tolist(),
        "code": fit.code.name,
        "message": fit.message,
        "sigma_g": fit.sigma,
        "dof": fit.dof,
        "statistics": fit.statistics,
    }


def _temperature(fit: Fit) -> dict[str, Any]:
    """The physical coefficients of the parameters that follow temperature, if any."""
    followings, stated = followings_of(fit.problem.chain), reported(fit)
    if not followings:
        return {}
    functions = followings[0].functions
    coefficients = _estimates(stated.names, stated.values, stated.sd, stated.units)
    return {
        "temperature": {
            "reference_degc": functions.reference_degc,
            "range_degc": functions.range_degc,
            "coefficients": {name: entry for name, entry in coefficients.items() if name not in fit.names},
        }
    }


def calibration_of(fit: Fit, entries: Catalogue | None = None) -> Calibration:
    """The calibration of a fit: matrix and bias of the sensor, and the terms of the effects in its chain.

    `entries`: the catalogue of the effects in the chain; by default that of the program.

    **Raises:** `KeyError` when the sensor's parameters are not all estimated, one for all data; `InputError` for a form of a
    user effect that no file can contain.
    """
    terms = terms_of_chain(fit, fit.problem.chain, catalogue() if entries is None else entries)
    return terms.put_into(linear_calibration(fit), fit.data.temperature_degc)


def strong_correlations(fit: Fit) -> Sequence[dict[str, Any]]:
    """Pairs of parameters correlated above 0.9, the strongest first."""
    correlation, shared = fit.correlation, fit.shared
    pairs = [
        {"first": fit.names[i], "second": fit.names[j], "correlation": float(correlation[i, j])}
        for number, i in enumerate(shared)
        for j in shared[number + 1 :]
        if abs(correlation[i, j]) > STRONG_CORRELATION
    ]
    return sorted(pairs, key=lambda pair: -abs(pair["correlation"]))
