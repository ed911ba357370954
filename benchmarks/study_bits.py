"""Whether studies give the same bits on one core, on all cores and from a worker process, compared file by file.

    python benchmarks/study_bits.py                     all five kinds, a few minutes on two cores
    python benchmarks/study_bits.py --only coverage

Each way has a cache of compiled programs of its own, so that each compiles for itself.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path


CONFIGS = Path(__file__).resolve().parents[1] / "configs"
# What makes each kind small.
KINDS = {
    "coverage": ["--seed", "2", "--trials", "200000"],
    "linearization": ["--instruments", "1500"],
    "convergence": ["--runs", "150"],
    "sweep": ["--trials", "5000"],
    "power": ["--runs", "2"],
}
WAYS = {"one core": ("0", []), "all cores": (None, []), "a worker": (None, ["--workers", "1"])}


def outcome(kind: str, way: str, folder: Path) -> dict[str, bytes]:
    """Run a study; the bytes of all its files, figures left out."""
    cores, more = WAYS[way]
    out = folder / way.replace(" ", "_")
    command = [sys.executable, "-m", "tumblecal.cli", "study", kind, str(CONFIGS / f"study_{kind}.toml")]
    command += [*KINDS[kind], "--out", str(out), *more]
    if cores is not None:
        command = ["taskset", "-c", str(min(os.sched_getaffinity(0))), *command]
    environment = os.environ | {"TUMBLECAL_CACHE": str(folder / f"cache_{out.name}")}
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
    files = [*sorted((out / "chunks").glob("*.npz")), *sorted(out.glob("*.parquet")), out / f"{kind}.json"]
    return {str(path.relative_to(out)): path.read_bytes() for path in files}


def different(kind: str, folder: Path) -> dict[str, list[str]]:
    """By way: the files that are not as those of one core."""
    first, *others = (outcome(kind, way, folder) for way in WAYS)
    told = {}
    for way, files in zip(list(WAYS)[1:], others, strict=True):
        told[way] = sorted(name for name in first.keys() | files.keys() if first.get(name) != files.get(name))
    print(f"{kind}: {len(first)} files; different from one core: {told}", flush=True)
    return told


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=KINDS, action="append")
    failed = False
    for kind in parser.parse_args().only or KINDS:
        with tempfile.TemporaryDirectory() as folder:
            failed |= any(different(kind, Path(folder)).values())
    sys.exit(failed)


if __name__ == "__main__":
    main()
