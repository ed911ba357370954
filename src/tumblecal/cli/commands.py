"""All commands by name; the start and the exit code of a command."""

import os
import shutil
import signal
import sys
import textwrap
import warnings
from contextlib import nullcontext, redirect_stdout, suppress
from io import StringIO

from cyclopts import App, CycloptsError, Parameter

from tumblecal import __version__
from tumblecal.cli.interrupts import NOTHING_HALF_WRITTEN, interrupted_by, line_of
from tumblecal.ground.errors import InputError, SupplementWarning, one_line
from tumblecal.ground.plain_text import first_control
from tumblecal.ground.unwritable import FULL


app = App(
    name="tumblecal",
    version=__version__,
    help="Calibrate accelerometer triads on a dividing head, and find the errors of the model.",
    result_action="return_value",
    suppress_keyboard_interrupt=False,
    default_parameter=Parameter(negative=()),
)
# Help lines are here, so that --help imports no command.
COMMANDS = {
    "reproduce": "Reproduce the study of the paper without further input: figures, tables, audit.",
    "calibrate": "Calibrate position files by the exact method and all linear methods.",
    "diagnose": "Find the errors of the model and their causes, extend the model, measure the improvement.",
    "thermal": "Calibrate over temperature: ramps and soaks at still attitudes.",
    "check": "Check whether a calibration is still valid, by a few attitudes at rest.",
    "apply": "Correct raw data by a calibration file.",
    "export": "Write a calibration for a device or another program, and report losses of its format.",
    "budget": "Compute an uncertainty budget: noise (type A) with stated input uncertainties (type B).",
    "certificate": "Write a calibration certificate: a page to print and a DCC (XML).",
    "history": "List the results of all units, or evaluate one: repeatability, drift, control charts.",
    "compare": "Compare two calibrations of a unit.",
    "example": "Write an example file (rig, plan or study), or list all examples.",
    "plan": "Design a measurement: positions, their order, the uncertainties to expect.",
    "simulate": "Simulate position means of a rig.",
    "effects": "List the catalogue of effects, or explain one effect.",
    "study": "Run simulation studies: convergence, linearization, coverage, sweep, power.",
    "capture": "Record the positions of a plan from a serial port.",
    "reduce": "Reduce a captured run, a recording of any format or a table of samples to position means.",
    "import": "Describe a recording of any format, and write its samples as a table.",
    "decode": "Decode a log of serial bytes.",
    "sniff": "Identify the protocol of a serial port or a file of bytes.",
    "ports": "List the serial ports.",
    "emulate": "Emulate an instrument on a pseudo-terminal.",
}
for _name, _help in COMMANDS.items():
    _file = "import_samples" if _name == "import" else _name  # a keyword of Python
    app.command(f"tumblecal.cli.{_file}:{_file}", name=_name, help=_help)
app.command("tumblecal.cli.about:about", name="about", show=False)
app.command(
    "tumblecal.cli.about:install_completion",
    name="--install-completion",
    help="Install shell completion of commands and options.",
)


_OTHERS = warnings.formatwarning


def warn_in_one_line() -> None:
    """From now on a missing figure or page is one line on stderr."""
    warnings.formatwarning = _warning_words


def _warning_words(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
) -> str:
    if not issubclass(category, SupplementWarning):
        return _OTHERS(message, category, filename, lineno, line)
    if interrupted_by():  # compiled modules convert the exception of a signal into other errors
        raise KeyboardInterrupt
    return f"WARNING: {message}\n"


