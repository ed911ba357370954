"""What was mixed up in setting up, found before anything is fitted: units, axes, angles, temperature and time.

What can be put right in one way only is put right and said; what cannot is refused, with the stories that would explain it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from tumblecal.chain import Chain
from tumblecal.chain.nominal import FreeAttitude
from tumblecal.data import PositionSet
from tumblecal.data.joined import times_going_on
from tumblecal.estimation.angle_mixups import ALIKE, APART, AngleSearch, Story, misfit, with_angles
from tumblecal.estimation.mountings import nominal_rotations, turned_mountings
from tumblecal.estimation.problem import where_of
from tumblecal.estimation.quarter_turns import turn_of, turn_words
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2


_FACTORS = {
    "mg": 1e3,
    "m/s^2": STANDARD_GRAVITY_MS2,
    "g (in a column of mg)": 1e-3,
    "g (in a column of m/s^2)": 1 / STANDARD_GRAVITY_MS2,
}
# How far (ratio) a reading's size may be from a unit's factor and still be taken for it.
_NEAR = 1.3
# The size of readings (g) that is no other unit's, and still some calibration's.
_POSSIBLE_G = (0.5, 2.0)
# An axis that varies by less than this share of the others, or differs from another by less, has no signal of its own.
_NO_SIGNAL = 0.02
# An axis of which attitudes leave more than this share unexplained does not follow them.
_UNFOLLOWED = 0.5
# Ideal inputs of an axis must vary by this much (g) for it to be missed.
_MOVED_G = 0.5
# Temperatures (in a column of degC) that are kelvin; 0 degC in kelvin.
_KELVIN, _ICE_POINT_K = (200.0, 450.0), 273.15
# Clocks that start within this share of a step of one another were both set to the start of their run.
_SAME_START = 0.1
# Where more of the rows than this are far from the angles as written and from those of every story, nothing is said.
_MOST_ASTRAY = 0.5
# A slip is the right one only where it leaves less than this share of the misfit: true ones left at most 1 %, an effect of a
# thousand sigma that looked like one more than half. (conditions of benchmarks/blind_stress.py)
_MOST_LEFT = 0.4


@dataclass(frozen=True)
class MixUp:
    """A mix-up found and put right: catalogue id, what it is in words; `equal`: ids and words of other slips that would
    leave the same data."""

    label: str
    words: str
    equal: tuple[tuple[str, str], ...] = ()

    @property
    def told(self) -> str:
        """The words with those of equal slips."""
        same = "; or ".join(words for _, words in self.equal)
        return f"{self.words} (or, which is the same here: {same})" if same else self.words

    def record(self) -> dict:
        """As JSON files hold it."""
        equal = [{"id": label, "words": words} for label, words in self.equal]
        return {"id": self.label, "words": self.words, "equal": equal}


# Mix-ups that no calibration at rest depends on.
HARMLESS = ("temperature_unit", "time_restarts")


def put_right(data: PositionSet, chain: Chain | None = None) -> tuple[PositionSet, list[MixUp]]:
    """Find what was mixed up by comparing the readings with those of a perfect instrument, and put it right.

    **Arguments:**

    - `data`: as given, readings taken for g. `chain`: the model given for them, with the intended attitudes of the
      mountings; None for the default one.

    **Returns:** the set put right, and what was found.

    **Raises:** `InputError` for what cannot be put right in one way: an axis without a signal of its own, readings of
    no known unit, angles that the readings do not follow.
    """
    mended, found = _mended(data, chain)
    if chain is not None and where_of(mended).labels != where_of(data).labels:
        raise InputError(
            f"{data.source}: {found[-1].told}; correct the file: the given model counts the settings as they stand there"
        )
    return mended, found


def _mended(data: PositionSet, chain: Chain | None) -> tuple[PositionSet, list[MixUp]]:
    data, found = _conditions(data)
    readings, units = _in_g(data)
    found += units
    data = replace(data, readings=readings)
    if data.hand_held or (chain is not None and any(isinstance(link, FreeAttitude) for link in chain.links)):
        return data, found
    ideal, attitudes = gravity_in_head(data.alpha, data.beta), _intended_attitudes(data, chain)
    ideal = ideal if attitudes is None else np.einsum("nij,nj->ni", attitudes, ideal)
    _refuse_silent_axes(data, ideal)
    axis_units, axis_map = _axes(data, ideal)
    if axis_units:
        data, found = replace(data, readings=axis_units[0]), [*found, *axis_units[1]]
    searches = [AngleSearch(data, attitudes, rows) for rows in _mountings(data)]
    as_written = [search.misfits([search.as_written()]) for search in searches]
    if all(float(cost[0]) < APART for cost, _ in as_written):
        return data, found
    before = sum(float(cost[0]) for cost, _ in as_written)
    mapped = (
        sum(float(misfit(ideal[None, s.rows], axis_map[0][s.rows])[0][0]) for s in searches) if axis_map else np.inf
    )
    told = [search.best() for search in searches]
    if axis_map and mapped < before - APART and mapped < sum(cost for _, cost, _ in told) + ALIKE:
        same = [told[0][0][0]] if len(told) == 1 and told[0][1] < mapped + ALIKE else []
        equal = (*axis_map[1].equal, *((story.label, story.words) for story in same))
        return replace(data, readings=axis_map[0]), [*found, replace(axis_map[1], equal=equal)]
    for search, (cost, share), (stories, least, near) in zip(searches, as_written, told, strict=True):
        whole = float(cost[0])
        if least < min(whole - APART, _MOST_LEFT * whole) and near > 1 - _MOST_ASTRAY:
            data, mix_up = _one_story(data, search, stories)
            found.append(mix_up)
        elif share[0] < 1 - _MOST_ASTRAY:
            raise InputError(
                f"{data.source}: the readings do not follow the angles ({1 - share[0]:.0%} of the positions are more than "
                "0.1 g off, whatever the sensor's errors); check angle columns, axes and units against the log"
            )
    return data, found


def _one_story(data: PositionSet, search: AngleSearch, stories: list[Story]) -> tuple[PositionSet, MixUp]:
    """The data put right by the best story.

    **Raises:** `InputError` when stories that fit equally well would put them right in different ways.
    """
    first, *others = stories
    if not all(search.same(first, other) for other in others):
        listed = "; or ".join(dict.fromkeys(story.words for story in stories))
        raise InputError(
            f"{data.source}: the readings do not follow the angles, and these slips would explain it equally well: {listed}; "
            "check the log and correct the angle columns"
        )
    equal = [(story.label, story.words) for story in others]
    pair = search.exchanged_pair(first)
    if pair is not None:
        equal.append(("swapped_positions", f"positions {' and '.join(data.names[row] for row in pair)} are exchanged"))
    return with_angles(data, first), MixUp(first.label, first.words, tuple(equal))


def _intended_attitudes(data: PositionSet, chain: Chain | None) -> Float[np.ndarray, "positions 3 3"] | None:
    """The intended rotation of the triad at every position: the chain's, else what the readings show; None for none."""
    if chain is None:
        turns = turned_mountings(data)
        rotations = nominal_rotations(turns, list(turns))
    else:
        rotations = None if chain.orientations is None else np.asarray(chain.orientations)
    # Mountings are numbered as they first appear.
    mount = data.mount or ("1",) * len(data)
    number = {label: k for k, label in enumerate(dict.fromkeys(mount))}
    return None if rotations is None else rotations[[number[label] for label in mount]]


