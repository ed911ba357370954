"""The serial protocols: one module for each. A new module in this folder is found automatically.

Each module defines `PROTOCOL`, a `Protocol`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Protocol as Interface

from tumblecal.capture.decoding.samples import Decoded, Samples, Settings
from tumblecal.ground.errors import InputError


class Decoder(Interface):
    """Decodes bytes to samples; stores unfinished bytes between calls."""

    def feed(self, data: bytes) -> Decoded:
        """Decode what `data` completes."""
        ...

    def finish(self) -> Decoded:
        """Decode the remaining bytes at the end of the stream."""
        ...


@dataclass(frozen=True)
class DeviceCounter:
    """The device's counter, the time base of a capture.

    **Arguments:**

    - `modulus`: it counts 0 .. modulus - 1 and restarts.
    - `ticks_per_s`: nominal speed; None if it counts samples.
    """

    modulus: int
    ticks_per_s: float | None

    def step(self, rate_hz: float | None) -> int | None:
        """Ticks from one sample to the next at a rate; None if they are not known."""
        return max(1, round(self.ticks_per_s / rate_hz)) if self.ticks_per_s and rate_hz else None


@dataclass(frozen=True)
class Protocol:
    """A serial protocol.

    **Arguments:**

    - `name`: name on the command line. `title`: name in messages.
    - `decoder`: makes a decoder; by default without settings: then the stream states them, or none are needed.
    - `encode`: samples to bytes, as a device with these settings sends them.
    - `bauds`: usual speeds, the most likely first.
    - `counter`: the device's counter, or None: then losses are only visible in time.
    - `queries`: commands that make the device state its identity and settings.
    - `ranges_g`: possible full scales; empty if the output is scaled already.
    - `range_from_stream`: the stream states the range on request, so it must not be assumed.
    - `checked`: whether frames have a checksum.
    - `answer`: the device's reply to a command.
    - `columns`: whether columns and unit may be stated.
    """

    name: str
    title: str
    decoder: Callable[..., Decoder]
    encode: Callable[[Samples, Settings], bytes]
    bauds: tuple[int, ...]
    counter: DeviceCounter | None = None
    queries: tuple[bytes, ...] = ()
    ranges_g: tuple[float, ...] = ()
    range_from_stream: bool = False
    checked: bool = True
    answer: Callable[[bytes, Settings, str], bytes] = lambda command, settings, serial: b""
    columns: bool = False

    def settings(self, range_g: float | None, rate_hz: float | None, columns: str = "", unit: str = "") -> Settings:
        """The settings of a device that states none itself."""
        ranges_g = None if range_g is None else (float(range_g), float(range_g), float(range_g))
        return Settings(ranges_g, rate_hz=rate_hz, columns=columns, unit=unit)

    def check_range(self, range_g: float, named: str) -> None:
        """Raise for a full scale that such devices do not have; `named` begins the fault.

        **Raises:** `InputError` with the possible ones.
        """
        if self.ranges_g and range_g not in self.ranges_g:
            raise InputError(f"{named}: the {self.title} has {', '.join(f'{r:g}' for r in self.ranges_g)}")


@cache
def protocols() -> dict[str, Protocol]:
    """All protocols by name, found among the files of this folder."""
    found = (import_module(f"{__name__}.{module.name}") for module in iter_modules(__path__))
    return {p.PROTOCOL.name: p.PROTOCOL for p in found if hasattr(p, "PROTOCOL")}


def protocol(name: str) -> Protocol:
    """The protocol of that name.

    **Raises:** `InputError` with all names for an unknown one.
    """
    try:
        return protocols()[name]
    except KeyError:
        raise InputError(
            f"protocol {name!r}: not known; there are {', '.join(sorted(protocols()))} "
            "(`tumblecal sniff PORT` guesses which one a device speaks)"
        ) from None
