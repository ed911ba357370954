"""The next positions as files to work with: a plan of `tumblecal capture` for each mounting."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from tumblecal.capture.capture_plan import SETUP, CaptureSetup, DwellTable, PortTable, setup_of_comment
from tumblecal.data.positions import joined_arguments
from tumblecal.diagnosis import Diagnosis
from tumblecal.ground.errors import one_line
from tumblecal.ground.strict_toml import toml_table
from tumblecal.ground.suggested_command import EVERY, suggested
from tumblecal.planning.conditions import Conditions
from tumblecal.planning.next_plan import NextPlan, NextPosition
from tumblecal.planning.proposals import SIDES


PLAN = "next_positions"
_KEPT = "[session], [port], [dwell], [limits], [soak] and [chamber] are those of the first measurement."
_UNKNOWN = (
    "The data do not state how they were captured. [port] and [dwell] are the defaults of capture, with the time of a position "
    "as in the data if these state times; correct them first."
)
# Of the time of a position, the share to settle at most.
_SETTLES = 0.2
# Labels of new mountings in the files.
LABELS = {side: f"turned_{side.rpartition(' ')[2]}" for side in SIDES}


def next_plan_texts(diagnosis: Diagnosis, plan: NextPlan, folder: Path) -> dict[str, str]:
    """The plans of the next positions for a folder, by the names of their files; none where nothing is proposed."""
    # Hands follow words, no plan of a head.
    together, texts = [position for position in plan.together if not position.direction], {}
    for side in ("", *SIDES):
        if chosen := [position for position in together if position.mount == side]:
            texts[_plan_name(side)] = plan_text(diagnosis, plan, chosen, side, folder)
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
        *map(one_line, next_commands(diagnosis, plan, folder)),
    ]
    session = {"title": f"next positions for {data.source}", "mount": mount, "run": (data.run or ("1",))[-1]}
    tables = {
        "session": session | setup.stated("session"),
        "port": setup.stated("port") | {"serial_number": data.serial_number or None},
        "site": {"gravity_ms2": site.value_ms2} if site and not site.assumed else {},
        "dwell": setup.stated("dwell") | ({} if captured or supposed is None else _dwell(supposed)),
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
    angles = [(one.alpha_deg, one.beta_deg) for one in chosen] if plan.in_reverse else _cells(chosen)
    for number, (alpha, beta) in enumerate(angles, start=1):
        name = f"next-{mount}-{number}" if side else f"next-{number}"
        lines += toml_table(
            "[positions.listed]", {"name": name, "alpha_deg": round(alpha, 9), "beta_deg": round(beta, 9)}
        )
    return "\n".join(lines)


def _cells(chosen: Iterable) -> list[tuple[float, float]]:
    """Angles (alpha, beta) of proposed positions in the order of choice, those of one pitch setting together."""
    by_pitch: dict[float, list[tuple[float, float]]] = {}
    for position in chosen:
        angles = [(alpha, position.beta_deg) for alpha in (position.turn_deg or (position.alpha_deg,))]
        by_pitch.setdefault(position.beta_deg, []).extend(angles)
    return [cell for angles in by_pitch.values() for cell in angles]


def _dwell(conditions: Conditions) -> dict[str, float]:
    """The dwell with which a position takes as long as those of the data; as usual where these state no times."""
    settle = min(DwellTable().settle_s, _SETTLES * conditions.step_s)
    seconds = {"seconds": conditions.step_s - settle, "settle_s": settle}
    return {name: round(value, 1) for name, value in seconds.items()} if conditions.step_s else {}


def _conditions(conditions: Conditions) -> dict[str, float]:
    """The table of the conditions, as far as the data state any."""
    names = ("after_s", "step_s", "temperature_degc") if conditions.after_s is not None else ("temperature_degc",)
    return {name: round(value, 3) for name in names if (value := getattr(conditions, name)) is not None}


def conditions_words(conditions: Conditions) -> str:
    """Time and temperature for which the new positions are evaluated; "" where the data state neither."""
    when = ""
    if conditions.after_s is not None:
        waited = f", {duration(conditions.after_s)} after the last position"
        when = waited if conditions.waited else ", directly after this measurement"
    if conditions.temperature_degc is None or conditions.last_temperature_degc is None:
        return when
    at = f"{conditions.temperature_degc:.1f} degC"
    if conditions.at_another_temperature:
        return f"{when}, at {at} (last position: {conditions.last_temperature_degc:.1f} degC)"
    return f"{when}, at about {at}, as at the end"


def duration(seconds: float) -> str:
    """A time in words, s, min or h."""
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * size:
            return f"{round(seconds / size, 1 if seconds < 10 * size else None):g} {unit}"
    return f"{seconds:.0f} s"


def next_commands(diagnosis: Diagnosis, plan: NextPlan, folder: Path) -> list[str]:
    """The commands that measure the plans of all mountings, written into a folder, and then diagnose the old positions and all
    new ones together."""
    sides = {position.mount for position in plan.together if not position.direction}
    old = diagnosis.data.files or (diagnosis.data.source,)
    folders = [Path(name).parent.name for name in old]
    names = {side: f"next_{LABELS[side]}" if side else "next" for side in ("", *SIDES) if side in sides}
    new = {side: Path(_unused(name, folders)) for side, name in names.items()}
    port, commands = [] if _setup(diagnosis).port.url else ["--port", "PORT"], list[str]()
    for side, out in new.items():
        commands.append(suggested("capture", folder / _plan_name(side), "--out", out, *port))
        commands.append(suggested("reduce", out, less=EVERY))
    measured = [str(out / "positions.csv") for out in new.values()]
    whole = joined_arguments([*old, *measured])
    return [*commands, suggested("diagnose", *whole)] if new else []


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
    return labels | {side: _unused(label, there) for side, label in LABELS.items()}


def _unused(name: str, used: Sequence[str]) -> str:
    """The name, with a number if it is used."""
    numbered = (f"{name}_{number}" for number in range(2, len(used) + 3))
    return next(one for one in (name, *numbered) if one not in used)
