"""The population `use`: can a calibration be used? Whole instruments, measured, calibrated, diagnosed and corrected.

    python benchmarks/blind use --effects use --instruments 400 --seed 4107
    python benchmarks/blind use --effects all --instruments 100 --seed 83

Instruments of `in_use_instrument.py` (plain numpy), four plans, noise 0.1 mg, a room that warms by 2 to 6 degC.
`--effects`: `all` at their usual size; `mixed`, one of 8 to 20 sigma with four to six of 1 to 3; `faint`, the latter only;
`one`; `none`; `use`, a mixture of populations. Judged for `calibrate` and `diagnose`, at 60 new attitudes and three
temperatures: 95 % intervals of dK, bias, gamma and corrected readings, rms error after `apply`, and, for `use`, the share
of the errors of at most U.
"""

import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import polars as pl

import in_use_instrument as truth
from blind.conditions import write
from command_line import asked, counted, print_head, print_row
from in_process import ran


PLANS = ("cube", "3x8", "4x12", "two mountings")
SIGMA, GRAVITY_MS2, ATTITUDES = 1e-4, 9.8123, 60
# An effect with a smaller visible share would need a size beyond every usual one.
LEAST_SHARE = 0.05
# Shares of the populations of `use`, and effects of those that are not drawn from all.
MIXTURE = {"none": 0.3, "one": 0.35, "several": 0.15, "by pitch": 0.1, "warm-up": 0.1}
ONLY = {"by pitch": ["bias_by_pitch", "scale_by_pitch", "index_zero"], "warm-up": ["warm_up"]}
# Known pitch angles, if the positions cannot separate them from the sensor.
PRIORS = {"cube": ["--prior", "dbeta=5 arcmin"]}
SPANS = {"low": np.min, "mean": np.mean, "high": np.max}
COMMANDS = ("calibrate", "diagnose")
EFFECTS = ("all", "mixed", "faint", "one", "none", "use")
SENSOR = ("dK_x", "dK_y", "dK_z", "bias_x", "bias_y", "bias_z", "gamma_21", "gamma_31", "gamma_32")


@dataclass
class Drawn:
    """An instrument, its plan and its population."""

    number: int
    plan_name: str
    kind: str
    own: truth.Instrument
    plan: truth.Schedule
    rng: np.random.Generator

    @property
    def stem(self) -> str:
        """Name of its file."""
        return f"i{self.number:04d}"


@dataclass
class Judged:
    """The calibration of one command: `inside`, whether intervals contain the true value; `errors`, g (temperatures, attitudes,
    3); `expanded_g`, the stated U if it may be used."""

    drawn: Drawn
    command: str
    verdict: str = ""
    use: str = "no file"
    expanded_g: float = np.nan
    inside: dict[str, list[bool]] = field(default_factory=dict)
    u: np.ndarray = field(default_factory=lambda: np.full(9, np.nan))
    errors: np.ndarray | None = None


def drawn(number: int, seed: int, effects: str) -> Drawn:
    """The instrument of a number."""
    rng, name, kind = np.random.default_rng([seed, number]), PLANS[number % len(PLANS)], effects
    plan, turns = truth.schedule(name, rng)
    if effects in ("all", "none"):
        own = truth.instrument(plan, turns, rng, list(truth.SIZES) if effects == "all" else [])
        return Drawn(number, name, kind, own, plan, rng)
    own, wanted = truth.instrument(plan, turns, rng, []), [rng.uniform(8, 20)]
    if effects in ("mixed", "faint"):
        wanted = [*(wanted if effects == "mixed" else ()), *rng.uniform(1, 3, rng.integers(4, 7))]
    if effects == "use":
        kind = str(np.random.default_rng([seed, number, 58]).choice(list(MIXTURE), p=list(MIXTURE.values())))
        wanted = [*rng.uniform(4, 20, {"none": 0, "several": rng.integers(2, 4)}.get(kind, 1))]
    for id in rng.permutation(ONLY.get(kind, list(truth.SIZES))):
        alone = replace(own, effects=truth.instrument(plan, turns, rng, [id]).effects)
        visible, _ = truth.shown_share(alone, plan, SIGMA)
        whole = np.linalg.norm(truth.readings(alone, plan) - truth.readings(replace(alone, effects={}), plan)) / SIGMA
        if wanted and visible >= LEAST_SHARE * whole:
            own.effects[id] = alone.effects[id] * (wanted.pop(0) / visible)
    return Drawn(number, name, kind, own, plan, rng)


