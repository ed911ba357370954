"""The picture of an unexplained error: maps over the angles, and the candidate law against its variable."""

from types import SimpleNamespace

import numpy as np
import pytest

from tumblecal.show.figures.unnamed import small_unnamed_figure, unnamed_figure


ALPHA, BETA = (values.ravel() for values in np.meshgrid(np.arange(0.0, 360, 45), [0.0, 45, 90]))
SIGNAL = 1e-3 * np.stack([0 * ALPHA, 0 * ALPHA, np.cos(np.radians(ALPHA))], axis=1)


def diagnosis(against=None, region=False):
    """A diagnosis with an unexplained error on z, and a law that follows a variable."""
    count = len(ALPHA)
    excess = SimpleNamespace(values=1.1 * SIGNAL, positions=ALPHA > 180, region="alpha above 180" if region else "")
    form = SimpleNamespace(against=against, words=("cos(alpha)",))
    term = SimpleNamespace(form=form, acts_on="z", sizes=(1e-3,), sd=(1e-4,), unit="mg")
    law = SimpleNamespace(terms=(term,), signal=SIGNAL) if against else None
    space = np.linalg.qr(np.ones((SIGNAL.size, 1)))[0]
    problem = SimpleNamespace(rows=np.ravel, unwhitened=lambda rows: rows.reshape(-1, 3))
    data = SimpleNamespace(
        alpha_deg=ALPHA, beta_deg=BETA, time_s=60.0 * np.arange(count), temperature_degc=np.linspace(20, 25, count)
    )
    inputs = SimpleNamespace(at=SimpleNamespace(evaluation=SimpleNamespace(inputs=SIGNAL / 1e-3)))
    fit = SimpleNamespace(rows=np.zeros(SIGNAL.size), column_space=space, problem=problem)
    return SimpleNamespace(unnamed=SimpleNamespace(excess=excess, law=law, fit=fit), data=data, screened=inputs)


@pytest.mark.parametrize(
    ("against", "label"),
    [("alpha", "alpha / °"), ("time", "time / min"), ("temperature", "temperature / °C"), ("u_z", "u_z / g")],
)
def test_the_law_is_drawn_against_its_variable_on_the_most_affected_output(against, label):
    for figure in (
        unnamed_figure(diagnosis(against)),
        small_unnamed_figure(diagnosis(against), diagnosis(against).unnamed),
    ):
        panel = figure.axes[3] if len(figure.axes) > 3 else figure.axes[0]
        measured, law = panel.lines[:2]
        assert (panel.get_xlabel(), panel.get_ylabel()) == (label, "z / mg")
        np.testing.assert_allclose(measured.get_ydata(), 1.1e3 * SIGNAL[:, 2], atol=1e-12)
        np.testing.assert_allclose(law.get_ydata(), 1e3 * SIGNAL[:, 2], atol=1e-9)


def test_without_a_law_each_output_is_a_map_and_the_region_is_circled():
    found = diagnosis(region=True)
    figure = unnamed_figure(found)
    maps = [panel for panel in figure.axes if panel.get_title().endswith("/ mg")]
    assert [panel.get_title() for panel in maps] == ["x / mg", "y / mg", "z / mg"]
    circled = maps[2].lines[0].get_xdata()
    np.testing.assert_array_equal(circled, ALPHA[ALPHA > 180])
    assert small_unnamed_figure(found, found.unnamed).axes[0].get_title() == "z / mg"
    assert unnamed_figure(SimpleNamespace(unnamed=None)) is None
