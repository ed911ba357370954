"""`tumblecal diagnose --units`: errors of the head told from those of each sensor, and head.toml in later calibrations."""

import json
import tomllib

import numpy as np
import polars as pl
import pytest

import blind_instrument as blind
from blind_sets import measured
from tumblecal.data import write_positions


LEVEL = 0.25e-3  # rad, of base_levelling: 7 sigma in one unit
SENSOR = ("dK_x", "dK_y", "dK_z", "bias_x", "bias_y", "bias_z", "gamma_21", "gamma_31", "gamma_32")


def setups_on_one_head(seed: int, count: int, *, pitch=(1.2e-3, -2.1e-3, 0.8e-3)):
    """Units that differ in everything; with `pitch` the errors (rad) of the head's settings are those of all."""
    rng = np.random.default_rng(seed)
    setups = [blind.random_setup(rng, 3, 8) for _ in range(count)]
    for setup in setups if pitch else ():
        setup.nominal["dbeta"] = np.array(pitch)
    return setups


def write_units(folder, setups, effects, seed: int, *, known: bool = True):
    """One file for each unit; `effects` of each, base units."""
    rng, files = np.random.default_rng([seed, 1]), []
    folder.mkdir(exist_ok=True)
    for number, (setup, hidden) in enumerate(zip(setups, effects, strict=True)):
        files.append(folder / f"unit{number}.csv")
        write_positions(files[-1], measured(setup, hidden, rng, known=known))
    return files


def told(folder):
    return json.loads((folder / "diagnosis.json").read_text())


def names(explanation):
    return {tuple(explanation["effects"]), *map(tuple, explanation["equivalents"])}


@pytest.fixture(scope="module")
def head(tmp_path_factory):
    """Five units of one head: level and pitch errors common; one has a nonlinearity, another three times the level."""
    return tmp_path_factory.mktemp("head")


@pytest.fixture
def diagnosed(head, tumblecal, few_effects):
    """The folder of results of five units; made once."""
    out = head / "out"
    if not out.exists():
        effects = [{"base_levelling": [LEVEL]} for _ in range(5)]
        effects[1]["second_order.y"] = [1.5e-3]
        effects[3] = {"base_levelling": [3 * LEVEL]}
        files = write_units(head / "units", setups_on_one_head(4, 5), effects, 4)
        assert tumblecal("diagnose", "--units", *files, "--out", out, "--workers", "1").code == 0
    return out


def test_what_all_units_share_is_the_heads(diagnosed):
    """And what a unit has by itself is its own."""
    batch = told(diagnosed)
    best = batch["explanations"][0]
    assert batch["schema"] == "tumblecal.diagnosis/1" and ("base_levelling",) in names(best)
    assert batch["verdict"] in ("identified", "ambiguous") and batch["detection"]["p_value"] < 1e-6
    assert best["probability"] > 0.8 and best["chosen"]
    effect = best["effects"][0]
    assert batch["origins"][effect]["belongs_to"] == "head" and batch["origins"][effect]["shared"] > 0.8
    assert [unit["folder"] for unit in batch["units"]] == [f"unit{k}" for k in range(5)]
    assert "second_order.y" in batch["units"][1]["effects"] and batch["units"][1]["probability"] > 0.5
    assert all(not batch["units"][k]["effects"] for k in (0, 2, 4)) and batch["units"][3]["effects"] == [effect]
    for k in range(5):
        own = told(diagnosed / f"unit{k}")
        assert own["causes"] == batch["units"][k]["causes"] and (diagnosed / f"unit{k}" / "calibration.json").exists()
    assert pl.read_csv(diagnosed / "summary.csv").height == 5


def test_a_unit_that_does_not_show_it_stands_out(diagnosed):
    units = told(diagnosed)["units"]
    assert [unit["outlying"] for unit in units] == [False, False, False, True, False]
    page = (diagnosed / "diagnosis.html").read_text()
    assert "(outlying)" in page and "<svg" in page and "second_order.y" in page
    assert "Check unit3 separately" in (diagnosed / "verdict.txt").read_text()


