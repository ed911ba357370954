"""`tumblecal reduce`: from a capture's folder to position means."""

from pathlib import Path


def reduce(folder: Path, /) -> None:
    """Average the accepted positions of a capture; write positions.csv, positions.parquet and reduction.json there.

    The sd of each mean comes from the coloured noise, averaged over the noise models that the dwells allow; the comment
    noise_model of positions.csv holds its parts, from which calibrate and diagnose know what neighbouring positions have in
    common. Every dwell is checked: warm-up, trend, outliers, spectral lines, quantisation, saturation, losses.
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
    dwell_s = max(len(p.force) for p in r.positions) / r.rate_hz
    for axis, words in zip("xyz", r.recorded.reported.words(dwell_s), strict=True):
        console.print(f"noise {axis}: {words}", highlight=False)
    console.print(
        f"{', '.join(str(p) for p in paths)}: {len(r.positions)} of {len(r.plan.steps)} positions", highlight=False
    )
