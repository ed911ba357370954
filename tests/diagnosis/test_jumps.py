"""What changes for good at some position: a bias that jumps, a mount that slips; named with the position."""

import json

import numpy as np
import pytest

import blind_instrument as blind
from tumblecal.diagnosis.causes.jumps import jumps
from tumblecal.diagnosis.causes.pool import Pool
from tumblecal.planning import next_plan
from tumblecal.report.diagnosis_files import write_diagnosis


SEED, BEGINS = 2, 12  # the blind instrument's second half


@pytest.mark.parametrize(
    ("effect", "size", "label"),
    [
        ("?step_half_way.y", [1e-3], "bias_jump"),
        ("?step_half_way.z", [-1e-3], "bias_jump"),
        ("?mount_slip", [1e-3, 6e-4, -8e-4], "mount_slip"),
    ],
)
def test_a_jump_is_named_with_its_position(hidden, diagnoser, tmp_path, effect, size, label):
    data = hidden(SEED, {effect: size})
    said = diagnoser(data)
    assert said.verdict == "identified" and said.labels == (f"{label}:{data.names[BEGINS]}",)
    assert said.extended.rms < 1.3 * blind.SIGMA < said.nominal.rms
    write_diagnosis(tmp_path, said, next_plan(said), figures=False)
    chosen = json.loads((tmp_path / "diagnosis.json").read_text())["explanations"][0]
    assert chosen["effects"] == [label] and chosen["positions"] == {label: [data.names[BEGINS]]}
    assert said.entries[label].cause in " ".join((tmp_path / "verdict.txt").read_text().split())


def test_signals_are_those_of_the_blind_instrument(hidden, diagnoser):
    """By central differences at the truth; the candidates are made at the fit, which is off by some tenths of a mrad."""
    at = diagnoser(hidden(SEED, {})).screened.at
    setup = blind.random_setup(np.random.default_rng(SEED), 3, 8)
    every = Pool(tuple(jumps(at)), at.dof).causes
    candidates = [cause for cause in every if cause.label.endswith(f":{setup.names[BEGINS]}")]
    assert [cause.words for cause in candidates if cause.words] == ["x axis", "y axis", "z axis"]
    for cause in candidates:
        effect = "?mount_slip" if cause.label.startswith("mount") else f"?step_half_way.{cause.words[0]}"
        for signal, unit in zip(cause.terms, np.eye(len(cause.terms)) * 1e-5, strict=True):
            there, back = (blind.readings(setup, setup.nominal, {effect: sign * unit}) for sign in (1, -1))
            expected = ((there - back) / 2e-5).ravel() / blind.SIGMA
            scale = at.model.scales[0] if effect == "?mount_slip" else 1.0
            np.testing.assert_allclose(signal / scale, expected, atol=1e-3 / blind.SIGMA)
            # The block spans what is left of them.
            rest = at.basis[: len(signal)].T @ signal
            assert np.linalg.norm(rest - cause.block @ (cause.block.T @ rest)) < 1e-9 * np.linalg.norm(rest)


def test_the_measuring_order_counts_not_that_of_the_rows(hidden, diagnoser):
    data = hidden(SEED, {"?step_half_way.y": [1e-3]})
    rows = np.random.default_rng(10).permutation(
        len(data)
    )  # the settings are still met in their order: a plan of other tests
    assert diagnoser(data.chosen(rows)).labels == (f"bias_jump:{data.names[BEGINS]}",)
