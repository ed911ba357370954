"""A wanted plan: limits, criteria, effects to be named."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from tumblecal.chain.head_ability import Times
from tumblecal.ground.errors import InputError
from tumblecal.plan.cells import Positions
from tumblecal.plan.order import Kind
from tumblecal.plan.responses import Responses


# Criteria of the covariance, and further ones.
COVARIANCE = ("worst", "mean", "volume", "in_use", "in_use_largest")
CRITERIA = (*COVARIANCE, "naming", "alias")
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
        if self.positions is not None:
            count, stated = self.positions, f"--positions {self.positions}"
        else:
            count, stated = 60 * (self.minutes or 0) / (times.dwell_s + times.settle_s), f"--minutes {self.minutes}"
        if count > MOST_POSITIONS:
            raise InputError(f"{stated}: {count:.0f} positions; a plan has at most {MOST_POSITIONS}")

    def parameters_of(self, responses: Responses) -> tuple[str, ...] | None:
        """The parameters by name, those of a leaf together; None: all of the sensor.

        **Raises:** `InputError` for one that the rig does not have.
        """
        names = dict[str, None]()
        for wanted in self.parameters:
            of_leaf = [name for name in responses.names if name == wanted or name.startswith(f"{wanted}_")]
            if not of_leaf:
                raise InputError(f"--parameters {wanted}: no such parameter; parameters: {', '.join(responses.names)}")
            names |= dict.fromkeys(of_leaf)
        return tuple(names) or None
