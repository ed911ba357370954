"""The sample rate of a device that does not state it: with a backlog when the port opens, and a rate that changes."""

import os
import pty
import threading
import time
import tty
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from tumblecal.capture.capture_plan import CapturePlan
from tumblecal.capture.decoding.losses import losses_from_time, losses_of
from tumblecal.capture.decoding.samples import Settings
from tumblecal.capture.journal import Journal
from tumblecal.capture.port.live import LiveStream, Recording
from tumblecal.capture.protocols import protocol
from tumblecal.capture.run.contact import Contact
from tumblecal.capture.run.run_folder import RunFolder


class Board:
    """A board on a pseudo-terminal that prints lines at 100 Hz; the first `backlog_s` of them at once."""

    def __init__(self, backlog_s: float):
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        self.port, self._sent, self._ended = os.ttyname(slave), 0, threading.Event()
        self._begin = time.monotonic() - backlog_s
        self._writer = threading.Thread(target=self._write, daemon=True)
        self._writer.start()

    def _write(self) -> None:
        while not self._ended.wait(0.02):
            for number in range(self._sent, int(100 * (time.monotonic() - self._begin))):
                micros, self._sent = number * 10_000, number + 1
                os.write(self._master, f"{number},{micros},{0.001 * (number % 3):.4f},0.0000,1.0000\n".encode())

    def close(self) -> None:
        self._ended.set()
        self._writer.join()


def test_a_backlog_does_not_change_the_rate(tmp_path: Path) -> None:
    board = Board(6.0)
    content = {"url": board.port, "protocol": "text", "columns": "counter,-,ax,ay,az", "unit": "g"}
    plan = CapturePlan.model_validate(
        {"port": content, "positions": {"listed": [{"alpha_deg": 0, "beta_deg": 0}]}, "dwell": {"seconds": 5}}
    )
    recording = Recording(tmp_path / "raw.log", board.port, 115200)
    how = protocol("text")
    stream = LiveStream(recording, how, Settings(columns=plan.port.columns, unit=plan.port.unit))
    try:
        with closing(Journal(tmp_path)) as journal:
            (contact := Contact(RunFolder(tmp_path, plan, journal), stream)).meet()
            assert contact.rate_hz == pytest.approx(100, rel=0.03)
    finally:
        recording.stop()
        board.close()


def stamps(times: np.ndarray, seed: int = 1) -> np.ndarray:
    """Stamps of the reads every 20 ms, with delays up to 20 ms."""
    late = np.ceil(times / 0.02) * 0.02
    return np.maximum.accumulate(late + np.random.default_rng(seed).uniform(0, 0.02) + 1e-6)


def test_a_rate_that_differs_from_the_stated_one_is_a_warning_and_an_equal_one_is_not() -> None:
    for seed in range(20):
        rates = losses_from_time(stamps(np.arange(1000) / 100, seed))
        assert rates.rate_words(100.0) == ""
        assert "samples a second, but 303 are expected: baud rate too low?" in rates.rate_words(303.0)
        assert float(rates.rate_words(303.0).split()[3]) == pytest.approx(100, rel=0.005)
        assert "but 50 are expected" in rates.rate_words(50.0) and "baud" not in rates.rate_words(50.0)
    assert losses_from_time(np.array([0.1])).rate_words(100.0) == ""


@pytest.mark.parametrize("unit", [1.0, 1e3, 1e6])
@pytest.mark.parametrize("counter", [True, False])
def test_the_clock_of_the_device_decides_where_there_is_one(unit: float, counter: bool) -> None:
    """100.7 Hz by the device's clock, with host stamps that fall 2 % behind within the dwell."""
    time_s = np.arange(600) / 100.7
    columns = "counter,time,ax,ay,az" if counter else "-,time,ax,ay,az"
    how = protocol("text")
    decoder = how.decoder(Settings(columns=columns, unit="g", whole=True))
    lines = [f"{k},{4.5e6 + t * unit:.7f},0.0,0.0,1.0\n" for k, t in enumerate(time_s) if not (counter and k % 50 == 7)]
    samples = decoder.feed("".join(lines).encode()).samples
    kept = np.array([k for k in range(600) if not (counter and k % 50 == 7)])
    losses = losses_of(how, samples, stamps(1.02 * time_s[kept]), None, range(len(samples)), [])
    assert losses.rate_hz == pytest.approx(100.7, rel=1e-4)
    assert losses.lost == (12 if counter else 0)
    samples.clock[:] *= 37
    by_host = losses_of(how, samples, stamps(1.02 * time_s[kept]), None, range(588), [])
    assert by_host.rate_hz == pytest.approx(100.7 / 1.02, rel=0.01)
