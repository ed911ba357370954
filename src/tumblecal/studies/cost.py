"""The cost of a study, before it runs."""

from pathlib import Path

from tumblecal.ground.errors import InputError
from tumblecal.ground.numbers_shown import counted, duration
from tumblecal.studies.run import Study


# Time to compile the program of a study, s; measured with an empty cache on a busy core (7 to 13 s).
COMPILE_SECONDS = 12.0


def cost_words(study: Study, workers: int) -> str:
    """The numbers of trials and chunks of a study, and its cost with this number of worker processes."""
    compiling, computing = COMPILE_SECONDS * study.programs, study.seconds / workers
    return (
        f"{counted(study.trials, 'trial')} in {counted(study.chunks, 'chunk')}; about {duration(computing)} on "
        f"{counted(workers, 'core')}, plus about {duration(compiling)} to compile it the first time; {_gib(study):.2g} GiB on "
        "disk"
    )


def require_affordable(study: Study, config: Path, workers: int, max_hours: float, max_gib: float) -> None:
    """Check that a study is within limits; `config`: its file.

    **Raises:** `InputError`.
    """
    hours = (COMPILE_SECONDS * study.programs + study.seconds / workers) / 3600
    for needed, most, option in ((hours, max_hours, "max-hours"), (_gib(study), max_gib, "max-gib")):
        if needed > most:
            raise InputError(
                f"{config}: {option.partition('-')[2]}: would need {needed:.3g}, more than --{option} {most:g}"
            )


def _gib(study: Study) -> float:
    return study.chunks * study.chunk_bytes / 2**30
