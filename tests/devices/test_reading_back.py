"""Files of other programs read back: the same numbers, or a line that says which is none."""

import re

import numpy as np
import pytest
from test_targets import TERMS, G, exported, unit

from tumblecal.devices import TARGETS, read_any
from tumblecal.ground.errors import InputError


@pytest.mark.parametrize("name", TARGETS)
def test_what_was_written_is_read_again(tmp_path, name):
    own = unit(TERMS)
    text, _ = exported(name, own)
    path = tmp_path / "file"
    path.write_text(text)
    back = read_any(f"{name}:{path}", G)
    part = TARGETS[name].carried(own)
    tolerance = 1e-6 if name == "vectornav" else 1e-7
    np.testing.assert_allclose(back.matrix, part.matrix, atol=tolerance, rtol=0)
    np.testing.assert_allclose(back.bias, part.bias, atol=tolerance, rtol=0)
    assert back.extra.get("terms", []) == (part.extra.get("terms", []))
    assert back.provenance["format"] == name


@pytest.mark.parametrize("name", TARGETS)
def test_files_that_are_none_are_one_line(tmp_path, name):
    path = tmp_path / "file"
    for text in ("hello", "{}", "[1]", "1 2 3", '{"matrix": 3}', "$VNWRG,25,1*00", "A = 1; b = 2", "axis,m_x\nx,1"):
        path.write_text(text)
        with pytest.raises(InputError, match=r"file: "):
            read_any(f"{name}:{path}")
    path.write_text("A = [0 0 0; 0 0 0; 0 0 0]; b = [1 2 3];")
    with pytest.raises(InputError, match="A cannot be inverted"):
        read_any(f"matlab:{path}")
    path.write_text("SM: [1e999, 0, 0, 0, 1, 0, 0, 0, 1]\nbias: [0, 0, 0]")
    with pytest.raises(InputError, match=r"not finite|cannot"):
        read_any(f"ros:{path}")
    with pytest.raises(InputError, match="formats: c-header"):
        read_any(f"px5:{path}")


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("px4", "1\t1\tCAL_ACC0_XOFF\t{}\t9\n"),
        ("ardupilot", "INS_ACCOFFS_X,{}\n"),
        ("ardupilot", "INS_ACCOFFS_X = {}\n"),
    ],
)
def test_an_offset_that_cannot_be_read_is_not_taken_for_none(tmp_path, name, line):
    path, key = tmp_path / "file", line.split("\t")[-3] if "\t" in line else "INS_ACCOFFS_X"
    text, _ = exported(name, unit())
    own = re.compile(rf"^.*{key}.*\n", re.MULTILINE)
    path.write_text(own.sub(line.format("0.5"), text))
    assert read_any(f"{name}:{path}", G).bias[0] == pytest.approx(0.5 / G)
    for value in ("nan", "0,00933", "abc", "-0.0072x41", "inf", "", "1e999"):
        path.write_text(own.sub(line.format(value), text))
        with pytest.raises(InputError, match=rf"file: {key}: '{value}\d*' is not a number"):
            read_any(f"{name}:{path}", G)
    path.write_text(own.sub("", text))
    with pytest.raises(InputError, match=rf"file: {key} is missing; add it to the file"):
        read_any(f"{name}:{path}", G)


@pytest.mark.parametrize("name", ["kalibr", "matlab", "ros", "c-header"])
def test_a_word_among_the_numbers_of_a_matrix_is_not_passed_over(tmp_path, name):
    (path := tmp_path / "file").write_text(exported(name, unit())[0])
    key = {"kalibr": "M:\n    - [", "matlab": "A = [", "ros": "SM: [", "c-header": "matrix[3][3] = {"}[name]
    for word in ("nan", "abc"):
        text = path.read_text()
        (tmp_path / "wrong").write_text(text.replace(key, f"{key}{word}, "))
        with pytest.raises(InputError, match=f"'{word}' in place of a number"):
            read_any(f"{name}:{tmp_path / 'wrong'}", G)