def run() -> int:
    """Run the command line.

    **Returns:** the exit code: 0, 1 (a fit failed), 2 (rejected input), 3 (a calibration must not be used), or 128 plus the
    number of the signal that ended it (130 for Ctrl-C).
    """
    warn_in_one_line()
    try:
        words = _words(sys.argv[1:])
        if words in ([], ["-h"], ["--help"]):
            print(_overview())
            return 0
        quiet = {"-q", "--quiet"} & {*words} and not {"-h", "--help"} & {*words}
        with redirect_stdout(StringIO()) if quiet else nullcontext():  # warnings and errors go to stderr
            code = app(words, print_error=False, exit_on_error=False)
            sys.stdout.flush()
    except KeyboardInterrupt as error:
        return _interrupted(str(error))
    except Exception as error:
        return _interrupted() if interrupted_by() else _failed(error)
    return code if isinstance(code, int) else 0


def _overview() -> str:
    """The commands; in a fraction of the time that the formatter of their options needs."""
    width = max(map(len, COMMANDS)) + 2
    room = shutil.get_terminal_size().columns
    lines = [
        textwrap.fill(words, room, initial_indent=name.ljust(width), subsequent_indent=" " * width)
        for name, words in sorted(COMMANDS.items())
    ]
    more = "Options of a command: tumblecal COMMAND --help. Also: --version, --install-completion (of a shell)."
    return "\n".join(["Usage: tumblecal COMMAND", "", textwrap.fill(str(app.help), room), "", *lines, "", more])


def _failed(error: Exception) -> int:
    """Print one line for each fault; returns the exit code.

    **Raises:** the error, if it is an error of the program.
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
    elif isinstance(error, MemoryError):
        faults = ["not enough memory for this file or computation; split the file, or close other programs"]
    elif (fault := _users_fault(error)) is not None:
        faults = [fault]
    else:
        raise error
    # The notes list earlier guesses, from which the fault may follow.
    for line in (*getattr(error, "__notes__", ()), *faults):
        print(f"tumblecal: {one_line(line)}", file=sys.stderr)
    return 2


def _words(arguments: list[str]) -> list[str]:
    """The words of the command line, with `help`, `help COMMAND` and `--version -v` translated.

    **Raises:** `InputError` for control characters, because names of files and units are printed and stored.
    """
    # Names of files are bytes, not always text.
    texts = [word.encode("utf-8", "replace").decode() for word in arguments]
    refused = [word for word in texts if first_control(word) is not None or "\n" in word or "\r" in word]
    if refused:
        raise InputError([f"{word}: has control characters; rename it, or the file" for word in refused])
    if arguments[:1] == ["help"]:
        return [*arguments[1:], "--help"]
    if arguments[:1] == ["--version"] and {*arguments[1:]} & {"-v", "--verbose"}:
        return ["about"]
    return arguments


def _usage(error: CycloptsError) -> str:
    """One line for a fault of the command line, with its help command."""
    fault = " ".join(str(error).split())
    fault = fault if fault.endswith("...") else fault.removesuffix(".")
    command = " ".join(error.command_chain or ())
    negative = next((word for word in sys.argv[1:] if word[:1] == "-" and word[1:2].isdigit()), None)
    if negative and "requires an argument" in fault:
        fault += f" (a value that begins with - is written --option={negative})"
    return f"{fault}; see tumblecal {command + ' ' if command else ''}--help"


def _interrupted(words: str = "") -> int:
    number = interrupted_by() or signal.SIGINT
    print(line_of(number, words or NOTHING_HALF_WRITTEN), file=sys.stderr)
    return 128 + number


def _refused_by_system(error: OSError) -> str:
    """The line for an unexpected failure of a disk, a file or a terminal."""
    with suppress(OSError):
        # Otherwise the failed print is repeated, and reported, at the end of the process.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    # Files that are written are named, so that a full disk without a name is that of the output.
    what = error.filename or ("standard output" if error.errno in FULL else "a file that the system does not name")
    return one_line(f"{what}: {error.strerror or error}")


def _users_fault(error: Exception) -> str | None:
    """The line for an error in a user's own effect; None where none was loaded."""
    if "tumblecal.effects.users_file" not in sys.modules:
        return None
    from tumblecal.effects.users_file import fault_in_users_file

    return fault_in_users_file(error)
