"""The parts of the diagnosis that `ablation.py` switches off, one at a time, in its process alone.

An entry replaces functions or constants. A file is reached by it where, in the ordinary run, the replacement would have given
another result than the function: of the other files the answers are equal by construction, as the program is deterministic.
"""

import ast
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import tumblecal.diagnosis
from tumblecal.diagnosis.lack_of_fit import lack_of_fit
from tumblecal.diagnosis.screening import noise_change, screen
from tumblecal.diagnosis.sets import cause_sets, classes, prior, search


# Number of causes from which on `sets of four causes` are reached.
_FOUR = 4
# Digits of log posteriors that are compared.
_DIGITS = 5


@dataclass(frozen=True)
class Replaced:
    """One function (or constant) of a module or class, by what it gives when it is switched off.

    - `instead`: called with the arguments; None: nothing is replaced, it is watched only. `watch`: whether it tells which files
      are reached.
    - `same`: whether a result of the function, and of the replacement, are equal.
    - `reaches`: gives, for the function and its arguments, its result and whether the replacement would differ.
    """

    owner: Any
    name: str
    instead: Any = None
    same: Callable[[Any, Any], bool] = lambda own, other: own is other
    watch: bool = True
    reaches: Callable[[Callable, tuple, dict], tuple[Any, bool]] | None = None

    def watched(self, function: Callable, reached: Callable[[], None]) -> Callable:
        """The function, which reports where the replacement would differ."""

        def call(*arguments, **options):
            if self.reaches is not None:
                result, differs = self.reaches(function, arguments, options)
            else:
                result = function(*arguments, **options)
                differs = not self.same(result, self.instead(*arguments, **options))
            if differs:
                reached()
            return result

        return call


@dataclass(frozen=True)
class Suspect:
    """A part of the diagnosis. `code`: files of `diagnosis/`, or `file:function`, that would go with it."""

    name: str
    replaced: tuple[Replaced, ...]
    code: tuple[str, ...]

    @property
    def lines(self) -> int:
        """Number of lines that would go."""
        return sum(map(_lines, self.code))


def _lines(code: str) -> int:
    folder = Path(next(iter(tumblecal.diagnosis.__path__)))
    file, _, name = code.partition(":")
    text = (folder / file).read_text()
    if not name:
        return len(text.splitlines())
    *outer, last = name.split(".")
    nodes = ast.walk(ast.parse(text))
    if outer:
        nodes = next(node for node in nodes if isinstance(node, ast.ClassDef) and node.name == outer[0]).body
    node = next(node for node in nodes if isinstance(node, ast.FunctionDef) and node.name == last)
    first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
    return (node.end_lineno or first) - first + 2


def _first(screened, *_):
    """The screen as it was."""
    return screened


def _second(_, screened, *__):
    """The screen as it was, of a method."""
    return screened


def _none(*_, **__):
    return None


def _empty(*_, **__) -> list:
    return []


def _false(*_, **__) -> bool:
    return False


def _searched(*replaced: tuple[Any, str, Any]) -> tuple["Replaced", "Replaced"]:
    """The watch of replacements that act within a search: it is done a second time with them, and what it ranks is compared."""

    def again(own, method: Callable, arguments: tuple, options: dict) -> Any:
        with ExitStack() as stack:
            for owner, name, instead in (*replaced, (search.Search, "run", _RUN)):
                stack.enter_context(patch.object(owner, name, instead))
            other = search.Search(own.pool, own.z, own.known)
            if method is _RUN and getattr(own, "after_several", False):
                _SEVERAL(other)
            return method(other, *arguments, **options)

    def run(function: Callable, arguments: tuple, options: dict) -> tuple[Any, bool]:
        ranked = function(*arguments, **options)
        return ranked, _scores(ranked) != _scores(again(arguments[0], _RUN, arguments[1:], options))

    def several(function: Callable, arguments: tuple, options: dict) -> tuple[Any, bool]:
        odds = function(*arguments, **options)
        arguments[0].after_several = True
        return odds, abs(odds - again(arguments[0], _SEVERAL, (), {})) > 10.0**-_DIGITS

    return Replaced(search.Search, "run", reaches=run), Replaced(search.Search, "several", reaches=several)


def _scores(ranked: cause_sets.Ranked) -> dict[cause_sets.Members, float]:
    """The log posteriors of the sets that are not negligible."""
    values = np.round(ranked.log_posterior, _DIGITS).tolist()
    return dict(zip(cause_sets.sets_of(ranked.members), values, strict=True))


def _classes_without_changes(groups, coefficients, shares, changes):
    return _NEAR(groups, coefficients, shares, None)


