"""False reports of a change within dwells on recordings of noise alone, by its colour, and how often a true one is found.

python benchmarks/within_dwells.py [recordings]
"""

import sys

import numpy as np

from tumblecal.noise.parts import Dwells, Flicker, GaussMarkov, Noise, RandomWalk, White
from tumblecal.noise.sampling import dwell_records
from tumblecal.noise.within_dwells import without_common_change


RATE_HZ, WHITE = 10.0, 4e-5
# Sizes that dominate the mean of a dwell.
COLOURS = {
    "white": (),
    "flicker": (Flicker(np.full(3, 2e-5), 0.02, 1e5),),
    "random walk": (RandomWalk(np.full(3, 1e-5)),),
    "Gauss-Markov 5 s": (GaussMarkov(np.full(3, 8e-5), 5.0),),
    "Gauss-Markov 100 s": (GaussMarkov(np.full(3, 8e-5), 100.0),),
}
# Dwells, seconds of each, seconds from one to the next.
PLANS = {
    "24 x 30 s": (24, 30.0, 60.0),
    "24 x 3 s": (24, 3.0, 8.0),
    "6 x 60 s": (6, 60.0, 90.0),
    "4 x 5 s": (4, 5.0, 20.0),
}


def recording(rng, noise, plan, kind):
    """Dwells of one recording, and the temperature in them."""
    count, length, step = plan
    size = round(length * RATE_HZ)
    up = rng.normal(size=(count, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    starts = np.arange(count) * step
    dwells = list(dwell_records(noise, Dwells(starts, size, 1 / RATE_HZ), int(rng.integers(1 << 30)), up))
    time = starts[:, None] + np.arange(size) / RATE_HZ
    whole = count * step
    temperature = {
        "ramp": 25 + 20 * time / whole,
        "warm-up": 25 + 10 * (1 - np.exp(-time / (whole / 6))),
        "wander": 25 + np.cumsum(np.cumsum(rng.normal(size=time.size)) * 1e-4).reshape(time.shape),
        "sensor noise": 25 + 0.1 * rng.normal(size=time.shape),
    }[kind]
    return dwells, list(np.round(temperature, 2))


def main(recordings: int) -> None:
    """Print the false reports, and how many changes of 0.3 mg in a dwell are found."""
    kinds = ("ramp", "warm-up", "wander", "sensor noise")
    for plan_name, plan in PLANS.items():
        for name, slow in COLOURS.items():
            rng, noise = np.random.default_rng(1), Noise((White(np.full(3, WHITE)), *slow))
            false = found = 0
            for number in range(recordings):
                dwells, temperature = recording(rng, noise, plan, kinds[number % len(kinds)])
                false += bool(without_common_change(dwells, RATE_HZ, temperature)[1])
                if number % 10 == 0:
                    rising = np.linspace(-0.5, 0.5, len(dwells[0]))
                    moved = [own + 3e-4 * rising[:, None] for own in dwells]
                    found += bool(without_common_change(moved, RATE_HZ)[1])
            share = f"{false} of {recordings} ({100 * false / recordings:.1f} %)"
            print(f"{plan_name:10} {name:20} false {share}; found {found} of {-(-recordings // 10)}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 500)
