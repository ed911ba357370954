"""The README's blocks as they stand, pasted in one go into a fresh shell, and their short ones once more in its folder."""

import os
import re
import shlex
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest


ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
# Pages whose Python runs after the README's, in its folder; the shell block of docs/index.md is one of the README's.
PYTHON = [(ROOT / "docs" / page).read_text(encoding="utf-8") for page in ("python.md", "extending.md", "jax.md")]
INDEX = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
# The two set-up commands are run by .ci/run itself.
_SET_UP = "python3 -m venv"
# Long; the guided run makes a new folder each time, so that its second run is a first one, and that a diagnosis replaces the
# one in its folder is tested in cli/test_results_apart.py.
_LONG = ("tumblecal emulate", "tumblecal diagnose measured.csv")


def blocks(language: str, *without: str, page: str = README) -> list[str]:
    written = re.findall(rf"^```{language}\n(.*?)^```", page, re.S | re.M)
    return [block for block in written if not any(words in block for words in (_SET_UP, *without))]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("readme")


def run(folder: Path, *arguments: str, without: str = "") -> str:
    """What a process prints, in this one's environment without one of its variables."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {name: value for name, value in os.environ.items() if name != without} | {"PATH": path}
    done = subprocess.run(arguments, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    return done.stdout


def run_again(folder: Path, tumblecal, shell: str, monkeypatch) -> str:
    """The commands of a block without variables and pipes, called in this process."""
    monkeypatch.chdir(folder)
    printed = ""
    for line in shell.splitlines():
        command, *words = shlex.split(line, comments=True)
        outcome = tumblecal(*words)
        assert command == "tumblecal" and outcome.code == 0, outcome.lines
        printed += outcome.out
    return printed


def shown_by(printed: str) -> bool:
    """Whether the README's table of a calibration was printed; the terminal's width breaks its lines."""
    (shown,) = (block for block in blocks("text") if "exact / u" in block)
    words = " ".join(printed.split())
    return all(" ".join(line.split()) in words for line in shown.splitlines() if line != "...")


def test_the_first_block_and_the_readme_s_python(tmp_path, tumblecal, monkeypatch):
    """The first commands of the next block, and the set-up commands, are run by .ci/run itself."""
    assert shown_by(run_again(tmp_path, tumblecal, blocks("sh")[0], monkeypatch))
    exec("".join(blocks("python")), {})


@pytest.mark.long
def test_the_shell_s_blocks_and_then_python_s(folder, tumblecal, monkeypatch):
    whole, again = "".join(blocks("sh")), "".join(blocks("sh", *_LONG))
    assert all(line in whole for block in blocks("sh", page=INDEX) for line in block.splitlines())  # docs/index.md
    assert all(words in whole for words in _LONG) and again.count("tumblecal ") >= 3
    # Compiled as users have it; what runs here and the Python below are compiled quickly, as everywhere in the tests.
    first = run(folder, "bash", "-euo", "pipefail", "-c", whole, without="JAX_DISABLE_MOST_OPTIMIZATIONS")
    assert shown_by(first) and shown_by(run_again(folder, tumblecal, again, monkeypatch))
    (captured,) = folder.glob("demo-*")
    assert "second_order.y" in (captured / "diagnosis" / "verdict.txt").read_text(encoding="utf-8")
    assert not (folder / "virtual-imu").is_symlink()  # the virtual instrument ended with its run
    assert (folder / "calibration" / "calibration.html").is_file() and (
        folder / "diagnosis" / "diagnosis.html"
    ).is_file()
    # Measured as proposed, the ambiguous example is identified.
    verdicts = [(folder / name / "verdict.txt").read_text(encoding="utf-8") for name in ("diagnosis", "again")]
    assert verdicts[0].startswith("AMBIGUOUS") and verdicts[1].startswith("IDENTIFIED")
    assert "bias_drift.x" in verdicts[1] and "second_order.z" in verdicts[1]
    absent = () if find_spec("numpyro") else ("import numpyro",)
    python = "".join(block for page in (README, *PYTHON) for block in blocks("python", *absent, page=page))
    said = run(folder, sys.executable, "-W", "error::DeprecationWarning", "-c", python)
    # The README's own clean data hold nothing but noise, whose sd the example states too low.
    assert "noise_attitude" not in said


def test_all_packages_of_the_pages_are_installed():
    pytest.importorskip("numpyro", reason="the block of docs/jax.md with numpyro was not run: install tumblecal[dev]")
