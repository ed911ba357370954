"""The model of a table: leaves that its attitudes determine, orders of their functions, signals that are not of temperature."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tumblecal.chain.following import CHANGE
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters, leaf_of
from tumblecal.estimation.linearised import linearised
from tumblecal.estimation.priors import Priors
from tumblecal.ground.errors import InputError
from tumblecal.ground.soaks import soaks
from tumblecal.ground.temperature_functions import HIGHEST_ORDER, TemperatureFunctions
from tumblecal.recordings.thermal.thermal_table import ThermalTable
from tumblecal.thermal import signals as kinds
from tumblecal.thermal.design import Design, design_of, estimate
from tumblecal.thermal.hysteresis import FORMS, forms_of
from tumblecal.thermal.model import LEAVES, SENSOR_LEAVES, ThermalModel
from tumblecal.thermal.orders import Search, above_hysteresis, chains_of, confirmed, unseparated
from tumblecal.thermal.signals import NAMES
from tumblecal.thermal.stated import Stated
from tumblecal.thermal.usual_sizes import AT_REFERENCE, SLOPE


# 25 degC is the usual reference of calibrations.
USUAL_REFERENCE_DEGC = 25.0
# Attitudes that a message lists.
_SHOWN = 3
# A leaf is determined if the data reduce its usual size at least to this part.
_DETERMINED = 0.5
# Usual size of angles of attitudes and mountings, rad: not known.
_ANGLE = 1.0


@dataclass(frozen=True)
class Choice:
    """The chosen model.

    - `model`: with its functions and signals. `design`: the largest model, linearised. `everything`: with all leaves of the
      sensor, and an order more than the temperatures determine.
    - `orders`: by leaf or signal, and `criterion`: of the information criterion; `constant_criterion`: that of parameters
      independent of temperature.
    - `highest`: the highest orders that the temperatures determine, `forced`: those that the user states.
    - `dropped`: leaves that lost orders because rows outside the fit do not confirm them.
    - `of_temperature`: effects of the history that these directions and rates do not separate from the dependence on
      temperature; `unseparated`: from it or from each other.
    """

    model: ThermalModel
    design: Design
    everything: Design
    reference_degc: float
    orders: Mapping[str, int]
    criterion: float
    constant_criterion: float
    highest: Mapping[str, int]
    forced: Mapping[str, int]
    dropped: tuple[str, ...]
    of_temperature: tuple[str, ...]
    unseparated: tuple[str, ...]

    @property
    def orders_of_leaves(self) -> dict[str, int]:
        """The order of each leaf that the attitudes determine; 0 for a constant one."""
        return {leaf: self.orders.get(leaf, 0) for leaf in self.highest}

    @property
    def inseparable(self) -> tuple[str, ...]:
        """Leaves whose change the attitudes do not determine, and that are not stated to be constant."""
        return tuple(leaf for leaf in LEAVES if leaf not in self.highest and leaf not in self.forced)


@dataclass(frozen=True)
class Selection:
    """Orders by evidence (`orders`), and those that rows outside the fit confirm."""

    search: Search
    orders: Mapping[str, int]
    confirmed: Mapping[str, int]


def chosen_model(table: ThermalTable, stated: Stated) -> Choice:
    """The model of a table by evidence and prediction.

    **Raises:** `InputError` for orders or knots that the temperatures cannot determine, for one temperature only, or for one in
    each of a few unknown attitudes.
    """
    low, high = table.range_degc
    temperatures = len(soaks(table.temperature_degc))
    if temperatures < 2:
        raise InputError(
            f"{table.source}: all rows are at {low:.1f} to {high:.1f} degC, which is one temperature; record a ramp, or "
            "soaks at several temperatures"
        )
    base = None if stated.base is None else stated.base.sensor.of(SENSOR)
    of_base = None if stated.base is None else stated.base.temperature_degc
    usual = USUAL_REFERENCE_DEGC if of_base is None else of_base
    reference = stated.reference_degc
    if reference is None:
        reference = usual if low <= usual <= high else round((low + high) / 2, 1)
    functions = {leaf: _functions(table, leaf, stated, temperatures, reference) for leaf in LEAVES}
    free, following = _determined(table, functions)
    if not free:
        # Each attitude has its own offset, so only temperatures of one attitude show a change.
        temperatures = _in_one_attitude(table)
        functions = {leaf: _functions(table, leaf, stated, temperatures, reference) for leaf in LEAVES}
    functions = {leaf: functions[leaf] for leaf in following if functions[leaf].count}
    fixed = {} if base is None else dict(zip(base.names, base.values.tolist(), strict=True))
    largest = ThermalModel(table, functions, free, fixed=fixed, priors=_priors(free, base))
    forced = {leaf: functions[leaf].count for leaf in functions if leaf in stated.orders or leaf in stated.knots_degc}
    forced |= {leaf: 0 for leaf, order in stated.orders.items() if order == 0}
    return _chosen(largest, forced, reference)


def _in_one_attitude(table: ThermalTable) -> int:
    """The largest number of temperatures in one attitude.

    **Raises:** `InputError` if each attitude has only one.
    """
    labels = np.array(table.attitude)
    found = {name: soaks(table.temperature_degc[labels == name]) for name in table.attitudes}
    if (count := max(len(levels) for levels in found.values())) > 1:
        return count
    listed = ", ".join(f"{name} {levels[0]:.1f} degC" for name, levels in list(found.items())[:_SHOWN])
    raise InputError(
        f"{table.source}: each attitude has one temperature ({listed}), so the readings change with the attitude and the "
        "temperature at once, and one recording does not predict another; record several temperatures in each attitude, or "
        "give --same-attitude if the unit was not moved"
    )


def _functions(
    table: ThermalTable, leaf: str, stated: Stated, temperatures: int, reference: float
) -> TemperatureFunctions:
    highest, knots = min(HIGHEST_ORDER, temperatures - 1), stated.knots_degc.get(leaf, ())
    wanted = 3 if knots else stated.orders.get(leaf, highest)
    if wanted + len(knots) > temperatures - 1:
        kind = f"a spline with {len(knots)} knots" if knots else f"order {wanted}"
        raise InputError(
            f"{table.source}: {temperatures} different temperatures cannot determine {kind} of {LEAVES[leaf]}; "
            f"the highest order is {highest}"
        )
    return TemperatureFunctions(wanted, reference, table.range_degc, knots)


def _determined(
    table: ThermalTable, functions: Mapping[str, TemperatureFunctions]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Sensor leaves whose values at the reference these data determine, and leaves whose change they determine, all at once:
    those that the data know much better than their usual sizes do."""
    linear = {leaf: replace(each, order=1, knots_degc=()) for leaf, each in functions.items()}
    problem, degc = ThermalModel(table, linear).problem, float(np.ptp(table.range_degc)) / np.sqrt(12)
    leaves = {leaf.name: leaf.value.size for leaf in problem.chain.free}
    sizes = {name: AT_REFERENCE.get(name, _ANGLE) for name in leaves}
    sizes |= {leaf + CHANGE: degc * size for leaf, size in SLOPE.items()}
    usual = np.repeat([sizes[name] for name in leaves], [*leaves.values()])
    jacobian = np.asarray(linearised(problem, problem.chain.vector)[1]) / problem.scales * usual
    sd = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian + np.eye(len(usual)))))
    ends = np.cumsum([*leaves.values()])
    known = {name: bool(np.max(part) < _DETERMINED) for name, part in zip(leaves, np.split(sd, ends[:-1]), strict=True)}
    following = tuple(leaf for leaf in LEAVES if leaf == "bias" or known.get(leaf + CHANGE))
    angles = all(known[name] for name in leaves if not (name in SENSOR_LEAVES or name.endswith(CHANGE)))
    free = tuple(leaf for leaf in SENSOR_LEAVES if known[leaf])
    return (free if angles and "bias" in free else ()), following


