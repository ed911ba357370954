"""`tumblecal certificate`: a calibration for people and machines that must rely on it."""

import sys
from collections.abc import Iterator
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
    out: Path | None = None,
    use_anyway: Annotated[bool, Parameter(negative=())] = False,
    quiet: Quiet = False,
) -> None:
    """Write a calibration certificate to print (certificate.html, A4) and a digital one (dcc.xml, PTB's DCC).

    Parameters
    ----------
    folder
        Where calibrate or diagnose wrote calibration.json.
    admin
        What the laboratory states (docs/certificate.md): numbers, addresses, dates, traceability, who authorises.
    limits
        Limits of a data sheet: adds the statement of conformity.
    budget
        budget.json of the same data, whose expanded uncertainties are then stated; the folder's own where left out.
    out
        Folder to write to; the same one where left out.
    use_anyway
        Certify a calibration whose own judgement is that it must not be used (`use: no`); the judgement is on the certificate.
    """
    from tumblecal.certificate.admin import measured_elsewhen, read_admin, read_limits
    from tumblecal.certificate.dcc import dcc_text
    from tumblecal.certificate.judged import head_covariance
    from tumblecal.certificate.results import VERDICTS, results_of
    from tumblecal.data.not_applied import losses_words
    from tumblecal.data.overwriting import inputs_kept
    from tumblecal.data.uncertainty_parts import held_words
    from tumblecal.ground.atomic import write_text
    from tumblecal.ground.result_set import result_set
    from tumblecal.report.certificate_page import write_certificate

    if folder.is_file():
        raise InputError(f"{folder}: a file; give its folder, {folder.parent}, where calibrate or diagnose wrote it")
    stated = read_admin(admin)
    source, sizes = read_limits(limits) if limits else ("", {})
    results = results_of(folder, budget, sizes, use_anyway=use_anyway)
    own, theirs = results.calibration.serial_number, stated.item.serial_number
    if own and theirs and own != theirs:
        raise InputError(f"{admin}: item.serial_number is {theirs}, but {folder} is of unit {own}")
    if not own and not theirs:
        raise InputError(
            f"{admin}: item.serial_number is missing, and the data state none; a certificate is of one item"
        )
    elsewhen = measured_elsewhen(stated.performance, results.calibration, str(folder / "calibration.json"))
    out = out or folder
    inputs_kept([admin, limits, budget], folders=[out], names=_SET)
    with result_set(out, _SET) as aside:
        write_certificate(aside / "certificate.html", stated, results, source)
        write_text(aside / "dcc.xml", dcc_text(stated, results, source))
    for words in _warnings(results, elsewhen and f"{elsewhen}; look to performance.begin and end in {admin}"):
        print(f"WARNING: {folder}: {words}", file=sys.stderr)
    if not results.budgeted:
        held = held_words(results.calibration, "the measured head" if head_covariance(results.calibration) else "")
        print(f"the uncertainties are those of {held}; tumblecal budget adds what else is not exactly known")
    print("\n".join([f"use: {results.calibration.use.words}", *losses_words(results.calibration.not_applied)]))
    judged = f"conformity: {VERDICTS[results.conformity]}; " if results.conformity else ""
    print(f"{judged}written: {out}/: certificate.html, dcc.xml")


def _warnings(results: "Results", elsewhen: str) -> Iterator[str]:
    """What the laboratory must know before it signs."""
    gravity = results.calibration.gravity
    if gravity is None or gravity.assumed:
        yield "nobody stated the gravity of the site; scale factors and m/s^2 rest on it"
    if elsewhen:
        yield elsewhen
    if results.other_noise:
        yield (
            f"the budget was {results.other_noise}; uncertainties and coverage factors are computed anew with the "
            "calibration's, and differ from the budget's page"
        )
    if results.reservation:
        yield f"on the certificate stands: {results.reservation}"
