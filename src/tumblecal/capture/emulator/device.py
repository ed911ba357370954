"""The virtual device on a dividing head in a chamber: its samples, encoded, and a ledger of the true events."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import numpy as np

from tumblecal.capture.decoding.samples import Floats, Samples, Status, blank
from tumblecal.capture.emulator.config import Emulation
from tumblecal.capture.protocols import protocol
from tumblecal.ground.frames import gravity_in_head
from tumblecal.ground.gravity import STANDARD_GRAVITY_MS2
from tumblecal.noise.sampling import SampleStream


# Interval of time, and of temperature, at which the true output at rest is recomputed, for effects that drift.
_REFRESH_S, _REFRESH_DEGC = 5.0, 0.05
_ON_TIME_S, _BLOCK_S, _SHAKING_S = 1.0, 0.1, 0.5
# A smaller lag is none, s.
_LEAST_LAG_S = 1e-9

# Readings in local g at (alpha_deg, beta_deg, time_s, temperature_degc): shape (3,).
TruthFunction = Callable[[float, float, float, float], Floats]


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


def ideal(alpha_deg: float, beta_deg: float, time_s: float, temperature_degc: float) -> Floats:
    """An instrument without errors on a head without errors."""
    return gravity_in_head(np.radians(alpha_deg), np.radians(beta_deg))


class VirtualDevice:
    """A device on a dividing head, turned by hand (it moves for a while, shakes and comes to rest), in a chamber.

    The air of the chamber follows its set point with a limited rate. The die follows the air plus self-heating, and the
    thermometer follows the die, each with a first-order lag: dT/dt = (input - T) / lag.

    **Arguments:**

    - `config`: its description.
    - `truth`: its output at rest; by default that of an ideal instrument.

    `plugged`: whether its bytes reach the other end of the cable. `air_degc`, `die_degc`, `thermometer_degc`: true temperature
    of the air and of the die, and reading of the thermometer; `set_point_degc`: of the chamber.
    """

    def __init__(self, config: Emulation, truth: TruthFunction = ideal):
        self.config, self.rate_hz, self._truth = config, config.instrument.rate_hz, truth
        self.protocol = protocol(config.instrument.protocol)
        settings = self.protocol.settings(config.instrument.range_g if self.protocol.ranges_g else None, self.rate_hz)
        self.settings = replace(settings, temperatures=config.sends_temperatures)
        self.ledger, self.plugged = Ledger(), True
        self.air_degc = self.set_point_degc = config.instrument.temperature_degc
        self.die_degc = self.thermometer_degc = self.air_degc + config.temperature.self_heating_degc
        # Angles before and after the last turn, alpha and beta, its beginning, and the end of the shaking.
        self._before = self._after = np.array([config.head.alpha_deg, config.head.beta_deg])
        self._turn_s, self._shaken_until_s = -np.inf, 0.0
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

    def turn(self, alpha_deg: float, beta_deg: float) -> None:
        """Begin to turn the head to a position."""
        self._before, self._after, self._turn_s = self.angles(), np.array([alpha_deg, beta_deg]), self.time_s
        self._shaken_until_s = self.time_s + self.config.head.turn_s + _SHAKING_S

    def knock(self) -> None:
        """Bump against the table."""
        self._shaken_until_s = max(self._shaken_until_s, self.time_s + _SHAKING_S)

    def angles(self, now_s: float | None = None) -> Floats:
        """Spindle and pitch angle, deg, shape (2,); by default now."""
        part = self._turned(self.time_s if now_s is None else now_s)
        return self._before + (self._after - self._before) * part * part * (3 - 2 * part)

    def set_temperature(self, degc: float) -> None:
        """Request a temperature within the limits of the chamber."""
        self.set_point_degc = float(np.clip(degc, self.config.chamber.lowest_degc, self.config.chamber.highest_degc))

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
        self._warm(n / self.rate_hz)
        knock_g = config.head.knock_g * (times < self._shaken_until_s)[:, None]
        force = self._at_rest(middle) * (config.site.gravity.value_ms2 / STANDARD_GRAVITY_MS2)
        force = force + (self._noise.take(n) + random.normal(size=(n, 3)) * knock_g)
        # The spindle turns about x, the pitch axis follows.
        part, turned = self._turned(middle), np.radians(self.angles(middle)[0])
        alpha, beta = (self._after - self._before) * 6 * part * (1 - part) / config.head.turn_s
        rate = random.normal(size=(n, 3)) * config.noise.gyro_sd_dps
        rate += [alpha, beta * np.cos(turned), -beta * np.sin(turned)]
        temperature = self.thermometer_degc + config.temperature.thermometer_noise_degc * random.normal(size=n)
        overloaded = random.random(n) < config.faults.overloads_per_s / self.rate_hz
        self.ledger.overloads += int(overloaded.sum())
        ticks_per_s = (counter.ticks_per_s if counter else None) or self.rate_hz
        ticked = np.rint((number - self._first) * (ticks_per_s / self.rate_hz)).astype(np.int64)
        samples = blank(n)
        samples.force[:] = np.where(overloaded[:, None], config.instrument.range_g, force)
        samples.rate[:], samples.temperature[:] = rate, temperature
        samples.status[:] = Status.STARTING * (times < self._starting_until_s) + Status.OVERLOAD * overloaded
        samples.counter[:] = ticked % counter.modulus if counter else ticked
        return samples

    def _turned(self, now_s: float) -> float:
        """The part of the duration of the turn that has passed, 0 to 1."""
        return float(np.clip((now_s - self._turn_s) / self.config.head.turn_s, 0, 1))

    def _warm(self, seconds: float) -> None:
        """Let time pass in the chamber, in steps that are short compared with the lags."""
        thermal, air, die = self.config.temperature, self.air_degc, self.die_degc
        lags_s = np.maximum([thermal.die_lag_s, thermal.thermometer_lag_s], _LEAST_LAG_S)
        of_die, of_thermometer = (-np.expm1(-seconds / lags_s)).tolist()
        step = self.config.chamber.ramp_degc_per_min / 60 * seconds
        self.air_degc += float(np.clip(self.set_point_degc - air, -step, step))
        self.die_degc += ((air + self.air_degc) / 2 + thermal.self_heating_degc - die) * of_die
        self.thermometer_degc += ((die + self.die_degc) / 2 - self.thermometer_degc) * of_thermometer

    def _at_rest(self, now_s: float) -> Floats:
        """The true output, recomputed when the head moves, every few seconds, and with the temperature (effects that drift)."""
        # A late emulator makes its samples when they are read: drifts have continued meanwhile.
        alpha, beta = self.angles(now_s).tolist()
        drifted_s, degc = now_s + self.ledger.behind_s, self.die_degc
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