def test_a_later_calibration_on_that_head_is_better(diagnosed, tumblecal, tmp_path):
    """Four more units: errors of the sensor's parameters in their own sd, with the head known and without.

    The sd that are stated hold with it.
    """
    head = diagnosed / "head.toml"
    content = tomllib.loads(head.read_text())
    assert content["schema"] == "tumblecal.head/1"
    assert {"dbeta@0", "dbeta@45", "dbeta@90"} < set(content["parameters"]) and len(content["covariance"]) == 4
    setups = setups_on_one_head(2, 4)
    files = write_units(tmp_path / "later", setups, [{"base_levelling": [LEVEL]}] * 4, 2)
    squares = {}
    for options in ((), ("--head", head)):
        out = tmp_path / f"calibrated{len(options)}"
        # Without the head its level contradicts the model.
        assert tumblecal("calibrate", *files, "--out", out, *options).code == (0 if options else 3)
        errors, sd = [], []
        for number, setup in enumerate(setups):
            exact = json.loads((out / f"unit{number}" / "result.json").read_text())["methods"]["exact"]["parameters"]
            truth = np.concatenate([setup.nominal[name] for name in ("dK", "bias", "gamma")])
            errors.append([exact[name]["value"] for name in SENSOR] - truth)
            sd.append([exact[name]["sd"] for name in SENSOR])
        squares[len(options)] = np.mean(np.square(errors), axis=0), np.mean(np.square(np.array(errors) / sd))
    # 36 squares of standard normal errors: 1 +- 0.24; without the head's level they are larger by its bias.
    assert squares[2][1] < 1.7
    ratio = np.sqrt(squares[2][0] / squares[0][0])
    # dK_x, which is hidden behind dbeta_0 and bias_x, gains most.
    assert ratio[0] < 0.6 and np.exp(np.mean(np.log(ratio))) < 0.8


@pytest.mark.usefixtures("few_effects")
def test_a_sensors_effect_of_another_size_in_each_unit_is_not_the_heads(tumblecal, tmp_path):
    sizes = np.array([0.3, 1.7, 0.9, 1.4, -0.5]) * 1.2e-3
    setups = setups_on_one_head(3, 5, pitch=None)
    files = write_units(tmp_path / "units", setups, [{"cross_coupling.x.yz": [size]} for size in sizes], 3)
    out = tmp_path / "out"
    assert tumblecal("diagnose", "--units", *files, "--out", out, "--workers", "1").code == 0
    batch = told(out)
    best = batch["explanations"][0]
    assert batch["verdict"] == "adequate" and best["effects"] == [] and batch["causes"] == []
    assert best["by_unit"] == ["cross_coupling.x.yz"]
    assert batch["origins"]["cross_coupling.x.yz"]["belongs_to"] == "sensor"
    assert batch["origins"]["cross_coupling.x.yz"]["by_unit"] > 0.3
    # The pitch axis is set anew for each unit: nothing of this head is known.
    assert not batch["pitch_settings"]["common"] and not (out / "head.toml").exists()


HEAD = {
    "schema": '"tumblecal.head/1"',
    "made_of": "[]",
    "effects": '["index_gain"]',
    "parameters": '["index_gain", "dbeta@45"]',
    "units": '["mrad/rad", "mrad"]',
    "values": "[0.1, 1.0]",
    "sd": "[0.01, 0.1]",
    "covariance": "[[1e-4, 0.0], [0.0, 1e-2]]",
}
BAD_HEADS = [
    ({"effects": '["index_gian"]'}, "effects: unknown effect 'index_gian'"),
    ({"parameters": '["index_gain", "spin"]'}, "parameters: no parameter 'spin' of a head"),
    ({"units": '["mrad/rad", "mg"]'}, "units.1: 'mg' cannot be converted to 'rad'"),
    ({"values": "[0.1]"}, "values: 1 entries for 2 parameters"),
    ({"covariance": "[[1e-4, 0.0], [0.0]]"}, "covariance.1: 1 entries for 2 parameters"),
    ({"covariance": "[[1e-4, 1.0], [1.0, 1e-2]]"}, "covariance: not symmetric and positive definite"),
    ({"parameters": '["index_gain", "index_gain"]'}, "parameters: a name is repeated"),
    ({"parameters": '["index_gain", "dbeta_1"]'}, "'dbeta_1' is not the name of a pitch"),
    ({"parameters": '["index_gain", "dbeta@45.0"]'}, "'dbeta@45.0' is not the name"),
    ({"sd": "[0.01, 2.5]"}, "sd.1: 2.5, but the covariance gives 0.1; correct the wrong one"),
    ({"values": "[nan, 1.0]"}, "values.0: "),
    ({"effects": '["index_eccentricity"]', "parameters": '["index_eccentricity_c", "dbeta@45"]',
      "units": '["mrad", "mrad"]'}, "index_eccentricity has no parameter 'index_eccentricity_c'; give"),
    ({"effects": '["index_gain", "base_levelling"]'}, "base_levelling is missing"),
]  # fmt: skip


@pytest.mark.parametrize(("changed", "words"), BAD_HEADS)
def test_a_bad_head_file_is_one_line(tumblecal, tmp_path, table1_file, changed, words):
    head = tmp_path / "head.toml"
    head.write_text("\n".join(f"{key} = {value}" for key, value in (HEAD | changed).items()))
    outcome = tumblecal("calibrate", table1_file, "--head", head, "--noise-sd", "0.1mg", "--out", tmp_path / "out")
    assert outcome.code == 2 and len(outcome.lines) == 1
    assert str(head) in outcome.lines[0] and words in outcome.lines[0]
    assert not (tmp_path / "out").exists()
