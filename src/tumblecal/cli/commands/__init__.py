"""All commands: each file here is one, with its function of the same name, whose docstring is its help."""

import re
import shutil
import textwrap
from collections.abc import Iterator
from pathlib import Path

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
# The help of a function, or of an application of several, up to a blank line.
_HELP = r'^(?:def {0}\(.*?"""|{0} = App\(.*?help=")(.+?)(?:\n\n|")'


def _listed() -> Iterator[tuple[str, str, str]]:
    """Name, help and function of the command in each file, or folder, of this one; read, so that --help imports none."""
    for path in sorted(Path(__file__).parent.iterdir()):
        source = path / "__init__.py" if path.is_dir() else path
        text = source.read_text(encoding="utf-8") if source.suffix == ".py" and source.is_file() else ""
        if found := re.search(_HELP.format(path.stem), text, re.DOTALL | re.MULTILINE):
            # import_samples: `import` is a keyword of Python.
            yield path.stem.partition("_")[0], " ".join(found[1].split()), f"{__name__}.{path.stem}:{path.stem}"


COMMANDS = dict[str, str]()
for _name, _help, _function in _listed():
    COMMANDS[_name] = _help
    app.command(_function, name=_name, help=_help)
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
