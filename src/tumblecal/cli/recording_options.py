"""Recordings on the command line: the options that `recordings.options` declares, and what was found, for two commands."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.cli.command import Command
from tumblecal.cli.terminal import warn
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions


if TYPE_CHECKING:
    from tumblecal.recordings import recording

Recording = Annotated[RecordingOptions, Parameter(name="*")]
Context = Annotated[KnownContext, Parameter(name="*")]
Rest = Annotated[Criterion, Parameter(name="*")]


def print_recordings(
    command: Command,
    read: "Sequence[recording.Recording]",
    warnings: Iterable[tuple[str, Iterable[str]]],
    lines: Iterable[str],
) -> None:
    """Print layout and guesses of recordings, warnings by file, and lines on their intervals at rest."""
    from tumblecal.show.recordings import layout_lines, left_out_lines

    command.say(*layout_lines(read), *lines)
    for one in read:
        command.warn(one.path, left_out_lines(one))
    for source, of_source in warnings:
        warn(source, of_source)
