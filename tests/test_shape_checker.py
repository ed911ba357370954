"""The checks of shapes and types of the long job see what they are for."""

from dataclasses import dataclass

import numpy as np
import pytest
from jaxtyping import Float, TypeCheckError

import shape_checker


decorated = shape_checker.jaxtyped(typechecker=None)


@decorated
def product(a: Float[np.ndarray, "rows columns"], b: Float[np.ndarray, " columns"]) -> Float[np.ndarray, " rows"]:
    return a @ b if a[0, 0] else b


@decorated
@dataclass(frozen=True)
class Pair:
    first: Float[np.ndarray, " positions"]
    second: Float[np.ndarray, " positions"]
    size: float = 1.0

    @property
    @decorated
    def total(self) -> Float[np.ndarray, " positions"]:
        return (self.first + self.second) * (np.ones((1, 1)) if self.size > 1 else 1.0)


def test_arguments_results_and_fields_of_wrong_shapes_are_caught():
    assert product(np.ones((2, 3)), np.ones(3)).shape == (2,)
    for wrong in ((np.ones((2, 3)), np.ones(2)), (np.ones(2), np.ones(2)), (np.zeros((2, 3)), np.ones(3)), ("a", "b")):
        with pytest.raises(TypeCheckError):
            product(*wrong)
    pair = Pair(np.ones(3), np.ones(3), 1)
    assert pair.total.shape == (3,)
    for fields in ((np.ones(3), np.ones(2)), (np.ones(3), np.ones((3, 1))), (np.ones(3), np.ones(3), "one")):
        with pytest.raises(TypeCheckError):
            Pair(*fields)
    with pytest.raises(TypeCheckError):
        _ = Pair(np.ones(3), np.ones(3), 2.0).total


def test_sizes_are_compared_within_one_call_alone():
    assert product(np.ones((2, 3)), product(np.ones((3, 5)), np.ones(5))).shape == (2,)
    assert Pair(np.ones(4), product(np.ones((4, 2)), np.ones(2))).total.shape == (4,)
