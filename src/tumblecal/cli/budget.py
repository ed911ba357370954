"""`tumblecal budget`: the uncertainty budget of a calibration, type A (noise) and type B (inputs)."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import Parameter

from tumblecal.cli.options import ModelOptions, seed_in_range
from tumblecal.cli.output import Output
from tumblecal.ground.errors import InputError
from tumblecal.ground.suggested_command import suggested


if TYPE_CHECKING:
    from tumblecal.budget.budget import Budget
    from tumblecal.chain.considered import Considered
    from tumblecal.cli.model_options import StatedModel
    from tumblecal.data.calibration_use import Use
    from tumblecal.estimation.fit import Fit


@Parameter(name="*")
@dataclass(frozen=True)
class BudgetOptions:
    """Expanded uncertainties and their check.

    Parameters
    ----------
    level
        Coverage probability of the expanded uncertainties. Example: --level 0.99.
    monte_carlo
        Number of Monte Carlo trials (JCGM 101) to check the budget: noise and inputs are drawn, the model is fitted again.
        Default: 0, no check. Example: --monte-carlo 10000.
    seed
        Seed of the trials. Example: --seed 1.
    """

    level: float = 0.95
    monte_carlo: int = 0
    seed: int = 0

    def check(self) -> None:
        """Check the numbers.

        **Raises:** `InputError` for a number out of range.
        """
        if not 0.5 <= self.level < 1:
            raise InputError(f"--level {self.level:g}: a probability from 0.5 to below 1")
        if self.monte_carlo and not 100 <= self.monte_carlo <= 1_000_000:
            raise InputError(f"--monte-carlo {self.monte_carlo}: from 100 to 1000000 trials")
        seed_in_range(self.seed)


_SET = ("budget.json", "budget.svg", "budget.html")


def budget(
    data: Path,
    considered: Path | None = None,
    /,
    *,
    options: ModelOptions = ModelOptions(),
    budget_options: BudgetOptions = BudgetOptions(),
    diagnosis: Path | None = None,
    out: Path = Path("budget"),
    output: Output = Output(),
) -> int:
    """Compute the uncertainty budget of a calibration: noise (type A) and inputs that are not fitted (type B).

    Parameters
    ----------
    data
        Position file; or a rig (.toml), for the budget of its plan before a measurement.
    considered
        File of inputs (docs/budget.md). Default: the table `considered` of the rig.
    diagnosis
        Folder of tumblecal diagnose for the same data, or its calibration.json. Its covariance (noise, other explanations,
        undetected effects) replaces that of the noise. Default: none. Example: --diagnosis diagnosis.
    out
        Output folder: budget.json, budget.svg and budget.html. Example: --out budget17.
    """
    from tumblecal.cli.start import start

    output.begin()
    budget_options.check()
    start()
    from tumblecal.budget.budget import budget_of
    from tumblecal.cli.model_options import StatedModel
    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.ground.atomic import output_folders
    from tumblecal.ground.result_set import result_set
    from tumblecal.show.budget import budget_text, write_budget

    planned = data.suffix == ".toml"
    if planned and options.rig is not None and options.rig != data:
        raise InputError(f"{data}: a rig file; give it without --rig, or give a position file with --rig")
    if diagnosis is not None and (planned or budget_options.monte_carlo):
        other = "a plan that is not measured" if planned else "--monte-carlo, which draws noise and inputs only"
        raise InputError(f"--diagnosis cannot be combined with {other}; remove one of them")
    model = StatedModel.of(_with_rig(options, data) if planned else options)
    inputs, file = _inputs(model, considered)
    protect_inputs(
        [data, considered, diagnosis, options.rig, options.head, *options.effects], folders=[out], names=_SET
    )
    with output.working(f"fitting {data}"):
        fit, notes = (_planned(model), []) if planned else _measured(model, data)
    output.say("\n".join(notes))
    output.warn(str(data), notes)
    if not fit.code.good:
        raise InputError(f"{data}: {fit.message}; run: {suggested('diagnose', data)}")
    made = budget_of(fit, inputs, model.entries, file, level=budget_options.level)
    if diagnosis is not None:
        made, more, use = _of_diagnosis(made, diagnosis, model, file)
        output.say("\n".join([*more, f"use: {use.words}"]))
        output.warn(str(diagnosis), [*more, *([f"use: {use.words}"] if use.refused else [])])
        notes += [*more, f"use: {use.words}"]
    elif not planned:
        notes.append(
            f"Undetected effects are not included. To include them, run {suggested('diagnose', data)} and give its folder to "
            "--diagnosis"
        )
        output.say(notes[-1])
    checked = None
    if budget_options.monte_carlo:
        from tumblecal.budget.monte_carlo import monte_carlo

        with output.working(f"{budget_options.monte_carlo} trials"):
            checked = monte_carlo(made, budget_options.monte_carlo, budget_options.seed)
    with output_folders([out]), result_set(out, _SET) as aside:
        written = write_budget(aside, made, checked, notes)
    output.say(f"{budget_text(made, checked)}\nwritten: {out}/: {', '.join(written)}")
    output.record(out / "budget.json")
    return 0


def _of_diagnosis(made: "Budget", diagnosis: Path, model: "StatedModel", file: str) -> "tuple[Budget, list[str], Use]":
    """The budget with the covariance of a diagnosis, notes on it, and the use of its calibration."""
    from tumblecal.budget.of_diagnosis import of_diagnosis, require_same_data
    from tumblecal.data.calibration import read_calibration
    from tumblecal.data.not_applied import losses_words
    from tumblecal.data.source_of import source_of

    path = diagnosis / "calibration.json" if diagnosis.is_dir() else diagnosis
    calibration = read_calibration(path)
    require_same_data(path, calibration, source_of(made.fit.data)["sha256"], made.fit.data.serial_number)
    made, notes = of_diagnosis(made, path, calibration, model.entries, file)
    return made, [*notes, *losses_words(calibration.not_applied)], calibration.use


def _with_rig(options: ModelOptions, rig: Path) -> ModelOptions:
    from dataclasses import replace

    return replace(options, rig=rig)


def _inputs(model: "StatedModel", considered: Path | None) -> "tuple[dict[str, Considered], str]":
    """The inputs, and the file that states them.

    **Raises:** `InputError` if there are none.
    """
    from tumblecal.budget.budget_file import read_considered

    if considered is not None:
        return dict(read_considered(considered)), str(considered)
    if model.rig is None or not model.rig.considered:
        raise InputError(
            "no inputs to consider: give a file of inputs after the data, or a rig with [considered.NAME] tables"
        )
    return dict(model.rig.considered), model.rig.source


def _measured(model: "StatedModel", data: Path) -> "tuple[Fit, list[str]]":
    """The fit of a position file as in `calibrate`, with its warnings; its noise is the type A part of the budget."""
    from tumblecal.estimation.methods import Calibrated, exact_fit
    from tumblecal.estimation.plausibility import implausible
    from tumblecal.show.calibration import words_of_calibration

    positions, setup_errors = model.checked(model.read(data))
    fitted, scatter, floor, level = exact_fit(model.problem(positions), by_columns=model.noise_sd is None)
    unusual = model.with_sources(implausible(fitted, model.usual), fitted.problem)
    made = Calibrated({"exact": fitted}, {}, unusual, tuple(setup_errors), scatter, floor, level, model.entries)
    return fitted, words_of_calibration(made).lines("warnings")


def _planned(model: "StatedModel") -> "Fit":
    """The fit of a plan at the true values of its rig, without measurement errors.

    **Raises:** `InputError` if the noise is not stated.
    """
    from dataclasses import replace

    from tumblecal.estimation import exact
    from tumblecal.simulation.position_means import simulated

    assert model.rig is not None
    if model.noise_sd is None:
        raise InputError(f'{model.rig.source}: noise.sd is missing; add [noise] sd = "0.1 mg" or give --noise-sd')
    data = simulated(replace(model.rig, effects=()), 0, noise_sd=1e-12)
    return exact.fit(model.problem(data))
