# SPDX-License-Identifier: Apache-2.0
"""What a chart carries is what was given, and words tell what it shows."""

import base64
import zlib

import numpy as np

from loco_bringup.page.chart import BUDGET, data_of, seen
from loco_bringup.page.plot import STEPS
from loco_learning.drawing.chart import Axis, Chart, Frame, bars, dots, line

RNG = np.random.default_rng(7)


def unpacked(data):
    """Places of all layers of the first frame, by layer and side, as the script reads them."""
    stream = np.frombuffer(zlib.decompress(base64.b64decode(data["steps"])), "<i2")
    used, found = 0, []
    for layer in data["panels"][0]["layers"]:
        sides = {}
        for side in ("x", "right", "y", "top"):
            if side in layer["ends"]:
                low, high = layer["ends"][side]
                part, used = stream[used : used + layer["count"]], used + layer["count"]
                steps = np.cumsum(part, dtype="<i2").astype(float)
                sides[side] = low + (steps + STEPS // 2) * (high - low) / STEPS
        found.append(sides)
    assert used == len(stream)
    return found


def test_places_of_every_shape_come_back():
    x, y = RNG.normal(size=(2, 50))
    walk = line("walk", x, y, "#0072b2")
    stance = bars("stance", [(1.0, 2.0), (4.0, 0.25)], 1, "#009e73")
    marks = dots("marks", y, x, "#d55e00", texts=list("ab") * 25, links=["#a"] * 50)
    data = data_of("One", Chart([Frame(Axis("x"), Axis("y"), [walk, stance, marks])]))
    one, two, three = unpacked(data)
    for got, wanted in (
        (one["x"], x), (one["y"], y), (three["x"], y), (three["y"], x),
        (two["x"], [1.0, 4.0]), (two["right"], [3.0, 4.25]), (two["top"], stance.top),
    ):  # fmt: skip
        np.testing.assert_allclose(got, wanted, atol=1.01 * np.ptp(wanted) / STEPS)
    assert data["panels"][0]["layers"][2]["texts"] == list("ab") * 25


def test_long_lines_are_thinned_and_marks_are_not():
    many = np.arange(2.0 * BUDGET)
    layers = [line("long", many, many, "#0"), dots("all", many[:1000], many[:1000], "#0")]
    data = data_of("Long", Chart([Frame(Axis("x"), Axis("y"), layers)]))
    assert [layer["count"] for layer in data["panels"][0]["layers"]] == [BUDGET, 1000]
    assert data["every"] == 2


def test_words_tell_the_range_of_lines_and_the_number_of_boxes():
    frame = Frame(
        Axis("time [s]"), Axis("leg", names=["a"]), [bars("stance", [(0, 1), (2, 1)], 0, "#0")]
    )
    path = Frame(Axis("x [m]"), Axis("y [m]"), [line("path", [0, 2], [-1, 3], "#0")], "seen", True)
    text = seen("Gait", Chart([frame, path]))
    assert text == (
        "Gait. leg over time [s]: stance 2 boxes. seen: y [m] over x [m]: path −1 to 3 at 0 to 2."
    )
