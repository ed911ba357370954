"""The command line: one file for each command, no physics."""

# No imports here, so that the handler of Ctrl-C is installed as early as possible.


def main() -> None:
    """Run the command line and end the process with its exit code, or by the signal that ended the command."""
    from tumblecal.cli.endings import ALL, end_by, finished, leave_when_asked

    leave_when_asked()
    import io
    import os
    import sys

    for number in range(3):
        # A service may close the standard streams. Otherwise a file that is opened later gets the number of one.
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    sys.stdin = sys.stdin or os.fdopen(0, "r")
    sys.stdout, sys.stderr = sys.stdout or os.fdopen(1, "w"), sys.stderr or os.fdopen(2, "w")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names of files are bytes, not always text
    try:
        from tumblecal.cli.interrupts import interrupts_kept
        from tumblecal.cli.run import run

        interrupts_kept(ALL)  # a worker process handles Ctrl-C only
        code = run()
    except KeyboardInterrupt:  # before or after the command: no work is incomplete
        code = 130
    finally:
        leave_when_asked()
    if code > 128:
        end_by(code - 128)
    finished()
    if code == 130 and "jax" in sys.modules:
        # After an interrupted JAX computation the interpreter can crash at exit. All output is written.
        os._exit(code)
    sys.exit(code)
