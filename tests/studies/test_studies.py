"""Studies: their files, their resumption after kill -9, their statistics against independent truth."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from tumblecal.estimation import harmonic, kalman, problem_of
from tumblecal.ground.errors import InputError
from tumblecal.studies.chunk import packed, statement, study_hash
from tumblecal.studies.convergence import CHUNK, Convergence
from tumblecal.studies.linearization import Linearization, crossing
from tumblecal.studies.run import run
from tumblecal.studies.store import Store
from tumblecal.studies.study_tables import read_study
from tumblecal.studies.sweep import Sweep, points_of


def written(folder: Path, text: str) -> Path:
    path = folder / "study.toml"
    path.write_text(text)
    return path


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "tumblecal.cli", *map(str, arguments)]


def test_all_faults_of_a_study_are_told_at_once(tmp_path):
    (tmp_path / "rig.toml").write_text('schema = "tumblecal.rig/1"\n[plan]\nalpha_deg = [0]\n')
    path = written(
        tmp_path,
        'schema = "tumblecal.study.coverage/1"\nrig = "rig.toml"\ntrials = "many"\ncolour = 1\n'
        '[noise]\nsd = "0.1"\nrate = "5 mg"\n[truth.spread]\ndK = "1 mg"\n',
    )
    with pytest.raises(InputError) as caught:
        read_study(path, "coverage")
    told = "\n".join(caught.value.faults)
    for place in ("trials", "colour", "noise.sd", "noise.rate", "plan"):
        assert place in told


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ('[truth.spread]\ndK = "1 mg"', "truth.spread.dK"),
        ('[noise]\nsd = "1 mg"\nwhite = "1 mg"', "give one of"),
        ("[inject]\nsecond_order.q = true", "inject"),
    ],
)
def test_a_fault_is_told_with_its_path(tmp_path, configs, text, word):
    head = f'schema = "tumblecal.study.coverage/1"\nrig = "{configs / "paper24.toml"}"\ntrials = 10\n'
    with pytest.raises(InputError, match=word):
        read_study(written(tmp_path, head + text), "coverage")


def test_a_study_killed_at_any_moment_goes_on_to_the_same_result(tmp_path, configs):
    study = configs / "study_coverage.toml"
    given = ("study", "coverage", study, "--trials", 330_000, "--out")
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    subprocess.run(command(*given, whole), check=True, capture_output=True)
    process = subprocess.Popen(command(*given, killed), stdout=subprocess.DEVNULL)
    chunks = killed / "chunks"
    while process.poll() is None and not (chunks.is_dir() and any(chunks.glob("[0-9]*.npz"))):
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    finished = len(list(chunks.glob("[0-9]*.npz")))
    assert finished >= 1 and not (killed / "coverage.json").exists()
    (chunks / "00000004.npz").write_bytes(b"cut off")
    kept = (chunks / "00000000.npz").stat().st_mtime_ns
    subprocess.run(command(*given, killed), check=True, capture_output=True)
    assert (chunks / "00000000.npz").stat().st_mtime_ns == kept
    for name in ("coverage.json", "coverage_parameters.parquet", "coverage.svg"):
        assert (whole / name).read_bytes() == (killed / name).read_bytes()
    content = json.loads((whole / "coverage.json").read_text())
    assert content["schema"] == "tumblecal.study.coverage/1" and content["path"] == "harmonic"
    assert content["trials"] == 330_000 and content["failed"] == 0
    n = content["trials"]
    assert abs(content["chi2_mean"] - 57) < 5 * np.sqrt(2 * 57 / n)
    rows = pl.read_parquet(whole / "coverage_parameters.parquet")
    assert np.all(np.abs((rows["bias"] / rows["bias_se"]).to_numpy()) < 5)
    assert np.all(np.abs(rows["covered_95_stated"].to_numpy() - 0.95) < 5 * np.sqrt(0.95 * 0.05 / n))

    other = subprocess.run(command(*given[:4], 500_000, "--out", killed), capture_output=True, text=True)
    assert other.returncode == 2 and "another study" in other.stderr and "Traceback" not in other.stderr


@pytest.mark.skipif(not shutil.which("taskset"), reason="keeps a process on one core")
def test_one_core_all_cores_and_a_worker_give_the_same_bytes(tmp_path, configs):
    pytest.importorskip("distributed")
    given = command("study", "coverage", configs / "study_coverage.toml", "--seed", 2, "--trials", 65_536, "--out")
    for cores in (1, 2):
        on = ["taskset", "-c", ",".join(map(str, sorted(os.sched_getaffinity(0))[:cores]))]
        subprocess.run([*on, *given, str(tmp_path / str(cores))], check=True, capture_output=True)
    subprocess.run([*given, str(tmp_path / "worker"), "--workers", "1"], check=True, capture_output=True)
    for name in ("coverage.json", "coverage_parameters.parquet", "chunks/00000000.npz"):
        first = (tmp_path / "1" / name).read_bytes()
        assert (tmp_path / "2" / name).read_bytes() == first == (tmp_path / "worker" / name).read_bytes(), name


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


def test_too_large_a_study_is_refused_before_it_starts(tmp_path, configs):
    study = configs / "study_sweep.toml"
    given = ("study", "sweep", study, "--trials", 10**12, "--out", tmp_path / "out")
    told = subprocess.run(command(*given), capture_output=True, text=True)
    assert told.returncode == 2 and "--max-hours" in told.stderr and "chunks" in told.stdout
    assert not (tmp_path / "out").exists()
    dry = subprocess.run(
        command("study", "sweep", study, "--out", tmp_path / "out", "--dry-run"), capture_output=True, text=True
    )
    assert dry.returncode == 0 and "240000 trials in 12 chunks" in dry.stdout and not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def convergence(configs) -> Convergence:
    changes = {"runs": 100, "data_sets": 40, "methods": ["single", "mean", "kalman", "iterated", "exact"]}
    return Convergence(
        read_study(configs / "study_convergence.toml", "convergence", changes | {"prior_sd": [0.01, 1e-3]})
    )


def test_batched_kalman_is_the_recursion(convergence):
    import jax
    import jax.numpy as jnp

    generator = np.random.default_rng(0)
    z = convergence.ideal[:, None] + 1e-3 * generator.normal(size=(6, len(convergence.ideal), CHUNK))
    truth, filters = jnp.zeros((15, CHUNK)), convergence._first_filters()
    estimates = jax.jit(convergence._estimates)
    prior = kalman.Prior(1e-3)
    place = [label for label, _, _ in convergence.methods].index("kalman, prior sd 0.001")
    history, _ = kalman.run(z[:, :, 5] - convergence.ideal, convergence.design, np.diag(convergence.variance), prior)
    total = jnp.zeros(z.shape[1:])
    for step in range(6):
        total = total + z[step]
        filters, errors, _, nis, _ = estimates(step + 1.0, jnp.asarray(z[step]), total, filters, truth)
        np.testing.assert_allclose(errors[place, :, 5], history.values[step], rtol=0, atol=1e-12)
        np.testing.assert_allclose(nis[place, 5], history.nis[step], rtol=1e-7)


def test_convergence_statistics(convergence):
    result, frames = convergence.summary([convergence.compute(0)])
    errors = frames["errors"].filter(pl.col("parameter") == "dK_y")
    rms = {m: errors.filter(pl.col("method") == m)["rms"].to_numpy() for m in result["methods"]}
    # sqrt(N) for the means, none for the single sets; 100 runs give the rms to 7 %, so 5 sd.
    assert rms["mean"][-1] == pytest.approx(rms["mean"][0] / np.sqrt(40), rel=0.5)
    assert rms["single"][-1] == pytest.approx(rms["single"][0], rel=0.5)
    last = frames["consistency"].filter(pl.col("data_sets") == 40)
    for method in ("single", "exact", "iterated, prior sd 0.01"):
        nees = last.filter(pl.col("method") == method)["nees"].item()
        assert abs(nees - 15) < 5 * np.sqrt(2 * 15 / 100), method
    nis = last.filter(pl.col("method") == "kalman, prior sd 0.01")["nis"].item()
    assert abs(nis - 27) < 5 * np.sqrt(2 * 27 / 100)
    exact = frames["needed"].filter((pl.col("method") == "exact") & (pl.col("threshold") == 1e-4))
    assert exact["median"].max() <= 40 and result["settled"]["exact"]["1e-05"]["median_data_sets"] is None


def test_correlated_means_from_dwell_to_dwell_have_the_exact_covariance():
    import jax

    from tumblecal.noise import GaussMarkov, Noise, RandomWalk, White, regular_dwells
    from tumblecal.simulation.noise_steps import noise_steps

    one = np.array([1.0, 2.0, 0.5])
    noise = Noise((White(3 * one), GaussMarkov(one, 4.0), GaussMarkov(2 * one, 300.0), RandomWalk(0.1 * one)))
    dwells = regular_dwells(5, dwell_s=10.0, move_s=3.0, rate_hz=5.0)
    steps, lanes = noise_steps(noise, dwells), 40_000
    state = steps.first(jax.random.key(0), lanes)
    _, means = jax.jit(lambda s: steps.dwells(s, jax.random.key(1), 5))(state)
    expected = noise.mean_covariance(dwells)
    for axis in range(3):
        values = np.asarray(means)[:, axis]
        scale = np.sqrt(np.outer(np.diag(expected[axis]), np.diag(expected[axis])))
        assert np.max(np.abs(values @ values.T / lanes - expected[axis]) / scale) < 5 * np.sqrt(2 / lanes)


def test_linear_bias_is_that_of_the_single_fit(configs):
    changes = {"instruments": 4, "sizes": 3, "smallest": "1 mrad", "largest": "10 mrad"}
    study = Linearization(read_study(configs / "study_linearization.toml", "linearization", changes))
    chunks = [study.compute(chunk) for chunk in range(study.chunks)]
    assert all(np.all(chunk["count"] == 4) for chunk in chunks)
    result, frames = study.summary(chunks)
    for slopes in result["slopes"].values():
        assert all(abs(slope - 2) < 0.05 for slope in slopes.values())
    # Pitch errors alone are exact in the small-angle chain: its first-order mount is then the exact one.
    pitch = frames["biases"].filter((pl.col("case") == "pitch") & (pl.col("path") == "small angle"))
    assert pitch["rms_bias"].to_numpy().max() < 1e-12
    assert len(result["answers"]) == 4 * 2 * 4


def test_linear_bias_of_one_instrument(configs):
    """Against `harmonic.fit` on readings of the exact chain, the study's own draw repeated."""
    import jax

    from tumblecal.chain.rig_file import read_rig
    from tumblecal.data import PositionSet
    from tumblecal.simulation.experiment import BLOCK

    changes = {"instruments": 2, "sizes": 3, "smallest": "1 mrad", "largest": "10 mrad", "seed": 5}
    study = Linearization(read_study(configs / "study_linearization.toml", "linearization", changes))
    chunk = 2  # the first case (mount), its largest size
    found = study.compute(chunk)
    key = jax.random.fold_in(jax.random.key(5), 0)
    spread = np.zeros(15)
    spread[6:9] = 0.01
    truth = spread[:, None] * np.asarray(jax.random.normal(key, (15, BLOCK)))[:, :2]
    rig = read_rig(configs / "paper24.toml")
    biases = []
    for column in truth.T:
        readings = np.asarray(rig.chain(rig.where).at(column)(rig.where))
        plan = rig.plan
        data = PositionSet(plan.names, np.array(plan.alpha_deg), np.array(plan.beta_deg), readings)
        biases.append(harmonic.fit(problem_of(data)).values - column)
    np.testing.assert_allclose(found["bias"][0], np.sum(biases, axis=0), rtol=0, atol=1e-13)


