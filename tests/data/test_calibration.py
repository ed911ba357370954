"""Calibration files, raw tables, and files that are whole or absent."""

import json
import os
import re
import stat
from dataclasses import replace

import numpy as np
import pytest

from tumblecal import InputError
from tumblecal.data.calibration import Calibration, read_calibration, write_calibration
from tumblecal.data.sensor_parameters import SENSOR, SensorParameters, triad_of
from tumblecal.ground.atomic import write_text, write_texts, written_aside


RNG = np.random.default_rng(4)


@pytest.fixture
def calibration():
    root = RNG.normal(size=(12, 12)) * 1e-4
    return Calibration(
        matrix=np.eye(3) + RNG.normal(size=(3, 3)) * 1e-3,
        bias=RNG.normal(size=3) * 1e-3,
        covariance=root @ root.T,
        alignment=np.eye(3),
        temperature_degc=23.5,
        serial_number="A-17",
        provenance={"data": "table.csv"},
        extra={"note": ["kept", 1]},
    )


def test_calibration_round_trip_is_bit_exact(tmp_path, calibration):
    path = tmp_path / "calibration.json"
    write_calibration(path, calibration)
    back = read_calibration(path)
    for name in ("matrix", "bias", "covariance", "alignment"):
        assert getattr(back, name).tobytes() == getattr(calibration, name).tobytes()
    assert (back.temperature_degc, back.serial_number) == (23.5, "A-17")
    assert back.provenance == calibration.provenance and back.extra == calibration.extra
    content = json.loads(path.read_text())
    assert content["schema"] == "tumblecal.calibration/1" and content["units"]["bias"] == "g"
    assert len(content["covariance_order"]) == 12


@pytest.fixture
def fitted(calibration):
    """With parameters, as the program writes it."""
    values = RNG.normal(size=9) * 1e-3
    own = SensorParameters((*SENSOR, "dtheta_x"), np.append(values, 0.01), 9e-6 * np.eye(10))
    return replace(calibration, matrix=np.linalg.inv(triad_of(values)), bias=values[3:6], parameters=own)


def test_what_is_not_determined_is_kept(tmp_path, fitted):
    path, own = tmp_path / "calibration.json", fitted.parameters
    write_calibration(path, fitted)
    assert "determined" not in json.loads(path.read_text())["parameters"]
    assert read_calibration(path).sensor.undetermined_words == ""
    write_calibration(path, replace(fitted, parameters=replace(own, undetermined=("gamma_21",))))
    assert json.loads(path.read_text())["parameters"]["determined"] == [name != "gamma_21" for name in own.names]
    back = read_calibration(path).sensor
    assert back.undetermined == ("gamma_21",) and back.undetermined_words == "gamma_21 (sd 3 mrad)"
    assert back.of(["dK_x"]).undetermined == ()


def changed(path, calibration, *keys, to):
    """A calibration file with one of its numbers changed by hand."""
    write_calibration(path, calibration)
    content = json.loads(path.read_text())
    table = content
    for key in keys[:-1]:
        table = table[key]
    table[keys[-1]] = to
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize(
    ("keys", "to", "words"),
    [
        (("bias", 1), 0.5, r"bias\.1: 0\.5 g, but parameters say"),
        (("parameters", "values", 5), -0.5, r"bias\.2: .* g, but parameters say -0\.5"),
        (("matrix", 0, 0), 1.1, r"matrix: its inverse has .* in row 1, column 1, but dK and gamma in parameters make"),
        (("parameters", "values", 8), 0.2, "matrix: its inverse has .* in row 3, column 2, .* parameters make"),
        (("parameters", "values", 0), -1.0, "matrix: its inverse has .* make 0: the file contradicts itself"),
        (("parameters", "names", 2), "foo", r"parameters\.names\.2: no parameter of a triad .*got 'foo'"),
        (("parameters", "names"), ["dK_x"], r"parameters: names: dK_y, .* missing"),
        (("parameters", "covariance", 3, 3), -1e-15, "parameters.covariance: no variance of a covariance may be neg"),
        (("parameters", "covariance", 0, 1), 1e-3, "parameters.covariance: a covariance must be symmetric"),
        (("parameters", "determined"), [True], "parameters: determined must be true or false for each"),
        (("matrix", 1, 1), True, r"matrix\.1\.1: must be a number \(got true\)"),
        (("matrix",), [[0.0] * 3] * 3, "matrix: a matrix with scales from 0 to 0 is not that of a triad"),
        (("bias", 2), 10**4000, r"bias\.2: must be a number \(got 1000"),
        (("units", "A"), "mg", "units: differs from the value that calibrate writes"),
    ],
)
def test_what_was_changed_by_hand_is_refused(tmp_path, fitted, keys, to, words):
    path = changed(tmp_path / "calibration.json", fitted, *keys, to=to)
    with pytest.raises(InputError, match=rf"^{re.escape(str(path))}: {words}"):
        read_calibration(path)


@pytest.mark.parametrize("scale", [1.0, 1e-3, 999.0, -1.0])
def test_rounding_to_float32_is_no_contradiction(tmp_path, fitted, scale):
    """Readings in another unit, or with the other sign, make scale factors far from 1: the file still is one."""
    values = fitted.parameters.values.copy()
    values[:3], values[3:6] = (1 + values[:3]) * scale - 1, values[3:6] * scale
    own = replace(fitted, matrix=np.linalg.inv(triad_of(values[:9])), bias=values[3:6])
    own = replace(
        own, matrix=own.matrix.astype(np.float32).astype(float), bias=own.bias.astype(np.float32).astype(float)
    )
    write_calibration(tmp_path / "c.json", replace(own, parameters=replace(fitted.parameters, values=values)))
    assert read_calibration(tmp_path / "c.json").sensor.values.tobytes() == values.tobytes()


def test_an_interrupted_file_is_absent_and_an_older_one_stays(tmp_path):
    path = tmp_path / "a.json"
    write_text(path, "old")
    for error in (KeyboardInterrupt, ValueError):
        with pytest.raises(error), written_aside(path) as aside:
            aside.write_text("half")
            raise error
        assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]
    with written_aside(path) as aside:
        aside.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new" and list(tmp_path.iterdir()) == [path]


def test_a_file_is_on_the_disk_before_its_name_and_its_name_before_the_return(tmp_path, monkeypatch):
    path, steps = tmp_path / "file.txt", []
    sync, rename = os.fsync, os.replace

    def synced(descriptor):
        steps.append("folder" if stat.S_ISDIR(os.fstat(descriptor).st_mode) else os.fstat(descriptor).st_size)
        sync(descriptor)

    def renamed(*paths):
        steps.append("rename")
        rename(*paths)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", renamed)
    write_text(path, "whole")
    assert steps == [5, "rename", "folder"] and path.read_text() == "whole"
    del steps[:]
    write_texts(tmp_path, {"file.txt": "longer", "other.txt": "ab"})
    assert {*steps[:2]} == {6, 2} and steps[2:] == ["rename", "rename", "folder"]
    assert {own.name: own.read_text() for own in tmp_path.iterdir()} == {"file.txt": "longer", "other.txt": "ab"}


def test_of_several_files_none_takes_its_name_before_all_are_whole(tmp_path):
    (tmp_path / "a").write_text("old")
    with pytest.raises(InputError, match="there: cannot be written"):
        write_texts(tmp_path, {"a": "new", "not/there": "x"})
    assert [own.name for own in tmp_path.iterdir()] == ["a"] and (tmp_path / "a").read_text() == "old"
