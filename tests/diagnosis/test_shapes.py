"""Causes of a shape of their own, which no entry and no single generic term has: no effect's name is given to them."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
import blind_noise
from blind.acting import sized_to
from blind.unlisted import LATER, LATEST, UNLISTED, UNSEEN
from tumblecal.show.diagnosis import verdict_of_diagnosis


def unlisted(name, seed, d=12.0):
    """A cause of 12 sigma, or another size, at 3 x 8 positions."""
    rng = np.random.default_rng([seed, 12])
    while True:
        setup = blind.random_setup(rng, 3, 8)
        sized = (UNLISTED | LATER | LATEST | UNSEEN)[name](setup, rng)
        scaled = sized_to(sized, projector := blind.unreachable(setup), blind.SIGMA, d)
        if scaled is not None and blind.resembles_none(setup, projector, scaled[1], 5.0):
            readings = sized(scaled[0])
            readings = readings + blind.SIGMA * rng.normal(size=readings.shape)
            return blind_noise.position_set(setup, readings, known=seed % 2 == 0)


@pytest.mark.long
@pytest.mark.parametrize("name", UNLISTED)
def test_a_cause_of_a_shape_of_its_own_is_unexplained(diagnoser, name):
    told = [diagnoser(unlisted(name, seed)) for seed in range(3)]
    assert sum("unexplained" in sum((own.best.labels, *own.best.equivalents), ()) for own in told) >= 2
    assert not any(own.best.single_name and own.best.probability > 0.95 and not own.best.unexplained for own in told)


def test_what_it_depends_on_is_said_and_fitted(diagnoser):
    diagnosis = diagnoser(unlisted("knee of an output", 0))
    (cause,) = diagnosis.members
    assert ": a function of input" in cause.words
    # The law states what it depends on more exactly than the process.
    words = verdict_of_diagnosis(diagnosis).words()
    assert "Excess at " in words and "Candidate law: output y: " in words and cause.words not in words
    assert len(cause.terms) == cause.block.shape[1] >= 2
    fit = diagnosis.extended
    assert fit.code.good and fit.dof == diagnosis.nominal.dof - len(cause.terms)
    assert 0.6 < fit.chi2 / fit.dof < 1.6 < diagnosis.nominal.chi2 / diagnosis.nominal.dof
    # What is sought anew in each fold is causes: the gain is that of what was found, and says so.
    gain = replace(diagnoser, nested=True)(unlisted("knee of an output", 0)).gain
    assert gain.cv_same_causes is None and gain.cv_rms_after_g == gain.cv_rms_kept_g < gain.cv_rms_before_g


def test_a_noise_that_lack_of_fit_would_explain_as_well_is_ambiguous(diagnoser):
    diagnosis = diagnoser(unlisted("heater cycles", 1))
    assert diagnosis.noise_wrong["noise_unequal"].alternative == "unexplained" and not diagnosis.best.labels
    assert diagnosis.verdict == "ambiguous"
    words = verdict_of_diagnosis(diagnosis).words()
    assert "or an effect without an entry is present" in words.partition("\n")[0]
    assert "an effect that is not in the catalogue would explain it about as well" in words
