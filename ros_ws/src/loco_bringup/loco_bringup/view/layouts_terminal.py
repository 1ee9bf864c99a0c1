# SPDX-License-Identifier: Apache-2.0
"""`loco view --layouts`: layout files for Foxglove and RViz."""

from __future__ import annotations

import argparse
from importlib.resources import files

from ..terminal import console


def show_layouts(a: argparse.Namespace) -> int:
    """Copy the layouts for Foxglove and RViz to a folder, and print how to open them."""
    a.layouts.mkdir(parents=True, exist_ok=True)
    for source in sorted(files(__package__).joinpath("layouts").iterdir(), key=lambda p: p.name):
        target = a.layouts / source.name
        target.write_bytes(source.read_bytes())
        console.print(str(target))
    console.print("Foxglove: layouts, import from file. RViz: rviz2 -d loco.rviz")
    return 0
