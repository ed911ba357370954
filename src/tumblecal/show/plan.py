"""A designed plan for people: its words, `plan.html`, and its lines and tables on a terminal."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from tumblecal.ground.units import factor
from tumblecal.plan.bound import GOOD
from tumblecal.plan.designed_plan import DesignedPlan
from tumblecal.plan.plan_files import capture_files, run_folder, write_files
from tumblecal.plan.responses import MOUNT, PITCH
from tumblecal.show.figures.plan import FIGURES
from tumblecal.show.narrow import print_table, print_words
from tumblecal.show.page import write_page
from tumblecal.show.words import Words, words_of


# Tables on a terminal.
_PRINTED = ("uncertainties", "practice", "named")


def words_of_plan(plan: DesignedPlan, folder: Path) -> Words:
    """The words of a plan in this folder."""
    ability, positions = plan.ability, plan.positions[plan.measured :]
    runs = {name: run_folder(name) for name in capture_files(plan)}
    relevant = {"remount_s": len(ability.mounts) > 1, "temperature_change_s": bool(ability.temperatures_degc)}
    times = [key.removeprefix("times.") for key in ability.assumed if key.startswith("times.")]
    comparable = [each for each in plan.practice if each.fits and not each.missing]
    return words_of(
        "plan",
        plan=plan,
        source=Path(plan.rig.source).name,
        folder=folder,
        positions=positions,
        starts=plan.after.schedule.start_s[plan.measured :],
        mountings=len({position["mount"] for position in positions}),
        units={name: each["unit"] for name, each in plan.parameters.items()},
        without="positions measured already" if plan.measured else "plan of the rig file",
        plans=[plan.after, plan.before, *plan.practice],
        best=min(comparable, key=plan.ratio, default=None),
        good=GOOD,
        runs=runs,
        data=[run / "positions.csv" for run in runs.values()],
        assumed_times=[key for key in times if relevant.get(key, True)],
        settings=[
            ("pitch", PITCH, "pitch setting", plan.responses.pitch),
            ("mount", MOUNT, "mounting", plan.responses.mount),
        ],
        arcmin=factor("rad", "arcmin"),
        finite=np.isfinite,
    )


def plan_lines(words: Words) -> Iterator[str]:
    """The findings, the most important first."""
    about = words.verdict
    yield f"{words.text('lead')} {about.headline}"
    yield from (question.words for question in about.unresolved if not question.findings)
    yield from about.evidence
    for number, finding in enumerate(about.found[1:], 2):
        questions = [
            f"{one.words}{one.reason and ': '}{one.reason}." for one in about.unresolved if number in one.findings
        ]
        yield " ".join([f"{finding.sentence}.", *questions])
    yield from (f"Assumed: {assumed}. Override with {key}." for assumed, key in words.pairs("assumptions")[1:])


def print_plan(words: Words) -> None:
    """Print a designed plan: findings, uncertainties, comparison, and the commands that measure it."""
    console = Console()
    print_words(console, f"\n{words.text('title')}", style="bold")
    for line in plan_lines(words):
        print_words(console, line)
    for name in _PRINTED:
        if table := words.table(name):
            print_words(console, "")
            print_table(console, table)
    instruction, *commands = words.lines("next")
    print_words(console, f"\n{instruction}")
    for command in commands:
        print_words(console, f"  {command}")


def write_plan(folder: Path, plan: DesignedPlan, content: Mapping[str, Any], words: Words) -> list[str]:
    """Write all files of a plan; `content`: of the rig file. Returns their names."""
    names = write_files(folder, plan, content, list(plan_lines(words)), words.pairs("assumptions")[1:])
    return names + write_page(folder / "plan.html", words, FIGURES, plan)
