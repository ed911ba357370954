"""Parameters that follow temperature as reported: physical coefficients in place of those of orthonormal combinations."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Following, followings_of
from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.data.temperature_curves import Curve, TemperatureCurves, order_of_covariance
from tumblecal.estimation.fit import Fit


@dataclass(frozen=True)
class Reported:
    """Estimates with physical coefficients: values and covariance in base units, in the order of `names`."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Float[np.ndarray, " reported"]
    covariance: Float[np.ndarray, "reported reported"]

    @property
    def sd(self) -> Float[np.ndarray, " reported"]:
        """Standard uncertainties."""
        return np.sqrt(np.diag(self.covariance))


def reported(fit: Fit) -> Reported:
    """The parameters of a fit that are shared by positions, then the physical coefficients of estimated changes: `bias_x/degC`,
    `bias_x/degC^2`, ..."""
    estimated = [leaf for leaf in followings_of(fit.problem.chain) if leaf.change.names[0] in fit.names]
    changes = {name for leaf in estimated for name in leaf.change.names}
    others = [k for k in fit.shared if fit.names[k] not in changes]
    names, units, rows = (
        [fit.names[k] for k in others],
        [fit.units[k] for k in others],
        [np.eye(len(fit.names))[others]],
    )
    for leaf in estimated:
        functions, unit = leaf.functions, leaf.reference.unit
        for number, component in enumerate(leaf.reference.components):
            rows.append(_coefficients(fit, leaf, number)[0])
            bare = leaf.reference.name + (f"_{component}" if component else "")
            names += [bare + end for end in functions.coefficient_ends]
            units += [unit + divisor for divisor in functions.units]
    slope = np.vstack(rows)
    return Reported(tuple(names), tuple(units), slope @ fit.values, slope @ fit.covariance @ slope.T)


def curves_of(fit: Fit, of_others: Float[np.ndarray, "9 9"] | None = None) -> TemperatureCurves | None:
    """The parameters of the sensor over temperature, with the joint covariance of values at T0 and physical coefficients.

    Their range is the measured one; a stated range that is smaller limits it. None if no parameter of the sensor follows
    temperature, or if not all of them are estimated, one for all data.

    **Arguments:**

    - `of_others`: covariance of the sensor's parameters (in the order of `SENSOR`), for those that the fit does not estimate;
      they are then no reason for None.

    **Raises:** `InputError` if leaves have different reference temperatures or ranges.

    Examples:
        >>> import tumblecal
        >>> from tumblecal.estimation.curves_of_fit import curves_of
        >>> rig = tumblecal.read_rig("thermal_soaks")
        >>> data = tumblecal.simulate(rig, seed=1)
        >>> curves = curves_of(tumblecal.calibrate(data, chain=rig.chain(rig.where), noise_sd=1e-4).exact)
        >>> curve = curves.curves[3]
        >>> curve.parameter, [round(c / true, 1) for c, true in zip(curve.coefficients, (1e-4, -2e-6, 1e-7))]  # g/degC^k
        ('bias_x', [1.0, 1.0, 1.0])
    """
    chain, names = fit.problem.chain, fit.names
    if of_others is None and any(name not in names for name in SENSOR):
        return None
    followings = {name: leaf for leaf in followings_of(chain) for name in leaf.reference.names}
    curves, rows = (
        [],
        [np.eye(len(names))[names.index(name)] if name in names else np.zeros(len(names)) for name in SENSOR],
    )
    for name in SENSOR:
        leaf = followings.get(name)
        if leaf is not None and (leaf.change.free or np.any(leaf.change.value)):
            slope, known = _coefficients(fit, leaf, leaf.reference.names.index(name))
            # Over the measured part of their range; the coefficients do not depend on it.
            (low, high), degc = leaf.functions.range_degc, np.asarray(fit.problem.where.temperature_degc)
            degc = degc[fit.problem.takes_part]
            ends = (max(low, float(degc.min())), min(high, float(degc.max())))
            curves.append(Curve(name, replace(leaf.functions, range_degc=ends), slope @ fit.values + known))
            rows += list(slope)
    if not curves:
        return None
    slope = np.array(rows)
    covariance = slope @ fit.covariance @ slope.T
    if of_others is not None:
        here = np.array([k for k, name in enumerate(SENSOR) if name not in names], int)
        covariance[np.ix_(here, here)] = of_others[np.ix_(here, here)]
    return TemperatureCurves(tuple(curves), covariance, order_of_covariance(curves))


def _coefficients(
    fit: Fit, leaf: Following, component: int
) -> tuple[Float[np.ndarray, "count free"], Float[np.ndarray, " count"]]:
    """The physical coefficients of one component: a matrix times the parameters of the fit, plus those of a known change."""
    combination, width = leaf.functions.combination, len(leaf.reference.components)
    if not leaf.change.free:
        return np.zeros((len(combination), len(fit.names))), np.ravel(leaf.change.value)[component::width] @ combination
    columns = [fit.names.index(name) for name in leaf.change.names[component::width]]
    rows = np.zeros((len(combination), len(fit.names)))
    rows[:, columns] = combination.T
    return rows, np.zeros(len(combination))
