"""Terminal output of `tumblecal plan`."""

from pathlib import Path

from rich.console import Console

from tumblecal.design.plan import DesignedPlan
from tumblecal.report.plan_files import capture_commands
from tumblecal.report.plan_tables import named_table, practice_table, uncertainty_table
from tumblecal.report.plan_words import plan_lines
from tumblecal.show.narrow import print_table, print_words


def print_plan(plan: DesignedPlan, folder: Path, console: Console | None = None) -> None:
    """Print a designed plan: findings, uncertainties, comparison, and the commands that measure it."""
    console = console or Console()
    print_words(console, "")
    print_words(console, plan.rig.source, style="bold")
    for line in plan_lines(plan):
        print_words(console, line)
    tables = [uncertainty_table(plan), practice_table(plan, short=True)]
    if plan.after.effects:
        tables.append(named_table(plan))
    for table in tables:
        print_words(console, "")
        print_table(console, table)
    print_words(console, "")
    print_words(console, "Next:")
    for command in capture_commands(plan, folder):
        print_words(console, f"  {command}")
