"""A check in words: what changed, what it cannot see, the test and its sensitivity."""

from collections.abc import Iterator, Mapping

import numpy as np

from tumblecal.check.consistency import LEVEL
from tumblecal.check.moved import Explanation
from tumblecal.check.result import CheckResult
from tumblecal.check.sensitivity import JOINED, POWER, combination_words, size_words
from tumblecal.data.sensor_parameters import GROUPS, SENSOR, leaf_of
from tumblecal.ground.counted import counted
from tumblecal.ground.numbers_shown import decimals, p_words, rounded_together, with_decimals
from tumblecal.ground.units import shown


_OF_LEAF = {"bias": "bias of the {} axis", "dK": "scale factor of the {} axis", "gamma": "non-orthogonality {}"}
_KINDS = {"bias": "bias", "dK": "scale factor", "gamma": "non-orthogonality"}
# Combinations that a line lists, and parameters of each.
_MOST_HIDDEN, _MOST_TOGETHER = 3, 3
_MOST_EXPLANATIONS = 3


def probability_words(probability: float) -> str:
    """A probability; near 1 as a bound."""
    return "> 0.99" if probability > 0.995 else f"{probability:.2g}"


def parameter_words(name: str) -> str:
    """A parameter in words: `bias of the x axis`."""
    return _OF_LEAF[leaf_of(name)].format(name.partition("_")[2])


def explanation_words(explanation: Explanation) -> str:
    """What changed, in words."""
    kind = explanation.kind
    if kind == "attitude":
        return f"attitude {explanation.attitude}: not at rest, or in error"
    if kind in ("biases", "several"):
        return "several biases" if kind == "biases" else "several parameters"
    if kind == "scales":
        return "all scale factors together, or the value of gravity,"
    return parameter_words(explanation.parameters[0])


def change_and_uncertainty(name: str, change: float, sd: float) -> str:
    """A change of a parameter with its standard uncertainty: `2.10 +- 0.05 mg`."""
    unit, factor = shown(GROUPS[leaf_of(name)][1])
    text = rounded_together(change * factor, sd * factor)
    return f"({text})e-3" if unit == "1e-3" else f"{text} {unit}"


def explanation_size(explanation: Explanation) -> str:
    """The change of one parameter with its standard uncertainty; "" for several, and for an attitude."""
    if explanation.kind == "scales":
        return change_and_uncertainty("dK_x", explanation.change[0], explanation.sd[0])
    if len(explanation.parameters) != 1:
        return ""
    k = SENSOR.index(explanation.parameters[0])
    return change_and_uncertainty(SENSOR[k], explanation.change[k], explanation.sd[k])


def attitudes_words(result: CheckResult) -> str:
    """Number and kind of the attitudes."""
    count = len(result.data)
    if result.data.hand_held:
        return counted(count, "attitude") + " with unknown angles"
    return counted(count, "attitude") + " with known angles"


def test_words(result: CheckResult) -> str:
    """The test of the parameters and its outcome."""
    test = result.test
    return (
        f"Agreement: chi2 = {test.chi2:.3g} ({counted(test.dof, 'degree')} of freedom), {p_words(test.p_value)}, "
        f"rejected below {LEVEL:g}"
    )


def rest_words(result: CheckResult) -> Iterator[str]:
    """The test of noise and linear model; nothing without degrees of freedom."""
    test = result.test
    if test.rest_p is None:
        return
    if test.disagree:
        larger = f" by {test.noise_factor:.2g} times their noise" if test.noise_factor > 1 else ""
        used = "; the test uses the larger noise" if larger else ""
        yield (
            f"The attitudes disagree with each other{larger} for any parameters ({p_words(test.rest_p)}): the noise is larger "
            f"between attitudes, one was not at rest, or the sensor is nonlinear{used}"
        )
        return
    yield f"Agreement of the attitudes with each other: {p_words(test.rest_p)}"


def size_of_gravity_words(result: CheckResult) -> str:
    """The deviation of the size of gravity."""
    excess, sd = result.sizes.excess * 1e3, result.sizes.sd * 1e3
    worst = int(np.argmax(np.abs(excess)))
    largest = f"{rounded_together(excess[worst], sd[worst])} mg ({result.data.names[worst]})"
    if len(excess) == 1:
        return f"Size of gravity: deviation {largest}"
    return f"Size of gravity: deviation {rms(excess):.2g} mg rms, largest {largest}"


