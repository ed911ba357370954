"""An effect that acts everywhere, at one pitch setting, or in the second half of the measurement.

`right`: the effect is the first of `located`, or, everywhere, it is named and nothing is located. The size is that after
the cut.
"""

import numpy as np

import blind_instrument as blind
from blind_noise import PLANS


# An effect with a smaller visible share is hidden by the cut.
LEAST_SHARE = 0.2
# The others are by setting or by time themselves.
NAMES = [name for name in blind.COEFFICIENTS if name not in ("warm_up", "gravity_value") and "drift" not in name]


def case(rng: np.random.Generator, plan: str, part: str, d: float) -> tuple[blind.Setup, np.ndarray, str]:
    """Setup, readings and the hidden effect."""
    while True:
        setup = blind.random_setup(rng, *PLANS[plan])
        count, projector = len(setup.alpha), blind.unreachable(setup)
        name = NAMES[rng.integers(len(NAMES))]
        drawn = blind.sized(setup, projector, name, d, rng)
        if drawn is None:
            continue
        here = {
            "everywhere": np.ones(count, bool),
            "one setting": setup.pitch == rng.integers(setup.pitch.max() + 1),
            "second half": np.arange(count) >= count // 2,
        }[part]
        plain = blind.readings(setup, setup.nominal, {})
        signal = (blind.readings(setup, setup.nominal, {name: drawn[0]}) - plain) * here[:, None] / blind.SIGMA
        visible = np.linalg.norm(projector @ signal.ravel())
        if visible > LEAST_SHARE * np.linalg.norm(signal):
            return setup, plain + blind.SIGMA * (signal * d / visible + rng.normal(size=signal.shape)), name


def judged(diagnosis, name: str, part: str) -> str:
    """The result of a case in a word."""
    located = [found.effect for found in diagnosis.located]
    named = (name,) in (diagnosis.best.labels, *diagnosis.best.equivalents)
    if part == "everywhere":
        return "wrong part" if located else "right" if named else "not named"
    sure = diagnosis.verdict == "identified" and diagnosis.best.probability > 0.9 and diagnosis.members
    if not located and sure:
        return "right effect everywhere" if named else "wrong and sure"
    return "right" if located[:1] == [name] else "among those told" if name in located else "else"
