"""The next position of a running capture: its choice, its purpose in words, and the end of the run.

The model is linear, so a choice depends on the positions done, on the times of their dwells and on their noise, and not on the
readings. The standard deviation of a position is that of the rig, or that of the dwells so far if this is larger.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Int

from tumblecal.capture.capture_plan import CapturePlan, PlanPosition
from tumblecal.capture.run.choice import Choice, Ending, Progress
from tumblecal.chain.head_ability import HeadAbility
from tumblecal.chain.rig import Rig
from tumblecal.design.criteria.criterion import Criterion, determined, worst
from tumblecal.design.criteria.measure import measures
from tumblecal.design.model.evaluation import Uncertainties, uncertainties
from tumblecal.design.model.limits import limits_of
from tumblecal.design.model.one_visit import one_visit
from tumblecal.design.model.responses import Responses, responses_of
from tumblecal.design.model.schedule import Schedule, continued, schedule
from tumblecal.design.positions.exchange import exchange
from tumblecal.design.sequential.adaptive_rig import adaptive_cells
from tumblecal.design.sequential.ahead import Ahead, Planner
from tumblecal.design.sequential.target import Target, read_target, uncertainty_words


# A target that a search misses by less than this factor may be reached all the same.
_NEAR = 1.05
_LISTED = 3
# Longer plans are not searched for a warning.
_MOST = 500
# The purpose of a position is a parameter with at least this share of the largest uncertainty, relative to the target.
_LARGE = 0.5
# Positions in another mounting that are proposed at the end.
_MOST_REMOUNTED = 16


@dataclass(frozen=True)
class AdaptiveChooser:
    """Chooses positions of one mounting; a `Chooser` of the capture.

    - `responses`: of the candidates in this mounting (the first `candidates`), the plan's positions, then other mountings.
    - `ability`: with the times of the plan. `target`: None if none is stated. `mount`: label of the mounting.
    """

    responses: Responses
    ability: HeadAbility
    target: Target | None
    mount: str
    candidates: int

    @cached_property
    def here(self) -> Responses:
        """The responses of the present mounting."""
        at = [k for k, mount in enumerate(self.responses.cells.mounts) if mount == self.mount]
        return self.responses.chosen(np.array(at))

    @cached_property
    def elsewhere(self) -> Int[np.ndarray, " others"]:
        """Numbers of the cells of other mountings."""
        return np.arange(len(self.here.cells), len(self.responses.cells))

    @cached_property
    def criterion(self) -> Criterion:
        """The largest uncertainty of the parameters that the present mounting determines, relative to a target.

        **Raises:** `InputError` if it determines none of them.
        """
        if self.target is None:
            return worst(self.here)
        return determined(self.target.criterion(self.here), one_visit(self.here))

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """The parameters of the criterion."""
        used = np.any(self.criterion.functionals != 0, axis=0)
        return tuple(name for name, one in zip(self.responses.names, used, strict=True) if one)

    def __call__(self, progress: Progress) -> Choice | Ending:
        """The next position, or the end of the run."""
        measured = self._measured(progress)
        now = self._with_noise(progress)
        found = uncertainties(now.chosen(np.arange(len(self.here.cells))), measured, self.ability) if measured else None
        if self.target is not None and found is not None:
            missed = [name for name in self.target.missed(found.names, found.sd) if name in self.parameters]
            if not missed:
                return self._ending("target", "the target is reached", found, measured, now)
        best = self._best(progress, measured, now)
        if best is not None:
            cells = self.here.cells
            alpha, beta = float(cells.alpha_deg[best.cells[0]]), float(cells.beta_deg[best.cells[0]])
            return Choice(alpha, beta, self._purpose(best, measured, found, now))
        least = self.ability.times.dwell_s + self.ability.times.settle_s
        if progress.remaining_s < least + self.ability.times.turn_s + self.ability.times.pitch_change_s:
            return self._ending("time", "the time is over", found, measured, now)
        return self._ending("no position", "no other position is possible", found, measured, now)

    def positions(self) -> list[PlanPosition]:
        """All positions that may be chosen."""
        cells = self.here.cells
        angles = zip(cells.alpha_deg.tolist(), cells.beta_deg.tolist(), strict=True)
        return [PlanPosition(alpha_deg=alpha, beta_deg=beta) for alpha, beta in angles][: self.candidates]

    def unreachable(self, minutes: float) -> str:
        """A line about targets that the best plan found in this time does not reach; empty if it reaches all."""
        if self.target is None:
            return ""
        hidden = [name for name in self.target.sd if name not in self.parameters]
        here, ability = self.here, replace(self.ability, mounts=(self.mount,))
        if minutes * 60 > _MOST * (ability.times.dwell_s + ability.times.settle_s):
            return f"mounting {self.mount} does not determine {', '.join(hidden)}" if hidden else ""
        model = one_visit(here)
        allowed = np.arange(len(here.cells)) < self.candidates
        limits = limits_of(here.cells, ability, minutes=minutes, allowed=allowed, repeats=1000)
        chosen = exchange(limits, measures(model, self.criterion), restarts=2)
        found = uncertainties(here, schedule(here.cells, chosen.cells, self.ability.times), ability)
        missed = [name for name in self.target.missed(found.names, found.sd, _NEAR) if name not in hidden]
        lines = []
        if hidden:
            lines.append(f"mounting {self.mount} does not determine {', '.join(hidden)}")
        if missed:
            rest = len(self.target.sd) - len(missed) - len(hidden)
            others = f"; the other {rest} can be reached" if rest else ""
            lines.append(
                f"{minutes:g} min do not suffice for {len(missed)} of {len(self.target.sd)} parameters: the best plan found "
                f"gives {self._listed(missed, found)}{others}"
            )
        return "; ".join(lines)

    def _measured(self, progress: Progress) -> Schedule | None:
        """The positions done, with the times of their dwells."""
        if not progress.done:
            return None
        cells, seconds = self.here.cells, self.ability.times.dwell_s
        places = np.array([self._number(one.alpha_deg, one.beta_deg) for one in progress.done])
        # A clock that was set back, or the speed of a virtual device, must not make dwells overlap.
        start = np.array([one.start_s for one in progress.done]) - progress.done[0].start_s
        steps = np.arange(len(start)) * seconds
        start = np.maximum.accumulate(start - steps) + steps
        end = max(progress.end_s - progress.done[0].start_s, start[-1] + seconds)
        visits = np.concatenate([[0], np.cumsum(np.diff(cells.pitch[places]) != 0)])
        return Schedule(places, start, float(end), visits, np.zeros(len(places), int))

    def _number(self, alpha_deg: float, beta_deg: float) -> int:
        cells = self.here.cells
        away = np.abs((cells.alpha_deg - alpha_deg + 180) % 360 - 180) + np.abs(cells.beta_deg - beta_deg)
        return int(np.argmin(away))

    def _with_noise(self, progress: Progress) -> Responses:
        """The responses, with the larger noise of the dwells so far if it exceeds that of the rig."""
        sds = np.array([one.sd_g for one in progress.done if len(one.sd_g) == 3])
        sds = sds[np.isfinite(sds).all(axis=1)] if len(sds) else sds
        seen = float(np.sqrt(np.max(np.mean(sds**2, axis=0)))) if len(sds) else 0.0
        return replace(self.responses, sd=max(self.responses.sd, seen))

    def _best(self, progress: Progress, measured: Schedule | None, now: Responses) -> Ahead | None:
        """The plan of the rest. It begins neither with a skipped position nor with the present one."""
        allowed = np.arange(len(self.here.cells)) < self.candidates
        allowed[[self._number(*angles) for angles in progress.skipped]] = False
        if measured is not None:
            allowed[measured.cells[-1]] = False
        here = now.chosen(np.arange(len(self.here.cells)))
        return Planner(here, self.ability, self.criterion, measured, allowed).plan(progress.remaining_s, self._goal)

    @property
    def _goal(self) -> float | None:
        """The criterion to reach."""
        return None if self.target is None else 1.0

    def _purpose(self, best: Ahead, measured: Schedule | None, before: Uncertainties | None, now: Responses) -> str:
        """The purpose of a position and of those that follow it in this pitch setting, for the operator."""
        batch = best.first_visit(now)
        after = self._after(now, measured, batch)
        count = len(batch)
        together = "" if count == 1 else f", with the next {count - 1}" if count > 2 else ", with the next one"
        return f"{self._reduction(before, after, self.parameters)}{together}"

    def _after(self, now: Responses, measured: Schedule | None, further: Int[np.ndarray, " further"]) -> Uncertainties:
        """The uncertainties after further positions."""
        return uncertainties(now, continued(now.cells, measured, further, self.ability.times), self.ability)

    def _reduction(self, before: Uncertainties | None, after: Uncertainties, parameters: tuple[str, ...]) -> str:
        """The parameter whose uncertainty is reduced most, among those with a large one, in words."""
        at = [after.names.index(name) for name in parameters]
        new, wanted = after.sd[at], self._wanted(parameters)
        old = np.full(len(at), np.inf) if before is None else before.sd[at]
        if not np.any(np.isfinite(new)):
            return "begins to determine the parameters"
        fresh = np.isinf(old) & np.isfinite(new)
        if np.any(fresh):
            k = int(np.argmin(np.where(fresh, new / wanted, np.inf)))
            words = uncertainty_words(parameters[k], new[k])
            return f"determines {parameters[k]}: uncertainty {words}{self._aim(parameters[k])}"
        ratio = np.where(np.isfinite(old), old / wanted, 0.0)
        large = ratio >= _LARGE * np.max(ratio)
        k = int(np.argmax(np.divide(old, new, out=np.zeros(len(at)), where=large & np.isfinite(old))))
        name = parameters[k]
        digits = 2 if new[k] < 0.9 * old[k] else 3
        return (
            f"reduces the uncertainty of {name} from {uncertainty_words(name, old[k], digits)} to "
            f"{uncertainty_words(name, new[k], digits)}{self._aim(name)}"
        )

    def _wanted(self, parameters: tuple[str, ...]) -> np.ndarray:
        """The target of parameters, or a common size."""
        return np.array([1e-3 if self.target is None else self.target.sd[name] for name in parameters])

    def _aim(self, name: str) -> str:
        return "" if self.target is None else f" (target {self._target_words(name)})"

    def _target_words(self, name: str) -> str:
        assert self.target is not None
        return uncertainty_words(name, self.target.sd[name])

    def _ending(
        self, reason: str, words: str, found: Uncertainties | None, measured: Schedule | None, now: Responses
    ) -> Ending:
        if found is None:
            return Ending(reason, words)
        sd = found.sd[[found.names.index(name) for name in self.parameters]]
        if self.target is None:
            name = self.parameters[int(np.argmax(sd))]
            state = f"largest uncertainty: {name} {uncertainty_words(name, float(np.max(sd)))}"
        else:
            missed = [name for name in self.target.missed(found.names, found.sd) if name in self.parameters]
            reached = len(self.target.sd) - len(missed)
            state = f"{reached} of {len(self.target.sd)} targets reached"
            state = f"not reached: {self._listed(missed, found)}" if missed else state
            hidden = [name for name in self.target.sd if name not in self.parameters]
            state += f"; mounting {self.mount} does not determine {', '.join(hidden)}" if hidden else ""
        parts = [f"{words}; {state}", self._remount(found, measured, now)]
        return Ending(reason, ". ".join(part for part in parts if part))

    def _listed(self, names: list[str], found: Uncertainties) -> str:
        assert self.target is not None
        words = [
            f"{name} {uncertainty_words(name, float(found.sd[found.names.index(name)]))} (target {self._target_words(name)})"
            for name in names[:_LISTED]
        ]
        more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
        return ", ".join(words) + more

    def _remount(self, before: Uncertainties, measured: Schedule | None, now: Responses) -> str:
        """What another mounting would give, in words; empty if there is none or it gives nothing."""
        if measured is None or not len(self.elsewhere):
            return ""
        criterion = worst(now) if self.target is None else self.target.criterion(now)
        if self.target is not None and not self.target.missed(before.names, before.sd):
            return ""
        planner = Planner(now, self.ability, criterion, measured, np.isin(np.arange(len(now.cells)), self.elsewhere))
        found = planner.plan(np.inf, self._goal, _MOST_REMOUNTED)
        if found is None or found.value >= planner.value(measured):
            return ""
        after = self._after(now, measured, found.cells)
        names = self.parameters if self.target is None else tuple(self.target.sd)
        mount, count = now.cells.mounts[found.cells[0]], len(found.cells)
        return (
            f'Next: {count} positions in mounting {mount}, a capture of its own with session.mount = "{mount}", '
            f"would improve this: it {self._reduction(before, after, names)}"
        )


def chooser_of(rig: Rig, plan: CapturePlan, target_file: Path | None = None) -> AdaptiveChooser:
    """The chooser of an adaptive capture.

    **Arguments:**

    - `rig`: with what the head can do. `plan`: first positions, mounting, dwell.

    **Raises:** `InputError` if the rig and the plan do not suit an adaptive capture, in one line.
    """
    cells, candidates = adaptive_cells(rig, plan)
    ability = rig.ability
    assert ability is not None
    found = responses_of(rig, cells)
    target = None if target_file is None else read_target(target_file, found.names)
    times = ability.times
    if "times.dwell_s" not in ability.assumed:
        found = replace(found, sd=found.sd * float(np.sqrt(times.dwell_s / plan.dwell.seconds)))
    here = replace(times, dwell_s=float(plan.dwell.seconds), settle_s=float(plan.dwell.settle_s))
    return AdaptiveChooser(found, replace(ability, times=here), target, plan.session.mount, candidates)
