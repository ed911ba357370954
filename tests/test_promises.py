"""docs/promises.md names tests and scripts that exist."""

import re
from pathlib import Path

import pytest


ROOT = Path(__file__).parents[1]
NAMED = sorted(set(re.findall(r"`((?:tests|benchmarks)/[^` ]+)", (ROOT / "docs" / "promises.md").read_text("utf-8"))))


@pytest.mark.parametrize("named", NAMED)
def test_what_is_named_exists(named):
    file, _, function = named.partition("::")
    assert (ROOT / file).is_file()
    assert not function or f"def {function}(" in (ROOT / file).read_text("utf-8")
