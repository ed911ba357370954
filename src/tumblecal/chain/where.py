"""Where and when each position was measured: the inputs of the chain, one entry a position."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from tumblecal.ground.angle_settings import setting_angle, setting_index
from tumblecal.ground.clocks import times_going_on
from tumblecal.ground.errors import InputError
from tumblecal.ground.showing import brief


Column = Float[Array | np.ndarray, " positions"]

# Positions are at least this share of the median step apart in time.
_LEAST_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Where:
    """The settings of a set of positions.

    Angles in rad, commanded or read, time in s, temperature in degC. An optional column that was not recorded is `None`.
    `groups` gives for each index column (pitch setting, mount, run, position) the group of every position; `labels`
    the groups' names. There is a column `clock` only where the times count by several clocks: from one to the next the pause
    is unknown. `mean_time_s`, `mean_degc`: the means of both columns where they were measured, the same for every position;
    squares count from them, at other times and temperatures too. `inputs_before`: the ideal inputs u at the position measured
    before in the same run and mounting (at the first: its own), g, as a chain shows them to those of its links that look back.
    """

    __repr__ = brief

    alpha: Column
    beta: Column
    groups: dict[str, Int[Array | np.ndarray, " positions"]]
    time_s: Column | None
    temperature_degc: Column | None
    approach: Column | None
    labels: tuple[tuple[str, tuple[str, ...]], ...]
    mean_time_s: Column | None = None
    mean_degc: Column | None = None
    inputs_before: tuple[Column, Column, Column] | None = None

    def index(self, by: str) -> Int[Array | np.ndarray, " positions"]:
        """The group of every position for an index column or a combination such as `run.pitch`."""
        return self.groups[by]

    def names(self, by: str) -> tuple[str, ...]:
        """The suffixes that tell the groups' parameters apart, e.g. `("_0", "_1")` or `("_0@run=1", ...)`."""
        return dict(self.labels)[by]

    @property
    def clocks(self) -> int:
        """Number of clocks that the times count by."""
        return len(self.names("clock")) if "clock" in self.groups else 1

    @property
    def clock_starts(self) -> list[int]:
        """The number of the first position by each clock; of the first position of all where there is one clock."""
        time = np.zeros(len(np.asarray(self.alpha))) if self.time_s is None else np.asarray(self.time_s)
        clock = np.asarray(self.index("clock")) if self.clocks > 1 else np.zeros(len(time), int)
        return [int(np.argmin(np.where(clock == number, time, np.inf))) for number in range(self.clocks)]

    @property
    def in_order(self) -> Int[Array, " positions"]:
        """The positions' numbers in measuring order, run by run."""
        run = jnp.asarray(self.index("run"))
        time = jnp.arange(len(run)) if self.time_s is None else jnp.asarray(self.time_s)
        return jnp.lexsort((time, run))

    def earlier(self, within: str) -> Int[Array, " positions"]:
        """The number of the position measured before each; its own at the first of a run, or of another group."""
        order, group = self.in_order, jnp.asarray(self.index(within))
        before = jnp.zeros_like(order).at[order].set(jnp.concatenate([order[:1], order[:-1]]))
        return jnp.where(group[before] == group, before, jnp.arange(len(order)))

    def at_rows(self, rows: Int[Array | np.ndarray, " positions"]) -> "Where":
        """The settings of these rows in the place of each."""
        columns = {name: getattr(self, name) for name in _COLUMNS if name not in ("groups", "inputs_before")}
        taken = {name: None if column is None else jnp.asarray(column)[rows] for name, column in columns.items()}
        groups = {name: jnp.asarray(index)[rows] for name, index in self.groups.items()}
        return replace(self, groups=groups, **taken)

    @cached_property
    def pitch_angle(self) -> Float[np.ndarray, " positions"]:
        """The angle that each position's pitch setting is called by, rad: `beta`, but where it was read and not commanded."""
        return setting_angle(np.asarray(self.beta), np.asarray(self.index("pitch")))

    @cached_property
    def attitude(self) -> Int[np.ndarray, " positions"]:
        """A number for each position: the same for those that repeat an attitude (angles and mounting)."""
        columns = [np.round(np.asarray(self.alpha), 6), np.round(np.asarray(self.beta), 6), self.index("mount")]
        return np.unique(np.stack(columns, axis=1), axis=0, return_inverse=True)[1].ravel()

    @cached_property
    def measuring_order(self) -> Float[np.ndarray, " positions"]:
        """Time in median steps between positions: from time_s where there is one, else the order of the rows."""
        count = len(np.asarray(self.alpha))
        if self.time_s is None or np.ptp(np.asarray(self.time_s)) == 0:
            return np.arange(count, dtype=float)
        time = self._going_on(np.asarray(self.time_s, float))
        # A pause (another day) is no reason to take neighbours for simultaneous.
        step = float(np.median(np.diff(np.sort(time)))) or np.ptp(time) / (count - 1)
        order = np.argsort(time, kind="stable")
        steps = np.diff(time[order]) / step
        if np.all(steps >= _LEAST_STEP):
            return (time - time.min()) / step
        # Positions of the same time stay apart: their noise is not one and the same number.
        apart = np.zeros(count)
        apart[order[1:]] = np.cumsum(np.maximum(steps, _LEAST_STEP))
        return apart

    def _going_on(self, time: Float[np.ndarray, " positions"]) -> Float[np.ndarray, " positions"]:
        """Times of runs each of which has a clock of its own, one run after the other; as they are where runs lie apart."""
        run = np.asarray(self.index("run"))
        runs = [run == number for number in np.unique(run)]
        spans = sorted((time[own].min(), time[own].max()) for own in runs)
        if all(before[1] <= after[0] for before, after in pairwise(spans)):
            return time
        going_on = np.empty_like(time)
        going_on[np.argsort(run, kind="stable")] = times_going_on([time[own] for own in runs])
        return going_on


