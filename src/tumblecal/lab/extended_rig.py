"""The rig file that a diagnosis writes: the extended model."""

from typing import Any

import jax
import numpy as np

from tumblecal.chain import followings_of
from tumblecal.chain.nominal import LINKS, UNIT_OF_LEAF
from tumblecal.chain.rig_temperature import temperature_content
from tumblecal.diagnosis import Diagnosis
from tumblecal.effects.catalogue import first_link
from tumblecal.ground.strict_toml import toml_lines
from tumblecal.lab.diagnosed import not_written
from tumblecal.lab.terms import effects_in


NAME = "extended_rig.toml"
_COMMENT = "# The model that tumblecal diagnose found, for `tumblecal simulate`, `calibrate --rig` and `study`."
# Columns of the plan in addition to the angles, and their attributes in a `PositionSet`.
_COLUMNS = {"name": "names", "alpha_deg": "alpha_deg", "beta_deg": "beta_deg"}
_COLUMNS |= {name: name for name in ("mount", "run", "time_s", "temperature_degc", "approach")}


def extended_rig_text(diagnosis: Diagnosis) -> str:
    """The chain with the named effects, their fitted values and the noise found, at the positions as they were measured; "" if
    there is no such model: no calibration is written, attitudes are unknown, something without a name was found, or an effect
    whose id in a rig denotes a different link (`mount_by_pitch` at another setting).

    Faults of positions and labels are no part of it: the file is the model of the data as corrected.
    """
    chain, data, where, members = diagnosis.chain, diagnosis.data, diagnosis.problem.where, diagnosis.members
    if not_written(diagnosis) or chain.of_positions or any(not cause.named for cause in members):
        return ""
    for slot in [cause.slot for cause in members if cause.slot.columns]:
        named = first_link(diagnosis.entries[slot.id], where)
        if jax.tree.structure(slot.links) != jax.tree.structure((named,)):
            return ""
    names, truth = {link.kind: name for name, link in LINKS.items()}, dict[str, Any]()
    changes = {leaf.change.name for leaf in followings_of(chain)}
    for leaf in chain.parameters:
        if leaf.name not in changes:
            values = np.asarray(leaf.value, float).ravel().tolist()
            truth[leaf.name] = {"value": values if len(values) > 1 else values[0], "unit": leaf.unit}
    columns = {name: getattr(data, of) for name, of in _COLUMNS.items()}
    stated = {name: np.asarray(column).tolist() for name, column in columns.items() if column is not None}
    content = {
        "schema": "tumblecal.rig/1",
        "title": f"extended model of {data.source}",
        "chain": {
            "links": [names[type(link)] for link in chain.links if type(link) in names],
            "effects": [effect.id for effect in effects_in(chain, where, diagnosis.entries)],
            "leaves": {
                leaf.name: {"by": leaf.by, "free": leaf.free}
                for leaf in diagnosis.model.nominal_chain.parameters
                if leaf.name in UNIT_OF_LEAF
            },
        },
        "mounts": {label: {"rotation_deg": rotation} for label, rotation in diagnosis.mountings.items()},
        "truth": truth,
        "temperature": temperature_content(chain),
        "noise": {"sd": f"{diagnosis.sigma_g!r} g"},
        "plan": {"positions": [dict(zip(stated, row, strict=True)) for row in zip(*stated.values(), strict=True)]},
    }
    return "\n".join([_COMMENT, *toml_lines({name: table for name, table in content.items() if table})])
