# SPDX-License-Identifier: Apache-2.0
"""Building blocks of every HTML page; the only place where text becomes HTML.

All functions take plain text and return `Markup`, which is HTML. Templates escape text, so
that a name in a bag cannot inject HTML; `Markup` is inserted unchanged. Templates are in
``templates/``: ``page.html`` is the page with its style, ``blocks.html`` has one macro per
function of this module.
"""

from __future__ import annotations

import base64
import functools
import importlib.resources
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from loco_control.exceptions import LocoError
from loco_learning.drawing.chart import Chart

from .. import __version__
from . import chart, plot
from .plot import Plot

_TEMPLATES = Environment(
    loader=PackageLoader("loco_bringup.page"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def _block(name: str, *arguments: Any, **kwargs: Any) -> Markup:
    return getattr(_TEMPLATES.get_template("blocks.html").module, name)(*arguments, **kwargs)


@dataclass(frozen=True)
class Part:
    """One section of a page.

    Attributes:
        title: Heading.
        anchor: Name that the list of contents links to.
        content: HTML below the heading.
        long: Whether the section may be split over printed pages.
    """

    title: str
    anchor: str
    content: Markup
    long: bool


def part(title: str, make: Callable[[], Markup | str], long: bool = False) -> Part:
    """Section with the result of `make`, or with its error message.

    Args:
        title: Heading.
        make: Function that returns the content; if it raises a `LocoError`, the message is shown.
        long: Whether the section may be split over printed pages.
    """
    try:
        content = join([make()])
    except LocoError as error:
        content = missing(f"Not shown: {error}")
    return Part(title, title.lower().replace(" ", "-").replace(",", ""), content, long)


def document(title: str, header: Markup, parts: Iterable[Part]) -> str:
    """A complete page without references to external addresses."""
    page, parts = _TEMPLATES.get_template("page.html"), list(parts)
    plotted = any('<figure class="plot"' in text for text in [header, *(p.content for p in parts)])
    fields = {"title": title, "header": header, "version": __version__}
    return page.render(fields, parts=parts, plotted=plotted, **_uplot())


@functools.lru_cache(maxsize=1)
def _uplot() -> dict[str, Markup]:
    """Script, style and licence of uPlot, without its first line, which is an address."""
    folder = importlib.resources.files("loco_bringup.page") / "uplot"
    files = ("uplot.js", "uplot.css", "licence.txt")
    script, style, licence = ((folder / name).read_text(encoding="utf-8") for name in files)
    script = script.partition("\n")[2]
    return {"uplot": Markup(script), "uplot_css": Markup(style), "licence": Markup(licence)}


def join(blocks: Iterable[Markup | str]) -> Markup:
    """Concatenated pieces; plain text is escaped."""
    return Markup("\n").join(blocks)


def paragraph(*content: Markup | str, soft: bool = False) -> Markup:
    """Paragraph; `soft` marks it as a remark in a softer colour."""
    return _block("paragraph", content, soft)


def note(text: Markup | str) -> Markup:
    """Remark inside other text, in a softer colour."""
    return Markup('<span class="soft">{}</span>').format(text)


def strong(text: Markup | str) -> Markup:
    """Emphasised text."""
    return Markup("<strong>{}</strong>").format(text)


def code(text: str) -> Markup:
    """Name of a topic, file or command in code style."""
    return Markup("<code>{}</code>").format(text)


def link(text: str, target: str) -> Markup:
    """Link to another local page.

    Args:
        text: Text of the link.
        target: Path of that page, relative to the folder of this page.
    """
    return Markup('<a href="{}">{}</a>').format(target, text)


def good(text: str, well: bool = True) -> Markup:
    """Text in the colour of success, or of failure if `well` is false."""
    return Markup('<span class="{}">{}</span>').format("good" if well else "bad", text)


def missing(text: str) -> Markup:
    """Box with a message about missing or wrong content."""
    return Markup('<p class="missing">{}</p>').format(text)


def verdict(text: str, well: bool | None) -> Markup:
    """Outcome or verdict as a badge; grey if `well` is None, which means no verdict."""
    return _block("verdict", text, well)


def cards(rows: Iterable[tuple[str, str, str]], remark: str = "") -> Markup:
    """The main numbers of a page.

    Args:
        rows: Name, value and remark in small print (may be empty).
        remark: Sentence below the cards.
    """
    return _block("cards", list(rows), remark)


def answer(rows: Iterable[tuple[str, str, str]], curve: Markup, place: Markup) -> Markup:
    """Top of a page about a result: its sizes, curve and place.

    Args:
        rows: Name, value and remark of each size.
        curve: HTML of the plot.
        place: HTML of the drawing.
    """
    return _block("answer", list(rows), curve, place)


def facts(rows: Mapping[str, Markup | str]) -> Markup:
    """Table of names and texts."""
    return _block("facts", rows)


def table(
    head: Sequence[Markup | str],
    rows: Iterable[Sequence[Markup | str]],
    numeric: Sequence[int] = (),
    marks: Iterable[str] = (),
) -> Markup:
    """Table.

    Args:
        head: Names of the columns.
        rows: Cells of each row.
        numeric: Columns to align as numbers.
        marks: Class of each row: ``good``, ``so``, ``bad`` or empty; no classes if omitted.
    """
    rows = [list(row) for row in rows]
    return _block("table", list(head), rows, set(numeric), list(marks) or [""] * len(rows))


def bullets(items: Iterable[Markup | str]) -> Markup:
    """Bullet list of sentences; empty if there are none."""
    return _block("bullets", list(items))


def number(value: float, digits: int = 4) -> str:
    """A value with `digits` significant digits; a dash if it is not finite."""
    if not math.isfinite(value):
        return "–" if math.isnan(value) else "∞"
    return f"{value:.{digits}g}".replace("e-0", "e-").replace("-", "−")


def figure(
    drawn: Plot | Chart | Callable[[], Plot | Chart], title: str, text: Markup | str
) -> Markup:
    """An interactive plot or chart with its caption.

    Args:
        drawn: Plot or chart, or a function that returns one.
        title: Title, also for readers who cannot see it.
        text: Caption; empty for none.
    """
    drawing = drawn() if callable(drawn) else drawn
    of = plot if isinstance(drawing, Plot) else chart
    return _block("plot", text, of.seen(title, drawing), of.data_of(title, drawing))


def beside(left: Markup, right: Markup) -> Markup:
    """Two blocks side by side; one below the other on a narrow page."""
    return Markup('<div class="beside"><div>{}</div><div>{}</div></div>').format(left, right)


def case_panel(details: Mapping[str, Mapping[str, str]]) -> Markup:
    """Panel with the details of a case, opened by links ``#case-NAME`` from the marks of a chart.

    Args:
        details: Texts of each case by its name.
    """
    return _block("case_panel", {name: dict(values) for name, values in details.items()})


def movie(gif: bytes, text: str, start: float = 0.0, end: float = 0.0) -> Markup:
    """An animation with its caption; it shows the moment under the pointer of a plot over time.

    Args:
        gif: The animation, whose pictures are at even times.
        text: Caption.
        start: Time of its first picture [s].
        end: Time of its last picture [s].
    """
    data = base64.b64encode(gif).decode()
    return _block("movie", text, Markup(f"data:image/gif;base64,{data}"), start, end)


def yaml_block(values: Any) -> Markup:
    """Code block with values as YAML."""
    return _block("pre", yaml.safe_dump(values, sort_keys=False, allow_unicode=True))


def folded(title: str, content: Markup) -> Markup:
    """Collapsed content that opens on a click."""
    return _block("folded", title, content)


def matrix(head: Sequence[str], rows: Iterable[tuple[str, Sequence[tuple[str, str]]]]) -> Markup:
    """Table of counts with vertical column names.

    Args:
        head: Names of the columns.
        rows: Name of each row, and text and class (``good``, ``so``, ``bad`` or empty) of each
            cell.
    """
    return _block("matrix", list(head), list(rows))
