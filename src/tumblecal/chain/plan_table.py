"""The plan of a rig file: a grid of angles or a list of positions, checked."""

from dataclasses import replace
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from tumblecal.chain.plan import Plan, grid
from tumblecal.ground.strict_toml import Line, Number, Strict


# Conditions that a plan may state for each position.
_CONDITIONS = ("time_s", "temperature_degc", "approach")
# A plan larger than this is a typing error.
MOST_POSITIONS = 100_000


class Steps(Strict):
    """Equally spaced values."""

    start: Number
    step: Number
    count: Annotated[int, Field(ge=1, le=MOST_POSITIONS)]

    @model_validator(mode="after")
    def _has_a_step(self) -> "Steps":
        if self.step == 0 and self.count > 1:
            raise ValueError(
                f"step is 0, so all {self.count} positions would be equal; write the step (runs repeats a plan)"
            )
        return self

    @property
    def values(self) -> list[float]:
        """The values."""
        return [self.start + self.step * place for place in range(self.count)]


Angles = Annotated[
    Annotated[list[Number], Tag("list")] | Annotated[Steps, Tag("steps")],
    Discriminator(
        lambda given: "list" if isinstance(given, list) else "steps" if isinstance(given, dict | Steps) else None,
        custom_error_type="angles",
        custom_error_message="must be a list of numbers such as [0, 45, 90], or { start = 0, step = 45, count = 3 }",
    ),
]


class Position(Strict):
    """One position of a plan that is not a grid; time, temperature and approach are stated for all positions or for none."""

    alpha_deg: Number
    beta_deg: Number
    name: Line | None = None
    mount: Line = "1"
    run: Line = "1"
    time_s: Number | None = None
    temperature_degc: Number | None = None
    approach: Literal[-1, 1] | None = None


class Ramp(Strict):
    """A quantity that changes linearly over the plan."""

    start: Number
    end: Number


Temperatures = Annotated[
    Annotated[list[Number], Tag("list")] | Annotated[Ramp, Tag("steps")],
    Discriminator(
        lambda given: "list" if isinstance(given, list) else "steps" if isinstance(given, dict | Ramp) else None,
        custom_error_type="temperatures",
        custom_error_message="must be { start = 24.0, end = 26.5 }, or a list of soaks such as [0, 25, 60]",
    ),
]


class PlanTable(Strict):
    """The `[plan]` table: a grid (alpha_deg x beta_deg) or a list of positions.

    `interval_s` is the time from one position to the next, `temperature_degc` the triad's from first to last, or of each soak:
    then the grid is repeated at each temperature. `approach` is the direction in which the spindle approaches its positions.
    Listed positions may state these individually.
    """

    alpha_deg: Angles | None = None
    beta_deg: Angles | None = None
    mounts: Annotated[list[Line], Field(min_length=1)] = ["1"]
    runs: Annotated[int, Field(ge=1, le=MOST_POSITIONS)] = 1
    positions: list[Position] | None = None
    interval_s: Annotated[Number, Field(gt=0)] | None = None
    temperature_degc: Temperatures | None = None
    approach: Literal["positive", "negative", "alternating"] | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> "PlanTable":
        is_grid = self.alpha_deg is not None and self.beta_deg is not None
        if is_grid == (self.positions is not None):
            raise ValueError("give either alpha_deg and beta_deg (a grid), or positions")
        for column in _CONDITIONS:
            stated = [getattr(position, column) is not None for position in self.positions or []]
            if any(stated) and not all(stated):
                raise ValueError(
                    f"positions: {column} is stated for {sum(stated)} of {len(stated)}; state all, or none"
                )
            if any(stated) and (self.interval_s if column == "time_s" else getattr(self, column)) is not None:
                raise ValueError(f"{column} is stated for the plan and for its positions; state one of them")
        if self.positions is not None and isinstance(self.temperature_degc, list):
            raise ValueError(
                "temperature_degc: a list of soaks repeats a grid; state temperature_degc in each position"
            )
        count = self._count
        if not 0 < count <= MOST_POSITIONS:
            raise ValueError(f"{count} positions; give 1 to {MOST_POSITIONS}")
        return self

    @property
    def _count(self) -> int:
        if self.positions is not None:
            return len(self.positions)
        soaks = len(self.temperature_degc) if isinstance(self.temperature_degc, list) else 1
        return len(_values(self.alpha_deg)) * len(_values(self.beta_deg)) * len(self.mounts) * self.runs * soaks

    def plan(self) -> Plan:
        """The plan described."""
        plan, count = self._bare(), len(self._bare())
        signs = {None: None, "positive": [1.0], "negative": [-1.0], "alternating": [1.0, -1.0]}[self.approach]
        step = self.interval_s
        if self.positions is not None:
            stated = {name: tuple(getattr(position, name) for position in self.positions) for name in _CONDITIONS}
            plan = replace(plan, **{name: values for name, values in stated.items() if None not in values})
        return replace(
            plan,
            time_s=plan.time_s if step is None else tuple(step * number for number in range(count)),
            temperature_degc=self._temperatures(plan),
            approach=plan.approach if signs is None else tuple(signs[number % len(signs)] for number in range(count)),
        )

    def _temperatures(self, plan: Plan) -> tuple[float, ...] | None:
        given, count = self.temperature_degc, len(plan)
        if given is None:
            return plan.temperature_degc
        if isinstance(given, list):
            return tuple(degc for degc in given for _ in range(count // len(given)))
        return tuple(given.start + (given.end - given.start) * number / max(count - 1, 1) for number in range(count))

    def _bare(self) -> Plan:
        if self.positions is not None:
            names = tuple(p.name or str(number) for number, p in enumerate(self.positions, start=1))
            return Plan(
                names,
                tuple(p.alpha_deg for p in self.positions),
                tuple(p.beta_deg for p in self.positions),
                tuple(p.mount for p in self.positions),
                tuple(p.run for p in self.positions),
            )
        once = grid(_values(self.alpha_deg), _values(self.beta_deg), mounts=self.mounts, runs=self.runs)
        if not isinstance(self.temperature_degc, list):
            return once
        count = len(self.temperature_degc)
        return Plan(
            tuple(f"{soak + 1}-{name}" for soak in range(count) for name in once.names),
            once.alpha_deg * count,
            once.beta_deg * count,
            once.mounts * count,
            once.runs * count,
        )


def _values(angles: "list[float] | Steps | None") -> list[float]:
    return angles.values if isinstance(angles, Steps) else angles or []