def test_raw_samples_and_drawn_means_agree(tmp_path, configs):
    head = f'schema = "tumblecal.study.coverage/1"\nrig = "{configs / "paper24.toml"}"\ntrials = 320\nseed = 3\n'
    noise = '[noise]\nwhite = "0.5 mg"\nrandom_walk = "0.02 mg"\nquantisation = "0.2 mg"\n'
    path = written(tmp_path, head + noise + 'rate = "10 Hz"\ndwell = "4 s"\nmove = "1 s"\n')
    sds = []
    for changes in ({"raw": True}, {}):
        study = read_study(path, "coverage", changes)
        content, frames = run(study, tmp_path / str(len(sds)))
        assert content["trials"] == 320 and content["failed"] == 0
        sds.append(frames["parameters"]["sd"].to_numpy())
    # Two samples of 320: the ratio of their sds has a relative sd of sqrt(1/320); 15 of them, 5 sd.
    assert np.max(np.abs(sds[0] / sds[1] - 1)) < 5 * np.sqrt(1 / 320)


def test_crossing_is_found_on_logarithmic_axes():
    sizes = np.geomspace(1e-3, 1e-1, 9)
    assert crossing(sizes, 3 * sizes**2, 3e-4) == pytest.approx(1e-2, rel=1e-9)
    assert crossing(sizes, 3 * sizes**2, 1.0) is None
    assert crossing(sizes, 3 * sizes**2, 1e-9) == sizes[0]


