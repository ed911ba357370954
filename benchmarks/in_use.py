"""Can a calibration be used? Whole instruments with every effect at once, measured, diagnosed, applied and exported.

    python benchmarks/in_use.py --instruments 200 --seed 71
    python benchmarks/in_use.py --instruments 200 --seed 72 --effects mixed

Each instrument (`in_use_instrument.py`, plain numpy, nothing of the program) is measured by one of four plans with 0.1 mg
noise while the room warms by some degrees, then diagnosed and corrected through the command line, and corrected once more by
the formula of each device (`device_formulas.py`). Judged at 60 attitudes that took no part, at the lowest, the mean and the
highest temperature of the measurement: coverage of the 95 % intervals of dK, bias, gamma and of the corrected readings, and
the rms error in mg. `--effects`: `all` effects at their usual size; `mixed`, one of 8 to 20 sigma with four to six of 1 to 3;
`one`, a single one of 8 to 20 sigma; `none`.

    python benchmarks/in_use.py --effects use --instruments 400 --seed 5801

judges the statement `use` of `calibrate` and of `diagnose` (without the devices): no effect (30 %), one of 4 to 20 sigma
(35 %), two or three (15 %), one that differs between pitch settings (10 %), a warm-up (10 %). For all calibrations that may
be used: share of the components of corrected readings with an error of at most U.
"""

import argparse
import contextlib
import csv
import io
import json
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import device_formulas
import in_use_instrument as truth
from tumblecal.cli import commands


PLANS = ("cube", "3x8", "4x12", "two mountings")
SIGMA = 1e-4  # g
GRAVITY_MS2 = 9.8123
ATTITUDES = 60
SPANS = ("low", "mean", "high")
# The effects that these positions show at all are drawn by size; one that they hardly show would be beyond every typical size.
LEAST_SHARE = 0.05
# Populations of `--effects use`, with their probabilities.
USE_KINDS = {"none": 0.3, "one": 0.35, "several": 0.15, "by pitch": 0.1, "warm-up": 0.1}
USABLE = ("yes", "within")
# What the laboratory knows of the pitch angles where the positions cannot tell them from the sensor.
PRIORS = {"cube": ["--prior", "dbeta=5 arcmin"]}
SENSOR = ("dK", "bias", "gamma")


def drawn(number: int, seed: int, effects: str) -> tuple[str, truth.Instrument, truth.Schedule, np.random.Generator]:
    """The instrument of a number: its plan's name, itself, and what is measured."""
    rng = np.random.default_rng([seed, number])
    name = PLANS[number % len(PLANS)]
    plan, turns = truth.schedule(name, rng)
    if effects in ("all", "none"):
        return name, truth.instrument(plan, turns, rng, list(truth.SIZES) if effects == "all" else []), plan, rng
    instrument, wanted = truth.instrument(plan, turns, rng, []), [rng.uniform(8, 20)]
    wanted += [*rng.uniform(1, 3, rng.integers(4, 7))] if effects == "mixed" else []
    listed = list(truth.SIZES)
    if effects == "use":
        kind = use_kind(number, seed)
        count = {"none": 0, "several": rng.integers(2, 4)}.get(kind, 1)
        wanted = [*rng.uniform(4, 20, count)]
        listed = {"by pitch": ["bias_by_pitch", "scale_by_pitch", "index_zero"], "warm-up": ["warm_up"]}.get(
            kind, listed
        )
    for id in rng.permutation(listed):
        alone = replace(instrument, effects=truth.instrument(plan, turns, rng, [id]).effects)
        shown, _ = truth.shown_share(alone, plan, SIGMA)
        whole = np.linalg.norm(truth.readings(alone, plan) - truth.readings(replace(alone, effects={}), plan)) / SIGMA
        if shown < LEAST_SHARE * whole or not wanted:
            continue
        instrument.effects[id] = alone.effects[id] * (wanted.pop(0) / shown)
    return name, instrument, plan, rng


def use_kind(number: int, seed: int) -> str:
    """The population of an instrument of `--effects use`."""
    return str(np.random.default_rng([seed, number, 58]).choice(list(USE_KINDS), p=list(USE_KINDS.values())))


