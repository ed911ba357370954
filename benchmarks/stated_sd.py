"""Is the sd that `reduce` states honest, and does `diagnose` stay silent where only the noise is coloured?

Recordings of 24 dwells, simulated in plain numpy (1/f by its spectrum), in five noises: white; flicker; random walk; white,
flicker and walk; Gauss-Markov. Each is reduced as `tumblecal reduce` does and written to positions.csv. Printed for each noise,
pooled over the recordings: the scatter of neighbouring means over the stated sd, chi-squared per degree of freedom of the
means under the covariance written beside it, and how many null runs `tumblecal diagnose positions.csv` finds a cause in.

    python benchmarks/stated_sd.py --recordings 60 --processes 2
"""

import argparse
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from tumblecal.data import PositionSet, read_positions
from tumblecal.data.files import write_positions
from tumblecal.noise.dwell_sd import sd_of_means
from tumblecal.noise.recorded import NOISE_MODEL, RecordedNoise, recorded_covariance


sys.path.insert(0, str(Path(__file__).parent))
import blind_instrument as blind


RATE, POSITIONS = 50.0, 24
# Length of a dwell and of the move after it, s.
SCHEDULES = ((60.0, 20.0), (20.0, 10.0))


def white(rng: np.random.Generator, n: int, density: float) -> np.ndarray:
    return rng.standard_normal(n) * density * np.sqrt(RATE)


def flicker(rng: np.random.Generator, n: int, bias_instability: float) -> np.ndarray:
    """Noise of the one-sided spectrum B^2 / (pi f), down to a quarter of one over its length (IEEE 952, C.1.3)."""
    length = 1 << int(np.ceil(np.log2(4 * n)))
    frequency = np.fft.rfftfreq(length, 1 / RATE)
    frequency[0] = np.inf
    drawn = np.fft.rfft(rng.standard_normal(length)) * np.sqrt(RATE / 2)
    return np.fft.irfft(drawn * bias_instability / np.sqrt(np.pi * frequency), length)[:n]


def walk(rng: np.random.Generator, n: int, size: float) -> np.ndarray:
    return np.cumsum(rng.standard_normal(n)) * size / np.sqrt(RATE)


def markov(rng: np.random.Generator, n: int, sd: float, time_s: float) -> np.ndarray:
    keep = np.exp(-1 / (time_s * RATE))
    drive = rng.standard_normal(n) * sd * np.sqrt(1 - keep**2)
    drive[0] = rng.standard_normal() * sd
    return np.asarray(lfilter([1.0], [1.0, -keep], drive))


NOISES: dict[str, Callable[[np.random.Generator, int], np.ndarray]] = {
    "white": lambda rng, n: white(rng, n, 100e-6),
    "flicker": lambda rng, n: white(rng, n, 40e-6) + flicker(rng, n, 60e-6),
    "walk": lambda rng, n: white(rng, n, 100e-6) + walk(rng, n, 4e-6),
    "white, flicker, walk": lambda rng, n: white(rng, n, 100e-6) + flicker(rng, n, 20e-6) + walk(rng, n, 3e-6),
    "Gauss-Markov": lambda rng, n: white(rng, n, 100e-6) + markov(rng, n, 50e-6, 100.0),
}


def recorded(kind: str, seed: int, schedule: tuple[float, float] = SCHEDULES[0]) -> tuple[PositionSet, np.ndarray]:
    """The means of one null recording with what `reduce` says of their noise, and the true readings."""
    rng = np.random.default_rng([seed, *map(ord, kind)])
    dwell, step = round(schedule[0] * RATE), round(sum(schedule) * RATE)
    setup = blind.random_setup(rng, 3, 8)
    readings = blind.readings(setup, setup.nominal, {})
    noise = np.stack([NOISES[kind](rng, step * POSITIONS) for _ in range(3)], axis=1)
    dwells = [noise[k * step : k * step + dwell] + readings[k] for k in range(POSITIONS)]
    middle_s = np.arange(POSITIONS) * step / RATE + schedule[0] / 2
    model = RecordedNoise.of(dwells, RATE, float(np.ptp(middle_s)), str(seed))
    return PositionSet(
        tuple(setup.names),
        np.degrees(setup.alpha),
        np.degrees(setup.beta),
        np.array([own.mean(axis=0) for own in dwells]),
        sd=sd_of_means(model, dwells, middle_s),
        time_s=middle_s,
        n=np.full(POSITIONS, float(dwell)),
        comments={NOISE_MODEL: model.text()},
        recorded_noise=(model.text(),) * POSITIONS,
        source=f"{kind} {seed}",
    ), readings


def honesty(data: PositionSet, readings: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """By axis: mean square of neighbours' differences over two, mean stated variance, chi-squared per degree of freedom."""
    assert data.sd is not None
    errors = data.readings - readings
    covariance = recorded_covariance(data)
    assert covariance is not None
    beside = np.linalg.qr(np.eye(len(data)) - 1.0 / len(data))[0].T[:-1]
    rows = beside @ errors
    chi2 = [row @ np.linalg.solve(beside @ own @ beside.T, row) for row, own in zip(rows.T, covariance, strict=True)]
    return np.mean(np.diff(errors, axis=0) ** 2, axis=0) / 2, np.mean(data.sd**2, axis=0), np.array(chi2) / len(rows)


_diagnoser = None


def one_recording(
    kind: str, schedule: tuple[float, float], diagnosed: bool, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str], str, float]:
    """Honesty of one recording, what is found in it, how the slow noise counts, and chi2 p-value of the exact fit."""
    global _diagnoser
    data, readings = recorded(kind, seed, schedule)
    if not diagnosed:
        return *honesty(data, readings), [], "", 1.0
    from tumblecal.cli.start import start

    start()
    from tumblecal.diagnosis.diagnose import Diagnoser
    from tumblecal.estimation import exact
    from tumblecal.estimation.position_problem import problem_of

    with tempfile.TemporaryDirectory() as folder:
        write_positions(Path(folder) / "positions.csv", data)
        read = read_positions(Path(folder) / "positions.csv")
    _diagnoser = _diagnoser or Diagnoser(nested=False)
    diagnosis = _diagnoser(read)
    fitted = exact.fit(problem_of(read))
    lasts = diagnosis.samples.lasts if diagnosis.samples else ""
    return *honesty(data, readings), list(diagnosis.labels), lasts, fitted.chi2_p_value or 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, default=60, help="of each noise and schedule")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="seed of the first recording")
    parser.add_argument("--no-diagnosis", action="store_true")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.recordings)
    with ProcessPoolExecutor(given.processes, get_context("spawn")) as pool:
        for schedule in SCHEDULES:
            for kind in NOISES:
                done = list(pool.map(partial(one_recording, kind, schedule, not given.no_diagnosis), seeds))
                scatter, stated, chi2 = (np.array([file[k] for file in done]) for k in range(3))
                causes = [[label for label in file[3] if not label.startswith("noise_")] for file in done]
                noises = [label for file in done for label in file[3] if label.startswith("noise_")]
                small = np.mean([file[5] < 0.01 for file in done])
                lasts = {name: sum(file[4] == name for file in done) for name in {file[4] for file in done}}
                print(
                    f"{schedule[0]:g} s  {kind:20s}  scatter/stated {np.sqrt(scatter.mean() / stated.mean()):.2f}  "
                    f"chi2/dof {chi2.mean():.2f}  fit p<0.01 {small:.2f}  causes {sum(map(bool, causes))} of {len(done)}  "
                    f"{[c for c in causes if c]} noise found {noises} {lasts}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
