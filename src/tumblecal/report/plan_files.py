"""Files of a designed plan: a plan of `tumblecal capture` for each mounting, the rig for a calibration, plan.json."""

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.capture.capture_plan import CaptureSetup
from tumblecal.chain.rig_file import unit_of_parameter
from tumblecal.design.candidates import Evaluated
from tumblecal.design.forecast.naming import EffectForecast
from tumblecal.design.plan import DesignedPlan
from tumblecal.ground.atomic import write_text
from tumblecal.ground.errors import InputError
from tumblecal.ground.json_file import json_text, read_json
from tumblecal.ground.strict_toml import toml_lines, toml_table
from tumblecal.ground.suggested_command import EVERY, suggested
from tumblecal.report.plan_assumptions import assumptions
from tumblecal.report.plan_words import plan_lines


SCHEMA = "tumblecal.plan/1"
RIG = "rig.toml"
# Settings whose errors a designed plan indexes by visit.
_SETTINGS = ("dbeta", "dtheta")


def write_plan(folder: Path, plan: DesignedPlan, content: Mapping[str, Any]) -> list[str]:
    """Write the plan without its page; returns the names of the files.

    **Arguments:**

    - `content`: of the rig file.
    """
    texts = {name: capture_text(plan, rows, folder) for name, rows in capture_files(plan).items()}
    texts |= {RIG: rig_text(plan, content), "plan.json": json_text(plan_record(plan))}
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
    new = range(plan.measured, len(mounts))
    for _, rows in groupby(new, key=lambda row: visit[row]):
        listed = list(rows)
        stem = f"plan_{re.sub(r'[^A-Za-z0-9-]+', '_', mounts[listed[0]])}"
        names = (stem, *(f"{stem}_{number}" for number in range(2, len(mounts) + 2)))
        files[next(f"{name}.toml" for name in names if f"{name}.toml" not in files)] = listed
    return files


def capture_text(plan: DesignedPlan, rows: list[int], folder: Path) -> str:
    """A plan of `tumblecal capture` for some positions of one mounting, for a folder."""
    cells, times, mount = plan.cells, plan.ability.times, plan.cells.mounts[rows[0]]
    names = capture_files(plan)
    name = next(file for file, listed in names.items() if listed == rows)
    new = run_folder(name)
    rotation = plan.rig.mounts.get(mount)
    turned = "" if rotation is None or not any(rotation) else f", rotated by {_angles(rotation)} deg about x, y, z"
    comments = [
        f"Positions of mounting {mount}{turned}; designed by tumblecal plan. Measure them in this order.",
        "Correct [port] first, and add the site (gravity scales every reading): [site] latitude_deg = 48.1, height_m = 520",
        suggested("capture", folder / name, "--out", new, "--port", "PORT"),
        suggested("reduce", new, less=EVERY),
    ]
    setup = CaptureSetup()
    tables: dict[str, Mapping[str, Any]] = {
        "session": {"title": plan.rig.title, "mount": mount},
        "port": setup.port.model_dump(include={"protocol"}),
        "dwell": {"seconds": float(times.dwell_s), "settle_s": float(times.settle_s)},
    }
    if rotation is not None:
        tables["positions"] = {"mount_rotation_deg": list(map(float, rotation))}
    lines = [*(f"# {comment}" for comment in comments), ""]
    for table, values in tables.items():
        lines += toml_table(table, values)
    degc = cells.temperature_degc
    for row in rows:
        position = {
            "name": plan.names[row],
            "alpha_deg": _rounded(cells.alpha_deg[row]),
            "beta_deg": _rounded(cells.beta_deg[row]),
            "temperature_degc": None if degc is None else float(degc[row]),
        }
        lines += toml_table("[positions.listed]", position)
    return "\n".join(lines)


def run_folder(plan_file: str) -> Path:
    """The folder of the capture of a plan: `plan_A.toml` is captured into `run_A`."""
    return Path(plan_file.replace("plan_", "run_", 1).removesuffix(".toml"))


