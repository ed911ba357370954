"""`tumblecal budget`: the uncertainty budget of a calibration, type A (noise) and type B (inputs)."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tumblecal.cli.command import Command, results
from tumblecal.cli.options import ModelOptions, Seed, options, within
from tumblecal.ground.errors import InputError
from tumblecal.ground.suggested_command import suggested


if TYPE_CHECKING:
    from tumblecal.cli.model_options import StatedModel
    from tumblecal.estimation.fit import Fit


_FEWEST_TRIALS = 100
_SET = ("budget.json", "budget.svg", "budget.html")


@options
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

    level: Annotated[float, within(gte=0.5, lt=1)] = 0.95
    monte_carlo: Annotated[int, within(gte=0, lte=1_000_000)] = 0
    seed: Seed = 0


def budget(
    data: Path,
    considered: Path | None = None,
    /,
    *,
    options: ModelOptions = ModelOptions(),
    checking: BudgetOptions = BudgetOptions(),
    diagnosis: Path | None = None,
    out: Path = Path("budget"),
    command: Command = Command(),
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
    command.begin()
    from tumblecal.budget.budget import budget_of
    from tumblecal.budget.budget_file import read_considered
    from tumblecal.budget.of_diagnosis import diagnosis_of, of_diagnosis
    from tumblecal.cli.model_options import StatedModel
    from tumblecal.data.not_applied import losses_words
    from tumblecal.show.budget import budget_text, write_budget
    from tumblecal.show.calibration import words_of_calibration

    planned = _is_planned(data, options, checking, diagnosis)
    model, notes = StatedModel.of(replace(options, rig=data) if planned else options), list[str]()
    if considered is None and not (model.rig and model.rig.considered):
        raise InputError(
            "no inputs to consider: give a file of inputs after the data, or a rig with [considered.NAME] tables"
        )
    inputs = read_considered(considered) if considered else model.rig.considered if model.rig else {}
    file = str(considered or (model.rig and model.rig.source))

    with results(out, _SET, [data, considered, diagnosis, *options.files]) as aside:
        with command.working(f"fitting {data}"):
            calibrated = None if planned else model.calibrated(model.read(data))
            fit = _planned(model) if calibrated is None else calibrated.exact
        if calibrated is not None:
            notes = words_of_calibration(calibrated).lines("warnings")
        command.say(*notes)
        command.warn(data, notes)
        if not fit.code.good:
            raise InputError(f"{data}: {fit.message}; run: {suggested('diagnose', data)}")
        made, checked = budget_of(fit, inputs, model.entries, file, level=checking.level), None
        more = list[str]()
        if diagnosis is not None:
            path, calibration = diagnosis_of(diagnosis, fit.data)
            made, more = of_diagnosis(made, path, calibration, model.entries, file)
            more += losses_words(calibration.not_applied)
            use = [f"use: {calibration.use.words}"]
            command.warn(diagnosis, more + use * calibration.use.refused)
            more += use
        elif not planned:
            without = "Undetected effects are not included. To include them, run"
            more = [f"{without} {suggested('diagnose', data)} and give its folder to --diagnosis"]
        command.say(*more)
        if checking.monte_carlo:
            from tumblecal.budget.monte_carlo import monte_carlo

            with command.working(f"{checking.monte_carlo} trials"):
                checked = monte_carlo(made, checking.monte_carlo, checking.seed)
        write_budget(aside, made, checked, [*notes, *more])
    command.say(budget_text(made, checked))
    return command.end(out, _SET, "budget.json")


def _is_planned(data: Path, options: ModelOptions, checking: BudgetOptions, diagnosis: Path | None) -> bool:
    """Whether the budget is that of the plan of a rig, whose file is then the data.

    **Raises:** `InputError` for options that contradict each other, and for too few trials.
    """
    planned = data.suffix == ".toml"
    if 0 < checking.monte_carlo < _FEWEST_TRIALS:
        raise InputError(f"--monte-carlo {checking.monte_carlo}: at least {_FEWEST_TRIALS} trials")
    if planned and options.rig not in (None, data):
        raise InputError(f"{data}: a rig file; give it without --rig, or give a position file with --rig")
    if diagnosis is not None and (planned or checking.monte_carlo):
        other = "a plan that is not measured" if planned else "--monte-carlo, which draws noise and inputs only"
        raise InputError(f"--diagnosis cannot be combined with {other}; remove one of them")
    return planned


def _planned(model: "StatedModel") -> "Fit":
    """The fit of a plan at the true values of its rig, without measurement errors.

    **Raises:** `InputError` if the noise is not stated.
    """
    from tumblecal.estimation import exact
    from tumblecal.simulation.position_means import simulated

    assert model.rig is not None
    if model.noise_sd is None:
        raise InputError(f'{model.rig.source}: noise.sd is missing; add [noise] sd = "0.1 mg" or give --noise-sd')
    return exact.fit(model.problem(simulated(replace(model.rig, effects=()), 0, noise_sd=1e-12)))
