"""Lines of numbers between words: labels, brackets, units and the clock of a monitor, equal in all lines.

The text around the numbers is the form. The cells are the numbers in order, named by the words before them.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass


# Separator of the cells of such lines; it does not occur in text.
FORM_SEPARATOR = "\x1f"
_CLOCK = r"(?:\d{4}[-/.]\d\d?[-/.]\d\d?[T ,_]\s*)?\d{1,2}:\d\d:\d\d(?:[.,:]\d+)?"
_NUMBER = (
    r"(?<![\w.^])[-+]?(?:\d+\.?\d*|\.\d+)(?![xX][\da-fA-F])(?:[eE][-+]?\d+)?"
    r"|(?<![\w.])[-+]?(?:nan|inf|NaN|Inf|NAN|INF)(?![\w.])"
)
_CELL = re.compile(rf"{_CLOCK}|{_NUMBER}")
# Prefixes of monitors: 10:00:00.000 ->, [10:00:00.000], or a clock and a blank before cells between commas.
_ARROW = re.compile(
    rf"^[ \t]*(?:[\[(<]({_CLOCK})[\])>][ \t]*(?:[:>]|->)?|({_CLOCK})[ \t]*[-=]?>|({_CLOCK}) +(?=[-+.\d]+[,;|\t]))"
    r"[ \t]*(?![,;|])"
)
_UNIT = re.compile(
    r"\s?([\[(]?(?:m/s\^?2|m/s²|m?[gG]|deg/s|°/s|dps|rad/s|°?C|deg ?C|[mun]?s|uT|µT|%)[\])]?)(?=[\s,;|}]|$)"
)
_MOST_KINDS = 12
_LEAST_SHARE = 0.02
_WHOLE_SHARE = 0.8


@dataclass(frozen=True)
class LineForm:
    """Conversion of lines with words around their numbers to cells.

    **Arguments:**

    - `pattern`: of a line, or of its beginning, with a group for each cell. `cells`: the replacement.
    - `names`: of the cells. `others`: pattern of other lines in the same text, which become blank.
    """

    pattern: re.Pattern[bytes]
    cells: bytes
    names: tuple[str, ...] = ()
    others: re.Pattern[bytes] | None = None

    def applied(self, piece: bytes) -> bytes:
        """Complete lines as lines of cells; lines without this form are unchanged."""
        piece = self.others.sub(b"", piece) if self.others else piece
        return self.pattern.sub(self.cells, piece)

    def line(self, line: str) -> str:
        """A line as a line of cells."""
        return self.applied(line.encode()).decode()


def without_clock(lines: Sequence[str]) -> list[str] | None:
    """Lines without the clock of a monitor, which has an arrow or brackets; None if most lines have no clock."""
    found = sum(bool(_ARROW.match(line)) for line in lines)
    return [_ARROW.sub("", line) for line in lines] if found and found >= _WHOLE_SHARE * len(lines) else None


def clock_form(separator: str) -> LineForm:
    """The form of lines with such a clock, which becomes the first cell."""
    return LineForm(re.compile(_ARROW.pattern.encode(), re.MULTILINE), rb"\1\2\3" + separator.encode())


def has_words(rows: Sequence[Sequence[str]]) -> bool:
    """Whether a column of these rows, of equal length, has labels, or numbers with words or brackets around them."""
    return any(2 * sum(map(_is_mixed, cells)) > len(cells) for cells in zip(*rows, strict=True))


def _is_mixed(cell: str) -> bool:
    between = "" if re.search(r"\d:\d\d", cell) or not _CELL.search(cell) else _CELL.sub("", cell)
    return bool(re.search(r"[^\W\d_]|[\[\](){}<>]", between) or re.fullmatch(r"[^\W\d_].*[:=]", cell))


def word_forms(lines: Sequence[str]) -> dict[str, LineForm]:
    """The forms of lines with words around their numbers, by their first label; none if most lines have no common form."""
    pointed, digits = _with_points(lines)
    # The texts around the numbers of each line, with single blanks.
    texts = [tuple(re.sub(r"\s+", " ", text).strip() for text in _CELL.split(line)) for line in pointed]
    least = max(1, _LEAST_SHARE * len(lines))
    kinds = [key for key, count in Counter(texts).most_common(_MOST_KINDS) if count > least and key[1:]]
    patterns = {key: _pattern(key, digits) for key in kinds}
    whole = [
        key for key, line in zip(texts, lines, strict=True) if key in patterns and patterns[key].match(line.encode())
    ]
    if len(whole) < _WHOLE_SHARE * len(lines) or not any("".join(key).strip(" ,;|") for key in whole):
        return {}
    forms = dict[str, LineForm]()
    for key in dict.fromkeys(whole):
        first = pointed[texts.index(key)]
        names = _names(_CELL.split(first), _CELL.findall(first))
        others = b"|".join(pattern.pattern for other, pattern in patterns.items() if other != key)
        cells = FORM_SEPARATOR.encode().join(rb"\g<%d>" % (k + 1) for k in range(len(names)))
        label = names[0].partition(" [")[0]
        name = (re.sub(r"[._ ]?[xXyYzZ1]$", "", label) if len(names) > 1 else "") or label
        forms[name if name not in forms else f"{name}#{len(forms) + 1}"] = LineForm(
            patterns[key], cells, names, re.compile(others, re.MULTILINE) if others else None
        )
    return forms


def _with_points(lines: Sequence[str]) -> tuple[Sequence[str], bytes]:
    """Lines with decimal points, and the characters of their numbers, with the comma if commas are only between digits."""
    text = "\n".join(lines)
    pairs = len(re.findall(r"(?<=\d),(?=\d)", text))
    if not pairs or pairs < text.count(",") or re.search(r"\d\.\d|\d,\d+,\d", text):
        return lines, rb"[-+.\deE]+"
    return re.sub(r"(?<=\d),(?=\d)", ".", text).split("\n"), rb"[-+,\deE]+"


def _pattern(texts: Sequence[str], digits: bytes) -> re.Pattern[bytes]:
    """The pattern of lines with these texts around numbers of these characters, so that polars reads the same numbers."""
    words = [rb"[ \t]+".join(map(_word, text.split())) for text in texts]
    # Two numbers without a word between them are separated by a blank.
    least = [b"*" if k in (0, len(words) - 1) else b"+" for k in range(len(words))]
    between = [
        rb"[ \t]*" + word + rb"[ \t]*" if word else rb"[ \t]" + many for word, many in zip(words, least, strict=True)
    ]
    cell = b"(" + digits + b"|" + _CLOCK.encode() + b"|[-+]?(?:[nN][aA][nN]|[iI][nN][fF]))"
    return re.compile(b"^" + cell.join(between) + b"$", re.MULTILINE)


def _word(word: str) -> bytes:
    """The pattern of a word; letters beyond ASCII are some bytes in any encoding."""
    return re.sub(rb"[\x80-\xff]+", rb"[\\x80-\\xff]+", re.escape(word.encode()))


def _names(texts: Sequence[str], cells: Sequence[str]) -> tuple[str, ...]:
    """The names of cells by the texts around them; three cells after one label are its x, y and z."""
    behind = [_UNIT.match(text) for text in texts[1:]]
    before = [texts[0], *(text[unit.end() :] if unit else text for text, unit in zip(texts[1:], behind, strict=True))]
    labels, units = map(list, zip(*map(_label, before[: len(cells)]), strict=True))
    words = labels[0].split()
    if len(words) > 1 and len(words[-1]) > 1 and re.sub("([xX])$", _next_axis, words[-1]) in labels:
        # IMU: ax=0.1, ay=0.2: the first word is that of the line.
        labels[0] = words[-1]
    clocks = [not label and bool(re.fullmatch(_CLOCK, cell)) for label, cell in zip(labels, cells, strict=True)]
    # Numbers before the first label, and after a clock, have no name.
    starts = [k for k, label in enumerate(labels) if label or clocks[k] or not any(labels[:k]) or clocks[k - 1]]
    names, group = list[str](), ""
    for start, stop in zip(starts, [*starts[1:], len(labels)], strict=True):
        label, count = "time" if clocks[start] else labels[start], stop - start
        if re.fullmatch("[xyzXYZ]", label):
            # A lone letter of an axis has the words of the label before it.
            label = group + label
        elif match := re.fullmatch(r"(.+?[ ._]?)[xX]", label):
            group = match[1]
        ends = [""] if count == 1 else [".x", ".y", ".z"] if count == 3 else [f".{k + 1}" for k in range(count)]
        for k, end in enumerate(ends, start):
            name, unit = f"{label}{end}" if label else str(k + 1), behind[k]
            name = name if name not in names else f"{name}#{k + 1}"
            names.append(f"{name} [{shown}]" if (shown := unit[1].strip("[]()") if unit else units[start]) else name)
    return tuple(names)


def _next_axis(match: re.Match[str]) -> str:
    return chr(ord(match[1]) + 1)


def _label(text: str) -> tuple[str, str]:
    """The words that name the next number, the last between separators and brackets, and the unit in brackets after them."""
    text = text.rstrip(" \t:=[({<\"'")
    unit = re.search(r"[\[(]([^\[\](){}]*)[\])]$", text)
    parts = re.split(r"[,;|\t\[\](){}<>]|\s{2,}", text[: unit.start()] if unit else text)
    parts = [part.strip(" \t:=>'\"-#$*@!?/") for part in parts]
    words = next((part for part in reversed(parts) if re.search("[^\\W\\d_]", part)), "")
    return re.sub(r"\s*[:=]\s*", " ", words), unit[1].strip() if unit and words else ""
