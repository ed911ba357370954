"""`tumblecal reduce`: from a capture's folder to position means."""

from pathlib import Path


def reduce(folder: Path, /) -> None:
    """Average the accepted positions of a capture; write positions.csv, positions.parquet and reduction.json there.

    The sd of each mean comes from the coloured noise (overlapping Allan deviation of all dwells and a noise model
    fitted to it). Every dwell is checked: warm-up, trend, outliers, spectral lines, quantisation, saturation, losses.
    Then: tumblecal calibrate DIR/positions.csv.

    Parameters
    ----------
    folder
        The folder of tumblecal capture.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from tumblecal.capture.reduce import reduce as reduced
    from tumblecal.capture.reduce import write_reduction

    r = reduced(folder)
    paths = write_reduction(r, folder)
    table = Table(box=box.SIMPLE)
    for name in ("position", "alpha", "beta", "n", "x mg", "y mg", "z mg", "sd of the mean ug", "sd/sqrt(n) ug"):
        table.add_column(name, justify="right")
    table.add_column("to look at")
    for k, p in enumerate(r.positions):
        step = r.plan.steps[p.position]
        table.add_row(
            str(step.name),
            f"{step.alpha_deg:g}",
            f"{step.beta_deg:g}",
            str(len(p.force)),
            *(f"{v * 1e3:+.3f}" for v in p.mean),
            " ".join(f"{v * 1e6:.1f}" for v in r.sd_of_mean[k]),
            " ".join(f"{v * 1e6:.1f}" for v in p.white_sd),
            "; ".join(r.checks[k].warnings),
        )
    console = Console()
    console.print(table)
    for axis, noise in zip("xyz", r.noise, strict=True):
        console.print(f"noise {axis}: {_words(noise)}", highlight=False)
    console.print(
        f"{', '.join(str(p) for p in paths)}: {len(r.positions)} of {len(r.plan.steps)} positions", highlight=False
    )


def _words(noise) -> str:
    parts = [
        (noise.white_g_per_rthz, "white {:.1f} ug/sqrt(Hz)"),
        (noise.flicker_g, "flicker {:.1f} ug"),
        (noise.markov_sd_g, f"Gauss-Markov {{:.1f}} ug with {noise.markov_time_s:.0f} s"),
        (noise.walk_g_per_rts, "random walk {:.2f} ug/sqrt(s)"),
        (noise.quantisation_g_s, "quantisation {:.2f} ug s"),
    ]
    return ", ".join(text.format(value * 1e6) for value, text in parts if value > 0) or "none"
