"""A set of positions: commanded angles, readings and recorded conditions, checked once."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from tumblecal.data.position_comments import ATTITUDES, UNKNOWN, serial_number_of
from tumblecal.ground.angle_settings import look_like_radians, setting_angle, setting_index
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import STANDARD, Gravity, comments_of, stated_gravity
from tumblecal.ground.showing import Screen, Shown
from tumblecal.ground.suggested_command import states


if TYPE_CHECKING:
    import polars as pl


Rows = Float[np.ndarray, " positions"]
# Columns of a set: labels and numbers that need not be recorded; and all of them.
LABELS, NUMBERS = ("run", "mount", "clock", "recorded_noise"), ("time_s", "temperature_degc", "approach", "n")
# This many consecutive rows of one name and setting are samples of one dwell.
_LIKE_SAMPLES = 16
COLUMNS = ("names", "alpha_deg", "beta_deg", "readings", "sd", *LABELS, *NUMBERS)


def joined_arguments(files: Sequence[str]) -> tuple[str | Path, ...]:
    """Arguments of a command that diagnoses files as one measurement, of one run unless the user stated runs."""
    if len(files) < 2:
        return (*map(Path, files),)
    same_run = states("--same-run") or not states("--join")
    return "--join", *(["--same-run"] if same_run else []), *map(Path, files)


def stretches(columns: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Rows of each stretch in which no column changes."""
    changed = np.zeros(len(columns[0]), bool)
    for column in columns:
        changed[1:] |= column[1:] != column[:-1]
    return np.split(np.arange(len(changed)), np.flatnonzero(changed))


