"""Studies on a dask cluster: real schedulers and workers, foreign ones among them."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

import tumblecal
from tumblecal.errors import InputError
from tumblecal.simulation import cluster as cluster_module
from tumblecal.simulation.cluster import cluster
from tumblecal.simulation.run import run
from tumblecal.simulation.study_tables import read_study


distributed = pytest.importorskip("distributed")
SOURCE = Path(tumblecal.__file__).parent


@contextmanager
def process(module: str, *arguments: object, paths: tuple[Path, ...] = ()):
    """`python -m module`, killed at the end; `paths` go before this tumblecal."""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(map(str, (*paths, SOURCE.parent))),
        "JAX_PLATFORMS": "cpu",
    }
    command = [sys.executable, "-m", f"distributed.cli.dask_{module}", *map(str, arguments)]
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
    try:
        yield child
    finally:
        child.kill()
        child.wait()


@contextmanager
def scheduler(folder: Path):
    """A running scheduler: its address and process."""
    file = folder / "scheduler.json"
    with process("scheduler", "--port", 0, "--no-dashboard", "--scheduler-file", file) as child:
        while not file.exists() or not file.read_text().strip():
            assert child.poll() is None
            time.sleep(0.05)
        yield json.loads(file.read_text())["address"], child


def worker(address: str, name: str, *paths: Path):
    return process("worker", address, "--nthreads", 1, "--no-nanny", "--no-dashboard", "--name", name, paths=paths)


def wait_for(address: str, workers: int) -> None:
    with distributed.Client(address) as client:
        client.wait_for_workers(workers, timeout=60)


@pytest.fixture
def study(configs):
    return read_study(configs / "study_coverage.toml", "coverage", {"trials": 200_000})


@pytest.fixture(scope="module")
def changed(tmp_path_factory) -> Path:
    """A copy of this tumblecal whose noise is doubled."""
    folder = tmp_path_factory.mktemp("changed")
    shutil.copytree(SOURCE, folder / "tumblecal", ignore=shutil.ignore_patterns("__pycache__"))
    experiment = folder / "tumblecal" / "simulation" / "experiment.py"
    text = experiment.read_text()
    assert "return self.sd * white" in text
    experiment.write_text(text.replace("return self.sd * white", "return 2.0 * self.sd * white"))
    return folder


@pytest.fixture(scope="module")
def without(tmp_path_factory) -> Path:
    """A folder that hides tumblecal from a worker."""
    folder = tmp_path_factory.mktemp("without")
    (folder / "sitecustomize.py").write_text(
        "import sys\n"
        "class Hidden:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name.partition('.')[0] == 'tumblecal':\n"
        "            raise ModuleNotFoundError(f'No module named {name!r}', name='tumblecal')\n"
        "sys.meta_path.insert(0, Hidden())\n"
    )
    return folder


def test_foreign_workers_are_refused_by_name(tmp_path, study, changed, without, monkeypatch):
    with (
        scheduler(tmp_path) as (address, _),
        worker(address, "own"),
        worker(address, "changed", changed),
        worker(address, "without", without),
    ):
        wait_for(address, 3)
        with pytest.raises(InputError) as caught, cluster(study, scheduler=address) as computed:
            run(study, tmp_path / "out", computed=computed)
        versions, missing = sorted(caught.value.faults, key=lambda fault: "no tumblecal" in fault)
        own = cluster_module.maker()["versions"]["tumblecal"]
        assert "worker tcp://" in versions and f"against {own}" in versions and "it has no tumblecal" in missing
        assert not list((tmp_path / "out" / "chunks").glob("[0-9]*"))


def test_a_chunk_of_a_worker_that_came_later_is_refused(tmp_path, study, changed, monkeypatch):
    monkeypatch.setattr(cluster_module._Cluster, "_compare_workers", lambda _: None)
    with scheduler(tmp_path) as (address, _), worker(address, "changed", changed):
        wait_for(address, 1)
        with (
            pytest.raises(InputError, match=r"worker tcp://.* refused: chunk \d+: tumblecal .* against "),
            cluster(study, scheduler=address) as computed,
        ):
            run(study, tmp_path / "out", computed=computed)
    assert not list((tmp_path / "out" / "chunks").glob("[0-9]*"))


def test_no_workers_and_a_scheduler_that_dies_are_told(tmp_path, study, configs, monkeypatch):
    monkeypatch.setattr(cluster_module, "PATIENCE", 2.0)
    with scheduler(tmp_path) as (address, child):
        with pytest.raises(InputError, match="no worker is connected"), cluster(study, scheduler=address) as computed:
            run(study, tmp_path / "none", computed=computed)
        with worker(address, "own"):
            out = tmp_path / "killed"
            given = ("study", "coverage", configs / "study_coverage.toml", "--trials", 10**8, "--out", out)
            command = [sys.executable, "-m", "tumblecal.cli", *map(str, given), "--scheduler", address]
            running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            while running.poll() is None and not any(out.glob("chunks/[0-9]*.npz")):
                time.sleep(0.05)
            child.send_signal(signal.SIGKILL)
            killed = time.monotonic()
            _, told = running.communicate(timeout=60)
            assert time.monotonic() - killed < 20
    assert running.returncode == 2, told
    assert "the scheduler is gone" in told and "Traceback" not in told and "Cancelled" not in told
