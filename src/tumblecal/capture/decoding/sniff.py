"""Recognition of the protocol of bytes: all are tried, and the one that explains most is used."""

import re
from dataclasses import dataclass

import numpy as np

from tumblecal.capture.decoding.framing import decode_all
from tumblecal.capture.protocols import protocols


ENOUGH = 0.95
# Number of unknown bytes that are examined; no protocol has longer frames.
_LOOKED_AT, _LONGEST_FRAME = 1 << 16, 512


@dataclass(frozen=True)
class Guess:
    """Match of a protocol to bytes: fraction of bytes in complete frames, frames with samples, rate if known."""

    name: str
    explained: float
    frames: int
    special: int
    check_failures: int


def guesses(data: bytes) -> list[Guess]:
    """All protocols, the best first.

    **Arguments:**

    - `data`: bytes from anywhere in a stream; at least 2 kB are useful.
    """
    found = [_guess(name, data) for name in protocols()]

    def likelihood(guess: Guess) -> tuple[float, bool, int]:
        # Lines of a protocol with checksums are also lines of numbers: then the stricter protocol is preferred.
        explained = guess.explained if guess.frames + guess.special else 0.0
        return round(explained, 2), protocols()[guess.name].checked, guess.frames

    return sorted(found, key=likelihood, reverse=True)


def _guess(name: str, data: bytes) -> Guess:
    decoder = protocols()[name].decoder(None)
    counts = decode_all(decoder, data).counts
    # An unfinished frame at either end is no evidence against a protocol.
    allowance = min(128, len(data) // 4)
    wrong = max(0, counts.discarded - allowance)
    explained = 1 - wrong / max(len(data), 1) if counts.frames + counts.special else 0.0
    return Guess(name, explained, counts.frames, counts.special, counts.check_failures)


def described(data: bytes, wanted: str | None = None) -> str:
    """One line for the operator on bytes that the expected protocol cannot read."""
    best = guesses(data)[0]
    if wanted is not None and best.explained >= ENOUGH and best.name == wanted:
        events = decode_all(protocols()[wanted].decoder(None), data).events
        refused = next((e.content["text"] for e in events if e.kind == "refused"), None)
        return refused or f"the device sends {wanted} without a specific force: enable it in the device"
    if best.explained >= ENOUGH and best.name != wanted:
        return f'the device sends {best.name}, not {wanted}; set port.protocol = "{best.name}" in the plan'
    printable = len(re.findall(rb"[\x09\x0a\x0d\x20-\x7e]", data)) / max(len(data), 1)
    if printable > 0.95:
        line = data.split(b"\n")[1 if data.count(b"\n") > 1 else 0][:60].decode("ascii", "replace").strip()
        return f"text without a specific force arrives, e.g. {line!r}: a different device, or it waits for a command"
    if best.explained > 0.3:
        return f"only {best.explained:.0%} of the bytes are correct {best.name} frames: bad cable, or a wrong baud rate"
    return (
        f"{len(data)} bytes arrived and no protocol fits them; check the baud rate (usual ones: `tumblecal sniff PORT`)"
    )


def unknown_words(data: bytes) -> str:
    """Description of bytes that no protocol and no format fits: text, frames of one length, or neither."""
    content = np.frombuffer(data[:_LOOKED_AT], np.uint8)
    shares = np.bincount(content, minlength=256) / max(len(content), 1)
    bits = abs(float((shares[shares > 0] * np.log2(shares[shares > 0])).sum()))
    printable = float(shares[[9, 10, 13, *range(32, 127)]].sum())
    if printable > 0.95:
        line = data.split(b"\n")[data.count(b"\n") // 2][:60].decode("ascii", "replace").strip()
        return f"text without three numbers a line, e.g. {line!r}"
    lags = np.arange(4, min(_LONGEST_FRAME, len(content) // 8))
    agreement = np.array([float((content[lag:] == content[:-lag]).mean()) for lag in lags])
    usual = float((shares**2).sum())
    if len(lags) and agreement.max() > usual + max(0.02, 5 * np.sqrt(usual / len(content))):
        # Twice a frame's length also repeats: the shortest length that does so nearly as much is used.
        length = int(lags[np.flatnonzero(agreement > usual + 0.9 * (agreement.max() - usual))[0]])
        rows = content[: len(content) // length * length].reshape(-1, length)
        same = [k for k in range(length) if (rows[:, k] == np.bincount(rows[:, k]).argmax()).mean() > 0.9]
        fixed = " ".join(f"{np.bincount(rows[:, k]).argmax():02X}" for k in same[:8]) or "none"
        return f"the bytes repeat every {length} bytes, like frames of that length; {len(same)} of them never change ({fixed})"
    kind = "like compressed data, or a wrong baud rate" if bits > 7.5 else "without frames of one length"
    return f"{len(data)} bytes, {bits:.1f} bits of information each, {kind}"
