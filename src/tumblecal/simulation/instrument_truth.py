"""The readings of a virtual instrument on a dividing head, by the exact chain of a rig."""

from dataclasses import replace
from pathlib import Path

import equinox as eqx
import numpy as np

from tumblecal.capture.emulator.config import Emulation
from tumblecal.capture.emulator.device import TruthFunction
from tumblecal.chain import Chain
from tumblecal.effects.added_terms import base_unit
from tumblecal.effects.catalogue import Catalogue, entry, first_link
from tumblecal.effects.rig_with_effects import read_rig_with_effects
from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted
from tumblecal.ground.toml_faults import faults_at


def instrument_truth(wanted: Emulation, config: Path, entries: Catalogue, mount: str | None) -> TruthFunction:
    """The readings at a position by the exact chain of the rig with its true parameters, and its effects in their units.

    **Arguments:**

    - `config`: the file of the virtual instrument. `entries`: the catalogue. `mount`: the mounting; None: the first one of the
      rig's plan.

    **Raises:** `InputError` for an unknown effect, more values than its coefficients, or a mounting that the plan lacks.
    """
    path = (config.parent / str(wanted.rig)).resolve()
    rig = read_rig_with_effects(path, entries)
    plan, count = rig.plan, len(rig.plan)
    mounted = np.array([label == (mount or plan.mounts[0]) for label in plan.mounts])
    if not mounted.any():
        known = ", ".join(dict.fromkeys(plan.mounts))
        raise InputError(f"--mount {mount}: {path} has no positions in this mounting; mountings of its plan: {known}")
    # Effects of the temperature need several soaks.
    degc = tuple(np.resize(np.linspace(0.0, 50.0, 6), count).tolist())
    conditions = replace(plan, time_s=(0.0,) * count, temperature_degc=degc, approach=(1.0,) * count)
    where = replace(rig, plan=conditions).where
    chain = rig.true_chain(where)
    for id, values in wanted.effects.items():
        with faults_at(config, f"effects.{id}"):
            effect = entry(entries, id)
            link, scale = first_link(effect, where), base_unit(effect.unit)[1]
            leaves = Chain((link,)).parameters
            factors = {name: 1.0 if leaf.unit == "s" else scale for leaf in leaves for name in leaf.names}
            if len(factors) < len(values):
                raise InputError(f"{len(values)} values, but it has {counted(len(factors), 'coefficient')}")
            stated = zip(factors.items(), values, strict=False)
            chain = (chain + link).named({name: factor * value for (name, factor), value in stated})
    evaluate = eqx.filter_jit(lambda chain, where: chain(where))

    def truth(alpha_deg: float, beta_deg: float, time_s: float, temperature_degc: float):
        alpha, beta = np.radians([alpha_deg, beta_deg])
        # Each pitch setting of the rig has an error, and each visit of it in a plan of visits: that of the nearest position.
        turned = np.abs(np.sin((plan.alpha - alpha) / 2))
        row = int(np.lexsort((turned, np.round(np.abs(plan.beta - beta), 9), ~mounted))[0])
        here = np.arange(count) == row
        now = replace(
            where,
            alpha=np.where(here, alpha, plan.alpha),
            beta=np.where(here, beta, plan.beta),
            # The time of effects begins at the first position, so the other rows remain at zero.
            time_s=np.where(here, time_s, 0.0),
            temperature_degc=np.full(count, temperature_degc),
        )
        return np.asarray(evaluate(chain, now))[row]

    return truth
