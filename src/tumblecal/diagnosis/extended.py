"""The extended chain as a chain: nominal links with the winning ones in it, at the fitted values."""

import dataclasses

import jax
import numpy as np

from tumblecal.chain import Chain, Link, Parameter
from tumblecal.diagnosis.adapt import Fit
from tumblecal.diagnosis.candidates import Candidate
from tumblecal.diagnosis.model import Model


def extended_chain(model: Model, fit: Fit, members: tuple[Candidate, ...]) -> Chain:
    """The nominal chain at the fitted values, with the links of the fitted effects.

    **Arguments:**

    - `model`, `fit`: the fit's full vector. `members`: the causes; those that are no effect add no link.
    """
    chain = model.nominal_chain.at(fit.vector[: model.nominal])
    for one in members:
        if one.slot is None:
            continue
        values = dict(zip(one.slot.names, _slot_values(fit, one), strict=True))
        for link in one.slot.links:
            chain = chain + _valued(link, values)
    return chain


def _slot_values(fit: Fit, one: Candidate) -> list[float]:
    """Values of a slot in the order of its names: links' leaves in turn, amplitudes and shapes as they stand."""
    assert one.slot is not None
    return [float(fit.vector[column]) for column in sorted((*one.slot.columns, *one.slot.shape))]


def _valued(link: Link, values: dict[str, float]) -> Link:
    def replaced(node):
        if not isinstance(node, Parameter):
            return node
        numbers = np.array([values.get(name, old) for name, old in zip(node.names, np.ravel(node.value), strict=True)])
        return dataclasses.replace(node, value=numbers.reshape(node.value.shape))

    return jax.tree.map(replaced, link, is_leaf=lambda node: isinstance(node, Parameter))
