"""The cost of a study, before it runs."""

from dataclasses import dataclass
from pathlib import Path

from tumblecal.ground.counted import counted, duration
from tumblecal.ground.errors import InputError
from tumblecal.studies.run import Study


# Time to compile the program of a study, s; measured with an empty cache on a busy core (7 to 13 s).
COMPILE_SECONDS = 12.0


@dataclass(frozen=True)
class Cost:
    """Time and disk space of a study, about; `words`: both, with the numbers of trials and chunks."""

    hours: float
    gib: float
    words: str

    def require(self, config: Path, max_hours: float, max_gib: float) -> None:
        """Check that a study is within limits; `config`: its file.

        **Raises:** `InputError`.
        """
        for needed, most, option in ((self.hours, max_hours, "max-hours"), (self.gib, max_gib, "max-gib")):
            if needed > most:
                raise InputError(
                    f"{config}: {option.partition('-')[2]}: would need {needed:.3g}, more than --{option} {most:g}"
                )


def cost_of(study: Study, workers: int) -> Cost:
    """The cost of a study with this number of worker processes."""
    compiling, computing = COMPILE_SECONDS * study.programs, study.seconds / workers
    gib = study.chunks * study.chunk_bytes / 2**30
    words = (
        f"{counted(study.trials, 'trial')} in {counted(study.chunks, 'chunk')}; about {duration(computing)} on "
        f"{counted(workers, 'core')}, plus about {duration(compiling)} to compile it the first time; {gib:.2g} GiB on disk"
    )
    return Cost((compiling + computing) / 3600, gib, words)
