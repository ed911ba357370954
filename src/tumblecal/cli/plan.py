"""`tumblecal plan`: the design of a measurement before it begins."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from tumblecal.cli.options import angles, seed_in_range
from tumblecal.cli.output import Output
from tumblecal.ground.errors import InputError


if TYPE_CHECKING:
    from tumblecal.chain.rig import Rig
    from tumblecal.design.common_plans import Positions
    from tumblecal.design.wanted import Wanted
    from tumblecal.effects.catalogue import Catalogue

_CRITERIA = ("worst", "mean", "volume", "in_use", "in_use_largest", "naming", "alias")


@Parameter(name="*")
@dataclass(frozen=True)
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

    positions: int | None = None
    minutes: float | None = None
    allow_alpha: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    allow_beta: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    allow_mount: str = ""
    criterion: str = "worst"
    parameters: str = ""
    effects: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    order: Literal["keep", "random", "best"] = "best"
    augment: Path | None = None
    compare: Annotated[tuple[Path, ...], Parameter(negative=(), show_default=False, consume_multiple=True)] = ()
    restarts: int = 4
    seed: int = 0
    forecast: bool = True


def plan(
    rig: Path,
    /,
    *,
    options: PlanOptions = PlanOptions(),
    out: Path = Path("plan"),
    output: Output = Output(),
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
    from tumblecal.cli.start import start

    output.begin()
    start()
    from tumblecal.data.overwriting import protect_inputs
    from tumblecal.design.plan import design_plan
    from tumblecal.design.plan_files import RIG, earlier_files, write_plan
    from tumblecal.effects import catalogue
    from tumblecal.effects.catalogue import read_rig_with_effects
    from tumblecal.ground.atomic import output_folders
    from tumblecal.ground.blas import single_blas_thread
    from tumblecal.ground.examples import file_or_example
    from tumblecal.ground.result_set import result_set
    from tumblecal.ground.strict_toml import read_toml
    from tumblecal.show.plan import plan_lines, print_plan, words_of_plan, write_plan_page

    files = [Path(text) for text in options.effects if "=" not in text]
    read = [options.augment, *options.compare, *files]
    earlier = earlier_files(out)
    protect_inputs([rig, *read], folders=[out], names=(*earlier, RIG))
    entries = catalogue(*files)
    head = _allowed(read_rig_with_effects(rig, entries), options)
    wanted = _wanted(head, options, entries)
    with single_blas_thread(), output.working("designing"):
        designed = design_plan(head, wanted, entries)
    words = words_of_plan(designed, out)
    texts = list(plan_lines(words)), words.pairs("assumptions")[1:]
    with output_folders([out]), result_set(out, earlier) as aside:
        written = write_plan(aside, designed, read_toml(file_or_example(rig)), *texts)
        written += write_plan_page(aside / "plan.html", designed, words)
    if output.words:
        print_plan(words)
        output.say(f"written: {out}/: {', '.join(written)}")
    output.record(out / "plan.json")


def _allowed(rig: "Rig", options: PlanOptions) -> "Rig":
    """The rig with the settings of the options in place of those of its head.

    **Raises:** `InputError` for a mounting that the rig does not have.
    """
    from tumblecal.chain.head_ability import HeadAbilityTable

    there = rig.plan
    ability = rig.ability or HeadAbilityTable.model_validate({}).ability(
        tuple(sorted(set(there.beta_deg))), tuple(dict.fromkeys(there.mounts))
    )
    alpha, beta = angles("--allow-alpha", options.allow_alpha), angles("--allow-beta", options.allow_beta)
    mounts = tuple(label.strip() for label in options.allow_mount.split(",") if label.strip())
    known = {*rig.mounts, *there.mounts}
    if unknown := [label for label in mounts or ability.mounts if label not in known]:
        option = "--allow-mount" if mounts else "head.mounts"
        raise InputError(
            f"{rig.source}: {option}: no mounting {unknown[0]!r}; add [mounts.{unknown[0]}] with its rotation_deg"
            f" (mountings: {', '.join(sorted(known))})"
        )
    if beta and (steep := [angle for angle in beta if abs(angle) > 90]):
        raise InputError(f"--allow-beta: {steep[0]:g} deg; pitch settings are from -90 to 90 deg")
    stated = {"alpha_deg": alpha, "beta_deg": beta, "mounts": mounts}
    given = {name: value for name, value in stated.items() if value}
    assumed = tuple(key for key in ability.assumed if key not in given)
    return replace(rig, ability=replace(ability, **given, assumed=assumed))


def _wanted(rig: "Rig", options: PlanOptions, entries: "Catalogue") -> "Wanted":
    """The options as a request.

    **Raises:** `InputError` for an option that cannot be read, and options that contradict each other.
    """
    from tumblecal.design.wanted import Wanted

    seed_in_range(options.seed)
    for option, value in (("--positions", options.positions), ("--minutes", options.minutes)):
        if value is not None and not value > 0:
            raise InputError(f"{option} {value:g}: must be above 0")
    if options.restarts < 1:
        raise InputError(f"--restarts {options.restarts}: at least 1")
    return Wanted(
        positions=options.positions,
        minutes=options.minutes,
        criteria=_criteria(options),
        parameters=tuple(name.strip() for name in options.parameters.split(",") if name.strip()),
        effects=dict(_sizes(options.effects, entries)),
        order=options.order,
        restarts=options.restarts,
        seed=options.seed,
        measured=None if options.augment is None else _positions(options.augment, rig),
        compared=tuple(_positions(path, rig) for path in options.compare),
        forecast=options.forecast,
    )


def _criteria(options: PlanOptions) -> Mapping[str, float]:
    weights = dict[str, float]()
    for part in options.criterion.split(","):
        name, equals, text = part.strip().partition("=")
        if name not in _CRITERIA:
            raise InputError(
                f"--criterion {options.criterion}: no criterion {name!r}; criteria: {', '.join(_CRITERIA)}"
            )
        if name in weights:
            raise InputError(f"--criterion {options.criterion}: {name} is stated twice; state it once")
        try:
            weights[name] = float(text) if equals else 1.0
        except ValueError as error:
            raise InputError(f"--criterion {part}: write a weight, for example --criterion worst=1,in_use=2") from error
        if not 0 < weights[name] < float("inf"):
            raise InputError(f"--criterion {part}: a weight must be above 0; remove a criterion that does not count")
    about_effects = [name for name in ("naming", "alias") if name in weights]
    if about_effects and not any("=" in text for text in options.effects):
        raise InputError(
            f"--criterion {about_effects[0]}: no effect is stated; add for example --effects 'second_order.z=0.2 mg/g^2'"
        )
    if options.parameters and not {"worst", "mean", "volume"} & {*weights}:
        raise InputError(
            f"--parameters and --criterion {options.criterion} contradict each other: this criterion does not depend on a "
            "choice of parameters; remove --parameters, or add for example worst"
        )
    return weights


def _sizes(texts: tuple[str, ...], entries: "Catalogue") -> Iterator[tuple[str, float]]:
    """Effects and their sizes, each in the unit of the effect."""
    from tumblecal.effects.catalogue import entry
    from tumblecal.ground.units import quantity

    for text in texts:
        name, equals, size = text.partition("=")
        if not equals:
            continue
        try:
            effect = entry(entries, name.strip())
            value = quantity(size, effect.unit)
        except InputError as error:
            raise InputError(f"--effects {text!r}: {error}") from error
        if not value > 0:
            raise InputError(f"--effects {text!r}: a size is above 0")
        yield name.strip(), value


def _positions(path: Path, rig: "Rig") -> "Positions":
    """The positions of a plan of capture, a rig or a position file.

    **Raises:** `InputError` for a file of none of these kinds, or with a mounting that the rig does not have.
    """
    from tumblecal.design.common_plans import Positions

    if path.suffix == ".toml":
        from tumblecal.capture.capture_plan import read_plan
        from tumblecal.chain.rig_file import PlanTable
        from tumblecal.ground.strict_toml import checked, read_toml

        content = read_toml(path)
        if "plan" in content:
            planned = checked(path, content["plan"], PlanTable).plan()
            alpha, beta, mounts, degc = planned.alpha_deg, planned.beta_deg, planned.mounts, planned.temperature_degc
        else:
            captured = read_plan(path)
            alpha, beta = zip(*((step.alpha_deg, step.beta_deg) for step in captured.steps), strict=True)
            mounts = (captured.session.mount,) * len(alpha)
            listed = tuple(step.temperature_degc for step in captured.steps if step.temperature_degc is not None)
            degc = listed if len(listed) == len(alpha) else None
    else:
        from tumblecal.data import read_positions

        data = read_positions(path)
        if data.hand_held:
            raise InputError(f"{path}: unknown attitudes; a plan needs alpha_deg and beta_deg")
        alpha, beta = tuple(data.alpha_deg.tolist()), tuple(data.beta_deg.tolist())
        mounts = data.mount or (rig.ability.mounts[0] if rig.ability else "1",) * len(alpha)
        degc = None if data.temperature_degc is None else tuple(data.temperature_degc.tolist())
    known = {*rig.mounts, *rig.plan.mounts}
    if unknown := [label for label in mounts if label not in known]:
        raise InputError(
            f"{path}: mounting {unknown[0]!r} is not in {rig.source} (mountings: {', '.join(sorted(known))}); rename it, or "
            f"add [mounts.{unknown[0]}]"
        )
    return Positions(
        path.name, "", tuple(map(float, alpha)), tuple(map(float, beta)), tuple(mounts), temperature_degc=degc
    )
