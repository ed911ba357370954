"""The record of the study of the paper, `study.json`."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from pydantic import SerializeAsAny

from tumblecal.data import paper
from tumblecal.ground.record import Count, ResultRecord, at, rows, table
from tumblecal.studies.paper_audit import Audit, NoiseAudit
from tumblecal.studies.paper_study import PaperStudy


class ParameterRecord(ResultRecord):
    """Estimates of a parameter; `final`: after all data sets, by method."""

    unit: str
    truth: float
    single_sd: float
    final: dict[str, float]
    scatter_of_single_exact_fits: float


class SimulationRecord(ResultRecord):
    """`PaperStudy`."""

    seed: int
    sets: Count = at("single")
    parameters: dict[str, ParameterRecord]
    diffuse_kalman_less_running_mean_max_sd: float = at("kalman_is_running_mean")
    rms_error_in_sd_after_sets: dict[str, list[float]] = at("early_error")


class PublishedSetRecord(ResultRecord):
    """`PublishedSet`."""

    parameters: str = at("name")
    f: float
    dof: tuple[int, int]
    p_value: float
    largest_residual_g: float
    smallest_residual_g: float


class UnitsRecord(ResultRecord):
    """Mean size of gravity in the readings of Table 1."""

    mean_norm: float
    mean_norm_if_ms2_g: float


class AuditRecord(ResultRecord):
    """`Audit`."""

    explanations: list[PublishedSetRecord]
    noise: NoiseAudit
    units: UnitsRecord = at("result")


class PaperRecord(ResultRecord):
    """`study.json`; `table1`: the record of the calibration by Table 1."""

    schema_: Literal["tumblecal.reproduction/1"] = "tumblecal.reproduction/1"
    findings: list[str]
    simulation: SimulationRecord
    table1: SerializeAsAny[ResultRecord]
    table2: dict[str, list[float]]
    table3_g: dict[str, list[float]]
    audit: AuditRecord = at("result")


def paper_record(study: PaperStudy, audit: Audit, table1: ResultRecord, findings: Sequence[str]) -> PaperRecord:
    """The study in numbers; `table1`: the record of its calibration."""
    estimates = {"running_mean": study.mean, "kalman": study.kalman, "kalman_diffuse": study.diffuse}
    final = rows(**{name: each[-1] for name, each in (estimates | {"exact": study.exact_mean}).items()})
    scatter = np.std(study.exact, axis=0, ddof=1)
    parameters = table(
        study.names,
        unit=study.units,
        truth=study.truth,
        single_sd=study.single_sd,
        final=final,
        scatter_of_single_exact_fits=scatter,
    )
    return PaperRecord.of(
        audit,
        findings=findings,
        simulation=SimulationRecord.of(study, parameters=parameters),
        table1=table1,
        table2=paper.table2(),
        table3_g=paper.table3(),
    )
