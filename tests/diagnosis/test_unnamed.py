"""What no entry explains: where it is, and the closed form that it has; errors added to numpy's instrument by their formula."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import blind_instrument as blind
from blind.acting import inputs
from tumblecal.chain import settings
from tumblecal.diagnosis.findings.candidate_law import Law, Term, candidate_law
from tumblecal.diagnosis.findings.law_forms import forms, values_of
from tumblecal.diagnosis.findings.residual_space import ResidualSpace
from tumblecal.diagnosis.findings.unexplained import excess
from tumblecal.effects import catalogue
from tumblecal.effects.users_file import Source, extended
from tumblecal.show.diagnosis import suggested_effect


class Instrument:
    """4 x 12 positions with an error that is added, and what the nominal parameters leave of it, linearised by numpy."""

    def __init__(self, seed: int):
        self.setup = blind.random_setup(np.random.default_rng(seed), 4, 12)
        setup = self.setup
        self.where = settings(
            setup.alpha, setup.beta, time_s=setup.time_s, temperature_degc=setup.temperature_degc, pitch=setup.pitch
        )
        self.u, self.t = inputs(setup), setup.time_s - setup.time_s[0]
        nominal, plain = blind.nominal_columns(setup), blind.readings(setup, setup.nominal, {})
        left, singular, _ = np.linalg.svd(nominal)
        self.basis = left[:, np.sum(singular > 1e-9 * singular[0]) :]
        moved = [
            blind.readings(replace(setup, **{name: getattr(setup, name) + 1e-6}), setup.nominal, {})
            for name in ("alpha", "beta")
        ]
        self.head = np.stack([(own - plain) / 1e-6 for own in moved], axis=2)

    def left(self, added, known: bool = True) -> tuple[ResidualSpace, SimpleNamespace]:
        """What a fit leaves of the error and noise of 0.1 mg, and the fit."""
        unit = blind.SIGMA if known else 1e-3
        errors = (added + blind.SIGMA * np.random.default_rng(7).normal(size=added.shape)).ravel() / unit
        z = self.basis.T @ errors
        whole = ResidualSpace(z, (self.basis / unit).T.reshape(len(z), -1, 3), known)
        sd = np.full(added.shape, unit)
        problem = SimpleNamespace(where=self.where, sd=sd)
        residuals = (self.basis @ z).reshape(-1, 3) * unit
        return whole, SimpleNamespace(problem=problem, residuals=residuals, retained=np.ones(len(added), bool))

    def law(self, whole: ResidualSpace) -> Law | None:
        return candidate_law(whole, self.where, self.u, self.head)


@pytest.fixture(scope="module")
def instrument():
    return Instrument(5)


def on(axis: int, values) -> np.ndarray:
    added = np.zeros((len(values), 3))
    added[:, axis] = values
    return added


@pytest.mark.parametrize("known", [True, False])
def test_a_local_error_is_found_where_it_is(instrument, known):
    alpha, beta = np.degrees(instrument.setup.alpha), np.degrees(instrument.setup.beta)
    inside = (alpha > 175) & (alpha < 245) & (beta > 25) & (beta < 65)
    added = 0.8e-3 * on(2, inside) - 0.5e-3 * on(0, inside)
    whole, fit = instrument.left(added, known)
    law = instrument.law(whole)
    found = excess(whole, fit, law)
    assert found.region == "alpha 180 to 240, beta 30 to 60"
    assert np.array_equal(found.positions, inside)
    assert [(own.axis, np.sign(own.high + own.low)) for own in found.ranges] == [("z", 1.0), ("x", -1.0)]
    assert np.max(np.abs(found.values[inside] - added[inside])) < 5e-4
    assert found.words.startswith("Excess at alpha 180 to 240, beta 30 to 60: z up to +") and "elsewhere" in found.words
    # The box is the law of it, on the two outputs, and held-out positions are predicted better.
    assert law is not None and {term.acts_on for term in law.terms} == {"x", "z"}
    assert np.max(np.abs(law.signal - added)) < 4e-4 and law.after_g < law.before_g


def test_a_product_of_inputs_is_found_with_its_size(instrument):
    u = instrument.u
    whole, fit = instrument.left(on(1, 2.5e-3 * u[:, 1] * u[:, 2] ** 2))
    law = instrument.law(whole)
    (term,) = law.terms
    assert (term.acts_on, term.form.words, term.unit) == ("y", ("u_y u_z^2",), "mg/g^3")
    assert abs(term.sizes[0] - 2.5e-3) < 4 * term.sd[0] < 1e-3
    assert term.form.held == {"powers": [0, 1, 2]}
    assert excess(whole, fit, law).words.startswith("Excess at all angles and times: y -")
    assert law.before_g > 1.5 * law.after_g and law.same == 1.0


def test_noise_has_no_law(instrument):
    assert all(instrument.law(instrument.left(np.zeros((48, 3)), known)[0]) is None for known in (True, False))


def test_the_file_has_the_law_as_it_was_fitted():
    """One form of each family: the file is accepted, and its functions are those that were fitted."""
    rng = np.random.default_rng(1)
    alpha, beta = (own.ravel() for own in np.meshgrid(np.radians(np.arange(0, 360, 45)), np.radians([0, 45, 90])))
    time, degc = np.arange(24) * 60.0, np.linspace(20.0, 26.0, 24)
    where = settings(alpha, beta, time_s=time, temperature_degc=degc)
    u, listed = rng.uniform(-1, 1, (24, 3)), forms(where)
    families, names = (
        {family: own[0] for family, own in listed.items()},
        [form.name for own in listed.values() for form in own],
    )
    assert len(families) > 15 and len(set(names)) == len(names)
    written = (
        "product",
        "knee",
        "box",
        "harmonic times decay",
        "power of temperature",
        "power of temperature times input",
    )
    terms = [
        Term(form, "z", (1e-3,) * len(form.code), (1e-4,) * len(form.code))
        for form in map(families.__getitem__, written)
    ]
    terms.append(terms[2]._replace(acts_on="alpha"))
    law = Law(tuple(terms), np.zeros((24, 3)), 1e-3, 5e-4, 1.0)
    record = SimpleNamespace(
        unnamed=SimpleNamespace(law=law), data=SimpleNamespace(source="a.csv"), entries=catalogue()
    )
    text = suggested_effect(record)
    entries = extended(catalogue(), [Source("suggested_effect.py", text)])
    assert len(entries) == len(catalogue()) + len(terms)
    product, square = entries["product_xxx.z"], entries["temperature_3.z"]
    assert product.forms == ({"axis": "z", "powers": [3, 0, 0]},) and product.unit == "mg/g^3"
    assert square.forms == ({"axis": "z", "powers": [0, 0, 0], "degc_power": 3, "reference_degc": 23.0},)
    values = values_of([families["harmonic times decay"]], where, u)
    tau = float(families["harmonic times decay"].words[0].partition("t/")[2].partition(" ")[0]) * 60
    assert np.allclose(values[1], np.cos(alpha) * np.exp(-time / tau), atol=0.02)
