"""The key `temperature` of a calibration file: curves of temperature, their joint covariance, and hysteresis."""

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from tumblecal.data.sensor_parameters import SENSOR
from tumblecal.data.temperature_curves import Curve, Hysteresis, TemperatureCurves
from tumblecal.ground.errors import InputError
from tumblecal.ground.option_texts import faults_of
from tumblecal.ground.record import LEFT_OUT
from tumblecal.ground.strict_json import LISTED, Covariance, Finite, Record, Shape, Text, one_of
from tumblecal.ground.temperature_functions import HIGHEST_ORDER, TemperatureFunctions


# Smallest eigenvalue of correlations that rounding can cause: powers of the temperature are nearly dependent.
_ROUNDING = 1e-9


class StatedCurve(Record):
    """A parameter, the order and the knots of its functions, and their coefficients with units."""

    parameter: Annotated[Text, one_of(SENSOR)]
    order: Annotated[int, Field(strict=True, ge=0, le=HIGHEST_ORDER)]
    knots_degc: Annotated[list[Finite], LEFT_OUT] = Field(default_factory=list)
    coefficients: Annotated[np.ndarray, Shape((None,)), LISTED]
    units: list[Text]


class StatedTemperature(Record):
    """The object `temperature`."""

    reference_degc: Finite
    range_degc: Annotated[list[Finite], Field(min_length=2, max_length=2)]
    curves: Annotated[list[StatedCurve], Field(min_length=1)]
    covariance: Covariance
    covariance_order: list[Text]
    hysteresis: Annotated[list[Hysteresis], LEFT_OUT] = Field(default_factory=list)

    @model_validator(mode="after")
    def _valid(self) -> "StatedTemperature":
        self.curves_of_temperature()
        # Correlations; a coefficient of zero variance has a variance of 1 instead, and no correlations.
        sd = np.sqrt(np.diag(self.covariance))
        sd = np.where(sd > 0, sd, 1.0)
        if np.min(np.linalg.eigvalsh(self.covariance / np.outer(sd, sd))) < -_ROUNDING:
            raise ValueError("covariance must be positive semidefinite; use the file as the program wrote it")
        return self

    @classmethod
    def of(cls, curves: TemperatureCurves) -> "StatedTemperature":
        """The object of some curves."""
        return cls.model_validate(curves, from_attributes=True, strict=False)

    def curves_of_temperature(self) -> TemperatureCurves:
        """The curves of this object.

        **Raises:** `InputError` for values that do not agree.
        """
        curves, (low, high) = list[Curve](), self.range_degc
        for number, stated in enumerate(self.curves):
            with faults_of(f"curves.{number}"):
                knots = tuple(stated.knots_degc)
                functions = TemperatureFunctions(stated.order, self.reference_degc, (low, high), knots)
                curves.append(Curve(stated.parameter, functions, stated.coefficients))
                if tuple(stated.units) != curves[-1].units:
                    raise InputError(f"{stated.parameter}: the units must be {', '.join(curves[-1].units)}")
        return TemperatureCurves(tuple(curves), self.covariance, tuple(self.covariance_order), tuple(self.hysteresis))
