"""The columns of accelerations and angular rates of a table, with the evidence: names first, values only if names have no
known word.

A triple is three columns whose names have one stem and three axes. The accelerations are the triple with the name of an
acceleration and the size of gravity at rest. Of several triples of one sensor, the least processed one is used. For several
sensors, and if the evidence is not sufficient, the user must choose.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.columns.column_names import ColumnName
from tumblecal.capture.columns.column_words import meanings
from tumblecal.capture.columns.still_size import FEWEST_ATTITUDES, Ellipsoid, ellipsoid, still_means
from tumblecal.capture.columns.triples import (
    ALIKE,
    ALIKE_FITTED,
    STATE_ORDER,
    Columns,
    Triple,
    triples_of,
    usual_unit,
)
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError


# At rest, rates equal their bias: the range of their means is less than this share of the range of all readings.
_STILL_SHARE = 0.25
_MOST_COLUMNS, _MOST_NAMED = 14, 4
_AS_WELL = 4.0
_NAMELESS = ColumnName()
_OTHERS = "--columns ax=...,ay=...,az=..."


@dataclass(frozen=True)
class Choice:
    """The columns of accelerations and rates.

    **Arguments:**

    - `force`: the accelerations; `rate`: the rates, None for none. `why`, `rate_why`: the evidence, in words.
    - `size`: of gravity in the readings, if enough attitudes show it. `guesses`: the guesses, and how to override them.
    """

    force: Triple
    rate: Triple | None
    why: str
    rate_why: str
    size: float | None = None
    guesses: tuple[str, ...] = ()


class Unsettled(InputError):
    """The values of columns without names do not show which are the accelerations; more rows may show it."""

    def __reduce__(self) -> tuple[object, ...]:
        return Unsettled, (self.faults,)


def chosen(columns: Columns, path: str) -> Choice | None:
    """The accelerations and the rates; None if neither names nor values give a candidate.

    **Raises:** `InputError` with the candidates and the option for each, if the evidence is not sufficient.
    """
    triples = triples_of(columns.names)
    named = [triple for triple in triples if triple.name.quantity == "acceleration"]
    if named:
        force, why, guesses = _named(columns, named, path)
    elif accelerations := [name for name, meaning in columns.names.items() if meaning.quantity == "acceleration"]:
        _ask_for_axes(columns, accelerations, path)
        return None
    else:
        unnamed = [triple for triple in triples if _may_be_named(triple)]
        found = _by_axes(columns, unnamed, path) if unnamed else _by_values(columns, path)
        if found is None:
            return None
        force, why, guesses = found
    rate, rate_why, more = _rate(columns, triples, force)
    fit = columns.size(force).fit if force.columns in columns._sizes else None
    return Choice(force, rate, why, rate_why, fit.size if fit is not None and fit.fits else None, (*guesses, *more))


def _may_be_named(triple: Triple) -> bool:
    """Whether the quantity is unknown, or other words outweigh one for acceleration: `acc_30_orientations[0]`."""
    words = [meaning for word in triple.name.stem for meaning in meanings(word)]
    return triple.name.quantity in ("", "letter") or "acceleration" in words


def _ask_for_axes(columns: Columns, accelerations: list[str], path: str) -> None:
    """Raise if three columns or more are accelerations of axes other than x, y, z (forwards, up)."""
    if len(accelerations) >= len(AXES):
        first = Triple(tuple(accelerations[: len(AXES)]), _NAMELESS)  # type: ignore[arg-type]
        raise InputError(
            f"{path}: {', '.join(accelerations)} are accelerations, but not of axes x, y, z; assign the axes, for example: "
            f"{columns.option(first)}"
        )


def _named(columns: Columns, named: list[Triple], path: str) -> tuple[Triple, str, list[str]]:
    """The accelerations among triples with the name of an acceleration."""
    if len(named) == 1:
        return *_only(columns, named[0], path), []
    body = [triple for triple in named if triple.state not in ("free", "world")] or named
    others = _but(named, body)
    if len(body) == 1:
        return *_only(columns, body[0], path), [f"accelerations: {body[0]}, not {others} (without gravity, by name)"]
    heavy = [triple for triple in body if columns.size(triple).may_be_gravity]
    candidates = heavy or body
    if not heavy and all(columns.size(t).is_without_gravity for t in candidates):
        raise InputError(f"{path}: {_without_gravity(columns, candidates)}")
    if len({triple.name.sensor for triple in candidates}) > 1:
        raise InputError(f"{path}: {len(candidates)} accelerometers; choose one: {_options(columns, candidates)}")
    sized = {t.columns for t in candidates if t.name.unit or usual_unit(columns.size(t).middle, ALIKE)}
    force = min(candidates, key=lambda triple: (triple.columns not in sized, STATE_ORDER.index(triple.state)))
    if force.state in ("linear", "free", "world"):
        return *_only(columns, force, path), []
    others = _but(named, [force])
    why = "name" if len(candidates) > 1 else "name and size"
    because = "the least processed" if len(candidates) > 1 else "the size of gravity while still"
    other = next(triple for triple in named if triple is not force)
    return force, why, [f"accelerations: {force} ({because}), not {others}; to override: {columns.option(other)}"]


def _but(named: list[Triple], these: list[Triple]) -> str:
    """The other triples, in words."""
    others = [str(triple) for triple in named if triple not in these]
    return "; ".join(others[:_MOST_NAMED]) + ("; ..." if len(others) > _MOST_NAMED else "")


def _only(columns: Columns, triple: Triple, path: str) -> tuple[Triple, str]:
    """The only triple of accelerations, which must include gravity and be along the axes of the sensor.

    **Raises:** `InputError` for a triple without gravity, or along axes of the Earth.
    """
    if triple.state == "world":
        raise InputError(
            f"{path}: {triple} are accelerations along axes of the Earth, not of the sensor: no calibration is possible from "
            f"them. Record those of the sensor, or to use these all the same: {columns.option(triple)}"
        )
    named_free = triple.state in ("linear", "free")
    if columns.size(triple).is_without_gravity or (named_free and not columns.size(triple).is_gravity):
        raise InputError(f"{path}: {_without_gravity(columns, [triple])}")
    return triple, "name and size" if named_free else "name"


def _without_gravity(columns: Columns, triples: list[Triple]) -> str:
    triple = triples[0]
    by = "named so" if triple.state == "free" else "as their size says"
    return (
        f"{triple} are accelerations from which gravity was removed ({by}: {columns.size(triple).usual:.3g}): no "
        "calibration is possible from them. Record the accelerometer's own readings, or to use these all the same: "
        f"{columns.option(triple)}"
    )


def _by_axes(columns: Columns, unnamed: list[Triple], path: str) -> tuple[Triple, str, list[str]] | None:
    """The accelerations among triples whose names give axes but no quantity: the triple with the size of gravity."""
    heavy = [triple for triple in unnamed if columns.size(triple).is_gravity and not columns.size(triple).is_computed]
    if not heavy and len(unnamed) == 1 and columns.size(unnamed[0]).rests_at_gravity:
        heavy = unnamed
    if len(heavy) == 1:
        triple = heavy[0]
        size = columns.size(triple).middle
        guess = f"accelerations: {triple}, axes by their names, quantity by the size {size:.5g} while still"
        return triple, "axes by name, quantity by value", [f"{guess}; to override: {_OTHERS}"]
    because = (
        "several triples have the size of gravity" if heavy else "too few attitudes at rest, or no gravity in them"
    )
    raise Unsettled(
        f"{path}: no column has the name of an acceleration, and the values do not show it ({because}); candidates: "
        f"{_options(columns, heavy or unnamed)}"
    )


def _by_values(columns: Columns, path: str) -> tuple[Triple, str, list[str]] | None:
    """The accelerations among columns whose names have no known word: the triple whose means at rest lie on an ellipsoid of
    the size of gravity, if it is the only one.

    A second ellipsoid of a different size is a magnetic field if its columns follow; if they precede, it is ambiguous.
    """
    free = [name for name, meaning in columns.names.items() if not meaning.quantity][:_MOST_COLUMNS]
    data = np.stack([columns.values(name, 0) for name in free], axis=1) if free else np.zeros((0, 0))
    data = data[np.isfinite(data).all(1)]
    varied = [k for k in range(len(free)) if len(data) and not is_rising(data[:, k]) and np.ptp(data[:, k]) > 0]
    if len(varied) < len(AXES):
        return None
    means = still_means(data)
    fits = dict[tuple[int, ...], Ellipsoid]()
    for three in combinations(varied, 3):
        fit = ellipsoid(means.attitudes(list(three)))
        if fit is not None and fit.fits:
            fits[three] = fit
    heavy = [three for three, fit in fits.items() if fit.usual and usual_unit(fit.size, ALIKE_FITTED)]
    best = min(heavy, key=lambda three: fits[three].dispersion, default=())
    # Two columns of a triad and an unrelated one may fit by chance, but less well.
    heavy = [t for t in heavy if fits[t].dispersion <= _AS_WELL * fits[best].dispersion or len({*t, *best}) == 6]
    named = {three: Triple(tuple(free[k] for k in three), _NAMELESS) for three in fits}  # type: ignore[misc]
    if len(heavy) == 1 and not any(three[0] < heavy[0][0] for three in fits):
        (three,) = heavy
        fit, triple = fits[three], named[three]
        guess = (
            f"accelerations: columns {triple} as x, y, z, by their values (one ellipsoid of size {fit.size:.5g} in "
            f"{fit.attitudes} attitudes, {100 * fit.dispersion:.1f} % dispersion); to override: {_OTHERS}"
        )
        return triple, "values", [guess]
    if len(varied) == len(AXES) and not fits:
        only = Triple((free[varied[0]], free[varied[1]], free[varied[2]]), _NAMELESS)
        if columns.size(only).rests_at_gravity:
            guess = f"accelerations: columns {only} as x, y, z, the only three, at rest with the size of gravity"
            return only, "values", [f"{guess}; to override: {_OTHERS}"]
    likely = [named[three] for three in fits] or [
        Triple((free[k], free[k + 1], free[k + 2]), _NAMELESS) for k in varied if {k + 1, k + 2} <= set(varied)
    ]
    if not likely:
        return None
    because = (
        "several fit gravity"
        if len(fits) > 1
        else f"{FEWEST_ATTITUDES} attitudes at rest and one triple that fits gravity are needed"
    )
    raise Unsettled(
        f"{path}: no names of columns, and the values do not show which are the accelerations ({because}); candidates: "
        f"{_options(columns, likely)}"
    )


def _options(columns: Columns, triples: list[Triple]) -> str:
    """The candidates, each with its size and its option."""
    shown = [f"{columns.option(t)} (size {columns.size(t).middle:.4g})" for t in triples[:_MOST_NAMED]]
    more = len(triples) - _MOST_NAMED
    return " or ".join(shown) + (f", or {more} more" if more > 0 else "")


def is_rising(values: NDArray[np.float64]) -> bool:
    """Whether a column only rises, as a time or a counter does."""
    return bool((np.diff(values) >= 0).all())


def _rate(columns: Columns, triples: list[Triple], force: Triple) -> tuple[Triple | None, str, list[str]]:
    """The rates: the triple named as a rate with most words in common with the accelerations. Without names: three columns next
    to the accelerations whose readings are constant at rest."""
    named = [triple for triple in triples if triple.name.quantity == "rate"]
    if not named:
        letters = [t for t in triples if t.name.quantity == "letter" and t.name.stem[:1] == ("g",) and t != force]
        named = [triple for triple in letters if columns.size(triple).spread < _STILL_SHARE]
    if named:
        common = [len(set(triple.name.stem) & set(force.name.stem)) for triple in named]
        order = [(-common[k], STATE_ORDER.index(triple.state), k) for k, triple in enumerate(named)]
        return named[min(order)[-1]], "name", []
    free = [name for name, meaning in columns.names.items() if not meaning.quantity]
    if force.name.quantity or any(meaning.axis for meaning in columns.names.values()):
        return None, "", []
    at = free.index(force.columns[2])
    for three in (free[at + 1 : at + 4], free[max(0, at - 5) : at - 2]):
        if len(three) == len(AXES):
            triple = Triple(tuple(three), _NAMELESS)  # type: ignore[arg-type]
            data = [columns.values(name, 0) for name in three]
            moving = all(np.nanmax(column) > np.nanmin(column) and not is_rising(column) for column in data)
            if moving and columns.size(force).spread > _STILL_SHARE > columns.size(triple).spread:
                guess = f"angular rates: columns {triple}, by their values (at rest while the accelerations are)"
                return triple, "values", [f"{guess}; to override: --columns gx=...,gy=...,gz=..."]
    return None, "", []
