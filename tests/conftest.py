"""Strict test session: float64, no silent rank promotion; in the long job, shapes of signatures checked at run time."""

import gc
import importlib
import os
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

import compiled_once
import shape_checker
from tumblecal.studies.threads import use_one_thread


# As the study commands do, so that their processes and this one give the same bits.
use_one_thread()

# What runs for a moment is compiled quickly, in the commands that are started too; `fully_compiled` is what users have.
os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] = "1"

# The garbage collector looks seldom: what is imported stays, and it would look at all of it again and again.
gc.set_threshold(50_000, 20, 50)

# In the long job, shapes and dtypes of the signatures of numerical functions are checked; before the modules are imported.
if os.environ.get("TUMBLECAL_CHECK_SHAPES"):
    shape_checker.begin()
    install_import_hook(
        [
            "tumblecal.chain",
            "tumblecal.data",
            "tumblecal.devices",
            "tumblecal.estimation",
            "tumblecal.ground.frames",
            "tumblecal.history.comparison",
            "tumblecal.history.repeatability",
        ],
        "shape_checker.checked",
    )

compiled_once.begin()

# The same examples every time, and few: the whole suite runs on two cores.
settings.register_profile("tumblecal", max_examples=15, derandomize=True, deadline=None, database=None)
settings.load_profile("tumblecal")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-golden",
        action="store_true",
        help="write tests/golden/answers and the snapshots/ again; print what changed",
    )


def pytest_configure() -> None:
    import jax

    import tumblecal

    tumblecal.enable_float64()
    jax.config.update("jax_numpy_rank_promotion", "raise")
    jax.config.update("jax_numpy_dtype_promotion", "strict")
    compiled_once.keep_programs()


# Files that take longest, so that with `--dist loadfile` none of them is begun last and waited for by all; two that compile
# the same are not begun together.
LONGEST = (
    "golden/test_golden",
    "studies/test_resumed_studies",
    "capture/test_recorder",
    "certificate/test_certificate",
    "capture/test_run_folder",
    "recordings/test_recordings",
    "diagnosis/test_rates",
    "cli/test_set_up_mistakes",
    "tests/test_docs",
    "tests/test_readme",
    "thermal/test_thermal_calibration",
    "history/test_changes",
    "simulation/test_many_fits",
    "estimation/test_attitude_scatter",
    "simulation/test_batch",
    "report/test_page",
    "capture/test_bad_input",
    "capture/test_signals",
    "cli/test_output",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    rank = {name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get("/".join(item.path.with_suffix("").parts[-2:]), len(rank)))


def pytest_collection_finish() -> None:
    """What is imported stays."""
    gc.collect()
    gc.freeze()


def pytest_unconfigure() -> None:
    compiled_once.end()


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


@pytest.fixture(scope="module")
def fully_compiled():
    """All that is compiled here, and by the processes that are started, is optimised as it is for users."""
    import jax

    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("JAX_DISABLE_MOST_OPTIMIZATIONS")
        jax.config.update("jax_disable_most_optimizations", False)
        yield
        jax.config.update("jax_disable_most_optimizations", True)


@pytest.fixture(scope="module")
def quickly_compiled():
    """What a study compiles for minutes of work is compiled without optimisation here, where it works for a moment."""
    import jax

    from tumblecal.estimation.programs import compiler_options

    real = jax.jit

    def jit(function, **options):
        # Only what is compiled here and now: libraries keep what they make, and nest it.
        caller = sys._getframe(1).f_globals["__name__"]
        here = caller.startswith(("tumblecal.studies.", "tumblecal.simulation.", "test_"))
        return real(function, **({"compiler_options": compiler_options()} if here else {}) | options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jax, "jit", jit)
        yield


@dataclass(frozen=True)
class Outcome:
    """What a command left: exit code, what it printed, its error lines."""

    code: int
    out: str
    lines: list[str]


# Figures are drawn for those who look at them, and where a name or a value might spoil one; written by others they are blank.
DRAWN = (
    "report",
    "budget",
    "history",
    "capture",
    "studies",
    "test_notebook",
    "test_commands",
    "test_full_disk",
    "test_control_characters",
    "test_effects_everywhere",
)


@pytest.fixture(scope="module", autouse=True)
def figures_where_they_matter(request):
    """Figures are made whole, but drawn, which takes longer than most diagnoses, only in the tests of `DRAWN`."""
    if not {request.path.parent.name, request.path.stem}.isdisjoint(DRAWN):
        yield
        return
    from tumblecal.show.figures import drawing

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drawing, "svg_text", lambda figure: "<svg></svg>")
        yield


@pytest.fixture
def tumblecal(monkeypatch, capsys):
    """The command line as it is installed, called in this process with its arguments."""
    from tumblecal.cli.run import run as run_command_line

    monkeypatch.delenv("COLUMNS", raising=False)  # as wide as the test runner's terminal, which is not the user's

    def run(*arguments) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["tumblecal", *map(str, arguments)])
        try:
            with warnings.catch_warnings():
                # That the arguments are read from sys.argv is what is wanted here.
                warnings.filterwarnings("ignore", message="Cyclopts application invoked without tokens")
                code = run_command_line()
        except SystemExit as end:
            code = int(end.code or 0)
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err.splitlines())

    yield run
    compiled_once.keep_programs()


@pytest.fixture
def few_effects(monkeypatch):
    """Commands and diagnosers know few effects, and the user's own; see the module of this name."""
    from few_effects import few_entries

    few = SimpleNamespace(ENTRIES=few_entries().values())
    monkeypatch.setattr(importlib.import_module("tumblecal.effects.catalogue"), "MODULES", [few])


@pytest.fixture
def table1_file(tmp_path, table1):
    """Table 1 as a user's file."""
    from tumblecal.data import write_positions

    path = tmp_path / "table1.csv"
    write_positions(path, table1)
    return path
