"""Scripts as users write them: they run, and pyright checks them in its strict mode (`[tool.pyright]`)."""

import subprocess
import sys
from pathlib import Path


SCRIPTS = sorted((Path(__file__).parent / "typed").glob("*.py"))
# One process: the scripts share its compiled programs, and the checks of shapes of the tests are not in it.
RUN = """
import runpy, sys
import tumblecal
tumblecal.keep_programs()
for script in sys.argv[1:]:
    print(script)
    runpy.run_path(script, run_name="__main__")
"""


def test_they_run(tmp_path):
    command = [sys.executable, "-c", RUN, *map(str, SCRIPTS)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len(SCRIPTS) == 10 and (tmp_path / "unit.json").is_file()
