"""Contents of `budget.json`: an uncertainty budget in numbers."""

from typing import Any

import numpy as np

from tumblecal.budget.budget import Budget
from tumblecal.budget.monte_carlo import MonteCarlo
from tumblecal.data.calibration import ORDER
from tumblecal.data.source_of import source_of
from tumblecal.estimation.intrinsic import intrinsic, matrix_and_bias, one_sensor


SCHEMA = "tumblecal.budget_result/1"


def budget_content(budget: Budget, checked: MonteCarlo | None) -> dict[str, Any]:
    """Contents of `budget.json`, base units."""
    sources, without = budget.sources, budget.without_each
    best = np.argmin(without, axis=0).tolist()
    content = {
        "schema": SCHEMA,
        "source": source_of(budget.fit.data),
        "level": budget.level,
        "inputs": {
            given.label: {
                **given.stated.model_dump(exclude_defaults=True),
                "names": given.names,
                "standard_uncertainty": given.u,
            }
            for given in budget.inputs
        },
        "parameters": {
            name: {
                "value": budget.fit.values[j],
                "unit": budget.fit.units[j],
                "u_type_a": budget.type_a[j],
                "contributions": dict(zip(budget.labels, budget.sizes[:, j], strict=True)),
                "u": budget.combined[j],
                "effective_dof": budget.dof[j],
                "k": budget.coverage[j],
                "U": budget.expanded[j],
                "would_reduce_most": {"input": sources[best[j]], "U_without": without[best[j], j]},
            }
            for j, name in enumerate(budget.names)
        },
        "covariance": budget.covariance.tolist(),
        "type_b_covariance": budget.type_b.tolist(),
        "monte_carlo": None if checked is None else _trials(budget, checked),
    }
    if budget.diagnosis_parts:
        content["diagnosis"] = list(budget.diagnosis_parts)
    if one_sensor(budget.fit):
        triad = intrinsic(budget.as_fit)
        columns = zip(triad.names, triad.values, triad.sd, triad.units, strict=True)
        content["intrinsic"] = {name: {"value": value, "u": u, "unit": unit} for name, value, u, unit in columns}
        content["calibration_covariance"] = matrix_and_bias(budget.as_fit)[2].tolist()
        content["calibration_covariance_order"] = ORDER
    return content


def _trials(budget: Budget, checked: MonteCarlo) -> dict[str, Any]:
    columns = {key: getattr(checked, key) for key in ("shift", "sd", "half_width", "within")}
    by_name = {name: {key: column[j] for key, column in columns.items()} for j, name in enumerate(budget.names)}
    return {"trials": checked.trials, "failed": checked.failed, "parameters": by_name}
