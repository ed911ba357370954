"""Other names of a file."""

import os


NAMES = {
    "same path": lambda path, other: path,
    "spelled otherwise": lambda path, other: f"{path.parent}/../{path.parent.name}/{path.name}",
    "symbolic link": lambda path, other: other.symlink_to(path) or other,
    "hard link": lambda path, other: os.link(path, other) or other,
}  # fmt: skip
