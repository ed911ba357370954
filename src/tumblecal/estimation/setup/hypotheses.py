"""Set-up errors of angles and axes as hypotheses, each with the readings of a perfect instrument under it.

An error in the angles or axes moves whole pitch settings by tenths of a g, whereas the calibration parameters change readings
by hundredths of a g. Therefore a sensor with usual errors of scale, mount and bias is fitted to the readings under each
hypothesis, and the hypothesis with the smallest misfit is chosen. Hypotheses with the same readings count as one.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import combinations, permutations, product
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.data import PositionSet
from tumblecal.estimation.mountings import turn_of, turn_words
from tumblecal.estimation.setup.sensor_fit import EQUAL, misfit, of_rows, ss_with_pitch_errors
from tumblecal.ground.axes import AXES
from tumblecal.ground.frames import gravity_in_head


# The intended rotation of the triad at every position; None for none.
Attitudes = Float[np.ndarray, "positions 3 3"] | None
# Readings (g) that differ by less than this are the same.
SAME = 0.05
# Step of a derivative by the pitch angle, rad.
_STEP = 1e-4
# A deviation below this from the label of a pitch setting is a reading error of the vernier.
_LEAST_SLIP_DEG = 3.0
# An error in one run leaves at least this share of the misfit in that run (the rest is its effect on the common sensor).
_LEAST_OF_RUN = 0.1
# Offsets of the spindle zero below these are errors of the index (one setting) or of the mounting (all settings).
_LEAST_INDEX_DEG, _MOST_TURNED_DEG = 10.0, 20.0
# Largest number of angle steps of a plan that are tried.
_MOST_HOLES = 120
# With more rows than this, an error from some row on is not tried.
_MOST_ROWS = 400
# With fewer positions than this at a pitch setting, an error of one position could be taken for one of the setting.
_FEWEST = 3
# The residual sum of squares under another hypothesis is far smaller below this share.
FAR_SMALLER = 0.4


class Place(NamedTuple):
    """Rows that may have an error of their own: those of a mounting or of a run of it, and of a pitch setting in these.

    - `part`: the run in words. `level`: the setting, deg; NaN for all settings.
    """

    part: str
    rows: Bool[np.ndarray, " positions"]
    level: float = np.nan

    @property
    def of_setting(self) -> bool:
        """Whether it is one pitch setting."""
        return not np.isnan(self.level)

    @property
    def words(self) -> str:
        """The place after the words of an error."""
        return f" at beta {self.level:g} deg{self.part}" if self.of_setting else self.part


@dataclass(frozen=True)
class Hypothesis:
    """One set-up error.

    - `label`: catalogue id. `words`: the error in words. `equal`: ids and words of other errors that produce the same data.
    - `alpha_deg`, `beta_deg`: the true angles under it. `axes`: the matrix that takes readings on the plan's axes to those in
      the file, in the rows `mapped`; None for an error of the angles.
    """

    label: str
    words: str
    alpha_deg: Float[np.ndarray, " positions"]
    beta_deg: Float[np.ndarray, " positions"]
    equal: tuple[tuple[str, str], ...] = ()
    axes: Float[np.ndarray, "3 3"] | None = None
    mapped: Bool[np.ndarray, " positions"] | None = None

    def readings(self, readings: Float[np.ndarray, "positions 3"]) -> Float[np.ndarray, "positions 3"]:
        """Readings (g) on the plan's axes."""
        if self.axes is None or self.mapped is None:
            return readings
        return np.where(self.mapped[:, None], readings @ self.axes, readings)

    def corrected(self, data: PositionSet, rows: Bool[np.ndarray, " positions"]) -> PositionSet:
        """The set with these angles in some rows, and readings on the plan's axes."""
        angles = ((self.alpha_deg, data.alpha_deg), (self.beta_deg, data.beta_deg))
        alpha, beta = (np.where(rows, own, written) for own, written in angles)
        return replace(data, alpha_deg=alpha, beta_deg=beta, readings=self.readings(data.readings))


class AxisMap(NamedTuple):
    """Axes in the wrong columns, or with the wrong sign: the matrix as in `Hypothesis`, in words for all rows and for some, and
    the turn of the triad that is the same, if any."""

    matrix: Float[np.ndarray, "3 3"]
    words: str
    short: str
    equal: tuple[tuple[str, str], ...]


