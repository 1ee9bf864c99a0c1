# SPDX-License-Identifier: Apache-2.0
"""Picture of the top of a page of loco, for the docs; needs Debian's chromium.

``.venv/bin/python -m loco_workshop.docs.page_picture PAGE docs/pictures/NAME.png`` with
``PYTHONPATH=tests/workshop``.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

WIDTH = 1200  # of the window [px]
COLOURS = 200  # of the picture


def draw(page: Path, target: Path, top: int = 0, height: int = 540) -> None:
    """Draw a strip of a page as wide as the window.

    Args:
        page: HTML file.
        target: PNG to write.
        top: First row of the page [px].
        height: Height of the strip [px].
    """
    browser = shutil.which("chromium")
    if browser is None:
        sys.exit("chromium is not installed: apt-get install chromium")
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "page.png"
        options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
        options += [f"--window-size={WIDTH},{top + height}", "--virtual-time-budget=4000"]
        command = [browser, *options, f"--screenshot={whole}", page.resolve().as_uri()]
        subprocess.run(command, check=True, capture_output=True, timeout=120)
        strip = Image.open(whole).convert("RGB").crop((0, top, WIDTH, top + height))
    strip.quantize(COLOURS, dither=Image.Dither.NONE).save(target, optimize=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("page", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("--top", type=int, default=0, help="first row of the page [px]")
    parser.add_argument("--height", type=int, default=540, help="height of the strip [px]")
    given = parser.parse_args()
    draw(given.page, given.target, given.top, given.height)
