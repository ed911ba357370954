"""A wanted plan: limits, criteria, effects to be named; and its criterion on a head."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Bool

from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.rig import Rig
from tumblecal.design.common_plans import Positions
from tumblecal.design.criteria import Criterion, in_use, mean, volume, worst
from tumblecal.design.exchange import exchange
from tumblecal.design.measure import measures
from tumblecal.design.one_visit import one_visit
from tumblecal.design.responses import Responses
from tumblecal.design.weighted import Weighted
from tumblecal.ground.errors import InputError


Order = Literal["keep", "random", "best"]
# Criteria of the covariance.
COVARIANCE = ("worst", "mean", "volume", "in_use", "in_use_largest")
# Positions of a plan if neither their number nor the time is stated.
POSITIONS = 24


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
    order: Order = "best"
    restarts: int = 4
    seed: int = 0
    measured: Positions | None = None
    compared: tuple[Positions, ...] = ()
    forecast: bool = True

    @property
    def count(self) -> int | None:
        """Number of new positions, if it is limited."""
        return POSITIONS if self.positions is None and self.minutes is None else self.positions

    def parameters_of(self, responses: Responses) -> tuple[str, ...] | None:
        """The parameters by name, those of a leaf together; None: all of the sensor.

        **Raises:** `InputError` for one that the rig does not have.
        """
        names = list[str]()
        for wanted in self.parameters:
            of_leaf = [name for name in responses.names if name == wanted or name.startswith(f"{wanted}_")]
            if not of_leaf:
                raise InputError(f"--parameters {wanted}: no such parameter; parameters: {', '.join(responses.names)}")
            names += of_leaf
        return tuple(dict.fromkeys(names)) or None


def criterion_of(
    wanted: Wanted,
    responses: Responses,
    use: Responses,
    ability: HeadAbility,
    allowed: Bool[np.ndarray, " cells"],
) -> Criterion | Weighted:
    """The criterion of the covariance that is wanted; the first of these if only others (naming, alias) are.

    **Arguments:** `responses`: of the candidates. `use`: of the attitudes in use. `allowed`: candidates that may be chosen.

    **Raises:** `InputError` for an unknown parameter, or if no plan determines any.
    """
    parameters = wanted.parameters_of(responses)
    made = {
        "worst": lambda: worst(responses, parameters),
        "mean": lambda: mean(responses, parameters),
        "volume": lambda: volume(responses, parameters),
        "in_use": lambda: in_use(use, "average"),
        "in_use_largest": lambda: in_use(use, "largest"),
    }
    names = [name for name in COVARIANCE if name in wanted.criteria] or ["worst"]
    criteria = tuple(made[name]() for name in names)
    if len(criteria) == 1:
        return criteria[0]
    # Each relative to its own optimum.
    model = one_visit(responses)
    best = tuple(
        exchange(
            responses,
            ability,
            measures(model, each),
            count=wanted.count,
            minutes=wanted.minutes,
            allowed=allowed,
            restarts=1,
            seed=wanted.seed,
        ).value
        for each in criteria
    )
    return Weighted(criteria, tuple(wanted.criteria[name] for name in names), best)


def rig_positions(rig: Rig) -> Positions:
    """The plan of a rig file."""
    plan = rig.plan
    return Positions("plan of the rig file", "", plan.alpha_deg, plan.beta_deg, plan.mounts)
