"""`tumblecal certificate`: calibration certificates, printed and digital."""

import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.cli.output import Quiet
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.certificate.results import Results


_SET = ("certificate.html", "dcc.xml")


def certificate(
    folder: Path,
    /,
    *,
    admin: Path,
    limits: Path | None = None,
    budget: Path | None = None,
    temperatures: str | None = None,
    out: Path | None = None,
    use_anyway: Annotated[bool, Parameter(negative=())] = False,
    quiet: Quiet = False,
) -> None:
    """Write a calibration certificate to print (certificate.html, A4) and a digital certificate (dcc.xml, DCC of PTB).

    Parameters
    ----------
    folder
        Folder of calibrate or diagnose, with calibration.json.
    admin
        Statements of the laboratory (docs/certificate.md): numbers, addresses, dates, traceability, authorisation. Example:
        --admin configs/certificate_lab.toml.
    limits
        Limits of a data sheet, for a statement of conformity. Default: no statement. Example: --limits limits.toml.
    budget
        budget.json of the same data, with the expanded uncertainties to state. Default: that of the folder, if any. Example:
        --budget budget/budget.json.
    temperatures
        Temperatures (degC) at which values are stated, if the parameters follow temperature, separated by commas. Default:
        the reference temperature of the calibration. Example: --temperatures 0,25,60.
    out
        Output folder. Default: FOLDER. Example: --out certificates/A17.
    use_anyway
        Certificate for a calibration with `use: no` or `not tested`; the certificate states so. Default: an error.
    """
    from tumblecal.certificate.admin import item_elsewhere, measured_elsewhen, read_admin, read_limits
    from tumblecal.certificate.dcc import dcc_text
    from tumblecal.certificate.judged import head_covariance
    from tumblecal.certificate.results import VERDICTS, results_of
    from tumblecal.data.not_applied import losses_words
    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.data.uncertainty_parts import contribution_words
    from tumblecal.ground.atomic import write_text
    from tumblecal.ground.result_set import result_set
    from tumblecal.show.certificate import write_certificate

    if folder.is_file():
        raise InputError(f"{folder}: a file; give the output folder of calibrate or diagnose, {folder.parent}")
    stated = read_admin(admin)
    source, sizes = read_limits(limits) if limits else ("", {})
    degc = _temperatures(temperatures) if temperatures is not None else ()
    results = results_of(folder, budget, sizes, use_anyway=use_anyway, temperatures_degc=degc)
    calibrated, certified = results.calibration.serial_number, stated.item.serial_number
    if calibrated and certified and calibrated != certified:
        raise InputError(f"{admin}: item.serial_number is {certified}, but {folder} is of unit {calibrated}")
    if not calibrated and not certified:
        raise InputError(
            f"{admin}: no serial number. Add item.serial_number here, or `# serial_number: ...` to the data file"
        )
    elsewhere = item_elsewhere(stated.conditions, results.calibration.temperature_degc)
    results = replace(results, reservation=f"{results.reservation} {elsewhere}".strip())
    elsewhen = measured_elsewhen(stated.performance, results.calibration, str(folder / "calibration.json"))
    out = out or folder
    protect_inputs([admin, limits, budget], folders=[out], names=_SET)
    with result_set(out, _SET) as aside:
        write_certificate(aside / "certificate.html", stated, results, source)
        write_text(aside / "dcc.xml", dcc_text(stated, results, source))
    for words in _warnings(results, elsewhen and f"{elsewhen}; check performance.begin and end in {admin}"):
        print(f"WARNING: {folder}: {words}", file=sys.stderr)
    if not results.budgeted:
        included = contribution_words(
            results.calibration, "the measured head" if head_covariance(results.calibration) else ""
        )
        print(f"the uncertainties include {included}; run tumblecal budget to add type B contributions")
    print("\n".join([f"use: {results.calibration.use.words}", *losses_words(results.calibration.not_applied)]))
    if results.calibration.temperature is not None:
        default = "" if temperatures else " (the reference; --temperatures states others)"
        print(f"values at {', '.join(f'{degc:g}' for degc in results.temperatures_degc)} degC{default}")
    judged = f"conformity: {VERDICTS[results.conformity]}; " if results.conformity else ""
    print(f"{judged}written: {out}/: certificate.html, dcc.xml")


def _temperatures(text: str) -> list[float]:
    """The temperatures of `--temperatures`, degC, in increasing order.

    **Raises:** `InputError` for another text.
    """
    try:
        numbers = sorted({float(part) for part in text.split(",")})
    except ValueError:
        numbers = []
    if not numbers or not all(map(math.isfinite, numbers)):
        raise InputError(f"--temperatures {text}: write temperatures in degC separated by commas, such as 0,25,60")
    return numbers


def _warnings(results: "Results", elsewhen: str) -> Iterator[str]:
    """Warnings to the laboratory, to read before it signs."""
    gravity = results.calibration.gravity
    if gravity is None or gravity.assumed:
        yield "the gravity of the site is not stated; scale factors and values in m/s^2 depend on it"
    if elsewhen:
        yield elsewhen
    if results.other_noise:
        yield (
            f"the budget was {results.other_noise}; uncertainties and coverage factors are recomputed with those of the "
            "calibration, and differ from the page of the budget"
        )
    if results.reservation:
        yield f"the certificate states: {results.reservation}"
