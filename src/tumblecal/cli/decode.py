"""`tumblecal decode`: a byte log made elsewhere, to samples."""

from pathlib import Path


def decode(
    file: Path,
    /,
    *,
    protocol: str | None = None,
    out: Path | None = None,
    range_g: float | None = None,
    rate_hz: float | None = None,
    columns: str = "",
    unit: str = "",
) -> None:
    """Decode a file of bytes as they came from the port (or the raw log of a capture) and say what is in it.

    Parameters
    ----------
    file
        The bytes.
    protocol
        Name of the protocol; guessed where left out.
    out
        Write the samples to this file, .csv or .parquet.
    range_g
        Full scale in g, where the stream does not tell it.
    rate_hz
        Sample rate in Hz, where the stream does not tell it; gives the time column.
    columns
        For text lines: role of each column (ax, ay, az, gx, gy, gz, t, counter, time, or - for one not used).
    unit
        For text lines: g, mg, m/s2 or e.g. "LSB 16384/g".
    """
    from tumblecal.capture.byte_file import decoded_file, write_samples
    from tumblecal.data.overwriting import inputs_kept
    from tumblecal.errors import InputError

    inputs_kept([file], out=out)
    found = decoded_file(file, protocol, range_g=range_g, rate_hz=rate_hz, columns=columns, unit=unit)
    counts, samples = found.decoded.counts, found.decoded.samples
    print(f"{file}: {found.protocol.title} (--protocol {found.protocol.name})")
    print(
        f"{counts.frames} samples, {counts.special} other frames, {counts.check_failures} failed checks, "
        f"{counts.resyncs} resynchronisations, {counts.discarded} of {found.size} bytes discarded"
    )
    for event in found.decoded.events[:8]:
        shown = {k: v for k, v in event.content.items() if k != "raw"}
        print(f"{event.kind}: " + ", ".join(f"{k} {v}" for k, v in shown.items()))
    if found.losses:
        print(found.losses)
    if not found.protocol.checked and counts.frames and not counts.check_failures:
        print("the lines may carry no check: a lost character then makes a plausible wrong number")
    if len(samples):
        print(found.statistics())
    if out is not None:
        if not len(samples):
            raise InputError(f"{file}: no samples to write")
        write_samples(out, samples, rate_hz or found.rate_hz)
        print(f"{out}: {len(samples)} samples")
