"""What stands in the pages of docs/ and in the README is what the program understands: commands, TOML, Python."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest

from tumblecal.cli import app


ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
# A block of code, by what it begins with, and the test that runs it.
RUN_ELSEWHERE = {
    "README.md": "tests/test_readme.py",
    "files.md": "tests/data/test_calibration_extended.py",
    "diagnosis.md": "tests/effects/test_users_effects.py",
}


def commands() -> list:
    """Every command line of the pages, with its page; what stands after `#`, `|` or `&` left out."""
    listed = []
    for page in PAGES:
        for line in page.read_text(encoding="utf-8").splitlines():
            inline = re.findall(r"`(tumblecal [^`]+)`", line)
            whole = re.findall(r"^(?:    )?(?:\S*/)?(tumblecal .*)$", line)
            for text in dict.fromkeys([*inline, *whole]):
                words = shlex.split(text.split(" | ")[0].removesuffix("&"), comments=True)
                listed.append(pytest.param(words[1:], id=f"{page.name}: {' '.join(words)[:80]}"))
    return listed


@pytest.mark.parametrize("words", commands())
def test_every_command_of_the_pages_is_one(words, monkeypatch, tmp_path):
    if words[:1] == ["help"] or {*words} & {"--version", "--help", "--install-completion"} or "..." in words:
        return
    missing = len(words) == 1 or words[-1].endswith("...")
    words = [word.strip("[]") for word in words if word != "..."]
    try:
        app.parse_args(words, print_error=False, exit_on_error=False)
    except Exception as error:
        # A command that is only named lacks its file; an option or a command that does not exist is a fault.
        said = str(error)
        assert "requires an argument" in said or missing, said


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_blocks_are_toml_or_run_by_a_test(page):
    text = page.read_text(encoding="utf-8")
    for language, block in re.findall(r"^```(\w+)\n(.*?)^```", text, re.S | re.M):
        if language == "toml":
            tomllib.loads(block)
        elif language == "sh" and page.name not in RUN_ELSEWHERE:
            shlex.split(block, comments=True)  # its commands are parsed above
        elif language in ("python", "sh"):
            test = ROOT / RUN_ELSEWHERE[page.name]
            assert page.name in test.read_text(encoding="utf-8"), f"{page.name} is not read by {test}"
            compile(block, page.name, "exec") if language == "python" else shlex.split(block, comments=True)


def test_completion_is_installed_by_one_command(tumblecal, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SHELL", "/bin/bash")
    assert tumblecal("--install-completion").code == 0
    (script,) = [path for path in tmp_path.rglob("*") if path.is_file() and path.name == "tumblecal"]
    written = script.read_text(encoding="utf-8")
    assert "calibrate" in written and "--noise-sd" in written
    assert "tumblecal --install-completion" in (ROOT / "README.md").read_text(encoding="utf-8")
