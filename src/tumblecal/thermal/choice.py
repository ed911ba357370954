"""The model of a table: leaves that its attitudes determine, orders of their functions, and signals that are not of temperature."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tumblecal.capture.thermal.thermal_table import ThermalTable
from tumblecal.estimation.identifiability import identifiability
from tumblecal.estimation.linearised import linearised
from tumblecal.ground.errors import InputError
from tumblecal.ground.temperature_functions import HIGHEST_ORDER, TemperatureFunctions
from tumblecal.thermal import signals as kinds
from tumblecal.thermal.design import design_of, estimate
from tumblecal.thermal.model import LEAVES, SENSOR_LEAVES, ThermalModel
from tumblecal.thermal.orders import SEPARATED, Search, chains_of, confirmed, folds_of
from tumblecal.thermal.signals import NAMES


# 25 degC is the usual reference of calibrations.
USUAL_REFERENCE_DEGC = 25.0
# Leaves whose values at the reference are estimated, if the attitudes determine them; the first that they do is used.
_REFERENCES = (SENSOR_LEAVES, ("dK", "bias"), ("bias",), ())
# Leaves that follow temperature, likewise.
_FOLLOWING = (("bias", "dK", "gamma", "dtheta"), ("bias", "dK", "gamma"), ("bias", "dK"), ("bias",))
# A combination of parameters with this many times the uncertainty of the median one is not determined in practice.
_WEAKEST = 300.0
# Soaks closer than this (degC), or than this share of the range, are one temperature.
_SAME_DEGC, _SAME_SHARE = 0.5, 0.02
_MOST_ROUNDS = 4


@dataclass(frozen=True)
class Stated:
    """What the user states; the rest is chosen.

    - `orders`: highest order by leaf (0: constant). `knots_degc`: knots by leaf. `reference_degc`: of all functions.
    - `fixed`: values of sensor parameters at the reference that the attitudes do not determine, by name (base units).
    """

    orders: Mapping[str, int] = field(default_factory=dict)
    knots_degc: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    reference_degc: float | None = None
    fixed: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Choice:
    """The chosen model.

    - `model`: with its functions and signals. `orders`: by leaf or signal, and `criterion`: of the information criterion.
    - `constant_criterion`: that of parameters independent of temperature.
    - `highest`: the highest orders that the temperatures determine. `not_separated`: for a chosen signal, the other signals that
      explain the data almost as well. `dropped`: leaves that lost orders because they predict worse.
    """

    model: ThermalModel
    orders: Mapping[str, int]
    criterion: float
    constant_criterion: float
    highest: Mapping[str, int]
    not_separated: Mapping[str, tuple[str, ...]]
    dropped: tuple[str, ...]


def chosen_model(table: ThermalTable, stated: Stated = Stated()) -> Choice:
    """The model of a table by evidence and prediction.

    **Raises:** `InputError` for orders or knots that the temperatures cannot determine, and for one temperature only.
    """
    low, high = table.range_degc
    soaks = distinct_temperatures(table)
    if len(soaks) < 2:
        raise InputError(
            f"{table.source}: all rows are at {low:.1f} to {high:.1f} degC, which is one temperature; record a ramp, or "
            "soaks at several temperatures"
        )
    reference = stated.reference_degc
    if reference is None:
        reference = USUAL_REFERENCE_DEGC if low <= USUAL_REFERENCE_DEGC <= high else round((low + high) / 2, 1)
    functions = {leaf: _functions(table, leaf, stated, len(soaks), reference) for leaf in LEAVES}
    free, following = _determined(table, functions, stated)
    functions = {leaf: functions[leaf] for leaf in following if functions[leaf].count}
    largest = ThermalModel(table, functions, free, fixed=stated.fixed)
    forced = {leaf: functions[leaf].count for leaf in functions if leaf in stated.orders or leaf in stated.knots_degc}
    return _searched(largest, forced)


def distinct_temperatures(table: ThermalTable) -> list[float]:
    """Temperatures that are wider apart than a soak scatters, in increasing order."""
    degc = np.sort(table.temperature_degc)
    gap = max(_SAME_DEGC, _SAME_SHARE * float(np.ptp(degc)))
    found = [float(degc[0])]
    for value in degc.tolist():
        if value - found[-1] > gap:
            found.append(value)
    return found


def _functions(table: ThermalTable, leaf: str, stated: Stated, soaks: int, reference: float) -> TemperatureFunctions:
    highest, knots = min(HIGHEST_ORDER, soaks - 1), stated.knots_degc.get(leaf, ())
    wanted = 3 if knots else stated.orders.get(leaf, highest)
    if wanted + len(knots) > soaks - 1:
        kind = f"a spline with {len(knots)} knots" if knots else f"order {wanted}"
        raise InputError(
            f"{table.source}: {soaks} different temperatures cannot determine {kind} of {LEAVES[leaf]}; "
            f"the highest order is {highest}"
        )
    return TemperatureFunctions(wanted, reference, table.range_degc, knots)


def _determined(
    table: ThermalTable, functions: Mapping[str, TemperatureFunctions], stated: Stated
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Sensor leaves whose values at the reference the attitudes determine, and leaves whose change they determine."""
    linear = {leaf: replace(each, order=1, knots_degc=()) for leaf, each in functions.items()}
    best: tuple[tuple[str, ...], tuple[str, ...]] = ((), ("bias",))
    for following in _FOLLOWING:
        model = ThermalModel(table, {leaf: linear[leaf] for leaf in following}, (), fixed=stated.fixed)
        if _full_rank(model):
            best = ((), following)
            break
    for free in _REFERENCES:
        if not free or _full_rank(ThermalModel(table, {}, free, fixed=stated.fixed)):
            return free, best[1]
    return best


