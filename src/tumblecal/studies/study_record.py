"""Results of studies, as their JSON files have them: what all state, then those of the kind."""

from typing import Any

from tumblecal.ground.record import ResultRecord


class StudyHead(ResultRecord):
    """What all studies state: their tables, and the units of effects that they put into the data, by dotted path."""

    schema_: str
    title: str
    study: dict[str, Any]
    rig: dict[str, Any]
    units: dict[str, str]


class TrialsResult(ResultRecord):
    """Trials of one experiment: `path` and `path_reason` of the fit, sums of squares with `dof` degrees of freedom."""

    path: str
    path_reason: str
    trials: int
    failed: int
    sd_g: float | None
    dof: int
    chi2_mean: float | None
    chi2_variance: float | None
    nees_mean: float | None


class CoverageResult(TrialsResult):
    """Result of `study coverage`: the histogram is of bins of equal probability; correlation of the estimates."""

    chi2_uniformity_p: float | None
    chi2_histogram: list[float]
    nees_variance: float | None
    nees_expected: int
    levels: list[float]
    correlation: list[list[float | None]]


class PointResult(TrialsResult):
    """Trials of one point of a grid: `values` by dotted path."""

    values: dict[str, Any]


class SweepResult(ResultRecord):
    """Result of `study sweep`: the values of each dotted path, and their combinations."""

    grid: dict[str, list[Any]]
    points: list[PointResult]


class SettledResult(ResultRecord):
    """The parameter that needs most data sets, and how many; null where half of the runs never settle."""

    parameter: str
    median_data_sets: int | None


class ConvergenceResult(ResultRecord):
    """Result of `study convergence`: `settled` by method and threshold."""

    runs: int
    data_sets: int
    methods: list[str]
    sd_g: float | None
    noise: str
    nees_expected: int
    nis_expected: int
    settled: dict[str, dict[str, SettledResult]]


class LinearizationResult(ResultRecord):
    """Result of `study linearization`: `slopes` of the bias by case and path, 2 in theory; `answers` in words."""

    sd_g: float | None
    instruments: int
    failed: int
    predicted_sd: dict[str, float]
    slopes: dict[str, dict[str, float]]
    answers: list[str]


class RateResult(ResultRecord):
    """Rates of detection and naming of an effect of a size, in `unit`."""

    effect: str
    size: float
    unit: str
    runs: int
    failed: int
    detected: float
    named: float
    named_alone: float


class PowerResult(ResultRecord):
    """Result of `study power`."""

    sd_g: float | None
    rates: list[RateResult]
