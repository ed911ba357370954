"""Frames, links, parameters; a rig from TOML. Independent of data files, fits and output."""

from tumblecal.chain.chain import Chain, hand_held_chain, nominal_chain
from tumblecal.chain.following import Following, followings_of
from tumblecal.chain.forward import Forward, Unknown, forward_chain
from tumblecal.chain.link import Link, Place, State
from tumblecal.chain.parameter import Parameter, coefficients, parameters_of, with_parameters, with_values
from tumblecal.chain.where import Where, settings


__all__ = [
    "Chain",
    "Following",
    "Forward",
    "Link",
    "Parameter",
    "Place",
    "State",
    "Unknown",
    "Where",
    "coefficients",
    "followings_of",
    "forward_chain",
    "hand_held_chain",
    "nominal_chain",
    "parameters_of",
    "settings",
    "with_parameters",
    "with_values",
]
