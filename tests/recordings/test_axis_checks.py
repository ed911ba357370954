"""Axes that do not answer to gravity are refused by name on every way to means; axes that gravity never reaches are not."""

import numpy as np
import polars as pl
import pytest
from recordings_made import made

from tumblecal.ground.errors import InputError
from tumblecal.recordings.dwells.dwell_checks import require_axes_answer
from tumblecal.recordings.options import KnownContext
from tumblecal.recordings.reduce import reduced


SIX = np.array([[0, 0, 1], [0, 0, -1], [0, 1, 0], [0, -1, 0], [1, 0, 0], [-1, 0, 0]], float)


def sphere(count=14):
    directions = np.random.default_rng(3).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def ring(axis, count=8):
    """Gravity turned about an axis: it never reaches that one."""
    angle = 2 * np.pi * np.arange(count) / count
    return np.insert(np.stack([np.cos(angle), np.sin(angle)], axis=1), axis, 0.0, axis=1)


def dwells(attitudes, noise=1e-3, rows=50):
    rng = np.random.default_rng(4)
    return [
        np.array([1.08, 0.94, 1.0]) * unit + [0.5, -0.3, 0.1] + noise * rng.normal(size=(rows, 3)) for unit in attitudes
    ]


@pytest.mark.parametrize("attitudes", [SIX, sphere(), ring(1)])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_an_axis_with_one_reading_is_named(attitudes, axis, noise):
    rng = np.random.default_rng(5)
    made_of = dwells(attitudes)
    for dwell in made_of:
        dwell[:, axis] = 0.013 + noise * rng.normal(size=len(dwell))
    if noise and not np.ptp(attitudes[:, axis]):
        # Gravity never reaches that axis: nothing shows whether it answers.
        require_axes_answer("log.csv", made_of)
        return
    # Of two axes that do not change, gravity may not have reached one: noise hides which.
    named = "axes .*y.* do" if noise and not np.ptp(attitudes[:, 1]) else f"axis {'xyz'[axis]} does"
    with pytest.raises(InputError, match=f"log.csv: {named} not respond: the same reading in all attitudes"):
        require_axes_answer("log.csv", made_of)


@pytest.mark.parametrize("attitudes", [SIX, sphere(), *(ring(axis) for axis in range(3)), sphere(3), SIX[:2], SIX[:1]])
@pytest.mark.parametrize("rows", [1, 50])
def test_good_axes_are_not_refused(attitudes, rows):
    """Not even where a turn about one axis leaves its reading the same, or the noise is below the steps."""
    require_axes_answer("log.csv", dwells(attitudes, rows=rows))
    require_axes_answer("log.csv", dwells(attitudes, noise=0.0, rows=rows))
    require_axes_answer("log.csv", [np.round(64 * dwell) / 64 for dwell in dwells(attitudes, noise=5e-3, rows=rows)])


@pytest.mark.parametrize("way", ["static", "by", "means"])
def test_a_dead_axis_is_refused_on_every_way_to_means(tmp_path, way):
    s = made(attitudes=SIX)
    force = s.force.copy()
    force[:, 1] = 0.013
    path = tmp_path / "s.parquet"
    columns = {f"a{axis}_g": force[:, k] for k, axis in enumerate("xyz")}
    label = np.full(len(force), "turning", dtype=object)
    for k, (start, stop) in enumerate(s.still):
        label[start:stop] = f"s{k}"
    frame = pl.DataFrame(columns | {"time_s": s.time_s, "position": label})
    if way == "means":
        frame = frame.group_by("position", maintain_order=True).mean().drop("time_s", "position")
    if way == "by":
        frame = frame.with_columns(alpha_deg=pl.lit(0.0), beta_deg=pl.lit(0.0))
    frame.filter(pl.col("position") != "turning" if way == "by" else True).write_parquet(path)
    with pytest.raises(InputError, match=r"s.parquet: axis y does not respond: the same reading in all attitudes \(13"):
        match way:
            case "means":
                reduced([path], KnownContext(means=True))
            case "by":
                reduced([path])
            case _:
                reduced([path], KnownContext(static=True))
