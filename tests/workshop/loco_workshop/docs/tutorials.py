# SPDX-License-Identifier: Apache-2.0
"""Type tutorials as they are printed, each into a new folder, beside busy processes.

    PYTHONPATH=tests/workshop .venv/bin/python -m loco_workshop.docs.tutorials walk --busy 4

Exit code 1: a command of a page failed.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from loco_bringup.graph.processes import _environment
from loco_bringup.terminal import console

ROOT = Path(__file__).resolve().parents[4]
# A file that the text names, with its block, or commands; in the order of the page.
BLOCK = re.compile(r"[Aa]s\s`([\w./]+)`:\n\n```\w+\n(.*?)^```|^```sh\n(.*?)^```", re.S | re.M)


def follow(
    page: Path, folder: Path, changes: Mapping[str, str] | None = None, timeout: float = 280.0
) -> Iterator[str]:
    """Type a page into a folder; yields what each block of commands said.

    Args:
        page: The tutorial.
        folder: Folder in which it is typed; a command `loco` is written there.
        changes: Texts of the page that are replaced, to make it shorter.
        timeout: Longest time of a block of commands [s].

    Raises:
        AssertionError: A command failed.
    """
    text = page.read_text()
    for old, new in (changes or {}).items():
        text = text.replace(old, new)
    (folder / "loco").write_text(
        f'#!/bin/sh\nexec {sys.executable} -m loco_bringup.cli.main "$@"\n'
    )
    (folder / "loco").chmod(0o755)
    for name, content, commands in BLOCK.findall(text):
        if name:
            (folder / name).write_text(content)
            continue
        done = subprocess.run(
            ["bash", "-ec", commands], cwd=folder, capture_output=True, text=True,
            env=_environment(), timeout=timeout,
        )  # fmt: skip
        assert done.returncode == 0, commands + done.stdout + done.stderr
        yield done.stdout


@contextlib.contextmanager
def busy(count: int) -> Iterator[None]:
    """So many processes that only compute, while it lasts."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def type_page(name: str) -> tuple[float, float]:
    """Type ``docs/tutorial_NAME.md`` into a new folder: its wall and processor time [s]."""
    start, before = time.monotonic(), _processor_time()
    with tempfile.TemporaryDirectory() as place:
        (Path(place) / "bags").mkdir()
        (Path(place) / "bags/measured").symlink_to(ROOT / "bags/measured")
        for said in follow(ROOT / f"docs/tutorial_{name}.md", Path(place), timeout=3600.0):
            console.print(said, markup=False, highlight=False)
    return time.monotonic() - start, _processor_time() - before


def _processor_time() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> int:
    """Type the named tutorials; prints the times of each, returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", nargs="+", help="walk, own, log or gap")
    parser.add_argument("--busy", type=int, default=0, help="processes that compute meanwhile")
    a = parser.parse_args()
    rows = []
    for name in a.name:
        try:
            with busy(a.busy):
                wall, processor = type_page(name)
                rows.append(f"| {name} | {wall:.0f} | {processor:.0f} | {os.getloadavg()[0]:.0f} |")
        except AssertionError as error:
            console.print(str(error), markup=False, highlight=False)
            rows.append(f"| {name} | failed | | {os.getloadavg()[0]:.0f} |")
    console.print("| tutorial | wall time [s] | processor time [s] | load |", *rows, sep="\n")
    return int(any("failed" in row for row in rows))


if __name__ == "__main__":
    sys.exit(main())
