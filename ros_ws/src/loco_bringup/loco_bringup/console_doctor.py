# SPDX-License-Identifier: Apache-2.0
"""`loco doctor` at the terminal."""

from __future__ import annotations

import json
import os
import sys

from . import shm
from .doctor import (
    Finding,
    check_elsewhere,
    check_environment,
    check_messages,
    check_shared_memory,
)


def show_doctor(seconds: float, as_json: bool = False, clean: bool = False) -> int:
    """Examine environment and graph, and print what is wrong.

    Args:
        seconds: How long to listen to the graph [s].
        as_json: Print JSON.
        clean: Remove shared memory of dead processes first.

    Returns:
        0 if nothing grave was found, else 1.
    """
    if clean:
        files, size = shm.clean()
        sys.stderr.write(f"removed {files} files, {size / 1e6:.1f} MB\n")
    found = examine(seconds)
    if as_json:
        rows = [
            {"fault": f.fault, "text": f.text, "remedy": f.remedy, "grave": f.grave} for f in found
        ]
        sys.stdout.write(json.dumps(rows, indent=1) + "\n")
    for f in () if as_json else found:
        sys.stdout.write(f"{'FAULT' if f.grave else 'note '}  {f.fault}: {f.text}\n")
        sys.stdout.write(f"       {f.remedy}\n")
    if not found and not as_json:
        sys.stdout.write("nothing is wrong\n")
    return int(any(f.grave for f in found))


def examine(seconds: float) -> list[Finding]:
    """All findings. The graph is left out if the environment does not let us hear it."""
    found = check_environment(os.environ) + check_messages()
    if found:
        return found
    from .doctor_graph import check_graph
    from .graph_view import Onlooker

    with Onlooker() as onlooker:
        view = onlooker.listen(seconds)
    graph = check_graph(view)
    elsewhere = check_elsewhere(os.environ) if not view.reports else []
    return check_shared_memory() + elsewhere + graph