def _mountings(data: PositionSet) -> Iterator[Bool[np.ndarray, " positions"]]:
    mount = np.array(data.mount or ("1",) * len(data))
    for label in dict.fromkeys(mount.tolist()):
        yield mount == label


def _conditions(data: PositionSet) -> tuple[PositionSet, list[MixUp]]:
    """Temperature in degC, and a time that goes on."""
    found: list[MixUp] = []
    temperature, time = data.temperature_degc, data.time_s
    if temperature is not None and _KELVIN[0] < np.min(temperature) and np.max(temperature) < _KELVIN[1]:
        words = f"the temperatures, {np.min(temperature):.4g} to {np.max(temperature):.4g}, are kelvin"
        data, found = replace(data, temperature_degc=temperature - _ICE_POINT_K), [MixUp("temperature_unit", words)]
    if time is not None and (parts := _restarted(time)):
        firsts = np.cumsum([len(part) for part in parts])[:-1]
        words = f"time_s starts anew at position {', '.join(data.names[row] for row in firsts[:6])}; it is taken as going on"
        data, found = replace(data, time_s=times_going_on(parts)), [*found, MixUp("time_restarts", words)]
    return data, found


def _restarted(time: Float[np.ndarray, " positions"]) -> list[np.ndarray]:
    """The stretches of a clock that was set back for each; empty where it was not.

    Rows in another order than they were measured in go back in time as well, but not to the same start.
    """
    back = np.flatnonzero(np.diff(time) < 0) + 1
    if not 0 < len(back) <= len(time) // 4:
        return []
    parts = np.split(time, back)
    step = float(np.median(np.concatenate([np.diff(part) for part in parts])))
    starts = np.array([part[0] for part in parts])
    return parts if np.max(np.abs(starts - starts[0])) <= _SAME_START * step else []


