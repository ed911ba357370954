"""A second, smaller measurement with a simulated instrument: the positions of a plan, after those of its rig."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.chain.rig import Rig
from tumblecal.data import PositionSet
from tumblecal.ground.errors import InputError
from tumblecal.simulation.position_means import simulated


def simulated_after(rig: Rig, plan: CapturePlan, source: Path, seed: int, noise_sd: float | None = None) -> PositionSet:
    """The positions of a plan alone, measured after those of the rig: its drifts continue, in the same mounting and run.

    **Arguments:**

    - `rig`: the instrument, with the first plan. `plan`: of the second measurement, with its conditions; if it states none,
      directly after the first, at its final temperature. `source`: the plan's file, named in faults.
    - `seed`, `noise_sd` (g): as of `simulated`.

    **Raises:** `InputError` for positions at a pitch angle, in a mounting or in a run that the rig does not have.
    """
    first, steps, given = rig.plan, plan.steps, plan.conditions
    for what, wanted, there in (
        ("pitch angle", {step.beta_deg for step in steps}, first.beta_deg),
        ("mount", {plan.session.mount}, first.mounts),
        ("run", {plan.session.run}, first.runs),
    ):
        if unknown := sorted(wanted - {*there}):
            listed = ", ".join(f"{value:g}" if isinstance(value, float) else str(value) for value in unknown)
            raise InputError(f"{source}: {what} {listed} is not in {rig.source}, so its truth is unknown; use others")
    count = len(steps)
    time = temperature = approach = None
    if first.time_s is not None:
        interval = float(np.median(np.diff(first.time_s))) if len(first) > 1 else 0.0
        after = interval if given.after_s is None else given.after_s
        step = interval if given.step_s is None else given.step_s
        time = (*first.time_s, *(max(first.time_s) + after + step * np.arange(count)).tolist())
    if first.temperature_degc is not None:
        degc = first.temperature_degc[-1] if given.temperature_degc is None else given.temperature_degc
        requested = (degc if step.temperature_degc is None else step.temperature_degc for step in steps)
        temperature = (*first.temperature_degc, *requested)
    if first.approach is not None:
        approach = (*first.approach, *(float(step.approach or 1) for step in steps))
    both = replace(
        first,
        names=(*first.names, *(str(step.name) for step in steps)),
        alpha_deg=(*first.alpha_deg, *(step.alpha_deg for step in steps)),
        beta_deg=(*first.beta_deg, *(step.beta_deg for step in steps)),
        mounts=(*first.mounts, *(plan.session.mount,) * count),
        runs=(*first.runs, *(plan.session.run,) * count),
        time_s=time,
        temperature_degc=temperature,
        approach=approach,
    )
    temperature = rig.temperature.stated_for(rig.where)
    return simulated(replace(rig, plan=both, temperature=temperature), seed, noise_sd).chosen(
        np.arange(len(first), len(both))
    )
