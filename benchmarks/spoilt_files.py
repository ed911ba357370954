"""Files spoilt by chance: bytes, lines, cells, separators, encodings, whole trees."""

import bz2
import gzip
import json
import lzma
import random
import re
from collections.abc import Callable


# What stands in place of a cell, key or value.
_WORDS = (
    r"""nan inf -inf -1 0 1e308 -1e308 1e-308 1e400 true false null [] {} "" 'x' [1,2] {"a":1} 2026-01-02 12:30:00
0x7fffffffffffffff 9223372036854775808 99999999999999999999 1_000 +5 .5 5. 1,5 ² ١ "\u0000" "a\nb" --- """
    + r"""[[ ]] # =
0.1mg '1\u00a0mg' '-1mg' '1e400mg' '1mg/g^9/h' "3parsec" None"""
)
VALUES = [
    *_WORDS.split(), "\u2028", "\x0b", "\x7f", "\x1c", "1 mg", "7" * 5000, "0x" + "f" * 4500, "1." + "3" * 5000,
    "[" * 3000, '{"a":' * 3000, "x" * 100_000,
]  # fmt: skip
ODD = (b"\x00", b"\xff", b"\r", b'"', b"\x0b", b"\x1c", b"\xe2\x80\xa8", b"\xed\xa0\x80", b"#", b",", b"\n", b"[", b"}")
TOML_VALUES = """1|-1|0|1.5|nan|inf|1e308|"x"|""|true|1979-05-27T07:32:00Z|999999999999999999999999999999|"1 mg"|"1 rad"
"1e300 mg"|"1e-300 mg"|0xffffffffffffffffffffffff|"-1 s"|100000|"\\n"|"1 Hz"|"1e12 Hz" """.replace("\n", "|").split("|")


def spoilt(content: bytes, chance: random.Random) -> bytes:
    """The file with one to four mutations."""
    for _ in range(chance.randint(1, 4)):
        content = chance.choice(MUTATIONS)(content, chance)
    return content


def _flipped(content: bytes, chance: random.Random) -> bytes:
    out = bytearray(content)
    for _ in range(chance.randint(1, 8)):
        if out:
            out[chance.randrange(len(out))] ^= 1 << chance.randrange(8)
    return bytes(out)


def _cut(content: bytes, chance: random.Random) -> bytes:
    first, last = sorted(chance.randint(0, len(content)) for _ in range(2))
    return chance.choice((content[:first], content[first:], content[:first] + content[last:]))


def _lines(content: bytes, chance: random.Random) -> bytes:
    lines = content.split(b"\n")
    line = lines.pop(chance.randrange(len(lines)))
    for _ in range(chance.choice((0, 2, 2, 1))):
        lines.insert(chance.randint(0, len(lines)), line)
    return b"\n".join(lines)


def _token(content: bytes, chance: random.Random) -> bytes:
    tokens = list(re.finditer(rb'"[^"\n]*"|[-+\w.]+', content))
    if not tokens:
        return content
    token, value = chance.choice(tokens), chance.choice(VALUES).encode()
    return content[: token.start()] + value + content[token.end() :]


def _encoded(content: bytes, chance: random.Random) -> bytes:
    text = content.decode("utf-8", "replace")
    codec = chance.choice(("utf-16", "utf-16-le", "utf-8-sig", "utf-32", "utf-7"))
    return text.encode(codec)


def _separated(content: bytes, chance: random.Random) -> bytes:
    old, new = chance.choice(((b",", b";"), (b",", b"\t"), (b",", b" "), (b"\n", b"\r\n"), (b"\n", b"\r"), (b".", b","),
                              (b"=", b":"), (b'"', b"'"), (b"_g", b"_ms2"), (b"_g", b"_mg"), (b"\n", b"\n\n")))  # fmt: skip
    return content.replace(old, new, chance.choice((-1, 1, 3)))


