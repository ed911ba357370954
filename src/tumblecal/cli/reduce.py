"""`tumblecal reduce`: from samples to position means."""

from pathlib import Path


_WRITTEN = ("positions.csv", "positions.parquet", "reduction.json")


def reduce(source: Path, /, *, out: Path | None = None) -> None:
    """Average the samples of every position; write positions.csv, positions.parquet and reduction.json.

    The sd of each mean comes from the coloured noise, averaged over the noise models that the dwells allow; the comment
    noise_model of positions.csv holds its parts, from which calibrate and diagnose know what neighbouring positions have in
    common. Every dwell is checked: warm-up, trend, outliers, spectral lines, quantisation, saturation, losses.
    Then: tumblecal calibrate DIR/positions.csv.

    Parameters
    ----------
    source
        The folder of tumblecal capture, or a table of samples (.csv, .parquet): a row a sample, with columns position,
        alpha_deg, beta_deg, ax_g, ay_g, az_g (or _mg, _ms2) and time_s (or the comment `# rate_hz: 100`).
    out
        Folder for the files; a capture's own folder, or `reduced` for a table, where left out.
    """
    from tumblecal.data.overwriting import inputs_kept
    from tumblecal.ground.atomic import output_folders
    from tumblecal.report.reduction_terminal import print_reduction

    if source.is_file():
        from tumblecal.capture.reduce_table import reduce_table, write_table_reduction

        folder = out or Path("reduced")
        inputs_kept([source], folders=[folder], names=_WRITTEN)
        with output_folders([folder]):
            table = reduce_table(source)
            paths = write_table_reduction(table, folder)
        data, words = table.data, f"{len(table.data)} positions of {sum(map(len, table.dwells))} samples"
        print_reduction(data, table.dwells, table.checks, (table.recorded, table.rate_hz))
    else:
        from tumblecal.capture.reduce import position_set, write_reduction
        from tumblecal.capture.reduce import reduce as reduced

        r, folder = reduced(source), out or source
        with output_folders([folder]):
            paths = write_reduction(r, source, folder)
        words = f"{len(r.positions)} of {len(r.plan.steps)} positions"
        dwells = [position.force for position in r.positions]
        print_reduction(position_set(r, source), dwells, r.checks, (r.recorded, r.rate_hz))
    print(f"{', '.join(str(path) for path in paths)}: {words}")
