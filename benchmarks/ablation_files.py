"""The files of `ablation.py`, diagnosed and judged: single files of three simulators, and batches of units."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import blind_units
from ablation_aimed import AIMED
from blind_judge import UNEXPLAINED, right, stated, sure, with_unexplained
from simulated_files import SIMULATORS, Labels, Simulated
from tumblecal.data import PositionSet, read_positions
from tumblecal.diagnosis import Diagnoser, Diagnosis
from tumblecal.diagnosis.units import JointDiagnosis, joint_diagnosis
from tumblecal.ground.errors import InputError


# Of these no set of names is expected.
_NOT_JUDGED = ("one with small ones",)
_UNITS = 8


@dataclass(frozen=True)
class Answer:
    """What is compared: verdict and leading names (`said`), the class, and how they are judged."""

    verdict: str
    said: Labels
    members: int
    probability: float
    right: bool
    identified: bool
    wrong_sure: bool


@dataclass
class File:
    """One file of a simulator; `plan`: files of one plan share compiled programs."""

    simulated: Simulated
    data: PositionSet
    diagnosers: dict[object, Diagnoser] = field(repr=False)

    @property
    def key(self) -> str:
        """Its name in the journal."""
        return self.simulated.name

    @property
    def plan(self) -> tuple:
        """What its compiled programs depend on, about."""
        data = self.data
        columns = [
            name
            for name in ("sd", "time_s", "temperature_degc", "approach", "run", "mount")
            if getattr(data, name) is not None
        ]
        return len(data), tuple(sorted(set(data.beta_deg.tolist()))), tuple(columns[1:])

    def answer(self) -> tuple[Answer, float]:
        """Diagnose; the answer and the seconds of CPU."""
        new = self.plan not in self.diagnosers
        diagnoser = self.diagnosers.setdefault(self.plan, Diagnoser(nested=False))
        if new:
            # The first diagnosis of a plan compiles.
            _diagnosed(diagnoser, self.data)
        started = time.process_time()
        diagnosis = _diagnosed(diagnoser, self.data)
        seconds = time.process_time() - started
        return _judged(diagnosis, self.simulated), seconds


def _diagnosed(diagnoser: Diagnoser, data: PositionSet) -> Diagnosis | str:
    try:
        return diagnoser(data)
    except InputError as fault:
        return fault.faults[0]


def _judged(diagnosis: Diagnosis | str, simulated: Simulated) -> Answer:
    """Judged as in `second_study.py` and, for set-up errors, as in `blind_stress.py`: a refusal in words is right for these."""
    if isinstance(diagnosis, str):
        return Answer("refused", (), 0, 0.0, "mistake" in simulated.kind, False, False)
    best, said = diagnosis.best, tuple(sorted(diagnosis.labels))
    ids = {fault.label for fault in diagnosis.setup_errors}
    stories = [ids, *(ids - {fault.label} | {other} for fault in diagnosis.setup_errors for other, _ in fault.equal)]
    named = {tuple(sorted({*said} - ids | own)) for own in stories}
    ok = [truth for truth in simulated.accepted if _is_right(diagnosis, truth, named)]
    meant = [truth for truth in ok if truth in named or _is_meant(diagnosis, truth)]
    return Answer(
        diagnosis.verdict,
        said,
        1 + len(best.equivalents),
        best.probability,
        bool(ok),
        bool(meant) and diagnosis.verdict == "identified",
        sure(best) and UNEXPLAINED not in best.labels and not meant,
    )


def _is_right(diagnosis: Diagnosis, truth: Labels, named: set[Labels]) -> bool:
    best, noise = diagnosis.best, diagnosis.noise_labels
    if not truth:
        return diagnosis.verdict == "adequate"
    if truth == (UNEXPLAINED,):
        return with_unexplained(best, noise)
    if rest := _without_noise(truth):
        # An effect that is named right is right, whether its noise is found or not.
        noise = [label for label in noise if label not in truth]
    return truth in named or (not diagnosis.setup_errors and bool(rest) and right(best, rest, noise))


def _is_meant(diagnosis: Diagnosis, truth: Labels) -> bool:
    """Whether a right answer is also the statement of which the probability is given."""
    rest = _without_noise(truth)
    return rest != truth or truth in ((), (UNEXPLAINED,)) or stated(diagnosis.best, truth)


def _without_noise(truth: Labels) -> Labels:
    return tuple(label for label in truth if not label.startswith("noise_"))


@dataclass
class Units:
    """A batch of units on one head, screened once. An error of the head is right where it is shared, or has two levels."""

    kind: str
    number: int
    seed: int
    diagnosers: dict[object, Diagnoser] = field(repr=False)

    @property
    def key(self) -> str:
        """Its name in the journal."""
        return f"units, {self.kind}, {self.number}"

    def answer(self) -> tuple[Answer, float]:
        """Take the units together; the answer and the seconds of CPU of that alone."""
        sets, names, levels = self._made()
        diagnoser = self.diagnosers.setdefault("units", Diagnoser(nested=False))
        screened = [diagnoser.begun(data).screened for data in sets]
        started = time.process_time()
        found = joint_diagnosis(screened, [""] * len(sets))
        seconds = time.process_time() - started
        best = found.joint.best.shared
        of_levels = tuple(sorted(level.signal.label for level in found.levels))
        ok = of_levels == names if levels else best.labels == names or names in best.equivalents
        said = (*best.labels, *(f"{label} (two levels)" for label in of_levels))
        return Answer(found.verdict, said, 1 + len(best.equivalents), _probability(found), ok, False, False), seconds

    def _made(self) -> tuple[list[PositionSet], Labels, bool]:
        rng = np.random.default_rng([self.seed, self.number, list(UNIT_KINDS).index(self.kind)])
        condition = UNIT_KINDS[self.kind]
        sets, name = blind_units.batch(condition, rng)
        return sets, () if name is None else (name,), "set up again" in self.kind


def _probability(found: JointDiagnosis) -> float:
    return float(found.joint.best.probability)


def _set_up_again(d: float, first: int):
    """An error of the head that is another from some unit on."""

    def hide(rng, setups):
        name, coefficients = blind_units.drawn(rng, setups[0], blind_units.HEAD, d)
        return [
            {name: blind_units.scaled(name, coefficients, 1.0 if k < first else -1.0)} for k in range(len(setups))
        ], name

    return hide


UNIT_KINDS = {f"head set up again, d = {d}": blind_units.Condition(_UNITS, _set_up_again(d, 4)) for d in (4, 8, 30)}
UNIT_KINDS |= {
    title: blind_units.KINDS[title]
    for title in ("8 units, d = 3.5", "8 units, nothing", "8 units, a sensor's effect of 8 times 0.3 to 1.7")
}


def files_of(
    seed: int, number: int, folder: Path, diagnosers: dict[object, Diagnoser], texts: Sequence[str] = ()
) -> list[File]:
    """One file of each kind of each simulator, those of one plan together; `texts`: only of kinds that have one of these."""
    files = []
    # Kinds made for one rule only where they are asked for.
    simulators = SIMULATORS | ({"aimed": AIMED} if texts else {})
    for kinds in simulators.values():
        for kind, drawn in kinds.items():
            if kind not in _NOT_JUDGED and (not texts or any(text in kind for text in texts)):
                simulated = drawn(seed, number)
                path = folder / f"{simulated.name}.csv"
                simulated.write(path)
                try:
                    files.append(File(simulated, read_positions(path, check_size=False), diagnosers))
                except InputError:
                    # Refused by the reader in any case.
                    continue
    return sorted(files, key=lambda own: (str(own.plan), own.key))