def _inserted(content: bytes, chance: random.Random) -> bytes:
    at = chance.randint(0, len(content))
    return content[:at] + chance.choice(ODD) * chance.choice((1, 1, 2, 1000)) + content[at:]


def _tree(content: bytes, chance: random.Random) -> bytes:
    """Values of a JSON file or a TOML line replaced by random trees."""
    try:
        whole = json.loads(content)
    except (ValueError, RecursionError):
        return re.sub(
            rb"(?m)=.*$", lambda _: b"= " + _random_toml(chance, 3).encode(), content, count=chance.randint(1, 4)
        )
    if isinstance(whole, dict) and whole:
        whole[chance.choice(list(whole))] = _random_json(chance, 4)
    return json.dumps(whole).encode()


def _random_json(chance: random.Random, depth: int) -> object:
    kind = chance.randrange(9 if depth else 6)
    if kind > 7:
        return {chance.choice(("axis", "powers", "kind", "x", "")): _random_json(chance, depth - 1) for _ in range(3)}
    if kind > 5:
        return [_random_json(chance, depth - 1) for _ in range(chance.choice((0, 1, 3, 3, 12)))]
    return chance.choice(
        (None, True, 1, -1.5, 0, 1e308, 1e-320, 10**400, "x", "z", "", float("nan"), float("inf"), 2**64)
    )


def _random_toml(chance: random.Random, depth: int) -> str:
    if depth and chance.random() < 0.5:
        return "[" + ", ".join(_random_toml(chance, depth - 1) for _ in range(chance.randint(0, 3))) + "]"
    if depth and chance.random() < 0.3:
        keys = chance.sample(("start", "step", "count", "value", "unit", "a"), 3)
        return "{" + ", ".join(f"{key} = {_random_toml(chance, depth - 1)}" for key in keys) + "}"
    return chance.choice(TOML_VALUES)


MUTATIONS: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    _flipped, _cut, _lines, _lines, _token, _token, _token, _encoded, _separated, _inserted, _tree,
)  # fmt: skip


def _zeroed(content: bytes, chance: random.Random) -> bytes:
    first, last = _stretch(content, chance)
    return content[:first] + bytes(last - first) + content[last:]


def _doubled(content: bytes, chance: random.Random) -> bytes:
    first, last = _stretch(content, chance)
    return content[:last] + content[first:]


def _noise(content: bytes, chance: random.Random) -> bytes:
    at = chance.randint(0, len(content))
    return content[:at] + chance.randbytes(chance.choice((1, 3, 40, 500))) + content[at:]


def _truncated(content: bytes, chance: random.Random) -> bytes:
    return content[
        : chance.choice((chance.randint(0, len(content)), len(content) - chance.randint(1, min(40, len(content)))))
    ]


def _emptied(content: bytes, chance: random.Random) -> bytes:
    return chance.choice((b"", b"\n", b" ", bytes(len(content)), content[:1]))


def _exchanged(content: bytes, chance: random.Random) -> bytes:
    lines = content.split(b"\n")
    one, other = (chance.randrange(len(lines)) for _ in range(2))
    lines[one], lines[other] = lines[other], lines[one]
    return b"\n".join(lines)


def _one_flipped(content: bytes, chance: random.Random) -> bytes:
    out = bytearray(content)
    out[chance.randrange(len(out))] ^= 1 << chance.randrange(8)
    return bytes(out)


def _packed(content: bytes, chance: random.Random) -> bytes:
    return chance.choice((gzip.compress, bz2.compress, lzma.compress))(content)


def _stretch(content: bytes, chance: random.Random) -> tuple[int, int]:
    first = chance.randrange(len(content))
    return first, min(len(content), first + chance.choice((1, 16, 100, 512, 4096)))


# One damage at a time, as disks, copies and editors make it.
DAMAGES: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    _truncated, _truncated, _truncated, _one_flipped, _one_flipped, _flipped, _zeroed, _doubled, _noise, _emptied, _exchanged,
    _packed, *MUTATIONS,
)  # fmt: skip
