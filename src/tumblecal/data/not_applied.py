"""Corrections that a calibration file does not include: effect, reason, and size in the data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import ConfigDict

from tumblecal.ground.strict_json import Finite, Text


if TYPE_CHECKING:
    from tumblecal.data.calibration import Calibration


# The keys of `provenance`: the ids alone, and ids with reason and size.
IDS, LOSSES = "not_applied", "losses"
_LACKING = "not in this calibration"


@dataclass(frozen=True)
class NotApplied:
    """A correction that a calibration file does not include.

    - `effect`: id of the catalogue entry, or a dependence that the data do not determine, such as `temperature^3`. `reason`: in
      words. `largest_mg`, `rms_mg`: of the correction over the readings of the data; None if not known.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    effect: Text
    reason: Text
    largest_mg: Finite | None = None
    rms_mg: Finite | None = None

    @property
    def words(self) -> str:
        """Effect, size and reason."""
        return f"{self.effect} ({', '.join([*self._sizes, self.reason])})"

    @property
    def brief(self) -> str:
        """Effect and size."""
        return f"{self.effect} ({', '.join(self._sizes)})" if self._sizes else self.effect

    @property
    def _sizes(self) -> list[str]:
        sizes = [f"up to {self.largest_mg:.2g} mg"] if self.largest_mg is not None else []
        return [*sizes, f"{self.rms_mg:.2g} mg rms"] if self.rms_mg is not None else sizes

    def record(self) -> dict[str, Any]:
        """The record in `provenance`."""
        return vars(self).copy()


def losses_words(losses: Sequence[NotApplied], *, reasons: bool = True) -> list[str]:
    """Words of all commands on omitted corrections: one line for each; without reasons one line for all."""
    if not reasons:
        return [f"{_LACKING}: {', '.join([loss.brief for loss in losses])}"] if losses else []
    return [f"{_LACKING}: {loss.words}" for loss in losses]


def use_lines(calibration: "Calibration") -> list[str]:
    """The permitted use of a calibration, and its omitted corrections, a line each."""
    return [f"use: {calibration.use.words}", *losses_words(calibration.not_applied)]


def not_applied(provenance: Mapping[str, Any]) -> list[NotApplied]:
    """The omitted corrections in the provenance of a calibration."""
    return [NotApplied(**loss) for loss in provenance.get(LOSSES, [])]
