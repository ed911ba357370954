"""A capture's folder, written through the recording's own log and journal: a STIM300's frames of 24 positions."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

import blind_instrument as blind
from tumblecal.capture.decoding.samples import Settings, blank
from tumblecal.capture.journal import PLAN_NAME, RAW_NAME, Journal, sha256_of
from tumblecal.capture.log import LogWriter, RecordKind
from tumblecal.capture.port.recorder import clocks
from tumblecal.capture.protocols.stim300 import encode
from tumblecal.recordings.reduce import reduced
from tumblecal.recordings.reduction import write_reduction


RATE_HZ, DWELL_S, STEP_S = 50.0, 30.0, 60.0
GRAVITY_MS2 = 9.80665
PLAN = f"""
[port]
url = "imu"
protocol = "stim300"
[site]
gravity_ms2 = {GRAVITY_MS2}
[positions]
beta_deg = [0, 45, 90]
alpha_deg = [0, 45, 90, 135, 180, 225, 270, 315]
[dwell]
seconds = {DWELL_S}
guard_s = 0.0
"""


@dataclass(frozen=True)
class Recorded:
    """What was put into the folder: samples (positions, n, 3) in g, and their times in s."""

    folder: Path
    samples: np.ndarray
    times_s: np.ndarray


def write_capture(
    folder: Path, readings: np.ndarray, white_g: float, wander_g: float, wander_s: float, serial: str | None = "N1"
) -> Recorded:
    """Record readings (24, 3) in white noise (sd of a sample) and a wander that goes on through the moves.

    The wander is a Gauss-Markov process of this sd and correlation time, zero at first.
    """
    rng, count = np.random.default_rng(3), round(RATE_HZ * DWELL_S)
    step = round(RATE_HZ * STEP_S)
    keep = np.exp(-1 / (RATE_HZ * wander_s))
    drive = wander_g * np.sqrt(1 - keep**2) * rng.normal(size=(step * len(readings), 3))
    wander = lfilter([1.0], [1.0, -keep], drive, axis=0)
    samples = readings[:, None] + wander.reshape(len(readings), step, 3)[:, :count]
    samples = samples + white_g * rng.normal(size=samples.shape)
    times = STEP_S * np.arange(len(readings))[:, None] + np.arange(count) / RATE_HZ
    folder.mkdir()
    (folder / PLAN_NAME).write_text(PLAN)
    journal, log, begun = Journal(folder), LogWriter(folder / RAW_NAME), clocks()
    settings = Settings((10.0, 10.0, 10.0), "acceleration", RATE_HZ)
    journal.write("session", mount="1", run="1", clocks=begun)
    configuration = {"kind": "configuration", "rate_hz": RATE_HZ, "range_g": [10.0] * 3, "output": "acceleration"}
    journal.write(
        "device",
        serial_number=serial,
        rate_hz=RATE_HZ,
        protocol="stim300",
        events=[configuration],
        clocks=begun,
        log_position=0,
    )
    for position, own in enumerate(samples):
        sent = blank(count)
        sent.force[:], sent.rate[:], sent.counter[:] = (
            own,
            0.0,
            round(2000 / RATE_HZ) * (position * count + np.arange(count)),
        )
        start, frames = log.position, encode(sent, settings)
        size = len(frames) // count
        for first in range(0, count, 50):
            last = min(first + 50, count)
            stamp = begun["monotonic_ns"] + int(1e9 * times[position, last - 1])
            stop = log.append(RecordKind.BYTES, frames[first * size : last * size], stamp)
        journal.write(
            "accepted",
            position=position,
            attempt=1,
            log_start=start,
            log_stop=stop,
            sha256=sha256_of(folder / RAW_NAME, start, stop),
            summary={},
        )
    journal.close()
    log.close()
    return Recorded(folder, samples, times)


def wandering(folder: Path, effects: dict) -> Recorded:
    """A blind instrument with these effects in a wander of 80 ug and 60 s, seven times the white noise of a mean."""
    setup = blind.random_setup(np.random.default_rng(4), 3, 8)
    readings = blind.readings(setup, setup.nominal, effects)
    return write_capture(folder, readings, white_g=3e-4, wander_g=8e-5, wander_s=60.0)


def means_of(recorded: Recorded) -> Path:
    """The position file that `reduce` makes of it."""
    return write_reduction(reduced([recorded.folder]), recorded.folder)[0]
