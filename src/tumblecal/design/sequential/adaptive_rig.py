"""The head of an adaptive capture: positions that can be chosen, and a rig for a plan without one."""

from dataclasses import replace

import numpy as np

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.chain.rig import Rig
from tumblecal.design.model.cells import Cells, cells_of
from tumblecal.ground.errors import InputError
from tumblecal.ground.strict_toml import toml_lines


# White noise of a dwell if no rig states it: small effects that the nominal model lacks are not seen in a dwell.
ASSUMED_SD = "0.1 mg"


def adaptive_cells(rig: Rig, plan: CapturePlan) -> tuple[Cells, int]:
    """The cells of an adaptive capture: candidates in its mounting, positions of the plan, candidates in other mountings; and
    the number of candidates in its mounting.

    **Raises:** `InputError` if the rig and the plan do not suit an adaptive capture, in one line.
    """
    ability, mount = rig.ability, plan.session.mount
    if ability is None:
        raise InputError(
            f"{rig.source}: no table [head]; an adaptive capture needs the settings and times of the head: write [head] with "
            "alpha_deg and beta_deg, and [head.times]"
        )
    if ability.temperatures_degc or plan.over_temperature:
        source = "the plan requests" if plan.over_temperature else f"{rig.source}: head.temperatures_degc requests"
        raise InputError(f"{source} temperatures, but an adaptive capture is at one temperature; remove them")
    if mount not in ability.mounts:
        raise InputError(
            f"the plan is for mounting {mount}, but the head of {rig.source} has {', '.join(ability.mounts)}; correct "
            "session.mount of the plan"
        )
    own = cells_of(replace(ability, mounts=(mount,)))
    steps = plan.steps
    alpha, beta = (np.array([getattr(step, name) for step in steps], float) for name in ("alpha_deg", "beta_deg"))
    cells, _ = own.joined(Cells(alpha, beta, (mount,) * len(steps)))
    others = tuple(label for label in ability.mounts if label != mount)
    if others:
        cells, _ = cells.joined(cells_of(replace(ability, mounts=others)))
    return cells, len(own)


def assumed_rig(plan: CapturePlan) -> str:
    """A rig file for a plan without one: the angles of the plan in all combinations, its dwells, and a noise of 0.1 mg."""
    alpha, beta = (sorted({getattr(step, name) for step in plan.steps}) for name in ("alpha_deg", "beta_deg"))
    mount = plan.session.mount
    rotation = plan.positions.mount_rotation_deg
    content = {
        "schema": "tumblecal.rig/1",
        "title": "Assumed for an adaptive capture without --rig",
        "plan": {"alpha_deg": alpha, "beta_deg": beta, "mounts": [mount]},
        "noise": {"sd": ASSUMED_SD},
        "mounts": {} if rotation is None else {mount: {"rotation_deg": rotation}},
        "head": {"alpha_deg": alpha, "beta_deg": beta},
    }
    return "\n".join(toml_lines({name: part for name, part in content.items() if part}))
