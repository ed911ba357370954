"""Products on the residual space under covariances of every form, against the dense covariance there."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from tumblecal.diagnosis.noise.repeats import Repeats
from tumblecal.diagnosis.noise.whitening import Whitening
from tumblecal.full_model.tangent import Tangent
from tumblecal.noise.covariance import Covariance


POSITIONS, PRIORS = 6, 2
COUNT = 3 * POSITIONS


def covariance(form, rng):
    """A random covariance of a form."""
    shape = {"between": (POSITIONS,), "by_axis": (3, POSITIONS), "blocks": (POSITIONS, 3), "full": (COUNT,)}
    if form == "rows":
        return Covariance(rng.uniform(0.5, 9.0, COUNT), form)
    root = rng.normal(size=(*shape[form], shape[form][-1]))
    return Covariance(root @ root.swapaxes(-1, -2) + np.eye(root.shape[-1]), form)


@pytest.mark.parametrize("reached", [4, 14])
def test_products_and_determinants_are_those_of_the_dense_covariance(reached):
    """By the precisions where the column space is small, by the residual space otherwise; means of repeats too."""
    rng = np.random.default_rng(reached)
    q = np.linalg.qr(rng.normal(size=(COUNT + PRIORS, COUNT + PRIORS)))[0]
    basis = q[:, reached:]
    problem = SimpleNamespace(readings=np.zeros((POSITIONS, 3)))
    at = SimpleNamespace(basis=basis, reached=q[:, :reached], dof=basis.shape[1], problem=problem)
    repeats = Repeats(np.array([0, 1, 0, 2, 3, 1]), np.array([1.0, 1.0, 2.0, 1.0, 1.0, 3.0]))
    listed = [covariance(form, rng) for form in ("rows", "blocks", "between", "by_axis", "full", "rows")]
    of_means = [False, True, False, False, False, True]
    tried = Whitening(cast(Tangent, at), listed, repeats, of_means)
    x = rng.normal(size=(at.dof, 3))
    products, squares, one = tried.products(x), tried.squares(x), tried.squares(x[:, :1])
    turn = np.kron(repeats.turn, np.eye(3))
    for k, (own, means) in enumerate(zip(listed, of_means, strict=True)):
        dense = np.eye(COUNT + PRIORS)
        dense[:COUNT, :COUNT] = turn.T @ own.matrix @ turn if means else own.matrix
        dense = basis.T @ dense @ basis
        truth = x.T @ np.linalg.solve(dense, x)
        np.testing.assert_allclose(products[k], truth, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(squares[k], np.diag(truth), rtol=1e-9)
        np.testing.assert_allclose(one[k, 0], truth[0, 0], rtol=1e-9)
        np.testing.assert_allclose(tried.half_log_dets[k], 0.5 * np.linalg.slogdet(dense)[1], rtol=1e-9)
