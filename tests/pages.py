"""The pages of docs/: their blocks, and their examples run in the working folder."""

import re
import shlex
from pathlib import Path


ROOT = Path(__file__).parents[1]


def blocks(page: str, language: str) -> list[str]:
    """The blocks of a language, of a page of docs/."""
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.S | re.M)


def run_example(page: str, tumblecal, *options: str, code: int = 0) -> str:
    """What the last command of the first shell block prints, given these options in addition, after the page's program."""
    (program,) = blocks(page, "python")
    exec(compile(program, f"{page}.md", "exec"), {})
    *earlier, last = blocks(page, "sh")[0].splitlines()
    for command in earlier:
        assert tumblecal(*shlex.split(command)[1:]).code == 0
    outcome = tumblecal(*shlex.split(last)[1:], *options)
    assert outcome.code == code, outcome.lines
    return outcome.out
