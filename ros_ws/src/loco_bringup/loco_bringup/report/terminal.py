# SPDX-License-Identifier: Apache-2.0
"""Terminal command `loco report`."""

from __future__ import annotations

import argparse

from ..terminal import console
from .report import write_report


def show_report(a: argparse.Namespace) -> int:
    """Write the report page of a bag and print its path."""
    console.print(str(write_report(a.bag, a.out, gif=not a.no_gif)))
    return 0
