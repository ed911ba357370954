"""Two sets of golden answers compared: verdicts, classes, probabilities, coefficients."""

import gzip
import json
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path


# A change of a probability, and of a coefficient or its standard uncertainty in units of that, up to which they are equal.
PROBABILITY, COEFFICIENT = 0.02, 0.1
WHAT = ("missing", "file", "refusal", "verdict", "class", "probability", "coefficient")


@dataclass
class Difference:
    """What differs in the answers of one file: lines by what changed, one of `WHAT`."""

    name: str
    kind: str
    lines: dict[str, list[str]] = field(default_factory=dict)

    @property
    def changed(self) -> bool:
        """Whether anything differs."""
        return bool(self.lines)


def read(path: Path) -> dict[str, dict]:
    """Answers by the names of their files."""
    with gzip.open(path, "rt", encoding="utf-8") as file:
        return {row["name"]: row for row in map(json.loads, file)}


def compared(before: Mapping[str, dict], after: Mapping[str, dict]) -> list[Difference]:
    """The differences of all files that are in either."""
    return [_of_file(name, before.get(name), after.get(name)) for name in dict.fromkeys([*before, *after])]


def _of_file(name: str, before: dict | None, after: dict | None) -> Difference:
    difference = Difference(name, (before or after or {})["kind"])

    def add(what: str, words: str) -> None:
        difference.lines.setdefault(what, []).append(words)

    if before is None or after is None:
        add("missing", "only after" if before is None else "only before")
        return difference
    if before["sha256"] != after["sha256"]:
        add("file", "the positions differ: the answers are not comparable")
    elif before["answer"] is None or after["answer"] is None:
        if before["refused"] != after["refused"]:
            add("refusal", f"{before['refused'] or 'diagnosed'} -> {after['refused'] or 'diagnosed'}")
    else:
        for what, words in _of_answers(before["answer"], after["answer"]):
            add(what, words)
    return difference


def _of_answers(before: dict, after: dict) -> Iterator[tuple[str, str]]:
    """What changed, and how."""
    if before["verdict"] != after["verdict"]:
        yield "verdict", f"{before['verdict']} -> {after['verdict']}"
    causes = [" + ".join(own.get("causes", ())) or "none" for own in (before, after)]
    if causes[0] != causes[1]:
        yield "class", f"causes: {causes[0]} -> {causes[1]}"
    leading = [next(iter(own["explanations"]), {}) for own in (before, after)]
    members = [_members(own) for own in leading]
    if members[0] != members[1]:
        yield "class", f"fewer: {_words(members[0] - members[1])}; more: {_words(members[1] - members[0])}"
    elif leading[0] and abs(leading[0]["probability"] - leading[1]["probability"]) > PROBABILITY:
        yield "probability", f"{leading[0]['probability']:.3f} -> {leading[1]['probability']:.3f}"
    others = [{_key(own): _probability(own) for own in answer["explanations"][1:]} for answer in (before, after)]
    for key in dict.fromkeys([*others[0], *others[1]]):
        low, high = (own.get(key, 0.0) for own in others)
        if abs(high - low) > PROBABILITY:
            yield "probability", f"{' + '.join(key)}: {low:.3f} -> {high:.3f}"
    if leading[0] and leading[1] and _key(leading[0]) == _key(leading[1]):
        yield from _coefficients(
            _values(leading[0].get("coefficients", {})), _values(leading[1].get("coefficients", {}))
        )
    yield from _coefficients(_values(before.get("parameters", {})), _values(after.get("parameters", {})))


def _coefficients(before: Mapping[str, tuple], after: Mapping[str, tuple]) -> Iterator[tuple[str, str]]:
    for name in dict.fromkeys([*before, *after]):
        if name not in before or name not in after:
            yield "coefficient", f"{name}: only {'before' if name in before else 'after'}"
            continue
        (value, u), (other, other_u) = before[name], after[name]
        if None in (value, u, other, other_u):
            if (value, u) != (other, other_u):
                yield "coefficient", f"{name}: {value} +- {u} -> {other} +- {other_u}"
        elif max(abs(other - value), abs(other_u - u)) > COEFFICIENT * u:
            yield "coefficient", f"{name}: {value:.4g} +- {u:.2g} -> {other:.4g} +- {other_u:.2g}"


def _values(entries: Mapping[str, dict]) -> dict[str, tuple]:
    """Value and standard uncertainty of each coefficient."""
    return {name: (own["value"], own.get("u", own.get("sd"))) for name, own in entries.items() if "value" in own}


def _key(explanation: dict) -> tuple[str, ...]:
    at = [f"{id} at {', '.join(own)}" for id, own in explanation.get("positions", {}).items()]
    return (*sorted(explanation["effects"]), *sorted(at))


def _members(explanation: dict) -> frozenset[tuple[str, ...]]:
    """The sets of names of a class."""
    if not explanation:
        return frozenset()
    return frozenset([_key(explanation), *(tuple(sorted(own)) for own in explanation["equivalents"])])


def _probability(explanation: dict) -> float:
    return explanation.get("class_probability", explanation["probability"])


def _words(members: frozenset[tuple[str, ...]]) -> str:
    return ", ".join(" + ".join(own) or "adequate" for own in sorted(members)) or "none"


def report(differences: list[Difference]) -> str:
    """A paragraph for each file with a difference, and a table of counts by kind."""
    lines, kinds = [], Counter(own.kind for own in differences)
    for own in differences:
        if own.changed:
            lines.append(f"{own.name} ({own.kind})")
            lines += [f"    {what}: {words}" for what in WHAT for words in own.lines.get(what, ())]
    counts = Counter((own.kind, what) for own in differences for what in own.lines)
    width = max(map(len, [*kinds, "all"]))
    lines += ["", f"{'kind':{width}s}  files  " + "  ".join(f"{what:>11s}" for what in WHAT)]
    for kind in sorted(kinds):
        if any(counts[kind, what] for what in WHAT):
            lines.append(
                f"{kind:{width}s} {kinds[kind]:6d}  " + "  ".join(f"{counts[kind, what]:11d}" for what in WHAT)
            )
    total = [sum(what in own.lines for own in differences) for what in WHAT]
    lines.append(f"{'all':{width}s} {len(differences):6d}  " + "  ".join(f"{count:11d}" for count in total))
    return "\n".join(lines)
