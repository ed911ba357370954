"""The stated model of a command's options."""

from pathlib import Path

from tumblecal.chain.following import CHANGE
from tumblecal.chain.nominal import UNIT_OF_LEAF, unit_in
from tumblecal.cli.model_options import ModelOptions
from tumblecal.effects.catalogue import catalogue, links_and_units
from tumblecal.estimation.stated_model import StatedModel
from tumblecal.ground.errors import InputError
from tumblecal.ground.gravity import gravity_of_option
from tumblecal.ground.option_texts import pairs, sd_of_reading, sizes
from tumblecal.ground.toml_faults import located


def read_model(options: ModelOptions) -> StatedModel:
    """The model of the options.

    **Raises:** `InputError` for an option that cannot be used.
    """
    entries, rig, head = catalogue(*options.effects), None, None
    if options.rig is not None:
        from tumblecal.effects.rig_with_effects import read_rig_with_effects

        rig = read_rig_with_effects(options.rig, entries)
    if options.head is not None:
        from tumblecal.chain.head_file import read_head

        head = read_head(options.head, *links_and_units(entries))
    units = UNIT_OF_LEAF | (links_and_units(entries)[1] if rig and rig.effects else {})
    given = sizes("--prior ", options.prior, unit_in(units), "'dbeta=3 arcmin'", zero=True)
    known = [*UNIT_OF_LEAF, *(leaf + CHANGE for leaf in (rig.temperature.leaves if rig else ()))]
    if unknown := sorted({*options.fix} - {*known}):
        raise InputError(f"--fix {unknown[0]}: no such parameter; parameters: {', '.join(known)}")
    noise_sd = sd_of_reading("--noise-sd", options.noise_sd) or (rig.noise_sd_g if rig else None)
    if rig and noise_sd == 0:
        fault = (
            f"{rig.source}: noise.sd: readings without noise cannot be weighted; write their standard deviation, remove "
            "[noise] to estimate it from the residuals, or give --noise-sd"
        )
        raise InputError(located(Path(rig.source), [fault]))
    columns = pairs("--columns", options.columns or "", "ax_g=AccX,ay_g=AccY,az_g=AccZ")
    return StatedModel(
        rig=rig,
        noise_sd=noise_sd,
        priors={**(rig.priors if rig else {}), **{name: (0.0, size) for name, size in given.items()}},
        fixed=frozenset(options.fix),
        head=head,
        entries=entries,
        gravity=None if options.gravity is None else gravity_of_option(options.gravity),
        columns=columns or None,
        attitudes=options.attitudes,
        stated_in={name: f"{options.rig} (priors.{name})" for name in (rig.priors if rig else ())}
        | {name: f"--prior {name}" for name in given},
    )