@cache
def axis_maps() -> tuple[AxisMap, ...]:
    """The 47 ways to exchange axes or their signs."""
    found = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        matrix = np.diag(signs) @ np.eye(3)[list(order)]
        if np.array_equal(matrix, np.eye(3)):
            continue
        columns = [f"{'-' if sign < 0 else ''}{AXES[k]}" for k, sign in zip(order, signs, strict=True)]
        words = "; ".join(f"column {axis} is {column}" for axis, column in zip(AXES, columns, strict=True))
        angles = turn_of(matrix + 0.0)
        equal = (
            () if angles is None else (("triad_turned", f"the triad is turned {turn_words(angles)} in its fixture"),)
        )
        found.append(AxisMap(matrix, words, _short(order, signs), equal))
    return tuple(found)


def _short(order: tuple[int, ...], signs: tuple[float, ...]) -> str:
    """Words of a simple error of the columns; empty for a combination of several, which no part of a file has."""
    negative, moved = [k for k in range(3) if signs[k] < 0], [k for k in range(3) if order[k] != k]
    match len(negative), len(moved):
        case 1, 0:
            return f"column {AXES[negative[0]]} has the wrong sign"
        case 3, 0:
            return "all columns have the wrong sign"
        case 0, 2:
            return f"columns {AXES[moved[0]]} and {AXES[moved[1]]} are exchanged"
        case 0, 3:
            return f"columns x, y, z contain {', '.join(AXES[k] for k in order)}"
    return ""


