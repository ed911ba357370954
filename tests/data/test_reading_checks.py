"""Warnings on readings that a calibration at rest does not cover: the same however the rows are cut into pieces."""

import numpy as np
import pytest

from tumblecal.data.reading_checks import ReadingChecks


COUNT = 60
FIRST = 11  # number of the first row


def resting(unit: float = 1.0) -> np.ndarray:
    """Readings of about 1 g in all directions."""
    force = np.random.default_rng(5).normal(size=(COUNT, 3))
    return unit * (force / np.linalg.norm(force, axis=1)[:, None] * [1.02, 0.99, 1.0] + [0.02, -0.01, 0.03])


def changed(axis: int, rows: slice, value: float) -> np.ndarray:
    readings = resting()
    readings[rows, axis] = value
    return readings


def words(readings, pieces=1, degc=None, unit="g", **options) -> list[str]:
    checks = ReadingChecks([f"a{axis}_{unit}" for axis in "xyz"], **options)
    for rows in np.array_split(np.arange(len(readings)), pieces):
        checks.add(readings[rows], FIRST + rows)
        if degc is not None:
            checks.add_temperatures(degc[rows], FIRST + rows)
    return list(checks.words())


# Readings in g, by the unit in the names of their columns, and the beginning or a part of each warning.
CASES = {
    "at rest": (resting(), []),
    "two rows far beyond": (changed(1, slice(20, 22), -6.0), ["2 of 60 rows (the first: line 31) are beyond 2 g, up to 6 g"]),
    "saturated": (
        changed(2, slice(30, 37), 4.0),
        ["7 of 60 rows (the first: line 41) are beyond 2 g", "axis z stays at its largest reading, 4 g in 7 of 60 rows"],
    ),
    "saturated below": (
        changed(0, slice(3, 6), -1.9), ["axis x stays at its smallest reading, -1.9 g in 3 of 60 rows (the first: line 14)"],
    ),
    "m/s^2 as g": (resting(9.80665), ["ax_g, ay_g, az_g: their norm is about 9.81 g in 60 of 60 rows (the first: line 11)"]),
    "mg as g": (resting(1000.0), ["their norm is about 1e+03 g in 60 of 60 rows (the first: line 11), so they look like mg"]),
    "counts": (resting(200.0), ["beyond 10 g in 60 of 60 rows"]),
}  # fmt: skip


@pytest.mark.parametrize(("readings", "expected"), CASES.values(), ids=CASES)
def test_rows_are_counted_and_named_whatever_the_pieces(readings, expected):
    told = words(readings)
    assert len(told) == len(expected) and all(part in line for part, line in zip(expected, told, strict=True)), told
    for pieces in (2, 7, 20, 60):
        assert words(readings, pieces) == told, pieces


def test_readings_of_2_g_below_half_the_rows_are_no_other_unit():
    readings = resting()
    readings[:25] *= 9.80665
    assert not any("look like" in line for line in words(readings))
    readings[:31] = 9.80665 * resting()[:31]
    assert "31 of 60 rows" in words(readings)[0] and "so they look like m/s^2" in words(readings)[0]


def test_two_equal_readings_at_an_end_are_chance():
    assert not any("stays at" in line for line in words(changed(2, slice(30, 32), 1.9)))


@pytest.mark.parametrize("pieces", [1, 9])
def test_temperatures_beyond_the_range_are_counted(pieces):
    degc = np.linspace(15.0, 44.5, COUNT)
    degc[7] = np.nan
    (line,) = words(resting(), pieces, degc, range_degc=(20.0, 40.0), margin_degc=1.0)
    # By half a degree a row: 19 is row 8, 41 is row 52; neither those at the margin nor NaN count.
    assert (
        line
        == "temperatures in 14 of 60 rows (the first: line 11) are beyond the 20 to 40 degC of the calibration; "
        + ("it was not measured there")
    )
    assert not words(resting(), pieces, degc)
