"""A class of explanations as a product of factors, each with the reason why these data leave it open.

`bias_drift.x + second_order.z`, with `bias_temperature.x` in place of the first and `cross_axis_square.z` in place of the
second, is two findings: a bias that follows the time or the temperature, and a quadratic response of z.
"""

from collections.abc import Mapping
from itertools import product
from typing import NamedTuple

import numpy as np

from tumblecal.data import PositionSet
from tumblecal.diagnosis.causes.cause import UNEXPLAINED, id_of
from tumblecal.diagnosis.priors import CORRELATED_COLUMNS, INDISTINGUISHABLE, LARGER_ERROR
from tumblecal.diagnosis.sets.exchanges import Exchange, Labels, exchanges, parts
from tumblecal.diagnosis.sets.explanation import Explanation
from tumblecal.effects import Catalogue


# Columns of numbers that effects follow, with their attribute of a position set.
_COLUMNS = {"time_s": "time_s", "temperature_degc": "temperature_degc", "pitch": "beta_deg", "approach": "approach"}


class Reason(NamedTuple):
    """The reason why these data cannot distinguish a member of a factor from the first.

    - `kind`: "identity" (one function at 1 g: no measurement on a head separates them, and the correction at 1 g is the same),
      "columns" (columns of the data that are fully correlated), "size" (the error is too small: one three times as large would
      be distinguished), "range" (both follow the same column, which does not vary enough), "angles" (the same signal at these
      angles: others are missing), or "unnamed" (it may be an error that is not in the catalogue).
    - `columns`, `r`: of "columns" both names and their correlation, of "range" the column.
    """

    kind: str
    columns: tuple[str, ...] = ()
    r: float = float("nan")


class Factor(NamedTuple):
    """Causes that can replace each other while the rest of the explanation remains.

    - `members`: sets of labels, that of the leading explanation first.
    - `reasons`: why these data cannot distinguish each further member from the first.
    """

    members: tuple[Labels, ...]
    reasons: tuple[Reason, ...] = ()

    @property
    def resolved(self) -> bool:
        """Whether no measurement on a head could show another of its members in place of the first."""
        return all(reason.kind == "identity" for reason in self.reasons)


def factors(best: Explanation, entries: Catalogue, data: PositionSet) -> tuple[Factor, ...]:
    """An explanation of some data as a product, a factor for each finding, in the order of its labels; nothing where it has no
    label.

    Members of the class with coefficients that the data do not need (`best.supersets`), or that are less probable, are in none.
    """
    columns = {name: getattr(data, attribute) for name, attribute in _COLUMNS.items()}
    known = {name: np.asarray(values, float) for name, values in columns.items() if values is not None}
    return factors_of(best, entries, known)


def factors_of(best: Explanation, entries: Catalogue, columns: Mapping[str, np.ndarray]) -> tuple[Factor, ...]:
    """The factors of an explanation, from the columns of the data by name."""
    listed = exchanges(best.labels, best.stated, best.identical)
    apart = dict(zip(best.equivalents, best.apart, strict=False))

    def reason(exchange: Exchange) -> Reason:
        if UNEXPLAINED in exchange.added:
            return Reason("unnamed")
        if exchange.identical:
            return Reason("identity")
        if apart.get(exchange.labels, 0.0) * LARGER_ERROR >= INDISTINGUISHABLE:
            return Reason("size")
        return _of_columns(exchange, entries, columns) or Reason("angles")

    powers = ((label, entries[id_of(label)].polynomial[0]) for label in best.labels if id_of(label) in entries)
    whole: dict[tuple[str, ...], list[str]] = {}
    for label, polynomial in powers:
        whole.setdefault(polynomial or (label,), []).append(label)
    replaced = (exchange.removed for exchange in listed)
    factors = []
    for part in parts(best.labels, [*replaced, *whole.values()]):
        within = [exchange for exchange in listed if exchange.removed <= {*part}]
        others = [tuple(sorted({*part} - exchange.removed | exchange.added)) for exchange in within]
        factors.append(Factor((part, *others), tuple(map(reason, within))))
    return tuple(factors)


def _of_columns(exchange: Exchange, entries: Catalogue, columns: Mapping[str, np.ndarray]) -> Reason | None:
    """The columns that the exchanged causes follow, where both follow the same or those are fully correlated."""
    needs = {label: entry.needs for label in exchange.removed | exchange.added if (entry := entries.get(id_of(label)))}
    removed, added = (
        {name for label in labels for name in needs.get(label, ()) if name in columns}
        for labels in (exchange.removed, exchange.added)
    )
    if removed and removed == added:
        return Reason("range", tuple(sorted(removed)))
    for first, second in product(sorted(removed - added), sorted(added - removed)):
        both = columns[first], columns[second]
        if all(np.ptp(values) > 0 for values in both) and len(both[0]) == len(both[1]):
            r = float(np.corrcoef(*both)[0, 1])
            if abs(r) >= CORRELATED_COLUMNS:
                return Reason("columns", (first, second), r)
    return None
