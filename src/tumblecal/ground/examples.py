"""The rig, plan and study files of the package: `configs/` of the repository."""

import difflib
import re
from pathlib import Path

from tumblecal.ground.errors import InputError


# In a wheel the files are in the package (pyproject.toml, force-include); in a checkout they are in `configs/`.
_INSTALLED = Path(__file__).parents[1] / "examples"
_CHECKOUT = Path(__file__).parents[3] / "configs"
_REFERENCE = re.compile(r'^rig = "(?P<name>[\w-]+)\.toml"', re.M)


def example_names() -> list[str]:
    """Names of all example files, in alphabetical order, without `.toml`."""
    return sorted(path.stem for path in _folder().glob("*.toml"))


def example_path(name: str) -> Path:
    """The file of an example, inside the package.

    **Raises:** `InputError` for an unknown name, with the nearest ones.

    **Example:** `example_path("paper24").read_text()`
    """
    names, bare = example_names(), name.removesuffix(".toml")
    if bare in names:
        return _folder() / f"{bare}.toml"
    near = difflib.get_close_matches(bare, names, n=3, cutoff=0.4)
    guess = f"did you mean {' or '.join(near)}? " if near else ""
    raise InputError(
        f"{name}: neither a file nor an example has this name; {guess}`tumblecal example` lists the examples"
    )


def example_files(name: str) -> dict[str, str]:
    """File names and texts of an example and of the rig that it refers to.

    **Raises:** `InputError` for an unknown name.
    """
    path = example_path(name)
    text = path.read_text(encoding="utf-8")
    referred = [example_path(match["name"]) for match in _REFERENCE.finditer(text)]
    return {path.name: text} | {rig.name: rig.read_text(encoding="utf-8") for rig in referred}


def example_title(name: str) -> str:
    """One line that describes an example: the first comment of its file."""
    return example_path(name).read_text(encoding="utf-8").partition("\n")[0].lstrip("# ").rstrip(".")


def file_or_example(path: Path | str) -> Path:
    """A path, or the file of the example with that name if the path has no suffix and does not exist."""
    path = Path(path)
    named = path.name == str(path) and not path.suffix and not path.exists()
    return example_path(path.name) if named else path


def _folder() -> Path:
    return _INSTALLED if _INSTALLED.is_dir() else _CHECKOUT
