"""Terminal output of `tumblecal thermal`."""

from rich.console import Console

from tumblecal.report.thermal_tables import coefficient_table, reference_table
from tumblecal.report.thermal_words import thermal_lines
from tumblecal.show.narrow import print_table, print_words
from tumblecal.thermal.result import ThermalResult


def print_thermal(result: ThermalResult, console: Console | None = None) -> None:
    """Print a temperature calibration: findings, parameters at the reference, coefficients."""
    console = console or Console()
    print_words(console, "")
    print_words(console, result.table.source, style="bold")
    for line in thermal_lines(result):
        print_words(console, line)
    if not result.calibration.use.refused:
        print_words(console, "")
        print_table(console, reference_table(result))
    if result.curves is not None:
        print_words(console, "")
        print_table(console, coefficient_table(result))