def _priors(free: tuple[str, ...], base: SensorParameters | None) -> Priors:
    """Priors of the values at the reference that the attitudes do not determine: of a calibration, otherwise usual sizes. The
    non-orthogonality always has one, because orders of temperature may leave it undetermined."""
    names = tuple(name for name in SENSOR if leaf_of(name) not in free)
    if not free:
        return {}
    if base is None or not names:
        return {leaf: (0.0, AT_REFERENCE[leaf]) for leaf in SENSOR_LEAVES if leaf not in free or leaf == "gamma"}
    known = base.of(names)
    return {names: (known.values, known.covariance)}


def selected(design: Design, table: ThermalTable, highest: Mapping[str, int], forced: Mapping[str, int]) -> Selection:
    """The best orders for the rows of a design, by evidence and prediction.

    **Arguments:**

    - `highest`: the highest order of each leaf. `forced`: orders that are not chosen.
    """
    movable = {leaf: order for leaf, order in highest.items() if leaf not in forced}
    families = {name: len(columns) for name, columns in design.families.items()}
    # On one branch, hysteresis is a function of temperature.
    forms = [form for form in forms_of(table) if form in families] or [""]
    others = {name: order for name, order in families.items() if name in NAMES and name not in FORMS}
    search = Search(design, chains_of(table))
    # Functions of temperature first: in one ramp at a constant rate, time is a function of temperature.
    of_temperature = search.best(forced, movable)
    orders = min(
        (search.best(of_temperature, movable | others | {form: families.get(form, 0)}) for form in forms),
        key=search.criterion,
    )
    found = confirmed(design, orders, table, [*movable])
    return Selection(search, orders, above_hysteresis(design, found, table) if "bias" in movable else found)


