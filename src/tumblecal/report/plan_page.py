"""`plan.html`: a designed plan on one page."""

from collections.abc import Iterator
from pathlib import Path

from tumblecal.design.plan import DesignedPlan
from tumblecal.report.page import PageFigure, Section, inline_drawing, write_page
from tumblecal.report.plan_figures import figures_of, small_figure
from tumblecal.report.plan_files import capture_commands
from tumblecal.report.plan_tables import assumption_table, position_table, practice_table, uncertainty_table
from tumblecal.report.plan_words import before_words, in_use_words, practice_lines, size_words, uncertainty_words
from tumblecal.report.verdict import Finding, Verdict, as_sentence


_CAPTIONS = {
    "sphere": "Direction of the specific force in the axes of the sensor, at equal areas. Circles: every 30 °.",
    "uncertainties": "Filled: this plan. Open: without it.",
    "in_use": "Standard uncertainty of the corrected force that a fraction of all attitudes does not exceed. Solid: this plan. "
    "Dashed: without it.",
    "trade_off": "Plans designed for other numbers of positions (numbers at the points), on the same head.",
    "order": "Start of each dwell.",
}


def write_plan_page(path: Path, plan: DesignedPlan) -> None:
    """Write the page."""
    write_page(
        path,
        f"Plan for {plan.rig.title or Path(plan.rig.source).name}",
        f"{size_words(plan)}.",
        _verdict(plan, path.parent),
        list(_sections(plan)),
        tone="named",
        pictures={1: inline_drawing(small_figure(plan), "small")},
    )


def _verdict(plan: DesignedPlan, folder: Path) -> Verdict:
    name, _ = plan.after.worst
    evidence = [before_words(plan), *practice_lines(plan)]
    return Verdict(
        "plan",
        f"{as_sentence(uncertainty_words(plan.after))}.",
        plan.rig.source,
        found=(Finding("Standard uncertainties", "", name), Finding(in_use_words(plan))),
        evidence=tuple(f"{line}." for line in evidence),
        next=("Measure the plans of the mountings in this order, and calibrate with the rig of the plan:",
              *capture_commands(plan, folder)),
    )  # fmt: skip


def _sections(plan: DesignedPlan) -> Iterator[Section]:
    drawn = {name: PageFigure(inline_drawing(figure, name), _CAPTIONS[name]) for name, figure in figures_of(plan)}
    yield Section("Positions", tables=[position_table(plan)], figures=[drawn["sphere"], drawn["order"]])
    yield Section("Uncertainties", tables=[uncertainty_table(plan)], figures=[drawn["uncertainties"]])
    yield Section("Uncertainty in use", words=[f"{in_use_words(plan)}."], figures=[drawn["in_use"]])
    yield Section(
        "Common practice",
        words=[
            "The same head in the same time: positions are repeated in each mounting until the time is used. Deviation: "
            "largest angle between the intended direction and the nearest one that the head can set."
        ],
        tables=[practice_table(plan)],
    )
    if plan.traded:
        yield Section("Trade-off", figures=[drawn["trade_off"]])
    yield Section("Assumptions", tables=[assumption_table(plan)])
