# SPDX-License-Identifier: Apache-2.0
"""Building blocks of every HTML page: text becomes HTML here and nowhere else.

All functions take plain text and return `Markup`, which is HTML. Text is escaped as it enters
a template, so that a name in a bag cannot become part of the page; what is `Markup` already
goes in as it is. Templates are in ``templates/``: ``page.html`` is the page with its style,
``blocks.html`` holds a macro for each function here.
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
        long: The section may be broken over printed pages.
    """

    title: str
    anchor: str
    content: Markup
    long: bool


def part(title: str, make: Callable[[], Markup | str], long: bool = False) -> Part:
    """Section with what `make` returns, or with the reason why it cannot return anything.

    Args:
        title: Heading.
        make: Draws or writes the content; a `LocoError` is shown in its place.
        long: The section may be broken over printed pages.
    """
    try:
        content = join([make()])
    except LocoError as error:
        content = missing(f"Not shown: {error}")
    return Part(title, title.lower().replace(" ", "-").replace(",", ""), content, long)


def document(title: str, header: Markup, parts: Iterable[Part]) -> str:
    """A whole page, which names no address outside of itself."""
    page, parts = _TEMPLATES.get_template("page.html"), list(parts)
    plotted = any('<figure class="plot"' in text for text in [header, *(p.content for p in parts)])
    return page.render(title=title, header=header, parts=parts, plotted=plotted, **_uplot())


@functools.lru_cache(maxsize=1)
def _uplot() -> dict[str, Markup]:
    """Script, style and licence of uPlot; its first line, an address, is left out."""
    folder = importlib.resources.files("loco_bringup.page") / "uplot"
    files = ("uplot.js", "uplot.css", "licence.txt")
    script, style, licence = ((folder / name).read_text(encoding="utf-8") for name in files)
    script = script.partition("\n")[2]
    return {"uplot": Markup(script), "uplot_css": Markup(style), "licence": Markup(licence)}


def join(blocks: Iterable[Markup | str]) -> Markup:
    """Pieces one after the other; plain text is escaped."""
    return Markup("\n").join(blocks)


def paragraph(*content: Markup | str, soft: bool = False) -> Markup:
    """Paragraph of some texts; a soft one is a remark."""
    return _block("paragraph", content, soft)


def note(text: Markup | str) -> Markup:
    """Remark inside other text, in a softer colour."""
    return Markup('<span class="soft">{}</span>').format(text)


def strong(text: Markup | str) -> Markup:
    """Text that stands out."""
    return Markup("<strong>{}</strong>").format(text)


def code(text: str) -> Markup:
    """Name of a topic, a file or a command."""
    return Markup("<code>{}</code>").format(text)


def link(text: str, target: str) -> Markup:
    """Text that leads to a page beside this one.

    Args:
        text: The text.
        target: Path of that page, from the folder of this one.
    """
    return Markup('<a href="{}">{}</a>').format(target, text)


def good(text: str, well: bool = True) -> Markup:
    """Text in the colour of what went well, or of what did not."""
    return Markup('<span class="{}">{}</span>').format("good" if well else "bad", text)


def missing(text: str) -> Markup:
    """Box that stands where something is missing or wrong."""
    return Markup('<p class="missing">{}</p>').format(text)


def verdict(text: str, well: bool | None) -> Markup:
    """The ending or the verdict, as a badge; grey where `well` is None and nothing was judged."""
    return _block("verdict", text, well)


def cards(rows: Iterable[tuple[str, str, str]], remark: str = "") -> Markup:
    """The main numbers of a page.

    Args:
        rows: Name, value and what is said of it in small letters, perhaps nothing.
        remark: Sentence below the cards.
    """
    return _block("cards", list(rows), remark)


def answer(rows: Iterable[tuple[str, str, str]], curve: Markup, place: Markup) -> Markup:
    """Top of a page about a finding: its sizes, which are what people copy, its curve and place.

    Args:
        rows: Name, value and remark of each size.
        curve: Plot.
        place: Drawing.
    """
    return _block("answer", list(rows), curve, place)


def facts(rows: Mapping[str, Markup | str]) -> Markup:
    """Table of texts by name."""
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
        marks: Class of each row: ``good``, ``so``, ``bad`` or nothing; empty for none at all.
    """
    rows = [list(row) for row in rows]
    return _block("table", list(head), rows, set(numeric), list(marks) or [""] * len(rows))


def bullets(items: Iterable[Markup | str]) -> Markup:
    """List of sentences; nothing if there are none."""
    return _block("bullets", list(items))


def number(value: float, digits: int = 4) -> str:
    """A value with so many digits, a dash where there is none."""
    if not math.isfinite(value):
        return "–" if math.isnan(value) else "∞"
    return f"{value:.{digits}g}".replace("e-0", "e-").replace("-", "−")


def figure(
    drawn: Plot | Chart | Callable[[], Plot | Chart], title: str, text: Markup | str
) -> Markup:
    """A plot or a chart that a reader can explore, under its caption.

    Args:
        drawn: Plot or chart, or the function that makes it.
        title: Name of it, for readers who cannot see it.
        text: Caption; none where it is empty.
    """
    drawing = drawn() if callable(drawn) else drawn
    of = plot if isinstance(drawing, Plot) else chart
    return _block("plot", text, of.seen(title, drawing), of.data_of(title, drawing))


def beside(left: Markup, right: Markup) -> Markup:
    """Two things side by side, below each other where the page is narrow."""
    return Markup('<div class="beside"><div>{}</div><div>{}</div></div>').format(left, right)


def case_panel(details: Mapping[str, Mapping[str, str]]) -> Markup:
    """The place where ``#case-NAME``, which a mark of a chart leads to, shows a case.

    Args:
        details: Texts of each case by its name.
    """
    return _block("case_panel", {name: dict(values) for name, values in details.items()})


def movie(gif: bytes, text: str) -> Markup:
    """An animation above its caption."""
    return _block("movie", text, _address(gif, "gif"))


def yaml_block(values: Any) -> Markup:
    """Values as YAML."""
    return _block("pre", yaml.safe_dump(values, sort_keys=False, allow_unicode=True))


def folded(title: str, content: Markup) -> Markup:
    """Content that a click opens."""
    return _block("folded", title, content)


def matrix(head: Sequence[str], rows: Iterable[tuple[str, Sequence[tuple[str, str]]]]) -> Markup:
    """Table of counts with upright names of columns.

    Args:
        head: Names of the columns.
        rows: Name of each row, and text and class (``good``, ``so``, ``bad`` or nothing) of each
            cell.
    """
    return _block("matrix", list(head), list(rows))


def _address(data: bytes, kind: str) -> Markup:
    return Markup(f"data:image/{kind};base64,{base64.b64encode(data).decode()}")
