"""`tumblecal certificate`: calibration certificates, printed and digital."""

from dataclasses import replace
from pathlib import Path

from tumblecal.cli.options import Quiet
from tumblecal.cli.result_files import names_written, results
from tumblecal.cli.terminal import print_folded, warn
from tumblecal.ground.errors import InputError


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
    use_anyway: bool = False,
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
    from tumblecal.certificate.admin import item_elsewhere, measured_elsewhen, read_admin, read_limits, require_unit
    from tumblecal.certificate.results import results_of
    from tumblecal.ground.option_texts import numbers
    from tumblecal.show.certificate import words_of_certificate, write_certificate

    if folder.is_file():
        raise InputError(f"{folder}: a file; give the output folder of calibrate or diagnose, {folder.parent}")
    stated = read_admin(admin)
    source, sizes = read_limits(limits) if limits else ("", {})
    degc = sorted({*numbers("--temperatures", temperatures, "0,25,60")}) if temperatures is not None else ()
    certified = results_of(folder, budget, sizes, use_anyway=use_anyway, temperatures_degc=degc)
    calibration = certified.calibration
    require_unit(stated, admin, calibration, folder)
    elsewhere = item_elsewhere(stated.conditions, calibration.temperature_degc)
    certified = replace(certified, reservation=f"{certified.reservation} {elsewhere}".strip())
    elsewhen = measured_elsewhen(stated.performance, calibration, str(folder / "calibration.json"))
    out = out or folder
    with results(out, _SET, [admin, limits, budget]) as aside:
        write_certificate(aside, stated, certified, source)
    words = words_of_certificate(certified, admin, elsewhen, stated_degc=temperatures is not None)
    warn(folder, words.lines("warnings"))
    print_folded(
        "\n".join([*words.lines("statements"), f"{words.text('conformity')} {names_written(out, _SET)}".strip()])
    )
