from tumblecal.data.calibration import read_calibration as load
from tumblecal.data.files import read_positions as read_positions
from tumblecal.diagnosis.diagnose import diagnose as diagnose
from tumblecal.effects.catalogue import read_rig_with_effects as read_rig
from tumblecal.estimation.methods import calibrate as calibrate
from tumblecal.ground.errors import InputError as InputError
from tumblecal.ground.precision import enable_float64 as enable_float64
from tumblecal.planning.next_plan import next_plan as next_plan
from tumblecal.simulation.position_means import simulated as simulate

__all__ = [
    "InputError",
    "calibrate",
    "diagnose",
    "enable_float64",
    "load",
    "next_plan",
    "read_positions",
    "read_rig",
    "simulate",
]
__version__: str