def write_positions(path: Path, plan: truth.Schedule, readings: np.ndarray) -> None:
    """A position file as a laboratory would write it."""
    mounted = plan.mounting.max() > 0
    header = ["position", "alpha_deg", "beta_deg", "ax_g", "ay_g", "az_g", "time_s", "temperature_degc", "approach"]
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        file.write(f"# gravity_ms2: {GRAVITY_MS2}\n")
        writer.writerow([*header, *(["mount"] if mounted else [])])
        for k, row in enumerate(readings):
            angles = np.degrees(plan.alpha[k]).round(6), np.degrees(plan.beta[k]).round(6)
            conditions = plan.time_s[k], plan.temperature_degc[k], int(plan.approach[k])
            writer.writerow([f"p{k + 1}", *angles, *row, *conditions, *([plan.mounting[k]] if mounted else [])])


def command(*words: object) -> tuple[int, str]:
    """Run the command line in this process: exit code, and all that was printed."""
    told, arguments = io.StringIO(), sys.argv
    sys.argv = ["tumblecal", *map(str, words)]
    try:
        with contextlib.redirect_stdout(told), contextlib.redirect_stderr(told):
            return commands.run(), told.getvalue()
    finally:
        sys.argv = arguments


def in_frame(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`matrix = lower Q`: the triad's lower triangular matrix in its own frame, and what turns forces into that frame."""
    q, r = np.linalg.qr(matrix.T)
    signs = np.sign(np.diag(r))
    return (r.T * signs), (q * signs).T


class Judged:
    """What is counted of one plan."""

    def __init__(self):
        self.verdicts, self.use = defaultdict(int), defaultdict(int)
        self.covered, self.widths = defaultdict(list), []
        self.errors: dict[str, list[float]] = defaultdict(list)
        self.without = 0

    def parameters(self, content: dict, nominal: dict, instrument: truth.Instrument, since: float, degc: float) -> None:
        """Compare dK, bias and gamma with the truth at the stated reference."""
        lower, _ = in_frame(truth.linear(instrument, since, degc)[0])
        scale = np.diag(lower)
        triad = lower / scale[:, None]
        values = dict(zip(("dK_x", "dK_y", "dK_z"), scale - 1, strict=True))
        bias = truth.linear(instrument, since, degc)[1]
        values |= dict(zip(("bias_x", "bias_y", "bias_z"), bias, strict=True))
        values |= {"gamma_21": triad[1, 0], "gamma_31": triad[2, 0], "gamma_32": triad[2, 1]}
        own, alone = (_parameters(file) for file in (content, nominal))
        for name, true in values.items():
            value, sd = own[name]
            self.covered[name.split("_")[0]].append(abs(value - true) <= 1.96 * sd)
            self.widths.append(sd / alone[name][1])

    def corrected(self, content: dict, raw: np.ndarray, force: np.ndarray, found: np.ndarray, span: str) -> None:
        """Compare corrected readings with the true force, and their error with the covariance of matrix and bias."""
        matrix, covariance = np.array(content["matrix"]), np.array(content["covariance"])
        less = raw - np.array(content["bias"])
        for axis in range(3):
            slopes = np.zeros((len(raw), 12))
            slopes[:, 3 * axis : 3 * axis + 3] = less
            slopes[:, 9:] = -matrix[axis]
            sd = np.sqrt(np.einsum("ni,ij,nj->n", slopes, covariance, slopes))
            self.covered[f"corrected, {span}"] += (np.abs(found - force)[:, axis] <= 1.96 * sd).tolist()


def _parameters(content: dict) -> dict[str, tuple[float, float]]:
    part = content["parameters"]
    sds = np.sqrt(np.diag(np.array(part["covariance"])))
    return {name: (value, sd) for name, value, sd in zip(part["names"], part["values"], sds, strict=True)}


def held_out(instrument: truth.Instrument, plan: truth.Schedule, rng: np.random.Generator) -> Iterator[tuple]:
    """For the lowest, mean and highest temperature: its name, forces (triad's mechanical frame), raw readings, degC."""
    since = float(np.mean(plan.time_s) - plan.time_s[0])
    temperatures = np.min(plan.temperature_degc), np.mean(plan.temperature_degc), np.max(plan.temperature_degc)
    for span, degc in zip(SPANS, temperatures, strict=True):
        force = rng.normal(size=(ATTITUDES, 3))
        force /= np.linalg.norm(force, axis=1, keepdims=True)
        yield span, force, truth.output(instrument, force, since, degc), float(degc)


def judge_use(
    folder: Path, stem: str, own: truth.Instrument, plan: truth.Schedule, counts: dict, population: str, rng
) -> None:
    """Errors of corrected readings in units of the stated U, for calibrations that may be used."""
    stated = {}
    for kind in ("nominal", "diagnosis"):
        file = folder / kind / stem / "calibration.json"
        use = json.loads(file.read_text())["use"] if file.exists() else {"answer": "no file"}
        counts[kind, population]["answers"].append(use["answer"])
        if use["answer"] in USABLE:
            stated[kind] = file, use["expanded_g"]
    _, to_frame = in_frame(
        truth.linear(own, float(np.mean(plan.time_s) - plan.time_s[0]), np.mean(plan.temperature_degc))[0]
    )
    for _, force, raw, warm in held_out(own, plan, rng):
        force = force @ to_frame.T
        for kind, (file, expanded) in stated.items():
            found = applied(folder, file, raw, warm, float(np.mean(plan.time_s)))
            if found is not None:
                counts[kind, population]["errors"].append(np.abs(found - force) / expanded)
                counts[kind, population]["U"].append(expanded)


def report_use(counts: dict) -> None:
    """Print a row for each command and population."""
    print(
        "| command | population | instruments | use | error <= U | worst instrument | rms error / U | median U / mg |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for kind, name in (("nominal", "calibrate"), ("diagnosis", "diagnose")):
        rows = {population: counts[kind, population] for population in USE_KINDS}
        rows["all"] = {key: [each for row in rows.values() for each in row[key]] for key in ("answers", "errors", "U")}
        for population, row in rows.items():
            answers = ", ".join(f"{row['answers'].count(answer)} {answer}" for answer in sorted({*row["answers"]}))
            cells = ["-"] * 4
            if row["errors"]:
                ratios = np.array(row["errors"])
                within = np.mean(ratios.reshape(-1, len(SPANS), ATTITUDES, 3) <= 1, axis=(1, 2, 3))
                cells = [f"{np.mean(ratios <= 1):.1%}", f"{np.min(within):.0%}", f"{np.sqrt(np.mean(ratios**2)):.2f}"]
                cells.append(f"{1e3 * np.median(row['U']):.2f}")
            print("|", " | ".join([name, population, f"{len(row['answers'])}", answers, *cells]), "|")


def judge(folder: Path, stem: str, own: truth.Instrument, plan: truth.Schedule, counts: Judged, rng) -> None:
    """Apply and export the calibration of one instrument, and compare."""
    file = folder / "diagnosis" / stem / "calibration.json"
    diagnosis = folder / "diagnosis" / stem / "diagnosis.json"
    if not file.exists() or not diagnosis.exists():
        counts.without += 1
        return
    content, nominal = (
        json.loads((folder / kind / stem / "calibration.json").read_text()) for kind in ("diagnosis", "nominal")
    )
    counts.verdicts[json.loads(diagnosis.read_text())["verdict"]] += 1
    counts.use[content.get("use", {}).get("answer", "not stated")] += 1
    at = content["provenance"].get("reference", {})
    degc = at.get("temperature_degc", float(np.mean(plan.temperature_degc)))
    since = at.get("time_s", float(np.mean(plan.time_s))) - plan.time_s[0]
    counts.parameters(content, nominal, own, since, degc)
    _, to_frame = in_frame(truth.linear(own, since, degc)[0])
    low, high = np.floor(plan.temperature_degc.min()), np.ceil(plan.temperature_degc.max())
    exported = {}
    for target in device_formulas.FORMULAS:
        out = folder / f"{target}.txt"
        words = ["export", file, "--to", target, "--out", out, "--temperatures", f"{low:g}:{high:g}", "--use-anyway"]
        code, _ = command(*words)
        if code == 0:
            exported[target] = out.read_text()
        else:
            counts.errors[f"{target} refused"].append(1.0)
    for span, force, raw, warm in held_out(own, plan, rng):
        force = force @ to_frame.T
        for kind, name in (("diagnosis", "apply"), ("nominal", "apply, calibrate alone")):
            found = applied(folder, folder / kind / stem / "calibration.json", raw, warm, float(np.mean(plan.time_s)))
            if found is None:
                counts.errors[f"{name} refused"].append(1.0)
                continue
            if kind == "diagnosis":
                counts.corrected(content, raw, force, found, span)
                counts.errors[f"apply, {span}"].append(float(np.mean((found - force) ** 2)))
            counts.errors[name].append(float(np.mean((found - force) ** 2)))
        for target, text in exported.items():
            found = device_formulas.applied(target, text, raw, warm, GRAVITY_MS2)
            counts.errors[target].append(float(np.mean((found - force) ** 2)))


def applied(folder: Path, calibration: Path, raw: np.ndarray, degc: float, time_s: float) -> np.ndarray | None:
    """Readings as `tumblecal apply` corrects them; None where it refuses them."""
    log, out = folder / "raw.csv", folder / "corrected.csv"
    rows = [f"{','.join(map(repr, row))},{degc!r},{time_s!r}" for row in raw.tolist()]
    log.write_text("\n".join(["ax_g,ay_g,az_g,temperature_degc,time_s", *rows]) + "\n")
    code, told = command("apply", calibration, log, "--out", out, "--use-anyway")
    if code:
        print(f"apply {calibration.parent.name}: {told.strip()}", file=sys.stderr)
        return None
    with out.open() as file:
        lines = [line for line in file if not line.startswith("#")]
    table = list(csv.DictReader(lines))
    names = [next(name for name in table[0] if name.startswith(f"a{axis}_")) for axis in "xyz"]
    return np.array([[float(row[name]) for name in names] for row in table])


def main() -> None:
    """Draw, measure, diagnose, judge; print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instruments", type=int, default=200)
    parser.add_argument("--seed", type=int, default=71)
    parser.add_argument("--effects", choices=("all", "mixed", "one", "none", "use"), default="all")
    args = parser.parse_args()
    judged: dict[str, Judged] = {name: Judged() for name in PLANS}
    with tempfile.TemporaryDirectory() as temporary:
        folder, cases = Path(temporary), {}
        for number in range(args.instruments):
            name, own, plan, rng = drawn(number, args.seed, args.effects)
            clean = truth.readings(own, plan)
            stem = f"i{number:04d}"
            write_positions(folder / f"{stem}.csv", plan, clean + SIGMA * rng.normal(size=clean.shape))
            cases[stem] = name, own, plan, rng
        for plan_name in PLANS:
            files = [folder / f"{stem}.csv" for stem, case in cases.items() if case[0] == plan_name]
            for kind, words in (("diagnosis", ["diagnose"]), ("nominal", ["calibrate"])):
                words += PRIORS.get(plan_name, [])
                code, told = command(*words, *files, "--noise-sd", "0.1mg", "--out", folder / kind, "--no-figures")
                if code == 2:
                    print(told.strip(), file=sys.stderr)
        counts = defaultdict(lambda: defaultdict(list))
        for number, (stem, (name, own, plan, rng)) in enumerate(cases.items()):
            if args.effects == "use":
                judge_use(folder, stem, own, plan, counts, use_kind(number, args.seed), rng)
            else:
                judge(folder, stem, own, plan, judged[name], rng)
    if args.effects == "use":
        report_use(counts)
    else:
        report(judged)


def report(judged: dict[str, Judged]) -> None:
    """Print what was counted, a column a plan."""
    plans = [name for name in judged if judged[name].widths]
    print("| |", " | ".join(plans), "|")
    print("|---|", " | ".join("---" for _ in plans), "|")

    def row(label: str, cell) -> None:
        print(f"| {label} |", " | ".join(cell(judged[name]) for name in plans), "|")

    row("instruments (without a calibration)", lambda own: f"{sum(own.verdicts.values())} ({own.without})")
    row("verdicts", lambda own: ", ".join(f"{count} {name}" for name, count in sorted(own.verdicts.items())))
    row("use", lambda own: ", ".join(f"{count} {name}" for name, count in sorted(own.use.items())))
    for name in (*SENSOR, *(f"corrected, {span}" for span in SPANS)):
        row(f"95 % intervals, {name}", lambda own, name=name: f"{np.mean(own.covered[name]):.1%}")
    row("median width / noise-only width", lambda own: f"{np.median(own.widths):.2f}")
    names = list(dict.fromkeys(name for name in PLANS for name in judged[name].errors))
    for name in names:
        if name.endswith("refused"):
            row(name, lambda own, name=name: f"{len(own.errors[name])}")
        else:
            row(
                f"{name} / mg rms (90th percentile)",
                lambda own, name=name: (
                    f"{1e3 * np.sqrt(np.mean(own.errors[name])):.3f} ({1e3 * np.sqrt(np.quantile(own.errors[name], 0.9)):.3f})"
                    if own.errors[name]
                    else "-"
                ),
            )


if __name__ == "__main__":
    main()
