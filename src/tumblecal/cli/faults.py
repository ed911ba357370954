"""The error of a command as lines for its user."""

import os
import sys
from contextlib import suppress

from cyclopts import CycloptsError

from tumblecal.ground.errors import InputError, one_line
from tumblecal.ground.unwritable import FULL


def print_faults(error: Exception) -> int:
    """Print one line for each fault of the input, the system or the command line; returns the exit code.

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


def _usage(error: CycloptsError) -> str:
    """One line for a fault of the command line, with its help command."""
    fault = " ".join(str(error).split())
    fault = fault if fault.endswith("...") else fault.removesuffix(".")
    command = " ".join(error.command_chain or ())
    negative = next((word for word in sys.argv[1:] if word[:1] == "-" and word[1:2].isdigit()), None)
    if negative and "requires an argument" in fault:
        fault += f" (a value that begins with - is written --option={negative})"
    return f"{fault}; see tumblecal {command + ' ' if command else ''}--help"


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
