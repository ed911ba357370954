"""A new calibration from the prior one and a recording: a Kalman update, with process noise since the calibration.

The state is that of `Expected`: the parameters at the reference temperature, and the coefficients of the curves. A change since
the calibration is the same at all temperatures. With `S = 1 + H (J C J' + N) H'`, the gain is `C J' H' S^-1`. The common error
N of the recording (hysteresis, gravity) is in S, so it is not mistaken for knowledge.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
from jaxtyping import Float

from tumblecal import __version__
from tumblecal.check.consistency import Consistency, tested
from tumblecal.check.drift import ProcessNoise, ProcessNoiseRecord
from tumblecal.check.expected import Expected
from tumblecal.check.usual_changes import FACTORS, USUAL
from tumblecal.data.calibration import Calibration
from tumblecal.data.calibration_terms import WITH_TERMS
from tumblecal.data.calibration_use import YES, Use, combined
from tumblecal.data.sensor_parameters import (
    SENSOR,
    UNITS,
    SensorParameters,
    correction_slope,
    leaf_of,
    triad_of,
)
from tumblecal.data.temperature_curves import order_of_covariance
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import p_words
from tumblecal.lab.corrected_reading import expanded_uncertainty
from tumblecal.words import sentence


@dataclass(frozen=True)
class Update:
    """An updated calibration.

    - `before`: test of the recording against the prior with process noise and freed parameters. `calibration`: the new one.
    - `change`, `sd`: of the sensor parameters, new minus old, and their new standard uncertainties, base units. `ratio`: of
      these to the old ones.
    """

    before: Consistency
    calibration: Calibration
    change: Float[np.ndarray, "9"]
    sd: Float[np.ndarray, "9"]
    ratio: Float[np.ndarray, "9"]


def freed_names(listed: Collection[str]) -> tuple[str, ...]:
    """Parameters of `--free`: names or leaves.

    **Raises:** `InputError` for an unknown one.
    """
    if unknown := {*listed} - {*UNITS}:
        raise InputError(f"--free {min(unknown)}: no such parameter; parameters: {', '.join(UNITS)}")
    return tuple(name for name in SENSOR if name in listed or leaf_of(name) in listed)


def prior_of(expected: Expected, process: ProcessNoise, freed: Collection[str] = ()) -> Expected:
    """The calibration with the changes since then: process noise, and a wide prior on freed parameters."""
    wide = np.array([max(FACTORS) * USUAL[k] if name in freed else 0.0 for k, name in enumerate(SENSOR)])
    covariance, state = expected.covariance.copy(), expected.state.copy()
    covariance[range(9), range(9)] += process.variance + wide**2
    state[:9] += process.shift
    sensor = replace(
        expected.sensor,
        values=expected.sensor.values + process.shift,
        covariance=expected.sensor.covariance + np.diag(process.variance + wide**2),
        noise=expected.sensor.covariance if expected.sensor.noise is None else expected.sensor.noise,
    )
    mean = expected.mean + process.shift
    return replace(expected, covariance=covariance, state=state, sensor=sensor, mean=mean)


def updated(test: Consistency, process: ProcessNoise, freed: Collection[str], record: dict[str, Any]) -> Update:
    """Update a calibration.

    **Arguments:**

    - `test`: of the recording against the calibration. `process`: changes since the calibration. `freed`: parameters that
      changed.
    - `record`: files and dates for the provenance.

    **Raises:** `InputError` if the recording contradicts the prior with these changes.
    """
    prior = prior_of(test.expected, process, freed)
    shifted = replace(
        test.observation, innovation=test.observation.innovation - test.observation.slopes @ process.shift
    )
    before = tested(shifted, prior, noise_dof=test.noise_dof, shared=test.shared)
    if before.rejected:
        free = f" even with {', '.join(freed)} free" if freed else ""
        raise InputError(
            f"--update: the recording contradicts the calibration{free} ({p_words(before.p_value)}), so it is not updated: an "
            "update would mix a changed sensor with its old calibration; state the parameters that changed with --free, or "
            "calibrate again"
        )
    rows, slope = before.observation, prior.slope
    along = rows.by_state(slope)
    total = np.eye(len(rows.innovation)) + along @ prior.covariance @ along.T
    total += rows.slopes @ prior.common @ rows.slopes.T
    gain = np.linalg.solve(total, along @ prior.covariance).T
    state = prior.state + gain @ rows.innovation
    keep = np.eye(len(state)) - gain @ along
    # Joseph's form: symmetric and positive for any rounding.
    noise = np.eye(len(total)) + rows.slopes @ prior.common @ rows.slopes.T
    covariance = keep @ prior.covariance @ keep.T + gain @ noise @ gain.T
    said = record | {
        "process_noise": ProcessNoiseRecord.of(process).plain(),
        "freed": list(freed),
        "p_value": before.p_value,
    }
    calibration = _calibration(test.expected.calibration, state, covariance, freed, said)
    sensor = calibration.sensor.of(SENSOR)
    old = test.expected.calibration.sensor.of(SENSOR)
    ratio = np.sqrt(np.diag(covariance)[:9] / np.diag(test.expected.covariance)[:9])
    return Update(before, calibration, sensor.values - old.values, sensor.sd, ratio)


def _calibration(
    old: Calibration,
    state: Float[np.ndarray, " state"],
    covariance: Float[np.ndarray, "state state"],
    freed: Collection[str],
    record: dict[str, Any],
) -> Calibration:
    values = state[:9]
    undetermined = tuple(
        name
        for k, name in enumerate(SENSOR)
        if (name in freed or (old.parameters and name in old.parameters.undetermined))
        and np.sqrt(covariance[k, k]) > USUAL[k]
    )
    sensor = SensorParameters(SENSOR, values, covariance[:9, :9], undetermined)
    curves = old.temperature
    if curves is not None:
        first, made = 9, []
        for curve in curves.curves:
            made.append(replace(curve, coefficients=state[first : first + curve.functions.count]))
            first += curve.functions.count
        curves = replace(curves, curves=tuple(made), covariance=covariance, covariance_order=order_of_covariance(made))
    use, slope = old.use if old.use.answer else YES, correction_slope(values)
    matrix, expanded_g = np.linalg.inv(triad_of(values)), use.expanded_g
    if freed and expanded_g is not None:
        # Freed parameters are known by this recording alone.
        expanded_g = float(np.hypot(expanded_g, expanded_uncertainty(matrix, slope @ sensor.covariance @ slope.T)))
    use = combined([use], expanded_g)
    if undetermined:
        known = tuple(name for name in SENSOR if name not in undetermined)
        reason = sentence("check/undetermined", names=list(undetermined))
        use = combined([use, Use("only", reason, parameters=known)], expanded_g)
    # The frame of the matrix is that of the old one: a rotation does not change the parameters.
    turned = old.matrix @ triad_of(old.sensor.of(SENSOR).values)
    slope = np.vstack([np.kron(turned, np.eye(3)) @ slope[:9], slope[9:]])
    extra = {key: value for key, value in old.extra.items() if key != WITH_TERMS}
    if curves is None and len(state) > len(SENSOR):
        size = len(state) - len(SENSOR)
        terms = [replace(term, coefficient=float(c)) for term, c in zip(old.terms, state[9:], strict=True)]
        whole = np.block([[slope, np.zeros((12, size))], [np.zeros((size, 9)), np.eye(size)]])
        joint = old.extra[WITH_TERMS] | {"covariance": (whole @ covariance @ whole.T).tolist()}
        extra |= {"terms": [term.record() for term in terms], WITH_TERMS: joint}
    return replace(
        old,
        matrix=turned @ matrix,
        bias=values[3:6],
        covariance=slope @ sensor.covariance @ slope.T,
        # A file without parameters may have a matrix in a different frame, with which they would not agree.
        parameters=sensor if old.parameters is not None or curves is not None else None,
        use=use,
        temperature=curves,
        provenance=_provenance(old, record),
        extra=extra,
    )


def _provenance(old: Calibration, record: Mapping[str, Any]) -> dict[str, Any]:
    """Data and date are those of the recording; the prior's are in `update`."""
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    recording = record.get("recording") or [{}]
    prior = {
        key: old.provenance[key] for key in ("data", "sha256", "measured_utc", "date_utc") if key in old.provenance
    }
    made = {
        "data": recording[0].get("file", "recording"),
        "sha256": recording[0].get("sha256"),
        "tumblecal": __version__,
        "date_utc": now,
        "update": {
            **record,
            "prior": prior | ({"update": earlier} if (earlier := old.provenance.get("update")) else {}),
        },
    }
    measured = record.get("measured_utc")
    rest = {key: value for key, value in old.provenance.items() if key != "measured_utc"}
    return rest | made | ({"measured_utc": measured} if measured else {})
