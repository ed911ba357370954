"""Attitudes that a hand-held set lacks, in words."""

import json
import re

import numpy as np
import pytest

from tumblecal.estimation.attitudes import attitudes, next_attitudes


AXES = {f"{sign}{axis}": (1 if sign == "+" else -1) * np.eye(3)[k] for k, axis in enumerate("xyz") for sign in "+-"}


def down_of(words):
    """What a person does who follows the words: which way of the triad points down."""
    sides = [AXES[name] for name in re.findall(r"[+-][xyz]", words)]
    tilt = re.search(r"tilted (\d+) deg towards", words)
    if tilt:
        angle = np.radians(float(tilt[1]))
        return np.cos(angle) * sides[0] + np.sin(angle) * sides[1]
    assert len(sides) == {"face": 1, "edge": 2, "corner": 3}[next(k for k in ("edge", "corner", "face") if k in words)]
    return np.sum(sides, axis=0) / np.sqrt(len(sides))


def test_the_words_say_which_way_is_down():
    assert len(attitudes()) == 6 + 24 + 12 + 8 == len({attitude.words for attitude in attitudes()})
    for attitude in attitudes():
        np.testing.assert_allclose(attitude.up, -down_of(attitude.words), atol=1e-12)


def worst_sd(ups):
    """The sd of the weakest direction of nine parameters by the sizes of readings, differentiated numerically; sd 1 each."""

    def sizes(parameters):
        scale, bias, (g21, g31, g32) = parameters[:3], parameters[3:6], parameters[6:]
        x, y, z = np.asarray(ups, float).T
        inputs = np.column_stack([x, y + g21 * x, z + g31 * x + g32 * y])
        readings = (1 + scale) * inputs + bias
        return np.linalg.norm(readings, axis=1)

    jacobian = np.column_stack([(sizes(step) - sizes(-step)) / 2e-6 for step in 1e-6 * np.eye(9)])
    return np.sqrt(1 / max(np.linalg.eigvalsh(jacobian.T @ jacobian)[0], 1e-12))


@pytest.mark.parametrize("seed", range(6))
def test_what_is_proposed_lowers_the_weakest_direction_as_said(seed):
    """Sets of a hand that kept one side up: each attitude does what was said, better than the rest, and together a lot."""
    rng = np.random.default_rng(seed)
    ups = rng.normal(size=(14, 3)) * [1, 1, 0.5]
    ups[:, 2] = np.abs(ups[:, 2])
    ups /= np.linalg.norm(ups, axis=1, keepdims=True)
    before, began = worst_sd(ups), worst_sd(ups)
    proposed = next_attitudes(ups * 1.02)
    assert proposed
    for attitude, gain in proposed:
        ups = np.vstack([ups, -down_of(attitude.words)])
        after = worst_sd(ups)
        assert after == pytest.approx(before * (1 - gain), rel=0.02)
        before = after
    assert before < 0.5 * began
    arbitrary = [worst_sd(np.vstack([ups[:14], rng.normal(size=(len(proposed), 3))])) for _ in range(20)]
    assert before < np.median(arbitrary)


def test_a_set_that_determines_nothing_gets_six_more():
    faces = np.vstack([np.eye(3), -np.eye(3)])
    proposed = next_attitudes(faces)
    assert len(proposed) == 6
    assert np.isfinite(worst_sd(np.vstack([faces, *(attitude.up for attitude, _ in proposed)])))
    assert worst_sd(np.vstack([faces, *(attitude.up for attitude, _ in proposed)])) < 2
    # Symmetry makes many alike: which is taken must not hang on rounding, which differs between processors.
    rounded = faces + 1e-13 * np.random.default_rng(1).normal(size=(6, 3))
    assert [attitude.words for attitude, _ in next_attitudes(rounded)] == [own.words for own, _ in proposed]
    everywhere = np.array([attitude.up for attitude in attitudes()] * 6)
    assert next_attitudes(everywhere) == []


@pytest.fixture
def one_sided(tmp_path):
    """Seventeen attitudes of a hand that hardly turned the triad over."""
    rng = np.random.default_rng(3)
    ups = rng.normal(size=(17, 3)) * [1, 1, 0.6]
    ups[:, 2] = np.abs(ups[:, 2])
    ups /= np.linalg.norm(ups, axis=1, keepdims=True)
    readings = ups * [1.001, 0.999, 1.002] + [0.01, -0.02, 0.03] + 1e-4 * rng.normal(size=ups.shape)
    lines = ["# attitudes: unknown", "position,ax_g,ay_g,az_g"]
    lines += [f"p{k},{','.join(map(repr, row.tolist()))}" for k, row in enumerate(readings)]
    (tmp_path / "hand.csv").write_text("\n".join(lines) + "\n")
    return tmp_path / "hand.csv"


@pytest.mark.long
@pytest.mark.usefixtures("few_effects")
def test_both_commands_propose_directions(tumblecal, tmp_path, one_sided):
    outcome = tumblecal("diagnose", one_sided, "--noise-sd", "0.1mg", "--out", tmp_path / "out")
    assert outcome.code == 0
    said = " ".join(outcome.out.split())
    assert "Measure next, to reduce the standard uncertainty of the most poorly determined direction" in said
    content = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["next_plan"]
    directions = [position["direction"] for position in content["together"]]
    assert directions and all(words in said for words in directions)
    assert "alpha" not in said.partition("Measure next")[2]
    assert directions[0] in (tmp_path / "out" / "diagnosis.html").read_text()
    assert not list((tmp_path / "out").glob("next_positions*"))
    outcome = tumblecal("calibrate", one_sided, "--noise-sd", "0.1mg", "--no-figures", "--out", tmp_path / "cal")
    assert directions[0] in " ".join(outcome.out.split())
