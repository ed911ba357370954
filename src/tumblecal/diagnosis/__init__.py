"""What does the model get wrong, and why: show, detect, identify, adapt, and say what cannot be said."""

from tumblecal.diagnosis.diagnose import Diagnoser as Diagnoser
from tumblecal.diagnosis.diagnose import diagnose as diagnose
from tumblecal.diagnosis.diagnosis import Diagnosis as Diagnosis
