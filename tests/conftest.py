"""Strict test session: float64, no silent rank promotion, shapes of signatures checked at run time."""

import os
import shutil
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

from tumblecal.studies.threads import one_thread


# As the study commands do, so that their processes and this one give the same bits.
one_thread()

# Signatures' shapes and dtypes are checked wherever numerical functions are called; before the modules are imported.
install_import_hook(
    ["tumblecal.chain", "tumblecal.data", "tumblecal.estimation", "tumblecal.ground.frames"],
    "shape_checker.checked",
)

# Compiled programs of this session, its subprocesses included, go to a folder of its own.
_CACHE = tempfile.mkdtemp(prefix="tumblecal-tests-")
os.environ["TUMBLECAL_CACHE"] = _CACHE

# The same examples every time, and few: the whole suite runs on two cores.
settings.register_profile("tumblecal", max_examples=15, derandomize=True, deadline=None, database=None)
settings.load_profile("tumblecal")


def pytest_configure() -> None:
    import jax

    import tumblecal

    tumblecal.enable_float64()
    jax.config.update("jax_numpy_rank_promotion", "raise")
    jax.config.update("jax_numpy_dtype_promotion", "strict")


def pytest_unconfigure() -> None:
    shutil.rmtree(_CACHE, ignore_errors=True)


@pytest.fixture(scope="session")
def configs() -> Path:
    """The rigs that come with the program."""
    return Path(__file__).parents[1] / "configs"


@pytest.fixture(scope="session")
def table1():
    """The paper's Table 1."""
    from tumblecal.data import paper

    return paper.table1()


@pytest.fixture(scope="session")
def table1_fit(table1):
    """Its exact fit."""
    from tumblecal.estimation import exact, problem_of

    return exact.fit(problem_of(table1))


@pytest.fixture(scope="session")
def study():
    """The paper's simulation, all 600 sets."""
    from tumblecal.studies.paper_study import paper_study

    return paper_study()
