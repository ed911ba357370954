"""A check for people: its words, and its page."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tumblecal.check.consistency import LEVEL
from tumblecal.check.drift import ProcessNoise
from tumblecal.check.moved import Explanation
from tumblecal.check.record import CheckRecord
from tumblecal.check.result import CheckResult
from tumblecal.check.sensitivity import JOINED, POWER, combination_words, size_words
from tumblecal.check.update import Update
from tumblecal.data.sensor_parameters import GROUPS, SENSOR, leaf_of
from tumblecal.estimation.attitudes import attitude_words
from tumblecal.ground.numbers_shown import counted, decimals, rounded_together, with_decimals
from tumblecal.ground.units import shown
from tumblecal.show.figures.check import FIGURES
from tumblecal.show.page import write_page
from tumblecal.show.verdict import verdict_lines
from tumblecal.show.words import Words, words_of


_KINDS = {"bias": "bias", "dK": "scale factor", "gamma": "non-orthogonality"}
# Hidden combinations that a line lists, and parameters of each.
_MOST_HIDDEN, _MOST_TOGETHER = 3, 3


def words_of_check(
    result: CheckResult,
    given: Sequence[object],
    made: tuple[Update, ProcessNoise] | None = None,
    written: Path | None = None,
) -> Words:
    """The words of a check.

    **Arguments:**

    - `given`: calibration and recording, for suggested commands. `made`: update and process noise. `written`: the file of the
      update.
    """
    seen, data, moved = result.sensitivity, result.data, result.moved
    named = None if moved is None else moved.named
    excess, sd = result.sizes.excess * 1e3, result.sizes.sd * 1e3
    worst = int(np.argmax(np.abs(excess)))
    update, process = made or (None, None)
    size_mg, expanded_mg = (1e3 * each for each in result.change_g or (0.0, 0.0))
    places = decimals(expanded_mg)
    few = [each for each in seen.hidden_together if each.count(JOINED) < _MOST_TOGETHER][:_MOST_HIDDEN]
    visible = dict(zip(SENSOR, seen.limits.tolist(), strict=True))
    incomplete = seen.invisible or len(seen.hidden) or 0 < len(seen.poorly_visible) < len(SENSOR)
    return words_of(
        "check",
        r=result,
        serial=result.serial_number,
        file=Path(data.source).name,
        attitudes=f"{counted(len(data), 'attitude')} with {'unknown' if data.hand_held else 'known'} angles",
        named=named,
        size_of=_size,
        size=_size(named) if named else "",
        id=named.parameters[0] if named and len(named.parameters) == 1 else "",
        change_mg=with_decimals(size_mg, places),
        expanded_mg=with_decimals(expanded_mg, places),
        largest_mg=float(np.max(np.abs(excess))),
        factor=result.test.noise_factor,
        poorly=", ".join(_limits(seen.poorly_visible, whole=False)),
        few=few,
        rest=len(seen.hidden_together) - len(few),
        level=LEVEL,
        power=POWER,
        rms_mg=float(np.sqrt(np.mean(np.square(excess)))),
        worst=rounded_together(excess[worst], sd[worst]),
        worst_name=data.names[worst],
        detected="; ".join(_limits({name: size for name, size in visible.items() if np.isfinite(size)}, whole=True)),
        hardest=combination_words(seen.worst),
        limited=_limited(result),
        further=attitude_words(result.noise.data.readings) if incomplete else "",
        given=given,
        update=update,
        process=process,
        written=written,
    )


def _size(one: Explanation) -> str:
    """The change of one parameter with its standard uncertainty, `2.10 +- 0.05 mg`; "" for several, and for an attitude."""
    if len(one.parameters) != 1 and one.kind != "scales":
        return ""
    k = SENSOR.index(one.parameters[0]) if one.kind != "scales" else 0
    unit, factor = shown(GROUPS[leaf_of(SENSOR[k])][1])
    text = rounded_together(one.change[k] * factor, one.sd[k] * factor)
    return f"({text})e-3" if unit == "1e-3" else f"{text} {unit}"


def _limits(limits: Mapping[str, float], *, whole: bool) -> Iterator[str]:
    """Limits by kind of parameter, `bias 0.32 to 0.64 mg`; fewer than three of a kind by name, unless kinds are `whole`."""
    for leaf, kind in _KINDS.items():
        of_kind = sorted((size, name) for name, size in limits.items() if leaf_of(name) == leaf)
        if len(of_kind) < 3 and not whole:
            yield from (f"{name} {size_words(name, limits[name])}" for name in limits if leaf_of(name) == leaf)
        elif of_kind:
            low, high = (size_words(name, size) for size, name in (of_kind[0], of_kind[-1]))
            first = low.partition(" ")[0]
            yield f"{kind} {high if low == high else f'{first} to {high}'}"


def _limited(result: CheckResult) -> str:
    """Which uncertainty limits the sensitivity to a bias: `noise`, `expected`, or "" if no bias is visible."""
    slopes, test = result.test.slopes, result.test
    shares = [
        test.per_unit(change) / max(float(np.sum((slopes @ change) ** 2)), 1e-300)
        for change in np.eye(len(SENSOR))[3:6]
        if np.any(slopes @ change)
    ]
    # The share of the noise in the variance along a change.
    return "" if not shares else "noise" if np.median(shares) > 0.5 else "expected"


def write_check(
    folder: Path, result: CheckResult, words: Words, source: Mapping[str, Any], update: Update | None, *, figures: bool
) -> None:
    """Write the files of a check; `source`: its provenance, `figures`: whether with its page."""
    text = "\n".join(verdict_lines(words.verdict))
    CheckRecord.of(result, **source, update=update, text=text).write(folder / "check.json")
    if figures:
        write_page(folder / "check.html", words, FIGURES, result)
