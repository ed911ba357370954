"""Errors of the model and their causes: detection, identification, adaptation, and their limits."""

from tumblecal.diagnosis.diagnose import Diagnoser, diagnose
from tumblecal.diagnosis.diagnosis import Diagnosis


__all__ = [
    "Diagnoser",
    "Diagnosis",
    "diagnose",
]
