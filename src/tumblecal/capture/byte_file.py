"""Byte logs made elsewhere: which protocol, what is in them, and the samples as a table."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tumblecal.capture.framing import decode_all
from tumblecal.capture.log import MAGIC, Kind, read_log
from tumblecal.capture.losses import count_losses
from tumblecal.capture.protocols import Protocol, protocol
from tumblecal.capture.protocols.stim300_datagrams import settings_of
from tumblecal.capture.samples import Decoded, Samples, Settings
from tumblecal.capture.sniff import ENOUGH, guesses
from tumblecal.data.atomic import written_aside
from tumblecal.errors import InputError


@dataclass(frozen=True)
class DecodedFile:
    """What a byte log holds. `losses`: a line on lost samples; empty when there is no counter."""

    protocol: Protocol
    decoded: Decoded
    size: int
    rate_hz: float | None
    losses: str

    def statistics(self) -> str:
        """Means and standard deviations of the good samples."""
        use = (self.decoded.samples.status == 0) & np.isfinite(self.decoded.samples.force).all(1)
        force = self.decoded.samples.force[use]
        if not len(force):
            return (
                "no specific force in g: the stream does not tell the range; "
                "give --range-g (it is set in the device, do not guess)"
            )
        mean = " ".join(f"{v:+.6f}" for v in force.mean(0))
        sd = " ".join(f"{v * 1e3:.3f}" for v in force.std(0))
        return f"{len(force)} good samples: mean {mean} g, sd {sd} mg, size {np.linalg.norm(force.mean(0)):.5f} g"


def decoded_file(
    path: Path,
    name: str | None = None,
    *,
    range_g: float | None = None,
    rate_hz: float | None = None,
    columns: str = "",
    unit: str = "",
) -> DecodedFile:
    """Decode a whole file.

    **Arguments:**

    - `path`: bytes as they came, or the raw log of a capture.
    - `name`: protocol; guessed when None.
    - `range_g`, `rate_hz`: where the stream does not tell them.
    - `columns`, `unit`: of text lines.

    **Raises:** `InputError` when the file cannot be read or no protocol fits.
    """
    data = _bytes_of(path)
    if not data:
        raise InputError(f"{path}: is empty")
    how = protocol(name) if name is not None else _guessed(path, data)
    settings = _settings(how, range_g, rate_hz)
    options: dict = {"columns": columns, "unit": unit} if "columns" in how.options else {}
    if "whole" in how.options:
        options["whole"] = True
    decoded = decode_all(how.decoder(settings, **options), data)
    configured = [e for e in decoded.events if e.kind == "configuration" and "range_g" in e.content]
    if settings is None and configured and len(decoded.samples) and np.isnan(decoded.samples.force[0, 0]):
        # The configuration came after the first samples: they were made with it, too.
        decoded = decode_all(how.decoder(settings_of(configured[0].content), **options), data)
    rate = configured[0].content.get("rate_hz") if configured else None
    return DecodedFile(how, decoded, len(data), rate, _losses(how, decoded, rate or rate_hz))


def _bytes_of(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    if data.startswith(MAGIC):
        return b"".join(r.payload for r in read_log(path) if r.kind == Kind.BYTES)
    return data


def _guessed(path: Path, data: bytes) -> Protocol:
    ranked = guesses(data[:65536])
    if ranked[0].explained < ENOUGH or not ranked[0].frames + ranked[0].special:
        seen = ", ".join(f"{g.name} {g.explained:.0%}" for g in ranked if g.explained > 0.01) or "nothing"
        raise InputError(
            f"{path}: no protocol explains these bytes (seen: {seen}); give --protocol to read it all the same"
        )
    return protocol(ranked[0].name)


def _settings(how: Protocol, range_g: float | None, rate_hz: float | None) -> Settings | None:
    if range_g is None:
        return Settings(rate_hz=rate_hz) if rate_hz and not how.range_from_stream else None
    if range_g not in how.ranges_g:
        known = ", ".join(f"{r:g}" for r in how.ranges_g) or "none: its output is scaled already"
        raise InputError(f"--range-g {range_g:g}: ranges of {how.name}: {known}")
    return how.with_range(Settings(rate_hz=rate_hz), range_g)


def _losses(how: Protocol, decoded: Decoded, rate_hz: float | None) -> str:
    counter = how.counter
    samples = decoded.samples
    if counter is None or len(samples) < 3 or samples.counter[0] < 0:
        return ""
    step = max(1, round(counter.ticks_per_s / rate_hz)) if counter.ticks_per_s and rate_hz else None
    specials = np.searchsorted(samples.stop, np.array([e.stop for e in decoded.events], np.int64)) - 1
    # A file has no stamps: only what the counter itself shows can be counted.
    found = count_losses(samples.counter, np.zeros(len(samples)), counter.modulus, step, specials)
    wraps = f" (whole wraps of {counter.modulus} cannot be seen in a file)" if counter.modulus <= 65536 else ""
    return f"lost by the counter: {found.lost} in {len(found.gaps)} gaps, {found.replaced} replaced by replies{wraps}"


def write_samples(path: Path, samples: Samples, rate_hz: float | None) -> None:
    """Write samples as .csv or .parquet: ax_g .., gx_dps .., temperature_degc, counter, status, time_s if known.

    **Raises:** `InputError` for another ending or a folder that cannot be written.
    """
    import polars as pl

    if path.suffix not in (".csv", ".parquet"):
        raise InputError(f"{path}: must end in .csv or .parquet")
    table: dict = {}
    if rate_hz:
        table["time_s"] = np.arange(len(samples)) / rate_hz
    table |= {f"a{axis}_g": samples.force[:, k] for k, axis in enumerate("xyz")}
    if np.isfinite(samples.rate).any():
        table |= {f"g{axis}_dps": samples.rate[:, k] for k, axis in enumerate("xyz")}
    if np.isfinite(samples.temperature).any():
        table["temperature_degc"] = samples.temperature
    table |= {"counter": samples.counter, "status": samples.status}
    with written_aside(path) as aside:
        frame = pl.DataFrame(table)
        if path.suffix == ".csv":
            frame.write_csv(aside)
        else:
            frame.write_parquet(aside)
