"""The rig of a designed plan: its positions, and the errors of each visit of a setting with their priors.

A calibration with this rig states the uncertainties of the plan. A simulation has the errors of settings that are set again.
"""

from dataclasses import replace

import numpy as np

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.nominal import Leaf
from tumblecal.chain.plan import Plan
from tumblecal.chain.rig import Rig
from tumblecal.chain.rig_temperature import RigTemperature
from tumblecal.chain.where import VISITS
from tumblecal.plan.information import uncertainties
from tumblecal.plan.limits import Schedule
from tumblecal.plan.responses import MOUNT, PITCH, Responses


# Angles of visits that nothing determines, and that nothing depends on, get this prior, rad: no bound.
_NO_BOUND = 1.0
# The index column of the errors of a setting by visit; those without repeated visits, of several mountings and of one.
_BY = {PITCH: ("pitch_visit", "mount.pitch", "pitch"), MOUNT: ("mount_visit", "mount", None)}


def planned_rig(
    rig: Rig, responses: Responses, schedule: Schedule, ability: HeadAbility, names: tuple[str, ...], seed: int = 0
) -> Rig:
    """The rig with the positions of a schedule.

    **Arguments:**

    - `responses`, `ability`: of the rig. `names`: of the positions.
    - `seed`: of the true errors of visits, which are drawn with the stated repeatability.
    """
    cells = responses.cells.chosen(schedule.cells)
    plan = cells.plan(names, np.round(schedule.start_s + ability.times.dwell_s / 2, 3))
    leaves, priors, spread = dict(rig.leaves), dict(rig.priors), ability.repeatability
    bounded = uncertainties(responses, schedule, ability).bounded
    several = len(set(cells.mounts)) > 1
    of_setting = {
        PITCH: (responses.pitch, schedule.pitch_visit, cells.setting),
        MOUNT: (responses.mount, schedule.mount_visit, cells.mounting),
    }
    for name, (setting, visit, label) in of_setting.items():
        by_visit, of_mounts, of_one = _BY[name]
        # Each visit has an error of its own, unless all visits of a setting share one.
        shared = setting.exact or (setting.common and not setting.again)
        again = visit.max() + 1 > len(np.unique(label)) or (setting.again and setting.common != 0.0)
        leaves[name] = Leaf(of_mounts if several else of_one, free=not setting.exact)
        if again and not shared:
            leaves[name] = Leaf(by_visit)
        if setting.common == 0.0 and setting.again:
            # Every visit is independent; also if the leaf is fixed in the rig, but not set exactly again.
            priors[name] = (0.0, setting.again * setting.scale)
            spread = replace(spread, **{"pitch" if name == PITCH else "mount": None})
        elif setting.common is None and not setting.again and not bounded:
            priors[name] = (0.0, _NO_BOUND)
    truth = {name: values for name, values in rig.truth.items() if name.partition("_")[0] not in _BY}
    ability = replace(ability, repeatability=spread)
    planned = replace(rig, plan=plan, leaves=leaves, priors=priors, truth=truth, ability=ability)
    return replace(planned, truth=truth | _truth_of_settings(rig, planned, responses, seed))


def _truth_of_settings(rig: Rig, planned: Rig, responses: Responses, seed: int) -> dict[str, tuple[float, ...]]:
    """True errors of the settings of a plan: those of the rig where it has the setting, and what each visit adds."""
    # The settings alone: the present plan need not have the temperatures that other leaves follow.
    mine = {name: values for name, values in rig.truth.items() if name.partition("_")[0] in _BY}
    alone = replace(rig, truth=mine, effects=(), temperature=RigTemperature())
    known = {leaf.name: leaf for leaf in alone.true_chain(alone.where).parameters}
    generator, where, truth = np.random.default_rng(seed), planned.where, dict[str, tuple[float, ...]]()
    for leaf in planned.chain(where).parameters:
        if leaf.name not in _BY:
            continue
        there, by, setting = known[leaf.name], leaf.by, responses.pitch if leaf.name == PITCH else responses.mount
        stated, old, new = (
            np.asarray(there.value, float),
            _settings(rig.plan, leaf.name),
            _settings(planned.plan, leaf.name),
        )
        of_old = np.zeros(len(old), int) if there.by is None else np.asarray(rig.where.index(there.by))
        of_new = np.zeros(len(new), int) if by is None else np.asarray(where.index(by))
        values = np.zeros(leaf.value.shape)
        for key, number in reversed(list(zip(new, of_new.tolist(), strict=True))):
            values[number] = stated[of_old[old.index(key)]] if key in old else 0.0
        if by in VISITS and setting.again:
            values = values + setting.again * setting.scale * generator.standard_normal(values.shape)
        if np.any(values):
            truth[leaf.name] = tuple(values.ravel().tolist())
    return truth


def _settings(plan: Plan, name: str) -> list[tuple[float | str, ...]]:
    """The setting that a leaf belongs to, for each position."""
    return list(zip(plan.mounts, plan.beta_deg, strict=True) if name == PITCH else zip(plan.mounts, strict=True))