@dataclass(frozen=True)
class Mounting:
    """The positions of one mounting, `rows` of a set, and the hypotheses on them; `label`: its name."""

    data: PositionSet
    attitudes: Attitudes
    rows: Bool[np.ndarray, " positions"]
    label: str = ""

    @cached_property
    def as_written(self) -> Hypothesis:
        """The angles and axes as in the file."""
        return Hypothesis("", "", self.data.alpha_deg, self.data.beta_deg)

    @cached_property
    def written(self) -> tuple[float, float]:
        """Misfit of the file as written, and share of rows close to its predictions."""
        (cost,), (close,) = self.misfits([self.as_written])
        return float(cost), float(close)

    @cached_property
    def best(self) -> tuple[list[Hypothesis], float, float]:
        """The hypotheses that fit best and equally well, their misfit, and the share of rows close to the predictions.

        A bias also shows at zero input, so those with the smallest residuals come first: axes only if theirs are far smaller.
        """
        hypotheses = [*scale_errors(self)]
        for rule, places in ((_mislabelled, self.places), (_index_offset, self.places), (_read_at_others, self.parts)):
            hypotheses += [own for place in places for own in rule(self, place)]
        hypotheses += _axes(self)
        if not hypotheses:
            return [], np.inf, 0.0
        cost, close = self.misfits(hypotheses)
        first = int(np.argmin(cost))
        near = [hypotheses[k] for k in np.argsort(cost, kind="stable") if cost[k] < cost[first] + EQUAL]
        if len(near) > 1 and (near[0].axes is not None or all(self.same(near[0], other) for other in near)):
            near.sort(key=lambda own: self.residual_ss(own) / (1.0 if own.axes is None else FAR_SMALLER))
        return near, float(cost[first]), float(close[first])

    def misfits(self, hypotheses: list[Hypothesis]) -> tuple[np.ndarray, np.ndarray]:
        """Misfit of each hypothesis, and share of rows close to its predictions."""
        return misfit(np.stack([self.ideal(own) for own in hypotheses]), self.data.readings[self.rows])

    def ideal(self, hypothesis: Hypothesis) -> Float[np.ndarray, "positions 3"]:
        """Readings of a perfect instrument under a hypothesis, g, as the file has them."""
        angles = (hypothesis.alpha_deg[self.rows], hypothesis.beta_deg[self.rows])
        f = gravity_in_head(*map(np.radians, angles))
        f = f if self.attitudes is None else np.einsum("nij,nj->ni", self.attitudes[self.rows], f)
        if hypothesis.axes is None or hypothesis.mapped is None:
            return f
        return np.where(hypothesis.mapped[self.rows, None], f @ hypothesis.axes.T, f)

    def same(self, first: Hypothesis, second: Hypothesis) -> bool:
        """Whether two hypotheses imply the same readings."""
        return bool(np.max(np.abs(self.ideal(first) - self.ideal(second))) < SAME)

    def residual_ss(self, hypothesis: Hypothesis) -> float:
        """`ss_with_pitch_errors` of a hypothesis, g^2."""
        on_plan = replace(hypothesis, axes=None)
        turned = replace(on_plan, beta_deg=hypothesis.beta_deg + np.degrees(_STEP))
        ideal, setting = self.ideal(on_plan), np.round(hypothesis.beta_deg[self.rows], 6)
        slope = (self.ideal(turned) - ideal) / _STEP
        return ss_with_pitch_errors(ideal, slope, setting, hypothesis.readings(self.data.readings)[self.rows])

    def exchanged_pair(self, hypothesis: Hypothesis) -> str:
        """The names of the two positions whose exchange produces the same data as a hypothesis; empty if there are none."""
        before, after = self.ideal(self.as_written), self.ideal(hypothesis)
        moved = np.flatnonzero(np.max(np.abs(after - before), axis=1) > SAME)
        if len(moved) != 2 or np.max(np.abs(after[moved] - before[moved[::-1]])) > SAME:
            return ""
        return " and ".join(self.data.names[row] for row in np.flatnonzero(self.rows)[moved])

    @cached_property
    def parts(self) -> list[Place]:
        """All rows, and those of each run that an error of this run may explain: of the runs that contribute to the misfit of
        the angles as written, if there are several."""
        parts = [Place("", self.rows)]
        if len(self.data.runs) > 1:
            cost, run = of_rows(self.ideal(self.as_written)[None], self.data.readings[self.rows])[0][0], self.data.run
            of_run = {label: self.rows & (np.array(run) == label) for label in self.data.runs}
            parts += [
                Place(f" in run {label}", rows)
                for label, rows in of_run.items()
                if np.sum(cost[rows[self.rows]]) >= _LEAST_OF_RUN * np.sum(cost)
            ]
        return parts

    def settings(self, part: Place) -> list[Place]:
        """The pitch settings of a part with enough positions."""
        pitch = self.data.pitch_setting_deg
        levels, counts = np.unique(pitch[part.rows].round(6), return_counts=True)
        listed = levels[counts >= _FEWEST].tolist()
        return [Place(part.part, part.rows & (np.abs(pitch - level) < 1e-5), level) for level in listed]

    @cached_property
    def places(self) -> list[Place]:
        """The parts, each with its settings."""
        return [place for part in self.parts for place in (part, *self.settings(part))]

    def moved(self, place: Place, label: str, words: str, alpha=None, beta=None) -> Hypothesis:
        """A hypothesis with other angles (deg) in the rows of a place."""
        alpha_deg, beta_deg = (
            own if other is None else np.where(place.rows, other, own)
            for own, other in ((self.data.alpha_deg, alpha), (self.data.beta_deg, beta))
        )
        return Hypothesis(label, words, alpha_deg, beta_deg)

    def nearest(self, at: Callable[[float], Hypothesis], angle: float, *grids: np.ndarray) -> float:
        """The angle (deg) of the least misfit: on each grid, then in steps of one degree about it."""
        least = np.inf
        for angles in (*grids, None):
            tried = angle + np.arange(-4.0, 5.0) if angles is None else angles
            cost, _ = self.misfits([at(each) for each in tried])
            if np.min(cost) < least - EQUAL:
                angle, least = float(tried[np.argmin(cost)]), float(np.min(cost))
        return angle


def scale_errors(mounting: Mounting) -> Iterator[Hypothesis]:
    """Errors of whole scales, of the direction of the spindle, and exchanged pitch settings."""
    alpha, beta, pitch = mounting.data.alpha_deg, mounting.data.beta_deg, mounting.data.pitch_setting_deg
    for part in mounting.parts:
        for label, words, *angles in (
            ("angles_exchanged", "the columns alpha_deg and beta_deg are exchanged", beta, alpha),
            ("pitch_reversed", "the pitch angle is measured from the other end of its scale", None, 90.0 - beta),
            ("pitch_reversed", "the pitch angle has the opposite sign", None, -beta),
        ):
            yield mounting.moved(part, label, f"{words}{part.words}", *angles)
        for low, high in combinations(mounting.settings(part), 2):
            both = Place(part.part, low.rows | high.rows)
            words = f"the pitch settings {low.level:g} and {high.level:g} deg are exchanged{part.words}"
            other = np.where(low.rows, high.level, low.level) + beta - pitch
            yield mounting.moved(both, "settings_exchanged", words, beta=other)
    for place in mounting.places:
        words = f"the spindle angle has the opposite sign{place.words}"
        yield mounting.moved(place, "spindle_reversed", words, (-alpha) % 360.0)


