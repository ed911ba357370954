"""Studies on a dask cluster; real schedulers and workers, foreign ones among them, in the long job."""

import importlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from test_chunks import Squares

import tumblecal
from tumblecal.ground.errors import InputError
from tumblecal.studies import cluster as cluster_module
from tumblecal.studies import worker_watch
from tumblecal.studies.chunk import maker
from tumblecal.studies.cluster import cluster
from tumblecal.studies.run import run
from tumblecal.studies.study_tables import read_study


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
def scheduler(folder: Path, *paths: Path):
    """A running scheduler: its address and process."""
    file = folder / "scheduler.json"
    given = ("--port", 0, "--no-dashboard", "--scheduler-file", file)
    with process("scheduler", *given, paths=(folder, *paths)) as child:
        while not file.exists() or not file.read_text().strip():
            assert child.poll() is None
            time.sleep(0.05)
        yield json.loads(file.read_text())["address"], child


def worker(address: str, name: str, *paths: Path):
    return process("worker", address, "--nthreads", 1, "--no-nanny", "--no-dashboard", "--name", name, paths=paths)


def wait_for(address: str, workers: int) -> None:
    with distributed.Client(address) as client:
        client.wait_for_workers(workers, timeout=600)


@pytest.fixture
def study(configs):
    return read_study(configs / "study_coverage.toml", "coverage")


@pytest.fixture(scope="module")
def changed(tmp_path_factory) -> Path:
    """A copy of this tumblecal whose noise is doubled."""
    folder = tmp_path_factory.mktemp("changed")
    shutil.copytree(SOURCE, folder / "tumblecal", ignore=shutil.ignore_patterns("__pycache__"))
    experiment = folder / "tumblecal" / "simulation" / "experiment.py"
    text = experiment.read_text()
    line = "return factor[:, :, None] * white"
    assert line in text
    experiment.write_text(text.replace(line, line.replace("return", "return 2.0 *")))
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


@pytest.mark.long
def test_foreign_workers_are_refused_by_name(tmp_path, study, changed, without):
    with (
        scheduler(tmp_path) as (address, _),
        worker(address, "own"),
        worker(address, "changed", changed),
        worker(address, "without", without),
    ):
        wait_for(address, 3)
        with pytest.raises(InputError) as caught, cluster(study, scheduler=address) as computed:
            next(computed([0]))
    versions, missing = sorted(caught.value.faults, key=lambda fault: "no tumblecal" in fault)
    own = maker()["versions"]["tumblecal"]
    assert "worker tcp://" in versions and f"against {own}" in versions and "it has no tumblecal" in missing


class Thirty(Squares):
    """A study of thirty chunks, whose numbers are those of the workers in the test below."""

    chunks = trials = 30

    def compute(self, chunk):
        return {"square": np.array([float(chunk)]), "trials": np.array(1.0)}


def work(folder: Path, name: str, lines: str) -> Callable:
    """A function for workers, in a module of its own."""
    head = "import os, time\nimport numpy\n"
    (folder / f"{name}.py").write_text(f"{head}def compute(text, chunk):\n{lines}")
    return importlib.import_module(name).compute


@pytest.mark.long
def test_a_stopped_and_a_killed_worker_are_told_and_the_study_ends(tmp_path, study, monkeypatch):
    monkeypatch.setattr(worker_watch, "SILENT_S", 3.0)
    monkeypatch.syspath_prepend(tmp_path)
    slow = "    time.sleep(0.2)\n    return {'trials': numpy.array(1.0), 'square': numpy.array([float(chunk)])}\n"
    compute = work(tmp_path, "slow_work", slow)
    told, done = [], []
    with (
        scheduler(tmp_path) as (address, _),
        worker(address, "steady", tmp_path),
        worker(address, "stopped", tmp_path) as stopped,
        worker(address, "killed", tmp_path) as killed,
    ):
        wait_for(address, 3)

        def progress(trials):
            done.append(trials)
            if len(done) == 4:
                os.kill(stopped.pid, signal.SIGSTOP)
                killed.kill()

        def tell(line):
            told.append(line)
            if "has not responded for 3 s" in line:
                os.kill(stopped.pid, signal.SIGCONT)

        with cluster(study, scheduler=address, compute=compute) as computed:
            content, _ = run(
                study, tmp_path / "out", study=Thirty(study), computed=computed, progress=progress, tell=tell
            )
    assert content["sum"] == sum(range(30))
    # On a busy machine the steady worker may be silent for a while too.
    gone, silent, again = (
        sum(words in line for line in told) for words in ("is gone", "has not responded", "answers again")
    )
    assert gone == 1 and silent >= 1 and again >= 1


def test_processes_started_here_listen_to_this_machine_alone():
    with cluster_module._local(1) as local:
        addresses = [local.scheduler_address, *local.scheduler.identity()["workers"]]
    assert all(address.startswith("tcp://127.0.0.1:") for address in addresses)


@pytest.mark.long
def test_no_workers_and_a_scheduler_that_dies_are_told(tmp_path, study, monkeypatch):
    monkeypatch.setattr(cluster_module, "PATIENCE", 2.0)
    monkeypatch.syspath_prepend(tmp_path)
    compute = work(tmp_path, "cheap_work", "    return {'chunk': numpy.array([float(chunk)])}\n")
    with scheduler(tmp_path) as (address, child):
        with pytest.raises(InputError, match="no worker is connected"), cluster(study, scheduler=address) as computed:
            next(computed([0]))
        with worker(address, "own", tmp_path), cluster(study, scheduler=address, compute=compute) as computed:
            wait_for(address, 1)
            chunks = computed(list(range(10)))
            next(chunks)
            child.kill()
            with pytest.raises(InputError, match="the scheduler is gone"):
                list(chunks)