def _same_classes(own, other) -> bool:
    return own[0] == other[0] and bool(np.array_equal(own[1], other[1]))


def _no_curve(*_) -> dict:
    return {}


# Modules whose names their packages give to a function.
_DIAGNOSE = import_module("tumblecal.diagnosis.diagnose")
_UNITS = import_module("tumblecal.diagnosis.units.joint")
_NEAR = classes._near
_UP_TO_THREE = prior._LOG_SIZE.copy()
_UP_TO_THREE[_FOUR:] = -np.inf
_THREE_CAUSES = (
    (cause_sets, "MOST_CAUSES", _FOUR - 1),
    (search, "MOST_CAUSES", _FOUR - 1),
    (prior, "_LOG_SIZE", _UP_TO_THREE),
)
_NO_FAMILIES = ((search.Search, "_expand_families", _none), (search.Search, "_exchange_for_families", _none))
_NO_POSITIONS = (search, "off_together", _empty)
_RUN, _SEVERAL = search.Search.run, search.Search.several
# Those that free most lines first.
SUSPECTS = (
    Suspect(
        "sign variants",
        (Replaced(screen.Screening, "_signs_varied", _second),),
        (
            "causes/sign_variants.py", "screening/screen.py:Screening._signs_varied",
            "screening/screened.py:Screened.with_signs", "screening/screened.py:Screened.improves",
        ),
    ),
    Suspect("tests of positions in error", (
        Replaced(screen, "detected_positions", _first),
        Replaced(*_NO_POSITIONS, watch=False),
        *_searched(_NO_POSITIONS),
    ), ("sets/positions_off.py", "detection/detect.py:detected_positions")),
    Suspect(
        "location", (Replaced(_DIAGNOSE, "located", _empty, lambda own, other: own == other),), ("findings/location.py",)
    ),
    Suspect(
        "one curve", (
            Replaced(
                lack_of_fit.LackOfFit, "_of_one_curve", _no_curve, lambda own, other: len(own) == len(other)
            ),
        ),
        (
            "lack_of_fit/one_curve.py:one_curve", "lack_of_fit/one_curve.py:_in_direction",
            "lack_of_fit/lack_of_fit.py:LackOfFit._of_one_curve", "lack_of_fit/processes.py:Process.of_one_curve",
        ),
    ),
    Suspect(
        "two levels", (Replaced(_UNITS, "two_levels", _empty),),
        ("units/amounts.py:two_levels", "units/amounts.py:_split"),
    ),
    Suspect(
        "second reading of slips", (Replaced(_DIAGNOSE, "of_angles", _empty, lambda own, other: own == other),),
        ("screening/slips.py", "diagnose.py:Diagnoser._credence"),
    ),
    Suspect(
        "patchwork",
        tuple(Replaced(module, "is_patchwork", _false) for module in (classes, noise_change)),
        ("sets/patchwork.py", "sets/classes.py:Groups.patchwork"),
    ),
    Suspect("setting changes", (Replaced(classes, "_near", _classes_without_changes, _same_classes),), (
        "sets/setting_changes.py",
    )),
    Suspect("expansion and exchange of families", (
        *(Replaced(*own, watch=False) for own in _NO_FAMILIES),
        *_searched(*_NO_FAMILIES),
    ), (
        "sets/search.py:Search._expand_families", "sets/search.py:Search._may_score",
        "sets/search.py:Search._exchange_for_families",
    )),
    Suspect("level", (Replaced(noise_change, "_free_level", _none),), (
        "screening/noise_change.py:_free_level", "screening/noise_change.py:_sure_level",
    )),
    Suspect("sets of four causes", (
        *(Replaced(*own, watch=False) for own in _THREE_CAUSES),
        *_searched(*_THREE_CAUSES),
    ), ()),
)  # fmt: skip


@contextmanager
def without(suspect: Suspect) -> Iterator[None]:
    """The diagnosis with a part switched off."""
    with ExitStack() as stack:
        for replaced in suspect.replaced:
            if replaced.instead is not None:
                stack.enter_context(patch.object(replaced.owner, replaced.name, replaced.instead))
        yield


@contextmanager
def watched(suspects: Sequence[Suspect]) -> Iterator[set[str]]:
    """The ordinary diagnosis; holds the names of the suspects that it reached."""
    reached: set[str] = set()
    with ExitStack() as stack:
        for suspect in suspects:
            for replaced in suspect.replaced:
                if replaced.watch:
                    function = getattr(replaced.owner, replaced.name)
                    call = replaced.watched(function, lambda name=suspect.name: reached.add(name))
                    stack.enter_context(patch.object(replaced.owner, replaced.name, call))
        yield reached
