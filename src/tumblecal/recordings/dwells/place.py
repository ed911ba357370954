"""The position of a dwell: from a plan, a table of files, or unknown; and rows of positions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tumblecal.capture.capture_plan import CapturePlan, names_of
from tumblecal.capture.decoding.samples import Floats
from tumblecal.data.position_comments import ATTITUDES, UNKNOWN
from tumblecal.data.positions import PositionSet, attitudes_of
from tumblecal.recordings.options import KnownContext


@dataclass(frozen=True)
class Place:
    """Name of a position; angles in deg, None if unknown; approach; labels of run and mounting; index in the plan."""

    name: str
    alpha_deg: float | None = None
    beta_deg: float | None = None
    approach: float | None = None
    run: str = ""
    mount: str = ""
    step: int | None = None

    @property
    def known(self) -> bool:
        """Whether its angles are known."""
        return self.alpha_deg is not None

    def at_step(self, plan: CapturePlan, step: int) -> "Place":
        """This place as a position of a plan."""
        at = plan.steps[step]
        angles = {"alpha_deg": float(at.alpha_deg), "beta_deg": float(at.beta_deg)}
        return replace(self, name=str(at.name), approach=at.approach, step=step, **angles)


def angles_of(places: Sequence[Place]) -> tuple[Floats, Floats]:
    """Alpha and beta of places, deg; NaN if unknown."""
    alpha, beta = ([getattr(place, name) for place in places] for name in ("alpha_deg", "beta_deg"))
    return np.array(alpha, float), np.array(beta, float)


def position_set(
    source: str,
    readings: Floats,
    places: Sequence[Place],
    comments: Mapping[str, str],
    known: tuple[KnownContext, CapturePlan | None],
    **columns: Any,
) -> PositionSet:
    """Readings (positions, 3) in g at these places.

    With the comment of unknown attitudes, the readings give approximate angles. Labels of a place precede those of the options
    and of the plan, `known`. `columns`: further columns of the set.
    """
    hand_held = comments.get(ATTITUDES) == UNKNOWN
    alpha, beta = attitudes_of(readings) if hand_held else angles_of(places)
    approaches = [place.approach for place in places]
    for name in ("run", "mount"):
        usual = label_of_rows(known, name)
        stated = [getattr(place, name) for place in places]
        columns[name] = tuple(label or usual for label in stated) if usual != "1" or any(stated) else None
    return PositionSet(
        names_of([place.name for place in places]),
        alpha,
        beta,
        readings,
        approach=None if hand_held or None in approaches else np.array(approaches, float),
        comments=dict(comments),
        source=source,
        **columns,
    )


def label_of_rows(known: tuple[KnownContext, CapturePlan | None], name: str) -> str:
    """The label of `run` or `mount` for all rows: by option, otherwise by the plan; "1" if neither states it."""
    context, plan = known
    return getattr(context, name) or (getattr(plan.session, name) if plan else "1")
