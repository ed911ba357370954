"""Every form of a covariance against its dense matrix, written out here."""

import numpy as np
import pytest

from tumblecal.noise.covariance import Covariance


POSITIONS = 4
ROWS = 3 * POSITIONS


def positive(rng, size):
    """A positive definite matrix."""
    factor = rng.normal(size=(size, size))
    return factor @ factor.T + 0.5 * np.eye(size)


def as_matrix(inverse_root):
    """(rows, rows), of whatever shape it is kept in."""
    if inverse_root.ndim != 3:
        return inverse_root if inverse_root.ndim == 2 else np.diag(inverse_root)
    full = np.zeros((ROWS, ROWS))
    for axis, own in enumerate(inverse_root):
        full[axis::3, axis::3] = own
    return full


def made(form):
    """A covariance of this form and its dense matrix; rows are positions times axes, the axis running fastest."""
    rng = np.random.default_rng(7)
    dense = np.zeros((ROWS, ROWS))
    if form == "rows":
        values = rng.uniform(0.2, 3, ROWS)
        return Covariance(values, form), np.diag(values)
    if form == "full":
        values = positive(rng, ROWS)
        return Covariance(values, form), values
    if form == "between":
        values = positive(rng, POSITIONS)
        entries = [(3 * i + axis, 3 * j + axis, values[i, j]) for i in range(4) for j in range(4) for axis in range(3)]
    elif form == "by_axis":
        values = np.stack([positive(rng, POSITIONS) for _ in range(3)])
        entries = [(3 * i + a, 3 * j + a, values[a, i, j]) for i in range(4) for j in range(4) for a in range(3)]
    else:
        values = np.stack([positive(rng, 3) for _ in range(POSITIONS)])
        entries = [(3 * i + a, 3 * i + b, values[i, a, b]) for i in range(4) for a in range(3) for b in range(3)]
    for row, column, value in entries:
        dense[row, column] = value
    return Covariance(values, form), dense


FORMS = ("rows", "between", "by_axis", "blocks", "full")


@pytest.mark.parametrize("form", FORMS)
class TestForm:
    def test_matrix_count_sd_and_determinant(self, form):
        covariance, dense = made(form)
        np.testing.assert_allclose(covariance.matrix, dense, rtol=1e-15)
        assert covariance.count == ROWS
        np.testing.assert_allclose(covariance.sd, np.sqrt(np.diag(dense)), rtol=1e-14)
        assert covariance.half_log_det == pytest.approx(0.5 * np.linalg.slogdet(dense)[1], rel=1e-12)

        rows = np.random.default_rng(3).normal(size=(ROWS, 4))
        np.testing.assert_allclose(covariance.times(rows), dense @ rows, rtol=1e-12, atol=1e-12)

    @pytest.mark.parametrize("columns", [(), (1,), (5,), (0,), (2, 3)])
    def test_white_rows_have_the_metric_of_the_inverse(self, form, columns):
        covariance, dense = made(form)
        rows = np.random.default_rng(1).normal(size=(ROWS, *columns))
        white = covariance.whiten(rows)
        assert white.shape == rows.shape
        flat, given = white.reshape(ROWS, -1), rows.reshape(ROWS, -1)
        np.testing.assert_allclose(flat.T @ flat, given.T @ np.linalg.solve(dense, given), rtol=1e-9, atol=1e-10)

    def test_whitening_is_linear_and_by_the_inverse_root(self, form):
        covariance, dense = made(form)
        white = covariance.whiten(np.eye(ROWS))
        np.testing.assert_allclose(white @ dense @ white.T, np.eye(ROWS), atol=1e-10)
        matrix = as_matrix(covariance.inverse_root)
        np.testing.assert_allclose(matrix @ dense @ matrix.T, np.eye(ROWS), atol=1e-10)

    def test_rows_of_priors_behind_them_are_left_alone(self, form):
        covariance, _ = made(form)
        rows = np.random.default_rng(2).normal(size=(ROWS + 3, 2))
        white = covariance.whiten(rows)
        np.testing.assert_array_equal(white[ROWS:], rows[ROWS:])
        np.testing.assert_allclose(white[:ROWS], covariance.whiten(rows[:ROWS]), rtol=1e-13)

    def test_draws_have_it(self, form):
        covariance, dense = made(form)
        draws = covariance.sample(np.random.default_rng(3), 40_000)
        assert draws.shape == (ROWS, 40_000)
        scale = np.sqrt(np.outer(np.diag(dense), np.diag(dense)))
        # 144 entries, each with a standard error of at most 0.007 of the scale.
        assert np.max(np.abs(draws @ draws.T / 40_000 - dense) / scale) < 0.035
        assert np.max(np.abs(draws.mean(axis=1)) / covariance.sd) < 0.025
        assert covariance.sample(np.random.default_rng(3), 0).shape == (ROWS, 0)
        again = covariance.sample(np.random.default_rng(3), 7)
        np.testing.assert_allclose(
            covariance.whiten(again), np.random.default_rng(3).standard_normal((ROWS, 7)), atol=1e-11
        )

    @pytest.mark.parametrize("relative", FORMS)
    def test_compounded_is_the_covariance_of_rows_white_by_it(self, form, relative):
        outer, _ = made(form)
        inner, white = made(relative)
        whitening = as_matrix(outer.inverse_root)
        np.testing.assert_allclose(whitening @ outer.compounded(inner).matrix @ whitening.T, white, atol=1e-10)


def test_what_is_not_positive_definite_is_refused():
    with pytest.raises(np.linalg.LinAlgError):
        Covariance(-np.eye(ROWS), "full").whiten(np.ones(ROWS))
