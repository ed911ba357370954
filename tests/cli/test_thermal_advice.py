"""Advice that `tumblecal thermal` prints works as pasted."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from thermal_instrument import Programme, instrument, recording, soak_means, write_recording


pytestmark = pytest.mark.usefixtures("few_effects")


FACES = np.concatenate([np.eye(3), -np.eye(3)])
EDGES = np.array([(1, 1, 0), (1, -1, 0), (0, 1, 1), (0, 1, -1), (1, 0, 1), (-1, 0, 1)]) / np.sqrt(2)
RAMP = Programme(10.0, ((40.0, 6.0),))


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def unit(**more):
    return instrument(np.random.default_rng(2), bias_order=1, **more)


def sampled(name: str, programme: Programme, force=FACES[2], rate_hz: float = 10.0) -> str:
    """A recording of one face at a programme; the name of its file."""
    rng = np.random.default_rng([*name.encode()])
    write_recording(name, *recording(rng, unit(), force, programme, rate_hz, noise_mg=0.5))
    return name


def pasted(outcome, pattern: str) -> list[str]:
    """The words of an advice in a message."""
    (advice,) = set(re.findall(pattern, " ".join(outcome.lines)))
    return shlex.split(advice)


@pytest.mark.long
def test_a_slow_log_of_six_faces_with_the_statement_that_it_was_at_rest(tumblecal):
    parts = [sampled(f"{k}.csv", RAMP, face, 0.25) for k, face in enumerate(FACES)]
    log = pl.concat([pl.read_csv(part).with_columns(pl.col("time_s") + 400 * k) for k, part in enumerate(parts)])
    log.write_csv("log.csv")
    refused = tumblecal("thermal", "log.csv", "--out", "a")
    assert refused.code == 2 and not Path("a").exists()
    outcome = tumblecal("thermal", "log.csv", "--out", "a", *pasted(refused, r"add (--means --noise-sd [\d.]+mg)"))
    assert outcome.code == 0, outcome.lines
    record = json.loads(Path("a/thermal.json").read_text())
    assert record["use"]["answer"] == "within" and record["orders"]["bias"] == 1
    assert "write a file for each attitude" in " ".join(refused.lines)


def soaks(name: str, *levels: float, faces=FACES, square: float = 0.0) -> list[str]:
    """Tables of means of faces, one for each soak, which are set again for each; the names of their files."""
    columns = soak_means(np.random.default_rng(6), unit(), faces, levels, noise_mg=0.1)
    values = columns["readings"] + square * columns["readings"] ** 2
    table = pl.DataFrame({f"a{axis}_g": values[:, k] for k, axis in enumerate("xyz")})
    table = table.with_columns(temperature_degc=columns["temperature_degc"])
    files = [f"{name}{k}.csv" for k in range(len(levels))]
    for k, file in enumerate(files):
        # In random order, so that no drift makes the same signal.
        table[k * len(faces) : (k + 1) * len(faces)].sample(fraction=1, shuffle=True, seed=k).write_csv(file)
    return files


OF_MEANS = ("--means", "--noise-sd", "0.1mg")


@pytest.mark.long
def test_the_cause_of_a_refusal_is_found_by_the_command_that_is_printed(tumblecal):
    files = soaks("bent", 10, 25, 40, faces=np.concatenate([FACES, EDGES]), square=4e-3)
    outcome = tumblecal("thermal", *files, *OF_MEANS, "--out", "made")
    assert outcome.code == 3
    (command,) = [line.strip() for line in outcome.out.splitlines() if line.strip().startswith("tumblecal ")]
    assert command == "tumblecal diagnose made/bins.csv"
    assert tumblecal(*shlex.split(command)[1:], "--no-figures", "--out", "cause").code in (0, 3)
    assert "second_order" in Path("cause/diagnosis.json").read_text()
