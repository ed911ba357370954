"""What a source shows to be missing or changed in it: reported, with what is sound in it read."""

from dataclasses import dataclass, field


@dataclass
class Damage:
    """A line each, in order; filled while a source is read.

    Damage that leaves no sound rows is no report but an `InputError`.
    """

    lines: list[str] = field(default_factory=list)

    def report(self, words: str) -> None:
        """Add a line, once."""
        if words not in self.lines:
            self.lines.append(words)
