"""The extended fit as a `Result`, like every other estimate."""

import numpy as np

from tumblecal.diagnosis.diagnose import Diagnosis
from tumblecal.estimation.result import Code, Result


def extended_result(found: Diagnosis) -> Result:
    """Nominal parameters, then the coefficients of the effects found, in base units."""
    model, fit = found.model, found.extended
    slots = [one.slot for one in found.members if one.slot is not None]
    columns = [*range(model.nominal), *(column for slot in slots for column in sorted((*slot.columns, *slot.shape)))]
    names = (*model.names, *(name for slot in slots for name in slot.names))
    units = (*model.units, *(unit for slot in slots for unit in slot.units))
    free = fit.directions.shape[1]
    spread = fit.directions[columns] * model.scales[columns][:, None]
    return Result(
        method="exact, extended by diagnosis" if slots else "exact",
        names=names,
        units=units,
        values=fit.vector[columns],
        covariance=spread @ fit.covariance[:free, :free] @ spread.T,
        residuals=np.where(fit.keep[:, None], fit.residuals, np.nan),
        sigma=found.sigma_g,
        dof=fit.dof,
        chi2=fit.chi2,
        noise="stated" if found.how.known else "estimated",
        code=Code.CONVERGED if fit.converged else Code.NOT_CONVERGED,
        data=found.data,
        chain=found.chain,
    )


def sensor_terms(found: Diagnosis) -> tuple[list[dict], list[str]]:
    """The effects found that belong to the sensor, as terms of a calibration file; and the ids that it cannot hold."""
    terms, left = [], []
    for one in found.members:
        if one.slot is None:
            continue
        forms = found.entries[one.id].forms
        if not forms:
            left.append(one.id)
        for form, column in zip(forms, one.slot.columns, strict=False):
            terms.append({**form, "coefficient": float(found.extended.vector[column]), "effect": one.id})
    return terms, left
