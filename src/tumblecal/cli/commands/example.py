"""`tumblecal example`: the rig, plan and study files of the package."""

from pathlib import Path

from tumblecal.ground.errors import InputError


def example(name: str | None = None, *, out: Path = Path()) -> None:
    """Write an example file and its rig, or list all examples.

    Parameters
    ----------
    name
        Name of the example, such as paper24. Default: a list of all examples.
    out
        Output folder; existing files are not overwritten. Default: the current folder. Example: --out rigs.
    """
    from tumblecal.ground.atomic import writable_folder, write_texts
    from tumblecal.ground.examples import example_files, example_names, example_title

    if name is None:
        names = example_names()
        for known in names:
            print(f"{known:{max(map(len, names))}}  {example_title(known)}")
        return
    files = example_files(name)
    for path, text in ((out / file, text) for file, text in files.items()):
        if path.exists() and path.read_bytes() != text.encode():
            raise InputError(f"{path}: exists and differs from the example; move it, or give another folder with --out")
    writable_folder(out)
    write_texts(out, files)
    for file in files:
        print(f"{out / file}: {example_title(file)}")
