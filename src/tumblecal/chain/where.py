"""Angles, times and conditions of each position: the inputs of the chain, one entry for each position."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from operator import is_
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from tumblecal.ground.angle_settings import setting_angle, setting_index
from tumblecal.ground.clocks import continued_times
from tumblecal.ground.errors import InputError
from tumblecal.ground.showing import brief
from tumblecal.ground.soaks import soaks


Column = Float[Array | np.ndarray, " positions"]

# A dependence on temperature over a smaller range (degC) is a straight line for usual sensors, as far as data can show.
LEAST_RANGE_DEGC = 10.0
# Positions in each tenth of the range that has any, on average; a ramp has fewer.
_LEAST_IN_SOAK = 3
# Smallest time between positions, as a share of the median step.
_LEAST_STEP = 1e-3
# Two turns, rad: a pitch angle beyond is one in degrees.
_MOST_PITCH = 4 * np.pi


@dataclass(frozen=True, eq=False)
class Where:
    """The settings of a set of positions.

    Angles in rad, commanded or recorded, time in s, temperature in degC. An optional column that was not recorded is `None`.
    `groups` gives for each index column (pitch setting, mount, run, position) the group of every position; `labels` the names
    of the groups. There is a column `clock` only if the times are from several clocks; the pauses between them are unknown.
    `mean_time_s`, `mean_degc`: the means of both columns, if measured, the same for every position; the reference of squares,
    also at other times and temperatures. `inputs_before`: the ideal inputs u at the previous position in the same run and
    mounting (for the first position: at itself), g; a chain provides them to links that look back.

    Examples:
        >>> from tumblecal.chain import settings
        >>> where = settings([0.0, 1.5], [0.0, 0.8], run=["a", "b"])
        >>> where.names("pitch"), where.names("run"), where.index("run").tolist()
        (('_0', '_1'), ('@run=a', '@run=b'), [0, 1])
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
        """The suffixes that distinguish the parameters of the groups, such as `("_0", "_1")` or `("_0@run=1", ...)`."""
        return dict(self.labels)[by]

    @property
    def clocks(self) -> int:
        """Number of clocks of the times."""
        return len(self.names("clock")) if "clock" in self.groups else 1

    @property
    def clock_starts(self) -> list[int]:
        """The number of the first position by each clock; with one clock, of the first position of all."""
        time = np.zeros(len(np.asarray(self.alpha))) if self.time_s is None else np.asarray(self.time_s)
        clock = np.asarray(self.index("clock")) if self.clocks > 1 else np.zeros(len(time), int)
        return [int(np.argmin(np.where(clock == number, time, np.inf))) for number in range(self.clocks)]

    @property
    def in_order(self) -> Int[Array, " positions"]:
        """The numbers of the positions in measuring order, run by run."""
        return _in_order(self, jnp)

    def earlier(self, within: str) -> Int[Array, " positions"]:
        """The number of the previous position; for the first of a run, or of another group, its own number."""
        order, group = self.in_order, jnp.asarray(self.index(within))
        before = jnp.zeros_like(order).at[order].set(jnp.concatenate([order[:1], order[:-1]]))
        return jnp.where(group[before] == group, before, jnp.arange(len(order)))

    def at_rows(self, rows: Int[Array | np.ndarray, " positions"]) -> "Where":
        """The settings with each position replaced by the given row."""
        columns = {name: getattr(self, name) for name in _COLUMNS if name not in ("groups", "inputs_before")}
        replaced = {name: None if column is None else jnp.asarray(column)[rows] for name, column in columns.items()}
        groups = {name: jnp.asarray(index)[rows] for name, index in self.groups.items()}
        return replace(self, groups=groups, **replaced)

    @cached_property
    def soaks(self) -> int:
        """Number of soaks over the smallest range that shows a curvature; 0 over a smaller one, and on a ramp.

        On a ramp, a tenth of the range has fewer than three positions on average; a power of the temperature is then also a
        function of the attitude and of time.
        """
        degc = self.temperature_degc
        if degc is None or np.ptp(np.asarray(degc)) < LEAST_RANGE_DEGC:
            return 0
        values = np.asarray(degc)
        tenths = np.unique(np.floor(10 * (values - values.min()) / np.ptp(values)).clip(max=9))
        return len(soaks(values)) if _LEAST_IN_SOAK * len(tenths) <= len(values) else 0

    @cached_property
    def pitch_angle(self) -> Float[np.ndarray, " positions"]:
        """The nominal angle of each position's pitch setting, rad: `beta`, unless it was recorded and not commanded."""
        return setting_angle(np.asarray(self.beta), np.asarray(self.index("pitch")))

    @cached_property
    def attitude(self) -> Int[np.ndarray, " positions"]:
        """A number for each position, equal for positions that repeat an attitude (angles and mounting)."""
        columns = [np.round(np.asarray(self.alpha), 6), np.round(np.asarray(self.beta), 6), self.index("mount")]
        return np.unique(np.stack(columns, axis=1), axis=0, return_inverse=True)[1].ravel()

    @cached_property
    def measuring_order(self) -> Float[np.ndarray, " positions"]:
        """Time in median steps between positions: from time_s if there is one, otherwise the order of the rows."""
        count = len(np.asarray(self.alpha))
        if self.time_s is None or np.ptp(np.asarray(self.time_s)) == 0:
            return np.arange(count, dtype=float)
        time = self._going_on(np.asarray(self.time_s, float))
        # The median, because a long pause (another day) must not make neighbours appear simultaneous.
        step = float(np.median(np.diff(np.sort(time)))) or np.ptp(time) / (count - 1)
        order = np.argsort(time, kind="stable")
        steps = np.diff(time[order]) / step
        if np.all(steps >= _LEAST_STEP):
            return (time - time.min()) / step
        # Positions with equal times are separated, because their noise is not identical.
        separated = np.zeros(count)
        separated[order[1:]] = np.cumsum(np.maximum(steps, _LEAST_STEP))
        return separated

    def _going_on(self, time: Float[np.ndarray, " positions"]) -> Float[np.ndarray, " positions"]:
        """Times one run after the other, if each run has a separate clock; unchanged if the runs do not overlap."""
        run = np.asarray(self.index("run"))
        runs = [run == number for number in np.unique(run)]
        spans = sorted((time[rows].min(), time[rows].max()) for rows in runs)
        if all(before[1] <= after[0] for before, after in pairwise(spans)):
            return time
        going_on = np.empty_like(time)
        going_on[np.argsort(run, kind="stable")] = continued_times([time[rows] for rows in runs])
        return going_on


