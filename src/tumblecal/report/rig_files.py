"""The rig file that a diagnosis writes: the extended model."""

import jax
import numpy as np

from tumblecal.chain import followings_of
from tumblecal.chain.nominal import LINKS, UNIT_OF_LEAF
from tumblecal.chain.rig_temperature import temperature_tables
from tumblecal.diagnosis import Diagnosis
from tumblecal.effects.catalogue import first_link
from tumblecal.ground.strict_toml import toml_string, toml_table
from tumblecal.lab.sensor_terms import effects_in
from tumblecal.report.diagnosis_calibration import not_written


NAME = "extended_rig.toml"


def extended_rig_text(diagnosis: Diagnosis) -> str:
    """The chain with the named effects, their fitted values and the noise found, at the positions as they were measured; "" if
    there is no such model: no calibration is written, attitudes are unknown, something without a name was found, or an effect
    whose id in a rig denotes a different link (`mount_by_pitch` at another setting).

    Faults of positions and labels are no part of it: the file is the model of the data as corrected.
    """
    chain, data = diagnosis.chain, diagnosis.data
    if not_written(diagnosis) or chain.of_positions or any(not cause.named for cause in diagnosis.members):
        return ""
    slots = [cause.slot for cause in diagnosis.members if cause.slot.columns]
    named = [first_link(diagnosis.entries[slot.id], diagnosis.problem.where) for slot in slots]
    if any(
        jax.tree.structure(slot.links) != jax.tree.structure((link,)) for slot, link in zip(slots, named, strict=True)
    ):
        return ""
    names = {link.kind: name for name, link in LINKS.items()}
    nominal = [names[type(link)] for link in chain.links if type(link) in names]
    effects = [effect.id for effect in effects_in(chain, diagnosis.problem.where, diagnosis.entries)]
    leaves = [leaf for leaf in diagnosis.model.nominal_chain.parameters if leaf.name in UNIT_OF_LEAF]
    values = {leaf.name: np.asarray(leaf.value, float).ravel().tolist() for leaf in chain.parameters}
    changes = {leaf.change.name for leaf in followings_of(chain)}
    truth = {
        toml_string(leaf.name): {"value": each[0] if len(each := values[leaf.name]) == 1 else each, "unit": leaf.unit}
        for leaf in chain.parameters
        if leaf.name not in changes
    }
    labels = {"mount": data.mount, "run": data.run}
    conditions = {"time_s": data.time_s, "temperature_degc": data.temperature_degc}
    positions = [
        {"name": name, "alpha_deg": float(data.alpha_deg[k]), "beta_deg": float(data.beta_deg[k])}
        | {key: column[k] for key, column in labels.items() if column is not None}
        | {key: float(column[k]) for key, column in conditions.items() if column is not None}
        | ({} if data.approach is None else {"approach": int(data.approach[k])})
        for k, name in enumerate(data.names)
    ]
    lines = [
        "# The model that tumblecal diagnose found, for `tumblecal simulate`, `calibrate --rig` and `study`.",
        'schema = "tumblecal.rig/1"',
        f"title = {toml_string(f'extended model of {data.source}')}",
        "",
        *toml_table("chain", {"links": nominal, "effects": effects}),
    ]
    for leaf in leaves:
        lines += toml_table(f"chain.leaves.{leaf.name}", {"by": leaf.by, "free": leaf.free})
    for label, rotation in diagnosis.mountings.items():
        lines += toml_table(f"mounts.{toml_string(label)}", {"rotation_deg": rotation})
    lines += [*toml_table("truth", truth), *temperature_tables(chain, with_truth=True)]
    lines += toml_table("noise", {"sd": f"{diagnosis.sigma_g!r} g"})
    for position in positions:
        lines += toml_table("[plan.positions]", position)
    return "\n".join(lines)
