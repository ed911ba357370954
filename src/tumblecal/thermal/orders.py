"""The orders of the functions of temperature, and the terms of direction, rate and time: by evidence, checked by prediction.

A model is chosen by the Bayesian information criterion (Schwarz 1978) over nested families, searched by changes of one family
by up to three orders. Its number of observations is reduced by the autocorrelation of the residuals of the largest model along
the temperature: errors that neighbouring bins share, such as a loop of hysteresis of any shape, are no evidence for an order.
The highest order of a family is dropped unless the model with it, fitted to the other branch or the other temperatures,
predicts the held-out rows better by more than one standard error.

Hysteresis has one of several forms, chosen by the same criterion. No form is that of the unit, so the middle between the
branches is known only within a part of the hysteresis: a highest order of the bias with a smaller curve is dropped.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from tumblecal.ground.soaks import soaks
from tumblecal.recordings.thermal.thermal_table import ThermalTable
from tumblecal.thermal.design import RANK, Design, free_of
from tumblecal.thermal.hysteresis import FORMS
from tumblecal.thermal.signals import NAMES


# A cubic may be needed although no quadratic is: steps of one to three orders are tried.
_STEPS = (1, 2, 3, -1, -2)
_MOST_CHANGES = 40
# A signal that is no function of temperature is accepted with odds above 20 : 1.
_ACCEPTED = 2 * np.log(20.0)
# The standard deviations of the rows are as good as estimates with this many degrees of freedom: few rows do not replace them.
_NOISE_DOF = 5
# A signal needs a part of this share that no function of temperature and no other signal of the model makes; otherwise large
# coefficients could cancel.
_DISTINCT = 0.1
# Effects of the history of the temperature. One is not separated from others, or from functions of temperature, if less than
# this part of its signal is no combination of theirs.
HISTORY = ("hysteresis", "temperature_lag", "temperature_rate")
_SEPARATE = 0.3
# The root mean square of the highest order of the bias, relative to that of the hysteresis. For loops of eight other laws, most
# orders above the true one are below this part, and the true orders are above 1/3.
OF_HYSTERESIS = 0.2


class Search:
    """The best orders of the families of a design; `rows`: of observations and priors less its constants."""

    def __init__(self, design: Design, chains: Sequence[Int[np.ndarray, " part"]]):
        self._known: dict[tuple[tuple[str, int], ...], float] = {}
        highest = {name: len(columns) for name, columns in design.families.items()}
        # In the space that the constants do not reach.
        constant, whole = design.with_priors(np.column_stack([design.columns(highest), design.values]))
        whole[len(design.values) :, -1] = design.prior_values
        free = free_of(constant, whole)
        # The rest of a column that the constants absorb (a difference between branches of which there is one) is rounding.
        self._absorbed = np.linalg.norm(free, axis=0) <= RANK * np.linalg.norm(whole, axis=0)
        columns, values = free[:, :-1], free[:, -1]
        basis = np.linalg.svd(columns, full_matrices=False)[0][:, : np.linalg.matrix_rank(columns)]
        residual = (values - basis @ (basis.T @ values))[: len(design.values)]
        self.rows = len(free) - np.linalg.matrix_rank(constant)
        self._count = self.rows * independent_share(residual.reshape(-1, 3), chains)
        # Everything is in the space of the columns and the values: a small triangle instead of all rows.
        _, self._triangle = np.linalg.qr(free)
        self._places, start = {}, 0
        for name, family in design.families.items():
            self._places[name] = (start, family.shape[1])
            start += family.shape[0] * family.shape[1]

    def criterion(self, orders: Mapping[str, int]) -> float:
        """Observations times the logarithm of the mean square of residuals, plus the logarithm of observations for each
        coefficient."""
        # Signals after the functions of temperature, so that each is compared with what these make.
        key = tuple(
            sorted(((n, order) for n, order in orders.items() if order), key=lambda each: (each[0] in NAMES, each))
        )
        if key not in self._known:
            taken = [self._places[name][0] + k for name, order in key for k in range(order * self._places[name][1])]
            columns, values = self._triangle[:, taken], self._triangle[:, -1]
            if taken:
                basis, triangle = np.linalg.qr(columns)
                least = [
                    _DISTINCT if n in NAMES else 1e-9 for n, order in key for _ in range(order * self._places[n][1])
                ]
                good = np.abs(np.diag(triangle)) > np.array(least) * np.linalg.norm(columns, axis=0)
                values = values - basis @ (basis.T @ values)
                if not np.all(good) or np.any(self._absorbed[taken]):
                    self._known[key] = np.inf
                    return np.inf
            square = (self._count * float(values @ values) / self.rows + _NOISE_DOF) / (self._count + _NOISE_DOF)
            others = sum(name in NAMES for name, _ in key)
            self._known[key] = (
                (self._count + _NOISE_DOF) * np.log(square) + len(taken) * np.log(self._count) + _ACCEPTED * others
            )
        return self._known[key]

    def best(self, start: Mapping[str, int], highest: Mapping[str, int]) -> dict[str, int]:
        """The best orders from a start, each at most its highest."""
        orders = dict(start)
        for _ in range(_MOST_CHANGES):
            changes = [
                orders | {name: orders.get(name, 0) + step}
                for name in highest
                for step in _STEPS
                if 0 <= orders.get(name, 0) + step <= highest[name]
            ]
            better = min(changes, key=self.criterion, default=orders)
            if not self.criterion(better) < self.criterion(orders) - 1e-9:
                break
            orders = better
        return {name: order for name, order in orders.items() if order}


def independent_share(residual: Float[np.ndarray, "table 3"], chains: Sequence[Int[np.ndarray, " part"]]) -> float:
    """Independent observations for each row, `(1 - r) / (1 + r)` for the autocorrelation r of neighbours (first order)."""
    product = sum(float(np.sum(residual[chain[1:]] * residual[chain[:-1]])) for chain in chains)
    square = sum(float(np.sum(residual[chain[1:]] ** 2 + residual[chain[:-1]] ** 2)) / 2 for chain in chains)
    correlation = min(max(product / square, 0.0), 0.98) if square > 0 else 0.0
    return (1 - correlation) / (1 + correlation)


def chains_of(table: ThermalTable) -> list[Int[np.ndarray, " part"]]:
    """Rows of each attitude and branch in the order of time."""
    labels, time_s = np.array([f"{a}\n{b}" for a, b in zip(table.attitude, table.branch, strict=True)]), table.time_s
    return [
        rows[np.argsort(time_s[rows])] for label in dict.fromkeys(labels) for rows in [np.flatnonzero(labels == label)]
    ]


def unseparated(design: Design, table: ThermalTable) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Effects of the history that these directions and rates do not separate from the dependence on temperature, and those that
    they do not separate from it or from each other. Hysteresis is any function of temperature that differs by direction."""
    functions = design.columns({name: len(each) for name, each in design.families.items() if name not in NAMES})
    names = HISTORY if np.any(table.rate_degc_per_s[~table.soak]) else HISTORY[:1]
    base, first, every = np.column_stack([design.constant, functions]), {}, {}
    for name in [name for name in names if name in design.families]:
        columns = design.columns({name: 1})
        if name == "hysteresis":
            by_direction = np.asarray(table.reached_by)[design.row_of, None] * functions
            every[name] = free_of(base, np.column_stack([columns, by_direction]))
        rest = free_of(base, columns)
        if np.linalg.norm(rest) >= _SEPARATE * np.linalg.norm(columns):
            first[name] = rest
    joined = {
        name
        for one, part in first.items()
        for other in first
        if one != other
        and np.linalg.norm(free_of(every.get(other, first[other]), part)) < _SEPARATE * np.linalg.norm(part)
        for name in (one, other)
    }
    alone = tuple(name for name in names if name not in first)
    return alone, tuple(name for name in names if name in {*alone, *joined})


