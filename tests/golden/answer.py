"""The answer of a command as numbers, verdicts and labels: what a redesign must not change. Texts are not part of it.

An answer has the exit codes and the files of a case. Of a JSON or TOML file it has all entries except texts and those that
differ from run to run; of a table the number of rows, and mean and root mean square of each column; of an exported file the
numbers outside its comments.
"""

import json
import math
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import polars as pl


# Entries that depend on the moment, the version or the folder of a run.
_OF_THE_RUN = {
    "provenance",
    "sha256",
    "raw_sha256",
    "recording",
    "hash",
    "created",
    "version",
    "versions",
    "source",
    "sources",
    "seconds",
    "title",
}
# Of a diagnosis: what decides. The other entries are descriptions and forecasts.
_OF_DIAGNOSES = ("schema", "verdict", "use", "causes", "set_up", "explanations", "located", "unexplained", "sigma_g",
                 "assumed_noise_p_value", "mountings", "parameters")  # fmt: skip
# Of a plan: what depends on the positions that the search finds.
_OF_PLANS = ("positions", "parameters", "in_use_g", "criterion", "effects", "trade_off")
_LONGEST_LIST = 40
# Of exported files: what begins a comment, and numbers that are no part of a name or of a checksum (*57).
_COMMENTS = ("#", "//", "/*", "*", "%", '"comment"')
_NUMBER = re.compile(r"(?<![\w.*])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?(?![\w.])")
# Differences up to which numbers are equal: relative, absolute, in units of a stated uncertainty, of probabilities.
RELATIVE, ABSOLUTE, OF_U, PROBABILITY = 2e-3, 1e-9, 0.05, 0.02
# The entry of a plan with the value of its criterion, and the relative difference up to which plans are equally good.
SEARCHED, AS_GOOD = "searched", 0.02


def files_of(folder: Path, before: set[Path]) -> dict[str, Any]:
    """The reduced content of each file that was written into a folder."""
    written = sorted(path for path in folder.rglob("*") if path.is_file() and path not in before)
    written = [path for path in written if path.name != ".lock" and path.parent.name != "chunks"]
    return {path.relative_to(folder).as_posix(): _content(path) for path in written}


def _content(path: Path) -> Any:
    match path.suffix:
        case ".json":
            content = json.loads(path.read_text(encoding="utf-8"))
            if str(content.get("schema", "")).startswith("tumblecal.diagnosis/"):
                return diagnosis(content)
            if str(content.get("schema", "")).startswith("tumblecal.plan/"):
                return searched_plan(content)
            return reduced(content)
        case ".toml":
            content = tomllib.loads(path.read_text(encoding="utf-8"))
            if (path.parent / "plan.json").exists():
                return searched_files(content)
            return reduced(content)
        case ".csv":
            return _table(pl.read_csv(path, comment_prefix="#", infer_schema_length=None, truncate_ragged_lines=True))
        case ".parquet":
            return _table(pl.read_parquet(path))
        case ".html" | ".svg" | ".xml" | ".txt" | ".db":
            return None
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.lstrip().startswith(_COMMENTS)]
    return reduced([float(number) for line in lines for number in _NUMBER.findall(line)])


def _table(table: pl.DataFrame) -> dict[str, Any]:
    numbers = {
        name: [table[name].drop_nulls().mean(), math.sqrt((table[name].cast(float).drop_nulls() ** 2).mean() or 0.0)]
        for name, kind in table.schema.items()
        if kind.is_numeric()
    }
    return reduced({"rows": len(table), "columns": {name: numbers.get(name) for name in table.columns}})


def diagnosis(content: dict[str, Any]) -> dict[str, Any]:
    """What decides in a diagnosis; of its explanations the first two."""
    kept = {name: content[name] for name in _OF_DIAGNOSES if name in content}
    explanations = content["explanations"][:2]
    for one in explanations:
        # Rounding decides which of two combinations comes first if both are equally well determined.
        one.get("combinations", []).sort(key=lambda each: sorted(each["weights"]))
    return reduced(kept | {"explanations": explanations})


def searched_plan(content: dict[str, Any]) -> dict[str, Any]:
    """What a plan states besides its positions: many plans are equally good, and rounding decides between them."""
    kept = {name: entry for name, entry in content.items() if name not in _OF_PLANS}
    return reduced(kept | {"positions": len(content["positions"]), SEARCHED: content["criterion"]["value"]})


def searched_files(content: dict[str, Any]) -> dict[str, Any]:
    """A plan or rig of a search, with the number of its positions."""
    for table, key in (("positions", "listed"), ("plan", "positions")):
        if isinstance(listed := content.get(table, {}).get(key), list):
            content[table][key] = len(listed)
    return reduced(content)


def reduced(value: Any) -> Any:
    """Without texts and entries of the run, with short numbers, and long lists of numbers as [count, mean, rms]."""
    match value:
        case dict():
            entries = {str(key): reduced(entry) for key, entry in value.items() if key not in _OF_THE_RUN}
            return {key: entry for key, entry in entries.items() if entry != _TEXT}
        case list() | tuple():
            flat = list(_flat(value))
            if len(flat) > _LONGEST_LIST and all(isinstance(entry, int | float) for entry in flat):
                known = [entry for entry in flat if math.isfinite(entry)]
                square = math.sqrt(sum(entry**2 for entry in known) / max(len(known), 1))
                return reduced([len(flat), sum(known) / max(len(known), 1), square])
            return [entry for entry in map(reduced, value) if entry != _TEXT]
        case float():
            return float(f"{value:.6g}")
        case str():
            return _TEXT if " " in value.strip() else value
        case bool() | int() | None:
            return value
    return str(value)


_TEXT = "(text)"


def _flat(value: Any) -> Iterator[Any]:
    if isinstance(value, list | tuple):
        for entry in value:
            yield from _flat(entry)
    else:
        yield value


def differences(before: Any, after: Any, where: str = "", tolerance: float = 0.0) -> Iterator[str]:
    """What differs, a line each. `tolerance`: of numbers, in addition to the relative one."""
    match before, after:
        case dict(), dict():
            u = next((before[name] for name in ("u", "sd") if isinstance(before.get(name), float)), 0.0)
            for key in dict.fromkeys([*before, *after]):
                inner = f"{where}/{key}"
                if key not in before or key not in after:
                    yield f"{inner}: only {'before' if key in before else 'after'}"
                    continue
                probable = "probability" in key or key.startswith("p_") or key.endswith("p_value")
                near = AS_GOOD * abs(before[key]) if key == SEARCHED else PROBABILITY if probable else OF_U * abs(u)
                yield from differences(before[key], after[key], inner, near)
        case list(), list() if len(before) == len(after):
            for number, (old, new) in enumerate(zip(before, after, strict=True)):
                yield from differences(old, new, f"{where}[{number}]", tolerance)
        case ((int() | float()), (int() | float())) if not isinstance(before, bool):
            near = tolerance + ABSOLUTE + RELATIVE * max(abs(before), abs(after))
            same = after == before or (math.isnan(before) and math.isnan(after))  # equal infinities have no difference
            if not (same or abs(after - before) <= near):
                yield f"{where}: {before} -> {after}"
        case _:
            if before != after:
                yield f"{where}: {json.dumps(before)[:80]} -> {json.dumps(after)[:80]}"
