"""The next positions as files to work with: a plan of `tumblecal capture` for each mounting, and a rig for the analysis."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from tumblecal.capture.capture_plan import SETUP, CaptureSetup, PortTable, setup_of_comment
from tumblecal.data.positions import joined_arguments
from tumblecal.diagnosis import Diagnosis
from tumblecal.ground.atomic import write_text
from tumblecal.ground.errors import one_line
from tumblecal.ground.strict_toml import toml_string
from tumblecal.ground.suggested_command import EVERY, suggested
from tumblecal.planning.conditions import Conditions
from tumblecal.planning.next_plan import NextPlan, NextPosition
from tumblecal.planning.proposals import SIDES
from tumblecal.report.rig_text import SCHEMA, leaf_table, mount_tables, position_table


PLAN = "next_positions"
RIG = "next_rig.toml"
_KEPT = "[session], [port], [dwell] and [limits] are those of the first measurement."
_UNKNOWN = (
    "The data do not state how they were captured. [port] and [dwell] are the defaults of capture; correct them first."
)
# Labels of new mountings in the files.
LABELS = {side: f"turned_{side.rpartition(' ')[2]}" for side in SIDES}


def write_next_plan(folder: Path, diagnosis: Diagnosis, plan: NextPlan) -> list[str]:
    """Write the plans of the next positions, and the rig that analyses old and new positions of several mountings.

    **Returns:** the names of the files; none where nothing is proposed. Plans of an earlier diagnosis are removed.
    """
    # Hands follow words, no plan of a head.
    together, names = [position for position in plan.together if not position.direction], []
    for old in (
        *(folder / f"{PLAN}{end}.toml" for end in ("", *(f"_{label}" for label in LABELS.values()))),
        folder / RIG,
    ):
        old.unlink(missing_ok=True)
    for side in ("", *SIDES):
        chosen = [position for position in together if position.mount == side]
        if chosen:
            names.append(_plan_name(side))
            write_text(folder / names[-1], plan_text(diagnosis, plan, chosen, side, folder))
    if any(position.mount for position in together) and not plan.from_rig:
        names.append(RIG)
        write_text(folder / RIG, rig_text(diagnosis, plan))
    return names


def plan_text(diagnosis: Diagnosis, plan: NextPlan, chosen: Iterable[NextPosition], side: str, folder: Path) -> str:
    """A plan of `tumblecal capture` for the positions of one mounting, for a folder; one pitch setting after the
    other."""
    data, setup = diagnosis.data, _setup(diagnosis)
    mount, stated = _label(diagnosis, side), setup_of_comment(data.comments.get(SETUP))
    conditions = "" if plan.conditions is None else conditions_words(plan.conditions).removeprefix(", ")
    lines = [
        f"# Measure next, to {plan.purpose}; proposed by tumblecal diagnose.",
        *([f"# Measure these positions {conditions}, in this order."] if conditions else []),
        f"# {_KEPT if stated else _UNKNOWN}",
        *(f"# {one_line(command)}" for command in _commands(diagnosis, plan, side, folder)),
        "",
        "[session]",
        f"title = {toml_string(f'next positions for {data.source}')}",
        f"mount = {toml_string(mount)}",
        f"run = {toml_string((data.run or ('1',))[-1])}",
        *setup.lines("session"),
        "",
        "[port]",
        *setup.lines("port"),
        *([f"serial_number = {toml_string(data.serial_number)}"] if data.serial_number else []),
        "",
        *(
            ["[site]", f"gravity_ms2 = {data.gravity.value_ms2!r}", ""]
            if data.gravity and not data.gravity.assumed
            else []
        ),
        "[dwell]",
        *setup.lines("dwell"),
        "",
        *(["[limits]", *limits, ""] if (limits := [*setup.lines("limits")]) else []),
        *(["[conditions]", *supposed, ""] if (supposed := _conditions(plan)) else []),
    ]
    if side:
        lines += [f"# The triad {side} in its fixture.", "[positions]", f"mount_rotation_deg = {list(SIDES[side])}", ""]
    elif setup.mount_rotation_deg:
        lines += ["[positions]", f"mount_rotation_deg = {setup.mount_rotation_deg}", ""]
    cells = [(one.alpha_deg, one.beta_deg) for one in chosen] if plan.in_reverse else _cells(chosen)
    for number, (alpha, beta) in enumerate(cells, start=1):
        name = f"next-{mount}-{number}" if side else f"next-{number}"
        lines += [
            "[[positions.listed]]",
            f"name = {toml_string(name)}",
            f"alpha_deg = {round(alpha, 9)}",
            f"beta_deg = {round(beta, 9)}",
            "",
        ]
    return "\n".join(lines)


def _conditions(plan: NextPlan) -> list[str]:
    """Lines of the table of the conditions, as far as the data state any."""
    if plan.conditions is None or not plan.together:
        return []
    stated = {name: getattr(plan.conditions, name) for name in ("after_s", "step_s", "temperature_degc")}
    if plan.conditions.after_s is None:
        stated.pop("step_s")
    return [f"{name} = {round(value, 3)}" for name, value in stated.items() if value is not None]


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


def _label(diagnosis: Diagnosis, side: str) -> str:
    """The label of a mounting: that of the last position for the present mounting, a new one for a new mounting."""
    there = diagnosis.data.mount or ("1",)
    if not side:
        return there[-1]
    names = (LABELS[side], *(f"{LABELS[side]}_{number}" for number in range(2, len(there) + 3)))
    return next(name for name in names if name not in there)


def _cells(chosen: Iterable[NextPosition]) -> list[tuple[float, float]]:
    """Positions in the order of choice, those of one pitch setting together."""
    by_pitch: dict[float, list[tuple[float, float]]] = {}
    for position in chosen:
        cells = [(alpha, position.beta_deg) for alpha in (position.turn_deg or (position.alpha_deg,))]
        by_pitch.setdefault(position.beta_deg, []).extend(cells)
    return [cell for cells in by_pitch.values() for cell in cells]


def rig_text(diagnosis: Diagnosis, plan: NextPlan) -> str:
    """A rig with the old positions and the new ones, whose new mountings are turned as proposed."""
    data = diagnosis.data
    mounts, runs = data.mount or ("1",) * len(data), data.run or ("1",) * len(data)
    rows = list(zip(data.names, data.alpha_deg, data.beta_deg, mounts, runs, strict=True))
    for position in plan.together:
        label = _label(diagnosis, position.mount)
        for alpha, beta in _cells([position]):
            rows.append((f"next-{len(rows) - len(data) + 1}", alpha, beta, label, runs[-1]))
    turned = {_label(diagnosis, side): angles for side, angles in SIDES.items()}
    turned = {label: angles for label, angles in turned.items() if any(row[3] == label for row in rows)}
    angles = {label: diagnosis.mountings.get(label, (0.0, 0.0, 0.0)) for label in dict.fromkeys(mounts)} | turned
    by = {"dbeta": "run.mount.pitch" if len(set(runs)) > 1 else "mount.pitch", "dtheta": "mount"}
    fixed = [
        leaf.name for leaf in diagnosis.model.nominal_chain.parameters if not leaf.free and leaf.name != "levelling"
    ]
    lines = [
        "# The head with its old positions and those proposed by tumblecal diagnose, for --rig.",
        SCHEMA,
        f"title = {toml_string(f'{data.source} with the next positions')}",
        "",
    ]
    for name in dict.fromkeys((*by, *fixed)):
        lines += leaf_table(name, by.get(name), False if name in fixed else None)
    lines += mount_tables(angles)
    for name, alpha, beta, mount, run in rows:
        alpha, beta = (round(float(np.round(angle, 9)), 9) for angle in (alpha, beta))
        lines += position_table(name, alpha, beta, {"mount": mount, "run": run})
    return "\n".join(lines)
