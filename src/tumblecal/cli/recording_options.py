"""Recordings on the command line: the options that `recordings.options` declares, and what was found."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tumblecal.cli.command import Command
from tumblecal.cli.terminal import warn
from tumblecal.recordings.options import Criterion, KnownContext, RecordingOptions


if TYPE_CHECKING:
    from tumblecal.recordings import recording
    from tumblecal.recordings.reduction import Reduction

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


def print_reduction(command: Command, found: "Reduction") -> None:
    """Print the recordings, the means of their dwells, and what is unusual."""
    from tumblecal.data.gravity_size import gravity_warnings
    from tumblecal.show.recordings import left_out_lines, noise_lines, print_means, reduction_lines, unusual_lines

    for name, lines in found.dwells.warnings:
        warn(name, lines)
    command.say(*reduction_lines(found.dwells))
    for recording in found.dwells.read:
        (warn if found.noise is None else command.warn)(recording.path, left_out_lines(recording))
    if command.words and found.noise is not None:
        print_means(found)
        command.say(*unusual_lines(found), *noise_lines(found))
    command.warn(found.data.source, unusual_lines(found))
    warn(found.data.source, gravity_warnings(found.data))
