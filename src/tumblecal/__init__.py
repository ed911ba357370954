"""Calibration of accelerometer triads on a dividing head, and diagnosis of what the model gets wrong.

The folders are the data's way: `ground` → `chain` → `effects` → `data` → `noise` → `capture` → `estimation` →
`simulation` → `diagnosis` → `planning` → `studies` → `report` → `cli`. Importing this package loads neither JAX nor
matplotlib; they load with the folder that needs them.
"""

from tumblecal.ground.errors import InputError as InputError
from tumblecal.ground.precision import enable_float64 as enable_float64


__version__ = "0.1.0"
