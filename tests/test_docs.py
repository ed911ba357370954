"""What stands in the pages of docs/ and in the README is what the program understands: commands, TOML, Python."""

import doctest
import importlib
import inspect
import pkgutil
import re
import shlex
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

import tumblecal as package
from pages import ROOT, blocks
from tumblecal.cli.commands import app
from tumblecal.data import write_positions


PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
# A block of code, by what it begins with, and the test that runs it.
RUN_ELSEWHERE = {
    "README.md": "tests/test_readme.py",
    "jax.md": "tests/test_readme.py",
    "python.md": "tests/test_readme.py",
    "files.md": "tests/data/test_calibration_extended.py",
    "extending.md": "tests/test_readme.py",
    "index.md": "tests/test_readme.py",
    "own_effects.md": "tests/effects/test_users_effects.py",
    "plan.md": "tests/cli/test_plan.py",
    "thermal.md": "tests/report/test_thermal_page.py",
    "check.md": "tests/check/test_check_command.py",
}
# Pages whose shell blocks are run here, in this order: each has what those before it made.
WAY_OUT = ("certificate", "budget", "devices", "history")


# Packages with an `__all__`: the API reference documents these names, those of `tumblecal` itself, and no others.
PUBLIC = ("chain", "data", "devices", "diagnosis", "effects", "estimation", "noise", "planning", "simulation")


def public_objects(folder: str) -> dict[str, object]:
    """The public names of a folder, or with "" those that only the package itself has."""
    if folder:
        module = importlib.import_module(f"tumblecal.{folder}")
        return {name: getattr(module, name) for name in module.__all__}
    names = ["InputError", "enable_float64", *package._FROM]
    elsewhere = [thing for other in PUBLIC for thing in public_objects(other).values()]
    listed = {name: getattr(package, name) for name in names}
    return {name: thing for name, thing in listed.items() if all(thing is not other for other in elsewhere)}


_COMPILED = ("diagnosis", "planning", "simulation")  # their examples compile for seconds


