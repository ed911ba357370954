"""The forecast of a diagnosis in numbers."""

from dataclasses import dataclass


@dataclass(frozen=True)
class EffectForecast:
    """Forecast for one effect; sizes in `unit`, of every coefficient.

    - `visible_fraction`: share of its signal that the nominal parameters do not absorb.
    - `detected`, `named`, `identified`: probabilities at `size`: that something is detected; that the effect is named, alone or
      among explanations of the same signal (as `study power` counts); that it is the verdict `identified`.
    - `detection_limit`, `smallest_named`, `smallest_identified`: sizes at which these probabilities are 0.8; None: at none.
    - `identical`: effects that are one function with it at 1 g. `not_separated`: others that make its signal, of `size` or at
      the detection limit if that is larger, to within what the diagnosis takes for indistinguishable.
    """

    id: str
    unit: str
    size: float
    visible_fraction: float
    detected: float
    named: float
    identified: float
    detection_limit: float | None
    smallest_named: float | None
    smallest_identified: float | None
    identical: tuple[str, ...]
    not_separated: tuple[str, ...]


@dataclass(frozen=True)
class Alias:
    """The largest error in use, g, of one effect that the calibration does not know, at a size in its unit."""

    effect: str
    size: float
    unit: str
    error_g: float


@dataclass(frozen=True)
class Limit:
    """Detection limit of an effect in its unit; None for an undetectable one."""

    size: float | None
    unit: str


@dataclass(frozen=True)
class NamingForecast:
    """Forecast of the diagnosis of a plan.

    - `effects`: of those asked for. `detection_limits`: size of every effect that is detected with probability 0.8 (every
      coefficient of this size). `undetectable`: those that the nominal parameters absorb.
    - `hidden_on_head`: those of them that no positions on this head show, identities at 1 g among them; the choice of positions
      hides the others.
    - `alias`: the largest error in use that an effect at its detection limit leaves; `alias_of_undetectable`: the same of
      undetectable effects of usual size; None if there are none.
    - `draws`: number of draws of each probability. `not_testable`: reasons by effect.
    """

    effects: tuple[EffectForecast, ...]
    detection_limits: dict[str, Limit]
    undetectable: tuple[str, ...]
    alias: Alias | None
    alias_of_undetectable: Alias | None
    draws: int
    not_testable: dict[str, str]
    hidden_on_head: tuple[str, ...] = ()
