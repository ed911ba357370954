"""The serial protocols, one file each; a file put beside these is found, nothing else changes.

Each file defines `PROTOCOL`, a `Protocol`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Any
from typing import Protocol as Interface

from tumblecal.capture.samples import Decoded, Samples, Settings
from tumblecal.ground.errors import InputError


class Decoder(Interface):
    """Bytes in, samples out; keeps what is unfinished between calls."""

    def feed(self, data: bytes) -> Decoded:
        """Decode what `data` completes."""
        ...

    def finish(self) -> Decoded:
        """Decode what is left at the end of the stream."""
        ...


@dataclass(frozen=True)
class DeviceCounter:
    """The device's own counter, the time base of a capture.

    **Arguments:**

    - `modulus`: it counts 0 .. modulus - 1 and starts again.
    - `ticks_per_s`: nominal speed; None when it counts samples, whatever their rate.
    """

    modulus: int
    ticks_per_s: float | None


def _set_range(settings: Settings, range_g: float) -> Settings:
    return replace(settings, range_g=(range_g,) * 3)


@dataclass(frozen=True)
class Protocol:
    """One way in which devices talk.

    **Arguments:**

    - `name`: as on the command line. `title`: for people.
    - `decoder`: makes a decoder; the settings may be None where the stream tells them or none are needed.
    - `encode`: samples to bytes, as a device with these settings sends them.
    - `bauds`: usual speeds, the likeliest first.
    - `counter`: the device's counter, or None: then losses can only be seen in time.
    - `queries`: commands that make the device say who it is and how it is set.
    - `ranges_g`: full scales there are; empty when the output is scaled already.
    - `range_from_stream`: the stream tells the range when asked, so it must not be assumed.
    - `checked`: whether frames carry a check.
    - `answer`: what the device replies to a command.
    - `with_range`: settings for a full scale.
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
    with_range: Callable[[Settings, float], Settings] = _set_range
    options: tuple[str, ...] = ()
    notes: str = ""
    extra: Any = None

    def decoder_options(self, columns: str, unit: str, *, whole: bool = False) -> dict[str, Any]:
        """Options of the decoder, as far as it has them: the columns of text lines, or that the whole stream is there."""
        given = {"columns": columns, "unit": unit, "whole": whole}
        return {name: value for name, value in given.items() if value and name in self.options}

    def check_range(self, range_g: float, named: str) -> None:
        """Refuse a full scale that such devices do not have; `named` begins the fault.

        **Raises:** `InputError` naming those there are.
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

    **Raises:** `InputError` naming the ones there are.
    """
    try:
        return protocols()[name]
    except KeyError:
        raise InputError(
            f"protocol {name!r}: not known; there are {', '.join(sorted(protocols()))} "
            "(`tumblecal sniff PORT` guesses which one a device speaks)"
        ) from None