class _Carried:
    """Values that a tree carries along unchanged, compared by identity: they may be arrays, tables, anything."""

    def __init__(self, values: tuple):
        self.values = values

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Carried) and all(map(is_, self.values, other.values))

    def __hash__(self) -> int:
        return hash(tuple(map(id, self.values)))

    def __repr__(self) -> str:
        # The same in every process: stored programs, which do not depend on the values, are found by it.
        return "carried"


def register_unchecked(cls: type, traced: Sequence[str], static: Sequence[str], carried: Sequence[str] = ()) -> None:
    """Register a dataclass as a pytree of its fields; JAX reconstructs it without checks, because its leaves are not always
    arrays.

    **Arguments:**

    - `traced`: fields that are children. `static`: hashable fields on whose values compiled programs depend.
    - `carried`: further fields, the same objects after any transformation. A program that takes such a tree is compiled for
      these objects.
    """

    def flattened(tree: Any) -> tuple[tuple, tuple]:
        children, values, along = ([getattr(tree, name) for name in names] for names in (traced, static, carried))
        return tuple(children), (tuple(values), _Carried(tuple(along)))

    def unflattened(stated: tuple[tuple, _Carried], leaves: Sequence[Any]) -> Any:
        tree, (values, along) = object.__new__(cls), stated
        for names, own in ((traced, leaves), (static, values), (carried, along.values)):
            vars(tree).update(zip(names, own, strict=True))
        return tree

    jax.tree_util.register_pytree_node(cls, flattened, unflattened)


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
register_unchecked(Where, _COLUMNS, ("labels",))


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

    - `alpha`, `beta`: spindle and pitch angles, commanded or recorded, rad.
    - `pitch`: number of each position's pitch setting; found from beta if omitted (`angle_settings.py`).
    - `run`, `mount`: labels of the run and of the mounting; all equal if omitted.
    - `time_s`, `temperature_degc`, `approach`: optional columns (s, degC, +1 or -1).
    - `clock`: labels of the clock of `time_s`; one for all if omitted.

    **Returns:** the settings; pitch settings are numbered by increasing beta, runs and mounts as they first appear.

    **Raises:** `InputError` for angles that are not two columns of one length, not finite, or pitch angles in degrees.

    Examples:
        >>> import numpy as np
        >>> from tumblecal.chain import settings
        >>> alpha, beta = np.radians([0, 90, 0, 90]), np.radians([0, 0, 45, 45])
        >>> settings(alpha, beta, temperature_degc=[25.0, 25.1, 25.2, 25.3]).index("pitch").tolist()
        [0, 0, 1, 1]
    """
    alpha, beta = np.asarray(alpha, float), np.asarray(beta, float)
    if alpha.shape != beta.shape or alpha.ndim != 1:
        raise InputError(f"alpha {alpha.shape} and beta {beta.shape} must be one-dimensional and equally long")
    if not np.all(np.isfinite([alpha, beta])):
        raise InputError("alpha or beta has numbers that are not finite; remove these positions")
    if (largest := np.max(np.abs(beta), initial=0.0)) > _MOST_PITCH:
        raise InputError(
            f"beta is up to {largest:.4g} rad: these look like degrees; convert both angles with np.radians"
        )
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

    optional = (time_s, temperature_degc, approach)
    time, degc, side = (None if column is None else np.asarray(column, float) for column in optional)
    mean_time, mean_degc = (None if column is None else np.full(count, np.mean(column)) for column in (time, degc))
    return Where(alpha, beta, groups, time, degc, side, tuple(labels), mean_time, mean_degc)


# Visits of a pitch setting, and of a mounting: the columns of which a change, in measuring order, begins a visit, and the one
# that names the setting.
VISITS = {"pitch_visit": ("run.mount.pitch", "pitch"), "mount_visit": ("run.mount", "mount")}


def _in_order(where: Where, numpy: Any) -> Any:
    """`Where.in_order` by numpy or by JAX's."""
    run = numpy.asarray(where.index("run"))
    time = numpy.arange(len(run)) if where.time_s is None else numpy.asarray(where.time_s)
    return numpy.lexsort((time, run))


