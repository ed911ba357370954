"""The population `next`: are the predictions of NEXT fulfilled? The proposed positions are measured and diagnosed as one run.

    python benchmarks/blind next --instruments 160 --seed 3001

Each blind instrument hides one cause of 5 to 15 sigma, or two. If the diagnosis proposes positions to separate
explanations, they are measured in the proposed order, conditions and mountings. A prediction is fulfilled if the truth
alone, or with the same function at 1 g, is then identified. If the plan states that alternatives remain, no others may
remain.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

import blind_instrument as blind
import tumblecal


tumblecal.enable_float64()
from blind.judge import SURE  # noqa: E402
from blind.plans import PLANS, remounted  # noqa: E402
from blind_noise import position_set  # noqa: E402
from command_line import asked, print_head, print_row  # noqa: E402
from tumblecal.diagnosis import Diagnoser  # noqa: E402
from tumblecal.ground.errors import InputError  # noqa: E402
from tumblecal.plan.next.next_plan import SEPARATE  # noqa: E402
from tumblecal.plan.next.proposals import SIDES  # noqa: E402
from tumblecal.planning import next_plan  # noqa: E402


BINS = (0.0, 0.5, 0.8, 0.9, 1.01)
AXES = blind.AXES
# A jump and a square refer to the middle of the run, which moves if the run is continued.
EFFECTS = {
    "an effect": [
        name
        for name in (*blind.COEFFICIENTS, *blind.RARE)
        if not any(word in name for word in ("gravity", "warm_up", "drift", "temperature", "by_pitch", "hysteresis"))
    ],
    "warm-up": ["warm_up"],
    "drift": [f"{leaf}_drift.{axis}" for leaf in ("bias", "scale", "misalignment") for axis in AXES],
    "temperature": [f"{leaf}_temperature.{axis}" for leaf in ("bias", "scale") for axis in AXES],
    "hysteresis": [f"hysteresis.{axis}" for axis in AXES],
    "offset at pitch settings": [f"bias_by_pitch.{axis}" for axis in AXES],
    "fixture moved": ["mount_by_pitch"],
    "vibration": [],
}
# How often each kind is drawn; `mixed`: two causes of different kinds.
SHARES = dict.fromkeys(EFFECTS, 1.0) | {"an effect": 3.0, "mixed": 2.0}
MOUNTS = ("1", "2", "turned_y", "turned_z")


class Bench:
    """An instrument on its head, whose measurement can be continued: angles, mountings and pitch settings that are set later
    have their errors from the beginning."""

    def __init__(self, kind: str, rng: np.random.Generator):
        self.rng, self.factor, self.noisy = rng, 1.0, -1
        while True:
            self.plan = str(rng.choice(["3x8", "4x12", "two mountings"]))
            setup = blind.random_setup(rng, *PLANS.get(self.plan, (3, 6)))
            if self.plan == "two mountings":
                setup = remounted(setup, ((0, 0, 0), (0, 90, 0)), rng)
            warms = rng.uniform(1, 5) * rng.integers(2)
            rise = warms * (setup.time_s - setup.time_s[0]) / np.ptp(setup.time_s)
            self.setup = replace(setup, temperature_degc=setup.temperature_degc + rise)
            kinds = rng.choice(list(EFFECTS)[:-1], 2, replace=False).tolist() if kind == "mixed" else [kind]
            if kind == "vibration":
                self.effects, self.truth = {}, ("noise_unequal",)
                self.factor, self.noisy = rng.uniform(3, 8), rng.integers(setup.pitch.max() + 1)
                return
            names = [str(rng.choice(EFFECTS[own])) for own in kinds]
            projector = blind.unreachable(self.setup)
            drawn = [blind.sized(self.setup, projector, name, rng.uniform(5, 15), rng) for name in names]
            if any(own is None for own in drawn):
                continue
            signals = [own[1] / np.linalg.norm(own[1]) for own in drawn]
            if len(drawn) == 1 or abs(signals[0] @ signals[1]) < 0.5:
                self.effects = {name: own[0] for name, own in zip(names, drawn, strict=True)}
                self.truth = tuple(sorted(names))
                return

    def measured(self, setup: blind.Setup) -> np.ndarray:
        """Readings with noise."""
        sd = blind.SIGMA * np.where(setup.pitch == self.noisy, self.factor, 1.0)
        clean = blind.readings(setup, setup.nominal, self.effects)
        return clean + sd[:, None] * self.rng.normal(size=clean.shape)

    def continued(self, cells: list[tuple[float, float, int]], time_s: np.ndarray, degc: np.ndarray) -> blind.Setup:
        """The setup with further positions: alpha and beta in deg, and the mounting (of `MOUNTS`)."""
        old, rng, count = self.setup, self.rng, len(cells)
        levels = [old.beta[old.pitch == k][0] for k in range(old.pitch.max() + 1)]
        before = len(levels)
        for _, beta, _ in cells:
            if not np.any(np.isclose(levels, np.radians(beta))):
                levels.append(np.radians(beta))
        pitch = [int(np.argmin(np.abs(np.array(levels) - np.radians(beta)))) for _, beta, _ in cells]
        errors = rng.uniform(-3e-3, 3e-3, (len(MOUNTS), len(levels)))
        mounts = rng.normal(0, 5e-3, (len(MOUNTS), 3))
        known = old.nominal["dbeta"].reshape(-1, before)
        errors[: len(known), :before], mounts[: len(known)] = known, old.nominal["dtheta"].reshape(-1, 3)
        for name in self.effects:
            if "_by_pitch." in name or name == "index_zero":
                # A setting that comes later has no error of this kind.
                self.effects[name] = np.append(self.effects[name], np.zeros(len(levels) - before))
        alpha, beta, mounting = np.array(cells).T
        turns = [(0, 0, 0), (0, 90, 0), *SIDES.values()]
        return replace(
            old,
            alpha=np.append(old.alpha, np.radians(alpha)),
            beta=np.append(old.beta, np.radians(beta)),
            time_s=np.append(old.time_s, time_s),
            temperature_degc=np.append(old.temperature_degc, degc),
            approach=np.append(old.approach, np.ones(count)),
            pitch=np.append(old.pitch, pitch),
            names=[*old.names, *(f"next-{k + 1}" for k in range(count))],
            mounting=np.append(old.mountings, mounting.astype(int)),
            turns=Rotation.from_euler("XYZ", -np.radians(turns)).as_matrix(),
            nominal=old.nominal | {"dbeta": errors.ravel(), "dtheta": mounts.ravel()},
        )


def data_of(setup: blind.Setup, readings: np.ndarray):
    """The position set of one run, the noise stated."""
    data = position_set(setup, readings, known=True)
    return replace(data, mount=tuple(MOUNTS[own] for own in setup.mountings)) if np.ptp(setup.mountings) else data


def proposed(bench: Bench, plan) -> blind.Setup:
    """The setup with the positions of a plan, in its order and under its conditions."""
    last = int(bench.setup.mountings[-1])
    cells = [
        (alpha, own.beta_deg, 2 + [*SIDES].index(own.mount) if own.mount else last)
        for own in plan.together
        for alpha in own.angles_deg
    ]
    times = plan.conditions.time_s + plan.conditions.step_s * np.arange(len(cells))
    return bench.continued(cells, times, plan.conditions.temperature_degc + 0.05 * bench.rng.normal(size=len(cells)))


def listed(diagnosis, sets) -> set[frozenset[str]]:
    """Sets of causes with the faults of the noise."""
    return {frozenset([*labels, *diagnosis.noise_labels]) for labels in sets}


def one(number: int, seed: int, diagnoser: Diagnoser, kinds: list[str]) -> dict:
    """The record of an instrument: what is hidden, predicted, and found at the end."""
    rng = np.random.default_rng([seed, number])
    shares = np.array([SHARES[own] for own in kinds])
    bench = Bench(kind := str(rng.choice(kinds, p=shares / shares.sum())), rng)
    truth, readings = frozenset(bench.truth), bench.measured(bench.setup)
    record = {"number": number, "kind": kind, "plan": bench.plan, "truth": bench.truth}
    try:
        diagnosis = diagnoser(data_of(bench.setup, readings))
        plan = next_plan(diagnosis)
        record |= {"verdict": diagnosis.verdict, "labels": diagnosis.labels}
        if plan.promise is None or plan.purpose != SEPARATE:
            return record
        more = proposed(bench, plan)
        again = diagnoser(data_of(more, np.concatenate([readings, bench.measured(more)[len(readings) :]])))
    except InputError as fault:
        return record | {"verdict": "rejected", "message": str(fault)}
    best, remaining = again.best, {*plan.promise.remaining}
    in_class = truth in listed(again, [best.labels, *best.stated, *best.powers])
    claimed = truth in listed(again, [best.labels, *best.identical, *best.powers])
    fulfilled = again.verdict == "identified" and claimed
    if remaining:
        fulfilled = in_class and len({best.labels, *best.separable} - remaining) <= 1
    sure = best.probability > SURE and again.verdict in ("identified", "ambiguous")
    record |= {"probability": plan.promise.probability, "settles": plan.promise.made}
    return record | {"labels again": again.labels, "fulfilled": fulfilled, "wrong": sure and not in_class}


def table(records: list[dict]) -> None:
    """How many predictions were fulfilled, by stated probability."""
    measured = [own for own in records if "fulfilled" in own]
    verdicts = Counter(own["verdict"] for own in records)
    print(f"{len(records)} instruments, {dict(verdicts)}; {len(measured)} with positions to separate explanations\n")
    print_head("probability stated", "instruments", "mean", "fulfilled", "wrong with p > 0.9")
    rows = {
        f"{a:g} to {min(b, 1):g}": [own for own in measured if a <= own["probability"] < b] for a, b in pairwise(BINS)
    }
    rows |= {"this settles": [own for own in measured if own["settles"]], "all": measured}
    rows |= {kind: [own for own in measured if own["kind"] == kind] for kind in SHARES}
    for words, own in rows.items():
        if own:
            good, bad = sum(one["fulfilled"] for one in own), sum(one["wrong"] for one in own)
            mean = np.mean([one["probability"] for one in own])
            print_row(words, len(own), f"{mean:.2f}", f"{good} ({good / len(own):.0%})", bad)


def main(words: Sequence[str]) -> None:
    """Draw, diagnose, continue, diagnose again; print the table."""
    given, diagnoser = asked(__doc__, words, instruments=160, seed=3001, only=[str]), Diagnoser(nested=False)
    table([one(number, given.seed, diagnoser, given.only or [*SHARES]) for number in range(given.instruments)])
