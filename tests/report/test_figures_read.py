"""Figures can be read: no label lies on another, no grid over bars."""

from itertools import pairwise
from types import SimpleNamespace

import pytest

from tumblecal.effects.catalogue import catalogue
from tumblecal.show.figures.evidence import limits_figure


@pytest.mark.parametrize("largest", [3.0, 200.0, 2500.0, 4e5])
def test_ticks_of_the_detection_limits_do_not_touch(largest):
    entries = {id: catalogue()[id] for id in ("second_order.x", "gravity_value")}
    limit = SimpleNamespace(coefficients={"a": largest * entries["second_order.x"].typical})
    figure = limits_figure(
        SimpleNamespace(entries=entries, limits={"second_order.x": limit}, invisible={"gravity_value": "all"})  # pyright: ignore[reportArgumentType]
    )
    assert figure is not None
    figure.canvas.draw()
    labels = [label for label in figure.axes[0].get_xticklabels() if label.get_text()]
    boxes = [label.get_window_extent() for label in labels]
    for left, right in pairwise(boxes):
        # Text of an SVG is set in the viewer's own font, which may be wider.
        assert right.x0 - left.x1 > 0.25 * right.width, [label.get_text() for label in labels]
