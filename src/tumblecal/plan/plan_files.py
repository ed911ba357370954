"""Files of a designed plan: a plan of `tumblecal capture` for each mounting, the rig for a calibration, plan.json."""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import chain, count, groupby
from pathlib import Path
from typing import Any

from tumblecal.capture.capture_plan import CaptureSetup
from tumblecal.ground.atomic import write_text
from tumblecal.ground.errors import InputError
from tumblecal.ground.json_file import json_text, read_json
from tumblecal.ground.strict_toml import toml_lines
from tumblecal.ground.suggested_command import suggested
from tumblecal.plan.designed_plan import DesignedPlan
from tumblecal.plan.record import SCHEMA, PlanRecord


RIG = "rig.toml"
# Settings whose errors a designed plan indexes by visit.
_SETTINGS = ("dbeta", "dtheta")


def write_files(
    folder: Path,
    plan: DesignedPlan,
    content: Mapping[str, Any],
    lines: Sequence[str],
    assumptions: Sequence[tuple[str, str]],
) -> list[str]:
    """Write the plan without its page; returns the names of the files.

    **Arguments:**

    - `content`: of the rig file. `lines`, `assumptions`: for the record.
    """
    texts = {name: capture_text(plan, name, folder) for name in capture_files(plan)}
    texts[RIG] = rig_text(plan, content)
    texts["plan.json"] = json_text(PlanRecord.of(plan, files=list(texts), words=lines, assumptions=assumptions))
    for name, text in texts.items():
        write_text(folder / name, text)
    return list(texts)


def earlier_files(folder: Path) -> list[str]:
    """Names of the files of an earlier plan in a folder, and of the page; other plans of capture there are kept."""
    names, record = ["plan.json", "plan.html"], None
    with suppress(InputError):
        record = read_json(folder / names[0])
    if isinstance(record, dict) and record.get("schema") == SCHEMA and isinstance(record.get("files"), list):
        names += [name for name in record["files"] if isinstance(name, str) and re.fullmatch(r"[\w-]+\.toml", name)]
    return names


def capture_files(plan: DesignedPlan) -> dict[str, list[int]]:
    """The new positions of each visit of a mounting, by the name of its plan."""
    files = dict[str, list[int]]()
    visit, mounts = plan.after.schedule.mount_visit, plan.cells.mounts
    for _, rows in groupby(range(plan.measured, len(mounts)), key=lambda row: visit[row]):
        listed = list(rows)
        stem = f"plan_{re.sub(r'[^A-Za-z0-9-]+', '_', mounts[listed[0]])}"
        names = chain([f"{stem}.toml"], (f"{stem}_{number}.toml" for number in count(2)))
        files[next(name for name in names if name not in files)] = listed
    return files


def capture_text(plan: DesignedPlan, name: str, folder: Path) -> str:
    """The plan of `tumblecal capture` with this name, for a folder."""
    rows, run, times = capture_files(plan)[name], run_folder(name), plan.ability.times
    mount = plan.cells.mounts[rows[0]]
    rotation = plan.rig.mounts.get(mount)
    angles = ", ".join(f"{angle:g}" for angle in rotation or ())
    turned = f", rotated by {angles} deg about x, y, z" if any(rotation or ()) else ""
    comments = [
        f"Positions of mounting {mount}{turned}; designed by tumblecal plan. Measure them in this order.",
        "Correct [port] first, and add the site (gravity scales every reading): [site] latitude_deg = 48.1, height_m = 520",
        suggested("capture", folder / name, "--out", run, "--port", "PORT"),
        suggested("reduce", run),
    ]
    content = {
        "session": {"title": plan.rig.title, "mount": mount},
        "port": CaptureSetup().port.model_dump(include={"protocol"}),
        "dwell": {"seconds": float(times.dwell_s), "settle_s": float(times.settle_s)},
        "positions": {
            "mount_rotation_deg": None if rotation is None else list(map(float, rotation)),
            "listed": [{**plan.positions[row], "mount": None} for row in rows],
        },
    }
    return "\n".join([*(f"# {comment}" for comment in comments), "", *toml_lines(content)])


def run_folder(plan_file: str) -> Path:
    """The folder of the capture of a plan: `plan_A.toml` is captured into `run_A`."""
    return Path(plan_file.replace("plan_", "run_", 1).removesuffix(".toml"))


def rig_text(plan: DesignedPlan, content: Mapping[str, Any]) -> str:
    """The rig file of the plan: that of the head, with the positions and the errors of settings by visit.

    **Arguments:**

    - `content`: of the rig file of the head.
    """
    rig, chain_of_head, times = plan.rig, content.get("chain", {}), plan.rig.plan.time_s or ()
    leaves = {name: {"by": rig.leaves[name].by, "free": rig.leaves[name].free} for name in _SETTINGS}
    priors = {name: f"{rig.priors[name][1]!r} rad" for name in _SETTINGS if name in rig.priors}
    truth = {name: {"value": list(rig.truth[name]), "unit": "rad"} for name in _SETTINGS if name in rig.truth}
    other_priors, other_truth = (
        {name: given for name, given in content.get(table, {}).items() if name.partition("_")[0] not in _SETTINGS}
        for table in ("priors", "truth")
    )
    head = dict(content.get("head", {}))
    if "repeatability" in head and rig.ability:
        spread = vars(rig.ability.repeatability)
        head["repeatability"] = {key: text for key, text in head["repeatability"].items() if spread[key] is not None}
    new = dict(content) | {
        "plan": {"positions": [one | {"time_s": time} for one, time in zip(plan.positions, times, strict=True)]},
        "chain": {**chain_of_head, "leaves": {**chain_of_head.get("leaves", {}), **leaves}},
        "priors": other_priors | priors,
        "truth": other_truth | truth,
        "head": head,
    }
    if rig.temperature.leaves:
        degc, limits = rig.temperature.reference_degc, rig.temperature.range_degc or ()
        new["temperature"] = {**content.get("temperature", {}), "reference_degc": degc, "range_degc": limits}
    comment = [
        "# Designed by tumblecal plan, for `tumblecal simulate`, `study` and `calibrate --rig`, which states the planned",
        "# uncertainties. dbeta and dtheta have a value for each visit of a setting.",
    ]
    return "\n".join([*comment, *toml_lines({name: value for name, value in new.items() if value != {}})]) + "\n"
