"""Tables over temperature from lists and arrays, for benchmarks and tests."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from tumblecal.recordings.thermal.thermal_table import ThermalTable


def table_of(
    attitude: Sequence[str],
    readings: ArrayLike,
    sd: ArrayLike,
    temperature_degc: ArrayLike,
    *,
    time_s: ArrayLike | None = None,
    rate_degc_per_s: ArrayLike = 0.0,
    branch: Sequence[str] | None = None,
    direction: ArrayLike = 0,
    reached_by: ArrayLike | None = None,
    clock: Sequence[str] | None = None,
    n: ArrayLike = 1000.0,
    n_eff: ArrayLike | None = None,
    alpha_deg: ArrayLike | None = None,
    beta_deg: ArrayLike | None = None,
    mount: Sequence[str] | None = None,
    source: str = "arrays",
    comments: Mapping[str, str] | None = None,
) -> ThermalTable:
    """A table from lists or arrays; single numbers are valid for all rows.

    **Arguments:** as of `ThermalTable`. By default: one row a minute, all on one branch and clock; `reached_by` is
    `direction`; `n_eff` is `n`.

    **Raises:** `InputError` as of `ThermalTable`.

    Examples:
        >>> table = table_of(["up"] * 3, [[0, 0, 1.0], [0, 0, 1.001], [0, 0, 1.002]], 1e-4, [10, 20, 30], direction=1)
        >>> len(table), table.range_degc, table.columns()["az_g"]
        (3, (10.0, 30.0), [1.0, 1.001, 1.002])
    """
    count = len(attitude)

    def column(given: ArrayLike | None, kind: type = float) -> np.ndarray | None:
        if given is None:
            return None
        values = np.asarray(given, kind)
        return np.full(count, values) if values.ndim == 0 else values

    def vectors(given: ArrayLike) -> np.ndarray:
        values = np.asarray(given, float)
        values = values[:, None] if values.ndim == 1 and len(values) == count != 3 else values
        return np.broadcast_to(values, (count, 3)).copy()

    branch = ("arrays:1 up",) * count if branch is None else tuple(branch)
    samples = column(n)
    turned = column(direction, int)
    assert samples is not None and turned is not None
    return ThermalTable(
        attitude=tuple(attitude),
        readings=np.asarray(readings, float),
        sd=vectors(sd),
        n=samples,
        temperature_degc=np.asarray(temperature_degc, float),
        time_s=60.0 * np.arange(count) if time_s is None else np.asarray(time_s, float),
        rate_degc_per_s=np.broadcast_to(np.asarray(rate_degc_per_s, float), (count,)).copy(),
        branch=branch,
        direction=turned,
        reached_by=turned if reached_by is None else np.broadcast_to(np.asarray(reached_by, int), (count,)).copy(),
        clock=("1",) * count if clock is None else tuple(clock),
        n_eff=vectors(samples[:, None] if n_eff is None else n_eff),
        alpha_deg=column(alpha_deg),
        beta_deg=column(beta_deg),
        mount=None if mount is None else tuple(mount),
        source=source,
        comments=dict(comments or {}),
    )
