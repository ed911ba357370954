"""The size of the source by folder, and the budget that only goes down.

    python tests/size.py

lowers the numbers of `size_budget.toml` to the present sizes. It raises none: that is done by hand, with the reason in the
table `raised`, which is a sentence of CHANGELOG.md.

The size is the number of nodes of the syntax trees without docstrings, and the number of words of templates and of long texts
in the code: neither joined lines nor code in strings make it smaller.
"""

import ast
import tomllib
from collections import Counter
from functools import cache
from pathlib import Path


ROOT = Path(__file__).parents[1]
BUDGET = Path(__file__).with_name("size_budget.toml")
_TEMPLATES = {".html", ".j2", ".jinja", ".txt", ".words", ".md", ".css", ".js"}
# Words of a text in the code from which it is counted as a template.
_LONG_TEXT = 25
_LIGHT = (ast.expr_context, ast.operator, ast.cmpop, ast.unaryop, ast.boolop)
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def size_of(source: str) -> int:
    """Nodes of a module without docstrings, and words of its long texts."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            node.body = node.body[1:] or [ast.Pass()]
    size = 0
    for node in ast.walk(tree):
        size += not isinstance(node, _LIGHT)
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            words = len(node.value.split())
            size += words if words >= _LONG_TEXT else 0
    return size


@cache
def sizes(root: Path = ROOT / "src" / "tumblecal") -> Counter[str]:
    """Size of each folder of the source; of the files in the root itself: "."."""
    found = Counter[str]()
    for path in root.rglob("*"):
        if not path.is_file():
            continue
        within = path.relative_to(root).parts
        folder = within[0] if len(within) > 1 else "."
        if path.suffix == ".py":
            found[folder] += size_of(path.read_text(encoding="utf-8"))
        elif path.suffix in _TEMPLATES:
            found[folder] += len(path.read_text(encoding="utf-8").split())
    return found


def budget() -> dict[str, int]:
    """Largest size of each folder."""
    return tomllib.loads(BUDGET.read_text(encoding="utf-8"))["folders"]


def main() -> None:
    """Lower the budget to the present sizes."""
    now = sizes()
    lines = BUDGET.read_text(encoding="utf-8").splitlines()
    for number, line in enumerate(lines):
        folder, equals, allowed = line.partition(" = ")
        name = folder.strip('"')
        if equals and allowed.isdigit() and now[name] < int(allowed):
            lines[number] = f"{folder} = {now[name]}" if now[name] else ""
            print(f"{name}: {allowed} -> {now[name]}")
    BUDGET.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"together: {sum(now.values())} of {sum(budget().values())}")


if __name__ == "__main__":
    main()
