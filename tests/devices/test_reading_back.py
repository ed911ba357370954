"""Files of other programs read back: the same numbers, or a line that says which is none."""

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
