"""The README's blocks as they stand, pasted in one go into a fresh shell, twice in a row."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest


ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
# The two set-up commands (run by .ci/run itself), the guided run of a minute (tests/capture/test_guided_run.py), and the study
# (tests/studies/test_linearization_study.py).
_ELSEWHERE = ("python3 -m venv", "tumblecal emulate", "tumblecal study linearization")


def blocks(language: str) -> list[str]:
    return [
        block
        for block in re.findall(rf"^```{language}\n(.*?)^```", README, re.S | re.M)
        if not any(words in block for words in _ELSEWHERE)
    ]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("readme")
    (folder / "configs").symlink_to(ROOT / "configs")
    return folder


def run(folder: Path, *arguments: str) -> str:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        arguments, cwd=folder, env=os.environ | {"PATH": path}, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    return done.stdout


def test_the_shell_s_blocks_and_then_python_s(folder):
    shell = "".join(blocks("sh"))
    assert shell.count("tumblecal ") >= 5
    for _ in range(2):
        run(folder, "bash", "-euo", "pipefail", "-c", shell)
    assert (folder / "calibration" / "calibration.html").is_file() and (
        folder / "diagnosis" / "diagnosis.html"
    ).is_file()
    python = "".join(blocks("python"))
    said = run(folder, sys.executable, "-W", "error::DeprecationWarning", "-c", python)
    # The README's own clean data hold nothing but noise, whose sd the example states too low.
    assert "noise_attitude" not in said
