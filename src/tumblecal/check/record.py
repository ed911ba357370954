"""`check.json`: a check in numbers."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tumblecal import __version__
from tumblecal.check.consistency import LEVEL
from tumblecal.check.moved import Moved
from tumblecal.check.result import CheckResult
from tumblecal.check.sensitivity import POWER
from tumblecal.check.update import Update
from tumblecal.data.sensor_parameters import GROUPS, SENSOR, leaf_of
from tumblecal.ground.atomic import write_text
from tumblecal.ground.json_file import json_text


SCHEMA = "tumblecal.check/1"


def write_check(path: Path, result: CheckResult, text: str, source: Mapping[str, Any], update: Update | None) -> None:
    """Write `check.json`; `text`: the verdict. `source`: files with their SHA-256, and
    dates."""
    write_text(path, json_text(check_record(result, text, source, update)))


def check_record(result: CheckResult, text: str, source: Mapping[str, Any], update: Update | None) -> dict[str, Any]:
    """The check as plain numbers, lists and texts."""
    test, found = result.test, result.sensitivity
    return {
        "schema": SCHEMA,
        "source": result.data.source,
        **source,
        "tumblecal": __version__,
        "serial_number": result.data.serial_number or result.calibration.serial_number,
        "verdict": result.outcome,
        "use": result.use.record(),
        "attitudes": [
            {"name": name, "excess_g": excess, "u_g": sd}
            for name, excess, sd in zip(
                result.data.names, result.sizes.excess.tolist(), result.sizes.sd.tolist(), strict=True
            )
        ],
        "attitudes_known": not result.data.hand_held,
        "temperature_degc": result.expected.degc,
        "gravity": {"ratio": result.gravity.size, "u": result.gravity.sd, "words": result.gravity.words},
        "noise": {
            "sd_g": result.noise.typical_g,
            "words": result.noise.words,
            "factor": test.noise_factor,
            "dof": test.noise_dof,
        },
        "test": {
            "chi2": test.chi2,
            "dof": test.dof,
            "p_value": test.p_value,
            "level": LEVEL,
            "rejected": test.rejected,
        },
        "rest": {"chi2": test.rest_chi2, "dof": test.rest_dof, "p_value": test.rest_p},
        "sensitivity": {
            "probability": POWER,
            "limits": {
                name: {"value": limit if np.isfinite(limit) else None, "unit": GROUPS[leaf_of(name)][1]}
                for name, limit in zip(SENSOR, found.limits.tolist(), strict=True)
            },
            "worst": dict(zip(SENSOR, found.worst.tolist(), strict=True)),
            "invisible": list(found.invisible),
            "hidden": found.hidden_together,
        },
        "change": None if result.moved is None else _change(result, result.moved),
        "update": None
        if update is None
        else {
            "change": dict(zip(SENSOR, update.change.tolist(), strict=True)),
            "u": dict(zip(SENSOR, update.sd.tolist(), strict=True)),
            "p_value": update.before.p_value,
        },
        "text": text,
    }


def _change(result: CheckResult, explained: Moved) -> dict[str, Any]:
    return {
        "named": list(explained.named.parameters) if explained.named else [],
        "largest_g": None if result.change_g is None else result.change_g[0],
        "largest_expanded_g": None if result.change_g is None else result.change_g[1],
        "explanations": [
            {
                "kind": each.kind,
                "parameters": list(each.parameters),
                "attitude": each.attitude or None,
                "probability": each.probability,
                "change": dict(zip(SENSOR, each.change.tolist(), strict=True)),
                "u": dict(zip(SENSOR, each.sd.tolist(), strict=True)),
            }
            for each in explained.possible
        ],
        "attitudes_that_separate": [attitude.words for attitude in explained.separating],
    }
