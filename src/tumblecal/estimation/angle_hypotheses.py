"""Angles that differ from their columns: the single set-up error under which the readings follow them.

An error in the angles moves whole pitch settings by tenths of a g, whereas the calibration parameters change readings by
hundredths of a g. Therefore a sensor with usual errors of scale, mount and bias is fitted to the readings under each
hypothesis, and the hypothesis with the smallest misfit is chosen. Hypotheses with the same attitudes count as one.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.data import PositionSet
from tumblecal.estimation.angle_misfit import ALIKE, left_by_pitch_errors, misfit, of_rows
from tumblecal.ground.frames import gravity_in_head


# Attitudes (g) that differ by less than this are the same.
SAME = 0.05
# Step of a derivative by the pitch angle, rad.
_STEP = 1e-4
# A setting closer than this to its label is off by an error of its vernier.
_LEAST_SLIP_DEG = 3.0
# A slip of one run leaves at least this share of the misfit to the run (the rest is what it does to the sensor of all).
_LEAST_OF_RUN = 0.1
# A spindle counted from closer than this to its zero at one setting is an error of the index; everywhere, so is a triad that
# stands turned in its fixture.
_LEAST_INDEX_DEG, _MOST_TURNED_DEG = 10.0, 20.0
# Of the steps of a plan so many are tried.
_MOST_HOLES = 120
# Of more rows than these none is tried as the first of those that stand a row late or early.
_MOST_ROWS = 400
# Fewer positions than these at a setting tell nothing of the setting: a position of them may be at fault.
_FEWEST = 3


@dataclass(frozen=True)
class AngleHypothesis:
    """One slip: catalogue id, what it is in words, and the angles (deg) at which the head then stood; `equal`: ids and words
    of what no slip is and would leave the same data."""

    label: str
    words: str
    alpha_deg: Float[np.ndarray, " positions"]
    beta_deg: Float[np.ndarray, " positions"]
    equal: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class AngleSearch:
    """Stories about one mounting's rows of a set; `attitudes`: the intended rotation at each position, None for none."""

    data: PositionSet
    attitudes: Float[np.ndarray, "positions 3 3"] | None
    rows: Bool[np.ndarray, " positions"]
    mounting: str = ""

    def misfits(self, told: list[AngleHypothesis]) -> tuple[np.ndarray, np.ndarray]:
        """Of every hypothesis: misfit, share of rows near."""
        return misfit(np.stack([self._ideal(hypothesis) for hypothesis in told]), self.data.readings[self.rows])

    def as_written(self) -> AngleHypothesis:
        """The angles as they stand in the file."""
        return AngleHypothesis("", "", self.data.alpha_deg, self.data.beta_deg)

    def best(self) -> tuple[list[AngleHypothesis], float, float]:
        """The hypotheses that fit best and equally well, their misfit, and the share of rows near."""
        told = [*self.slips(), *self._mislabelled(), *self._index_off(), *self._in_reverse(), *self._shifted()]
        if not told:
            return [], np.inf, 0.0
        cost, share = self.misfits(told)
        order = np.argsort(cost, kind="stable")
        near = [told[k] for k in order if cost[k] < cost[order[0]] + ALIKE]
        if len(near) > 1 and all(self.same(near[0], other) for other in near):
            near = sorted(near, key=self.left_by_pitch_errors)
        return near, float(cost[order[0]]), float(share[order[0]])

    def slips(self) -> Iterator[AngleHypothesis]:
        """Slips of whole scales, and settings exchanged."""
        yield from self._of_all()
        yield from self._exchanged()

    def stretches(self) -> Iterator[tuple[str, Bool[np.ndarray, " positions"]]]:
        """Parts of the rows that were perhaps written down otherwise: runs, pitch settings, from some row on; words, mask."""
        for words, part in self._parts():
            if words:
                yield words, part
            for level in self._settings(part):
                yield f" at beta {level:g} deg{words}", self._at(part, level)
        rows = np.flatnonzero(self.rows)
        for first in rows[_FEWEST:-_FEWEST] if len(rows) <= _MOST_ROWS else ():
            yield f" from position {self.data.names[first]} on", self.rows & (np.arange(len(self.rows)) >= first)

    def same(self, first: AngleHypothesis, second: AngleHypothesis) -> bool:
        """Whether two hypotheses put the triad into the same attitudes."""
        return bool(np.max(np.abs(self._ideal(first) - self._ideal(second))) < SAME)

    def exchanged_pair(self, hypothesis: AngleHypothesis) -> tuple[int, int] | None:
        """The two rows whose exchange would leave the same data as a hypothesis; None where there are none."""
        before, after = self._ideal(self.as_written()), self._ideal(hypothesis)
        moved = np.flatnonzero(np.max(np.abs(after - before), axis=1) > SAME)
        if len(moved) != 2 or np.max(np.abs(after[moved] - before[moved[::-1]])) > SAME:
            return None
        first, second = np.flatnonzero(self.rows)[moved].tolist()
        return first, second

    def left_by_pitch_errors(
        self, hypothesis: AngleHypothesis, readings: Float[np.ndarray, "positions 3"] | None = None
    ) -> float:
        """`left_by_pitch_errors` of a hypothesis; `readings`: of all positions, g, where others than the set's."""
        turned = replace(hypothesis, beta_deg=hypothesis.beta_deg + np.degrees(_STEP))
        ideal, setting = self._ideal(hypothesis), np.round(hypothesis.beta_deg[self.rows], 6)
        slope = (self._ideal(turned) - ideal) / _STEP
        return left_by_pitch_errors(
            ideal, slope, setting, (self.data.readings if readings is None else readings)[self.rows]
        )

    def _ideal(self, hypothesis: AngleHypothesis) -> Float[np.ndarray, "positions 3"]:
        f = gravity_in_head(np.radians(hypothesis.alpha_deg[self.rows]), np.radians(hypothesis.beta_deg[self.rows]))
        return f if self.attitudes is None else np.einsum("nij,nj->ni", self.attitudes[self.rows], f)

    def _parts(self) -> Iterator[tuple[str, Bool[np.ndarray, " positions"]]]:
        """All rows, and those of each run where there are several that a slip of it may explain: words, mask."""
        yield "", self.rows
        for run in self._far_runs:
            yield f" in run {run}", self.rows & (np.array(self.data.run) == run)

    @cached_property
    def _far_runs(self) -> list[str]:
        """Runs with a share in the misfit of the angles as written, where there are several."""
        if self.data.run is None or len(self.data.runs) < 2:
            return []
        cost, _ = of_rows(self._ideal(self.as_written())[None], self.data.readings[self.rows])
        run, least = np.array(self.data.run)[self.rows], _LEAST_OF_RUN * np.sum(cost)
        return [label for label in self.data.runs if np.sum(cost[0][run == label]) >= least]

    def _settings(self, part: Bool[np.ndarray, " positions"]) -> list[float]:
        """Pitch settings (deg) of which there is enough to tell something."""
        levels, counts = np.unique(self._called[part].round(6), return_counts=True)
        return [float(level) for level, count in zip(levels, counts, strict=True) if count >= _FEWEST]

    def _at(self, part: Bool[np.ndarray, " positions"], level: float) -> Bool[np.ndarray, " positions"]:
        return part & (np.abs(self._called - level) < 1e-5)

    @cached_property
    def _called(self) -> Float[np.ndarray, " positions"]:
        """What the pitch setting of each position is called by, deg."""
        return self.data.pitch_setting_deg

    @cached_property
    def _beside(self) -> Float[np.ndarray, " positions"]:
        """How far each position was read from that, deg."""
        return self.data.beta_deg - self._called

    def _told(self, label: str, words: str, rows: np.ndarray, alpha=None, beta=None) -> AngleHypothesis:
        """A hypothesis that gives some rows other angles."""
        here = self.as_written()
        return AngleHypothesis(
            label,
            words,
            here.alpha_deg if alpha is None else np.where(rows, alpha, here.alpha_deg),
            here.beta_deg if beta is None else np.where(rows, beta, here.beta_deg),
        )

    def _of_all(self) -> Iterator[AngleHypothesis]:
        alpha, beta = self.data.alpha_deg, self.data.beta_deg
        back = (-alpha) % 360.0
        for words, part in self._parts():
            yield self._told(
                "angles_exchanged", f"alpha_deg and beta_deg stand in each other's column{words}", part, beta, alpha
            )
            yield self._told(
                "pitch_reversed", f"pitch is counted from the other end of its scale{words}", part, beta=90.0 - beta
            )
            yield self._told("pitch_reversed", f"pitch is counted in the other sense{words}", part, beta=-beta)
            yield self._told("spindle_reversed", f"the spindle is counted in the other sense{words}", part, back)
            for level in self._settings(part):
                rows, at = self._at(part, level), f" at beta {level:g} deg{words}"
                yield self._told("spindle_reversed", f"the spindle is counted in the other sense{at}", rows, back)

    def _exchanged(self) -> Iterator[AngleHypothesis]:
        for words, part in self._parts():
            levels = self._settings(part)
            for number, low in enumerate(levels):
                for high in levels[:number]:
                    other = np.where(np.abs(self._called - low) < 1e-5, high, low) + self._beside
                    rows = self._at(part, low) | self._at(part, high)
                    told = f"the pitch settings {high:g} and {low:g} deg are exchanged{words}"
                    yield self._told("settings_exchanged", told, rows, beta=other)

    def _mislabelled(self) -> Iterator[AngleHypothesis]:
        for words, part in self._parts():
            for level in self._settings(part):
                rows, stood = self._at(part, level), level
                for reach, step in ((90.0, 5.0), (4.0, 1.0)):
                    angles = stood + np.arange(-reach, reach + step / 2, step)
                    told = [self._told("", "", rows, beta=angle + self._beside) for angle in angles]
                    stood = float(angles[np.argmin(self.misfits(told)[0])])
                if abs(stood - level) >= _LEAST_SLIP_DEG:
                    said = f"the pitch setting labelled {level:g} deg stood at {stood:g} deg{words}"
                    yield self._told("mislabelled_setting", said, rows, beta=stood + self._beside)

    def _index_off(self) -> Iterator[AngleHypothesis]:
        for words, part in self._parts():
            for off, hypothesis in self._index_off_at(part, words, _MOST_TURNED_DEG):
                turned = f"the triad stands turned {off:g} deg about x in its fixture{words}"
                yield replace(hypothesis, equal=(("triad_turned", turned),))
            for level in self._settings(part):
                at = f" at beta {level:g} deg{words}"
                yield from (
                    hypothesis for _, hypothesis in self._index_off_at(self._at(part, level), at, _LEAST_INDEX_DEG)
                )

    def _index_off_at(
        self, rows: Bool[np.ndarray, " positions"], words: str, least_deg: float
    ) -> list[tuple[float, AngleHypothesis]]:
        """The hypothesis that the spindle of some rows stood elsewhere than was written, by the angle (deg) that fits best."""
        alpha, off, least = self.data.alpha_deg, 0.0, np.inf
        # Holes are steps of the plan, or round numbers, apart: what is left of a degree is the mount's.
        plan = np.unique(np.round(np.subtract.outer(np.unique(alpha), np.unique(alpha)) % 360.0, 3))
        for tried in (plan[:_MOST_HOLES], np.arange(0.0, 360.0, 5.0), None):
            angles = off + np.arange(-4.0, 5.0) if tried is None else tried
            cost, _ = self.misfits([self._told("", "", rows, alpha + angle) for angle in angles])
            if np.min(cost) < least - ALIKE:
                off, least = float(angles[np.argmin(cost)]), float(np.min(cost))
        off -= 360.0 * np.round(off / 360.0)
        if abs(off) < least_deg:
            return []
        said = f"the spindle stood {off:+g} deg from the angles written{words}"
        return [(off, self._told("index_offset", said, rows, alpha + off))]

    def _in_reverse(self) -> Iterator[AngleHypothesis]:
        """Readings in the plan's order of a spindle that was turned back again, at one pitch setting or at every second."""
        for words, part in self._parts():
            levels = list(dict.fromkeys(self._called[part].round(6).tolist()))
            told = [(f"at beta {level:g} deg{words}", [level]) for level in levels]
            told += [
                (f"at every second pitch setting{words}", levels[first::2])
                for first in (0, 1)
                if len(levels) > 2 + first
            ]
            for said, own in told:
                alpha, beta = self.data.alpha_deg.copy(), self.data.beta_deg.copy()
                for here in (np.flatnonzero(self._at(part, level)) for level in own):
                    alpha[here], beta[here] = alpha[here[::-1]], beta[here[::-1]]
                yield self._told("spindle_reversed", f"the readings stand in reverse order {said}", part, alpha, beta)

    def _shifted(self) -> Iterator[AngleHypothesis]:
        """Readings that stand a row late or early, all or from some row on."""
        for words, part in self._parts():
            rows = np.flatnonzero(part)
            number = np.arange(len(rows))
            for step, said in (
                (1, "late: each is that of the position before"),
                (-1, "early: each is that of the next position"),
            ):
                for first in range(len(rows) - _FEWEST if len(rows) <= _MOST_ROWS else 1):
                    # All rows as a plan that goes round; else the last was left as it is.
                    moved = np.minimum(number - step, number[-1]) if first else np.roll(number, step)
                    source = rows[np.where(number < first, number, moved)]
                    alpha, beta = self.data.alpha_deg.copy(), self.data.beta_deg.copy()
                    alpha[rows], beta[rows] = self.data.alpha_deg[source], self.data.beta_deg[source]
                    since = f" from position {self.data.names[rows[first]]} on" if first else ""
                    yield self._told(
                        "rows_shifted", f"the readings{since} stand a row {said}{words}", part, alpha, beta
                    )


def with_angles(data: PositionSet, hypothesis: AngleHypothesis, rows: Bool[np.ndarray, " positions"]) -> PositionSet:
    """The set, these rows of it at the angles of a hypothesis."""
    alpha, beta = (
        np.where(rows, hypothesis.alpha_deg, data.alpha_deg),
        np.where(rows, hypothesis.beta_deg, data.beta_deg),
    )
    return replace(data, alpha_deg=alpha, beta_deg=beta)
