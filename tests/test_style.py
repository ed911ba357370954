"""Words that docs/style.md replaces do not occur in texts: pages, docstrings, comments and messages."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest


ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "tumblecal"
# docs/style.md, section 4; the phrases are those of its glossary.
REPLACED = re.compile(
    r"\b(anew|tells?|told|telling|stands?|stood|standing|holds?|holding|besides?|alike|apart|as well as|rivals?|mix-ups?"
    r"|put right|taken back|took no part|what (?:is|was) (?:left|said|told)|(?:sd|sigma|deg|step|positions?) off)\b",
    re.IGNORECASE,
)
# Uses that are right: terms of the field, and words of the program that are public.
ALLOWED = re.compile(r"standing wave|stand-?alone|rack|\brivals\b(?=[`\"'])|`[^`]*`|stands? for\b", re.IGNORECASE)
# Folders of src and pages whose texts are not revised yet.
PENDING: frozenset[str] = frozenset()
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
# The guide itself lists the words.
PAGES.remove(ROOT / "docs" / "style.md")


def found(text: str) -> list[str]:
    """The replaced words of a text."""
    return [match[0] for match in REPLACED.finditer(ALLOWED.sub(" ", text))]


def prose(page: Path) -> Iterator[tuple[int, str]]:
    """Lines of a page outside its blocks of code."""
    code = False
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        code ^= line.startswith("```")
        if not code and not line.startswith("    "):
            yield number, line


def texts(file: Path) -> Iterator[tuple[int, str]]:
    """Strings with a blank in them, docstrings among them, and comments of a source file."""
    source = file.read_text(encoding="utf-8")
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield node.lineno, node.value
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string


@pytest.mark.parametrize("page", [page for page in PAGES if page.name not in PENDING], ids=lambda page: page.name)
def test_pages_use_the_words_of_the_style_guide(page):
    assert not [f"{page.name}:{number}: {word}" for number, line in prose(page) for word in found(line)]


@pytest.mark.parametrize("folder", sorted({path.name for path in SOURCE.iterdir() if path.is_dir()} - PENDING))
def test_texts_of_the_source_use_the_words_of_the_style_guide(folder):
    files = (SOURCE / folder).rglob("*.py")
    faults = [
        f"{file.relative_to(SOURCE)}:{line}: {word}"
        for file in files
        for line, text in texts(file)
        for word in found(text)
    ]
    assert not faults, "\n".join(faults)


def test_the_search_finds_what_the_guide_replaces_and_nothing_that_is_right():
    assert found("Data do not tell it from what stands beside it.") == ["tell", "stands", "beside"]
    assert found("positions off by 8 sigma; 3 sd off") == ["positions off", "sd off"]
    assert found("held-out data of a hand-held set, an offset, `rivals`, turned off") == []
