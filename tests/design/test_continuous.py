"""Continuous angles: the uncertainties by the responses at the new angles, in the model of a search."""

from dataclasses import replace

import numpy as np
import pytest

from tumblecal.design.continuous import continuous_cells
from tumblecal.design.criteria import worst
from tumblecal.design.limits import in_order
from tumblecal.design.one_visit import one_visit
from tumblecal.design.responses import responses_of
from tumblecal.ground.errors import InputError


def test_continuous_angles_reduce_the_criterion(head, candidates):
    ability = replace(head.ability, alpha_continuous=True)
    taken = in_order(candidates.cells, np.r_[8:12, 17:20, 24:28, 56:60, 65:68])
    criterion = worst(candidates)
    before = float(criterion.of(one_visit(candidates).covariance(taken)))
    moved = continuous_cells(head, candidates, ability, criterion, taken, steps=30)
    assert moved.beta_deg.tolist() == candidates.cells.beta_deg[taken].tolist()
    assert moved.mounts == candidates.cells.chosen(taken).mounts
    after = float(criterion.of(one_visit(responses_of(head, moved)).covariance(np.arange(len(taken)))))
    assert after < 0.98 * before
    with pytest.raises(InputError, match="neither alpha_continuous nor beta_continuous"):
        continuous_cells(head, candidates, head.ability, criterion, taken)
