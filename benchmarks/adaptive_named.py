"""Positions until a hidden effect is named, for sequences of positions that are cut at several lengths.

Each instrument has one effect of `plan_naming.EFFECTS`, drawn at random, all its coefficients of one random size (0.1 to
1 mg/g^2, mg/g^3 or mrad; the noise of a dwell is 0.1 mg). The pitch settings have a prior of 3 arcmin: without it the first
positions determine nothing. The decisions are those of the forecast of a plan, on simulated residuals (white noise in plain
numpy and the signal of the effect). Whole diagnoses of simulated readings of the first instruments check them
(`plan_naming.Head`).
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plan_naming import EFFECTS, ENTRIES, Head, OfModel
from tumblecal.chain.rig import Rig
from tumblecal.design.forecast.decisions import decisions
from tumblecal.design.forecast.effects_of_plan import EffectsOfPlan, effects_of_plan
from tumblecal.design.model.cells import cells_of
from tumblecal.design.model.responses import responses_of
from tumblecal.ground.errors import InputError


LENGTHS = (8, 12, 16, 24, 32, 48)
SMALLEST, LARGEST = 0.1, 1.0
Angles = list[tuple[float, float]]


@dataclass(frozen=True)
class Instrument:
    """A hidden effect and its size in its unit; `number` of the instrument."""

    number: int
    effect: str
    size: float

    @classmethod
    def random(cls, seed: int, number: int) -> "Instrument":
        """An instrument by its number."""
        rng = np.random.default_rng([seed, number])
        size = float(np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST))))
        return cls(number, EFFECTS[rng.integers(len(EFFECTS))], size)


def named_table(rig: Rig, sequences: Mapping[str, Angles], count: int, whole: int, seed: int, out: Path) -> None:
    """Print the table; results that `out` has are not computed again."""
    instruments = [Instrument.random(seed, number) for number in range(count)]
    done = [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []
    results = {(one["sequence"], one["length"]): one for one in done if (one["count"], one["seed"]) == (count, seed)}
    for length in LENGTHS:
        for name, angles in sequences.items():
            if (name, length) in results:
                continue
            found = _of_length(rig, angles[:length], instruments, whole, seed)
            results[name, length] = {"sequence": name, "length": length, "count": count, "seed": seed, **found}
            with out.open("a") as file:
                file.write(json.dumps(results[name, length]) + "\n")
            print(f"{name}, {length} positions: {100 * np.mean(found['named']):.1f} % named", flush=True)
    _print_table(results, tuple(sequences))


def _of_length(rig: Rig, angles: Angles, instruments: Sequence[Instrument], whole: int, seed: int) -> dict:
    """Which instruments are detected, named and identified with some positions; the same by `whole` diagnoses."""
    assert rig.ability is not None
    responses = responses_of(rig, cells_of(rig.ability))
    cells = responses.cells
    keys = list(zip(cells.alpha_deg.tolist(), cells.beta_deg.tolist(), strict=True))
    head = Head(rig, responses, np.array([keys.index(at) for at in angles]))
    of = effects_of_plan(head.rig, ENTRIES)
    diagnoser = OfModel(of)
    checked = [_diagnosed(head, diagnoser, one, seed) for one in instruments[:whole]]
    return {
        "minutes": head.schedule.minutes,
        **dict(zip(("detected", "named", "identified"), _forecast(of, instruments, seed).tolist(), strict=True)),
        "whole": checked,
    }


def _forecast(of: EffectsOfPlan, instruments: Sequence[Instrument], seed: int) -> np.ndarray:
    """Decisions (3, instruments); the noise of an instrument's first readings is the same for all lengths."""
    found = np.zeros((3, len(instruments)), bool)
    for id in dict.fromkeys(one.effect for one in instruments):
        try:
            shown = of.shown(id)
        except InputError:
            continue
        at = [k for k, one in enumerate(instruments) if one.effect == id]
        noise = [np.random.default_rng([seed, 1, instruments[k].number]).standard_normal(len(of.at.basis)) for k in at]
        sizes = np.array([instruments[k].size for k in at])
        found[:, at] = decisions(of, id, np.array(noise) @ of.at.basis + sizes[:, None] * shown)
    return found


def _diagnosed(head: Head, diagnoser: OfModel, one: Instrument, seed: int) -> list[bool] | None:
    """The decisions of a whole diagnosis; None if the readings cannot be diagnosed."""
    rng = np.random.default_rng([seed, 2, one.number])
    try:
        return [bool(each) for each in head.judged(diagnoser, rng, one.effect, one.size)]
    except InputError:
        return None


def _print_table(results: Mapping[tuple[str, int], dict], names: Sequence[str]) -> None:
    lengths = " | ".join(f"{length}" for length in LENGTHS)
    print(f"| positions | {lengths} | median until named | never |\n|{'---|' * (len(LENGTHS) + 3)}")
    for name in names:
        named = np.array([results[name, length]["named"] for length in LENGTHS])
        first = np.where(named.any(axis=0), np.array(LENGTHS)[np.argmax(named, axis=0)], np.inf)
        shares = " | ".join(f"{100 * share:.0f} %" for share in named.mean(axis=1))
        middle = np.median(first)
        shown = f"{middle:.0f}" if np.isfinite(middle) else f"more than {LENGTHS[-1]}"
        print(f"| {name} | {shares} | {shown} | {100 * np.mean(np.isinf(first)):.0f} % |")
    both = [
        (whole[1], forecast)
        for one in results.values()
        for whole, forecast in zip(one["whole"], one["named"], strict=False)
        if whole is not None
    ]
    if both:
        diagnosed, forecast = np.array(both).T
        print(
            f"named in {len(both)} whole diagnoses of the first instruments: {100 * diagnosed.mean():.1f} %; by the decisions "
            f"of the forecast for the same instruments, with other noise: {100 * forecast.mean():.1f} %"
        )