def _in_g(data: PositionSet) -> tuple[Float[np.ndarray, "positions 3"], list[MixUp]]:
    """Readings in g where all, or single positions, are in another unit.

    **Raises:** `InputError` for readings in no known unit.
    """
    readings, found = data.readings.copy(), []
    sizes = np.linalg.norm(readings, axis=1)
    common = float(np.median(sizes))
    for words, factor in _FACTORS.items():
        if 1 / _NEAR < common / factor < _NEAR:
            return readings / factor, [MixUp("unit_error", f"all readings are in {words}")]
        odd = np.flatnonzero(np.abs(np.log(np.maximum(sizes, 1e-300) / factor)) < np.log(_NEAR))
        if len(odd) and 1 / _NEAR < common < _NEAR:
            readings[odd] /= factor
            sizes[odd] /= factor
            listed = ", ".join(data.names[k] for k in odd[:6]) + (" ..." if len(odd) > 6 else "")
            found.append(MixUp("unit_error", f"positions {listed} are in {words}"))
    # Single axes in another unit change the size as well: only where all axes are off is there nothing to go by.
    off = [not _POSSIBLE_G[0] < factor < _POSSIBLE_G[1] for factor in np.max(np.abs(readings), axis=0)]
    if all(off):
        raise InputError(
            f"{data.source}: the readings' size is about {common:.4g}; at rest it is 1 g. If they are counts, divide them by "
            "the counts per g of the data sheet; else check the scale of the data"
        )
    return readings, found


def _refuse_silent_axes(data: PositionSet, ideal: Float[np.ndarray, "positions 3"]) -> None:
    """Refuse an axis that does not move, or that reads what another reads.

    **Raises:** `InputError` naming the axes.
    """
    moved, readings = np.ptp(data.readings, axis=0), data.readings
    if np.any(np.ptp(ideal, axis=0) < _MOVED_G) or len(data) < 4:
        return
    usual = np.median(moved)
    for axis in np.flatnonzero(moved < _NO_SIGNAL * usual).tolist():
        if not _follows(readings[:, axis], ideal):
            raise InputError(
                f"{data.source}: axis {AXES[axis]} reads {readings[0, axis]:.4g} g at every position (it varies by "
                f"{moved[axis]:.2g} g, the others by {usual:.3g} g): a dead axis, or a column that is not a reading"
            )
    for first, second in ((0, 1), (0, 2), (1, 2)):
        for sign, words in ((1, "the same as"), (-1, "the negative of")):
            apart = np.ptp(readings[:, second] - sign * readings[:, first])
            if apart < _NO_SIGNAL * max(moved[first], moved[second]):
                raise InputError(
                    f"{data.source}: axis {AXES[second]} reads {words} axis {AXES[first]} at every position: a channel or a "
                    "column was taken twice; give each axis its own"
                )


def _follows(readings: Float[np.ndarray, " positions"], ideal: Float[np.ndarray, "positions 3"]) -> bool:
    """Whether one axis, however little it moves, follows the attitudes."""
    basis = np.hstack([ideal, np.ones((len(ideal), 1))])
    left = np.std(readings - basis @ np.linalg.lstsq(basis, readings, rcond=None)[0])
    return bool(np.ptp(readings) > 0 and left < _UNFOLLOWED * np.std(readings))


_Mended = tuple[Float[np.ndarray, "positions 3"], MixUp]


def _axes(
    data: PositionSet, ideal: Float[np.ndarray, "positions 3"]
) -> tuple[tuple[Float[np.ndarray, "positions 3"], list[MixUp]] | None, _Mended | None]:
    """Readings with single axes put in g, and readings on the plan's axes, where either is needed and can be told."""
    basis = np.hstack([ideal, np.ones((len(ideal), 1))])
    if np.linalg.matrix_rank(basis, tol=1e-3) < 4:
        return None, None
    readings, found = data.readings.copy(), []
    matrix = np.linalg.lstsq(basis, readings, rcond=None)[0][:3].T
    # Row a: which ideal inputs output a follows.
    source = np.argmax(np.abs(matrix), axis=1)
    leading = matrix[np.arange(3), source]
    if len(set(source.tolist())) < 3 or (np.any(np.abs(leading) < 0.5) and not np.any(np.abs(leading) > 2)):
        return None, None
    for axis in range(3):
        for words, factor in _FACTORS.items():
            if 1 / _NEAR < abs(leading[axis]) / factor < _NEAR:
                readings[:, axis] /= factor
                found.append(MixUp("unit_error", f"axis {AXES[axis]} is in {words}"))
    united = (readings, found) if found else None
    if not (np.any(source != np.arange(3)) or np.any(leading < 0)):
        return united, None
    turn, right = np.zeros((3, 3)), np.empty_like(readings)
    turn[np.arange(3), source] = np.sign(leading)
    right[:, source] = np.sign(leading) * readings
    terms = [f"column {AXES[a]} is {'-' if leading[a] < 0 else ''}{AXES[source[a]]}" for a in range(3)]
    angles = turn_of(turn + 0.0)
    turned = (
        () if angles is None else (("triad_turned", f"the triad stands turned {turn_words(angles)} in its fixture"),)
    )
    return united, (right, MixUp("axis_map", "; ".join(terms), turned))
