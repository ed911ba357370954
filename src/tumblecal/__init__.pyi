from tumblecal.chain.chain import Chain as Chain
from tumblecal.chain.link import Link as Link
from tumblecal.data.calibration import read_calibration as load
from tumblecal.data.files import read_positions as read_positions
from tumblecal.data.positions import PositionSet as PositionSet
from tumblecal.diagnosis.diagnose import diagnose as diagnose
from tumblecal.diagnosis.many import diagnose_many as diagnose_many
from tumblecal.effects.rig_with_effects import read_rig_with_effects as read_rig
from tumblecal.estimation.exact import fit as fit
from tumblecal.estimation.methods import calibrate as calibrate
from tumblecal.estimation.problem import Problem as Problem
from tumblecal.ground.errors import InputError as InputError
from tumblecal.ground.precision import enable_float64 as enable_float64
from tumblecal.ground.program_cache import keep_programs as keep_programs
from tumblecal.plan.next.next_plan import next_plan as next_plan
from tumblecal.recordings.library import read_recording as read_recording
from tumblecal.recordings.library import reduce as reduce
from tumblecal.simulation.many_fits import fit_many as fit_many
from tumblecal.simulation.position_means import simulated as simulate
from tumblecal.thermal.of_recordings import thermal as thermal_calibration

__all__ = [
    "Chain",
    "InputError",
    "Link",
    "PositionSet",
    "Problem",
    "calibrate",
    "diagnose",
    "diagnose_many",
    "enable_float64",
    "fit",
    "fit_many",
    "keep_programs",
    "load",
    "next_plan",
    "read_positions",
    "read_recording",
    "read_rig",
    "reduce",
    "simulate",
    "thermal_calibration",
]
__version__: str
