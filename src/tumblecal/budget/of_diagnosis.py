"""A budget that starts from the covariance of a diagnosis instead of that of the nominal fit's noise.

`C = D + sum u^2 s s'`: D the covariance of a diagnosis (noise, other explanations, undetected effects) of the parameters of
sensor and mount, to which the budget is limited; the inputs act through the nominal fit.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from tumblecal.budget.budget import Budget
from tumblecal.budget.inputs import BUDGET_INPUTS, Input
from tumblecal.data.calibration import Calibration, read_calibration
from tumblecal.data.calibration_use import Use
from tumblecal.data.not_applied import losses_words
from tumblecal.data.positions import PositionSet
from tumblecal.data.source_of import digest_of
from tumblecal.data.uncertainty_parts import UncertaintyParts, uncertainty_parts
from tumblecal.effects.catalogue import Catalogue
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


def diagnosis_of(folder: Path, data: PositionSet) -> tuple[Path, Calibration]:
    """The calibration of a diagnosis (its file, or the folder that has it) of the budget's data.

    **Raises:** `InputError` if file digest or serial number differ.
    """
    path = folder / "calibration.json" if folder.is_dir() else folder
    calibration = read_calibration(path)
    theirs, sha256 = calibration.serial_number, digest_of(data.source)
    if data.serial_number and theirs and data.serial_number != theirs:
        raise InputError(
            f"{path}: a diagnosis of unit {theirs}, but the data are of unit {data.serial_number}; diagnose the same file"
        )
    if sha256 and calibration.provenance.get("sha256") not in (None, sha256):
        raise InputError(f"{path}: a diagnosis of other data than the budget; diagnose the same file")
    return path, calibration


def with_diagnosis(budget: Budget, folder: Path, entries: Catalogue, file: str) -> tuple[Budget, list[str], Use]:
    """The budget with the covariance of a diagnosis of the same data.

    **Arguments:**

    - `folder`: as of `diagnosis_of`. `file`: of the inputs, for faults.

    **Returns:** the budget; notes on inputs that the diagnosis already includes as undetected effects, on the losses of its
    calibration and, last, on the use of this; and that use.

    **Raises:** `InputError` for a file that is not from such a diagnosis, and for an input that is an effect of its
    explanation.
    """
    path, calibration = diagnosis_of(folder, budget.fit.data)
    parts, use = uncertainty_parts(path, calibration), calibration.use
    names = parts.parameters.names
    if missing := [name for name in names if name not in budget.names]:
        raise InputError(
            f"{path}: a diagnosis of another model than the budget ({', '.join(missing)} not fitted); use the same "
            "options for both"
        )
    _require_new(path, budget, parts, file)
    places = [budget.names.index(name) for name in names]
    fit = budget.fit
    fit = replace(
        fit,
        names=names,
        units=tuple(fit.units[place] for place in places),
        values=parts.parameters.values,
        covariance=parts.parameters.covariance,
        unidentifiable=np.zeros((0, 0)),
    )
    shifts = tuple(shift[places] for shift in budget.shifts)
    made = replace(
        budget, fit=fit, shifts=shifts, diagnosis_parts=parts.diagnosis_parts, noise_dof=parts.parameters.dof
    )
    twice = _counted_twice(budget, parts, entries)
    return made, [*twice, *losses_words(calibration.not_applied), f"use: {use.words}"], use


def ids_of(given: Input) -> set[str]:
    """The effect ids of an input, with and without its axis."""
    return {given.stated.what, *(f"{given.stated.what}.{axis}" for axis in AXES)} if given.links else set()


def _require_new(path: Path, budget: Budget, parts: UncertaintyParts, file: str) -> None:
    faults = [
        f"{file}: considered.{given.label}: the diagnosis has a contribution of that name; choose another name"
        for given in budget.inputs
        if given.label in parts.diagnosis_parts
    ]
    faults += [
        f"{file}: considered.{given.label}: {', '.join(sorted(common))} is in the explanation of {path}; its uncertainty is "
        "included already, so leave it out"
        for given in budget.inputs
        if (common := ids_of(given) & parts.causes)
    ]
    if faults:
        raise InputError(faults)


def _counted_twice(budget: Budget, parts: UncertaintyParts, entries: Catalogue) -> Iterator[str]:
    for given in budget.inputs:
        effects = {id for id in ids_of(given) if id in entries and id not in BUDGET_INPUTS}
        both = effects if parts.undetected is None else effects & parts.undetected
        if both:
            yield (
                f"input {given.label} ({given.stated.what}) is also among the undetected effects of the diagnosis. Both "
                "contributions are included, so u is at most too large"
            )
