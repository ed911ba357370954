"""Several sensors of one hand-held session: no head is involved, and effects of the sensors may be common to them."""

from types import SimpleNamespace

import numpy as np
import pytest

from tumblecal.data import PositionSet
from tumblecal.data.positions import attitudes_of
from tumblecal.diagnosis.units import joint_diagnosis
from tumblecal.ground.errors import InputError
from tumblecal.show.diagnosis import verdict_of_diagnosis
from tumblecal.show.units_together import words_of_units


SIGMA, COUNT = 1e-4, 24
K2 = 2e-3


def sensors(units: int, k2: float) -> list[PositionSet]:
    """Sensors of biases to 300 mg held together in 24 attitudes; the y output bends with the square of its input."""
    rng = np.random.default_rng(2)
    up = rng.normal(size=(COUNT, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    sets = []
    for number in range(units):
        mounted = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        matrix = np.eye(3) + np.tril(rng.normal(size=(3, 3)) * 2e-3)
        force = up @ mounted.T
        readings = force @ matrix.T + rng.uniform(-0.3, 0.3, 3)
        readings[:, 1] += k2 * force[:, 1] ** 2
        sets.append(
            PositionSet(
                tuple(f"p{k}" for k in range(COUNT)),
                *attitudes_of(readings),
                readings + SIGMA * rng.normal(size=readings.shape),
                comments={"attitudes": "unknown"},
                source=f"u{number}.csv",
            )
        )
    return sets


@pytest.mark.long
def test_sensors_of_one_session(diagnoser):
    """An IndexError in sets/prior.py: without a head no cause is there that all could share."""
    sets = sensors(3, K2)
    screened = [diagnoser.begun(own, noise_sd=SIGMA).screened for own in sets]
    found = joint_diagnosis(screened, [own.source for own in sets])
    causes = [" + ".join(own.best.labels) for own in screened]
    rows = [(f"u{k}", {"causes": labels, "probability": 0.9, "verdict": ""}) for k, labels in enumerate(causes)]
    text = words_of_units(found, rows, diagnoser.entries).verdict.words()
    assert "No dividing head is involved" in text and found.fit.head is None and "error of the head" not in text
    assert found.joint.best.by_unit == ("second_order.y",) and found.verdict == "identified"
    (effect,) = found.joint.best.hypothesis.random_effects
    mean, sd = (own[0] * effect.signal.scales[0] for own in found.amounts["second_order.y"].mean)
    assert abs(mean - K2) < 3 * sd < 0.5 * K2


def test_an_ordinary_bias_is_no_contradiction(diagnoser):
    """Biases of 60 to 300 mg: "nothing contradicts the model, p = 1", UNEXPLAINED and IMPLAUSIBLE, for one set."""
    (own,) = sensors(1, 0.0)
    diagnosis = diagnoser(own, noise_sd=SIGMA)
    assert np.max(np.abs(diagnosis.in_use.as_fit.values[3:6])) > 0.06 and not diagnosis.implausible
    text = verdict_of_diagnosis(diagnosis).words()
    assert diagnosis.verdict == "adequate" and text.startswith("ADEQUATE") and "UNEXPLAINED" not in text
    assert "IMPLAUSIBLE" not in text and "Use of calibration.json: yes" in text


def test_hand_held_files_are_not_mixed_with_those_of_a_head():
    def screened(hand_held: bool):
        return SimpleNamespace(at=SimpleNamespace(model=SimpleNamespace(hand_held=hand_held)))

    with pytest.raises(InputError, match=r"u0\.csv: attitudes unknown \(hand-held\), but other files state angles"):
        joint_diagnosis([screened(True), screened(False)], ["u0.csv", "head.csv"])
