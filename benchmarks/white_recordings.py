"""What does it cost that a recording of white noise does not say that it is white?

Recordings of 24 dwells (of `stated_sd.py`, white noise alone) are reduced as `tumblecal reduce` does and fitted as
`tumblecal calibrate` does. Printed for each length of dwell: chi-squared per degree of freedom of the fit, and the sd of the
parameters over that by the true white noise, least and most of the recordings.

    python benchmarks/white_recordings.py --recordings 5
"""

import argparse
from dataclasses import replace

import numpy as np

import stated_sd
import tumblecal
from tumblecal.estimation import exact, problem_of


WHITE_G_PER_RTHZ = 100e-6  # as stated_sd.NOISES["white"]


def ratios(seed: int, schedule: tuple[float, float]) -> tuple[dict[str, float], float]:
    """Sd by the recording's noise over sd by the true white noise, by parameter, and chi2/dof."""
    data, _ = stated_sd.recorded("white", seed, schedule)
    own = exact.fit(problem_of(data))
    plain = replace(data, sd=None, recorded_noise=None, comments={})
    true = exact.fit(problem_of(plain, noise_sd=WHITE_G_PER_RTHZ / np.sqrt(schedule[0])))
    return dict(zip(own.names, (own.sd / true.sd).tolist(), strict=True)), own.chi2 / own.dof


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, default=5, help="of each length of dwell")
    parser.add_argument("--first", type=int, default=0, help="seed of the first recording")
    given = parser.parse_args()
    tumblecal.enable_float64()
    for schedule in stated_sd.SCHEDULES:
        made = [ratios(seed, schedule) for seed in range(given.first, given.first + given.recordings)]
        chi2 = [own for _, own in made]
        print(f"{schedule[0]:g} s: chi2/dof {min(chi2):.2f} to {max(chi2):.2f}")
        for name in made[0][0]:
            own = [sds[name] for sds, _ in made]
            print(f"  {name:10s} sd {min(own):.2f} to {max(own):.2f} times that of white noise")


if __name__ == "__main__":
    main()
