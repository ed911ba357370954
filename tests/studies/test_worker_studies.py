"""Studies on one core, on all, and with workers of which one is killed: the same bits."""

import os
import signal
import subprocess
import sys

import pytest

from tumblecal.studies.run import run
from tumblecal.studies.study_tables import read_study


pytestmark = pytest.mark.usefixtures("fully_compiled")

TRIALS = 200_000  # four chunks


def test_one_core_all_cores_and_workers_of_which_one_is_killed_give_the_same_bytes(programs_kept, tmp_path, configs):
    distributed = pytest.importorskip("distributed")
    from tumblecal.studies.cluster import cluster

    study = read_study(configs / "study_coverage.toml", "coverage", {"trials": TRIALS})
    alone, _ = run(study, tmp_path / "alone")
    core = ["taskset", "-c", str(min(os.sched_getaffinity(0)))]
    command = [sys.executable, "-m", "tumblecal.cli", "study", "coverage", configs / "study_coverage.toml"]
    given = [*map(str, command), "--trials", str(TRIALS), "--workers", "1", "--out", str(tmp_path / "core")]
    subprocess.run([*core, *given], check=True, capture_output=True)

    killed = []

    def progress(_):
        if len(killed) == 1:
            pids = distributed.default_client().run(os.getpid)
            os.kill(next(iter(pids.values())), signal.SIGKILL)
        killed.append(True)

    with cluster(study, workers=2) as computed:
        shared, _ = run(study, tmp_path / "shared", computed=computed, progress=progress)
    assert len(killed) > 2
    assert shared == alone
    chunks = [f"chunks/{path.name}" for path in (tmp_path / "alone" / "chunks").glob("*.npz")]
    assert len(chunks) == 4
    for name in ("coverage.json", "coverage_parameters.parquet", *chunks):
        first = (tmp_path / "alone" / name).read_bytes()
        assert (tmp_path / "core" / name).read_bytes() == first == (tmp_path / "shared" / name).read_bytes(), name
