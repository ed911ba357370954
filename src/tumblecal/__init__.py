"""Calibration of accelerometer triads on a dividing head, and diagnosis of errors of the model.

Importing this package loads neither JAX nor matplotlib; they load with the folder that needs them. The first names of a script
are here, each loaded when it is used: `read_positions`, `read_recording`, `reduce`, `read_rig`, `simulate`, `calibrate`,
`diagnose`, `next_plan`, `load`.
"""

# This file is read by Pythons that can read nothing else here: no syntax newer than 3.6 before the check.
import sys


if sys.version_info < (3, 11):  # noqa: UP036
    sys.exit("tumblecal needs Python 3.11 or later; this is Python %d.%d" % sys.version_info[:2])  # noqa: UP031

from tumblecal.ground.errors import InputError as InputError
from tumblecal.ground.precision import enable_float64 as enable_float64
from tumblecal.ground.showing import find_drawings_by


__version__ = "0.1.0"

# The module of each name; `__init__.pyi` states the same to type checkers.
_FROM = {
    "read_positions": "tumblecal.data.files:read_positions",
    "read_recording": "tumblecal.recordings.library:read_recording",
    "reduce": "tumblecal.recordings.library:reduce",
    "thermal_calibration": "tumblecal.thermal.of_recordings:thermal",
    "PositionSet": "tumblecal.data.positions:PositionSet",
    "Chain": "tumblecal.chain.chain:Chain",
    "Link": "tumblecal.chain.link:Link",
    "Problem": "tumblecal.estimation.problem:Problem",
    "fit": "tumblecal.estimation.exact:fit",
    "read_rig": "tumblecal.effects.rig_with_effects:read_rig_with_effects",
    "fit_many": "tumblecal.simulation.many_fits:fit_many",
    "simulate": "tumblecal.simulation.position_means:simulated",
    "calibrate": "tumblecal.estimation.methods:calibrate",
    "diagnose": "tumblecal.diagnosis.diagnose:diagnose",
    "diagnose_many": "tumblecal.diagnosis.many:diagnose_many",
    "keep_programs": "tumblecal.ground.program_cache:keep_programs",
    "next_plan": "tumblecal.plan.next.next_plan:next_plan",
    "load": "tumblecal.data.calibration:read_calibration",
}


def __getattr__(name: str):
    if name not in _FROM:
        raise AttributeError(f"module 'tumblecal' has no attribute {name!r}; there are {', '.join(_FROM)}")
    return _loaded(*_FROM[name].split(":"))


def _loaded(module: str, name: str):
    from importlib import import_module

    return getattr(import_module(module), name)


def _drawing(name: str):
    module, _, function = name.rpartition(".")
    return _loaded(f"tumblecal.{module}", function)


find_drawings_by(_drawing)


def __dir__() -> list[str]:
    return [*globals(), *_FROM]
