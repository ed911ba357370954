"""The command line: one file a command, no physics."""

# Nothing is imported here, so that Ctrl-C finds its handler as early as a program can have one.


def main() -> None:
    """Run the command line and end the process with its exit code, or by the signal that ended the command."""
    from tumblecal.cli.interrupts import all_interrupts_kept, end_by, finished, leave_when_asked

    leave_when_asked()
    import io
    import os
    import sys

    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names of files are bytes, and not always text
    try:
        from tumblecal.cli.commands import run

        all_interrupts_kept()
        code = run()
    except KeyboardInterrupt:  # at the edge of the command: nothing is half done
        code = 130
    finally:
        leave_when_asked()
    if code > 128:
        end_by(code - 128)
    finished()
    if code == 130 and "jax" in sys.modules:
        # A computation interrupted inside JAX can crash the interpreter while it is taken down: all is written, leave.
        os._exit(code)
    sys.exit(code)
