"""A slip made in setting up, as it is told."""

from dataclasses import dataclass


@dataclass(frozen=True)
class MixUp:
    """A mix-up found and put right: catalogue id, what it is in words; `equal`: ids and words of other slips that would
    leave the same data."""

    label: str
    words: str
    equal: tuple[tuple[str, str], ...] = ()

    @property
    def told(self) -> str:
        """The words with those of equal slips."""
        same = "; or ".join(words for _, words in self.equal)
        return f"{self.words} (or, which is the same here: {same})" if same else self.words

    def record(self) -> dict:
        """As JSON files hold it."""
        equal = [{"id": label, "words": words} for label, words in self.equal]
        return {"id": self.label, "words": self.words, "equal": equal}


# Mix-ups that no calibration at rest depends on.
HARMLESS = ("temperature_unit", "time_restarts")
