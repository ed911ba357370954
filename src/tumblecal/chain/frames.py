"""Vectors of the chain: three components of JAX, and their rotations."""

from typing import TypeAlias

import numpy as np
from jaxtyping import Array, Float

from tumblecal.ground.frames import rotate_x as rotate_x
from tumblecal.ground.frames import rotate_y as rotate_y
from tumblecal.ground.frames import rotate_z as rotate_z


Component: TypeAlias = Float[Array | np.ndarray | np.floating, "..."]
Vector: TypeAlias = tuple[Component, Component, Component]
