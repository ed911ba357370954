"""The short version of benchmarks/kills.py: kill -9 while a guided run is measured."""

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
    assert re.search(r"^6 kills; lost or different: 0$", done.stdout, re.MULTILINE), done.stdout
    assert re.search(r"^[1-9]\d* positions were shown as done", done.stdout, re.MULTILINE), done.stdout