def _mislabelled(mounting: Mounting, place: Place) -> Iterator[Hypothesis]:
    if not place.of_setting:
        return
    from_nominal = mounting.data.beta_deg - mounting.data.pitch_setting_deg

    def at(pitch: float) -> Hypothesis:
        words = f"the pitch setting labelled {place.level:g} deg was at {pitch:g} deg{place.part}"
        return mounting.moved(place, "mislabelled_setting", words, beta=pitch + from_nominal)

    pitch = mounting.nearest(at, place.level, place.level + np.arange(-90.0, 92.5, 5.0))
    if abs(pitch - place.level) >= _LEAST_SLIP_DEG:
        yield at(pitch)


def _index_offset(mounting: Mounting, place: Place) -> Iterator[Hypothesis]:
    """Spindle angles from another origin. Index holes differ by steps of the plan or round numbers; a remainder below one
    degree belongs to the mount."""
    alpha = mounting.data.alpha_deg

    def at(offset: float) -> Hypothesis:
        offset -= 360.0 * np.round(offset / 360.0)
        words = f"the spindle was {offset:+g} deg from the recorded angles{place.words}"
        turned = f"the triad is turned {offset:g} deg about x in its fixture{place.words}"
        equal = () if place.of_setting else (("triad_turned", turned),)
        return replace(mounting.moved(place, "index_offset", words, alpha + offset), equal=equal)

    holes = np.unique(np.round(np.subtract.outer(np.unique(alpha), np.unique(alpha)) % 360.0, 3))[:_MOST_HOLES]
    offset = mounting.nearest(at, 0.0, holes, np.arange(0.0, 360.0, 5.0))
    if abs(offset - 360.0 * np.round(offset / 360.0)) >= (_LEAST_INDEX_DEG if place.of_setting else _MOST_TURNED_DEG):
        yield at(offset)


def _read_at_others(mounting: Mounting, part: Place) -> Iterator[Hypothesis]:
    """Readings at the angles of other rows: recorded in the order of the plan while the spindle turned backwards, at one or
    every second setting; one row late or early, all or from some row on."""
    settings = sorted(mounting.settings(part), key=lambda place: int(np.argmax(place.rows)))
    every_second = [settings[first::2] for first in (0, 1) if len(settings) > 2 + first]
    for places in (*([place] for place in settings), *every_second):
        rows = np.arange(len(mounting.rows))
        for place in places:
            rows[place.rows] = rows[place.rows][::-1]
        where = places[0].words if len(places) == 1 else f" at every second pitch setting{part.words}"
        yield _at_rows(mounting, part, "spindle_reversed", f"the readings are in reverse order{where}", rows)
    here = np.flatnonzero(part.rows)
    number, firsts = np.arange(len(here)), range(len(here) - _FEWEST if len(here) <= _MOST_ROWS else 1)
    ways = (1, "late: each belongs to the previous position"), (-1, "early: each belongs to the next position")
    for (step, text), first in product(ways, firsts):
        # All rows are shifted cyclically; a part keeps its last row.
        moved = np.minimum(number - step, number[-1]) if first else np.roll(number, step)
        rows = np.arange(len(mounting.rows))
        rows[here] = here[np.where(number < first, number, moved)]
        since = f" from position {mounting.data.names[here[first]]} on" if first else ""
        yield _at_rows(mounting, part, "rows_shifted", f"the readings{since} are one row {text}{part.words}", rows)


def _at_rows(mounting: Mounting, part: Place, label: str, words: str, rows: np.ndarray) -> Hypothesis:
    return mounting.moved(part, label, words, mounting.data.alpha_deg[rows], mounting.data.beta_deg[rows])


def _axes(mounting: Mounting) -> Iterator[Hypothesis]:
    """Axes with the wrong sign, or exchanged, in a part of the rows: a pitch setting, a run, from some row on."""
    rows, number = np.flatnonzero(mounting.rows), np.arange(len(mounting.rows))
    stretches = [(place.words, place.rows) for place in mounting.places if place.words]
    for first in rows[_FEWEST:-_FEWEST] if len(rows) <= _MOST_ROWS else ():
        stretches.append((f" from position {mounting.data.names[first]} on", mounting.rows & (number >= first)))
    for (words, part), axes in product(stretches, axis_maps()):
        if axes.short:
            text = f"{axes.short}{words}"
            yield replace(mounting.as_written, label="axis_map", words=text, axes=axes.matrix, mapped=part)
