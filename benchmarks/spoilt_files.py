"""Damage as disks, copies and editors make it: bytes, lines, cells, separators, encodings, values of documents."""

import bz2
import gzip
import json
import lzma
import random
import re
from collections.abc import Callable


Damage = Callable[[bytes, random.Random], bytes]
_WORDS = r"""nan inf -inf -1 0 1e308 -1e308 1e-308 1e400 true false null [] {} "" 'x' [1,2] {"a":1} 2026-01-02 12:30:00
0x7fffffffffffffff 9223372036854775808 99999999999999999999 1_000 +5 .5 5. 1,5 ² ١ "\u0000" "a\nb" --- [[ ]] # =
0.1mg '1\u00a0mg' '-1mg' '1e400mg' '1mg/g^9/h' "3parsec" None"""
# Replacements of a cell, key or value.
VALUES = [
    *_WORDS.split(),
    *("\u2028", "\x0b", "\x7f", "\x1c", "1 mg", "7" * 5000, "0x" + "f" * 4500, "1." + "3" * 5000),
    *("[" * 3000, '{"a":' * 3000, "x" * 100_000),
]
ODD = [bytes([code]) for code in b'\x00\xff\r"\x0b\x1c#,\n[}'] + [b"\xe2\x80\xa8", b"\xed\xa0\x80"]
REPLACED = [
    pair.encode().split(b" ")
    for pair in (", ;", ", \t", "\n \r\n", "\n \r", "\n \n\n", ". ,", "= :", "\" '", "_g _ms2", "_g _mg")
]
JSON_VALUES = (None, True, 1, -1.5, 1e308, 1e-320, 10**400, "x", "", float("nan"), float("inf"), 2**64, [], [1, 2, 3])
_TOML = """1|-1|0|1.5|nan|inf|1e308|"x"|""|true|1979-05-27T07:32:00Z|[]|[1, 2]|999999999999999999999999999999|{a = 1, value = 2}
"1 mg"|"1e300 mg"|"1e-300 mg"|0xffffffffffffffffffffffff|"-1 s"|100000|"\\n\""""
TOML_VALUES = _TOML.replace("\n", "|").split("|")


def flipped(content: bytes, chance: random.Random) -> bytes:
    """One to eight bits."""
    out = bytearray(content)
    for _ in range(chance.choice((1, 1, 3, 8))):
        out[chance.randrange(len(out))] ^= 1 << chance.randrange(8)
    return bytes(out)


def truncated(content: bytes, chance: random.Random) -> bytes:
    size = len(content)
    return content[: chance.choice((chance.randint(0, size), size - chance.randint(1, min(40, size))))]


def cut(content: bytes, chance: random.Random) -> bytes:
    first, last = sorted(chance.randint(0, len(content)) for _ in range(2))
    return chance.choice((content[first:], content[:first] + content[last:]))


def zeroed(content: bytes, chance: random.Random) -> bytes:
    first, last = _stretch(content, chance)
    return content[:first] + bytes(last - first) + content[last:]


def doubled(content: bytes, chance: random.Random) -> bytes:
    first, last = _stretch(content, chance)
    return content[:last] + content[first:]


def inserted(content: bytes, chance: random.Random) -> bytes:
    at = chance.randint(0, len(content))
    odd = chance.choice(ODD) * chance.choice((1, 2, 1000))
    return content[:at] + chance.choice((odd, chance.randbytes(chance.choice((1, 3, 40, 500))))) + content[at:]


def emptied(content: bytes, chance: random.Random) -> bytes:
    return chance.choice((b"", b"\n", b" ", bytes(len(content)), content[:1]))


def lines_lost(content: bytes, chance: random.Random) -> bytes:
    """A line lost, moved, or there three times."""
    lines = content.split(b"\n")
    line = lines.pop(chance.randrange(len(lines)))
    for _ in range(chance.choice((0, 0, 1, 2))):
        lines.insert(chance.randint(0, len(lines)), line)
    return b"\n".join(lines)


def replaced(content: bytes, chance: random.Random) -> bytes:
    """A cell, key or value."""
    tokens = list(re.finditer(rb'"[^"\n]*"|[-+\w.]+', content))
    if not tokens:
        return content
    token = chance.choice(tokens)
    return content[: token.start()] + chance.choice(VALUES).encode() + content[token.end() :]


def separated(content: bytes, chance: random.Random) -> bytes:
    return content.replace(*chance.choice(REPLACED), chance.choice((-1, 1, 3)))


def encoded(content: bytes, chance: random.Random) -> bytes:
    codec = chance.choice(("utf-16", "utf-16-le", "utf-8-sig", "utf-32", "utf-7"))
    return content.decode("utf-8", "replace").encode(codec)


def packed(content: bytes, chance: random.Random) -> bytes:
    return chance.choice((gzip.compress, bz2.compress, lzma.compress))(content)


def of_another_type(content: bytes, chance: random.Random) -> bytes:
    """A value of a JSON document, or of a line of TOML."""
    try:
        whole = json.loads(content)
    except (ValueError, RecursionError):
        return re.sub(
            rb"(?m)=.*$", lambda _: b"= " + chance.choice(TOML_VALUES).encode(), content, count=chance.randint(1, 4)
        )
    if isinstance(whole, dict) and whole:
        value = chance.choice(JSON_VALUES)
        whole[chance.choice(list(whole))] = chance.choice(
            (value, [value], {"axis": value, "powers": [value], "": value})
        )
    return json.dumps(whole).encode()


def _stretch(content: bytes, chance: random.Random) -> tuple[int, int]:
    first = chance.randrange(len(content))
    return first, min(len(content), first + chance.choice((1, 16, 100, 512, 4096)))


_OFTEN = (truncated, flipped, flipped, inserted, lines_lost, lines_lost, replaced, replaced)
_SELDOM = (truncated, truncated, cut, flipped, flipped, zeroed, doubled, inserted, emptied, lines_lost, replaced)
DAMAGES: tuple[Damage, ...] = (*_OFTEN, *_SELDOM, separated, encoded, packed, of_another_type)
