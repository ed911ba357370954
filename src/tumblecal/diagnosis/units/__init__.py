"""Many units measured on one head: errors of the head, shared by all of them, and errors of single units."""

from tumblecal.diagnosis.units.together import Together as Together
from tumblecal.diagnosis.units.together import together as together
