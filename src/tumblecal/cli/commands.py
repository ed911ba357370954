"""All commands by name."""

import shutil
import textwrap

from cyclopts import App, Parameter

from tumblecal import __version__


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


def overview() -> str:
    """The commands; in a fraction of the time that the formatter of their options needs."""
    width = max(map(len, COMMANDS)) + 2
    room = shutil.get_terminal_size().columns
    lines = [
        textwrap.fill(words, room, initial_indent=name.ljust(width), subsequent_indent=" " * width)
        for name, words in sorted(COMMANDS.items())
    ]
    more = "Options of a command: tumblecal COMMAND --help. Also: --version, --install-completion (of a shell)."
    return "\n".join(["Usage: tumblecal COMMAND", "", textwrap.fill(str(app.help), room), "", *lines, "", more])
