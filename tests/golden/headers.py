"""Sixty headers of loggers as files: the right columns, a question, or a refusal."""

from pathlib import Path

import numpy as np
from recording_headers import HEADERS, columns_of, renamed, shuffled

from commands import run


CHOSEN = HEADERS[:: max(len(HEADERS) // 60, 1)][:60]


def answers(folder: Path) -> dict[str, object]:
    """For each header the exit code of `import`, and the mean size of the readings in g if they were read."""
    import polars as pl

    found: dict[str, object] = {}
    for number, header in enumerate(CHOSEN):
        rng = np.random.default_rng(number)
        cells, _ = columns_of(header, rng, 20.0, 8)
        names, order = renamed(header, rng), shuffled(header, rng)
        path, out = folder / f"{number}.csv", folder / f"{number}.parquet"
        rows = zip(*(cells[k] for k in order), strict=True)
        lines = [
            header.separator.join(names[k] for k in order),
            *(header.separator.join(map(str, row)) for row in rows),
        ]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        code = run(f"import {path} --rate 20 --out {out}")
        columns = [name for name in pl.read_parquet_schema(out)] if out.exists() else None
        found[f"{number} {header.source}"] = [code, columns]
    return found