def write_positions(path: Path, plan: truth.Schedule, readings: np.ndarray) -> None:
    """A position file as a laboratory would write it."""
    angles = {f"{name}_deg": np.degrees(getattr(plan, name)).round(6) for name in ("alpha", "beta")}
    columns = {"position": np.array([f"p{k + 1}" for k in range(len(readings))])} | angles
    columns |= {f"a{axis}_g": values for axis, values in zip("xyz", readings.T, strict=True)}
    columns |= {"time_s": plan.time_s, "temperature_degc": plan.temperature_degc, "approach": plan.approach.astype(int)}
    write(path, columns | ({"mount": plan.mounting} if plan.mounting.max() else {}), f"# gravity_ms2: {GRAVITY_MS2}")


def run(*words: object) -> int:
    """Run a command in this process; its exit code. An error message is printed."""
    outcome = ran(words)
    if outcome.code == 2 or outcome.traceback:
        print(outcome.told.strip() or outcome.traceback, file=sys.stderr)
    return outcome.code or bool(outcome.traceback)


def in_frame(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`matrix = lower Q`: the lower triangular matrix of the triad's own frame, and Q."""
    q, r = np.linalg.qr(matrix.T)
    signs = np.sign(np.diag(r))
    return r.T * signs, (q * signs).T


def judged(folder: Path, one: Drawn, command: str) -> Judged:
    """The calibration of a command against the truth."""
    result, own, plan = Judged(one, command), one.own, one.plan
    file = folder / command / one.stem / "calibration.json"
    if not file.exists():
        return result
    content = json.loads(file.read_text())
    verdict = file.with_name("diagnosis.json")
    result.verdict = json.loads(verdict.read_text())["verdict"] if verdict.exists() else ""
    use = content.get("use", {})
    result.use = use.get("answer", "not stated")
    if result.use in ("yes", "within"):
        result.expanded_g = use["expanded_g"]
    at = content["provenance"].get("reference", {})
    degc = at.get("temperature_degc", float(np.mean(plan.temperature_degc)))
    matrix, bias = truth.linear(own, at.get("time_s", float(np.mean(plan.time_s))) - plan.time_s[0], degc)
    lower, to_frame = in_frame(matrix)
    unit = lower / np.diag(lower)[:, None]
    true = np.concatenate([np.diag(lower) - 1, bias, [unit[1, 0], unit[2, 0], unit[2, 1]]])
    part = content["parameters"]
    values, sds = np.array(part["values"]), np.sqrt(np.diag(np.array(part["covariance"])))
    here = [part["names"].index(name) for name in SENSOR]
    result.u = sds[here]
    for name, inside in zip(SENSOR, np.abs(values[here] - true) <= 1.96 * result.u, strict=True):
        result.inside.setdefault(name.split("_")[0], []).append(bool(inside))
    rng, since, errors = np.random.default_rng([one.number, 9]), float(np.mean(plan.time_s) - plan.time_s[0]), []
    for span, of in SPANS.items():
        force = rng.normal(size=(ATTITUDES, 3))
        force /= np.linalg.norm(force, axis=1, keepdims=True)
        warm = float(of(plan.temperature_degc))
        raw = truth.output(own, force, since, warm)
        found = applied(folder, file, raw, warm, float(np.mean(plan.time_s)))
        if found is None:
            return result
        errors.append(found - force @ to_frame.T)
        sd = reading_sd(content, raw)
        result.inside[f"corrected, {span}"] = (np.abs(errors[-1]) <= 1.96 * sd).ravel().tolist()
    result.errors = np.array(errors)
    return result


def reading_sd(content: dict, raw: np.ndarray) -> np.ndarray:
    """Standard uncertainty of corrected readings by the covariance of matrix and bias, g."""
    matrix, covariance = np.array(content["matrix"]), np.array(content["covariance"])
    slopes = np.zeros((len(raw), 3, 12))
    for axis in range(3):
        slopes[:, axis, 3 * axis : 3 * axis + 3] = raw - np.array(content["bias"])
    slopes[:, :, 9:] = -matrix
    return np.sqrt(np.einsum("nai,ij,naj->na", slopes, covariance, slopes))


def applied(folder: Path, calibration: Path, raw: np.ndarray, degc: float, time_s: float) -> np.ndarray | None:
    """Readings as `tumblecal apply` corrects them; None if it rejects them."""
    log, out = folder / "raw.csv", folder / "corrected.csv"
    rows = [f"{','.join(map(repr, row))},{degc!r},{time_s!r}" for row in raw.tolist()]
    log.write_text("\n".join(["ax_g,ay_g,az_g,temperature_degc,time_s", *rows]) + "\n")
    if run("apply", calibration, log, "--out", out, "--use-anyway"):
        return None
    return pl.read_csv(out, comment_prefix="#").select("ax_g", "ay_g", "az_g").to_numpy()


def report_intervals(results: Sequence[Judged]) -> None:
    """Intervals and errors, a column for each plan."""
    by_plan = {name: [own for own in results if own.drawn.plan_name == name] for name in PLANS}
    by_plan = {name: own for name, own in by_plan.items() if own}
    print_head("", *by_plan)

    def of_plans(label: str, cell: Callable[[list[Judged], list[Judged]], str]) -> None:
        """`cell` is given the results of `diagnose` and of `calibrate`."""
        cells = [
            cell(*([one for one in own if one.command == command] for command in COMMANDS[::-1]))
            for own in by_plan.values()
        ]
        print_row(label, *cells)

    def rms(own: list[Judged]) -> str:
        squares = [np.mean(one.errors**2) for one in own if one.errors is not None]
        if not squares:
            return "-"
        return f"{1e3 * np.sqrt(np.mean(squares)):.3f} ({1e3 * np.sqrt(np.quantile(squares, 0.9)):.3f})"

    of_plans(
        "instruments", lambda own, nominal: f"{len(own)} ({sum(one.use == 'no file' for one in own)} without a file)"
    )
    of_plans("verdicts", lambda own, nominal: counted(one.verdict for one in own if one.verdict))
    of_plans("use", lambda own, nominal: counted(one.use for one in own))
    for name in ("dK", "bias", "gamma", *(f"corrected, {span}" for span in SPANS)):
        of_plans(
            f"95 % intervals, {name}",
            lambda own, nominal, name=name: f"{np.mean([i for one in own for i in one.inside.get(name, [])]):.1%}",
        )
    of_plans(
        "median u / u of `calibrate`",
        lambda own, nominal: f"{np.nanmedian([a.u / b.u for a, b in zip(own, nominal, strict=True)]):.2f}",
    )
    of_plans("apply / mg rms (90th percentile)", lambda own, nominal: rms(own))
    of_plans("apply, calibrate alone / mg rms (90th percentile)", lambda own, nominal: rms(nominal))


def report_use(results: Sequence[Judged]) -> None:
    """Errors over U of the calibrations that may be used, a row for each command and population."""
    print()
    print_head(
        "command",
        "population",
        "instruments",
        "`use`",
        "error at most U",
        "worst instrument",
        "rms error / U",
        "median U / mg",
    )
    kinds = list(dict.fromkeys(own.drawn.kind for own in results))
    for command in COMMANDS:
        for kind in (*kinds, "all") if len(kinds) > 1 else kinds:
            own = [one for one in results if one.command == command and kind in (one.drawn.kind, "all")]
            ratios = np.array(
                [np.abs(one.errors) / one.expanded_g for one in own if one.errors is not None and one.expanded_g > 0]
            )
            cells = ["-"] * 4
            if len(ratios):
                worst = np.mean(ratios <= 1, axis=(1, 2, 3)).min()
                cells = [f"{np.mean(ratios <= 1):.1%}", f"{worst:.0%}", f"{np.sqrt(np.mean(ratios**2)):.2f}"]
                cells.append(f"{1e3 * np.nanmedian([one.expanded_g for one in own]):.2f}")
            print_row(f"`{command}`", kind, len(own), counted(one.use for one in own), *cells)


def main(words: Sequence[str]) -> None:
    """Draw, measure, calibrate, diagnose, judge; print both tables."""
    given = asked(__doc__, words, instruments=200, seed=71, effects="all")
    if given.effects not in EFFECTS:
        raise SystemExit(f"--effects: one of {', '.join(EFFECTS)}")
    with tempfile.TemporaryDirectory() as temporary:
        folder, everything = Path(temporary), [drawn(k, given.seed, given.effects) for k in range(given.instruments)]
        for one in everything:
            clean = truth.readings(one.own, one.plan)
            noise = SIGMA * one.rng.normal(size=clean.shape)
            write_positions(folder / f"{one.stem}.csv", one.plan, clean + noise)
        for plan in PLANS:
            files = [folder / f"{one.stem}.csv" for one in everything if one.plan_name == plan]
            for command in COMMANDS if files else ():
                options = [*PRIORS.get(plan, []), "--noise-sd", "0.1mg", "--no-figures"]
                # The results of a single file are in the folder itself.
                out = folder / command if len(files) > 1 else folder / command / files[0].stem
                run(command, *files, *options, "--out", out)
        results = [judged(folder, one, command) for one in everything for command in COMMANDS]
    report_intervals(results)
    report_use(results)
