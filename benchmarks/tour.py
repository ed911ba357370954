"""The tour of docs/tour.md on its public recordings: its commands, and each line of output that the page shows.

    python benchmarks/tour.py FOLDER

FOLDER holds `exp_1.bin` and `exp_7.bin` (the page says where they are from). The commands run in an empty folder. Lines of the
page that the output does not contain are printed, and the exit code is then 1. Blanks and line breaks are not compared.
"""

import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from command_line import asked


PAGE = Path(__file__).parents[1] / "docs" / "tour.md"
# The files of the page's TOML blocks, in their order.
INPUTS = ("lab.toml", "admin.toml", "limits.toml")
COMMANDS = ("tumblecal ", "sed ")


def blocks(page: str) -> tuple[list[str], list[str], list[str]]:
    """TOML blocks, indented blocks (commands, Python) and blocks of output of a page."""
    fenced = re.findall(r"^```(\w*)\n(.*?)^```$", page, re.S | re.M)
    rest = re.sub(r"^```.*?^```$", "", page, flags=re.S | re.M)
    indented = [
        re.sub(r"^    ", "", text, flags=re.M) for text in re.findall(r"(?:^    .*\n|^\n(?=    ))+", rest, re.M)
    ]
    return [text for kind, text in fenced if kind], indented, [text for kind, text in fenced if not kind]


def one_line(text: str) -> str:
    """The words of a text with single blanks; the colours of a terminal are removed."""
    return " ".join(re.sub(r"\x1b\[[0-9;]*m", "", text).split())


def main() -> int:
    data = asked(__doc__, folder=()).folder.resolve()
    inputs, indented, outputs = blocks(PAGE.read_text(encoding="utf-8"))
    printed = ""
    with TemporaryDirectory() as name:
        for recording in ("exp_1.bin", "exp_7.bin"):
            (Path(name) / recording).symlink_to(data / recording)
        for file, text in zip(INPUTS, inputs, strict=True):
            (Path(name) / file).write_text(text, encoding="utf-8")
        lines = [line for block in indented for line in block.splitlines() if line.startswith(COMMANDS)]
        runs = [line.split() if line.startswith("tumblecal") else ["sh", "-c", line] for line in dict.fromkeys(lines)]
        runs += [[sys.executable, "-c", block] for block in indented if block.strip().startswith("import ")]
        for run in runs:
            done = subprocess.run(run, cwd=name, capture_output=True, text=True, check=False)
            printed += done.stdout + done.stderr
            print(f"exit code {done.returncode}: {' '.join(run)[:100].splitlines()[0]}", flush=True)
            if done.returncode:
                raise SystemExit(done.stderr)
            if run[0] == sys.executable:
                print(done.stdout)
    printed = one_line(printed)
    shown = [one_line(line).removesuffix("...").strip() for block in outputs for line in block.splitlines()]
    missing = [line for line in shown if line and line not in printed]
    print("\n".join(f"not in the output: {line}" for line in missing) or f"all {len(shown)} lines are in the output")
    return bool(missing)


if __name__ == "__main__":
    sys.exit(main())
