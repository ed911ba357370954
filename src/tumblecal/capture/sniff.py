"""Which protocol do these bytes belong to: all are tried, and the one that explains most wins."""

import re
from dataclasses import dataclass

from tumblecal.capture.framing import decode_all
from tumblecal.capture.protocols import protocols


ENOUGH = 0.95


@dataclass(frozen=True)
class Guess:
    """How well a protocol explains the bytes: fraction of bytes in whole frames, frames with samples, rate if known."""

    name: str
    explained: float
    frames: int
    special: int
    check_failures: int


def guesses(data: bytes) -> list[Guess]:
    """All protocols, the best first.

    **Arguments:**

    - `data`: bytes from anywhere in a stream; 2 kB and more say something.
    """
    found = [_guess(name, data) for name in protocols()]

    def likelihood(guess: Guess) -> tuple[float, bool, int]:
        # Lines of a protocol with checks are lines of numbers, too: then the protocol that demands more is believed.
        explained = guess.explained if guess.frames + guess.special else 0.0
        return round(explained, 2), protocols()[guess.name].checked, guess.frames

    return sorted(found, key=likelihood, reverse=True)


def _guess(name: str, data: bytes) -> Guess:
    decoder = protocols()[name].decoder(None)
    counts = decode_all(decoder, data).counts
    # An unfinished frame at either end says nothing against a protocol.
    allowance = min(128, len(data) // 4)
    wrong = max(0, counts.discarded - allowance)
    explained = 1 - wrong / max(len(data), 1) if counts.frames + counts.special else 0.0
    return Guess(name, explained, counts.frames, counts.special, counts.check_failures)


def described(data: bytes, wanted: str | None = None) -> str:
    """One line for an operator on bytes that the wanted protocol cannot read."""
    best = guesses(data)[0]
    if wanted is not None and best.explained >= ENOUGH and best.name == wanted:
        events = decode_all(protocols()[wanted].decoder(None), data).events
        refused = next((e.content["text"] for e in events if e.kind == "refused"), None)
        return refused or f"the device speaks {wanted}, but sends no specific force: switch it on in the device"
    if best.explained >= ENOUGH and best.name != wanted:
        return f'the device speaks {best.name}, not {wanted}; set port.protocol = "{best.name}" in the plan'
    printable = len(re.findall(rb"[\x09\x0a\x0d\x20-\x7e]", data)) / max(len(data), 1)
    if printable > 0.95:
        line = data.split(b"\n")[1 if data.count(b"\n") > 1 else 0][:60].decode("ascii", "replace").strip()
        return f"text arrives that holds no specific force, e.g. {line!r}: another device, or it waits for a command"
    if best.explained > 0.3:
        return f"only {best.explained:.0%} of the bytes are right {best.name} frames: bad cable, or a baud rate a little off"
    return f"{len(data)} bytes arrived and no protocol fits them: wrong baud rate? (usual ones: `tumblecal sniff PORT`)"
