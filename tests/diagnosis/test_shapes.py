"""Causes of a shape of their own, which no entry and no single generic term has: no effect's name is given to them."""

from dataclasses import replace

import numpy as np
import pytest

import blind_instrument as blind
import blind_noise
from blind_sized import sized_to
from blind_unlisted import LATER, UNLISTED
from blind_unseen import UNSEEN
from tumblecal.diagnosis.tuning import LACK_OF_FIT_WEIGHT
from tumblecal.report.diagnosis_words import verdict_text


def unlisted(name, seed):
    """A cause of 12 sigma at 3 x 8 positions, and the words for what it is."""
    rng = np.random.default_rng([seed, 12])
    while True:
        setup = blind.random_setup(rng, 3, 8)
        sized = (UNLISTED | LATER | UNSEEN)[name](setup, rng)
        scaled = sized_to(sized, projector := blind.unreachable(setup), blind.SIGMA, 12.0)
        if scaled is not None and blind.resembles_none(setup, projector, scaled[1], 5.0):
            readings = sized(scaled[0])
            readings = readings + blind.SIGMA * rng.normal(size=readings.shape)
            return blind_noise.position_set(setup, readings, known=seed % 2 == 0)


def test_the_processes_share_one_prior_weight(diagnoser, hidden):
    """Whatever they are and however many: three counts of swings weigh as much as one other process."""
    lack = diagnoser(hidden(5, {})).screened.alternatives.lack
    weights = dict(zip(lack.words, np.exp(lack.log_weights), strict=True))
    assert len(weights) > 60 and sum(weights.values()) == pytest.approx(LACK_OF_FIT_WEIGHT)
    swings = {weights[words] for words in weights if words.endswith(" swings")}
    others = {weights[words] for words in weights if not words.endswith(" swings")}
    assert len(swings) == 1 and 3 * swings.pop() == pytest.approx(max(others)) == pytest.approx(min(others))


@pytest.mark.parametrize("name", UNLISTED)
def test_a_cause_of_a_shape_of_its_own_is_unexplained(diagnoser, name):
    told = [diagnoser(unlisted(name, seed)) for seed in range(3)]
    assert sum("unexplained" in sum((own.best.labels, *own.best.equivalents), ()) for own in told) >= 2
    assert not any(own.best.single_name and own.best.probability > 0.95 and not own.best.unexplained for own in told)


def test_what_it_depends_on_is_said_and_fitted(diagnoser):
    diagnosis = diagnoser(unlisted("knee of an output", 0))
    (cause,) = diagnosis.members
    assert ": a function of input" in cause.words and cause.words in verdict_text(diagnosis)
    assert len(cause.terms) == cause.block.shape[1] >= 2
    fit = diagnosis.extended
    assert fit.code.good and fit.dof == diagnosis.nominal.dof - len(cause.terms)
    assert 0.6 < fit.chi2 / fit.dof < 1.6 < diagnosis.nominal.chi2 / diagnosis.nominal.dof
    # What is sought anew in each fold is causes: the gain is that of what was found, and says so.
    gain = replace(diagnoser, nested=True)(unlisted("knee of an output", 0)).gain
    assert gain.cv_same_causes is None and gain.cv_rms_after_g == gain.cv_rms_kept_g < gain.cv_rms_before_g


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("pump beats", (" swings",)),
        ("touches on one side", ("the lean to one side", "the side to which gravity pulls")),
    ],
)
def test_how_it_changes_is_said(diagnoser, name, words):
    """Beside smooth curves: swings in time, touching on one side."""
    told = [cause.words for seed in range(3) for cause in diagnoser(unlisted(name, seed)).members if not cause.named]
    assert len(told) >= 2 and all(own.endswith(words) for own in told), told


def test_a_noise_that_lack_of_fit_would_explain_as_well_is_ambiguous(diagnoser):
    diagnosis = diagnoser(unlisted("heater cycles", 1))
    assert diagnosis.noise_wrong["noise_unequal"].rival == "unexplained" and not diagnosis.best.labels
    assert diagnosis.verdict == "ambiguous"
    words = verdict_text(diagnosis)
    assert "or something that no entry describes is there" in words.partition("\n")[0]
    assert "something that no entry describes would explain it about as well" in words