def with_visits(where: Where, by: Collection[str | None]) -> Where:
    """The settings with those of the index columns `by` that number visits: each time a setting is set again is another group,
    named by the setting and the number of the visit (`_0@visit=3`)."""
    # In numpy: JAX would compile the order for each number of positions.
    groups, labels, order = dict(where.groups), list(where.labels), _in_order(where, np)
    for name, (changing, setting) in VISITS.items():
        if name not in by or name in groups:
            continue
        ordered = np.asarray(where.index(changing))[order]
        groups[name] = np.zeros(len(order), np.int64)
        groups[name][order] = np.concatenate([[0], np.cumsum(ordered[1:] != ordered[:-1])])
        first = np.unique(groups[name], return_index=True)[1]
        names = [where.names(setting)[group] for group in np.asarray(where.index(setting))[first]]
        labels.append((name, tuple(f"{suffix}@visit={number}" for number, suffix in enumerate(names, start=1))))
    return replace(where, groups=groups, labels=tuple(labels)) if len(labels) > len(where.labels) else where


def check_index(by: str, where: Where) -> None:
    """Reject an index that is not a column of the data.

    **Raises:** `InputError` with the available columns.
    """
    if by not in where.groups:
        raise InputError(f"no index column {by!r}; the columns are {', '.join([*where.groups, *VISITS])}")