def _full_rank(model: ThermalModel) -> bool:
    """Whether the rows determine the parameters of a model in practice."""
    problem = model.problem()
    if not problem.chain.names:
        return True
    jacobian = np.asarray(linearised(problem, problem.chain.vector)[1])
    seen = identifiability(jacobian, problem.chain.names, problem.scales)
    singular = seen.singular_values
    return not seen.unobservable and bool(np.median(singular) < _WEAKEST * singular[-1])


def _searched(largest: ThermalModel, forced: Mapping[str, int]) -> Choice:
    table, problem = largest.table, largest.problem()
    vector = estimate(largest)
    design = design_of(largest, vector)
    others = kinds.of_table(table)
    highest = {leaf: functions.count for leaf, functions in largest.functions.items()}
    highest_of_signals = {given.name: len(given.values) for given in others}
    whole = design.with_signals(problem, others)
    orders: dict[str, int] = dict(forced)
    movable = {leaf: order for leaf, order in highest.items() if leaf not in forced}
    chains = chains_of(table.attitude, table.branch, table.time_s)
    # Functions of temperature first: in one ramp at a constant rate, time is a function of temperature.
    orders = dict(Search(design, chains).best(orders, movable).orders)
    for _ in range(_MOST_ROUNDS):
        slope = _slope(largest, vector, orders)
        lag = kinds.lag(table, slope)
        available = [*others, *([lag] if lag is not None else [])]
        whole = design.with_signals(problem, available)
        search = Search(whole, chains)
        before = dict(orders)
        orders = dict(search.best(orders, movable | highest_of_signals | ({"lag": 1} if lag else {})).orders)
        if orders == before:
            break
    folds = folds_of(table.attitude, np.asarray(table.reached_by, float), table.temperature_degc)
    final = confirmed(whole, orders, folds, [*movable], chains)
    dropped = tuple(leaf for leaf in movable if final.get(leaf, 0) < orders.get(leaf, 0))
    functions = {leaf: _of_count(largest.functions[leaf], order) for leaf, order in final.items() if leaf in highest}
    signals = tuple((given, final[given.name]) for given in available if final.get(given.name))
    return Choice(
        model=replace(largest, functions=functions, signals=signals),
        orders=final,
        criterion=search.criterion(final),
        constant_criterion=search.criterion({}),
        highest=highest,
        not_separated=_not_separated(search, final, {given.name: len(given.values) for given in available}),
        dropped=dropped,
    )


def _of_count(functions: TemperatureFunctions, count: int) -> TemperatureFunctions:
    """The first functions of a leaf: a lower order, or fewer knots."""
    order = min(count, functions.order)
    return replace(functions, order=order, knots_degc=functions.knots_degc[: count - order])


def _slope(model: ThermalModel, vector: np.ndarray, orders: Mapping[str, int]) -> np.ndarray:
    """Derivative of the readings by the temperature at the estimate of the largest model, g/degC.

    Changes above the present orders are noise: they are not in the slope.
    """
    smooth = dict(zip(model.chain.names, vector.tolist(), strict=True))
    for leaf in model.chain.free:
        family = leaf.name.removesuffix("_T")
        if family in model.functions and leaf.name != family:
            order, each = max(orders.get(family, 0), 1), leaf.value.size // model.functions[family].count
            smooth |= dict.fromkeys(leaf.names[order * each :], 0.0)
    chain = model.chain.named(smooth)
    step = 0.5
    warm, cold = (
        np.asarray(chain(replace(model.where, temperature_degc=np.asarray(model.where.temperature_degc) + sign * step)))
        for sign in (1, -1)
    )
    return (warm - cold) / (2 * step)


def _not_separated(
    search: Search, orders: Mapping[str, int], available: Mapping[str, int]
) -> dict[str, tuple[str, ...]]:
    """For each chosen signal, the other signals that explain the data almost as well in its place."""
    found: dict[str, tuple[str, ...]] = {}
    for name in [kind for kind in NAMES if orders.get(kind)]:
        rest = {other: order for other, order in orders.items() if other != name}
        alike = []
        for other, highest in available.items():
            if other == name or orders.get(other):
                continue
            best = min(search.criterion(rest | {other: order}) for order in range(1, highest + 1))
            if best < search.criterion(orders) + SEPARATED:
                alike.append(other)
        found[name] = tuple(alike)
    return found
