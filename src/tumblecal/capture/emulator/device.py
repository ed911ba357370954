"""The virtual device: samples at the device's clock, encoded, damaged on request, with a ledger of the true events."""

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from tumblecal.capture.decoding.samples import Samples, Settings, Status, blank
from tumblecal.capture.emulator.climate import ThermalErrors, VirtualChamber
from tumblecal.capture.emulator.config import Emulation
from tumblecal.capture.emulator.head import DividingHead
from tumblecal.capture.protocols import protocol
from tumblecal.ground.frames import gravity_in_head
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2
from tumblecal.noise.sampling import SampleStream


# Interval of time, and of temperature, at which the true output at rest is recomputed, for effects that drift.
_REFRESH_S, _REFRESH_DEGC = 5.0, 0.05
_ON_TIME_S = 1.0

# Readings in local g at (alpha_deg, beta_deg, time_s, temperature_degc): shape (3,).
TruthFunction = Callable[[float, float, float, float], NDArray[np.float64]]

# Angular rates in deg/s, shape (n, 3), of the samples with these numbers, shape (n,).
RateFunction = Callable[[NDArray[np.int64]], NDArray[np.float64]]


@dataclass
class Ledger:
    """The true events of the device's samples, by number.

    `latest_ms`: largest delay of the emulator, by the host's clock. `behind_s`: present delay, `longest_behind_s`: largest
    delay, in the device's time, if a busy computer prevents samples in time.
    """

    generated: int = 0
    intact: int = 0
    damaged: int = 0
    missing: int = 0
    exchanged: int = 0
    repeated: int = 0
    unplugged: int = 0
    overrun: int = 0
    replaced: int = 0
    restarts: int = 0
    stalls: int = 0
    overloads: int = 0
    latest_ms: float = 0.0
    behind_s: float = 0.0
    longest_behind_s: float = 0.0

    def as_dict(self) -> dict[str, float | str]:
        """The ledger as keys and values of a file."""
        return asdict(self) | {"warning": self.warning()}

    def warning(self) -> str:
        """The effect of a late emulator on the data; empty if it was in time."""
        if self.longest_behind_s <= _ON_TIME_S:
            return ""
        return (
            f"fell behind by up to {self.longest_behind_s:.1f} s of the device's time: samples came late, and noise that "
            "wanders is out of step with the clock by that much (drifts are not); take a lower --speed"
        )

    def lost(self) -> int:
        """Samples that the device made, except those replaced by replies, that cannot arrive."""
        return self.damaged + self.missing + self.unplugged + self.overrun


def ideal(alpha_deg: float, beta_deg: float, time_s: float, temperature_degc: float) -> NDArray[np.float64]:
    """An instrument without errors on a head without errors."""
    return gravity_in_head(np.radians(alpha_deg), np.radians(beta_deg))