def _chosen(largest: ThermalModel, forced: Mapping[str, int], reference: float) -> Choice:
    table, vector = largest.table, estimate(largest)
    highest = {leaf: functions.count for leaf, functions in largest.functions.items()}
    complete = replace(largest, functions=_of_all_leaves(largest, forced, reference))
    fitted = dict(zip(largest.chain.names, vector.tolist(), strict=True))
    everything = design_of(complete, complete.chain.named(fitted).vector)
    signals, bare, problem = kinds.of_table(table), everything.limited(highest), largest.problem
    design = bare.with_signals(problem, signals)
    found = selected(design, table, highest, forced)
    # The slope of the chosen model gives the signal of a lag.
    if (lag := kinds.lag(table, _slope(largest, vector, found.orders))) is not None:
        signals = (*signals, lag)
        design = bare.with_signals(problem, signals)
        found = selected(design, table, highest, forced)
    final = found.confirmed
    functions = {leaf: _of_count(largest.functions[leaf], order) for leaf, order in final.items() if leaf in highest}
    # The form of the hysteresis is a detail of the model.
    chosen = tuple(
        (replace(given, name=kinds.kind(given.name)), final[given.name]) for given in signals if final.get(given.name)
    )
    of_temperature, joined = unseparated(design, table)
    return Choice(
        model=replace(largest, functions=functions, signals=chosen),
        design=design,
        everything=everything,
        reference_degc=reference,
        orders={kinds.kind(name): order for name, order in final.items()},
        criterion=found.search.criterion(final),
        constant_criterion=found.search.criterion({}),
        highest=highest,
        forced=forced,
        dropped=tuple(leaf for leaf in highest if final.get(leaf, 0) < found.orders.get(leaf, 0)),
        of_temperature=of_temperature,
        unseparated=joined,
    )


def _of_all_leaves(
    largest: ThermalModel, forced: Mapping[str, int], reference: float
) -> dict[str, TemperatureFunctions]:
    """Functions of all leaves of the sensor: as stated, otherwise with one order more than the temperatures determine."""
    order = min(max((each.order for each in largest.functions.values()), default=0) + 1, HIGHEST_ORDER)
    usual = dict.fromkeys(
        (*SENSOR_LEAVES, *largest.functions), TemperatureFunctions(order, reference, largest.table.range_degc)
    )
    stated = {leaf: largest.functions.get(leaf) for leaf in forced}
    return {leaf: each for leaf, each in (usual | stated).items() if each is not None}


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
        family = leaf.name.removesuffix(CHANGE)
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
