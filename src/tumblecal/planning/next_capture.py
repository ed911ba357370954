"""The next positions for the bench: a plan of `tumblecal capture` for each mounting, and the commands that measure them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tumblecal.capture.capture_plan import SETUP, CaptureSetup, DwellTable, PortTable, setup_of_comment
from tumblecal.data.positions import joined_arguments
from tumblecal.diagnosis import Diagnosis
from tumblecal.ground.suggested_command import EVERY, suggested
from tumblecal.planning.next_plan import NextPlan
from tumblecal.planning.proposals import SIDES


# Of the time of a position, the share to settle at most.
_SETTLES = 0.2
# Labels of new mountings in the files.
LABELS = {side: f"turned_{side.rpartition(' ')[2]}" for side in SIDES}


@dataclass(frozen=True)
class NextCapture:
    """The plan of one mounting.

    - `side`: how the triad is turned, "" for the present mounting; `mount`: label of the mounting.
    - `file`: name of the plan; `out`: folder of its capture. `angles_deg`: spindle and pitch angle of each position, in order.
    """

    side: str
    mount: str
    file: str
    out: Path
    angles_deg: tuple[tuple[float, float], ...]


def next_captures(diagnosis: Diagnosis, plan: NextPlan) -> list[NextCapture]:
    """The plans of the next positions; none for a hand-held set, or if nothing is proposed."""
    data, captures = diagnosis.data, list[NextCapture]()
    mounts, folders = data.mount or ("1",), [Path(name).parent.name for name in data.files or (data.source,)]
    settings = plan.settings
    for side in dict.fromkeys(side for side, _ in settings):
        ending = f"_{LABELS[side]}" if side else ""
        angles = [(alpha, beta) for (of_side, beta), alphas in settings.items() if of_side == side for alpha in alphas]
        if plan.in_reverse:
            angles = [(position.alpha_deg, position.beta_deg) for position in plan.together]
        mount = _unused(LABELS[side], mounts) if side else mounts[-1]
        out = Path(_unused(f"next{ending}", folders))
        captures.append(NextCapture(side, mount, f"next_positions{ending}.toml", out, tuple(angles)))
    return captures


def _unused(name: str, used: Sequence[str]) -> str:
    """The name, with a number if it is used."""
    numbered = (f"{name}_{number}" for number in range(2, len(used) + 3))
    return next(one for one in (name, *numbered) if one not in used)


def setup_of(diagnosis: Diagnosis) -> CaptureSetup | None:
    """How the data were captured; None if they do not state it."""
    return setup_of_comment(diagnosis.data.comments.get(SETUP))


def _setup_or_defaults(diagnosis: Diagnosis) -> CaptureSetup:
    protocol = diagnosis.data.comments.get("protocol")
    return setup_of(diagnosis) or CaptureSetup(port=PortTable(protocol=protocol) if protocol else PortTable())


def capture_content(diagnosis: Diagnosis, plan: NextPlan, capture: NextCapture) -> dict[str, Any]:
    """The tables of the file of one mounting."""
    data, setup, conditions = diagnosis.data, _setup_or_defaults(diagnosis), plan.conditions
    content = {name: setup.stated(name) for name in ("session", "port", "dwell", "limits", "soak", "chamber")}
    run = (data.run or ("1",))[-1]
    content["session"] |= {"title": f"next positions for {data.source}", "mount": capture.mount, "run": run}
    if data.serial_number:
        content["port"]["serial_number"] = data.serial_number
    if data.gravity and not data.gravity.assumed:
        content["site"] = {"gravity_ms2": data.gravity.value_ms2}
    if conditions is not None:
        if conditions.step_s and setup_of(diagnosis) is None:
            # A position takes as long as those of the data.
            settle = min(DwellTable().settle_s, _SETTLES * conditions.step_s)
            content["dwell"] |= {"seconds": round(conditions.step_s - settle, 1), "settle_s": round(settle, 1)}
        times = ("after_s", "step_s") if conditions.after_s is not None else ()
        stated = {name: getattr(conditions, name) for name in (*times, "temperature_degc")}
        content["conditions"] = {name: round(value, 3) for name, value in stated.items() if value is not None}
    rotation = SIDES.get(capture.side, setup.mount_rotation_deg)
    stem = f"next-{capture.mount}" if capture.side else "next"
    content["positions"] = ({"mount_rotation_deg": rotation} if rotation else {}) | {
        "listed": [
            {"name": f"{stem}-{number}", "alpha_deg": round(alpha, 9), "beta_deg": round(beta, 9)}
            for number, (alpha, beta) in enumerate(capture.angles_deg, start=1)
        ]
    }
    return {name: table for name, table in content.items() if table or name == "port"}


def next_commands(diagnosis: Diagnosis, captures: Sequence[NextCapture], folder: Path) -> list[str]:
    """The commands that measure the plans in a folder, and then diagnose the old and all new positions together; none without
    plans."""
    port = [] if _setup_or_defaults(diagnosis).port.url else ["--port", "PORT"]
    commands = list[str]()
    for one in captures:
        commands.append(suggested("capture", folder / one.file, "--out", one.out, *port))
        commands.append(suggested("reduce", one.out, less=EVERY))
    measured = [str(one.out / "positions.csv") for one in captures]
    whole = joined_arguments([*(diagnosis.data.files or (diagnosis.data.source,)), *measured])
    return [*commands, suggested("diagnose", *whole)] if captures else []