class VirtualDevice:
    """A device on a dividing head.

    **Arguments:**

    - `config`: its description.
    - `truth`: its output at rest; by default that of an ideal instrument.
    - `rates`: angular rates in deg/s of the samples with these numbers; by default noise.
    """

    config: Emulation
    settings: Settings
    head: DividingHead
    chamber: VirtualChamber
    ledger: Ledger

    def __init__(self, config: Emulation, truth: TruthFunction = ideal, rates: RateFunction | None = None):
        self.config, self._truth, self._rates = config, truth, rates
        self.protocol = protocol(config.instrument.protocol)
        settings = Settings(rate_hz=config.instrument.rate_hz, temperatures=config.sends_temperatures)
        ranges = self.protocol.ranges_g
        self.settings = self.protocol.with_range(settings, config.instrument.range_g) if ranges else settings
        head = config.head
        self.head = DividingHead(head.alpha_deg, head.beta_deg, head.turn_s, head.knock_g)
        self.chamber = VirtualChamber(config)
        self._thermal = ThermalErrors(config, self.chamber.die_degc)
        self.ledger = Ledger()
        self._noise = SampleStream(config.noise.model, 1 / config.instrument.rate_hz, config.noise.seed)
        self._random = np.random.default_rng([config.noise.seed, 1])
        self._site_gravity = config.site.gravity.value_ms2 / STANDARD_GRAVITY_MS2
        self.plugged = True
        self._starting_until_s = config.instrument.start_up_s
        self._counter_offset = 0
        self._replies: list[bytes] = []
        self._input, self._missed = b"", 0
        self._known: tuple[tuple, NDArray] | None = None
        # Compiled before the clock runs, which may take seconds.
        self._at_rest(0.0, self.chamber.die_degc)

    @property
    def time_s(self) -> float:
        """The device's time, s."""
        return self.ledger.generated / self.config.instrument.rate_hz

    def restart(self) -> None:
        """Power off and on: the counter restarts, and the start-up messages are sent."""
        self.ledger.restarts += 1
        self._counter_offset = self.ledger.generated
        self._starting_until_s = self.time_s + self.config.instrument.start_up_s
        self.command(b"N\rI\rC\r")

    def command(self, data: bytes) -> None:
        """Receive commands; the replies are sent instead of the next samples."""
        *commands, self._input = (self._input + data).replace(b"\n", b"\r").split(b"\r")
        for command in commands:
            if not self.config.instrument.answers:
                continue
            self._missed += 1
            if self._missed <= self.config.instrument.answers_after:
                continue
            reply = self.protocol.answer(command, self.settings, self.config.instrument.serial_number)
            if reply:
                self._replies.append(reply)

    def advance(self, n: int) -> bytes:
        """The bytes of the next `n` samples, as they arrive at the other end of the cable."""
        out = b""
        while n > 0:
            block = min(n, max(1, int(0.1 * self.config.instrument.rate_hz)))
            samples = self._samples(block)
            self.ledger.generated += block
            n -= block
            if not self.plugged:
                self.ledger.unplugged += block
                continue
            out += self._sent(samples)
        return out

    def _samples(self, n: int) -> Samples:
        rate = self.config.instrument.rate_hz
        number = self.ledger.generated + np.arange(n)
        times = number / rate
        middle = float(times[n // 2])
        samples = blank(n)
        self.chamber.advance(n / rate)
        # A late emulator makes its samples when they are read: drifts have continued meanwhile.
        resting = self._at_rest(middle, self.chamber.die_degc, self.ledger.behind_s)
        resting = self._thermal.applied(resting, self.chamber.die_degc)
        samples.force[:] = resting * self._site_gravity
        samples.force[:] += self._noise.take(n) + self.head.shaking(times, self._random)
        if self._rates is not None:
            samples.rate[:] = self._rates(number)
        else:
            samples.rate[:] = self._random.normal(size=(n, 3)) * self.config.noise.gyro_sd_dps
            samples.rate[:] += self.head.rates(middle)
        samples.temperature[:] = self.chamber.thermometer_degc
        if noise := self.config.temperature.thermometer_noise_degc:
            samples.temperature[:] += noise * self._random.normal(size=n)
        counter = self.protocol.counter
        since = number - self._counter_offset
        ticks = counter.ticks_per_s / rate if counter is not None and counter.ticks_per_s else 1.0
        samples.counter[:] = np.rint(since * ticks).astype(np.int64) % (counter.modulus if counter else 2**62)
        samples.status[times < self._starting_until_s] |= np.uint8(Status.STARTING)
        overloaded = self._random.random(n) < self.config.faults.overloads_per_s / rate
        samples.status[overloaded] |= np.uint8(Status.OVERLOAD)
        samples.force[overloaded] = self.config.instrument.range_g
        self.ledger.overloads += int(overloaded.sum())
        return samples

    def _at_rest(self, now_s: float, temperature: float, behind_s: float = 0.0) -> NDArray[np.float64]:
        """The true output, recomputed when the head moves, every few seconds, and with the temperature (effects that drift)."""
        drifted_s = now_s + behind_s
        key = (*self.head.angles(now_s), int(drifted_s / _REFRESH_S), round(temperature / _REFRESH_DEGC))
        if self._known is None or self._known[0] != key:
            self._known = (key, np.asarray(self._truth(*key[:2], drifted_s, temperature), float))
        return self._known[1]

    def _sent(self, samples: Samples) -> bytes:
        faults, rate = self.config.faults, self.config.instrument.rate_hz
        n, random = len(samples), self._random
        missing = random.random(n) < faults.missing_frames_per_s / rate
        self.ledger.missing += int(missing.sum())
        replies: dict[int, bytes] = {}
        for place in np.flatnonzero(~missing)[: len(self._replies)].tolist():
            replies[place] = self._replies.pop(0)
            self.ledger.replaced += 1
        flips = random.random(n) < faults.bit_flips_per_s / rate
        cuts = random.random(n) < faults.lost_bytes_per_s / rate
        garbage = random.random(n) < faults.garbage_per_s / rate
        exchanged = random.random(n) < faults.exchanged_frames_per_s / rate
        exchanged[-1:] = False
        exchanged[1:] &= ~exchanged[:-1]
        repeated = random.random(n) < faults.repeated_frames_per_s / rate
        odd = missing | flips | cuts | garbage | exchanged | repeated
        if not (odd.any() or replies):
            self.ledger.intact += n
            return self.protocol.encode(samples, self.settings)
        touched = set(np.flatnonzero(odd).tolist()) | set(replies)
        frames = self._frames(samples)
        for k in np.flatnonzero(exchanged).tolist():
            frames[k], frames[k + 1] = frames[k + 1], frames[k]
        self.ledger.exchanged += int(exchanged.sum())
        out = bytearray()
        for k in range(n):
            if k not in touched:
                out += frames[k]
                self.ledger.intact += 1
                continue
            if garbage[k]:
                out += random.integers(0, 256, int(random.integers(1, 60)), dtype=np.uint8).tobytes()
            if missing[k]:
                continue
            if k in replies:
                out += replies[k]
                continue
            frame = bytearray(frames[k])
            if flips[k]:
                frame[int(random.integers(len(frame)))] ^= 1 << int(random.integers(8))
            if cuts[k]:
                del frame[int(random.integers(len(frame)))]
            self.ledger.damaged += bool(flips[k] or cuts[k])
            self.ledger.intact += not (flips[k] or cuts[k])
            out += frame
            if repeated[k] and not (flips[k] or cuts[k]):
                self.ledger.repeated += 1
                out += frame
        return bytes(out)

    def _frames(self, samples: Samples) -> list[bytes]:
        """The bytes of each sample; encoded together if all are equally long."""
        data, n = self.protocol.encode(samples, self.settings), len(samples)
        first = self.protocol.encode(samples[:1], self.settings)
        if len(first) * n == len(data):
            return [data[k : k + len(first)] for k in range(0, len(data), len(first))]
        return [self.protocol.encode(samples[k : k + 1], self.settings) for k in range(n)]
