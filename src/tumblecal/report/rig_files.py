"""Rig files that a diagnosis writes: the extended model, and the old positions with those proposed."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

import jax
import numpy as np

from tumblecal.chain import followings_of
from tumblecal.chain.nominal import LINKS, UNIT_OF_LEAF
from tumblecal.chain.rig_temperature import temperature_tables
from tumblecal.diagnosis import Diagnosis
from tumblecal.effects.catalogue import first_link
from tumblecal.ground.strict_toml import toml_string, toml_table
from tumblecal.lab.sensor_terms import effects_in
from tumblecal.planning.next_plan import NextPlan
from tumblecal.planning.proposals import SIDES
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
    return _rig_text(
        "The model that tumblecal diagnose found, for `tumblecal simulate`, `calibrate --rig` and `study`.",
        f"extended model of {data.source}",
        [
            *toml_table("chain", {"links": nominal, "effects": effects}),
            *(line for leaf in leaves for line in _leaf(leaf.name, leaf.by, leaf.free)),
        ],
        diagnosis.mountings,
        positions,
        [
            *toml_table("truth", truth),
            *temperature_tables(chain, with_truth=True),
            *toml_table("noise", {"sd": f"{diagnosis.sigma_g!r} g"}),
        ],
    )


def next_rig_text(diagnosis: Diagnosis, plan: NextPlan, labels: Mapping[str, str]) -> str:
    """A rig with the old positions and the new ones, whose new mountings are turned as proposed; `labels`: of the mountings."""
    data = diagnosis.data
    mounts, runs = data.mount or ("1",) * len(data), data.run or ("1",) * len(data)
    rows = list(zip(data.names, data.alpha_deg, data.beta_deg, mounts, runs, strict=True))
    for position in plan.together:
        for alpha, beta in cells([position]):
            rows.append((f"next-{len(rows) - len(data) + 1}", alpha, beta, labels[position.mount], runs[-1]))
    turned = {labels[side]: angles for side, angles in SIDES.items() if any(row[3] == labels[side] for row in rows)}
    angles = {label: diagnosis.mountings.get(label, (0.0, 0.0, 0.0)) for label in dict.fromkeys(mounts)} | turned
    by = {"dbeta": "run.mount.pitch" if len(set(runs)) > 1 else "mount.pitch", "dtheta": "mount"}
    leaves = diagnosis.model.nominal_chain.parameters
    fixed = [leaf.name for leaf in leaves if not leaf.free and leaf.name in UNIT_OF_LEAF and leaf.name != "levelling"]
    return _rig_text(
        "The head with its old positions and those proposed by tumblecal diagnose, for --rig.",
        f"{data.source} with the next positions",
        [
            line
            for name in dict.fromkeys((*by, *fixed))
            for line in _leaf(name, by.get(name), False if name in fixed else None)
        ],
        angles,
        [
            {"name": name, "alpha_deg": round(float(alpha), 9), "beta_deg": round(float(beta), 9)}
            | {"mount": mount, "run": run}
            for name, alpha, beta, mount, run in rows
        ],
        list(temperature_tables(diagnosis.model.nominal_chain, with_truth=False)),
    )


def cells(chosen: Iterable) -> list[tuple[float, float]]:
    """Angles (alpha, beta) of proposed positions in the order of choice, those of one pitch setting together."""
    by_pitch: dict[float, list[tuple[float, float]]] = {}
    for position in chosen:
        angles = [(alpha, position.beta_deg) for alpha in (position.turn_deg or (position.alpha_deg,))]
        by_pitch.setdefault(position.beta_deg, []).extend(angles)
    return [cell for angles in by_pitch.values() for cell in angles]


def _leaf(name: str, by: str | None, free: bool | None) -> Iterator[str]:
    """How a leaf is indexed and whether it is estimated; None: as usual."""
    yield from toml_table(f"chain.leaves.{name}", {"by": by, "free": free})


def _rig_text(
    comment: str,
    title: str,
    chain: Sequence[str],
    mounts: Mapping[str, Sequence[float]],
    positions: Sequence[Mapping[str, object]],
    more: Sequence[str] = (),
) -> str:
    """A rig file; `chain`, `more`: lines of tables, before the mountings (deg about x, y, z) and after them."""
    lines = [f"# {comment}", 'schema = "tumblecal.rig/1"', f"title = {toml_string(title)}", "", *chain]
    for label, rotation in mounts.items():
        lines += toml_table(f"mounts.{toml_string(label)}", {"rotation_deg": rotation})
    lines += more
    for position in positions:
        lines += toml_table("[plan.positions]", position)
    return "\n".join(lines)
