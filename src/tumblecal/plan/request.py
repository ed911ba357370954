"""A wanted plan, and a head, as they are stated in texts and files: limits, criteria, effects to be named, other positions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from tumblecal.capture.capture_plan import read_plan
from tumblecal.chain.head_ability import HeadAbilityTable, Times
from tumblecal.chain.plan_table import PlanTable
from tumblecal.chain.rig import Rig
from tumblecal.data import read_positions
from tumblecal.effects.catalogue import Catalogue, entry
from tumblecal.ground.errors import InputError
from tumblecal.ground.option_texts import angles, numbers, pairs, sizes
from tumblecal.ground.strict_toml import checked, read_toml
from tumblecal.plan.cells import Cells, Positions
from tumblecal.plan.order import Kind


CRITERIA = ("worst", "mean", "volume", "in_use", "in_use_largest", "naming", "alias")
# Positions of a plan if neither their number nor the time is stated.
POSITIONS = 24
# Covariances of more positions take too long.
MOST_POSITIONS = 2000


@dataclass(frozen=True)
class Wanted:
    """A wanted plan.

    - `positions`, `minutes`: number of new positions, and time for them; None: not stated.
    - `criteria`: weights of the criteria by name. `parameters`: those that the criteria are about; none: all of the sensor.
    - `effects`: sizes of effects that are to be named, in the unit of each.
    - `order`: of the positions. `restarts`, `seed`: of the search.
    - `measured`: positions that are measured already. `compared`: further plans to compare.
    - `forecast`: whether to forecast the diagnosis.
    """

    positions: int | None = None
    minutes: float | None = None
    criteria: Mapping[str, float] = field(default_factory=lambda: {"worst": 1.0})
    parameters: tuple[str, ...] = ()
    effects: Mapping[str, float] = field(default_factory=dict)
    order: Kind = "best"
    restarts: int = 4
    seed: int = 0
    measured: Positions | None = None
    compared: tuple[Positions, ...] = ()
    forecast: bool = True

    @property
    def count(self) -> int | None:
        """Number of new positions, if it is limited."""
        return POSITIONS if self.positions is None and self.minutes is None else self.positions

    def check_size(self, times: Times) -> None:
        """Check that the plan is not too large.

        **Raises:** `InputError` for more than `MOST_POSITIONS`.
        """
        count, stated = self.count, f"--positions {self.positions}"
        if count is None:
            count, stated = 60 * (self.minutes or 0) / (times.dwell_s + times.settle_s), f"--minutes {self.minutes}"
        if count > MOST_POSITIONS:
            raise InputError(f"{stated}: {count:.0f} positions; a plan has at most {MOST_POSITIONS}")

    def parameters_of(self, names: Sequence[str]) -> list[str] | None:
        """The parameters among the names of a rig's parameters, those of a leaf together; None: all of the sensor.

        **Raises:** `InputError` for one that the rig does not have.
        """
        found = list[str]()
        for wanted in self.parameters:
            of_leaf = [name for name in names if name == wanted or name.startswith(f"{wanted}_")]
            if not of_leaf:
                raise InputError(f"--parameters {wanted}: no such parameter; parameters: {', '.join(names)}")
            found += of_leaf
        return found or None


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
    _require_mounts(rig, mounts or ability.mounts, f"{rig.source}: {'--allow-mount' if mounts else 'head.mounts'}")
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
    measured, *compared = (None if path is None else positions_of(path, rig) for path in (augment, *compare))
    positions = {"measured": measured, "compared": tuple(compared)}
    return Wanted(criteria=weights, parameters=_listed(parameters), effects=to_name, **positions, **options)


def positions_of(path: Path, rig: Rig) -> Positions:
    """The positions of a plan of capture, a rig or a position file.

    **Raises:** `InputError` for a file of none of these kinds, or with a mounting that the rig does not have.
    """
    mount = (rig.ability.mounts if rig.ability else ("1",))[0]
    if path.suffix != ".toml":
        data = read_positions(path)
        if data.hand_held:
            raise InputError(f"{path}: unknown attitudes; a plan needs alpha_deg and beta_deg")
        rows, degc = (
            zip(data.alpha_deg, data.beta_deg, data.mount or (mount,) * len(data), strict=True),
            data.temperature_degc,
        )
    elif "plan" in (content := read_toml(path)):
        plan = checked(path, content["plan"], PlanTable).plan()
        rows, degc = zip(plan.alpha_deg, plan.beta_deg, plan.mounts, strict=True), plan.temperature_degc
    else:
        captured = read_plan(path)
        rows = ((step.alpha_deg, step.beta_deg, captured.session.mount) for step in captured.steps)
        listed = [step.temperature_degc for step in captured.steps if step.temperature_degc is not None]
        degc = listed if captured.over_temperature else None
    cells = Cells.listed(rows, degc)
    _require_mounts(rig, cells.mounts, str(path))
    return Positions(path.name, "", cells)


def _require_mounts(rig: Rig, labels: tuple[str, ...], named: str) -> None:
    """Check that a rig has these mountings.

    **Raises:** `InputError`, with `named` first.
    """
    known = sorted({*rig.mounts, *rig.plan.mounts})
    if unknown := [label for label in labels if label not in known]:
        raise InputError(
            f"{named}: mounting {unknown[0]!r} is not in {rig.source} (mountings: {', '.join(known)}); rename it, or add "
            f"[mounts.{unknown[0]}] with its rotation_deg"
        )


def _listed(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())
