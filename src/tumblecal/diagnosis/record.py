"""`diagnosis.json`: a diagnosis in numbers (DESIGN section 6)."""

from collections.abc import Iterable
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator

from tumblecal.data.calibration_file import GravityOrNone
from tumblecal.data.calibration_use import Use
from tumblecal.data.source_of import Digest
from tumblecal.diagnosis.coefficients import Coefficient, coefficients, temperature_orders
from tumblecal.diagnosis.detection.detect import Detection
from tumblecal.diagnosis.diagnosis import Diagnosis, Shift
from tumblecal.diagnosis.findings.gain import Gain
from tumblecal.diagnosis.findings.limits import DetectionLimit, Invisible, Unseen
from tumblecal.diagnosis.findings.location import Located
from tumblecal.diagnosis.findings.residuals import Check, Harmonic
from tumblecal.estimation.mean_noise import MeanNoiseRecord
from tumblecal.estimation.mountings import Mountings
from tumblecal.estimation.plausibility import Implausible
from tumblecal.estimation.setup.error import SetupErrorRecord
from tumblecal.ground.record import OR_NULL, Estimate, ResultRecord, TextOrNull, at


_LEAST_PROBABLE, _MOST_EXPLANATIONS = 1e-4, 10


def _named(sets: Iterable[tuple[str, ...]]) -> list[list[str]]:
    return [[label.replace(":", " at ", 1) for label in labels] for labels in sets]


Sets = Annotated[list[list[str]], BeforeValidator(_named)]
Thousandths = Annotated[list[float], BeforeValidator(lambda sizes: [1e3 * size for size in sizes])]


class CoefficientRecord(Estimate):
    """A coefficient of a cause."""

    determined: bool


class ExplanationRecord(ResultRecord):
    """`Explanation`; `positions`: of each effect in a part of the data."""

    effects: list[str]
    positions: dict[str, list[str]]
    equivalents: Sets
    identical_at_1_g: Sets = at("identical")
    supersets: Sets
    less_simple: Annotated[Sets, BeforeValidator(lambda pairs: [labels for labels, _ in pairs])] = at("less_probable")
    probability: float
    class_probability: float
    chosen: bool
    coefficients: dict[str, CoefficientRecord]
    combinations: list[Coefficient]
    temperature_orders: dict[str, int]


class TermRecord(ResultRecord):
    """A term of a law."""

    acts_on: str
    words: list[str] = at("form.words")
    coefficients: Thousandths = at("sizes")
    u: Thousandths = at("sd")
    unit: str


class LawRecord(ResultRecord):
    """`Law`."""

    terms: list[TermRecord]
    held_out_before_g: float = at("before_g")
    held_out_after_g: float = at("after_g")
    same_in_folds: float = at("same")


class ExcessRecord(ResultRecord):
    """Where an unexplained error is, its range on each output, and its candidate law."""

    region: TextOrNull = at("excess.region")
    positions: list[str]
    ranges_g: Annotated[
        dict[str, tuple[float, float]], BeforeValidator(lambda ranges: {axis: ends for axis, *ends in ranges})
    ] = at("excess.ranges")
    law: LawRecord | None


class ParameterRecord(ResultRecord):
    """A parameter of the calibration file, base units: value, standard uncertainty `u` (null if no position in the fit depends
    on it) and its contributions, which add in quadrature."""

    value: float
    u: float | None
    unit: str
    noise: float
    explanations: float
    undetected_effects: float


class DiagnosisRecord(ResultRecord):
    """A `Diagnosis` with its verdict in words; coefficients as shown, the rest in g and rad."""

    schema_: Literal["tumblecal.diagnosis/1"] = "tumblecal.diagnosis/1"
    source: str = at("data.source")
    sha256: Digest = at("data.source")
    gravity: GravityOrNone = at("data.gravity")
    verdict: str
    causes: list[str] = at("labels")
    set_up: list[SetupErrorRecord] = at("setup_errors")
    implausible: list[Implausible]
    detection: Detection = at("screened.detection")
    noise_model: TextOrNull = at("noise_words")
    noise_rivals: dict[str, str]
    assumed_noise_p_value: float = at("assumed_p_value")
    mountings: Annotated[Mountings | None, OR_NULL]
    samples: MeanNoiseRecord | None
    sigma_g: float
    explanations: list[ExplanationRecord]
    located: list[Located]
    unexplained: TextOrNull
    excess: ExcessRecord | None = at("unnamed")
    gain: Gain
    shifts: dict[str, Shift]
    detection_limits: dict[str, DetectionLimit] = at("limits")
    invisible: dict[str, Invisible]
    parameters: dict[str, ParameterRecord]
    unseen: dict[str, Unseen]
    not_testable: dict[str, str] = at("model.not_testable")
    harmonics: list[Harmonic]
    predictive_checks: list[Check] = at("checks")
    predictive_checks_after: list[Check] = at("checks_after")
    use: Use
    text: str

    @classmethod
    def of(cls, result: Diagnosis, **more: Any) -> Self:  # type: ignore[override]
        """The record of a diagnosis; `more`: `use`, and `text`, the verdict."""
        return super().of(
            result,
            noise_rivals={label: fault.alternative for label, fault in result.noise_wrong.items() if fault.alternative},
            explanations=_explanations(result),
            unexplained="; ".join(result.unexplained_terms),
            parameters=_parameters(result),
            **more,
        )


def _parameters(diagnosis: Diagnosis) -> dict[str, ParameterRecord]:
    """Each parameter that is not of one position."""
    used, model = diagnosis.in_use, diagnosis.model
    sd, parts = used.sd, used.parts
    return {
        name: ParameterRecord(
            value=used.values[k],
            u=None if used.idle[k] else sd[k],
            unit=model.units[k],
            **{part: sizes[k] for part, sizes in parts.items()},
        )
        for k, name in enumerate(model.names)
        if not model.layout.of_positions[k]
    }


def _explanations(diagnosis: Diagnosis) -> list[ExplanationRecord]:
    """Those with the largest probabilities, the one acted on first."""
    of_data = dict.fromkeys(setup_error.label for setup_error in diagnosis.setup_errors)
    listed = []
    for one in diagnosis.leading(_LEAST_PROBABLE, _MOST_EXPLANATIONS):
        chosen = one is diagnosis.best
        members = diagnosis.members if chosen else ()
        effects = [label.partition(":")[0] for label in one.labels]
        noise = (label for label in diagnosis.noise_labels if label not in effects)
        positions = dict[str, list[str]]()
        for id, _, names in (label.partition(":") for label in one.labels if ":" in label):
            positions.setdefault(id, []).extend(names.split("+"))
        sizes = [size for cause in members for size in coefficients(diagnosis, cause)]
        record = ExplanationRecord.of(
            one,
            effects=[*of_data, *noise, *effects],
            positions=positions,
            chosen=chosen,
            coefficients={name: size for size in sizes for name in size.weights if len(size.weights) == 1},
            combinations=[size for size in sizes if len(size.weights) > 1],
            temperature_orders=temperature_orders(members),
        )
        listed.append(record)
    return sorted(listed, key=lambda one: not one.chosen)
