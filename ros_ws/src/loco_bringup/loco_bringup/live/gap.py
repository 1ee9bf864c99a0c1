# SPDX-License-Identifier: Apache-2.0
"""`loco gap --live`: find what a model lacks against a running robot, over topics.

As `live.calibration`, with the calibrator's action ``find_gap`` in place of ``calibrate``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from loco_learning.runs.experiment import Experiment
from loco_msgs.action import FindGap

from ..graph.run import Helper
from ..report.live_log import MEASURED, MODEL
from . import calibration as live


class GapClient(live.Client):
    """Client of the action ``find_gap``; its options are values of `GapParams`."""

    ACTION, NAME = "FindGap", "find_gap"

    def _goal(self) -> Any:
        options: Mapping[str, Any] = self._options
        return FindGap.Goal(
            measured=f"/{MEASURED}", model=f"/{MODEL}", robot=live.named(self._robot),
            effects=list(options.get("effects", ())), free=list(options.get("free", ())),
            seed=int(options.get("seed", 0)), duration=self._live.listen * self._period,
        )  # fmt: skip

    def _on_feedback(self, message: Any) -> None:
        f, p = message.feedback, self.progress
        p.phase, p.share, p.found = f.stage, f.fraction, f.best


def find_live(
    measured: Experiment,
    robot: str,
    folder: Path,
    options: Mapping[str, Any] | None = None,
    params: live.LiveParams | None = None,
    on_progress: live.Tell = lambda progress: None,
) -> live.LiveOutcome:
    """Find what a model lacks against a running robot, and record both in one bag.

    Args:
        measured: Experiment of the measured robot; the model gets the same excitation.
        robot: Initial model: a robot's name, robot.yaml or model.yaml.
        folder: New folder of the bag.
        options: Values of `GapParams` that differ from their defaults.
        params: Schedule of the live run.
        on_progress: Called about ten times per second; a true return value cancels the search.

    Raises:
        GraphError: A node died or never got ready.
        ParameterError: The excitation has no period, or `folder` holds a bag.
    """
    params = params or live.LiveParams()
    period = live.period_of(measured)
    robots = {
        MEASURED: replace(measured, duration=live.FOREVER),
        MODEL: live.model_of(measured, robot),
    }
    cls = "loco_bringup.live.calibrator:CalibratorNode"
    parameters = {"listen.skip": params.skip * period, **live.folders_of(robot)}
    helper = Helper("calibrator", cls, parameters, "calibration")
    client = GapClient(dict(options or {}), period, robot, params, on_progress)
    return live.run_live(client, robots, folder, params, helper)
