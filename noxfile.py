#!/usr/bin/env -S uv run --script
# /// script
# dependencies = ["nox>=2025.10.14"]
# ///
"""Tasks of a developer: `nox -l` lists them. CI runs `.ci/run`, which makes its environments by the README's commands."""

import nox


nox.needs_version = ">=2025.10.14"
nox.options.default_venv_backend = "uv|virtualenv"
_CONSTRAINED = ("-c", "constraints.txt", "-e", ".[dev]")


@nox.session
def tests(session: nox.Session) -> None:
    """Run the tests: `nox -s tests -- tests/chain`."""
    session.install(*_CONSTRAINED)
    session.run("pytest", "-q", "-n", "3", "--dist", "loadfile", *session.posargs)


@nox.session(default=False)
def long(session: nox.Session) -> None:
    """Run all tests, the long ones too, with the shapes of all signatures checked: before a release."""
    session.install(*_CONSTRAINED)
    shapes = {"TUMBLECAL_CHECK_SHAPES": "1"}
    session.run("pytest", "-q", "-n", "2", "--dist", "loadfile", "-m", "long or not long", *session.posargs, env=shapes)


@nox.session
def lint(session: nox.Session) -> None:
    """Check style, layers of imports and types."""
    session.install(*_CONSTRAINED)
    session.run("ruff", "check", "src", "tests", "benchmarks")
    session.run("ruff", "format", "--check", "src", "tests", "benchmarks")
    session.run("lint-imports")
    session.run("pyright")


@nox.session(default=False)
def package(session: nox.Session) -> None:
    """Check licences, build the sdist and the wheel, check both, and write a bill of materials of the dependencies."""
    session.install("-c", "constraints.txt", "-e", ".[package]")
    session.run("reuse", "lint")
    session.run("python", "-m", "build")
    session.run("twine", "check", "--strict", "dist/*")
    session.run(
        "cyclonedx-py", "environment", "--pyproject", "pyproject.toml", "--of", "JSON", "-o", "dist/sbom.cdx.json"
    )


@nox.session(default=False)
def docs(session: nox.Session) -> None:
    """Build the site with its gallery into site/; warnings are errors."""
    session.install("-c", "constraints.txt", "-e", ".[docs]")
    session.run("mkdocs", "build", "--strict", env={"NO_MKDOCS_2_WARNING": "1"})


if __name__ == "__main__":
    nox.main()
