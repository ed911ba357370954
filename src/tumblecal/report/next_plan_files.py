"""The next positions as files to work with: a plan of `tumblecal capture` for each mounting, and a rig for the analysis."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from tumblecal.capture.capture_plan import SETUP, CaptureSetup, PortTable, setup_of_comment
from tumblecal.data.positions import joined_arguments
from tumblecal.diagnosis import Diagnosis
from tumblecal.ground.errors import one_line
from tumblecal.ground.strict_toml import toml_table
from tumblecal.ground.suggested_command import EVERY, suggested
from tumblecal.planning.conditions import Conditions
from tumblecal.planning.next_plan import NextPlan, NextPosition
from tumblecal.planning.proposals import SIDES
from tumblecal.report.rig_files import cells, next_rig_text


PLAN = "next_positions"
RIG = "next_rig.toml"
_KEPT = "[session], [port], [dwell], [limits], [soak] and [chamber] are those of the first measurement."
_UNKNOWN = (
    "The data do not state how they were captured. [port] and [dwell] are the defaults of capture; correct them first."
)
# Labels of new mountings in the files.
LABELS = {side: f"turned_{side.rpartition(' ')[2]}" for side in SIDES}


def next_plan_texts(diagnosis: Diagnosis, plan: NextPlan, folder: Path) -> dict[str, str]:
    """The plans of the next positions for a folder, and the rig that analyses old and new positions of several mountings, by
    the names of their files; none where nothing is proposed."""
    # Hands follow words, no plan of a head.
    together, texts = [position for position in plan.together if not position.direction], {}
    for side in ("", *SIDES):
        if chosen := [position for position in together if position.mount == side]:
            texts[_plan_name(side)] = plan_text(diagnosis, plan, chosen, side, folder)
    if any(position.mount for position in together) and not plan.from_rig:
        texts[RIG] = next_rig_text(diagnosis, plan, _labels(diagnosis))
    return texts


def plan_text(diagnosis: Diagnosis, plan: NextPlan, chosen: Iterable[NextPosition], side: str, folder: Path) -> str:
    """A plan of `tumblecal capture` for the positions of one mounting, for a folder; one pitch setting after the
    other."""
    data, setup = diagnosis.data, _setup(diagnosis)
    mount, captured = _labels(diagnosis)[side], setup_of_comment(data.comments.get(SETUP))
    supposed, site = plan.conditions if plan.together else None, data.gravity
    conditions = "" if plan.conditions is None else conditions_words(plan.conditions).removeprefix(", ")
    comments = [
        f"Measure next, to {plan.purpose}; proposed by tumblecal diagnose.",
        *([f"Measure these positions {conditions}, in this order."] if conditions else []),
        *([f"The triad {side} in its fixture."] if side else []),
        _KEPT if captured else _UNKNOWN,
        *map(one_line, _commands(diagnosis, plan, side, folder)),
    ]
    session = {"title": f"next positions for {data.source}", "mount": mount, "run": (data.run or ("1",))[-1]}
    tables = {
        "session": session | setup.stated("session"),
        "port": setup.stated("port") | {"serial_number": data.serial_number or None},
        "site": {"gravity_ms2": site.value_ms2} if site and not site.assumed else {},
        "dwell": setup.stated("dwell"),
        "limits": setup.stated("limits"),
        "soak": setup.stated("soak"),
        "chamber": setup.stated("chamber"),
        "conditions": {} if supposed is None else _conditions(supposed),
        "positions": {"mount_rotation_deg": SIDES[side] if side else setup.mount_rotation_deg or None},
    }
    lines = [*(f"# {comment}" for comment in comments), ""]
    for name, values in tables.items():
        if name == "port" or any(value is not None for value in values.values()):
            lines += toml_table(name, values)
    angles = [(one.alpha_deg, one.beta_deg) for one in chosen] if plan.in_reverse else cells(chosen)
    for number, (alpha, beta) in enumerate(angles, start=1):
        name = f"next-{mount}-{number}" if side else f"next-{number}"
        lines += toml_table(
            "[positions.listed]", {"name": name, "alpha_deg": round(alpha, 9), "beta_deg": round(beta, 9)}
        )
    return "\n".join(lines)


def _conditions(conditions: Conditions) -> dict[str, float]:
    """The table of the conditions, as far as the data state any."""
    names = ("after_s", "step_s", "temperature_degc") if conditions.after_s is not None else ("temperature_degc",)
    return {name: round(value, 3) for name in names if (value := getattr(conditions, name)) is not None}


def conditions_words(conditions: Conditions) -> str:
    """Time and temperature for which the new positions are evaluated; "" where the data state neither."""
    when = ""
    if conditions.after_s is not None:
        waited = f", {_duration(conditions.after_s)} after the last position"
        when = waited if conditions.waited else ", directly after this measurement"
    if conditions.temperature_degc is None or conditions.last_degc is None:
        return when
    at = f"{conditions.temperature_degc:.1f} degC"
    if conditions.at_another_temperature:
        return f"{when}, at {at} (last position: {conditions.last_degc:.1f} degC)"
    return f"{when}, at about {at}, as at the end"


def _duration(seconds: float) -> str:
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * size:
            return f"{round(seconds / size, 1 if seconds < 10 * size else None):g} {unit}"
    return f"{seconds:.0f} s"


def next_commands(diagnosis: Diagnosis, plan: NextPlan, folder: Path) -> list[str]:
    """The commands that measure the plans of all mountings, written into a folder, and diagnose old and new positions."""
    positions = [position for position in plan.together if not position.direction]
    sides = [side for side in ("", *SIDES) if any(position.mount == side for position in positions)]
    listed = (command for side in sides for command in _commands(diagnosis, plan, side, folder))
    return list(dict.fromkeys(listed))


def _commands(diagnosis: Diagnosis, plan: NextPlan, side: str, folder: Path) -> Iterator[str]:
    """The commands that measure a plan, and then diagnose old and new positions together."""
    new, setup = Path(f"next{f'_{LABELS[side]}' if side else ''}"), _setup(diagnosis)
    yield suggested(
        *("capture", folder / _plan_name(side), "--out", new), *([] if setup.port.url else ["--port", "PORT"])
    )
    yield suggested("reduce", new, less=EVERY)
    whole = joined_arguments([*(diagnosis.data.files or [diagnosis.data.source]), str(new / "positions.csv")])
    yield suggested("diagnose", *whole, *(["--rig", folder / RIG] if side and not plan.from_rig else []))


def _setup(diagnosis: Diagnosis) -> CaptureSetup:
    """How the data were captured, as far as they state it."""
    comments = diagnosis.data.comments
    port = PortTable(protocol=comments["protocol"]) if comments.get("protocol") else PortTable()
    return setup_of_comment(comments.get(SETUP)) or CaptureSetup(port=port)


def _plan_name(side: str) -> str:
    return f"{PLAN}{f'_{LABELS[side]}' if side else ''}.toml"


def _labels(diagnosis: Diagnosis) -> dict[str, str]:
    """The label of each mounting: that of the last position for the present mounting, new ones for new mountings."""
    there = diagnosis.data.mount or ("1",)
    labels = {"": there[-1]}
    for side, label in LABELS.items():
        names = (label, *(f"{label}_{number}" for number in range(2, len(there) + 3)))
        labels[side] = next(name for name in names if name not in there)
    return labels
