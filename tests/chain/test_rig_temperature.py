"""The `[temperature]` table of rig files: leaves, truth in physical coefficients, soaks, and every fault."""

import numpy as np
import pytest

from tumblecal import InputError
from tumblecal.chain import followings_of, nominal_chain, settings
from tumblecal.chain.rig_file import read_rig
from tumblecal.chain.rig_temperature import temperature_content
from tumblecal.effects import catalogue
from tumblecal.full_model.followed import already_followed
from tumblecal.ground.soaks import soaks
from tumblecal.ground.strict_toml import toml_lines
from tumblecal.ground.temperature_functions import TemperatureFunctions


DEGC = np.repeat([0.0, 15.0, 28.0, 41.0, 60.0], 24)


def rig_with(tmp_path, temperature: str, plan: str = ""):
    path = tmp_path / "rig.toml"
    plan = plan or "alpha_deg = { start = 0, step = 45, count = 8 }\nbeta_deg = [0, 45, 90]\n"
    path.write_text(
        f'schema = "tumblecal.rig/1"\n[plan]\n{plan}temperature_degc = [-10, 25, 60]\n{temperature}\n[noise]\nsd = "0.1 mg"\n'
    )
    return read_rig(path)


def test_reference_and_range_are_stated_or_of_the_data(tmp_path):
    def functions(words, degc):
        rig = rig_with(tmp_path, f"[temperature]\n{words}\n[temperature.bias]\norder = 1")
        where = settings(np.zeros(len(degc)), np.zeros(len(degc)), temperature_degc=degc)
        return followings_of(rig.chain(where))[0].functions

    assert functions("", [0.0, 60.0]).reference_degc == 25.0
    assert functions("", [30.0, 60.0]).reference_degc == 45.0
    assert functions("reference_degc = 20", [30.0, 60.0]).reference_degc == 20.0
    assert functions("", [30.0, 60.0]).range_degc == (30.0, 60.0)
    assert functions("range_degc = [-20, 80]", [30.0, 60.0]).range_degc == (-20.0, 80.0)


def test_soaks_are_groups_of_temperatures_with_larger_steps_between():
    noise = np.random.default_rng(1).uniform(-0.3, 0.3, len(DEGC))
    np.testing.assert_allclose(soaks(DEGC + noise), [0, 15, 28, 41, 60], atol=0.2)
    assert len(soaks(np.repeat([0.0, 30.0, 60.0], 24) + np.tile(np.linspace(0, 2.4, 24), 3))) == 3
    assert len(soaks(np.linspace(0.0, 60.0, 24))) == 24 and soaks(np.full(9, 25.0)) == [25.0]


UNDETERMINED = [
    ("order = 3", (0, 25, 60), r"order 3 needs 4 or more soaks; .* 3 soaks \(0, 25, 60 degC\), .* at most order 2"),
    ("knots_degc = [20, 40]", (0, 15, 30, 45, 60), "knots at 20, 40 degC needs 6 or more .* at most 1 knot"),
    ("knots_degc = [20]", (0, 25, 60), "a knot at 20 degC needs 5 or more soaks; .* at most order 2"),
    ("order = 1", (25, 25.3), r"one temperature \(25.15 degC\), which determines no change of bias"),
    ("knots_degc = [70]", (0, 9, 18, 30, 45, 60), "knots 70 degC: they must increase within the range -0.01 to"),
    ("order = 1", None, "bias follows temperature, but the data have no column temperature_degc"),
]


@pytest.mark.parametrize(("table", "degc", "words"), UNDETERMINED)
def test_temperatures_that_cannot_determine_the_functions(tmp_path, table, degc, words):
    rig = rig_with(tmp_path, f"[temperature.bias]\n{table}")
    degc = None if degc is None else np.repeat(np.array(degc, float), 8) + np.tile([-0.01, 0.01], 4 * len(degc))
    count = 8 if degc is None else len(degc)
    where = settings(np.zeros(count), np.zeros(count), temperature_degc=degc)
    with pytest.raises(InputError, match=rf"rig\.toml:line \d+: temperature\.bias: .*{words}"):
        rig.chain(where)


def test_all_faults_of_the_table_are_reported_together(tmp_path):
    with pytest.raises(InputError) as raised:
        rig_with(
            tmp_path,
            """
[temperature]
reference_degc = "warm"
range_degc = [60, 0]
[temperature.bias]
order = 6
[temperature.dK]
[temperature.gama]
order = 1
[temperature.dtheta]
order = 2
knots_degc = [10]
""",
        )
    text = "\n".join(raised.value.faults)
    for words in (
        "line 8: temperature.reference_degc: must be a number",
        "temperature.bias.order: must be 5 or less (got 6)",
        "temperature.dK: give order = 0 to 5 (a polynomial), or knots_degc = [10, 30] (a cubic spline)",
        "temperature.gama: unknown key; did you mean gamma?",
        "temperature.dtheta: a cubic spline has order 3; remove order, or knots_degc",
    ):
        assert words in text


def test_the_tables_of_a_chain_describe_it(configs, tmp_path):
    rig = read_rig(configs / "thermal_soaks.toml")
    chain = rig.true_chain(rig.where)
    text = (configs / "thermal_soaks.toml").read_text()
    first, last = text.index("[temperature]"), text.index("[noise]")
    path = tmp_path / "again.toml"
    path.write_text(text[:first] + "\n".join(toml_lines({"temperature": temperature_content(chain)})) + text[last:])
    again = read_rig(path)
    assert again.temperature.range_degc == (0.0, 60.0)
    np.testing.assert_allclose(again.true_chain(again.where).vector, chain.vector, rtol=1e-12)


def test_effects_that_the_chain_includes_are_not_tested():
    where = settings(np.zeros(9), np.zeros(9), time_s=np.arange(9.0), temperature_degc=np.linspace(0, 60, 9))

    def included(**orders):
        functions = {leaf: TemperatureFunctions(order, 25.0, (0.0, 60.0)) for leaf, order in orders.items()}
        chain = nominal_chain(where, temperature=functions)
        return {id for id, effect in catalogue().items() if already_followed(effect, chain, where)}

    bias = {f"bias_temperature.{axis}" for axis in "xyz"}
    assert included(bias=1) == bias
    second = {f"bias_temperature_{order}.{axis}" for order in ("square", "quadratic") for axis in "xyz"}
    assert included(bias=2) == bias | second
    assert included(dK=1) == {f"scale_temperature.{axis}" for axis in "xyz"}
    assert included(gamma=1) == {"misalignment_temperature.y", "misalignment_temperature.z"}
    assert included(dtheta=1) == {"mount_temperature"}
    mounted = {"mount_temperature", *(f"misalignment_temperature.{axis}" for axis in "xyz")}
    assert included(gamma=1, dtheta=1) == mounted
    assert included() == set()
