"""Suggested commands, composed from the command line of this invocation.

A suggested command has all options of this invocation that it accepts, such as columns, gravity or noise. It is quoted for a
shell, so that it can be pasted.
"""

import shlex
import sys
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from tumblecal.ground.result_set import final_place


_MODEL = ("--rig", "--noise-sd", "--prior", "--fix", "--head", "--gravity", "--columns", "--effects", "--attitudes")
_RECORDING = (
    "--columns", "--rows", "--unit", "--gyro-unit", "--time-unit", "--scale", "--offset", "--signed", "--decimal", "--rate",
    "--topic", "--protocol", "--range-g",
)  # fmt: skip
# Options with a value that commands share. The --gravity of apply is that of a different site.
SHARED = {
    "calibrate": _MODEL,
    "diagnose": (*_MODEL, "--allow-alpha", "--allow-beta", "--allow-mount"),
    "budget": _MODEL,
    "reduce": (*_RECORDING, "--gravity", "--run", "--mount"),
    "import": (*_RECORDING, "--gravity"),
    "apply": _RECORDING,
    "check": (
        *_RECORDING, "--gravity", "--run", "--mount", "--rig", "--prior", "--noise-sd", "--plan", "--table", "--by",
        "--u-gravity", "--repeatability",
    ),
    "capture": ("--port", "--wait"),
}  # fmt: skip
# Options without a value.
_FLAGS = {"check": ("--static", "--means", "--other-unit", "--extrapolate", "--use-anyway")}
_OF_RECORDINGS = ("reduce", "import", "apply", "check")


EVERY = frozenset(option for options in SHARED.values() for option in options)


def suggested(command: str, *words: object, less: Collection[str] = ()) -> str:
    """A command to paste, with the options of this invocation.

    **Arguments:**

    - `words`: its files and further options, not quoted.
    - `less`: options to omit: `EVERY` for the folder of a capture, --columns for files of tumblecal.
    """
    given = [_word(word) for word in words]
    accepted = [option for option in SHARED.get(command, ()) if option not in given and option not in less]
    for option, value in _options():
        if option == "--effects" and "=" in value:
            continue  # the size of an effect in a plan, not a file
        if option == "--columns" and command in _OF_RECORDINGS:
            # The columns of positions that samples also have: all except the number of samples and sd.
            pairs = [pair for pair in value.split(",") if pair]
            names = [pair.partition("=")[0].strip() for pair in pairs]
            value = ",".join(
                pair for pair, name in zip(pairs, names, strict=True) if name != "n" and "_sd_" not in name
            )
        if option in accepted and value:
            given += [f"{option}={value}"] if value.startswith("-") else [option, value]
    given += [flag for flag in _FLAGS.get(command, ()) if states(flag) and flag not in given]
    return shlex.join(["tumblecal", command, *given])


def _word(word: object) -> str:
    """A word of a command; a file name that begins like an option gets a prefix, and an unfinished file its final path."""
    if not isinstance(word, Path):
        return str(word)
    path = final_place(word)
    return f"./{path}" if str(path).startswith("-") else str(path)


def states(flag: str) -> bool:
    """Whether this invocation has an option without a value."""
    return flag in _arguments()


def _arguments() -> Sequence[str]:
    """The words of the command line of tumblecal; none in another program."""
    program = Path(sys.argv[0]) if sys.argv else Path()
    is_tumblecal = program.stem == "tumblecal" or (program.name == "__main__.py" and "tumblecal" in program.parts)
    return sys.argv[1:] if is_tumblecal else ()


def _options() -> Iterator[tuple[str, str]]:
    """The shared options with a value of this invocation, in order."""
    words = iter(_arguments())
    for word in words:
        option, equals, value = word.partition("=")
        if option in EVERY:
            yield option, value if equals else next(words, "")
