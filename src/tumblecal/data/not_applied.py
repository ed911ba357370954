"""Corrections that a calibration file does not include: effect, reason, and size in the data."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tumblecal.data.calibration_parts import is_number
from tumblecal.ground.errors import InputError
from tumblecal.ground.text_file import shown


# The keys of `provenance`: the ids alone, and ids with reason and size.
IDS, LOSSES = "not_applied", "losses"
_LACKING = "not in this calibration"
_EARLIER = "this file, of an earlier version, does not state why"


@dataclass(frozen=True)
class NotApplied:
    """A correction that a calibration file does not include.

    - `effect`: id of the catalogue entry, or a dependence that the data do not determine, such as `temperature^3`. `reason`: in
      words. `largest_mg`, `rms_mg`: of the correction over the readings of the data; None if not known.
    """

    effect: str
    reason: str
    largest_mg: float | None = None
    rms_mg: float | None = None

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


def not_applied(provenance: Mapping[str, Any], named: str = "calibration") -> list[NotApplied]:
    """The omitted corrections in the provenance of a calibration; earlier versions state effects without reason and size.

    **Arguments:**

    - `named`: the file, for faults.

    **Raises:** `InputError` for invalid entries.
    """
    stated, ids = provenance.get(LOSSES, []), provenance.get(IDS, [])
    if faults := [f"{named}: provenance.{fault}" for fault in _faults(stated, ids)]:
        raise InputError(faults)
    listed = [NotApplied(**loss) for loss in stated]
    return [*listed, *(NotApplied(id, _EARLIER) for id in ids if id not in {loss.effect for loss in listed})]


def _faults(stated: object, ids: object) -> Iterator[str]:
    if not isinstance(ids, list) or not all(isinstance(id, str) for id in ids):
        yield f"{IDS}: {shown(ids)} is not a list of ids"
    if not isinstance(stated, list):
        yield f"{LOSSES}: {shown(stated)} is not a list"
        return
    for number, loss in enumerate(stated):
        known = isinstance(loss, dict) and loss.keys() <= {"effect", "reason", "largest_mg", "rms_mg"}
        if not known or not all(isinstance(loss.get(key), str) for key in ("effect", "reason")):
            yield f"{LOSSES}.{number}: {shown(loss)}; it must have effect and reason in words, largest_mg and rms_mg"
        elif not all(loss.get(key) is None or is_number(loss[key]) for key in ("largest_mg", "rms_mg")):
            yield f"{LOSSES}.{number}: largest_mg and rms_mg must be numbers (mg) or null"
