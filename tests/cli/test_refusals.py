"""Bad input: exit code 2, one line a fault with file, line and column, no traceback, nothing written."""

import pytest


pytestmark = pytest.mark.usefixtures("few_effects")


@pytest.mark.parametrize(
    ("sd", "words"),
    [("-0.15 mg", "'-0.15 mg': a standard deviation must be above 0"), ("0 mg", "readings without noise")],
)
def test_noise_of_a_rig_is_refused_by_its_file_and_key(tumblecal, tmp_path, configs, table1_file, sd, words):
    """No noise at all may be simulated; nothing can be weighed by it."""
    rig = tmp_path / "rig.toml"
    rig.write_text((configs / "paper24.toml").read_text().replace("0.15 mg", sd))
    outcome = tumblecal("calibrate", table1_file, "--rig", rig, "--out", tmp_path / "out")
    assert outcome.code == 2 and len(outcome.lines) == 1 and f"noise.sd: {words}" in outcome.lines[0]
    assert outcome.lines[0].startswith(f"tumblecal: {rig}:line 20: ")
    assert tumblecal("simulate", rig, "--out", tmp_path / "x.csv").code == (0 if sd == "0 mg" else 2)
