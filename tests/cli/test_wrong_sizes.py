"""Readings that are not those of a triad at rest: one sentence, the same from each command that reads positions."""

import shlex

import numpy as np
import pytest

from tumblecal.data.calibration import Calibration, write_calibration


pytestmark = pytest.mark.usefixtures("few_effects")


WRONG = {
    "gravity-compensated": (lambda a: a - [0, 0, 1], "1 g was subtracted from axis z"),
    "wrong range": (lambda a: 8 * a, "8 times the force, as with a wrong full-scale range"),
    "wrong scale": (lambda a: 0.68 * a, "the readings have a size of about 0.68"),
}


def directions(count):
    force = np.random.default_rng(4).normal(size=(count, 3))
    return force / np.linalg.norm(force, axis=1)[:, None]


def write_rows(path, readings, head, *, first=None):
    names = [f"{first}{k}" if first else str(k / 20) for k in range(len(readings))]
    rows = [f"{name}," + ",".join(f"{x:.6f}" for x in own) for name, own in zip(names, readings, strict=True)]
    path.write_text("\n".join([*head, *rows]) + "\n")
    return path


@pytest.mark.parametrize(("wrong", "words"), WRONG.values(), ids=WRONG)
def test_every_command_names_a_wrong_size(tumblecal, tmp_path, wrong, words):
    readings = wrong(directions(24) * [1.01, 0.99, 1.0] + [0.02, -0.01, 0.03])
    head = ["# attitudes: unknown", "position,ax_g,ay_g,az_g"]
    positions = write_rows(tmp_path / "set.csv", readings, head, first="p")
    calibration = tmp_path / "calibration.json"
    write_calibration(calibration, Calibration(np.eye(3), np.array([0.02, -0.01, 0.03]), np.eye(12) * 1e-8))
    for arguments in (("calibrate", positions), ("diagnose", positions), ("check", calibration, positions, "--means")):
        outcome = tumblecal(*arguments, "--noise-sd", "0.1mg", "--out", tmp_path / "out")
        assert outcome.code == 2 and len(outcome.lines) == 1 and words in outcome.lines[0], outcome
        assert not (tmp_path / "out").exists()
    outcome = tumblecal("reduce", positions, "--means", "--out", tmp_path / "out")
    assert outcome.code == 0 and any(words in line for line in outcome.lines), outcome


def test_moving_rows_are_refused_with_a_command_that_works(tumblecal, tmp_path, monkeypatch):
    """Waved by hand, each sample a row of `reduce --means`: warned of there, refused before both fits."""
    monkeypatch.chdir(tmp_path)
    force = directions(100)
    readings = force + 0.3 * np.random.default_rng(5).normal(size=force.shape)
    write_rows(tmp_path / "log.csv", readings, ["time,ax_g,ay_g,az_g"])
    outcome = tumblecal("reduce", "log.csv", "--means", "--out", "reduced")
    assert outcome.code == 0 and any("the triad was not at rest" in line for line in outcome.lines), outcome
    for command in ("calibrate", "diagnose"):
        outcome = tumblecal(command, "reduced/positions.csv", "--out", "out")
        assert outcome.code == 2 and len(outcome.lines) == 1
        assert "the triad was not at rest" in outcome.lines[0], outcome
    suggested = shlex.split(outcome.lines[0].partition("run: ")[2])
    assert suggested == ["tumblecal", "reduce", "log.csv", "--static"]
    assert "no interval at rest" in tumblecal(*suggested[1:], "--no-figures").lines[-1]
