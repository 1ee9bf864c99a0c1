# SPDX-License-Identifier: Apache-2.0
"""`loco report`: one self-contained HTML page about a bag.

Every figure, the animation included, is inside the page; it names no address.
A part that the bag has no data for says so in its place.
"""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from html import escape
from importlib import resources
from pathlib import Path
from string import Template

import yaml
from matplotlib.figure import Figure

from loco_control.exceptions import BagError, LocoError, MissingFileError
from loco_control.params import to_dict
from loco_learning import metrics
from loco_learning.joint_log import JointLog
from loco_learning.log import Log

from . import report_figures as figures
from . import report_motion as motion  # its figures enter the same chapters
from . import report_tables as tables
from .bag import Bag
from .bag_log import read_log
from .joint_bag_log import is_joint, read_joint_log
from .readout_check import ReadoutCheck, check_log, weights_of
from .report_style import style, svg

GIF = "gait.gif"
FPS = 20.0
SIZE = (480, 320)  # [pixel]


def write_report(bag: Bag | str | Path, out: str | Path | None = None, gif: bool = True) -> Path:
    """Write the report of a recorded run.

    Args:
        bag: Bag folder or ``.mcap`` file.
        out: HTML file; by default ``report.html`` in the folder of the bag.
        gif: Draw the animation, and write it as ``gait.gif`` beside the page too.

    Returns:
        The HTML file.

    Raises:
        MissingFileError: There is no such bag, or the page cannot be written.
        BagError: The bag is not a run of loco.
    """
    bag = bag if isinstance(bag, Bag) else Bag(bag)
    out = bag.folder / "report.html" if out is None else Path(out)
    if out.is_dir():
        out = out / "report.html"
    make = _page_of(bag)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with style():
            text = make(out.parent / GIF if gif else None)
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise MissingFileError(f"cannot write the report to {out}: {error.strerror}") from None
    return out


def _page_of(bag: Bag) -> Callable[[Path | None], str]:
    """Function that makes the page which suits what ran, given where the animation goes."""
    from . import live_report, live_run

    if live_run.is_live(bag):
        return lambda gif: live_report.page(live_run.read_live(bag))
    from . import msd_report

    if msd_report.is_msd(bag):
        return partial(msd_report.page, bag, msd_report.read_msd_log(bag))
    if is_joint(bag):
        from .joint_report import page as joint_page

        return partial(joint_page, bag, read_joint_log(bag))
    return partial(page, bag, read_log(bag))


def page(bag: Bag, log: Log, gif: Path | None) -> str:
    """HTML text of a report; `gif` is where the animation goes, None for none."""
    values, check = metrics.table(log), checked(bag, log)
    parts = [
        part("Animation", lambda: animation(log, gif)),
        *(
            part(c.title, lambda c=c: picture(svg(c.draw(log)), c.title, c.text))
            for c in figures.CHAPTERS
        ),
        part("Who drives hips and knees", lambda: driver(check)),
        part("Metrics", lambda: METRICS_TEXT + tables.metric_table(log, values), long=True),
        part("Effects", lambda: tables.effect_table(log)),
        part("Configuration", lambda: configuration(log), long=True),
        part("Messages", lambda: tables.message_table(bag)),
    ]
    template = resources.files(__package__).joinpath("report_template.html").read_text("utf-8")
    return Template(template).substitute(
        title=escape(log.experiment.name),
        header=header(bag, log, values, check),
        contents=" ".join(f'<a href="#{p.anchor}">{p.title}</a>' for p in parts),
        sections="\n".join(p.html for p in parts),
    )


@dataclass(frozen=True)
class Part:
    """One section of the page."""

    title: str
    anchor: str
    html: str


def part(title: str, make: Callable[[], str], long: bool = False) -> Part:
    """Section with what `make` gives, or with the reason why it gives nothing.

    Args:
        title: Heading.
        make: Draws or writes the content.
        long: The section may be broken over printed pages.
    """
    try:
        content = make()
    except LocoError as error:
        content = f'<p class="missing">Not shown: {escape(str(error))}</p>'
    anchor = title.lower().replace(" ", "-").replace(",", "")
    kind = ' class="long"' if long else ""
    html = f'<section id="{anchor}"{kind}><h2>{escape(title)}</h2>\n{content}</section>'
    return Part(escape(title), anchor, html)


def checked(bag: Bag, log: Log) -> ReadoutCheck | LocoError:
    """Result of the readout check, or why it cannot be made."""
    try:
        return check_log(log, weights_of(bag))
    except LocoError as error:
        return error


def header(
    bag: Bag, log: Log, values: dict[str, dict[str, float]], check: ReadoutCheck | LocoError
) -> str:
    """What the run was and how it ended."""
    well, text = tables.ending(log)
    return (
        f'<p class="soft">{escape(log.experiment.description)}</p>'
        f'<p class="verdict{"" if well else " bad"}">{escape(text)}</p>'
        f"{tables.cards(log, values)}{tables.facts(bag, log, check)}"
    )


def animation(log: Log, path: Path | None) -> str:
    """The last strides as a GIF, written to `path` and put into the page."""
    from loco_sim.render import render_gif

    if path is None:
        raise BagError("the animation was left out on request")
    log = motion.posed(log).cut(figures.whole_strides(log))
    data = render_gif(
        path,
        log.t,
        log.truth.position,
        log.truth.orientation,
        log.state.q,
        fps=FPS,
        size=SIZE,
        robot=log.experiment.robot,
    )
    text = f"The robot at the end of the run, {log.t[0]:.2f} s to {log.t[-1]:.2f} s, in real time."
    return f'{image(data, "gif", text, "movie")}<p class="soft">{text}</p>'


def driver(check: ReadoutCheck | LocoError) -> str:
    """Result of the readout check, in words and as a figure."""
    if isinstance(check, LocoError):
        raise check
    return driver_text(check, figures.readout(check), _CHECK)


def driver_text(check: ReadoutCheck, figure: Figure, caption: str) -> str:
    """What a readout check found, with its figure."""
    kind, mark = ("good", "Verified") if check.drives else ("bad", "Not verified")
    text = f'<p><span class="{kind}">{mark}:</span> {escape(check.summary())}.</p>'
    return text + picture(svg(figure), "Readout check", caption)


def configuration(log: Log | JointLog) -> str:
    """The experiment as YAML, folded."""
    text = yaml.safe_dump(to_dict(log.experiment), sort_keys=False, allow_unicode=True)
    return f"<details><summary>Experiment, all values</summary><pre>{escape(text)}</pre></details>"


def picture(data: bytes, title: str, text: str) -> str:
    """A figure with its caption."""
    shown = image(data, "svg+xml", title)
    return f'<p class="soft">{escape(text)}</p><div class="wide">{shown}</div>'


def image(data: bytes, kind: str, text: str, style: str = "") -> str:
    """A picture inside the page."""
    look = f' class="{style}"' if style else ""
    encoded = base64.b64encode(data).decode()
    return f'<img{look} alt="{escape(text)}" src="data:image/{kind};base64,{encoded}">'


_CHECK = (
    "The network of the bag is run again over the recorded forces, without any target. Dots that "
    "lie on the command line, and a distance of 0, mean that nothing but the readout made it."
)
METRICS_TEXT = (
    '<p class="soft">Over all ticks of each phase. “Equation” is that of the thesis, section 3.6; '
    "“ours” has none. A dash: does not apply, or the phase is too short.</p>"
)