def confirmed(
    design: Design,
    orders: Mapping[str, int],
    table: ThermalTable,
    names: Sequence[str],
) -> dict[str, int]:
    """The orders that rows outside their fit confirm: the highest order of a family is dropped unless it predicts them better.

    Rows at temperatures outside those of the fit, and parts whose rest has too few temperatures for the order, are no test.
    Without a test the evidence decides.

    **Arguments:**

    - `names`: families that may lose orders.
    """
    chosen, chains = dict(orders), chains_of(table)
    parts = [(part, temperatures_outside(table, part)) for part in folds_of(table)]
    for name in names:
        while chosen.get(name, 0) > 0:
            folds = [part for part, temperatures in parts if temperatures > chosen[name]]
            lower = chosen | {name: chosen[name] - 1}
            errors = prediction_errors(design, chosen, table, folds)
            change = prediction_errors(design, lower, table, folds) - errors
            rows = np.all(np.isfinite(errors), axis=1)
            if not rows.any():
                break
            share = independent_share(np.where(rows[:, None], errors, 0.0), chains)
            # (e + d)^2 - e^2 summed, and the standard deviation of its part 2 e d.
            gain = float(np.nansum(change**2 + 2 * errors * change))
            spread = 2 * float(np.sqrt(np.nanmean(errors**2) * np.nansum(change**2) / share))
            if gain > spread:
                break
            chosen = lower
    return {name: order for name, order in chosen.items() if order}


