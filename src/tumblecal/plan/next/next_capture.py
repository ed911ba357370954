"""The next positions for the bench: a plan of `tumblecal capture` for each mounting, and the commands that measure them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from tumblecal.capture.capture_plan import SETUP, CaptureSetup, DwellTable, PortTable, setup_of_comment
from tumblecal.data.positions import joined_arguments
from tumblecal.diagnosis import Diagnosis
from tumblecal.ground.suggested_command import EVERY, suggested
from tumblecal.plan.next.next_plan import NextPlan
from tumblecal.plan.next.proposals import SIDES


# Of the time of a position, the share to settle at most.
_SETTLES = 0.2
# Labels of new mountings in the files.
LABELS = {side: f"turned_{side.rpartition(' ')[2]}" for side in SIDES}


class NextCapture(NamedTuple):
    """The plan of one mounting.

    - `side`: how the triad is turned, "" for the present mounting. `file`, `content`: name and tables of the plan.
    - `out`: folder of its capture.
    """

    side: str
    file: str
    content: dict[str, Any]
    out: Path


def setup_of(diagnosis: Diagnosis) -> CaptureSetup | None:
    """How the data were captured; None if they do not state it."""
    return setup_of_comment(diagnosis.data.comments.get(SETUP))


def next_captures(diagnosis: Diagnosis, plan: NextPlan) -> list[NextCapture]:
    """The plans of the next positions; none for a hand-held set, or if nothing is proposed."""
    data, captures, settings = diagnosis.data, list[NextCapture](), plan.settings
    mounts, folders = data.mount or ("1",), [Path(name).parent.name for name in data.files or (data.source,)]
    common = _common(diagnosis, plan)
    for side in dict.fromkeys(side for side, _ in settings):
        angles = [(alpha, beta) for (of_side, beta), alphas in settings.items() if of_side == side for alpha in alphas]
        if plan.in_reverse:
            angles = [(position.alpha_deg, position.beta_deg) for position in plan.together]
        mount, ending = (_unused(LABELS[side], mounts), f"_{LABELS[side]}") if side else (mounts[-1], "")
        stem, setup = f"next-{mount}" if side else "next", setup_of(diagnosis)
        rotation = SIDES[side] if side else setup and setup.mount_rotation_deg
        listed = [
            {"name": f"{stem}-{number}", "alpha_deg": round(alpha, 9), "beta_deg": round(beta, 9)}
            for number, (alpha, beta) in enumerate(angles, start=1)
        ]
        positions = ({"mount_rotation_deg": rotation} if rotation else {}) | {"listed": listed}
        content = common | {"session": common["session"] | {"mount": mount}, "positions": positions}
        out = Path(_unused(f"next{ending}", folders))
        captures.append(NextCapture(side, f"next_positions{ending}.toml", content, out))
    return captures


def _common(diagnosis: Diagnosis, plan: NextPlan) -> dict[str, Any]:
    """The tables of all plans: those of the first capture, otherwise the defaults, with the time of a position as in the
    data."""
    data, captured, conditions = diagnosis.data, setup_of(diagnosis), plan.conditions
    protocol = data.comments.get("protocol")
    setup = captured or CaptureSetup(port=PortTable(protocol=protocol) if protocol else PortTable())
    content = {name: setup.stated(name) for name in ("session", "port", "dwell", "limits", "soak", "chamber")}
    content["session"] |= {"title": f"next positions for {data.source}", "run": (data.run or ("1",))[-1]}
    if data.serial_number:
        content["port"]["serial_number"] = data.serial_number
    if data.gravity and not data.gravity.assumed:
        content["site"] = {"gravity_ms2": data.gravity.value_ms2}
    if conditions is not None:
        if conditions.step_s and captured is None:
            settle = min(DwellTable().settle_s, _SETTLES * conditions.step_s)
            content["dwell"] |= {"seconds": round(conditions.step_s - settle, 1), "settle_s": round(settle, 1)}
        times = ("after_s", "step_s") if conditions.after_s is not None else ()
        stated = {name: getattr(conditions, name) for name in (*times, "temperature_degc")}
        content["conditions"] = {name: round(value, 3) for name, value in stated.items() if value is not None}
    return {name: table for name, table in content.items() if table or name == "port"}


def _unused(name: str, used: Sequence[str]) -> str:
    """The name, with `_2` if it is used."""
    return _unused(f"{name}_2", used) if name in used else name


def next_commands(diagnosis: Diagnosis, captures: Sequence[NextCapture], folder: Path) -> list[str]:
    """The commands that measure the plans in a folder, and then diagnose the old and all new positions together; none without
    plans."""
    commands = list[str]()
    for one in captures:
        port = [] if one.content["port"].get("url") else ["--port", "PORT"]
        commands.append(suggested("capture", folder / one.file, "--out", one.out, *port))
        commands.append(suggested("reduce", one.out, less=EVERY))
    measured = [str(one.out / "positions.csv") for one in captures]
    whole = joined_arguments([*(diagnosis.data.files or (diagnosis.data.source,)), *measured])
    return [*commands, suggested("diagnose", *whole)] if captures else []
