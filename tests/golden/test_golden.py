"""The answers of the commands are those in `answers/`: numbers, verdicts, labels, files.

    pytest tests/golden --update-golden

writes them again and prints what changed.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import cases
import diagnoses
import headers
from answer import differences
from commands import answer_of


ANSWERS = Path(__file__).parent / "answers"


@pytest.fixture
def compared(request) -> Callable[[str, dict[str, Any]], None]:
    """Compare the answers of a group with those of its file, or write it."""

    def compare(group: str, found: dict[str, Any]) -> None:
        path = ANSWERS / f"{group}.json"
        stored = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        found = json.loads(json.dumps(found))
        changed = list(differences(stored, found))
        if request.config.getoption("--update-golden"):
            entries = [
                f"{json.dumps(name)}: {json.dumps(entry, separators=(',', ':'))}" for name, entry in found.items()
            ]
            path.write_text("{\n" + ",\n".join(entries) + "\n}\n", encoding="utf-8")
            with request.config.pluginmanager.get_plugin("capturemanager").global_and_fixture_disabled():
                print(f"\n{group}: {len(changed)} changed", *changed[:50], sep="\n")
        else:
            assert not changed, "\n".join(changed[:50])

    return compare


GROUPS = [pytest.param(name, marks=[pytest.mark.long] * (name == "more")) for name in cases.GROUPS]


@pytest.mark.parametrize("group", GROUPS)
def test_commands(group, compared, tmp_path):
    found = {}
    for name, case in cases.GROUPS[group].items():
        folder = tmp_path / name.replace("/", "_").replace(" ", "_")
        folder.mkdir()
        found[name] = answer_of(case, folder)
    compared(group, found)


def test_diagnoses(compared, tmp_path):
    compared("diagnoses", diagnoses.answers(tmp_path))


def test_headers_of_recordings(compared, tmp_path):
    compared("headers", headers.answers(tmp_path))
