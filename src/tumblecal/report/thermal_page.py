"""`thermal.html`: a calibration over temperature on one page."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from tumblecal.ground.counted import counted
from tumblecal.ground.numbers_shown import changed
from tumblecal.ground.suggested_command import EVERY, suggested
from tumblecal.report.page import PageFigure, Section, chosen, inline_each, page, write_page
from tumblecal.report.thermal_tables import (
    coefficient_table,
    held_out_table,
    order_table,
    reference_table,
    temperature_table,
)
from tumblecal.report.thermal_words import (
    between_lines,
    combination_lines,
    improvement_lines,
    noise_lines,
    order_lines,
    range_words,
    separation_lines,
    signal_size,
    signal_words,
    total_improvement,
    undetermined_words,
)
from tumblecal.report.verdict import Finding, Unresolved, Verdict, as_sentence
from tumblecal.show.figures.thermal import FIGURES, small_figure
from tumblecal.thermal.result import ThermalResult


_BADGES = {"only": "usable in part", "not tested": "not tested", "no": "do not use"}
_TONES = {"only": "open", "not tested": "open", "no": "bad"}
_CAPTIONS = {
    "parameters": "Line: the calibration. Band: 95 % by its standard uncertainty u(T), with hysteresis. Dots and rings: "
    "estimates from the rows of one temperature and direction alone. Dotted line: reference temperature. For parameters whose "
    "value at the reference is not determined, the change is drawn.",
    "residuals": "Measured minus predicted, by axis, with the parameters at the reference temperature (left), and at the "
    "temperature of each row (right). Band: two standard deviations of the noise.",
    "hysteresis": "Residuals after the correction, mean over the attitudes, by direction. Lines: fitted branches for rising "
    "(solid) and falling (dashed) temperature. Half of their distance is the hysteresis.",
    "held_out": "Each part was predicted by a model that was chosen and fitted without it. Black line: noise of these rows.",
    "course": "Mean temperature of each row over time, by direction of change.",
}


@page
def write_thermal_page(path: Path, result: ThermalResult) -> None:
    """Write the page."""
    answer = result.calibration.use.answer or "yes"
    pictures = {min(1, len(result.signals)): partial(small_figure, result)} if result.curves is not None else {}
    write_page(
        path,
        f"Calibration over temperature of {_name(result.table.source)}",
        _lead(result),
        thermal_verdict(result, path.parent),
        _sections(result, inline_each(path, result, FIGURES, _CAPTIONS)),
        tone=_TONES.get(answer, "good"),
        pictures=pictures,
    )


def _name(source: str) -> str:
    """The first file without its folder, and the number of others: `a.csv and 5 more`."""
    first, joint, others = source.partition(" and ")
    return f"{Path(first).name}{joint}{others}"


def _lead(result: ThermalResult) -> str:
    table, serial = result.table, result.calibration.serial_number
    known = "known" if table.known_attitudes else "unknown"
    parts = [f"serial number {serial}"] if serial else []
    parts += [f"{counted(len(table.attitudes), f'{known} attitude')}", f"{counted(len(table), 'row')} over temperature"]
    return f"{', '.join(parts)}."


def thermal_verdict(result: ThermalResult, folder: Path) -> Verdict:
    """Use and improvement; signals that no correction includes as findings; values and effects that are not determined."""
    answer = result.calibration.use.answer or "yes"
    found = [
        Finding(f"{as_sentence(signal.name)}: no correction includes it", f"at most {signal_size(signal)}", signal.name)
        for signal in result.signals
    ]
    unresolved = []
    if missing := undetermined_words(result):
        unresolved.append(Unresolved(f"Not determined at the reference temperature: {', '.join(missing)}."))
    unresolved += [Unresolved(f"{line}.") for line in (*separation_lines(result), *combination_lines(result))]
    evidence = [range_words(result), *order_lines(result), *noise_lines(result)]
    return Verdict(
        _BADGES.get(answer, "usable"),
        _headline(result),
        result.table.source,
        result.calibration.use.words,
        tuple(found),
        tuple(unresolved),
        tuple(f"{line}." for line in evidence),
        tuple(next_lines(result, folder)),
    )


def _headline(result: ThermalResult) -> str:
    if result.curves is None:
        stated = 0 in result.choice.forced.values()
        return "Parameters stated as constant over temperature." if stated else "No dependence on temperature found."
    if (sizes := total_improvement(result)) is None:
        return "Improvement on held-out rows: not known."
    before, after, noise = sizes
    return f"Error on held-out rows: {changed(before, after)} mg rms with the dependence on temperature; noise {noise:.3g} mg."


def next_lines(result: ThermalResult, folder: Path) -> Iterator[str]:
    """Instructions, and commands to paste."""
    calibration = folder / "calibration.json"
    use = result.calibration.use
    if use.refused and not result.choice.model.free:
        yield (
            "To determine the values at the reference temperature, repeat the command with --calibration and the "
            "calibration.json of the unit at one temperature, or record six or more attitudes over the same temperatures."
        )
    elif use.refused:
        yield "Find the cause in the means of the bins:"
        yield suggested("diagnose", folder / "bins.csv", less=EVERY)
    if use.refused or use.untested:
        return
    if undetermined_words(result):
        yield "To determine all parameters, record nine or more attitudes, or add the calibration of the unit (--calibration)."
    yield "Correct a log with temperatures, write the calibration for a device, or write a certificate:"
    yield suggested("apply", calibration, "log.csv")
    yield suggested("export", calibration, "--to", "c-header")
    certificate = [folder, "--admin", "lab.toml"]
    if result.curves is not None:
        low, high = result.table.range_degc
        degc = sorted({float(np.ceil(low)), result.reference_degc, float(np.floor(high))})
        certificate.append(f"--temperatures={','.join(f'{each:g}' for each in degc)}")
    yield suggested("certificate", *certificate)


def _sections(result: ThermalResult, drawn: dict[str, PageFigure]) -> Iterator[Section]:
    if result.curves is not None:
        yield Section(
            "Parameters over temperature",
            words=["u is the standard uncertainty, with hysteresis. parameters.csv has a row for each temperature."],
            tables=[temperature_table(result)],
            figures=chosen(drawn, "parameters"),
        )
    yield Section("Residuals", figures=chosen(drawn, "residuals"))
    if result.held_out:
        yield Section(
            "Held-out rows",
            words=[
                "Errors are the root mean square over rows and axes.",
                *(f"{line}." for line in between_lines(result)),
            ],
            tables=[held_out_table(result)],
            figures=chosen(drawn, "held_out"),
        )
    elif words := [f"{line}." for line in improvement_lines(result)]:
        yield Section("Held-out rows", words=words)
    if result.signals:
        yield Section(
            "Signals that no correction includes",
            words=[f"{as_sentence(signal.name)}: {signal_words(signal)}." for signal in result.signals],
            figures=chosen(drawn, "hysteresis"),
        )
    yield Section("Orders", words=list(_criterion(result)), tables=[order_table(result)])
    yield Section(
        "Coefficients",
        words=[
            "Parameters at the reference temperature, and coefficients of T minus the reference. u is the standard uncertainty "
            "without hysteresis."
        ],
        tables=[
            *([] if result.calibration.use.refused else [reference_table(result)]),
            *([coefficient_table(result)] if result.curves is not None else []),
        ],
    )
    yield Section("Temperature over time", figures=chosen(drawn, "course"))


def _criterion(result: ThermalResult) -> Iterator[str]:
    gain = result.choice.constant_criterion - result.choice.criterion
    yield (
        "Orders are chosen by the Bayesian information criterion, and lowered if rows outside the fit do not confirm them. "
        f"Improvement over constant parameters: {gain:.0f}."
    )
