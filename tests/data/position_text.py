"""Position files as text, good rows of them, and what is refused of a file."""

import pytest

from tumblecal import InputError
from tumblecal.data import read_positions


HEADER = "position,alpha_deg,beta_deg,ax_g,ay_g,az_g"
ROWS = ("a,0,0,0.001,0.002,1.0", "b,90,0,0.001,1.0,0.003", "c,0,45,-0.7,0.001,0.7")


def written(path, *lines):
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def faults(path) -> tuple[str, ...]:
    with pytest.raises(InputError) as refused:
        read_positions(path)
    assert all("\n" not in fault and str(path) in fault for fault in refused.value.faults)
    return refused.value.faults
