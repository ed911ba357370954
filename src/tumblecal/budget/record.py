"""`budget.json`: an uncertainty budget in numbers, base units."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator

from tumblecal.budget.budget import Budget
from tumblecal.budget.monte_carlo import MonteCarlo
from tumblecal.data.calibration import ORDER
from tumblecal.data.source_of import SourceRecord
from tumblecal.estimation.intrinsic import intrinsic, matrix_and_bias, one_sensor
from tumblecal.ground.record import LEFT_OUT, Quantity, ResultRecord, at, rows, table


Matrix = list[list[float]]


class ReductionRecord(ResultRecord):
    """The contribution without which U would be smallest."""

    input: str
    U_without: float


class ParameterRecord(Quantity):
    """A parameter with its contributions, combined and expanded uncertainty."""

    u_type_a: float
    contributions: dict[str, float]
    u: float
    effective_dof: float
    k: float
    U: float
    would_reduce_most: ReductionRecord


class TrialsRecord(ResultRecord):
    """Statistics of a parameter over the trials."""

    shift: float
    sd: float
    half_width: float
    within: float


class MonteCarloRecord(ResultRecord):
    """`MonteCarlo`."""

    trials: int
    failed: int
    parameters: dict[str, TrialsRecord]


class IntrinsicRecord(Quantity):
    """A parameter that does not depend on the mounting, with its combined uncertainty."""

    u: float


class BudgetRecord(ResultRecord):
    """`budget.json`: a `Budget`; without the last three for data of more or less than one sensor."""

    schema_: Literal["tumblecal.budget_result/1"] = "tumblecal.budget_result/1"
    source: SourceRecord = at("fit.data")
    level: float
    inputs: dict[str, dict[str, Any]]
    parameters: dict[str, ParameterRecord]
    covariance: Matrix = at("as_fit.covariance")
    type_b_covariance: Matrix = at("type_b")
    monte_carlo: MonteCarloRecord | None
    diagnosis: Annotated[list[str], BeforeValidator(list), LEFT_OUT] = at("diagnosis_parts")
    intrinsic: Annotated[dict[str, IntrinsicRecord] | None, LEFT_OUT] = None
    calibration_covariance: Annotated[Matrix | None, LEFT_OUT] = None
    calibration_covariance_order: Annotated[list[str] | None, LEFT_OUT] = None


def budget_record(budget: Budget, checked: MonteCarlo | None) -> BudgetRecord:
    """Contents of `budget.json`."""
    names, fit, sources, without = budget.names, budget.fit, budget.sources, budget.without_each
    of_sensor: dict[str, Any] = {}
    if one_sensor(fit):
        triad = intrinsic(budget.as_fit)
        of_sensor = {
            "intrinsic": table(triad.names, value=triad.values, u=triad.sd, unit=triad.units),
            "calibration_covariance": matrix_and_bias(budget.as_fit)[2],
            "calibration_covariance_order": ORDER,
        }
    parameters = table(
        names,
        value=fit.values,
        unit=fit.units,
        u_type_a=budget.table[0],
        contributions=[dict(zip(sources[1:], sizes, strict=True)) for sizes in budget.table[1:].T],
        u=budget.combined,
        effective_dof=budget.dof,
        k=budget.coverage,
        U=budget.expanded,
        would_reduce_most=rows(
            input=[sources[best] for best in np.argmin(without, axis=0)], U_without=np.min(without, axis=0)
        ),
    )
    trials = checked and table(names, **{key: getattr(checked, key) for key in TrialsRecord.model_fields})
    return BudgetRecord.of(
        budget,
        **of_sensor,
        inputs={
            given.label: given.stated.model_dump(exclude_defaults=True)
            | {"names": given.names, "standard_uncertainty": given.u}
            for given in budget.inputs
        },
        parameters=parameters,
        monte_carlo=checked and MonteCarloRecord.of(checked, parameters=trials),
    )
