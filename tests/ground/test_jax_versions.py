"""The versions of JAX that are supported are those that CI tests, and its unpromised interfaces are in one module."""

import re
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest

import tumblecal
from tumblecal.ground.jax_interfaces import TESTED, store_executables_in


ROOT = Path(__file__).parents[2]
ADAPTER = "src/tumblecal/ground/jax_interfaces.py"


def parts(text: str) -> tuple[int, ...]:
    return tuple(map(int, text.split(".")))


def test_the_supported_versions_are_those_that_are_tested():
    """CI tests the oldest and the newest Python, with the constraints; and the lowest allowed versions of all packages."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (declared,) = (text for text in project["dependencies"] if re.match(r"jax\b", text))
    pinned = re.findall(r"^jax==([\d.]+)", (ROOT / "constraints.txt").read_text(encoding="utf-8"), re.M)
    pythons = re.findall(
        r'python: \["(.+?)".*"(.+?)"\]', (ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8")
    )
    listed = [text.split()[-1] for text in project["classifiers"] if re.search(r"Python :: 3\.\d", text)]
    remedy = f"after testing with it, change TESTED in {ADAPTER}, the limit in pyproject.toml, or constraints.txt"
    assert declared == f"jax>={TESTED[0]}", f"pyproject.toml allows {declared}, TESTED is {TESTED}: {remedy}"
    assert (min(pinned, key=parts), max(pinned, key=parts)) == TESTED, f"constraints.txt has jax {pinned}: {remedy}"
    assert pythons == [(listed[0], listed[-1])], f"CI tests Python {pythons}, pyproject.toml lists {listed}"
    own = version("jax")
    assert parts(TESTED[0]) <= parts(own) <= parts(TESTED[1]), f"jax {own} is not within {TESTED}: {remedy}"


def test_a_jax_without_the_interface_stores_nothing(monkeypatch):
    from jax._src import compilation_cache

    monkeypatch.delattr(compilation_cache, "get_file_cache")
    assert not store_executables_in(None, "")


@pytest.mark.parametrize("folder", ["src", "benchmarks"])
def test_no_other_module_uses_what_jax_does_not_promise(folder):
    private = re.compile(
        r"\bjax(?:\.| import )(?:_src|extend|experimental|interpreters|lib)\b|\bjaxlib\.\w|import jaxlib"
    )
    found = [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for path in sorted((ROOT / folder).rglob("*.py"))
        for line in path.read_text(encoding="utf-8").splitlines()
        if private.search(line) and path != ROOT / ADAPTER
    ]
    assert not found and Path(tumblecal.__file__).is_file(), f"move to {ADAPTER}: {found}"