def above_hysteresis(design: Design, orders: Mapping[str, int], table: ThermalTable) -> dict[str, int]:
    """The orders without those of the bias whose curve is small relative to the hysteresis, and to an effect of the rate that
    these rates do not separate from it.

    The curve of an order is the change of the fitted bias by it, signals excluded; the lower orders are fitted again.
    """
    chosen, rate = dict(orders), "temperature_rate"
    joined = rate in orders and "hysteresis" in unseparated(design, table)[1]
    signals = without_signals(design, orders, (*FORMS, rate) if joined else FORMS)
    size = float(np.linalg.norm(design.values - signals.values))
    fitted = _of_temperature(design, chosen)
    while size > 0 and chosen.get("bias", 0) > 0:
        lower = chosen | {"bias": chosen["bias"] - 1}
        before, fitted = fitted, _of_temperature(design, lower)
        if np.linalg.norm(fitted - before) > OF_HYSTERESIS * size:
            break
        chosen = lower
    return {name: order for name, order in chosen.items() if order}


def _of_temperature(design: Design, orders: Mapping[str, int]) -> Float[np.ndarray, " rows"]:
    """Fitted values of constants and functions of temperature; signals are fitted, and subtracted."""
    functions = {name: order for name, order in orders.items() if name not in NAMES}
    coefficients = design.coefficients(functions | {name: order for name, order in orders.items() if name in NAMES})
    count = design.constant.shape[1] + design.columns(functions).shape[1]
    return design.predicted(functions, coefficients[:count])


def prediction_errors(
    design: Design, orders: Mapping[str, int], table: ThermalTable, folds: Sequence[Bool[np.ndarray, " table"]]
) -> Float[np.ndarray, "table 3"]:
    """White errors of the prediction of each row of the table by the rows outside its fold; NaN without a prediction.

    Signals that are no function of temperature, such as the difference between the branches, are no errors of the prediction:
    their estimate by all rows is subtracted first.
    """
    errors = np.full((len(design.values) // 3, 3), np.nan)
    design = without_signals(design, orders)
    orders = {name: order for name, order in orders.items() if name not in NAMES}
    for held_out in folds:
        predicted = predictable(table, held_out)
        rest, apart = design.part(~held_out), design.part(predicted)
        error = apart.values - apart.predicted(orders, rest.coefficients(orders))
        errors[predicted] = error.reshape(-1, 3)
    return errors


def without_signals(design: Design, orders: Mapping[str, int], names: Collection[str] = NAMES) -> Design:
    """The design with its values less the signals of these names, which are no function of temperature, as estimated by all
    rows."""
    others = {name: order for name, order in orders.items() if name in names}
    if not others:
        return design
    # Families in this order, so that the coefficients of the signals are the last.
    arranged = {name: order for name, order in orders.items() if name not in names} | others
    columns = design.columns(others)
    return replace(design, values=design.values - columns @ design.coefficients(arranged)[-columns.shape[1] :])


def predictable(table: ThermalTable, part: Bool[np.ndarray, " table"]) -> Bool[np.ndarray, " table"]:
    """The rows of a part that the rest can predict: at its attitudes, within its temperatures."""
    rest = table.rows(~part)
    low, high = rest.range_degc
    degc = table.temperature_degc
    return part & (degc >= low) & (degc <= high) & np.isin(np.array(table.attitude), np.array(rest.attitude))


def temperatures_outside(table: ThermalTable, part: Bool[np.ndarray, " table"]) -> int:
    """The number of different temperatures outside a part; 0 if the rest predicts none of its rows."""
    return len(soaks(table.temperature_degc[np.flatnonzero(~part)])) if predictable(table, part).any() else 0


def folds_of(table: ThermalTable) -> list[Bool[np.ndarray, " table"]]:
    """Rows held out together: each direction of change, if both are present at the same attitudes; otherwise each interior
    fifth of the temperatures, or each interior soak."""
    labels, degc = np.array(table.attitude), table.temperature_degc
    direction = np.asarray(table.reached_by)
    both = [set(labels[direction == sign]) for sign in (1, -1)]
    if both[0] and both[0] == both[1]:
        return [direction == sign for sign in (1, -1)]
    distinct = np.unique(np.round(degc, 1))
    parts = len(distinct) if len(distinct) <= 8 else 7
    edges = np.quantile(distinct, np.linspace(0, 1, parts + 1)) if len(distinct) > 8 else np.append(distinct, np.inf)
    number = np.clip(np.searchsorted(edges, degc + 0.05, side="right") - 1, 0, parts - 1)
    return [number == k for k in range(1, parts - 1)]