def rms(values: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def sensitivity_words(result: CheckResult) -> str:
    """The smallest detected changes by kind of parameter."""
    limits = result.sensitivity.limits
    parts = []
    for leaf in ("bias", "dK", "gamma"):
        of_leaf = [(limits[k], name) for k, name in enumerate(SENSOR) if leaf_of(name) == leaf]
        seen = sorted(pair for pair in of_leaf if np.isfinite(pair[0]))
        if not seen:
            continue
        parts.append(f"{_KINDS[leaf]} {_range_words(seen[0][1], seen[0][0], seen[-1][0])}")
    return f"Detected with probability {POWER:g}, if one parameter changes: {'; '.join(parts) or 'nothing'}"


def unseen_lines(result: CheckResult) -> Iterator[str]:
    """What the recording cannot see, a line each."""
    found = result.sensitivity
    if found.invisible:
        yield f"changes of {', '.join(found.invisible)}"
    if found.poorly_visible:
        yield f"changes smaller than {', '.join(_by_kind(found.poorly_visible))}"
    together = found.hidden_together
    if len(result.data) == 1 and result.data.hand_held:
        yield "any change that leaves the size of gravity in this one attitude the same"
    elif together:
        few = [words for words in together if words.count(JOINED) < _MOST_TOGETHER][:_MOST_HIDDEN]
        rest = len(together) - len(few)
        more = (
            [f"{rest} combinations of several parameters" if rest > 1 else "a combination of several parameters"]
            if rest
            else []
        )
        yield f"changes that cancel in these attitudes ({'; '.join([*few, *more])})"
    if result.data.hand_held:
        yield "a rotation of all axes together (the mount), because the angles are unknown"
    else:
        yield "a rotation of all axes together, which is estimated as the mount"
    if result.gravity.sd:
        yield f"a common change of all scale factors below the uncertainty of gravity, {result.gravity.sd:.1g}"


def _by_kind(limits: Mapping[str, float]) -> Iterator[str]:
    """Limits of parameters; those of three of one kind as a range."""
    for leaf, kind in _KINDS.items():
        of_leaf = {name: size for name, size in limits.items() if leaf_of(name) == leaf}
        if len(of_leaf) < 3:
            yield from (f"{name} {size_words(name, size)}" for name, size in of_leaf.items())
        else:
            yield f"{kind} {_range_words(next(iter(of_leaf)), min(of_leaf.values()), max(of_leaf.values()))}"


def _range_words(name: str, low: float, high: float) -> str:
    """`0.32 to 0.64 mg`."""
    first, last = size_words(name, low), size_words(name, high)
    return last if first == last else f"{first.partition(' ')[0]} to {last}"


def limit_words(result: CheckResult) -> str:
    """Which uncertainty limits the sensitivity to a bias."""
    slopes, test = result.test.slopes, result.test
    shares = [
        test.per_unit(change) / max(float(np.sum((slopes @ change) ** 2)), 1e-300)
        for change in np.eye(len(SENSOR))[3:6]
        if np.any(slopes @ change)
    ]
    if not shares:
        return "no bias is visible"
    # The share of the noise in the variance along a change.
    noise = float(np.median(shares))
    return "the noise of the attitudes" if noise > 0.5 else "the uncertainty of the expected parameters"


def explanations_words(result: CheckResult) -> str:
    """The explanations that are not separated, with their probabilities."""
    assert result.moved is not None
    possible = result.moved.possible
    listed = [
        " ".join(
            filter(None, [explanation_words(each), explanation_size(each), f"({probability_words(each.probability)})"])
        )
        for each in possible[:_MOST_EXPLANATIONS]
    ]
    more = f"; and {len(possible) - _MOST_EXPLANATIONS} more" if len(possible) > _MOST_EXPLANATIONS else ""
    return f"{'; '.join(listed)}{more}"


def worst_words(result: CheckResult) -> str:
    """The visible combination that is most difficult to detect."""
    return combination_words(result.sensitivity.worst)


def change_in_use(result: CheckResult) -> str:
    """The largest change of a corrected force with its expanded uncertainty, or that in the recorded attitudes."""
    if result.change_g is None:
        seen = float(np.max(np.abs(result.sizes.excess)))
        return f"not determined; {seen * 1e3:.2g} mg in these attitudes"
    size, expanded = (each * 1e3 for each in result.change_g)
    places = decimals(expanded)
    return f"{with_decimals(size, places)} mg, U = {with_decimals(expanded, places)} mg (k = 2)"
