"""A head and a wanted plan as they are stated in texts."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tumblecal.chain.head_ability import HeadAbilityTable
from tumblecal.chain.rig import Rig
from tumblecal.effects.catalogue import Catalogue, entry
from tumblecal.ground.errors import InputError
from tumblecal.ground.option_texts import angles, numbers, pairs, sizes
from tumblecal.plan.positions_of_file import positions_of, require_mounts
from tumblecal.plan.request import CRITERIA, Wanted


def allowed_rig(rig: Rig, allow_alpha: Sequence[str], allow_beta: Sequence[str], allow_mount: str) -> Rig:
    """The rig with stated settings in place of those of its head.

    **Arguments:**

    - `allow_alpha`, `allow_beta`: as of `angles`. `allow_mount`: labels, separated by commas.

    **Raises:** `InputError` for a mounting that the rig does not have.
    """
    there = rig.plan
    ability = rig.ability or HeadAbilityTable.model_validate({}).ability(
        tuple(sorted({*there.beta_deg})), tuple(dict.fromkeys(there.mounts))
    )
    mounts = _listed(allow_mount)
    require_mounts(rig, mounts or ability.mounts, f"{rig.source}: {'--allow-mount' if mounts else 'head.mounts'}")
    alpha, beta = angles("--allow-alpha", allow_alpha), angles("--allow-beta", allow_beta)
    if steep := [angle for angle in beta if abs(angle) > 90]:
        raise InputError(f"--allow-beta: {steep[0]:g} deg; pitch settings are from -90 to 90 deg")
    stated = {"alpha_deg": alpha, "beta_deg": beta, "mounts": mounts}
    given = {name: value for name, value in stated.items() if value}
    assumed = tuple(key for key in ability.assumed if key not in given)
    return replace(rig, ability=replace(ability, **given, assumed=assumed))


def wanted_plan(
    rig: Rig,
    entries: Catalogue,
    *,
    criterion: str = "worst",
    parameters: str = "",
    effects: Sequence[str] = (),
    augment: Path | None = None,
    compare: Sequence[Path] = (),
    **options: Any,
) -> Wanted:
    """The request for a plan.

    **Arguments:**

    - `criterion`: names, or pairs of name and weight, separated by commas. `parameters`: names, separated by commas.
    - `effects`: texts such as `second_order.z=0.2 mg/g^2`; others are ignored. `augment`, `compare`: as of `positions_of`.
    - `options`: others of `Wanted`.

    **Raises:** `InputError` for an option that cannot be read, and options that contradict each other.
    """
    stated = [part if "=" in part else f"{part}=1" for part in criterion.split(",")]
    given = pairs("--criterion", stated, "worst=1,in_use=2", CRITERIA)
    weights = {name: numbers(f"--criterion {name}", text, "worst=1")[0] for name, text in given.items()}
    if wrong := [name for name, weight in weights.items() if weight <= 0]:
        raise InputError(f"--criterion {wrong[0]}: a weight must be above 0; remove a criterion that does not count")
    of_effects = [text for text in effects if "=" in text]
    to_name = sizes("--effects ", of_effects, lambda id: entry(entries, id).unit, "'second_order.z=0.2 mg/g^2'")
    if not to_name and {"naming", "alias"} & {*weights}:
        raise InputError("--criterion: no effect is stated; add for example --effects 'second_order.z=0.2 mg/g^2'")
    if parameters and not {"worst", "mean", "volume"} & {*weights}:
        raise InputError(
            f"--parameters and --criterion {criterion} contradict each other: this criterion does not depend on a choice of "
            "parameters; remove --parameters, or add for example worst"
        )
    return Wanted(
        criteria=weights,
        parameters=_listed(parameters),
        effects=to_name,
        measured=None if augment is None else positions_of(augment, rig),
        compared=tuple(positions_of(path, rig) for path in compare),
        **options,
    )


def _listed(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())
