"""Small valid files of the kinds that tumblecal itself writes, or that people write for it."""

import re
from pathlib import Path

import numpy as np

import damaged_made as made
from tumblecal.capture.decoding.samples import Settings, blank
from tumblecal.capture.journal import JOURNAL_NAME, PLAN_NAME, RAW_NAME, Journal, sha256_of
from tumblecal.capture.log import LogWriter, RecordKind
from tumblecal.capture.port.recorder import clocks
from tumblecal.capture.protocols import protocol


CONFIGS = Path(__file__).parents[1] / "configs"
# A head as tumblecal diagnose --units writes it.
HEAD = b"""schema = "tumblecal.head/1"
made_of = ["a.csv", "b.csv"]
effects = ["base_levelling"]
parameters = ["base_levelling", "dbeta@0", "dbeta@45", "dbeta@90"]
units = ["mrad", "mrad", "mrad", "mrad"]
values = [1.000000000000e-02, 2.000000000000e-01, 1.000000000000e-01, -1.000000000000e-01]
sd = [1.000000000000e-02, 5.000000000000e-02, 5.000000000000e-02, 5.000000000000e-02]
covariance = [
    [1.000000000000e-04, 0.000000000000e+00, 0.000000000000e+00, 0.000000000000e+00],
    [0.000000000000e+00, 2.500000000000e-03, 0.000000000000e+00, 0.000000000000e+00],
    [0.000000000000e+00, 0.000000000000e+00, 2.500000000000e-03, 0.000000000000e+00],
    [0.000000000000e+00, 0.000000000000e+00, 0.000000000000e+00, 2.500000000000e-03],
]
"""
_PLAN = b"""[port]
url = "imu"
protocol = "stim300"
[site]
gravity_ms2 = 9.80665
[positions]
beta_deg = [0, 45, 90]
alpha_deg = [0, 90]
[dwell]
seconds = 2.0
guard_s = 0.0
"""
_RATE_HZ, _COUNT = 50.0, 100


def byte_log(name: str) -> bytes:
    """A minute of frames of a protocol, as they came from the port."""
    time_s, force, rate = made.motion()
    sent = blank(len(time_s))
    sent.force[:], sent.rate[:], sent.temperature[:] = force / made.G, rate, 25.0
    spoken = protocol(name)
    step = round(spoken.counter.ticks_per_s / _RATE_HZ) if spoken.counter and spoken.counter.ticks_per_s else 1
    sent.counter[:] = step * np.arange(len(sent))
    return spoken.encode(sent, Settings((10.0, 10.0, 10.0), "acceleration", _RATE_HZ))


def capture(folder: Path) -> dict[str, bytes]:
    """The files of a run of six positions."""
    (folder / PLAN_NAME).write_bytes(_PLAN)
    journal, log, begun = Journal(folder), LogWriter(folder / RAW_NAME), clocks()
    digest = sha256_of(folder / PLAN_NAME, 0, len(_PLAN))
    journal.write("session", mount="1", run="1", clocks=begun, plan_sha256=digest)
    told = {"kind": "configuration", "rate_hz": _RATE_HZ, "range_g": [10.0] * 3, "output": "acceleration"}
    device = {"serial_number": "N1", "rate_hz": _RATE_HZ, "protocol": "stim300", "log_position": 0}
    journal.write("device", **device, events=[told], clocks=begun)
    frames = byte_log("stim300")
    size = len(frames) // 6
    for position in range(6):
        start, stop = log.position, log.position
        for part in range(0, size, size // 2):
            at = begun["monotonic_ns"] + int(1e9 * (60 * position + part / size * 2))
            stop = log.append(
                RecordKind.BYTES, frames[position * size + part : position * size + min(part + size // 2, size)], at
            )
        told = {
            "log_start": start,
            "log_stop": stop,
            "sha256": sha256_of(folder / RAW_NAME, start, stop),
            "summary": {},
        }
        journal.write("accepted", position=position, attempt=1, **told)
    journal.close()
    log.close()
    return {name: (folder / name).read_bytes() for name in (PLAN_NAME, JOURNAL_NAME, RAW_NAME)}


def configs() -> dict[str, bytes]:
    """The files that come with the program, which studies name."""
    return {path.name: path.read_bytes() for path in CONFIGS.glob("*.toml")}


def kind_of_study(content: bytes) -> str:
    """Which study a file is of."""
    found = re.search(rb"study\.(coverage|sweep|convergence|linearization|power)/1", content)
    return found[1].decode() if found else "coverage"
