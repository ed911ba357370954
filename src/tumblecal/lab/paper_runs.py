"""The three runs of Table 2 of the paper as results of a history."""

import numpy as np

from tumblecal.data import paper
from tumblecal.data.sensor_parameters import MOUNT, SENSOR, SensorParameters
from tumblecal.estimation import exact, problem_of
from tumblecal.history.entry import Entry
from tumblecal.lab.record import calibration_of


def paper_runs() -> list[Entry]:
    """The three runs, with the uncertainty of the exact fit to Table 1, which is one of them: the paper states none.

    The paper states no dates: all have the same date, so that no drift is estimated.
    """
    names, table = (*SENSOR, *MOUNT), paper.table2()
    covariance = calibration_of(exact.fit(problem_of(paper.table1()))).sensor.of(names).covariance
    return [
        Entry(
            "calibration",
            "paper",
            "2016-06-01T00:00:00Z",
            f"Table 2, run {run + 1}",
            f"table2-{run + 1}",
            "published",
            parameters=SensorParameters(names, np.array([table[name][run] for name in names]), covariance),
        )
        for run in range(3)
    ]
