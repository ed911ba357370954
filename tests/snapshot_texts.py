"""Texts of results compared with stored files: `pytest FOLDER --update-golden` writes these again."""

from collections.abc import Callable, Mapping

import pytest


@pytest.fixture
def snapshot(request) -> Callable[[str, Mapping[str, str]], None]:
    """Compare texts, each under its title, with the file `snapshots/NAME.txt` of the test's folder, or write it."""

    def compare(name: str, texts: Mapping[str, str]) -> None:
        path = request.path.parent / "snapshots" / f"{name}.txt"
        found = "\n".join(f"=== {title}\n{text.rstrip()}\n" for title, text in texts.items())
        if request.config.getoption("--update-golden"):
            path.parent.mkdir(exist_ok=True)
            path.write_text(found, encoding="utf-8")
            return
        assert path.exists(), f"{path} is missing: pytest {request.path} --update-golden writes it"
        assert found.splitlines() == path.read_text(encoding="utf-8").splitlines()

    return compare
