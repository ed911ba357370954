"""Studies with workers: the same bits as without, one of them killed or not."""

import os
import signal
import subprocess
import sys

import pytest

from tumblecal.studies.run import run
from tumblecal.studies.study_tables import read_study


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "tumblecal.cli", *map(str, arguments)]


def test_one_core_all_cores_and_a_worker_give_the_same_bytes(tmp_path, configs):
    pytest.importorskip("distributed")
    given = command("study", "coverage", configs / "study_coverage.toml", "--trials", 65_536, "--out")
    for cores in (1, 2):
        on = ["taskset", "-c", ",".join(map(str, sorted(os.sched_getaffinity(0))[:cores]))]
        subprocess.run([*on, *given, str(tmp_path / str(cores))], check=True, capture_output=True)
    subprocess.run([*given, str(tmp_path / "worker"), "--workers", "1"], check=True, capture_output=True)
    for name in ("coverage.json", "coverage_parameters.parquet", "chunks/00000000.npz"):
        first = (tmp_path / "1" / name).read_bytes()
        assert (tmp_path / "2" / name).read_bytes() == first == (tmp_path / "worker" / name).read_bytes(), name


def test_a_worker_killed_under_a_study_changes_no_bit(programs_kept, tmp_path, configs):
    distributed = pytest.importorskip("distributed")
    from tumblecal.studies.cluster import cluster

    study = read_study(configs / "study_coverage.toml", "coverage", {"trials": 400_000})
    alone, _ = run(study, tmp_path / "alone")
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
    for name in ("coverage.json", "coverage_parameters.parquet"):
        assert (tmp_path / "alone" / name).read_bytes() == (tmp_path / "shared" / name).read_bytes()
