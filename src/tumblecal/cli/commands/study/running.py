"""Command line of all kinds of study: print the cost, run with a progress bar, write and print results."""

from collections.abc import Mapping
from pathlib import Path

from tumblecal.cli.commands.study.study_options import Running
from tumblecal.cli.result_files import names_written
from tumblecal.cli.terminal import print_folded, warn
from tumblecal.ground.errors import InputError


def run_study(kind: str, config: Path, changes: Mapping[str, object | None], running: Running) -> None:
    """Run one study.

    **Arguments:**

    - `kind`, `config`: kind of study and its file.
    - `changes`: keys of the file that the command line overrides; None for those not given.
    - `running`: further options.

    **Raises:** `InputError` for faults of the files, a study that is too large, or a folder of a different study.
    """
    from tumblecal.cli.start import start

    if running.workers is not None and running.scheduler is not None:
        raise InputError("--workers and --scheduler contradict each other; give only one of them")
    # The workers compute on the CPU, so this process computes its share there too.
    start(accelerator=running.workers is None, one_thread=True)
    from rich.console import Console

    from tumblecal.cli.commands.study.computing import progress_bar, workers_of
    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.ground.atomic import writable_folder
    from tumblecal.show.figures.drawing import write_each
    from tumblecal.show.figures.study import FIGURES
    from tumblecal.show.page import write_page
    from tumblecal.show.study import answer_of, print_answer
    from tumblecal.studies.cost import cost_words, require_affordable
    from tumblecal.studies.run import run, study_of
    from tumblecal.studies.study_tables import read_study, unused_of_head

    console = Console()
    stated = {**changes, "seed": running.seed}
    changed = {name: value for name, value in stated.items() if value is not None}
    tables = read_study(config, kind, changed, running.effects)
    study = study_of(tables)
    if unused := unused_of_head(kind, tables):
        warn(config, [unused])
    workers = running.workers or 1
    print_folded(f"{config}: {cost_words(study, workers)}")
    require_affordable(study, config, workers, running.max_hours, running.max_gib)
    if running.dry_run:
        return
    names = (f"{kind}*", "*.svg", "manifest.json", "chunks/*")
    protect_inputs(
        [config, config.parent / str(tables["study"]["rig"]), *running.effects], folders=[running.out], names=names
    )
    folder = writable_folder(running.out)

    def shown(aside: Path, content, frames) -> None:
        answer, drawn = answer_of(kind, content, frames), write_each(aside, FIGURES[kind], content, frames)
        write_page(aside / f"{kind}.html", answer.words, drawn, tables={"results": answer.table})

    try:
        with workers_of(tables, running) as computed, progress_bar(console, study.trials) as progress:
            content, frames = run(
                tables, folder, study=study, computed=computed, progress=progress, tell=print, shown=shown
            )
    except KeyboardInterrupt:
        words = f"{folder}: the finished chunks are stored; the same command continues from there"
        raise KeyboardInterrupt(words) from None
    print_answer(answer_of(kind, content, frames), console)
    written = names_written(folder, (f"{kind}.html", "*.svg", f"{kind}_*.parquet", f"{kind}.json"))
    print_folded(f"{written} (open {folder / kind}.html)")
