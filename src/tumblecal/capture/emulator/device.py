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
        lost = self.missing + self.unplugged + self.overrun
        return asdict(self) | {"warning": self.warning(), "lost": lost}

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
    """

    def __init__(self, config: Emulation, truth: TruthFunction = ideal):
        self.config, self._truth = config, truth
        self.rate_hz = config.instrument.rate_hz
        self.protocol = protocol(config.instrument.protocol)
        self.settings = Settings(rate_hz=self.rate_hz, temperatures=config.sends_temperatures)
        if self.protocol.ranges_g:
            self.settings = self.protocol.with_range(self.settings, config.instrument.range_g)
        head = config.head
        self.head = DividingHead(head.alpha_deg, head.beta_deg, head.turn_s, head.knock_g)
        self.climate, self.ledger, self.plugged = Climate(config), Ledger(), True
        self._noise = SampleStream(config.noise.model, 1 / self.rate_hz, config.noise.seed)
        self._random = np.random.default_rng([config.noise.seed, 1])
        self._starting_until_s, self._counter_offset = config.instrument.start_up_s, 0
        self._replies, self._input = list[bytes](), b""
        self._known: tuple[tuple, NDArray] | None = None
        # Compiled before the clock runs, which may take seconds.
        self._at_rest(0.0)

    @property
    def time_s(self) -> float:
        """The device's time, s."""
        return self.ledger.generated / self.rate_hz

    def restart(self) -> None:
        """Power off and on: the counter restarts, and the start-up messages are sent."""
        self.ledger.restarts += 1
        self._counter_offset = self.ledger.generated
        self._starting_until_s = self.time_s + self.config.instrument.start_up_s
        self.command(b"N\rI\rC\r")

    def command(self, data: bytes) -> None:
        """Receive commands; the replies are sent instead of the next samples."""
        instrument = self.config.instrument
        *commands, self._input = (self._input + data).replace(b"\n", b"\r").split(b"\r")
        answers = (self.protocol.answer(command, self.settings, instrument.serial_number) for command in commands)
        self._replies += filter(None, answers) if instrument.answers else []

    def advance(self, n: int) -> bytes:
        """The bytes of the next `n` samples, as they arrive at the other end of the cable."""
        out = b""
        while n > 0:
            block = min(n, max(1, int(_BLOCK_S * self.rate_hz)))
            samples = self.samples(block)
            self.ledger.generated += block
            n -= block
            if self.plugged:
                out += self._sent(samples)
            else:
                self.ledger.unplugged += block
        return out

    def samples(self, n: int) -> Samples:
        """The next `n` samples, as the device measures them."""
        config, random = self.config, self._random
        number = self.ledger.generated + np.arange(n)
        times = number / self.rate_hz
        middle, samples = float(times[n // 2]), blank(n)
        self.climate.advance(n / self.rate_hz)
        samples.force[:] = self._at_rest(middle) * (config.site.gravity.value_ms2 / STANDARD_GRAVITY_MS2)
        samples.force[:] += self._noise.take(n) + self.head.shaking(times, random)
        samples.rate[:] = random.normal(size=(n, 3)) * config.noise.gyro_sd_dps + self.head.rates(middle)
        thermometer_noise = config.temperature.thermometer_noise_degc * random.normal(size=n)
        samples.temperature[:] = self.climate.thermometer_degc + thermometer_noise
        counter = self.protocol.counter
        ticks = counter.ticks_per_s / self.rate_hz if counter is not None and counter.ticks_per_s else 1.0
        ticked = np.rint((number - self._counter_offset) * ticks).astype(np.int64)
        samples.counter[:] = ticked % counter.modulus if counter is not None else ticked
        samples.status[times < self._starting_until_s] |= np.uint8(Status.STARTING)
        overloaded = random.random(n) < config.faults.overloads_per_s / self.rate_hz
        samples.status[overloaded] |= np.uint8(Status.OVERLOAD)
        samples.force[overloaded] = config.instrument.range_g
        self.ledger.overloads += int(overloaded.sum())
        return samples

    def _at_rest(self, now_s: float) -> NDArray[np.float64]:
        """The true output, recomputed when the head moves, every few seconds, and with the temperature (effects that drift)."""
        # A late emulator makes its samples when they are read: drifts have continued meanwhile.
        drifted_s, degc = now_s + self.ledger.behind_s, self.climate.die_degc
        key = (*self.head.angles(now_s), int(drifted_s / _REFRESH_S), round(degc / _REFRESH_DEGC))
        if self._known is None or self._known[0] != key:
            self._known = (key, np.asarray(self._truth(*key[:2], drifted_s, degc), float))
        return self._known[1]

    def _sent(self, samples: Samples) -> bytes:
        """The bytes of samples, of which some are missing and some replaced by replies."""
        ledger = self.ledger
        sent = self._random.random(len(samples)) >= self.config.faults.missing_frames_per_s / self.rate_hz
        ledger.missing += int((~sent).sum())
        samples, replies = samples[sent], self._replies[: int(sent.sum())]
        self._replies = self._replies[len(replies) :]
        ledger.replaced += len(replies)
        ledger.intact += len(samples) - len(replies)
        return b"".join(replies) + self.protocol.encode(samples[len(replies) :], self.settings)