def attitudes_of(readings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Spindle and pitch angles (deg) at which an ideal triad has the direction of these readings."""
    unit = readings / np.linalg.norm(readings, axis=1, keepdims=True)
    return np.degrees(np.arctan2(unit[:, 1], unit[:, 2])), np.degrees(np.arcsin(np.clip(-unit[:, 0], -1.0, 1.0)))


@dataclass(frozen=True, repr=False)
class PositionSet(Shown):
    """Position means of one triad on a dividing head.

    Angles in degrees, commanded or read; readings and their standard deviations in g; time in s; temperature in degC.
    Optional columns that were not recorded are None. `comments` are the `# key: value` lines of the file, `source` is its
    name. `clock`: label of the clock of each row, with unknown pauses between clocks; None: one clock. `recorded_noise`:
    for each row, the comment `noise_model` of its recording. `in_ms2`: whether readings in m/s^2 were divided by the
    gravity. `files`: files whose positions were joined. `ignored`: columns of the file that are not used.

    **Raises:** `InputError` for columns of a wrong length or shape, numbers that are not finite, or sd not above 0.

    Examples:
        >>> import numpy as np
        >>> from tumblecal.data import PositionSet
        >>> up_down = np.array([[0.001, 0.0, 1.002], [0.001, 0.0, -0.998]])  # g
        >>> data = PositionSet(("up", "down"), np.array([0.0, 180.0]), np.zeros(2), up_down)
        >>> len(data), data.readings.shape, data.time_s
        (2, (2, 3), None)
        >>> PositionSet(("up",), np.zeros(1), np.zeros(1), np.full((1, 3), np.nan))
        Traceback (most recent call last):
        tumblecal.ground.errors.InputError: positions: readings has numbers that are not finite; remove these positions
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
    clock: tuple[str, ...] | None = None
    recorded_noise: tuple[str, ...] | None = None
    comments: dict[str, str] = field(default_factory=dict)
    source: str = "positions"
    in_ms2: bool = False
    files: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if faults := list(self._faults()):
            raise InputError(faults)

    @classmethod
    def from_arrays(
        cls,
        readings: ArrayLike,
        alpha: ArrayLike,
        beta: ArrayLike,
        *,
        unit: str,
        names: Sequence[str] | None = None,
        sd: ArrayLike | None = None,
        time_s: ArrayLike | None = None,
        temperature_degc: ArrayLike | None = None,
        approach: ArrayLike | None = None,
        n: ArrayLike | None = None,
        run: Sequence[str] | None = None,
        mount: Sequence[str] | None = None,
        comments: Mapping[str, str] | None = None,
        source: str = "arrays",
    ) -> "PositionSet":
        """Positions from lists, numpy or JAX arrays.

        **Arguments:**

        - `readings`: (positions, 3), g. `alpha`, `beta`: spindle and pitch angles in `unit`.
        - `names`: of the positions; numbers from 1 if omitted. `sd`: standard deviations of the readings, g; one number, one
          for each axis, or (positions, 3).
        - other columns as of the class.

        **Raises:** `InputError` as of the class, and for another unit.

        Examples:
            >>> from tumblecal import PositionSet
            >>> data = PositionSet.from_arrays([[0, 0, 1.001], [0, 0, -0.998]], [0, 180], [0, 0], unit="deg", sd=1e-4)
            >>> len(data), data.names, data.sd.shape
            (2, ('1', '2'), (2, 3))
        """
        if unit not in ("deg", "rad"):
            raise InputError(f"unit {unit!r}: the unit of the angles is 'deg' or 'rad'")
        values = np.asarray(readings, float)
        angles = [np.asarray(angle, float) for angle in (alpha, beta)]
        if unit == "rad" and np.max(np.abs(angles[1]), initial=0.0) > 4 * np.pi:
            raise InputError(f"unit 'rad', but beta is up to {np.max(np.abs(angles[1])):.4g}: state unit=\"deg\"")
        if unit == "deg" and any(look_like_radians(angle) for angle in angles if len(np.unique(angle)) > 2):
            raise InputError("unit 'deg', but the angles look like radians: state unit=\"rad\"")
        given = {"time_s": time_s, "temperature_degc": temperature_degc, "approach": approach, "n": n}
        columns: dict[str, Any] = {
            name: np.asarray(column, float) for name, column in given.items() if column is not None
        }
        alpha_deg, beta_deg = angles if unit == "deg" else map(np.degrees, angles)
        return cls(
            names=tuple(map(str, range(1, len(values) + 1))) if names is None else tuple(names),
            alpha_deg=alpha_deg,
            beta_deg=beta_deg,
            readings=values,
            sd=None if sd is None else np.broadcast_to(np.asarray(sd, float), values.shape).copy(),
            run=None if run is None else tuple(run),
            mount=None if mount is None else tuple(mount),
            comments=dict(comments or {}),
            source=source,
            **columns,
        )

    def _faults(self) -> Iterator[str]:
        count = len(self.names)
        for name in COLUMNS[1:]:
            values = getattr(self, name)
            shape = (count, 3) if name in ("readings", "sd") else (count,)
            if values is None and name not in COLUMNS[:4]:
                continue
            if name in LABELS:
                if count != (number := len(values or ())):
                    yield f"{self.source}: {name} has {number} labels; it must have {count}, one for each name"
            elif not isinstance(values, np.ndarray):
                kind = type(values).__name__
                yield f"{self.source}: {name} is of type {kind}; it must be a numpy array (from_arrays takes others)"
            elif values.shape != shape:
                yield f"{self.source}: {name} has the shape {values.shape}; it must be {shape}, for {count} names"
            elif not np.all(np.isfinite(values)):
                yield f"{self.source}: {name} has numbers that are not finite; remove these positions"
            elif name == "sd" and not np.all(values > 0):
                yield f"{self.source}: sd must be above 0"

    def __len__(self) -> int:
        return len(self.names)

    @property
    def columns(self) -> dict[str, Sequence[object]]:
        """The recorded columns by their names in a position file, angles in deg, readings in g."""
        columns: dict[str, Sequence[object] | np.ndarray | None] = {"position": self.names}
        columns |= {"alpha_deg": self.alpha_deg, "beta_deg": self.beta_deg}
        columns |= dict(zip((f"a{axis}_g" for axis in AXES), self.readings.T, strict=True))
        columns |= {"run": self.run, "mount": self.mount, "time_clock": self.clock}
        columns |= {name: getattr(self, name) for name in NUMBERS}
        columns |= {} if self.sd is None else dict(zip((f"a{axis}_sd_g" for axis in AXES), self.sd.T, strict=True))
        found = {name: values for name, values in columns.items() if values is not None}
        return {name: values.tolist() if isinstance(values, np.ndarray) else values for name, values in found.items()}

    def table(self) -> "pl.DataFrame":
        """The columns as a table."""
        import polars as pl

        return pl.DataFrame(self.columns)

    def screen(self) -> Screen:
        """Source and first rows."""
        rows = zip(*self.columns.values(), strict=True)
        cells = [[f"{cell:.6g}" if isinstance(cell, float) else str(cell) for cell in row] for row in rows]
        facts = [f"{self.source}: {len(self)} positions", *filter(None, [self.serial_number])]
        gravity = f"one g is {self.gravity}" if self.gravity else "the file does not state the gravity of one g"
        return Screen(", serial number ".join(facts), list(self.columns), cells, [gravity])

    @property
    def alpha(self) -> Rows:
        """Spindle angles, rad."""
        return np.radians(self.alpha_deg)

    @property
    def beta(self) -> Rows:
        """Pitch angles, rad."""
        return np.radians(self.beta_deg)

    @property
    def pitch_setting_deg(self) -> Rows:
        """The nominal pitch angle of the setting of each position, deg: `beta_deg`, except for angles that were read."""
        if self.hand_held:
            return self.beta_deg
        index = setting_index(self.beta, held=True)
        nominal = setting_angle(self.beta, index)
        return np.where(nominal == self.beta, self.beta_deg, np.round(np.degrees(nominal), 6))

    @property
    def weighing_sd(self) -> Float[np.ndarray, "positions 3"] | None:
        """Standard deviations for the weights of the readings, g; for few samples moderated by those of all positions."""
        if self.sd is None or self.n is None or self.recorded_noise is not None:
            return self.sd
        from tumblecal.data.few_samples import moderated, of_few  # imports scipy

        return moderated(self.sd, self.n) if of_few(self.n) else self.sd

    @property
    def gravity(self) -> Gravity | None:
        """One g of the readings, from the comments; None if not stated."""
        return stated_gravity(self.comments, self.source)

    @property
    def as_arguments(self) -> tuple[str | Path, ...]:
        """Arguments of a command that diagnoses its files as one measurement."""
        return joined_arguments(self.files or (self.source,))

    @property
    def serial_number(self) -> str | None:
        """Serial number of the unit, from the comments; None if not stated."""
        return serial_number_of(self.comments)

    def under(self, gravity: Gravity) -> "PositionSet":
        """The same positions with this gravity: readings in m/s^2 are divided by it."""
        comments = self.comments | comments_of(gravity)
        if not self.in_ms2:
            return replace(self, comments=comments)
        ratio = (self.gravity or STANDARD).in_g_of(gravity)
        sd = None if self.sd is None else self.sd * ratio
        return replace(self, readings=self.readings * ratio, sd=sd, comments=comments)

    @property
    def attitudes(self) -> str | None:
        """How the attitudes were set (`BY_HEAD`, `BY_HAND`, `UNKNOWN`); None if it is not stated."""
        return self.comments.get(ATTITUDES)

    @property
    def hand_held(self) -> bool:
        """Whether the attitudes are unknown: the angles are then estimates from the readings."""
        return self.attitudes == UNKNOWN

    @property
    def stretches(self) -> int:
        """Number of stretches of consecutive rows with the same name and angles."""
        return len(stretches([np.array(self.names, dtype=object), self.alpha_deg, self.beta_deg]))

    @property
    def of_samples(self) -> bool:
        """Whether the rows are samples of dwells, not means."""
        return len(self) >= _LIKE_SAMPLES * self.stretches

    @property
    def runs(self) -> tuple[str, ...]:
        """Labels of the runs in order of appearance; one run `1` if none is given."""
        return tuple(dict.fromkeys(self.labels("run")))

    def labels(self, column: Literal["run", "mount", "clock"]) -> tuple[str, ...]:
        """Label of each position in a column; all `1` if it is not given."""
        return getattr(self, column) or ("1",) * len(self)

    @property
    def mountings(self) -> dict[str, Bool[np.ndarray, " positions"]]:
        """The rows of each mounting, in order of appearance."""
        mount = np.array(self.labels("mount"))
        return {label: mount == label for label in dict.fromkeys(mount.tolist())}

    def chosen(self, rows: Sequence[int] | np.ndarray) -> "PositionSet":
        """The set of these rows (indices or a mask), in that order."""
        index = np.arange(len(self))[np.asarray(rows) if len(rows) else []]
        columns = {name: values for name in COLUMNS if (values := getattr(self, name)) is not None}
        for name, values in columns.items():
            columns[name] = tuple(values[row] for row in index) if isinstance(values, tuple) else values[index]
        return replace(self, **columns)
