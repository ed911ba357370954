"""`tumblecal example`: the files of configs/ in an empty folder, and what they are good for there."""

import pytest

import tumblecal as package


def test_an_example_comes_with_its_rig_and_is_never_written_over_changes(tumblecal, tmp_path, configs):
    assert tumblecal("example", "study_power", "--out", tmp_path).code == 0
    for name in ("study_power.toml", "grid48.toml"):
        assert (tmp_path / name).read_bytes() == (configs / name).read_bytes()
    assert tumblecal("example", "grid48", "--out", tmp_path).code == 0
    (tmp_path / "grid48.toml").write_text("# mine\n")
    refused = tumblecal("example", "study_power", "--out", tmp_path)
    assert refused.code == 2 and "grid48.toml: exists and differs" in refused.lines[0]
    assert (tmp_path / "grid48.toml").read_text() == "# mine\n"


def test_a_rig_is_read_by_its_name_unless_a_file_has_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert len(package.read_rig("paper24").plan.alpha_deg) == 24
    (tmp_path / "paper24").write_text("no rig")
    with pytest.raises(package.InputError, match="paper24: not TOML"):
        package.read_rig("paper24")
