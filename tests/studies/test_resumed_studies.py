"""Studies on one core, on all, on a worker, and killed and begun again: the same bytes."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import polars as pl
import pytest

from tumblecal.ground.errors import InputError
from tumblecal.studies.chunk import packed, statement, study_hash
from tumblecal.studies.run import run
from tumblecal.studies.store import Store
from tumblecal.studies.study_tables import read_study


pytestmark = pytest.mark.usefixtures("fully_compiled")

TRIALS = 200_000  # four chunks


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "tumblecal.cli", *map(str, arguments)]


@pytest.fixture(scope="module")
def one_core(tmp_path_factory, configs):
    """The study's folder, made by a process that has one core."""
    folder = tmp_path_factory.mktemp("core")
    core = ["taskset", "-c", str(min(os.sched_getaffinity(0)))]
    given = ("study", "coverage", configs / "study_coverage.toml", "--trials", TRIALS, "--workers", 1, "--out", folder)
    subprocess.run([*core, *command(*given)], check=True, capture_output=True)
    return folder


def same_bytes(one, other) -> None:
    chunks = [f"chunks/{path.name}" for path in (one / "chunks").glob("*.npz")]
    assert len(chunks) == 4
    for name in ("coverage.json", "coverage_parameters.parquet", *chunks):
        assert (one / name).read_bytes() == (other / name).read_bytes(), name


@pytest.mark.long
@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.long)])
def test_one_core_all_cores_and_workers_of_which_one_is_killed_give_the_same_bytes(
    one_core, tmp_path, configs, workers
):
    """In CI one worker, which remains."""
    distributed = pytest.importorskip("distributed")
    from tumblecal.studies.cluster import cluster

    study, finished = read_study(configs / "study_coverage.toml", "coverage", {"trials": TRIALS}), []

    def progress(_):
        finished.append(True)
        if len(finished) == 2 and workers == 2:
            pids = distributed.default_client().run(os.getpid)
            os.kill(next(iter(pids.values())), signal.SIGKILL)

    if workers == 2:
        run(study, tmp_path / "alone")
        same_bytes(one_core, tmp_path / "alone")
    with cluster(study, workers=workers) as computed:
        run(study, tmp_path / "shared", computed=computed, progress=progress)
    assert len(finished) > 2
    same_bytes(one_core, tmp_path / "shared")


def test_a_study_killed_at_any_moment_goes_on_to_the_same_result(tumblecal, one_core, tmp_path, configs):
    given = ("study", "coverage", configs / "study_coverage.toml", "--trials", TRIALS, "--out")
    killed = tmp_path / "killed"
    process = subprocess.Popen(command(*given, killed), stdout=subprocess.DEVNULL)
    chunks = killed / "chunks"
    while process.poll() is None and not (chunks.is_dir() and any(chunks.glob("[0-9]*.npz"))):
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert any(chunks.glob("[0-9]*.npz")) and not (killed / "coverage.json").exists()
    (chunks / "00000003.npz").write_bytes(b"cut off")
    kept = (chunks / "00000000.npz").stat().st_mtime_ns
    subprocess.run(command(*given, killed), check=True, capture_output=True)
    assert (chunks / "00000000.npz").stat().st_mtime_ns == kept
    same_bytes(one_core, killed)
    content = json.loads((one_core / "coverage.json").read_text())
    assert content["path"] == "harmonic" and content["trials"] == TRIALS and content["failed"] == 0
    assert abs(content["chi2_mean"] - 57) < 5 * np.sqrt(2 * 57 / TRIALS)
    rows = pl.read_parquet(one_core / "coverage_parameters.parquet")
    assert np.all(np.abs((rows["bias"] / rows["bias_se"]).to_numpy()) < 5)
    assert np.all(np.abs(rows["covered_95_stated"].to_numpy() - 0.95) < 5 * np.sqrt(0.95 * 0.05 / TRIALS))

    other = tumblecal(*given[:4], 500_000, "--out", killed)
    assert other.code == 2 and len(other.lines) == 1 and "another study" in other.lines[0]


def test_a_folder_is_one_study_s_at_a_time(tmp_path, configs):
    study = read_study(configs / "study_coverage.toml", "coverage")
    first = Store(tmp_path, study, 2)
    (tmp_path / "chunks" / ".00000000.npz.abc.npz").write_bytes(b"left by a killed process")
    with pytest.raises(InputError, match="another process"):
        Store(tmp_path, study, 2)
    first.put(1, packed(statement(study_hash(study), 1), {"a": np.arange(3)}))
    first.close()
    again = Store(tmp_path, study, 2)
    again.close()
    assert again.missing() == [0] and [path.name for path in (tmp_path / "chunks").iterdir()] == ["00000001.npz"]