def rig_text(plan: DesignedPlan, content: Mapping[str, Any]) -> str:
    """The rig file of the plan: that of the head, with the positions and the errors of settings by visit.

    **Arguments:**

    - `content`: of the rig file of the head.
    """
    rig, new = plan.rig, dict(content)
    chain = dict(new.get("chain", {}))
    leaves = {name: {"by": leaf.by, "free": leaf.free} for name, leaf in rig.leaves.items() if name in _SETTINGS}
    stated = {name: {key: value for key, value in leaf.items() if value is not None} for name, leaf in leaves.items()}
    chain["leaves"] = dict(chain.get("leaves", {})) | stated
    priors = {name: text for name, text in new.get("priors", {}).items() if name not in _SETTINGS}
    priors |= {name: f"{rig.priors[name][1]!r} rad" for name in _SETTINGS if name in rig.priors}
    truth = {name: given for name, given in new.get("truth", {}).items() if name.partition("_")[0] not in _SETTINGS}
    truth |= {name: {"value": list(rig.truth[name]), "unit": "rad"} for name in _SETTINGS if name in rig.truth}
    head, spread = dict(new.get("head", {})), plan.rig.ability.repeatability if plan.rig.ability else None
    if "repeatability" in head and spread is not None:
        head["repeatability"] = {
            key: text for key, text in head["repeatability"].items() if getattr(spread, key) is not None
        }
    positions = [
        {
            "name": name,
            "alpha_deg": _rounded(rig.plan.alpha_deg[k]),
            "beta_deg": _rounded(rig.plan.beta_deg[k]),
            "mount": rig.plan.mounts[k],
            "time_s": (rig.plan.time_s or ())[k],
        }
        | ({} if rig.plan.temperature_degc is None else {"temperature_degc": rig.plan.temperature_degc[k]})
        for k, name in enumerate(rig.plan.names)
    ]
    new |= {"plan": {"positions": positions}, "chain": chain, "priors": priors, "truth": truth, "head": head}
    if rig.temperature.leaves:
        limits = {
            "reference_degc": rig.temperature.reference_degc,
            "range_degc": list(rig.temperature.range_degc or ()),
        }
        new["temperature"] = dict(new.get("temperature", {})) | limits
    comment = [
        "# Designed by tumblecal plan, for `tumblecal simulate`, `study` and `calibrate --rig`, which states the planned",
        "# uncertainties. dbeta and dtheta have a value for each visit of a setting.",
    ]
    kept = {name: value for name, value in new.items() if value != {}}
    return "\n".join([*comment, *toml_lines(kept)]) + "\n"


def plan_record(plan: DesignedPlan) -> dict[str, Any]:
    """The plan as plain numbers, lists and texts."""
    cells, schedule, wanted = plan.cells, plan.after.schedule, plan.wanted
    degc = cells.temperature_degc
    return {
        "schema": SCHEMA,
        "source": plan.rig.source,
        "files": [*capture_files(plan), RIG],
        "positions": [
            {
                "name": plan.names[k],
                "alpha_deg": _rounded(cells.alpha_deg[k]),
                "beta_deg": _rounded(cells.beta_deg[k]),
                "mount": cells.mounts[k],
                "temperature_degc": None if degc is None else float(degc[k]),
                "start_s": float(schedule.start_s[k]),
                "measured": k < plan.measured,
            }
            for k in range(len(cells))
        ],
        "minutes": plan.minutes,
        "pitch_visits": int(schedule.pitch_visit[-1]) + 1,
        "mount_visits": int(schedule.mount_visit[-1]) + 1,
        "criteria": dict(wanted.criteria),
        "order": wanted.order,
        "seed": wanted.seed,
        "parameters": {
            name: {"u": u, "u_before": before, "unit": unit_of_parameter(name, {}) or _unit(name)}
            for name, u, before in zip(
                plan.after.uncertainties.names,
                plan.after.uncertainties.sd.tolist(),
                plan.before.uncertainties.sd.tolist(),
                strict=True,
            )
        },
        "in_use_g": _in_use(plan.after),
        "criterion": {
            "value": plan.ordered.value,
            "slow_noise_known": plan.ordered.drift_known,
            "bound_white": None if plan.bounds is None else plan.bounds.repeated,
            "bound_one_visit": None if plan.bounds is None else plan.bounds.white,
            "bound_of_positions": None if plan.bounds is None else plan.bounds.own,
            "reason": None if plan.bounds is None else plan.bounds.reason or None,
        },
        "effects": [_effect(each) for each in plan.after.effects],
        "forecast": _forecast(plan),
        "before": _evaluated(plan, plan.before),
        "practice": [_evaluated(plan, each) for each in plan.practice],
        "trade_off": [
            {"positions": each.positions, "minutes": each.minutes, "value": each.value} for each in plan.traded
        ],
        "assumptions": [{"words": each.words, "override": each.override} for each in assumptions(plan)],
        "words": list(plan_lines(plan)),
    }


