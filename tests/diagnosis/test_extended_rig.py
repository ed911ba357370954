"""The extended model as a rig file: what it simulates is what was found."""

import numpy as np
import pytest

from tumblecal.chain.rig_file import read_rig
from tumblecal.effects import catalogue
from tumblecal.effects.catalogue import links_and_units
from tumblecal.lab.extended_rig import extended_rig_text


def predicted(path, tmp_path, text):
    """The noise-free readings of a rig file, g."""
    (tmp_path / path).write_text(text)
    rig = read_rig(tmp_path / path, *links_and_units(catalogue()))
    return rig, np.asarray(rig.true_chain(rig.where)(rig.where))


def test_its_chain_is_the_one_that_was_fitted(diagnoser, hidden, tmp_path):
    diagnosis = diagnoser(hidden(5, {"index_eccentricity": [6e-4, -3e-4]}))
    assert diagnosis.labels == ("index_eccentricity",)
    rig, readings = predicted("extended_rig.toml", tmp_path, extended_rig_text(diagnosis))
    assert rig.effects == ("index_eccentricity",) and rig.plan.names == diagnosis.data.names
    assert rig.noise_sd_g == pytest.approx(diagnosis.sigma_g)
    np.testing.assert_allclose(rig.plan.time_s, diagnosis.data.time_s)
    np.testing.assert_allclose(diagnosis.data.readings - readings, diagnosis.extended.residuals, atol=1e-12)
