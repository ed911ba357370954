"""All commands by their names, and how one of them is run and ends."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path

from cyclopts import App, CycloptsError

from tumblecal import __version__
from tumblecal.cli.interrupts import NOTHING_HALF_WRITTEN, interrupted, interrupted_by, line_of
from tumblecal.ground.errors import InputError, one_line
from tumblecal.ground.plain_text import first_control


app = App(
    name="tumblecal",
    version=__version__,
    help="Calibrate accelerometer triads on a dividing head, and find what the model gets wrong.",
    result_action="return_value",
    suppress_keyboard_interrupt=False,
)
# A command is named here with its help line, so that --help loads none of them.
COMMANDS = {
    "reproduce": "The paper's whole study, from no other input: figures, tables, audit.",
    "calibrate": "Calibrate position files by all methods.",
    "diagnose": "Show what the model gets wrong, name the cause, extend the model, measure the gain.",
    "apply": "Correct raw data by a calibration file.",
    "export": "Write a calibration as devices and other programs take it, and say what they cannot carry.",
    "budget": "Uncertainty budget: expanded uncertainties with all that is not exactly known.",
    "certificate": "Write a calibration certificate: a page to print and a DCC (XML).",
    "history": "List the results of all units; repeatability, drift and control charts of one.",
    "compare": "Say what moved between two calibrations.",
    "example": "Write an example file (rig, plan or study), or list all examples.",
    "simulate": "Simulate position means of a rig.",
    "effects": "List the effects that diagnose knows, or explain one.",
    "study": "Simulation studies: convergence, linearization, coverage, sweep, power.",
    "capture": "Measure a plan, position by position, from a serial port.",
    "reduce": "Reduce a captured run, a recording of any format, or a table of samples, to position means.",
    "import": "Say what is in a recording of any format, and write its samples as a table.",
    "decode": "Decode a log of serial bytes.",
    "sniff": "Guess the protocol that a port or a file of bytes speaks.",
    "ports": "List the serial ports.",
    "emulate": "A virtual instrument on a pseudo-terminal.",
}
# A command whose name is a word of Python.
_FILES = {"import": "import_samples"}
for _name, _help in COMMANDS.items():
    _file = _FILES.get(_name, _name)
    app.command(f"tumblecal.cli.{_file}:{_file}", name=_name, help=_help)
app.command("tumblecal.cli.about:about", name="about", show=False)
app.register_install_completion_command(help="Install the completion of commands and options for your shell.")


def run() -> int:
    """Run the command line.

    **Returns:** the exit code: 0, 1 (a fit failed), 2 (input that cannot be used), or 128 and the number of the signal that
    ended it (130 for Ctrl-C).
    """
    try:
        words = _words(sys.argv[1:])
        with _printed_to(words):
            code = app(words, print_error=False, exit_on_error=False)
            sys.stdout.flush()
    except KeyboardInterrupt as error:
        return _interrupted(str(error))
    except Exception as error:
        return _interrupted() if interrupted() else _failed(error)
    return code if isinstance(code, int) else 0


@contextmanager
def _printed_to(words: list[str]) -> Iterator[None]:
    """Where a command prints: with --quiet nowhere. Warnings and errors go to stderr."""
    if not {"-q", "--quiet"} & {*words} or {"-h", "--help"} & {*words}:
        yield
        return
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere, redirect_stdout(nowhere):
        yield


def _failed(error: Exception) -> int:
    """Say in a line a fault why a command failed; returns its exit code.

    **Raises:** the error, where it is the program's own.
    """
    if isinstance(error, CycloptsError):
        faults = [_usage(error)]
    elif isinstance(error, InputError):
        faults = error.faults
    elif isinstance(error, BrokenPipeError):
        sys.stderr.close()
        return 0
    elif isinstance(error, OSError):
        faults = [_refused_by_system(error)]
    elif (fault := _users_fault(error)) is not None:
        faults = [fault]
    else:
        raise error
    # Its notes are what was guessed before: the fault may follow from it.
    for line in (*getattr(error, "__notes__", ()), *faults):
        print(f"tumblecal: {one_line(line)}", file=sys.stderr)
    return 2


def _words(arguments: list[str]) -> list[str]:
    """`help`, `help COMMAND` and `--version -v` as they are meant.

    **Raises:** `InputError` for control characters: the names of files and of units are shown and written down.
    """
    # Names of files are bytes, and may be no text.
    texts = [word.encode("utf-8", "replace").decode() for word in arguments]
    refused = [word for word in texts if first_control(word) is not None or "\n" in word or "\r" in word]
    if refused:
        raise InputError([f"{word}: has control characters; give it, or the file, another name" for word in refused])
    if arguments[:1] == ["help"]:
        return [*arguments[1:], "--help"]
    if arguments[:1] == ["--version"] and {*arguments[1:]} & {"-v", "--verbose"}:
        return ["about"]
    return arguments


def _usage(error: CycloptsError) -> str:
    """A mistake in the command line in one line, and where help is."""
    said = " ".join(str(error).split())
    said = said if said.endswith("...") else said.removesuffix(".")
    asked = " ".join(error.command_chain or ())
    negative = next((word for word in sys.argv[1:] if word[:1] == "-" and word[1:2].isdigit()), None)
    if negative and "requires an argument" in said:
        said += f" (a value that begins with - is written --option={negative})"
    return f"{said}; see tumblecal {asked + ' ' if asked else ''}--help"


def _interrupted(words: str = "") -> int:
    number = interrupted_by() or signal.SIGINT
    print(line_of(number, words or NOTHING_HALF_WRITTEN), file=sys.stderr)
    return 128 + number


def _refused_by_system(error: OSError) -> str:
    """The line for a disk, a file or a terminal that fails where no command expected it."""
    with suppress(OSError):
        # A failed print would be tried, and reported, once more at the end of the process.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    what = error.filename or "output"
    return one_line(f"{what}: {error.strerror or error}")


def _users_fault(error: Exception) -> str | None:
    """The line for an error in a user's own effect; None where none was loaded."""
    if "tumblecal.effects.users_file" not in sys.modules:
        return None
    from tumblecal.effects.users_file import fault_in_users_file

    return fault_in_users_file(error)
