"""One call of the command line: its words, its warnings and its exit code."""

import signal
import sys
import warnings
from contextlib import nullcontext, redirect_stdout
from io import StringIO

from tumblecal.cli.commands import app, overview
from tumblecal.cli.endings import NOTHING_HALF_WRITTEN, line_of
from tumblecal.cli.interrupts import interrupted_by
from tumblecal.ground.errors import InputError, SupplementWarning
from tumblecal.ground.plain_text import first_control


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
            print(overview())
            return 0
        quiet = {"-q", "--quiet"} & {*words} and not {"-h", "--help"} & {*words}
        with redirect_stdout(StringIO()) if quiet else nullcontext():  # warnings and errors go to stderr
            code = app(words, print_error=False, exit_on_error=False)
            sys.stdout.flush()
    except KeyboardInterrupt as error:
        return _interrupted(str(error))
    except Exception as error:
        if interrupted_by():
            return _interrupted()
        from tumblecal.cli.faults import print_faults

        return print_faults(error)
    return code if isinstance(code, int) else 0


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


def _interrupted(words: str = "") -> int:
    number = interrupted_by() or signal.SIGINT
    print(line_of(number, words or NOTHING_HALF_WRITTEN), file=sys.stderr)
    return 128 + number