@pytest.mark.parametrize(
    "folder", ["", *(pytest.param(name, marks=pytest.mark.long) if name in _COMPILED else name for name in PUBLIC)]
)
def test_every_public_name_has_an_example_that_runs(folder, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    finder, runner = doctest.DocTestFinder(exclude_empty=False), doctest.DocTestRunner()
    module, printed = importlib.import_module(f"tumblecal.{folder}" if folder else "tumblecal"), []
    documented = module.__doc__ or ""
    for name, thing in {"": module, **public_objects(folder)}.items():
        own = inspect.isclass(thing) or inspect.isfunction(thing)
        if name and not own:  # an alias or a table has no docstring of its own
            assert re.search(rf">>> .*\b{name}\b", documented), f"{name}: no example in the docstring of its package"
            continue
        tests = (
            finder.find(thing, name or folder, module=False)
            if name
            else [doctest.DocTestParser().get_doctest(documented, {}, folder, None, None)]
        )
        assert not name or tests[0].examples, f"{name}: no example"
        for test in tests:
            runner.run(test, out=printed.append)
    assert not runner.failures, "".join(printed)


def test_the_main_names_are_in_the_package_itself():
    """Their examples run above."""
    names = "read_positions PositionSet calibrate diagnose Chain Link Problem fit fit_many simulate"
    assert {*names.split()} <= {*dir(package)}
    assert all(">>> " in (getattr(package, name).__doc__ or "") for name in names.split())


def test_every_package_with_public_names_is_in_the_reference():
    source = ROOT / "src" / "tumblecal"
    assert sorted(PUBLIC) == sorted(
        file.parent.name for file in source.glob("*/__init__.py") if "__all__" in file.read_text(encoding="utf-8")
    )
    for folder in PUBLIC:
        page = (ROOT / "docs" / "api" / f"{folder}.md").read_text(encoding="utf-8")
        # A module of the same name hides a function from the generated page.
        hidden = [name for name in public_objects(folder) if (source / folder / f"{name}.py").exists()]
        assert all(f"::: tumblecal.{folder}.{name}.{name}" in page for name in hidden), folder


def test_messages_of_the_troubleshooting_page_are_the_program_s():
    """The first column quotes messages; what differs between them, or is joined from several texts, is a `…`."""
    page = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    quoted = [row.removeprefix("| `").partition("` | ")[0] for row in page.splitlines() if row.startswith("| `")]
    source = "\n".join(file.read_text(encoding="utf-8") for file in (ROOT / "src").rglob("*.py"))
    texts = re.sub(r"([\"'])\s+f?\1", "", source)  # adjacent texts are one
    words = " ".join(file.read_text(encoding="utf-8") for file in (ROOT / "src").rglob("*.words"))
    texts += re.sub(r"\s+", " ", re.sub(r"\{%.*?%\}", "", words))
    pieces = [(message, piece) for message in quoted for piece in message.split("…") if len(piece.strip()) > 3]
    assert len(quoted) > 20 and not [both for both in pieces if both[1].strip() not in texts]


def test_names_of_the_reference_exist():
    pages = "\n".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs" / "api").glob("*.md"))
    names = re.findall(r"(?:^::: |#)(tumblecal\.[\w.]+)", pages, re.M)
    assert len(names) > 30 and all(pkgutil.resolve_name(name) for name in names)


@pytest.mark.parametrize("page", ["architecture", "extending"])
def test_files_that_a_page_names_exist(page):
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    named = re.findall(r"`((?:\w+/)+(?:\w+\.py)?)[`:]", text)
    parents = (ROOT, ROOT / "src" / "tumblecal", ROOT / "src" / "tumblecal" / "diagnosis")
    assert len(named) > 10 and not [path for path in named if not any((parent / path).exists() for parent in parents)]


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
        elif language == "sh" and page.stem in WAY_OUT:
            continue  # run below
        elif language in ("python", "sh"):
            test = ROOT / RUN_ELSEWHERE[page.name]
            assert page.name in test.read_text(encoding="utf-8"), f"{page.name} is not read by {test}"
            compile(block, page.name, "exec") if language == "python" else shlex.split(block, comments=True)


def test_the_way_out_s_shell_blocks_run_as_they_stand_and_print_what_the_pages_say(
    tumblecal, tmp_path, monkeypatch, table1
):
    monkeypatch.chdir(tmp_path)
    Path("configs").symlink_to(ROOT / "configs")
    own = {"serial_number": "A-17", "gravity_ms2": "9.8123", "gravity_source": "gravimeter"}
    (lab,) = blocks("budget", "toml")
    Path("lab.toml").write_text(lab, encoding="utf-8")
    for page in WAY_OUT:
        printed = ""
        if page != "certificate":  # its own first line makes the file
            write_positions(Path("positions.csv"), replace(table1, comments=own))
        if page == "devices":  # its figures are of the calibration of these data
            assert tumblecal("calibrate", "positions.csv", "--no-figures", "--out", "calibration").code == 0
        for line in "".join(blocks(page, "sh")).splitlines():
            if line.startswith("tumblecal compare old/"):  # what a reader has from before
                shutil.copytree("calibration", "old")
                shutil.copytree("calibration", "new")
                shutil.copy("unit.params", "factory.params")
            command, *words = shlex.split(line)
            assert command == "tumblecal"
            outcome = tumblecal(*words)
            assert outcome.code == 0, (line, outcome.lines)
            printed += "\n".join([outcome.out, *outcome.lines, ""])
        for text in blocks(page, "text"):
            assert text in printed, (page, printed)
    for written in ("certificate.html", "dcc.xml"):
        assert (tmp_path / "calibration" / written).is_file()
    assert (tmp_path / "budget" / "budget.html").is_file() and (tmp_path / "page" / "history.html").is_file()


def test_completion_is_installed_by_one_command(tumblecal, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SHELL", "/bin/bash")
    assert tumblecal("--install-completion").code == 0
    (script,) = [path for path in tmp_path.rglob("*") if path.is_file() and path.name == "tumblecal"]
    written = script.read_text(encoding="utf-8")
    assert "calibrate" in written and "--noise-sd" in written
    assert "tumblecal --install-completion" in (ROOT / "README.md").read_text(encoding="utf-8")
