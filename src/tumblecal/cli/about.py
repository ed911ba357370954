"""`tumblecal --version -v`: versions for a fault report."""

import platform
import sys
from importlib import metadata

from cyclopts.completion.install import create_install_completion_command

from tumblecal import __version__
from tumblecal.cli.commands import app


install_completion = create_install_completion_command(app.install_completion, True)
PACKAGES = ("jax", "jaxlib", "equinox", "optimistix", "lineax", "numpy", "scipy", "polars", "pyserial", "matplotlib")


def about() -> None:
    """Print the versions of the program, of Python and of the packages that it uses, and the platform."""
    print(f"tumblecal {__version__}")
    print(f"Python {platform.python_version()} ({sys.implementation.name}), {platform.platform()}")
    for package in PACKAGES:
        try:
            print(f"{package} {metadata.version(package)}")
        except metadata.PackageNotFoundError:
            print(f"{package} is not installed")
