# SPDX-License-Identifier: Apache-2.0
"""`loco report`: write a self-contained HTML page about a bag.

All figures and the animation are embedded; the page has no external references.
A section without data in the bag shows the reason instead.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from loco_control.exceptions import LocoError, MissingFileError

from ..bag.foreign.opening import open_bag
from ..bag.reader import Bag
from ..logs.bag_log import read_log
from ..outcome import file_at
from ..terminal import console
from . import live, network, robot
from .live_log import is_live, read_live

GIF = "gait.gif"


def show_report(a: argparse.Namespace) -> int:
    """Write the report page of a bag and print its path."""
    console.print(str(write_report(a.bag, a.out, gif=not a.no_gif)))
    return 0


def write_report(bag: Bag | str | Path, out: str | Path | None = None, gif: bool = True) -> Path:
    """Write the report page of a recorded run.

    Args:
        bag: Bag folder or ``.mcap`` file.
        out: HTML file, or its folder; default ``report.html`` in the folder of the bag.
        gif: Whether to draw the animation; it is also written as ``gait.gif`` beside the page.

    Returns:
        The HTML file.

    Raises:
        MissingFileError: There is no such bag, or the page cannot be written.
        BagError: The bag is not a run of loco.
    """
    bag = bag if isinstance(bag, Bag) else open_bag(bag)
    out = file_at(out, bag.folder / "report.html")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(page_of(bag, out.parent / GIF if gif else None), encoding="utf-8")
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
