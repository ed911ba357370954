"""Scripts as users write them; pyright checks all of them in its strict mode (`[tool.pyright]`).

The pages run most of their calls. Here runs the one that sends results between processes, without the tests' checks of shapes.
"""

import subprocess
import sys
from pathlib import Path

import pytest


SCRIPTS = Path(__file__).parent / "typed"


@pytest.mark.long
def test_results_of_a_script_with_an_effect_of_its_own_come_back_from_bytes(tmp_path):
    assert len(list(SCRIPTS.glob("*.py"))) == 9
    run = "import runpy, sys, tumblecal; tumblecal.keep_programs(); runpy.run_path(sys.argv[1], run_name='__main__')"
    command = [sys.executable, "-c", run, str(SCRIPTS / "diagnose_sets.py")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
