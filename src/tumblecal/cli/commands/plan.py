"""`tumblecal plan`: the design of a measurement before it begins."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from tumblecal.cli.command import Command
from tumblecal.cli.options import Count, Files, Positive, Seed, Texts, options
from tumblecal.cli.result_files import results


@options
class PlanOptions:
    """The wanted plan.

    Parameters
    ----------
    positions
        Number of positions to measure. Default: 24, or the best number in --minutes. Example: --positions 48.
    minutes
        Time for the whole plan, min. Default: no limit. Example: --minutes 480.
    allow_alpha
        Spindle angles (deg) that the head can set. Repeatable. Default: those of [head], otherwise every 15 deg. Example:
        --allow-alpha 0:360:45.
    allow_beta
        Pitch settings (deg) that the head can set. Repeatable. Default: those of [head], otherwise of the rig's plan.
        Example: --allow-beta 0,30,60,90.
    allow_mount
        Mountings, by their labels in [mounts]. Default: those of [head], otherwise of the rig's plan. Example:
        --allow-mount A,B.
    criterion
        Quantity to minimise: worst, mean or volume (of the parameters' uncertainties), in_use or in_use_largest (corrected
        force), naming (of --effects), alias; or several with weights. Default: worst. Example: --criterion worst=1,naming=2.
    parameters
        Parameters that the criteria worst, mean and volume are about. Default: all of the sensor. Example:
        --parameters dK,bias_z.
    effects
        Effect that the diagnosis should name, with its size; or a Python file with user-defined effects. Repeatable. Default:
        none. Example: --effects 'second_order.z=0.2 mg/g^2'.
    order
        Order of the positions: best (with respect to slow noise), random, or keep (by mounting and pitch setting). Default:
        best. Example: --order random.
    augment
        Positions that are measured already (a position file, a plan or a rig): the plan adds to them. Default: none.
        Example: --augment measured.csv.
    compare
        Plans to compare (plans of capture, rigs or position files). Default: common practice only. Example:
        --compare A.toml B.toml.
    restarts
        Restarts of the search. Default: 4. Example: --restarts 20.
    seed
        Seed of the search; the same seed gives the same plan. Example: --seed 1.
    forecast
        Forecast of the diagnosis, for this plan and for common practice: effects that it will detect and name. Takes up to a
        minute. Example: --no-forecast.
    """

    positions: Count | None = None
    minutes: Positive | None = None
    allow_alpha: Texts = ()
    allow_beta: Texts = ()
    allow_mount: str = ""
    criterion: str = "worst"
    parameters: str = ""
    effects: Texts = ()
    order: Literal["keep", "random", "best"] = "best"
    augment: Path | None = None
    compare: Annotated[Files, Parameter(consume_multiple=True)] = ()
    restarts: Count = 4
    seed: Seed = 0
    forecast: Annotated[bool, Parameter(negative="--no-forecast")] = True


def plan(
    rig: Path,
    /,
    *,
    options: PlanOptions = PlanOptions(),
    out: Path = Path("plan"),
    command: Command = Command(),
) -> None:
    """Design a measurement: positions and their order, with the uncertainties that they will give.

    The rig file states what the head can do, in its table [head]. Every assumption is printed with the key or option that
    overrides it. Exit code: 0; 2 for input that is rejected. Next: tumblecal capture with DIR/plan_*.toml, then tumblecal
    calibrate --rig DIR/rig.toml.

    Parameters
    ----------
    rig
        Rig file (TOML) with the table [head], such as configs/plan_head.toml.
    out
        Output folder: plan_MOUNTING.toml for capture, rig.toml for simulate, study and calibrate --rig, plan.json, plan.html.
        Example: --out plan17.
    """
    command.begin()
    from tumblecal.effects import catalogue
    from tumblecal.effects.rig_with_effects import read_rig_with_effects
    from tumblecal.ground.examples import file_or_example
    from tumblecal.ground.strict_toml import read_toml
    from tumblecal.plan.design import design_plan
    from tumblecal.plan.plan_files import RIG, earlier_files
    from tumblecal.plan.request import allowed_rig, wanted_plan
    from tumblecal.show.plan import print_plan, words_of_plan, write_plan

    files = [Path(text) for text in options.effects if "=" not in text]
    entries, earlier, stated = catalogue(*files), earlier_files(out), vars(options).copy()
    settings = [stated.pop(name) for name in ("allow_alpha", "allow_beta", "allow_mount")]
    head = allowed_rig(read_rig_with_effects(rig, entries), *settings)
    wanted = wanted_plan(head, entries, **stated)
    with results(out, (*earlier, RIG), [rig, options.augment, *options.compare, *files]) as aside:
        with command.working("designing"):
            designed = design_plan(head, wanted, entries)
        words = words_of_plan(designed, out)
        names = write_plan(aside, designed, read_toml(file_or_example(rig)), words)
    if command.words:
        print_plan(words)
    command.end(out, names, "plan.json")
