# SPDX-License-Identifier: Apache-2.0
"""`loco report`: write a self-contained HTML page about a recording.

All figures and the animation are embedded; the page has no external references.
A section without data in the bag shows the reason instead.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from loco_control.exceptions import LocoError, MissingFileError

from ..bag.foreign.opening import open_bag, result_path
from ..bag.reader import Bag
from ..logs.bag_log import read_log
from ..logs.recording import is_foreign
from ..outcome import file_at
from ..terminal import console
from . import live, network, recorded, robot
from .live_log import is_live, read_live

GIF = "gait.gif"


def show_report(a: argparse.Namespace) -> int:
    """Write the report page of a recording and print its path."""
    written = write_report(a.bag, a.out, gif=not a.no_gif, mapping=a.mapping)
    console.print(str(written))
    return 0


def write_report(
    bag: Bag | str | Path,
    out: str | Path | None = None,
    gif: bool = True,
    mapping: str | Path | None = None,
) -> Path:
    """Write the report page of a run of loco, or of a recording of any program.

    Args:
        bag: Folder of a bag, or file of a bag or table.
        out: HTML file, or its folder; default ``report.html`` in the folder of the bag.
        gif: Whether to draw the animation; it is also written as ``gait.gif`` beside the page.
        mapping: Mapping of the columns of a table, or of the topics of another program.

    Returns:
        The HTML file.

    Raises:
        MissingFileError: There is no such bag, or the page cannot be written.
        LocoError: The recording cannot be read.
    """
    path = bag.path if isinstance(bag, Bag) else Path(bag)
    text = ""
    if not isinstance(bag, Bag) and is_foreign(path):
        text = recorded.page(path, mapping)
    else:
        bag = bag if isinstance(bag, Bag) else open_bag(bag)
        path = bag.folder
    out = file_at(out, result_path(path, "report.html"))
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        text = text or page_of(bag, out.parent / GIF if gif else None)
        out.write_text(text, encoding="utf-8")
    except LocoError:  # first: a MissingFileError is also an OSError
        raise
    except OSError as error:
        raise MissingFileError(f"cannot write the report to {out}: {error.strerror}") from None
    return out


def page_of(bag: Bag, gif: Path | None) -> str:
    """HTML text of the page for this kind of bag.

    Args:
        bag: The bag.
        gif: Path of the animation; None draws no animation.

    Raises:
        BagError: The bag is not a run of loco.
    """
    if is_live(bag):
        return live.page(read_live(bag))
    if network.is_msd(bag):
        return network.page(bag, network.read_msd_log(bag), gif)
    return robot.page(bag, read_log(bag), gif)
