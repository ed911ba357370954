"""A set of positions: what was commanded, what was read, and what else was recorded, checked once."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from tumblecal.ground.gravity import Gravity, stated_gravity


Rows = Float[np.ndarray, " positions"]

# The comment `# attitudes: unknown` marks a hand-held set.
ATTITUDES, UNKNOWN = "attitudes", "unknown"


@dataclass(frozen=True)
class PositionSet:
    """Position means of one triad on a dividing head.

    Angles in degrees as commanded, readings and their standard deviations in g, time in s, temperature in degC.
    Optional columns that were not recorded are None. `comments` are the file's `# key: value` lines; `source` says
    where it was read from. `recorded_noise` is, for each row, the comment `noise_model` of the recording that it came from.
    """

    names: tuple[str, ...]
    alpha_deg: Rows
    beta_deg: Rows
    readings: Float[np.ndarray, "positions 3"]
    sd: Float[np.ndarray, "positions 3"] | None = None
    run: tuple[str, ...] | None = None
    mount: tuple[str, ...] | None = None
    time_s: Rows | None = None
    temperature_degc: Rows | None = None
    approach: Rows | None = None
    n: Rows | None = None
    recorded_noise: tuple[str, ...] | None = None
    comments: dict[str, str] = field(default_factory=dict)
    source: str = "positions"

    def __len__(self) -> int:
        return len(self.names)

    @property
    def alpha(self) -> Rows:
        """Spindle angles, rad."""
        return np.radians(self.alpha_deg)

    @property
    def beta(self) -> Rows:
        """Pitch angles, rad."""
        return np.radians(self.beta_deg)

    @property
    def gravity(self) -> Gravity | None:
        """What one g of the readings is, by the comments; None where nobody said."""
        return stated_gravity(self.comments, self.source)

    @property
    def hand_held(self) -> bool:
        """Whether the attitudes are unknown: the angles are then only what the readings themselves suggest."""
        return self.comments.get(ATTITUDES) == UNKNOWN

    @property
    def runs(self) -> tuple[str, ...]:
        """Labels of the runs in the order in which they appear; one run `1` where none is given."""
        return tuple(dict.fromkeys(self.run or ("1",)))

    def chosen(self, rows: Sequence[int] | np.ndarray) -> "PositionSet":
        """The set of these rows (indices or a mask), in that order."""
        index = np.arange(len(self))[np.asarray(rows)]
        pick: Callable = lambda values: (  # noqa: E731
            None
            if values is None
            else tuple(values[row] for row in index)
            if isinstance(values, tuple)
            else values[index]
        )
        columns = ("names", "alpha_deg", "beta_deg", "readings", "sd", "run", "mount", "recorded_noise")
        columns += ("time_s", "temperature_degc", "approach", "n")
        return replace(self, **{name: pick(getattr(self, name)) for name in columns})
