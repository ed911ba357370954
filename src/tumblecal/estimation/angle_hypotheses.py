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
from tumblecal.estimation.angle_misfit import EQUAL, misfit, of_rows, ss_with_pitch_errors
from tumblecal.ground.frames import gravity_in_head


# Attitudes (g) that differ by less than this are the same.
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
# With more rows than this, a shift by one row is tried only for all rows.
_MOST_ROWS = 400
# With fewer positions than this at a pitch setting, an error of one position could be taken for one of the setting.
_FEWEST = 3


@dataclass(frozen=True)
class AngleHypothesis:
    """One set-up error of the angles.

    `label`: catalogue id. `words`: the error in words. `alpha_deg`, `beta_deg`: the true angles under it. `equal`:
    ids and words of other errors, not of the angles, that produce the same data.
    """

    label: str
    words: str
    alpha_deg: Float[np.ndarray, " positions"]
    beta_deg: Float[np.ndarray, " positions"]
    equal: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class AngleSearch:
    """Hypotheses on the angles of one mounting.

    `data`: the set. `attitudes`: the intended rotation at each position, None for none. `rows`: mask of the mounting's rows.
    """

    data: PositionSet
    attitudes: Float[np.ndarray, "positions 3 3"] | None
    rows: Bool[np.ndarray, " positions"]
    mounting: str = ""

    def misfits(self, hypotheses: list[AngleHypothesis]) -> tuple[np.ndarray, np.ndarray]:
        """Misfit of each hypothesis, and share of rows close to its predictions."""
        return misfit(np.stack([self._ideal(hypothesis) for hypothesis in hypotheses]), self.data.readings[self.rows])

    def as_written(self) -> AngleHypothesis:
        """The angles as in the file."""
        return AngleHypothesis("", "", self.data.alpha_deg, self.data.beta_deg)

    def best(self) -> tuple[list[AngleHypothesis], float, float]:
        """The hypotheses that fit best and equally well, their misfit, and the share of rows close to the predictions."""
        hypotheses = [
            *self.scale_errors(),
            *self._mislabelled(),
            *self._index_offset(),
            *self._in_reverse(),
            *self._shifted(),
        ]
        if not hypotheses:
            return [], np.inf, 0.0
        cost, share = self.misfits(hypotheses)
        order = np.argsort(cost, kind="stable")
        near = [hypotheses[k] for k in order if cost[k] < cost[order[0]] + EQUAL]
        if len(near) > 1 and all(self.same(near[0], other) for other in near):
            near = sorted(near, key=self.ss_with_pitch_errors)
        return near, float(cost[order[0]]), float(share[order[0]])

    def scale_errors(self) -> Iterator[AngleHypothesis]:
        """Errors of whole scales, and exchanged pitch settings."""
        yield from self._of_all()
        yield from self._exchanged()

    def stretches(self) -> Iterator[tuple[str, Bool[np.ndarray, " positions"]]]:
        """Parts of the rows that may be recorded differently (runs, pitch settings, from some row on): words, mask."""
        for words, part in self._parts():
            if words:
                yield words, part
            for level in self._settings(part):
                yield f" at beta {level:g} deg{words}", self._at(part, level)
        rows = np.flatnonzero(self.rows)
        for first in rows[_FEWEST:-_FEWEST] if len(rows) <= _MOST_ROWS else ():
            yield f" from position {self.data.names[first]} on", self.rows & (np.arange(len(self.rows)) >= first)

    def same(self, first: AngleHypothesis, second: AngleHypothesis) -> bool:
        """Whether two hypotheses imply the same attitudes."""
        return bool(np.max(np.abs(self._ideal(first) - self._ideal(second))) < SAME)

    def exchanged_pair(self, hypothesis: AngleHypothesis) -> tuple[int, int] | None:
        """The two rows whose exchange produces the same data as a hypothesis; None if there are none."""
        before, after = self._ideal(self.as_written()), self._ideal(hypothesis)
        moved = np.flatnonzero(np.max(np.abs(after - before), axis=1) > SAME)
        if len(moved) != 2 or np.max(np.abs(after[moved] - before[moved[::-1]])) > SAME:
            return None
        first, second = np.flatnonzero(self.rows)[moved].tolist()
        return first, second

    def ss_with_pitch_errors(
        self, hypothesis: AngleHypothesis, readings: Float[np.ndarray, "positions 3"] | None = None
    ) -> float:
        """`ss_with_pitch_errors` of a hypothesis, g^2; `readings` (g) replaces those of the set."""
        turned = replace(hypothesis, beta_deg=hypothesis.beta_deg + np.degrees(_STEP))
        ideal, setting = self._ideal(hypothesis), np.round(hypothesis.beta_deg[self.rows], 6)
        slope = (self._ideal(turned) - ideal) / _STEP
        return ss_with_pitch_errors(
            ideal, slope, setting, (self.data.readings if readings is None else readings)[self.rows]
        )

    def _ideal(self, hypothesis: AngleHypothesis) -> Float[np.ndarray, "positions 3"]:
        f = gravity_in_head(np.radians(hypothesis.alpha_deg[self.rows]), np.radians(hypothesis.beta_deg[self.rows]))
        return f if self.attitudes is None else np.einsum("nij,nj->ni", self.attitudes[self.rows], f)

    def _parts(self) -> Iterator[tuple[str, Bool[np.ndarray, " positions"]]]:
        """All rows, and those of each run that an error of this run may explain: words, mask."""
        yield "", self.rows
        for run in self._far_runs:
            yield f" in run {run}", self.rows & (np.array(self.data.run) == run)

    @cached_property
    def _far_runs(self) -> list[str]:
        """Runs that contribute to the misfit of the angles as written, if there are several."""
        if self.data.run is None or len(self.data.runs) < 2:
            return []
        cost, _ = of_rows(self._ideal(self.as_written())[None], self.data.readings[self.rows])
        run, least = np.array(self.data.run)[self.rows], _LEAST_OF_RUN * np.sum(cost)
        return [label for label in self.data.runs if np.sum(cost[0][run == label]) >= least]

    def _settings(self, part: Bool[np.ndarray, " positions"]) -> list[float]:
        """Pitch settings (deg) with enough positions."""
        levels, counts = np.unique(self._nominal_pitch[part].round(6), return_counts=True)
        return [float(level) for level, count in zip(levels, counts, strict=True) if count >= _FEWEST]

    def _at(self, part: Bool[np.ndarray, " positions"], level: float) -> Bool[np.ndarray, " positions"]:
        return part & (np.abs(self._nominal_pitch - level) < 1e-5)

    @cached_property
    def _nominal_pitch(self) -> Float[np.ndarray, " positions"]:
        """Nominal pitch setting of each position, deg."""
        return self.data.pitch_setting_deg

    @cached_property
    def _from_nominal(self) -> Float[np.ndarray, " positions"]:
        """Recorded pitch angle of each position less the nominal setting, deg."""
        return self.data.beta_deg - self._nominal_pitch

    def _moved(self, label: str, words: str, rows: np.ndarray, alpha=None, beta=None) -> AngleHypothesis:
        """A hypothesis with other angles in some rows."""
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
            yield self._moved(
                "angles_exchanged", f"the columns alpha_deg and beta_deg are exchanged{words}", part, beta, alpha
            )
            yield self._moved(
                "pitch_reversed",
                f"the pitch angle is measured from the other end of its scale{words}",
                part,
                beta=90.0 - beta,
            )
            yield self._moved("pitch_reversed", f"the pitch angle has the opposite sign{words}", part, beta=-beta)
            yield self._moved("spindle_reversed", f"the spindle angle has the opposite sign{words}", part, back)
            for level in self._settings(part):
                rows, at = self._at(part, level), f" at beta {level:g} deg{words}"
                yield self._moved("spindle_reversed", f"the spindle angle has the opposite sign{at}", rows, back)

    def _exchanged(self) -> Iterator[AngleHypothesis]:
        for words, part in self._parts():
            levels = self._settings(part)
            for number, low in enumerate(levels):
                for high in levels[:number]:
                    other = np.where(np.abs(self._nominal_pitch - low) < 1e-5, high, low) + self._from_nominal
                    rows = self._at(part, low) | self._at(part, high)
                    exchanged = f"the pitch settings {high:g} and {low:g} deg are exchanged{words}"
                    yield self._moved("settings_exchanged", exchanged, rows, beta=other)

    def _mislabelled(self) -> Iterator[AngleHypothesis]:
        for words, part in self._parts():
            for level in self._settings(part):
                rows, pitch = self._at(part, level), level
                for reach, step in ((90.0, 5.0), (4.0, 1.0)):
                    angles = pitch + np.arange(-reach, reach + step / 2, step)
                    hypotheses = [self._moved("", "", rows, beta=angle + self._from_nominal) for angle in angles]
                    pitch = float(angles[np.argmin(self.misfits(hypotheses)[0])])
                if abs(pitch - level) >= _LEAST_SLIP_DEG:
                    text = f"the pitch setting labelled {level:g} deg was at {pitch:g} deg{words}"
                    yield self._moved("mislabelled_setting", text, rows, beta=pitch + self._from_nominal)

    def _index_offset(self) -> Iterator[AngleHypothesis]:
        for words, part in self._parts():
            for offset, hypothesis in self._index_offset_at(part, words, _MOST_TURNED_DEG):
                turned = f"the triad is turned {offset:g} deg about x in its fixture{words}"
                yield replace(hypothesis, equal=(("triad_turned", turned),))
            for level in self._settings(part):
                at = f" at beta {level:g} deg{words}"
                yield from (
                    hypothesis for _, hypothesis in self._index_offset_at(self._at(part, level), at, _LEAST_INDEX_DEG)
                )

    def _index_offset_at(
        self, rows: Bool[np.ndarray, " positions"], words: str, least_deg: float
    ) -> list[tuple[float, AngleHypothesis]]:
        """The best offset (deg) of the spindle angle in some rows, and the hypothesis with it; none below `least_deg`."""
        alpha, offset, least = self.data.alpha_deg, 0.0, np.inf
        # Index holes differ by steps of the plan or round numbers; a remainder below one degree belongs to the mount.
        plan = np.unique(np.round(np.subtract.outer(np.unique(alpha), np.unique(alpha)) % 360.0, 3))
        for tried in (plan[:_MOST_HOLES], np.arange(0.0, 360.0, 5.0), None):
            angles = offset + np.arange(-4.0, 5.0) if tried is None else tried
            cost, _ = self.misfits([self._moved("", "", rows, alpha + angle) for angle in angles])
            if np.min(cost) < least - EQUAL:
                offset, least = float(angles[np.argmin(cost)]), float(np.min(cost))
        offset -= 360.0 * np.round(offset / 360.0)
        if abs(offset) < least_deg:
            return []
        text = f"the spindle was {offset:+g} deg from the recorded angles{words}"
        return [(offset, self._moved("index_offset", text, rows, alpha + offset))]

    def _in_reverse(self) -> Iterator[AngleHypothesis]:
        """Readings recorded in the order of the plan while the spindle turned backwards, at one or every second setting."""
        for words, part in self._parts():
            levels = list(dict.fromkeys(self._nominal_pitch[part].round(6).tolist()))
            parts = [(f"at beta {level:g} deg{words}", [level]) for level in levels]
            parts += [
                (f"at every second pitch setting{words}", levels[first::2])
                for first in (0, 1)
                if len(levels) > 2 + first
            ]
            for text, reversed_levels in parts:
                alpha, beta = self.data.alpha_deg.copy(), self.data.beta_deg.copy()
                for here in (np.flatnonzero(self._at(part, level)) for level in reversed_levels):
                    alpha[here], beta[here] = alpha[here[::-1]], beta[here[::-1]]
                yield self._moved("spindle_reversed", f"the readings are in reverse order {text}", part, alpha, beta)

    def _shifted(self) -> Iterator[AngleHypothesis]:
        """Readings one row late or early, all or from some row on."""
        for words, part in self._parts():
            rows = np.flatnonzero(part)
            number = np.arange(len(rows))
            for step, text in (
                (1, "late: each belongs to the previous position"),
                (-1, "early: each belongs to the next position"),
            ):
                for first in range(len(rows) - _FEWEST if len(rows) <= _MOST_ROWS else 1):
                    # All rows are shifted cyclically; a part keeps its last row.
                    moved = np.minimum(number - step, number[-1]) if first else np.roll(number, step)
                    source = rows[np.where(number < first, number, moved)]
                    alpha, beta = self.data.alpha_deg.copy(), self.data.beta_deg.copy()
                    alpha[rows], beta[rows] = self.data.alpha_deg[source], self.data.beta_deg[source]
                    since = f" from position {self.data.names[rows[first]]} on" if first else ""
                    yield self._moved(
                        "rows_shifted", f"the readings{since} are one row {text}{words}", part, alpha, beta
                    )


def with_angles(data: PositionSet, hypothesis: AngleHypothesis, rows: Bool[np.ndarray, " positions"]) -> PositionSet:
    """The set with the angles of a hypothesis in these rows."""
    alpha, beta = (
        np.where(rows, hypothesis.alpha_deg, data.alpha_deg),
        np.where(rows, hypothesis.beta_deg, data.beta_deg),
    )
    return replace(data, alpha_deg=alpha, beta_deg=beta)
