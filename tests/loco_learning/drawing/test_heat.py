# SPDX-License-Identifier: Apache-2.0
"""Cells of a map lie where their values do, in one step of colour each, and edges close."""

import numpy as np
import pytest

from loco_learning.drawing import heat
from loco_learning.drawing.chart import DOTS, dots

VALUES = np.random.default_rng(3).lognormal(sigma=2.0, size=(5, 7))


def places(layers):
    """Step of colour of each cell, by its place."""
    return {
        (round(y + 0.5), round(x + 0.5)): step
        for step, layer in enumerate(layers)
        for x, y in zip(layer.x, layer.y, strict=True)
    }


@pytest.mark.parametrize("values", [VALUES, np.log(VALUES)])
def test_each_known_cell_has_one_step_in_the_order_of_the_values(values):
    values = values.copy()
    values[0, 2] = values[4, 6] = np.nan
    layers = heat.cells(values, "W")
    found = places(layers)
    assert sum(len(layer.x) for layer in layers) == len(found) == np.isfinite(values).sum()
    ranked = sorted(found, key=lambda at: values[at])
    assert (np.diff([found[at] for at in ranked]) >= 0).all()
    assert [layer.color for layer in layers] == [c for c in heat.STEPS if c in {
        layer.color for layer in layers}]  # fmt: skip


def test_a_cell_says_its_value_and_leads_to_its_own_page():
    links = [[f"#{i}-{j}" for j in range(7)] for i in range(5)]
    for layer in heat.cells(VALUES, "-", links, "power"):
        for x, y, text, link in zip(layer.x, layer.y, layer.texts, layer.links, strict=True):
            at = round(y + 0.5), round(x + 0.5)
            assert text == f"power {VALUES[at]:.4g}" and link == f"#{at[0]}-{at[1]}"


def test_a_flat_map_has_one_colour_and_an_unknown_one_none():
    (layer,) = heat.cells(np.full((2, 3), 4.0), "m")
    assert len(layer.x) == 6 and layer.name == "4 m"
    assert heat.cells(np.full((2, 3), np.nan), "m") == []


def test_maps_of_one_scale_have_one_colour_for_one_value():
    both = np.concatenate([VALUES.ravel(), 1e-3 * VALUES.ravel()])
    one, less = (heat.cells(values, "W", scale=both) for values in (VALUES, 1e-3 * VALUES))
    names = [{layer.name: layer.color for layer in layers} for layers in (one, less)]
    assert all(names[0][name] == names[1][name] for name in names[0].keys() & names[1].keys())
    assert [layer.color for layer in one] == list(heat.STEPS)  # in the legend of both
    assert len(one[-1].x) > 0 == len(less[-1].x)
    assert heat.cells(np.full((2, 2), np.nan), "W", scale=both) == []


def test_an_outline_runs_where_the_mask_changes():
    mask = np.random.default_rng(5).random((6, 8)) < 0.4
    edge = heat.outline(mask, "edge", "#000000")
    sides = np.column_stack([edge.x, edge.y]).reshape(-1, 3, 2)[:, :2]
    padded = np.pad(mask, 1)
    count = (padded[1:] != padded[:-1]).sum() + (padded[:, 1:] != padded[:, :-1]).sum()
    assert len(sides) == count
    for (x0, y0), (x1, y1) in sides:
        middle, across = np.array([(x0 + x1) / 2, (y0 + y1) / 2]), np.array([y1 - y0, x1 - x0]) / 2
        one, two = (np.round(middle + by * across).astype(int)[::-1] + 1 for by in (-1, 1))
        assert padded[tuple(one)] != padded[tuple(two)]


def test_a_halo_is_wider_and_below():
    below, above = heat.haloed(dots("failed", [1.0], [2.0], "#123456"))
    assert below.size > above.size and below.color != above.color
    assert below.shape == above.shape == DOTS and below.name == above.name
