"""Raw samples by position, from tables (`diagnose --samples`)."""

import numpy as np
import pytest

from tumblecal.ground.errors import InputError
from tumblecal.recordings.dwells.position_samples import read_position_samples


def table(path, header="position,time_s,ax_mg,ay_mg,az_mg", comment="", count=20, step=0.01):
    lines = [comment, header] if comment else [header]
    for place, name in enumerate("ab"):
        for k in range(count):
            cells = {
                "position": name,
                "time_s": f"{place * 60 + k * step}",
                "ax_mg": "1",
                "ay_mg": "2",
                "az_mg": "1000",
            }
            lines.append(",".join(cells[column] for column in header.split(",")))
    path.write_text("\n".join(lines) + "\n")
    return path


def test_samples_times_and_rate(tmp_path):
    found = read_position_samples(table(tmp_path / "raw.csv"))
    assert found.rate_hz == pytest.approx(100) and found.positions.names == ("a", "b")
    np.testing.assert_allclose(found.force[1][3], [0.001, 0.002, 1.0])
    assert found.positions.time_s == pytest.approx([0.095, 60.095]) and found.still_s == pytest.approx(0.4)
    found = read_position_samples(table(tmp_path / "raw.csv", "position,ax_mg,ay_mg,az_mg", "# rate_hz: 62.5"))
    assert found.rate_hz == 62.5 and found.positions.time_s is None


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"header": "time_s,ax_mg,ay_mg,az_mg"}, "column position is missing"),
        ({"header": "position,ax_mg,ay_mg,az_mg"}, "the sample rate is not known"),
        ({"header": "position,ax_mg,ay_mg,az_mg", "comment": "# rate_hz: fast"}, "not a sample rate"),
        ({"count": 5}, "too few samples at position a \\(5\\), b \\(5\\)"),
        ({"step": 0.0}, "must increase"),
    ],
)
def test_faults_are_told(tmp_path, change, match):
    with pytest.raises(InputError, match=match):
        read_position_samples(table(tmp_path / "raw.csv", **change))
    with pytest.raises(InputError, match="no journal"):
        read_position_samples(tmp_path)
