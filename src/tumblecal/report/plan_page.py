"""`plan.html`: a designed plan on one page."""

from collections.abc import Iterator
from pathlib import Path

from tumblecal.design.plan import DesignedPlan
from tumblecal.report.page import PageFigure, Section, chosen, inline_each, page, write_page
from tumblecal.report.plan_files import capture_commands
from tumblecal.report.plan_tables import (
    assumption_table,
    effect_table,
    limit_table,
    named_table,
    position_table,
    practice_table,
    uncertainty_table,
)
from tumblecal.report.plan_words import (
    before_words,
    effect_details,
    efficiency_lines,
    in_use_size,
    in_use_words,
    practice_lines,
    probability_words,
    size_words,
    u_words,
    uncertainty_words,
    undetectable_lines,
    undetermined_lines,
)
from tumblecal.report.verdict import Finding, Unresolved, Verdict, as_sentence
from tumblecal.show.figures.drawing import in_card
from tumblecal.show.figures.plan import FIGURES, in_use_figure, uncertainty_figure


_CAPTIONS = {
    "sphere": "Direction of the specific force in the axes of the sensor, at equal areas. Circles: every 30 °.",
    "uncertainties": "Filled: this plan. Open: without it.",
    "in_use": "Standard uncertainty of the corrected force that a fraction of all attitudes does not exceed. Solid: this plan. "
    "Dashed: without it.",
    "trade_off": "Plans designed for other numbers of positions (numbers at the points), on the same head.",
    "order": "Start of each dwell.",
}


@page
def write_plan_page(path: Path, plan: DesignedPlan) -> None:
    """Write the page."""
    write_page(
        path,
        f"Plan for {plan.rig.title or Path(plan.rig.source).name}",
        f"{size_words(plan)}.",
        _verdict(plan, path.parent),
        _sections(plan, inline_each(path, plan, FIGURES, _CAPTIONS)),
        tone="named",
        pictures={
            1: lambda: in_card(uncertainty_figure(plan), 2.3),
            2: lambda: in_card(in_use_figure(plan), 2.0),
        },
    )


def _verdict(plan: DesignedPlan, folder: Path) -> Verdict:
    name, u = plan.after.worst(plan.determined)
    found = [
        Finding("Standard uncertainties", f"at most {u_words(name, u)}", name),
        Finding("Uncertainty of the corrected force in use", in_use_size(plan)),
        *(Finding(f"{each.id} of {each.size:g} {each.unit}", probability_words(each), each.id)
          for each in plan.after.effects),
        *(Finding(*line.split(": ", 1)) for line in undetectable_lines(plan)),
    ]  # fmt: skip
    return Verdict(
        "plan",
        f"{as_sentence(uncertainty_words(plan, plan.after))}.",
        plan.rig.source,
        found=tuple(found),
        unresolved=(
            *(
                Unresolved(as_sentence(words), findings=(number,))
                for number, each in enumerate(plan.after.effects, 3)
                for words in effect_details(each)
            ),
            *(Unresolved(f"{line}.") for line in undetermined_lines(plan)),
        ),
        evidence=tuple(f"{line}." for line in (before_words(plan), *efficiency_lines(plan), *practice_lines(plan))),
        next=(
            "Measure the plans of the mountings in this order, and calibrate with the rig of the plan:",
            *capture_commands(plan, folder),
        ),
    )


def _sections(plan: DesignedPlan, drawn: dict[str, PageFigure]) -> Iterator[Section]:
    yield Section("Positions", tables=[position_table(plan)], figures=chosen(drawn, "sphere", "order"))
    yield Section("Uncertainties", tables=[uncertainty_table(plan)], figures=chosen(drawn, "uncertainties"))
    yield Section("Uncertainty in use", words=[f"{in_use_words(plan)}."], figures=chosen(drawn, "in_use"))
    yield Section(
        "Common practice",
        words=[
            "The same head in the same time: positions are repeated in each mounting until the time is used. Ratio: largest "
            "standard uncertainty, divided by that of this plan. Undetectable: number of effects, including those that no "
            "positions of this head show. Deviation: largest angle between the intended direction and the nearest one that "
            "the head can set."
        ],
        tables=[practice_table(plan)],
    )
    if plan.forecast is not None:
        yield Section(
            "Effects",
            words=[
                "Forecast of tumblecal diagnose; limits and smallest sizes are for a probability of 0.8. Named: alone, or with "
                "effects of the same signal. Identified: the verdict has this name.",
                *(f"{line}." for line in undetectable_lines(plan)),
            ],
            tables=[*([effect_table(plan), named_table(plan)] if plan.after.effects else []), limit_table(plan)],
        )
    if plan.traded:
        yield Section("Trade-off", figures=chosen(drawn, "trade_off"))
    yield Section("Assumptions", tables=[assumption_table(plan)])
