"""Readings over temperature: one row for each attitude, branch of the temperature, and temperature bin or soak."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from tumblecal.data.position_comments import ATTITUDES, UNKNOWN
from tumblecal.ground.errors import InputError


_VECTORS = ("readings", "sd", "n_eff")
_NUMBERS = ("alpha_deg", "beta_deg", "n", "temperature_degc", "time_s", "rate_degc_per_s", "direction", "reached_by")
_LABELS = ("attitude", "branch", "clock", "mount")


@dataclass(frozen=True)
class ThermalTable:
    """Means of readings over temperature, in rows of equal weight over temperature.

    **Arguments:**

    - `attitude`: label; rows with one label have the same direction of gravity. `readings` (rows, 3): g.
    - `sd` (rows, 3): standard deviation of each mean at its temperature, g, with the autocorrelation of the noise, the rounding
      of readings, and the noise and resolution of the thermometer. It is relative to the rows before and after: slower noise is
      common to neighbours.
    - `n`: samples of each row. `n_eff` (rows, 3): number of independent samples with the same noise of the mean.
    - `temperature_degc`, `rate_degc_per_s`: means of the smoothed temperature and of its rate. `time_s`: middle, by the clock
      `clock` (label of a recording, or of its part after a restart of the clock); times of different clocks are not comparable.
    - `branch`: label of the monotonic stretch of the temperature (`file:1 up`), to which its soaks belong.
    - `direction`: +1 while the temperature rises, -1 while it falls, 0 in a soak. `reached_by`: +1 if the stretch of the row
      rises (a soak reached from a lower temperature), -1 if it falls, 0 if the temperature does not change.
    - `alpha_deg`, `beta_deg`: angles of the attitude; None if attitudes are unknown. `mount`: label of the mounting, or None.
    - `source`: name of the recordings, `files`: their paths. `comments`: stated gravity, serial
      number and others, as of a position file.

    **Raises:** `InputError` for columns of different lengths, numbers that are not finite, or `sd` not above 0.
    """

    attitude: tuple[str, ...]
    readings: Float[np.ndarray, "rows 3"]
    sd: Float[np.ndarray, "rows 3"]
    n: Float[np.ndarray, " rows"]
    temperature_degc: Float[np.ndarray, " rows"]
    time_s: Float[np.ndarray, " rows"]
    rate_degc_per_s: Float[np.ndarray, " rows"]
    branch: tuple[str, ...]
    direction: Int[np.ndarray, " rows"]
    reached_by: Int[np.ndarray, " rows"]
    clock: tuple[str, ...]
    n_eff: Float[np.ndarray, "rows 3"]
    alpha_deg: Float[np.ndarray, " rows"] | None = None
    beta_deg: Float[np.ndarray, " rows"] | None = None
    mount: tuple[str, ...] | None = None
    source: str = "recording"
    comments: Mapping[str, str] = field(default_factory=dict)
    files: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        rows = len(self.attitude)
        for name in (*_VECTORS, *_NUMBERS):
            values: np.ndarray | None = getattr(self, name)
            if values is None:
                continue
            wanted = (rows, 3) if name in _VECTORS else (rows,)
            if values.shape != wanted:
                raise InputError(f"{self.source}: {name} has the shape {values.shape}; it must be {wanted}")
            if not np.isfinite(values).all():
                raise InputError(f"{self.source}: {name} has numbers that are not finite; remove these rows")
        for name in _LABELS:
            labels = getattr(self, name)
            if labels is not None and len(labels) != rows:
                raise InputError(f"{self.source}: {name} has {len(labels)} labels; it must have {rows}")
        if not (self.sd > 0).all():
            raise InputError(f"{self.source}: sd must be above 0")

    def __len__(self) -> int:
        return len(self.attitude)

    @property
    def known_attitudes(self) -> bool:
        """Whether the angles of the attitudes are known."""
        return self.alpha_deg is not None

    @property
    def attitudes(self) -> tuple[str, ...]:
        """The attitudes, in the order of their first rows."""
        return tuple(dict.fromkeys(self.attitude))

    @property
    def range_degc(self) -> tuple[float, float]:
        """Lowest and highest temperature of a row."""
        return float(self.temperature_degc.min()), float(self.temperature_degc.max())

    @property
    def soak(self) -> np.ndarray:
        """Mask of the rows of soaks."""
        return np.asarray(self.direction == 0)

    def rows(self, which: ArrayLike) -> "ThermalTable":
        """The rows of a mask or of indices."""
        index = np.arange(len(self))[np.asarray(which)]
        stated = {
            name: values for name in (*_VECTORS, *_NUMBERS, *_LABELS) if (values := getattr(self, name)) is not None
        }
        chosen = {
            name: tuple(np.array(v)[index].tolist()) if name in _LABELS else v[index] for name, v in stated.items()
        }
        return replace(self, **chosen)

    @property
    def position_comments(self) -> dict[str, str]:
        """The comments of a position file with these rows."""
        return dict(self.comments) | ({} if self.known_attitudes else {ATTITUDES: UNKNOWN})

    def columns(self) -> dict[str, Sequence[object]]:
        """The columns by their names in a position file."""
        vectors = {f"a{axis}{suffix}": values[:, k].tolist()
                   for suffix, values in (("_g", self.readings), ("_sd_g", self.sd), ("_n_eff", self.n_eff))
                   for k, axis in enumerate("xyz")}  # fmt: skip
        labels = {{"attitude": "position", "clock": "run"}.get(name, name): getattr(self, name) for name in _LABELS}
        numbers = {name: getattr(self, name) for name in _NUMBERS}
        listed = {name: None if values is None else values.tolist() for name, values in numbers.items()}
        return {name: values for name, values in (labels | listed | vectors).items() if values is not None}


def joined(tables: Sequence[ThermalTable], source: str) -> ThermalTable:
    """The rows of several tables. Angles and mountings that only some tables state are kept only if all of them have them."""
    first, *others = tables
    if not others:
        return replace(first, source=source)
    columns: dict[str, object] = {}
    for name in (*_VECTORS, *_NUMBERS, *_LABELS):
        parts = [getattr(table, name) for table in tables]
        stated = all(part is not None for part in parts)
        columns[name] = (sum(parts, ()) if name in _LABELS else np.concatenate(parts)) if stated else None
    same = {key: text for key, text in first.comments.items() if all(t.comments.get(key) == text for t in others)}
    return replace(first, **columns, source=source, comments=same)  # type: ignore[arg-type]
