"""Frames, links, parameters; a rig from TOML. Knows no file of data, no fit, no screen."""

from tumblecal.chain.chain import Chain as Chain, nominal_chain as nominal_chain
from tumblecal.chain.link import Link as Link, Place as Place, State as State
from tumblecal.chain.parameter import Parameter as Parameter, coefficients as coefficients
from tumblecal.chain.where import Where as Where, settings as settings
