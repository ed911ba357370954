"""`tumblecal plan`: the design of a measurement before it begins."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from tumblecal.cli.command import Command
from tumblecal.cli.options import Count, Files, Positive, Seed, Texts, options
from tumblecal.cli.result_files import results
from tumblecal.ground.errors import InputError
from tumblecal.ground.option_texts import angles, numbers, pairs, sizes


if TYPE_CHECKING:
    from tumblecal.chain.rig import Rig
    from tumblecal.effects.catalogue import Catalogue
    from tumblecal.plan.request import Wanted


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
    from tumblecal.plan.plan_files import RIG, earlier_files, write_plan
    from tumblecal.show.figures.plan import FIGURES
    from tumblecal.show.page import write_page
    from tumblecal.show.plan import plan_lines, print_plan, words_of_plan

    files = [Path(text) for text in options.effects if "=" not in text]
    entries, earlier = catalogue(*files), earlier_files(out)
    head = _allowed(read_rig_with_effects(rig, entries), options)
    wanted = _wanted(head, options, entries)
    inputs = [rig, options.augment, *options.compare, *files]
    with results(out, (*earlier, RIG), inputs) as aside:
        with command.working("designing"):
            designed = design_plan(head, wanted, entries)
        words = words_of_plan(designed, out)
        texts = list(plan_lines(words)), words.pairs("assumptions")[1:]
        names = write_plan(aside, designed, read_toml(file_or_example(rig)), *texts)
        names += write_page(aside / "plan.html", words, FIGURES, designed)
    if command.words:
        print_plan(words)
    command.end(out, names, "plan.json")


def _allowed(rig: "Rig", options: PlanOptions) -> "Rig":
    """The rig with the settings of the options in place of those of its head.

    **Raises:** `InputError` for a mounting that the rig does not have.
    """
    from tumblecal.chain.head_ability import HeadAbilityTable
    from tumblecal.plan.positions_of_file import require_mounts

    there = rig.plan
    ability = rig.ability or HeadAbilityTable.model_validate({}).ability(
        tuple(sorted({*there.beta_deg})), tuple(dict.fromkeys(there.mounts))
    )
    mounts = tuple(label.strip() for label in options.allow_mount.split(",") if label.strip())
    require_mounts(rig, mounts or ability.mounts, f"{rig.source}: {'--allow-mount' if mounts else 'head.mounts'}")
    alpha, beta = angles("--allow-alpha", options.allow_alpha), angles("--allow-beta", options.allow_beta)
    if steep := [angle for angle in beta if abs(angle) > 90]:
        raise InputError(f"--allow-beta: {steep[0]:g} deg; pitch settings are from -90 to 90 deg")
    stated = {"alpha_deg": alpha, "beta_deg": beta, "mounts": mounts}
    given = {name: value for name, value in stated.items() if value}
    assumed = tuple(key for key in ability.assumed if key not in given)
    return replace(rig, ability=replace(ability, **given, assumed=assumed))


def _wanted(rig: "Rig", options: PlanOptions, entries: "Catalogue") -> "Wanted":
    """The options as a request.

    **Raises:** `InputError` for an option that cannot be read, and options that contradict each other.
    """
    from tumblecal.effects.catalogue import entry
    from tumblecal.plan.positions_of_file import positions_of
    from tumblecal.plan.request import CRITERIA, Wanted

    stated = [part if "=" in part else f"{part}=1" for part in options.criterion.split(",")]
    given = pairs("--criterion", stated, "worst=1,in_use=2", CRITERIA)
    weights = {name: numbers(f"--criterion {name}", text, "worst=1")[0] for name, text in given.items()}
    if wrong := [name for name, weight in weights.items() if weight <= 0]:
        raise InputError(f"--criterion {wrong[0]}: a weight must be above 0; remove a criterion that does not count")
    of_effects = [text for text in options.effects if "=" in text]
    effects = sizes("--effects ", of_effects, lambda id: entry(entries, id).unit, "'second_order.z=0.2 mg/g^2'")
    if not effects and {"naming", "alias"} & {*weights}:
        raise InputError("--criterion: no effect is stated; add for example --effects 'second_order.z=0.2 mg/g^2'")
    if options.parameters and not {"worst", "mean", "volume"} & {*weights}:
        raise InputError(
            f"--parameters and --criterion {options.criterion} contradict each other: this criterion does not depend on a "
            "choice of parameters; remove --parameters, or add for example worst"
        )
    return Wanted(
        positions=options.positions,
        minutes=options.minutes,
        criteria=weights,
        parameters=tuple(name.strip() for name in options.parameters.split(",") if name.strip()),
        effects=effects,
        order=options.order,
        restarts=options.restarts,
        seed=options.seed,
        measured=None if options.augment is None else positions_of(options.augment, rig),
        compared=tuple(positions_of(path, rig) for path in options.compare),
        forecast=options.forecast,
    )