def test_sweep_points_are_coverage_studies(tmp_path, configs):
    study = read_study(configs / "study_sweep.toml", "sweep", {"trials": 2000})
    points = points_of(study)
    assert len(points) == 12 and points[1][0] == {"rig.noise.sd": "0.05 mg", "study.inject.second_order.y": 0.1}
    assert points[1][1]["study"]["inject"] == {"second_order.y": 0.1}
    study["study"]["grid"] = {"rig.noise.sd": ["0.1 mg", "oops"], "rig.plan.gamma_deg": [1], "beta": [2]}
    with pytest.raises(InputError) as caught:
        points_of(study)
    told = "\n".join(caught.value.faults)
    assert "noise.sd" in told and "plan.gamma_deg" in told and "grid.beta" in told


def test_a_sweep_runs_its_points_in_order(tmp_path, configs):
    study = read_study(configs / "study_sweep.toml", "sweep", {"trials": 2000})
    study["study"]["grid"] = {"study.inject.second_order.y": [0, 1.0]}
    content, frames = run(study, tmp_path, study=Sweep(study))
    quiet, loud = (point["chi2_mean"] for point in content["points"])
    assert abs(quiet - 57) < 5 * np.sqrt(2 * 57 / 2000) and loud > 100
    assert len(frames["parameters"]) == 30 and (tmp_path / "sweep_parameters.parquet").exists()


@pytest.mark.skipif(os.name != "posix", reason="kills a process")
def test_a_worker_killed_under_a_study_changes_no_bit(tmp_path, configs):
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


def test_no_scheduler_is_told_in_one_line(configs):
    pytest.importorskip("distributed")
    from tumblecal.studies.cluster import cluster

    with pytest.raises(InputError, match="--scheduler"), cluster({}, scheduler="nonsense://1"):
        pass


def test_power_is_nothing_at_size_zero_and_all_at_a_gross_one(configs):
    from tumblecal.studies.power import Power

    study = read_study(configs / "study_power.toml", "power", {"runs": 2})
    study["study"]["effects"] = {"second_order.z": [0, 5.0]}
    power = Power(study)
    assert power.chunks == 2 and power.trials == 4
    _, frames = power.summary([power.compute(chunk) for chunk in range(2)])
    quiet, loud = frames["rates"].iter_rows(named=True)
    assert loud["detected"] == loud["named"] == 1.0 and quiet["failed"] == loud["failed"] == 0
    assert quiet["named_alone"] == 0.0 and quiet["unit"] == "mg/g^2"
