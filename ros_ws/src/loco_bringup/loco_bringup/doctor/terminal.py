# SPDX-License-Identifier: Apache-2.0
"""Terminal output of `loco doctor`."""

from __future__ import annotations

import argparse
import json
import os
import sys

from ..graph import shm
from ..graph.view import GraphObserver
from . import environment
from .environment import Finding
from .graph import MUTE, check_graph

LISTEN_TIMEOUT = 10.0  # second listening time before a running node is called silent [s]


def show_doctor(a: argparse.Namespace) -> int:
    """`loco doctor`: examine environment and graph, and print what is wrong.

    Returns:
        0 if there is no grave finding, else 1.
    """
    if a.clean:
        files, size = shm.clean()
        sys.stderr.write(f"removed {files} files, {size / 1e6:.1f} MB\n")
    findings = examine(a.seconds)
    if a.json:
        rows = [
            {"fault": f.fault, "text": f.text, "remedy": f.remedy, "grave": f.grave}
            for f in findings
        ]
        sys.stdout.write(json.dumps(rows, indent=1) + "\n")
    for f in () if a.json else findings:
        sys.stdout.write(f"{'FAULT' if f.grave else 'note '}  {f.fault}: {f.text}\n")
        sys.stdout.write(f"       {f.remedy}\n")
    if not findings and not a.json:
        sys.stdout.write("nothing is wrong\n")
    return int(any(f.grave for f in findings))


def examine(seconds: float) -> list[Finding]:
    """All findings; the graph is skipped if the environment prevents communication."""
    findings = environment.check_environment(os.environ) + environment.check_messages()
    if findings:
        return findings
    with GraphObserver() as observer:
        view = observer.listen(seconds)
        graph = check_graph(view)
        if any(MUTE in finding.text for finding in graph):  # the machine may just be busy
            view = observer.listen(LISTEN_TIMEOUT, LISTEN_TIMEOUT)
            graph = check_graph(view)
    other_domains = environment.check_elsewhere(os.environ) if not view.reports else []
    return environment.check_shared_memory() + other_domains + graph
