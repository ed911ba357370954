"""Study files: TOML checked strictly; all faults are reported together, with their dotted paths."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from tumblecal.chain.nominal import UNIT_OF_LEAF, unit_of_parameter
from tumblecal.chain.rig import Rig
from tumblecal.chain.rig_file import rig_of
from tumblecal.effects.catalogue import Catalogue, catalogue, links_and_units
from tumblecal.effects.users_file import Source, extended, read_source
from tumblecal.ground.errors import InputError
from tumblecal.ground.strict_toml import (
    Angle,
    Hertz,
    Number,
    Numbers,
    Sd,
    SdOrNone,
    Seconds,
    Seed,
    Strict,
    checked,
    read_toml,
    sizes_by_name,
)
from tumblecal.ground.toml_faults import located
from tumblecal.noise import Dwells, Flicker, Noise, Part, Quantisation, RandomWalk, White, regular_dwells
from tumblecal.noise.allan_fit import from_figures
from tumblecal.studies.study_faults import unknown_effects


Count = Annotated[int, Field(ge=2, le=10**12)]


class Figure(Strict):
    """Sd of means over an averaging time."""

    tau: Seconds
    sd: SdOrNone


class StudyNoiseTable(Strict):
    """The `[noise]` table: white with the sd of a position mean, or a model of the samples with its schedule."""

    sd: Sd | None = None
    figures: Annotated[list[Figure], Field(min_length=2)] | None = None
    white: SdOrNone = 0.0
    bias_instability: SdOrNone = 0.0
    random_walk: SdOrNone = 0.0
    quantisation: SdOrNone = 0.0
    rate: Hertz = 100.0
    dwell: Seconds = 60.0
    move: Seconds = 15.0

    @model_validator(mode="after")
    def _one_kind(self) -> "StudyNoiseTable":
        parts = any((self.white, self.bias_instability, self.random_walk))
        if sum((self.sd is not None, self.figures is not None, parts)) > 1:
            raise ValueError("give one of sd (white position means), figures, or white/bias_instability/random_walk")
        return self

    def model(self) -> Noise | None:
        """The model of the samples; None for white position means."""
        if self.figures is not None:
            figures = [(figure.tau, figure.sd) for figure in self.figures]
            return from_figures(figures, period_s=1 / self.rate, quantisation=self.quantisation)
        unit, parts = np.ones(3), list[Part]()
        if self.quantisation:
            parts.append(Quantisation(unit * self.quantisation, 1 / self.rate))
        if self.white:
            parts.append(White(unit * self.white))
        if self.bias_instability:
            parts.append(Flicker(unit * self.bias_instability, shortest_s=1 / self.rate))
        if self.random_walk:
            parts.append(RandomWalk(unit * self.random_walk))
        return Noise(tuple(parts)) if parts else None

    def dwells(self, positions: int) -> Dwells:
        """The schedule of a number of positions."""
        return regular_dwells(positions, self.dwell, self.move, self.rate)


class TruthTable(Strict):
    """The `[truth]` table: sd of a random instrument about the rig's true values, by leaf or parameter."""

    spread: Annotated[
        dict[str, float], sizes_by_name(lambda name: unit_of_parameter(name, UNIT_OF_LEAF) or "1", zero=True)
    ] = {}


class _StudyKeys(Strict):
    """Keys of every study."""

    title: str = ""
    rig: str
    seed: Seed = 0
    noise: StudyNoiseTable = StudyNoiseTable()


class _CoverageKeys(_StudyKeys):
    trials: Count
    path: Literal["auto", "harmonic", "chain"] = "auto"
    raw: bool = False
    truth: TruthTable = TruthTable()
    inject: dict[str, Numbers] = {}


class CoverageTable(_CoverageKeys):
    """A coverage study: how far estimates and their stated uncertainties can be trusted."""

    schema_: Annotated[Literal["tumblecal.study.coverage/1"], Field(alias="schema")]


class SweepTable(_CoverageKeys):
    """A sweep: one coverage study for each point of a grid of dotted paths (`rig.noise.sd`, `study.inject.outlier`)."""

    schema_: Annotated[Literal["tumblecal.study.sweep/1"], Field(alias="schema")]
    grid: Annotated[dict[str, Annotated[list[Any], Field(min_length=1)]], Field(min_length=1)]


class ConvergenceTable(_StudyKeys):
    """A convergence study: how many data sets it takes to reach a given error, by each method."""

    schema_: Annotated[Literal["tumblecal.study.convergence/1"], Field(alias="schema")]
    runs: Count
    data_sets: Count = 600
    methods: Annotated[list[Literal["single", "mean", "kalman", "exact"]], Field(min_length=1)] = [
        "single",
        "mean",
        "kalman",
        "exact",
    ]
    prior_sd: Annotated[list[Annotated[Number, Field(gt=0)]], Field(min_length=1)] = [1e3, 1e-2, 2e-3]
    thresholds: Annotated[list[Annotated[Number, Field(gt=0)]], Field(min_length=1)] = [1e-4, 3e-5, 1e-5]
    truth: TruthTable = TruthTable()


class LinearizationTable(_StudyKeys):
    """A linearisation study: bias of the small-angle paths over the size of mount and pitch errors."""

    schema_: Annotated[Literal["tumblecal.study.linearization/1"], Field(alias="schema")]
    instruments: Count = 1000
    smallest: Angle = 0.3e-3
    largest: Angle = 0.1
    sizes: Annotated[int, Field(ge=3, le=10_000)] = 21
    data_sets: Annotated[list[Annotated[int, Field(ge=1, le=10**12)]], Field(min_length=1)] = [1, 10, 100, 1000]


