"""The chain of a temperature calibration: nominal links, leaves that follow temperature, signals of direction, rate and time.

Unknown attitudes are held still over a range of temperatures: each has two tilts for all its rows, so every row determines
three numbers, while a hand-held position determines one.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from tumblecal.chain import Chain, Where, coefficients, settings
from tumblecal.chain.nominal import HAND_HELD, NOMINAL, Leaf, nominal_link
from tumblecal.data.positions import PositionSet, attitudes_of
from tumblecal.estimation.priors import Priors
from tumblecal.estimation.problem import Problem
from tumblecal.ground.axes import AXES
from tumblecal.ground.temperature_functions import TemperatureFunctions
from tumblecal.recordings.thermal.thermal_table import ThermalTable
from tumblecal.thermal.given_signals import GivenSignals
from tumblecal.thermal.signals import Signals


# Leaves that may follow temperature, and their names in words.
LEAVES = {"bias": "bias", "dK": "scale factor", "gamma": "non-orthogonality", "dtheta": "mount"}
# Leaves of the sensor that are values at the reference temperature.
SENSOR_LEAVES = ("dK", "bias", "gamma")


@dataclass(frozen=True)
class ThermalModel:
    """The model of a table of bins.

    - `functions`: by leaf, the functions of temperature that it follows; a leaf that is absent is constant.
    - `free`: leaves of the sensor whose values at the reference the attitudes determine. The other leaves have `priors`. If it
      is empty, no value at the reference is estimated: each attitude has an offset on each axis, and the sensor has the
      values in `fixed`.
    - `signals`: signals of direction, rate or time, with their orders.
    """

    table: ThermalTable
    functions: Mapping[str, TemperatureFunctions]
    free: tuple[str, ...] = SENSOR_LEAVES
    fixed: Mapping[str, float] = field(default_factory=dict)
    priors: Priors = field(default_factory=dict)
    signals: tuple[tuple[Signals, int], ...] = ()

    @property
    def knots_degc(self) -> dict[str, tuple[float, ...]]:
        """Interior knots of the leaves that follow a spline."""
        return {leaf: each.knots_degc for leaf, each in self.functions.items() if each.knots_degc}

    @cached_property
    def where(self) -> Where:
        """The settings of the rows."""
        table = self.table
        known = table.known_attitudes
        angles = (table.alpha_deg, table.beta_deg) if known else directions_of(table)
        alpha, beta = np.radians(angles)
        return settings(
            alpha,
            beta,
            pitch=None if known else np.zeros(len(table), int),
            run=table.clock if known else None,
            mount=table.mount if known else table.attitude,
            time_s=table.time_s,
            temperature_degc=table.temperature_degc,
        )

    @cached_property
    def chain(self) -> Chain:
        """The chain, all coefficients zero but the fixed ones."""
        where, known = self.where, self.table.known_attitudes
        leaves = {name: Leaf(follows=self.functions.get(name)) for name in LEAVES}
        if known:
            many = {column: len(set(where.names(column))) > 1 for column in ("run", "mount")}
            by = ".".join([*(column for column in many if many[column]), "pitch"])
            leaves["dbeta"] = Leaf(by)
            leaves["dtheta"] = replace(leaves["dtheta"], by="mount" if many["mount"] else None)
        else:
            leaves |= {"dbeta": Leaf("pitch", free=False), "tilt": Leaf("mount", free=bool(self.free))}
        chain = Chain(tuple(nominal_link(name, where, leaves) for name in (NOMINAL if known else HAND_HELD)))
        for given, order in self.signals:
            size = coefficients(given.name, given.names(order), unit=given.unit, scale=given.scale)
            chain = chain + GivenSignals(size, given.up_to(order))
        if not (known or self.free):
            names = [f"{axis}@{name}" for name in self.table.attitudes for axis in AXES]
            chain = chain + GivenSignals(coefficients("offset", names, unit="g"), offsets(self.table))
        chain = chain.named(dict(self.fixed))
        return chain.fixed({*(() if self.free else SENSOR_LEAVES), *(() if known else ("dtheta",))})

    @property
    def problem(self) -> Problem:
        """The fit of the chain to the table."""
        table = self.table
        problem = Problem.from_arrays(self.chain, self.where, table.readings, noise_sd=table.sd, priors=self.priors)
        return replace(problem, data=self._positions)

    @property
    def _positions(self) -> PositionSet:
        table, where = self.table, self.where
        return PositionSet(
            names=tuple(
                f"{name} {degc:.1f} degC" for name, degc in zip(table.attitude, table.temperature_degc, strict=True)
            ),
            alpha_deg=np.degrees(np.asarray(where.alpha)),
            beta_deg=np.degrees(np.asarray(where.beta)),
            readings=table.readings,
            sd=table.sd,
            time_s=table.time_s,
            temperature_degc=table.temperature_degc,
            comments=table.comments,
            source=table.source,
            files=table.files,
        )


def offsets(table: ThermalTable) -> Float[np.ndarray, "signals rows 3"]:
    """A signal of 1 for each attitude and axis: they contain all values at the reference, and all tilts."""
    at = np.array([[name == label for label in table.attitude] for name in table.attitudes], float)
    return (at[:, None, :, None] * np.eye(3)[:, None, :]).reshape(-1, len(table), 3)


def directions_of(table: ThermalTable) -> tuple[Float[np.ndarray, " rows"], Float[np.ndarray, " rows"]]:
    """Spindle and pitch angles (deg) of the rows of unknown attitudes: those of the mean reading of each attitude, from which
    its tilts are counted."""
    labels = np.array(table.attitude)
    mean = np.zeros((len(table), 3))
    for name in table.attitudes:
        mean[labels == name] = table.readings[labels == name].mean(0)
    return attitudes_of(mean)