_COLUMNS = (
    "alpha",
    "beta",
    "groups",
    "time_s",
    "temperature_degc",
    "approach",
    "mean_time_s",
    "mean_degc",
    "inputs_before",
)


def _flattened(where: Where) -> tuple[tuple, tuple]:
    return tuple(getattr(where, name) for name in _COLUMNS), where.labels


def _unflattened(labels: tuple, columns: Sequence[Any]) -> Where:
    """As JAX puts it together again: not always of arrays, so nothing of it is checked."""
    where = object.__new__(Where)
    vars(where).update(zip(_COLUMNS, columns, strict=True), labels=labels)
    return where


jax.tree_util.register_pytree_node(Where, _flattened, _unflattened)


def settings(
    alpha: Sequence[float] | np.ndarray,
    beta: Sequence[float] | np.ndarray,
    *,
    pitch: Int[np.ndarray, " positions"] | None = None,
    run: Sequence[str] | None = None,
    mount: Sequence[str] | None = None,
    time_s: Sequence[float] | np.ndarray | None = None,
    temperature_degc: Sequence[float] | np.ndarray | None = None,
    approach: Sequence[float] | np.ndarray | None = None,
    clock: Sequence[str] | None = None,
) -> Where:
    """Settings of positions from their columns.

    **Arguments:**

    - `alpha`, `beta`: spindle and pitch angles, commanded or read, rad.
    - `pitch`: number of each position's pitch setting; told by beta where left out (`angle_settings.py`).
    - `run`, `mount`: labels of the run and of the mounting; all the same where left out.
    - `time_s`, `temperature_degc`, `approach`: optional columns (s, degC, +1 or -1).
    - `clock`: labels of the clock that `time_s` counts by; one for all where left out.

    **Returns:** the settings; pitch settings are numbered by increasing beta, runs and mounts as they first appear.
    """
    alpha, beta = np.asarray(alpha, float), np.asarray(beta, float)
    if alpha.shape != beta.shape or alpha.ndim != 1:
        raise ValueError(f"alpha {alpha.shape} and beta {beta.shape} must be one-dimensional and equally long")
    count = len(alpha)
    pitch = setting_index(beta, held=True) if pitch is None else pitch
    columns = {
        "pitch": [f"_{setting}" for setting in pitch],
        "mount": [f"@mount={label}" for label in (mount if mount is not None else ["1"] * count)],
        "run": [f"@run={label}" for label in (run if run is not None else ["1"] * count)],
        "position": [f"_{number}" for number in range(count)],
    }
    if clock is not None and len(set(clock)) > 1:
        columns["clock"] = [f"@clock={label}" for label in clock]
    for name in ("run.pitch", "mount.pitch", "run.mount", "run.mount.pitch"):
        parts = [columns[part] for part in reversed(name.split("."))]
        columns[name] = ["".join(texts) for texts in zip(*parts, strict=True)]
    groups, labels = {}, []
    for name, texts in columns.items():
        order = list(dict.fromkeys(texts))
        if name == "pitch":
            order.sort(key=lambda text: int(text[1:]))
        number = {text: k for k, text in enumerate(order)}
        groups[name] = np.array([number[text] for text in texts], dtype=np.int64)
        labels.append((name, tuple(order)))

    time, degc, side = (None if own is None else np.asarray(own, float) for own in (time_s, temperature_degc, approach))
    mean_time, mean_degc = (None if own is None else np.full(count, np.mean(own)) for own in (time, degc))
    return Where(alpha, beta, groups, time, degc, side, tuple(labels), mean_time, mean_degc)


def check_index(by: str, where: Where) -> None:
    """Refuse an index that is not one of the data's columns.

    **Raises:** `InputError` naming the ones there are.
    """
    if by not in where.groups:
        raise InputError(f"no index column {by!r}; there are {', '.join(where.groups)}")
