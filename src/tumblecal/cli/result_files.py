"""The files of a command: checked before the work begins, replaced together, named, and added to a history."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from tumblecal.cli.terminal import warn
from tumblecal.ground.errors import InputError
from tumblecal.ground.suggested_command import suggested


def table_file(path: Path, inputs: Iterable[Path | None]) -> Path:
    """A table to write, checked before the work begins.

    **Raises:** `InputError` for another kind of file, one of the inputs, or one that cannot be written.
    """
    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.ground.atomic import writable_file

    protect_inputs(inputs, out=path)
    if path.suffix not in (".csv", ".parquet"):
        raise InputError(f"{path}: must end in .csv or .parquet")
    writable_file(path)
    return path


@contextmanager
def results(out: Path, names: Sequence[str], inputs: Iterable[Path | None] = ()) -> Iterator[Path]:
    """A temporary folder for the files of a result. When the block ends, they replace those of the earlier result in `out`.

    **Arguments:**

    - `names`: glob patterns of the files. `inputs`: of the command.

    **Raises:** `InputError`, before the work begins, if a file of the result is an input or cannot be written.
    """
    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.ground.atomic import output_folders
    from tumblecal.ground.result_set import result_set

    protect_inputs(inputs, folders=[out], names=names)
    with output_folders([out]), result_set(out, names) as aside:
        yield aside


def names_written(out: Path, names: Sequence[str]) -> str:
    """The files of a result, for the last line of a command."""
    return f"written: {out}/: {', '.join(path.name for name in names for path in sorted(out.glob(name)))}"


def add_to_history(history: Path | None, folder: Path, kind: str, serial: str | None) -> None:
    """Add the results of a folder to a history, if one is given.

    **Raises:** `InputError` if they cannot be added; the folder keeps them.
    """
    if history is None:
        return
    from tumblecal.history.database import add
    from tumblecal.history.folders import of_folder

    try:
        add(history, of_folder(folder, kind, serial))
    except InputError as error:
        later = f"the results are in {folder}/; add them later: {suggested('history', history, '--add', folder)}"
        raise InputError([f"{fault}; {later}" for fault in error.faults]) from error
    if serial is None:
        state = "so it belongs to no unit: state the number in the data (# serial_number: ...)"
        warn(history, [f"{folder} was added without a serial number, {state}"])
