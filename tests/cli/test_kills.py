"""The short version of benchmarks/kills.py: kill -9 while something is recorded, measured or studied."""

import re
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.long
def test_kills_lose_nothing() -> None:
    script = Path(__file__).parents[2] / "benchmarks" / "kills.py"
    done = subprocess.run([sys.executable, str(script), "--kills", "6"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"^\d+ kills; lost or different: 0$", done.stdout, re.MULTILINE), done.stdout
    for told in (r"recorder: [1-9]\d* places", r"study: [1-9] studies"):
        assert re.search(told, done.stdout), done.stdout
