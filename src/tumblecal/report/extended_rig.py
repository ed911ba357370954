"""The extended model of a diagnosis as a rig file: `extended_rig.toml` for `simulate`, `calibrate --rig` and `study`."""

from collections.abc import Iterator

import numpy as np

from tumblecal.chain.nominal import LINKS, UNIT_OF_LEAF
from tumblecal.chain.parameter import Parameter
from tumblecal.diagnosis import Diagnosis
from tumblecal.ground.strict_toml import toml_string
from tumblecal.report.diagnosis_use import not_written
from tumblecal.report.rig_text import SCHEMA, leaf_table, mount_tables, position_table
from tumblecal.report.sensor_terms import effects_in


NAME = "extended_rig.toml"


def extended_rig_text(diagnosis: Diagnosis) -> str:
    """The chain with the named effects, their fitted values and the noise found, at the positions as they were measured; "" if
    there is no such model: no calibration is written, attitudes are unknown, or something without a name was found.

    Faults of positions and labels are no part of it: the file is the model of the data as corrected.
    """
    unnamed = any(not cause.named for cause in diagnosis.members)
    if not_written(diagnosis) or diagnosis.chain.of_positions or unnamed:
        return ""
    return "\n".join(
        [
            *_head(diagnosis),
            *_leaves(diagnosis),
            *mount_tables(diagnosis.mountings),
            *_truth(diagnosis),
            *_positions(diagnosis),
        ]
    )


def _head(diagnosis: Diagnosis) -> Iterator[str]:
    chain, data = diagnosis.chain, diagnosis.data
    names = {link.kind: name for name, link in LINKS.items()}
    nominal = [names[type(link)] for link in chain.links if type(link) in names]
    effects = [effect.id for effect in effects_in(chain, diagnosis.problem.where, diagnosis.entries)]
    yield "# The model that tumblecal diagnose found, for `tumblecal simulate`, `calibrate --rig` and `study`."
    yield SCHEMA
    yield f"title = {toml_string(f'extended model of {data.source}')}"
    yield ""
    yield "[chain]"
    yield f"links = [{', '.join(map(toml_string, nominal))}]"
    yield f"effects = [{', '.join(map(toml_string, effects))}]"
    yield ""


def _leaves(diagnosis: Diagnosis) -> Iterator[str]:
    for leaf in diagnosis.model.nominal_chain.parameters:
        if leaf.name in UNIT_OF_LEAF:
            yield from leaf_table(leaf.name, leaf.by, leaf.free)


def _truth(diagnosis: Diagnosis) -> Iterator[str]:
    yield "[truth]"
    for leaf in diagnosis.chain.parameters:
        yield f"{toml_string(leaf.name)} = {_values(leaf)}"
    yield ""
    yield "[noise]"
    yield f'sd = "{diagnosis.sigma_g!r} g"'
    yield ""


def _values(leaf: Parameter) -> str:
    numbers = np.asarray(leaf.value, float).ravel().tolist()
    value = repr(numbers[0]) if len(numbers) == 1 else repr(numbers)
    return f"{{ value = {value}, unit = {toml_string(leaf.unit)} }}"


def _positions(diagnosis: Diagnosis) -> Iterator[str]:
    data = diagnosis.data
    labels = {"mount": data.mount, "run": data.run}
    conditions = {"time_s": data.time_s, "temperature_degc": data.temperature_degc}
    for k, name in enumerate(data.names):
        more: dict[str, str | float] = {key: column[k] for key, column in labels.items() if column is not None}
        more |= {key: float(values[k]) for key, values in conditions.items() if values is not None}
        if data.approach is not None:
            more["approach"] = int(data.approach[k])
        yield from position_table(name, float(data.alpha_deg[k]), float(data.beta_deg[k]), more)
