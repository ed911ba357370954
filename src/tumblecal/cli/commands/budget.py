"""`tumblecal budget`: the uncertainty budget of a calibration, type A (noise) and type B (inputs)."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from tumblecal.cli.command import Command
from tumblecal.cli.model_options import ModelOptions
from tumblecal.cli.options import Seed, options, within
from tumblecal.cli.result_files import results
from tumblecal.ground.errors import InputError
from tumblecal.ground.suggested_command import suggested


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

    def planned(self, data: Path, rig: Path | None, diagnosis: Path | None) -> bool:
        """Whether the budget is that of the plan of a rig, whose file is then the data.

        **Raises:** `InputError` for options that contradict each other.
        """
        planned = data.suffix == ".toml"
        if planned and rig not in (None, data):
            raise InputError(f"{data}: a rig file; give it without --rig, or give a position file with --rig")
        if diagnosis is not None and (planned or self.monte_carlo):
            raise InputError("--diagnosis is for measured data without --monte-carlo; remove one of these")
        return planned


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
    from tumblecal.budget.inputs import considered_inputs, planned_fit
    from tumblecal.budget.monte_carlo import monte_carlo
    from tumblecal.budget.of_diagnosis import with_diagnosis
    from tumblecal.cli.positions_read import measured_fit
    from tumblecal.cli.read_model import read_model
    from tumblecal.show.budget import budget_lines, write_budget

    planned = checking.planned(data, options.rig, diagnosis)
    model = read_model(replace(options, rig=data) if planned else options)
    inputs, file = considered_inputs(considered, model.rig)
    with results(out, _SET, [data, considered, diagnosis, *options.files]) as aside:
        with command.working(f"fitting {data}"):
            fit, notes = (planned_fit(model), []) if planned else measured_fit(command, model, data)
        made = budget_of(fit, inputs, model.entries, file, level=checking.level)
        diagnose = f"run {suggested('diagnose', data)} and give its folder to --diagnosis"
        more = [] if planned else [f"Undetected effects are not included. To include them, {diagnose}"]
        if diagnosis is not None:
            made, more, use = with_diagnosis(made, diagnosis, model.entries, file)
            command.warn(diagnosis, more if use.refused else more[:-1])
        with command.working(f"{checking.monte_carlo} trials"):
            checked = monte_carlo(made, checking.monte_carlo, checking.seed) if checking.monte_carlo else None
        command.say(*more)
        write_budget(aside, made, checked, [*notes, *more])
    command.say(*budget_lines(made, checked))
    return command.end(out, _SET, "budget.json")
