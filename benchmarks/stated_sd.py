"""Is the noise that `reduce` states correct, and does `diagnose` report nothing where the noise alone is coloured?

    python benchmarks/stated_sd.py --recordings 60 --processes 2

Recordings of 24 dwells in plain numpy (1/f by its spectrum), in five noises. Each is reduced as `tumblecal reduce` does and
written to positions.csv. Printed for each noise: dispersion of neighbouring means over the stated standard deviation,
chi-squared per degree of freedom under the stated covariance, and recordings in which `diagnose` finds a cause.
"""

import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

import blind_instrument as blind
from blind_noise import position_set
from command_line import asked, print_head, print_row
from tumblecal.data import PositionSet, read_positions
from tumblecal.data.files import write_positions
from tumblecal.data.position_comments import NOISE_MODEL
from tumblecal.noise.dwell_sd import sd_of_means
from tumblecal.noise.recorded import RecordedNoise, recorded_covariance


RATE, POSITIONS = 50.0, 24
# Length of a dwell and of the move after it, s.
SCHEDULES = ((60.0, 20.0), (20.0, 10.0))
WHITE_G_PER_RTHZ = 100e-6


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
    "white": lambda rng, n: white(rng, n, WHITE_G_PER_RTHZ),
    "flicker": lambda rng, n: white(rng, n, 40e-6) + flicker(rng, n, 60e-6),
    "walk": lambda rng, n: white(rng, n, 100e-6) + walk(rng, n, 4e-6),
    "white, flicker, walk": lambda rng, n: white(rng, n, 100e-6) + flicker(rng, n, 20e-6) + walk(rng, n, 3e-6),
    "Gauss-Markov": lambda rng, n: white(rng, n, 100e-6) + markov(rng, n, 50e-6, 100.0),
}


def recorded(kind: str, seed: int, schedule: tuple[float, float] = SCHEDULES[0]) -> tuple[PositionSet, np.ndarray]:
    """The means of one recording without errors, with the noise that `reduce` states, and the true readings."""
    rng = np.random.default_rng([seed, *map(ord, kind)])
    dwell, step = round(schedule[0] * RATE), round(sum(schedule) * RATE)
    setup = blind.random_setup(rng, 3, 8)
    readings = blind.readings(setup, setup.nominal, {})
    noise = np.stack([NOISES[kind](rng, step * POSITIONS) for _ in range(3)], axis=1)
    dwells = [noise[k * step : k * step + dwell] + readings[k] for k in range(POSITIONS)]
    middle_s = np.arange(POSITIONS) * step / RATE + schedule[0] / 2
    model = RecordedNoise.of(dwells, RATE, float(np.ptp(middle_s)), str(seed))
    means = position_set(setup, np.array([own.mean(axis=0) for own in dwells]), known=False, columns=False)
    return replace(
        means,
        sd=sd_of_means(model, dwells, middle_s),
        time_s=middle_s,
        n=np.full(POSITIONS, float(dwell)),
        comments={NOISE_MODEL: model.text()},
        recorded_noise=(model.text(),) * POSITIONS,
        source=f"{kind} {seed}",
    ), readings


def honesty(data: PositionSet, readings: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """By axis: mean square of neighbours' differences over two, mean stated variance, chi-squared per degree of freedom."""
    errors, covariance = data.readings - readings, recorded_covariance(data)
    assert data.sd is not None and covariance is not None
    centred = np.linalg.qr(np.eye(len(data)) - 1.0 / len(data))[0].T[:-1]
    rows = centred @ errors
    chi2 = [row @ np.linalg.solve(centred @ own @ centred.T, row) for row, own in zip(rows.T, covariance, strict=True)]
    return np.mean(np.diff(errors, axis=0) ** 2, axis=0) / 2, np.mean(data.sd**2, axis=0), np.array(chi2) / len(rows)


@cache
def _diagnoser():
    from tumblecal.cli.start import start

    start()
    from tumblecal.diagnosis.diagnose import Diagnoser

    return Diagnoser(nested=False)


def one_recording(kind: str, schedule: tuple[float, float], seed: int) -> tuple[np.ndarray, list[str]]:
    """Honesty of one recording (3, axes), and the named causes."""
    data, readings = recorded(kind, seed, schedule)
    with tempfile.TemporaryDirectory() as folder:
        write_positions(Path(folder) / "positions.csv", data)
        diagnosis = _diagnoser()(read_positions(Path(folder) / "positions.csv"))
    return np.array(honesty(data, readings)), list(diagnosis.labels)


def main() -> None:
    """A row for each length of dwell and each noise."""
    given = asked(__doc__, recordings=60, processes=1)
    print_head("dwell / s", "noise", "dispersion / stated", "chi2 / dof", "a cause found", "a noise found")
    with ProcessPoolExecutor(given.processes, get_context("spawn")) as pool:
        for schedule in SCHEDULES:
            for kind in NOISES:
                done = list(pool.map(partial(one_recording, kind, schedule), range(given.recordings)))
                dispersion, stated, chi2 = np.mean([own for own, _ in done], axis=(0, 2))
                noises = sum(any(label.startswith("noise_") for label in labels) for _, labels in done)
                causes = sum(any(not label.startswith("noise_") for label in labels) for _, labels in done)
                found = (f"{own} of {len(done)}" for own in (causes, noises))
                print_row(f"{schedule[0]:g}", kind, f"{np.sqrt(dispersion / stated):.2f}", f"{chi2:.2f}", *found)


if __name__ == "__main__":
    main()
