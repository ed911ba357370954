"""NIST's upper bounds of type-B uncertainties for a two-axis gimbal, and the budget of configs/budget_gimbal.toml.

Geist and Gaitan 2022 (J. Res. NIST 126:126038, PMC11249360). Their inputs are not in the abstract, which is all that was at
hand. So the problem is inverted: the rig has the largest sizes at which, all together, no bound is exceeded.

    tumblecal budget configs/budget_gimbal.toml --out b && python benchmarks/gimbal_bounds.py b/budget.json
"""

import json
import sys
from pathlib import Path

import numpy as np


BOUNDS = {
    "intrinsic sensitivity": 1e-5,
    "sensitivity matrix, diagonal": 2e-5,
    "sensitivity matrix, off-diagonal": 5e-5,
    "zero-acceleration offset / g": 2e-4,
    "intrinsic angle / rad": np.radians(5e-3),
}
# First order of diag(1 + dK) T R(dtheta): what each element off the diagonal is made of.
OFF = {
    "xy": {"dtheta_z": 1},
    "xz": {"dtheta_y": -1},
    "yx": {"gamma_21": 1, "dtheta_z": -1},
    "yz": {"dtheta_x": 1},
    "zx": {"gamma_31": 1, "dtheta_y": 1},
    "zy": {"gamma_32": 1, "dtheta_x": -1},
}


def largest_uncertainties(budget: dict) -> dict[str, float]:
    """The largest standard uncertainty of each kind that the bounds are of, from a `budget.json` of that rig."""
    names, covariance = list(budget["parameters"]), np.array(budget["covariance"])
    own = {
        key: [part["u"] for name, part in budget["intrinsic"].items() if name.startswith(key)]
        for key in ("scale", "bias", "angle")
    }
    rows = []
    for elements in OFF.values():
        row = np.zeros(len(names))
        for name, sign in elements.items():
            row[names.index(f"{name}@mount=A" if name.startswith("dtheta") else name)] = sign
        rows.append(row)
    off = np.sqrt([row @ covariance @ row for row in rows])
    diagonal = [budget["parameters"][f"dK_{axis}"]["u"] for axis in "xyz"]
    kinds = (own["scale"], diagonal, off, own["bias"], own["angle"])
    return dict(zip(BOUNDS, (float(np.max(kind)) for kind in kinds), strict=True))


def table(here: dict[str, float]) -> list[str]:
    """Bounds and our uncertainties side by side, as in docs/budget.md."""
    return [f"| {what} | {bound:.1e} | {here[what]:.1e} |" for what, bound in BOUNDS.items()]


def main() -> None:
    """Print the table of a `budget.json`."""
    print("\n".join(table(largest_uncertainties(json.loads(Path(sys.argv[1]).read_text())))))


if __name__ == "__main__":
    main()
