"""Frames, links, parameters; a rig from TOML. Independent of data files, fits and output."""

from tumblecal.chain.chain import Chain, hand_held_chain, nominal_chain
from tumblecal.chain.forward import Forward, Unknown, forward_chain
from tumblecal.chain.link import Link, Place, State
from tumblecal.chain.parameter import Parameter, coefficients, parameters_of, with_parameters, with_values
from tumblecal.chain.where import Where, settings


__all__ = [
    "Chain",
    "Forward",
    "Link",
    "Parameter",
    "Place",
    "State",
    "Unknown",
    "Where",
    "coefficients",
    "forward_chain",
    "hand_held_chain",
    "nominal_chain",
    "parameters_of",
    "settings",
    "with_parameters",
    "with_values",
]
