"""Judgements of calibrate or diagnose that a certificate must include, or that prevent a certificate."""

from pathlib import Path

from tumblecal.data.calibration import Calibration
from tumblecal.data.result_records import result_of
from tumblecal.ground.errors import InputError


def reservation(folder: Path, calibration: Calibration, *, use_anyway: bool = False) -> str:
    """Reservations about the calibration of a folder, in words for its certificate; "" if there are none.

    **Arguments:**

    - `use_anyway`: whether to accept values that must not be used, or whose model nothing could test.

    **Raises:** `InputError` for such values, because a certificate would mislead its users; and for a judgement of different
    data.
    """
    use = calibration.use
    use.require(folder / "calibration.json", anyway=use_anyway, tested=True)
    if (found := result_of(folder / "calibration.json", calibration)) is None:
        return ""
    path, result = found
    judged = result.judgement
    headline = "" if judged.tone == "good" else judged.headline
    if judged.refused and not use_anyway:
        raise InputError(f"{path}: judgement: {judged.headline} No certificate is written; {judged.advice}")
    words = [f"Judgement of the calibration: {headline}"] if headline else []
    if use.refused or use.untested:
        words.append("Issued with the option --use-anyway. U is not valid if the model is wrong.")
    if use.answer not in ("yes", "within"):
        words.append(f"Use of the calibration: {use.words}.")
    return " ".join(words)


def head_covariance(calibration: Calibration) -> bool:
    """Whether the covariance of the calibration includes that of the measured errors of the head."""
    head = calibration.provenance.get("head")
    return isinstance(head, dict) and not head.get("exact")


def head_words(calibration: Calibration) -> str:
    """The measured errors of the head in the fit, in words; "" if there are none."""
    head = calibration.provenance.get("head")
    if not isinstance(head, dict):
        return ""
    names = ", ".join(map(str, head.get("parameters") or []))
    file = f" ({head['file']}, SHA-256 {head.get('sha256')})" if head.get("file") else ""
    treatment = "with their stated covariance" if head_covariance(calibration) else "treated as exact"
    return f"the fit includes measured errors of the dividing head{file}, {treatment}: {names}"
