# SPDX-License-Identifier: Apache-2.0
"""A PNG shows every layer, and the same chart gives the same bytes."""

import numpy as np
import pytest
from PIL import Image

from loco_learning.drawing import heat, png
from loco_learning.drawing.chart import DASHED, Axis, Chart, Frame, bars, dots, line


def near(pixels, color):
    """Which pixels, (N, 3), have a colour, but for what smoothing does to it."""
    wanted = [int(color[i : i + 2], 16) for i in (1, 3, 5)]
    return np.abs(pixels - wanted).max(axis=1) < 6


def test_every_shape_leaves_its_colour_and_bytes_are_the_same(tmp_path):
    colors = ("#ff0000", "#00ff00", "#0000ff", "#ff00ff")
    t = np.linspace(1.0, 10.0, 30)
    layers = [
        line("one", t, t, colors[0], size=4.0),
        line("two", t, 11.0 - t, colors[1], shape=DASHED, size=4.0),
        dots("three", t, np.full(30, 3.0), colors[2], size=6.0),
    ]
    chart = Chart([
        Frame(Axis("x [m]", logarithmic=True), Axis("y [m]"), layers, "first"),
        Frame(Axis("t [s]"), Axis("leg", names=["a", "b"]), [bars("four", [(1, 2)], 0, colors[3])]),
        Frame(Axis("i"), Axis("j"), heat.cells(np.arange(6.0).reshape(2, 3), "W"), equal=True),
    ])  # fmt: skip
    one, two = (png.write(chart, tmp_path / name).read_bytes() for name in ("a.png", "b.png"))
    assert one == two
    seen = np.asarray(Image.open(tmp_path / "a.png").convert("RGB")).reshape(-1, 3)
    for color in (*colors, heat.STEPS[0], heat.STEPS[-1]):
        assert near(seen, color).sum() > 20, color


def test_the_legend_shows_the_mark_that_lies_on_top(tmp_path):
    pale, full, empty = "#ffddaa", "#aa0000", "#0000aa"
    layers = [
        dots("region", [1.0, 2.0], [1.0, 1.0], pale, size=6.0),
        dots("region", [2.0], [1.0], full, size=6.0),
        dots("region", [], [], empty, size=6.0),
    ]
    chart = Chart([Frame(Axis("x", limits=(0.0, 9.0)), Axis("y"), layers)])
    seen = np.asarray(Image.open(png.write(chart, tmp_path / "a.png")).convert("RGB"))
    legend = seen[:, int(0.75 * seen.shape[1]) :].reshape(-1, 3)
    assert [near(legend, color).any() for color in (pale, full, empty)] == [False, True, False]


@pytest.mark.parametrize(("count", "columns"), [(5, 0), (3, 4)])
def test_a_place_without_a_frame_stays_white(tmp_path, count, columns):
    frame = Frame(Axis("x"), Axis("y"), [line("", [0.0, 1.0], [0.0, 1.0], "#000000")])
    path = png.write(Chart([frame] * count, columns), tmp_path / "a.png")
    seen = np.asarray(Image.open(path).convert("L"))
    height, width = (size // parts for size, parts in zip(seen.shape, (3, 5), strict=True))
    assert (seen[-height:, -width:] == 255).all()