class PowerTable(_StudyKeys):
    """A power study: how often effects are detected and named, over their sizes."""

    schema_: Annotated[Literal["tumblecal.study.power/1"], Field(alias="schema")]
    runs: Count
    noise_stated: bool = True
    effects: Annotated[dict[str, Annotated[list[Number], Field(min_length=1)]], Field(min_length=1)]
    truth: TruthTable = TruthTable()


TABLES: dict[str, type[Strict]] = {
    "coverage": CoverageTable,
    "sweep": SweepTable,
    "convergence": ConvergenceTable,
    "linearization": LinearizationTable,
    "power": PowerTable,
}


def read_study(
    path: Path, kind: str, changes: Mapping[str, object] | None = None, effects: Sequence[Path] = ()
) -> dict[str, Any]:
    """A study file and its rig as plain tables, checked.

    **Arguments:**

    - `path`: the TOML file; its `rig` is in the same folder.
    - `kind`: `coverage`, `sweep`, `convergence` or `linearization`.
    - `changes`: keys that the command line replaces (`trials`, `runs`, `seed`).
    - `effects`: Python files with user effects; their text becomes part of the study.

    **Returns:** `{"kind", "study", "rig", "source"}`, of JSON types only: what a worker needs, and what is hashed; `effects`
    too, where there are any.

    **Raises:** `InputError` with every fault of both files.
    """
    content: dict[str, Any] = dict(read_toml(path)) | dict(changes or {})
    sources = [read_source(file) for file in effects]
    entries = extended(catalogue(), sources)
    faults = table_faults(kind, content, path) or unknown_effects(content, path, entries)
    rig: dict[str, Any] = {}
    if isinstance(name := content.get("rig"), str):
        rig_path = path.parent / name
        try:
            rig = read_toml(rig_path)
            rig_of(rig, rig_path, *links_and_units(entries))
        except InputError as error:
            faults += error.faults
    if content.get("raw") and not {"figures", "white", "bias_instability", "random_walk"} & set(
        content.get("noise", {})
    ):
        faults = [*faults, f"{path}: raw: samples need a noise model; give noise.figures or noise.white and others"]
    if faults:
        raise InputError(located(path, faults))
    study: dict[str, Any] = {"kind": kind, "study": content, "rig": rig, "source": str(path)}
    if sources:
        study["effects"] = [vars(source) for source in sources]
    return json.loads(json.dumps(study, default=str))


def table_faults(kind: str, content: Mapping[str, object], path: Path) -> list[str]:
    """The faults of a study's table."""
    try:
        checked(path, content, TABLES[kind])
    except InputError as error:
        return [*error.faults]
    return []


def table_of(study: Mapping[str, Any]) -> Any:
    """The checked table of a study from `read_study`."""
    return TABLES[study["kind"]].model_validate(study["study"])


def rig_of_study(study: Mapping[str, Any]) -> Rig:
    """The rig of a study from `read_study`."""
    return rig_of(study["rig"], Path(str(study["study"]["rig"])), *links_and_units(entries_of(study)))


def entries_of(study: Mapping[str, Any]) -> Catalogue:
    """The catalogue of a study from `read_study`: the program's effects and those of the user's files."""
    return extended(catalogue(), [Source(**source) for source in study.get("effects", ())])


def noise_of(table: StudyNoiseTable, rig: Rig) -> tuple[float, np.ndarray | None]:
    """Stated sd of a position mean, g, and the covariance of the means, or None where they are white.

    **Raises:** `InputError` when neither the study nor the rig states the noise.
    """
    model = table.model()
    if model is None and rig.ability is not None and rig.ability.slow_noise.any and rig.plan.time_s is None:
        raise InputError(f"{rig.source}: [head.noise] needs the times of the positions; add plan.interval_s, or time_s")
    if model is not None:
        covariance = model.mean_covariance(table.dwells(len(rig.plan)))
        return float(np.sqrt(np.mean(np.diagonal(covariance, axis1=1, axis2=2)))), covariance
    noise_stated(table, rig)
    return table.sd or rig.noise_sd_g or 0.0, None


def unused_of_head(kind: str, study: Mapping[str, Any]) -> str:
    """Tables of the rig's head that a study does not use, in words; "" if there are none."""
    table, rig = table_of(study), rig_of_study(study)
    stated = rig.tables_of_head
    if kind not in ("coverage", "sweep"):
        return f"{rig.source}: not used by `study {kind}`: {', '.join(stated)}" if stated else ""
    if "[head.noise]" in stated and table.noise.model() is not None:
        return f"{rig.source}: [head.noise] is not used: [noise] of the study replaces it"
    return ""


def noise_stated(table: StudyNoiseTable, rig: Rig) -> None:
    """Check that there is noise.

    **Raises:** `InputError` when neither the study nor the rig states any.
    """
    sd = table.sd if table.sd is not None else rig.noise_sd_g
    if table.model() is None and not sd:
        none = (
            "neither the study nor its rig states the noise" if sd is None else "a study needs some, and the rig's is 0"
        )
        raise InputError(f'{rig.source}: noise.sd: {none}; write [noise] sd = "0.1 mg"')
