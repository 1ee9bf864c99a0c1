# SPDX-License-Identifier: Apache-2.0
"""Terminal output of `loco gap --live`: live progress and summary."""

from __future__ import annotations

import argparse

from loco_control.exceptions import ParameterError
from loco_control.params import from_dict

from ..graph.run import default_folder
from ..terminal import bar
from . import calibration as live_calibration
from . import gap as live_gap
from .terminal import show_outcome


def show_live(a: argparse.Namespace) -> int:
    """Find the gap between two running robots; returns the exit code.

    Raises:
        LocoError: An option is wrong or not available in a live search.
    """
    for name in ("bags", "hold_out", "add", "mapping"):
        if getattr(a, name):
            raise ParameterError(f"{name.replace('_', '-')} does not go with --live")
    measured = live_calibration.measured_robot(a.measured)
    params = from_dict(live_calibration.LiveParams, {"speed": a.speed}, "live")
    options = {"seed": a.seed or 0, "effects": a.effects, "free": a.free}
    folder = a.out or default_folder(measured)
    with bar("{task.percentage:3.0f} %", "{task.fields[state]}") as progress:
        task = progress.add_task("starting", total=1.0, state="")

        def tell(p: live_calibration.LiveProgress) -> None:
            gap = f"gap {p.gaps[-1].gap:.3f} rad" if p.gaps else ""
            state = f"{p.sim_time:6.1f} s  {p.found}  {gap}"
            progress.update(task, description=p.phase, completed=p.share, state=state)

        robot = a.robot or measured.plant.name
        outcome = live_gap.find_live(measured, robot, folder, options, params, tell)
    show_outcome("live gap", outcome)
    return outcome.exit_code
