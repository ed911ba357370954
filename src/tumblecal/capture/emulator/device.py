"""The virtual device: samples at the device's clock, encoded, with a ledger of the true events."""

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.samples import Samples, Settings, Status, blank
from tumblecal.capture.emulator.climate import Climate
from tumblecal.capture.emulator.config import Emulation
from tumblecal.capture.emulator.head import DividingHead
from tumblecal.capture.protocols import protocol
from tumblecal.ground.frames import gravity_in_head
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2
from tumblecal.noise.sampling import SampleStream


# Interval of time, and of temperature, at which the true output at rest is recomputed, for effects that drift.
_REFRESH_S, _REFRESH_DEGC = 5.0, 0.05
_ON_TIME_S, _BLOCK_S = 1.0, 0.1

# Readings in local g at (alpha_deg, beta_deg, time_s, temperature_degc): shape (3,).
TruthFunction = Callable[[float, float, float, float], NDArray[np.float64]]


@dataclass
class Ledger:
    """The true events of the device's samples, by number.

    `behind_s`: present delay, `longest_behind_s`: largest delay, in the device's time, if a busy computer prevents samples in
    time.
    """

    generated: int = 0
    intact: int = 0
    missing: int = 0
    unplugged: int = 0
    overrun: int = 0
    replaced: int = 0
    restarts: int = 0
    stalls: int = 0
    overloads: int = 0
    behind_s: float = 0.0
    longest_behind_s: float = 0.0

    def as_dict(self) -> dict[str, float | str]:
        """The ledger as keys and values of a file; `lost`: samples that cannot arrive, except those replaced by replies."""
        return asdict(self) | {"warning": self.warning(), "lost": self.missing + self.unplugged + self.overrun}

    def warning(self) -> str:
        """The effect of a late emulator on the data; empty if it was in time."""
        if self.longest_behind_s <= _ON_TIME_S:
            return ""
        return (
            f"fell behind by up to {self.longest_behind_s:.1f} s of the device's time: samples came late, and noise that "
            "wanders is out of step with the clock by that much (drifts are not); take a lower --speed"
        )


def ideal(alpha_deg: float, beta_deg: float, time_s: float, temperature_degc: float) -> NDArray[np.float64]:
    """An instrument without errors on a head without errors."""
    return gravity_in_head(np.radians(alpha_deg), np.radians(beta_deg))


class VirtualDevice:
    """A device on a dividing head.

    **Arguments:**

    - `config`: its description.
    - `truth`: its output at rest; by default that of an ideal instrument.

    `plugged`: whether its bytes reach the other end of the cable.
    """

    def __init__(self, config: Emulation, truth: TruthFunction = ideal):
        self.config, self.rate_hz, self._truth = config, config.instrument.rate_hz, truth
        self.protocol = protocol(config.instrument.protocol)
        range_g = (config.instrument.range_g,) * 3 if self.protocol.ranges_g else None
        self.settings = Settings(range_g, rate_hz=self.rate_hz, temperatures=config.sends_temperatures)
        self.head, self.climate, self.ledger, self.plugged = DividingHead(config.head), Climate(config), Ledger(), True
        self._noise = SampleStream(config.noise.model, 1 / self.rate_hz, config.noise.seed)
        self._random = np.random.default_rng([config.noise.seed, 1])
        self._starting_until_s, self._first = config.instrument.start_up_s, 0
        self._replies, self._commands, self._key = list[bytes](), b"", ()
        # Compiled before the clock runs, which may take seconds.
        self._at_rest(0.0)

    @property
    def time_s(self) -> float:
        """The device's time, s."""
        return self.ledger.generated / self.rate_hz

    def restart(self) -> None:
        """Power off and on: the counter restarts, and the start-up messages are sent."""
        self.ledger.restarts += 1
        self._first = self.ledger.generated
        self._starting_until_s = self.time_s + self.config.instrument.start_up_s
        self.command(b"N\rI\rC\r")

    def command(self, data: bytes) -> None:
        """Receive commands; the replies are sent instead of the next samples."""
        instrument = self.config.instrument
        *commands, self._commands = (self._commands + data).replace(b"\n", b"\r").split(b"\r")
        answers = (self.protocol.answer(command, self.settings, instrument.serial_number) for command in commands)
        self._replies += filter(None, answers) if instrument.answers else []

    def advance(self, n: int) -> bytes:
        """The bytes of the next `n` samples, as they arrive at the other end of the cable."""
        out, size = b"", max(1, int(_BLOCK_S * self.rate_hz))
        for start in range(0, n, size):
            samples = self.samples(min(size, n - start))
            self.ledger.generated += len(samples)
            out += self._sent(samples)
        return out

    def samples(self, n: int) -> Samples:
        """The next `n` samples, as the device measures them."""
        config, random, counter = self.config, self._random, self.protocol.counter
        number = self.ledger.generated + np.arange(n)
        times = number / self.rate_hz
        middle = float(times[n // 2])
        self.climate.advance(n / self.rate_hz)
        force = self._at_rest(middle) * (config.site.gravity.value_ms2 / STANDARD_GRAVITY_MS2)
        force = force + (self._noise.take(n) + self.head.shaking(times, random))
        rate = random.normal(size=(n, 3)) * config.noise.gyro_sd_dps + self.head.rates(middle)
        temperature = self.climate.thermometer_degc + config.temperature.thermometer_noise_degc * random.normal(size=n)
        overloaded = random.random(n) < config.faults.overloads_per_s / self.rate_hz
        self.ledger.overloads += int(overloaded.sum())
        ticks_per_s = (counter.ticks_per_s if counter else None) or self.rate_hz
        ticked = np.rint((number - self._first) * (ticks_per_s / self.rate_hz)).astype(np.int64)
        status = Status.STARTING * (times < self._starting_until_s) + Status.OVERLOAD * overloaded
        samples = blank(n)
        samples.force[:] = np.where(overloaded[:, None], config.instrument.range_g, force)
        samples.rate[:], samples.temperature[:], samples.status[:] = rate, temperature, status
        samples.counter[:] = ticked % counter.modulus if counter else ticked
        return samples

    def _at_rest(self, now_s: float) -> NDArray[np.float64]:
        """The true output, recomputed when the head moves, every few seconds, and with the temperature (effects that drift)."""
        # A late emulator makes its samples when they are read: drifts have continued meanwhile.
        alpha, beta = self.head.angles(now_s).tolist()
        drifted_s, degc = now_s + self.ledger.behind_s, self.climate.die_degc
        key = alpha, beta, int(drifted_s / _REFRESH_S), round(degc / _REFRESH_DEGC)
        if key != self._key:
            self._key, self._known = key, np.asarray(self._truth(alpha, beta, drifted_s, degc), float)
        return self._known

    def _sent(self, samples: Samples) -> bytes:
        """The bytes of samples, of which some are missing and some replaced by replies."""
        ledger, count = self.ledger, len(samples)
        if not self.plugged:
            ledger.unplugged += count
            return b""
        samples = samples[self._random.random(count) >= self.config.faults.missing_frames_per_s / self.rate_hz]
        ledger.missing += count - len(samples)
        replies, self._replies = self._replies[: len(samples)], self._replies[len(samples) :]
        samples = samples[len(replies) :]
        ledger.replaced += len(replies)
        ledger.intact += len(samples)
        return b"".join(replies) + (self.protocol.encode(samples, self.settings) if len(samples) else b"")
