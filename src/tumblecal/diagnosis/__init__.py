"""What does the model get wrong, and why: show, detect, identify, adapt, and say what cannot be said."""

from tumblecal.diagnosis.diagnose import Diagnoser, diagnose
from tumblecal.diagnosis.diagnosis import Diagnosis


__all__ = [
    "Diagnoser",
    "Diagnosis",
    "diagnose",
]
