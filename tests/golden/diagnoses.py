"""Sixty position files of one plan over all kinds of effects, diagnosed in one call; units on one head."""

from pathlib import Path
from typing import Any

import numpy as np

import answer
import inputs
from commands import run
from in_use_instrument import SIZES


_PAIRS = (("second_order", "bias_drift"), ("levelling", "scale_temperature"), ("eccentricity", "third_order"),
          ("cross_coupling", "warm_up"), ("mount_drift", "bias_temperature"), ("hysteresis", "ellipticity"))  # fmt: skip
# Kind of a file: names of effects, their visible size in standard deviations.
KINDS: dict[str, tuple[tuple[str, ...], float]] = {
    **{f"nothing {k}": ((), 0.0) for k in range(8)},
    **{f"{name}": ((name,), 15.0) for name in SIZES},
    **{f"{name} of 60": ((name,), 60.0) for name in list(SIZES)[::6]},
    **{f"{a} and {b}": ((a, b), 25.0) for a, b in _PAIRS},
}
SPOILT = ("outlier", "jump", "noise doubled", "exchanged rows", "negated angle", "all readings 2 sd of noise", "gain")


def _spoilt(kind: str, values: np.ndarray) -> np.ndarray:
    """Readings with a fault of the measurement."""
    rng = np.random.default_rng(SPOILT.index(kind))
    match kind:
        case "outlier":
            values[9] += [0, 2e-3, -1e-3]
        case "jump":
            values[13:, 1] += 1.5e-3
        case "noise doubled":
            values[12:] += 2e-4 * rng.normal(size=values[12:].shape)
        case "exchanged rows":
            values[[5, 6]] = values[[6, 5]]
        case "negated angle":
            values = values[[*range(8), *((-np.arange(8)) % 8 + 8), *range(16, 24)]]
        case "all readings 2 sd of noise":
            values += 2e-4 * rng.normal(size=values.shape)
        case "gain":
            values *= 1.02
    return values


def write(folder: Path) -> list[str]:
    """Write all files; their names."""
    plan, turns = inputs.plan_of()
    tables = {kind: inputs.readings(plan, turns, 100 + k, *own) for k, (kind, own) in enumerate(KINDS.items())}
    tables |= {kind: _spoilt(kind, inputs.readings(plan, turns, 300 + k)) for k, kind in enumerate(SPOILT)}
    for kind, values in tables.items():
        table = inputs.positions_table(plan, values)
        inputs.write_table(folder / f"{kind.replace(' ', '_')}.csv", table, {"gravity_ms2": 9.81})
    return [kind.replace(" ", "_") for kind in tables]


def answers(folder: Path) -> dict[str, Any]:
    """What decides of each diagnosis."""
    import json
    from contextlib import chdir

    names = write(folder)
    with chdir(folder):
        run(f"diagnose {' '.join(f'{name}.csv' for name in names)} --noise-sd 0.1mg --out d --no-figures --workers 1")
    files = {name: folder / "d" / name / "diagnosis.json" for name in names}
    return {
        name: answer.diagnosis(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else "refused"
        for name, path in files.items()
    }