def _evaluated(plan: DesignedPlan, evaluated: Evaluated) -> dict[str, Any]:
    name, u = evaluated.worst(plan.determined)
    return {
        "name": evaluated.positions.name,
        "source": evaluated.positions.source or None,
        "positions": len(evaluated.schedule),
        "minutes": evaluated.schedule.minutes,
        "fits": evaluated.fits,
        "deviation_deg": evaluated.positions.deviation_deg,
        "worst": {"parameter": name, "u": u},
        "undetermined": list(evaluated.uncertainties.undetermined),
        "in_use_g": _in_use(evaluated),
        "effects": [_effect(each) for each in evaluated.effects],
        "undetectable": None if evaluated.undetectable is None else list(evaluated.undetectable),
    }


def _effect(each: EffectForecast) -> dict[str, Any]:
    return vars(each) | {"identical": list(each.identical), "not_separated": list(each.not_separated)}


def _forecast(plan: DesignedPlan) -> dict[str, Any] | None:
    if (predicted := plan.forecast) is None:
        return None
    aliases = {"alias": predicted.alias, "alias_of_undetectable": predicted.alias_of_undetectable}
    return {
        "draws": predicted.draws,
        "detection_limits": {id: {"size": size, "unit": plan.units.get(id)} for id, size in predicted.limits.items()},
        "undetectable": list(predicted.undetectable),
        "hidden_on_head": list(predicted.hidden_on_head),
        "not_testable": dict(predicted.not_testable),
        **{name: None if alias is None else vars(alias) for name, alias in aliases.items()},
    }


def _in_use(evaluated: Evaluated) -> dict[str, float | None]:
    if evaluated.uncertainties.undetermined:
        return {"average": None, "largest": None}
    return {"average": evaluated.in_use_average, "largest": float(np.max(evaluated.in_use))}


def _unit(name: str) -> str:
    from tumblecal.chain.nominal import UNIT_OF_LEAF

    return unit_of_parameter(name, UNIT_OF_LEAF) or "1"


def _angles(rotation: tuple[float, ...]) -> str:
    return ", ".join(f"{angle:g}" for angle in rotation)


def _rounded(angle: float) -> float:
    return round(float(angle), 9)


def capture_commands(plan: DesignedPlan, folder: Path) -> Iterator[str]:
    """The commands that measure the plan, and calibrate with its rig."""
    files = capture_files(plan)
    for name in files:
        yield suggested("capture", folder / name, "--out", run_folder(name), "--port", "PORT")
    for name in files:
        yield suggested("reduce", run_folder(name), less=EVERY)
    data = [run_folder(name) / "positions.csv" for name in files]
    join = ["--join"] if len(data) > 1 else []
    yield suggested("calibrate", *join, *data, "--rig", folder / RIG, "--out", "calibration")
