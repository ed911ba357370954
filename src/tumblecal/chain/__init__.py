"""Frames, links, parameters; a rig from TOML. Knows no file of data, no fit, no screen."""

from tumblecal.chain.chain import Chain as Chain
from tumblecal.chain.chain import hand_held_chain as hand_held_chain
from tumblecal.chain.chain import nominal_chain as nominal_chain
from tumblecal.chain.link import Link as Link
from tumblecal.chain.link import Place as Place
from tumblecal.chain.link import State as State
from tumblecal.chain.parameter import Parameter as Parameter
from tumblecal.chain.parameter import coefficients as coefficients
from tumblecal.chain.parameter import parameters_of as parameters_of
from tumblecal.chain.parameter import with_parameters as with_parameters
from tumblecal.chain.parameter import with_values as with_values
from tumblecal.chain.where import Where as Where
from tumblecal.chain.where import settings as settings
