# SPDX-License-Identifier: Apache-2.0
"""Pages are well-formed, name no address, and show hostile text as text."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest
from markupsafe import Markup

from loco_bringup import __version__
from loco_bringup.page import html
from loco_bringup.page.plot import Line, Panel, Plot
from loco_control.exceptions import BagError
from loco_learning.drawing import heat
from loco_learning.drawing.chart import Axis, Chart, Frame, bars, dots, line

HOSTILE = "<script>alert('&')</script>\"><img src=x onerror=y> {{ 7 * 7 }} {% raw %}"


class Page(HTMLParser):
    """Tags, text and attributes of a page; fails where tags do not match."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.text, self.values = [], [], [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.values += [value for _, value in attrs]
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


BLOCKS = {
    "paragraph": lambda x: html.paragraph(x, x, soft=True),
    "note": html.note,
    "strong": html.strong,
    "code": html.code,
    "good": html.good,
    "missing": html.missing,
    "verdict": lambda x: html.verdict(x, False),
    "cards": lambda x: html.cards([(x, x, x)], x),
    "facts": lambda x: html.facts({x: x}),
    "table": lambda x: html.table([x], [[x]], numeric=[0]),
    "matrix": lambda x: html.matrix([x], [(x, [(x, "good")])]),
    "bullets": lambda x: html.bullets([x]),
    "figure": lambda x: plot_of(x),
    "chart": lambda x: chart_of(x),
    "link": lambda x: html.link(x, "page.html"),
    "beside": lambda x: html.beside(html.note(x), html.note(x)),
    "answer": lambda x: html.answer([(x, x, x)], html.note(x), html.note(x)),
    "case_panel": lambda x: html.case_panel({x: {x: x}}),
    "movie": lambda x: html.movie(b"GIF89a", x),
    "yaml_block": lambda x: html.yaml_block({x: x}),
    "folded": lambda x: html.folded(x, x),
    "join": lambda x: html.join([x]),
}


def plot_of(name):
    line = Line(name, np.arange(3.0), "#000000")
    return html.figure(Plot(np.arange(3.0), [Panel(name, [line])]), name, name)


def chart_of(name):
    """Every kind of layer, on axes of numbers and of names."""
    walk, log = np.cumsum(np.ones(5)) - 3.0, np.geomspace(1.0, 100.0, 5)
    cells = heat.cells(np.arange(6.0).reshape(2, 3), name, [[f"#case-{name}"] * 3] * 2, name)
    edge = heat.outline(np.eye(2, 3, dtype=bool), name, "#d62728")
    frames = [
        Frame(Axis(name), Axis(name), [line(name, walk, walk**2, "#0072b2")], name, equal=True),
        Frame(Axis(name, logarithmic=True), Axis(name, names=[name] * 5),
              [dots(name, log, range(5), "#d55e00", texts=[name] * 5)]),
        Frame(Axis(name), Axis(name, names=[name]), [bars(name, [(0.0, 1.0)], 0, "#009e73")]),
        Frame(Axis(name, names=[name] * 3), Axis(name, names=[name] * 2), [*cells, edge]),
    ]  # fmt: skip
    return html.figure(lambda: Chart(frames), name, name)


def test_every_block_is_here():
    made = {
        name
        for name, value in vars(html).items()
        if getattr(value, "__module__", "") == html.__name__ and not name.startswith("_")
    }
    assert made - set(BLOCKS) == {"Part", "part", "document", "number"}


@pytest.mark.parametrize("name", BLOCKS)
def test_text_stays_text(name):
    """A name that a bag holds cannot add a tag, an attribute or a template to the page."""
    block, plain = BLOCKS[name](HOSTILE), BLOCKS[name]("a harmless and long text")
    assert isinstance(block, Markup)
    hostile = Page(block)
    assert hostile.tags == Page(plain).tags
    words = " ".join(" ".join([*hostile.text, *map(str, hostile.values)]).split())
    # Values of a script are JSON with the characters of tags escaped.
    words = re.sub(r"\\u([0-9a-f]{4})", lambda found: chr(int(found[1], 16)), words)
    assert "alert('&')" in words.replace("''", "'") and "{{ 7 * 7 }}" in words


def test_a_page_is_whole_and_names_no_address():
    parts = [
        html.part(HOSTILE, lambda: html.table(["a"], [["b"]]), long=True),
        html.part("Second, part", lambda: HOSTILE),
    ]
    text = html.document(HOSTILE, html.paragraph(HOSTILE), parts)
    page = Page(text)
    assert text.startswith("<!DOCTYPE html>")
    assert "http" not in text and "url(" not in text
    assert f"Cite as:\nloco contributors, “{Markup.escape(HOSTILE)}”, loco {__version__}." in text
    assert "uPlot" not in text.partition("</main>")[2].partition("<script>")[0]  # nothing plotted
    assert page.tags.count("section") == 2 and "#second-part" in page.values
    assert "prefers-color-scheme: dark" in text and "width=device-width" in text


def test_a_part_without_data_says_why():
    def fail():
        raise BagError("no <data>")

    part = html.part("Figure", fail)
    assert part.content == '<p class="missing">Not shown: no &lt;data&gt;</p>'


def test_rows_have_marks_and_numbers_are_aligned():
    text = html.table(["name", "value"], [["a", "1"], ["b", "2"]], numeric=[1], marks=["good", ""])
    assert '<tr class="good"><td>a</td><td class="n">1</td></tr>' in text
    assert '<tr><td>b</td><td class="n">2</td></tr>' in text
    assert html.bullets([]) == html.cards([]) == ""
