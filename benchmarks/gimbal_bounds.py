"""NIST's upper bounds of type-B uncertainties for a two-axis gimbal beside the budget of configs/budget_gimbal.toml.

Geist and Gaitan 2022 (J. Res. NIST 126:126038, PMC11249360). Their inputs are not in the abstract, which is all that was at
hand. So the problem is turned round: the second table says at which size each input alone would make each bound, and the rig
has the largest sizes at which, all together, no bound is passed.
"""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np


if TYPE_CHECKING:
    from tumblecal.budget.budget import Budget


# Uncertainties by an input of one degree below this are rounding.
_NOTHING = 1e-9
RIG = Path(__file__).parents[1] / "configs" / "budget_gimbal.toml"
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


def rig_budget() -> "Budget":
    """The budget of the rig, as `tumblecal budget` makes it of the file, without the noise."""
    import tumblecal

    tumblecal.enable_float64()
    from tumblecal.budget.budget import budget_of
    from tumblecal.chain.rig_file import read_rig
    from tumblecal.effects.catalogue import catalogue
    from tumblecal.estimation import exact, problem_of
    from tumblecal.simulation.position_means import simulated

    rig = read_rig(RIG)
    data = simulated(rig, 0, noise_sd=1e-12)
    fit = exact.fit(problem_of(data, rig.chain(rig.where), noise_sd=1e-12))
    return budget_of(fit, rig.considered, catalogue(), str(RIG))


def largest_by_input(whole: "Budget") -> dict[str, dict[str, float]]:
    """The largest uncertainties of each kind by each input alone, for an input of one degree."""
    from tumblecal.budget.record import budget_record

    made = {}
    for given, shift in zip(whole.inputs, whole.shifts, strict=True):
        one = replace(whole, inputs=(given,), shifts=(shift / np.degrees(given.u),))
        made[given.label] = largest_uncertainties(budget_record(one, None).plain())
    return made


def table(here: dict[str, float]) -> list[str]:
    """Bounds and our uncertainties side by side, as in docs/budget.md."""
    return [f"| {what} | {bound:.1e} | {here[what]:.1e} |" for what, bound in BOUNDS.items()]


def input_table(by_input: dict[str, dict[str, float]]) -> list[str]:
    """At which size, deg, each input alone would make each bound, as in docs/budget.md; "any" where it makes nothing of it."""
    rows = []
    for label, made in by_input.items():
        sizes = (bound / made[what] if made[what] > _NOTHING else np.inf for what, bound in BOUNDS.items())
        rows.append(f"| {label} | " + " | ".join("any" if np.isinf(size) else f"{size:.4f}" for size in sizes) + " |")
    return rows


def main() -> None:
    """Print both tables."""
    from tumblecal.budget.record import budget_record

    whole = rig_budget()
    print("\n".join(table(largest_uncertainties(budget_record(whole, None).plain()))), end="\n\n")
    print("\n".join(input_table(largest_by_input(whole))))


if __name__ == "__main__":
    main()
