"""Forms of effects as terms of a calibration file, and a test that a form equals the function of its effect."""

from dataclasses import replace
from functools import partial
from typing import Any

import jax.numpy as jnp
import numpy as np

from tumblecal.chain import Chain, State, Where, settings
from tumblecal.data.calibration_terms import Term, terms_of
from tumblecal.effects import Effect
from tumblecal.effects.catalogue import catalogue
from tumblecal.effects.effect import MEAN
from tumblecal.ground.axes import AXES
from tumblecal.ground.errors import InputError
from tumblecal.ground.frames import gravity_in_head
from tumblecal.ground.units import factor


# A form and its term are the same function within this share of the coefficient.
_SAME = 1e-9


def term_of_form(form: dict[str, Any], where: Where, *, effect: str, determined: bool) -> Term:
    """A form of an effect as a term of a calibration file, its coefficient zero.

    **Raises:** `InputError` for a form that no calibration file can contain.
    """
    if form.get("reference_degc") == MEAN and where.temperature_degc is not None:
        form = form | {"reference_degc": float(np.mean(np.asarray(where.temperature_degc)))}
    stated = form | {"coefficient": 0.0, "effect": effect, "determined": determined}
    return terms_of([stated], f"effect {effect}: forms")[0]


def per_hour(term: Term, unit: str) -> float:
    """Factor from a coefficient of a chain to that of a file: chains use seconds, files hours."""
    return factor(unit, unit.replace("/s", "/h")) if term.per_hour and "/s" in unit else 1.0


def require_forms(effect: Effect) -> None:
    """Compare the forms of a user effect with the contribution of its link to the readings, at many attitudes, times and
    temperatures.

    **Raises:** `InputError` for a form that is a different function, as a calibration file would correct with the form.
    """
    if not effect.forms or effect.make is None or catalogue().get(effect.id) is effect:
        return
    where = _samples()
    chain = Chain(effect.make(where)[:1])
    f = gravity_in_head(np.asarray(where.alpha), np.asarray(where.beta))
    x, y, z = (jnp.asarray(part) for part in f.T)
    nothing = jnp.zeros(len(f))
    state = partial(State, jnp.asarray(where.alpha), jnp.asarray(where.beta), (x, y, z))
    for number, (form, scale, unit) in enumerate(zip(effect.forms, chain.scales, chain.units, strict=True)):
        term = term_of_form(form, where, effect=effect.id, determined=True)
        vector = np.zeros(len(chain.vector))
        vector[number] = scale
        made = chain.at(vector).links[0](state((nothing, nothing, nothing)), where)
        added = np.stack([np.asarray(part) for part in made.reading], axis=-1) / scale
        stated = np.zeros_like(added)
        unit_term = replace(term, coefficient=per_hour(term, unit))
        factors = unit_term.factor(np.asarray(where.temperature_degc), np.asarray(where.time_s))
        stated[:, AXES.index(term.axis)] = factors * term.of_inputs(f)
        if np.max(np.abs(added - stated)) > _SAME * max(1.0, float(np.max(np.abs(added)))):
            raise InputError(
                f"effect {effect.id}: forms.{number}: differs from the function of the effect (up to "
                f"{np.max(np.abs(stated)):.3g} instead of {np.max(np.abs(added)):.3g} for a coefficient of 1 {unit}). Correct "
                "the form, or omit forms"
            )


def _samples() -> Where:
    """Positions over the whole sphere at many times and temperatures."""
    alpha, beta = np.meshgrid(np.radians(np.arange(5, 360, 30.0)), np.radians([-80.0, -45.0, 10.0, 50.0]))
    count = alpha.size
    return settings(
        alpha.ravel(),
        beta.ravel(),
        run=[str(k % 2) for k in range(count)],
        time_s=np.linspace(0.0, 7200.0, count),
        temperature_degc=np.linspace(-20.0, 60.0, count)[np.arange(count) * 7 % count],
        approach=np.where(np.arange(count) % 2, 1.0, -1.0),
    )
