# SPDX-License-Identifier: Apache-2.0
"""Search for gaits of legged robots with a trunk controller: HyQ's foot trajectory generator.

Commanded speed, stride frequency, duty factor and step height are searched for the highest
forward speed of a rollout, each within a range relative to the nominal gait of the robot's size.
The value of a rollout is that of `search.judge`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from loco_control.gait.generator import GaitParams

from ..runs.experiment import load
from ..runs.log import Log
from ..runs.rollout import rollout
from .search import LEGGED, GaitProblem, GaitSearchParams

OPEN_LOOP = "hyq_trot_open"  # the experiment whose gait is modified
SHARES = {  # factors on the nominal gait for the robot's size
    "speed": (0.0, 4.0),
    "frequency": (0.6, 1.6),
    "duty_factor": (0.7, 1.4),
    "step_height": (0.3, 1.6),
}


class LeggedProblem(GaitProblem):
    """Objective of a search for `population.minimise`.

    Args:
        params: Aim of the search and its bodies; `frequency` is ignored, since it is searched.
        start: Initial parameters by name; default the nominal gait for the robot's size.

    Raises:
        LocoError: The robot has no legs, or an initial parameter is out of bounds.
        NameUnknownError: `start` has a parameter that is not searched.
    """

    def __init__(self, params: GaitSearchParams, start: dict[str, float] | None = None):
        self.params, self.pattern = params, LEGGED[params.gait]
        self._nominal = experiment(params.robot, {"duration": params.duration})
        self._gait = self._nominal.gait.replace(pattern=self.pattern)
        usual = {name: float(getattr(self._gait, name)) for name in SHARES}
        bounds = {name: (a * usual[name], b * usual[name]) for name, (a, b) in SHARES.items()}
        self._search(bounds, usual, start or {})

    def target(self, x: np.ndarray) -> GaitParams:
        """Gait of searched parameters x, (4,)."""
        return self._gait.replace(**dict(zip(self.names, map(float, x), strict=True)))

    def run(self, target: GaitParams, body: dict[str, Any]) -> Log:
        """Log of one rollout."""
        overrides = {**self._nominal.overrides, **body}
        return rollout(self._nominal.replace(gait=target, overrides=overrides))


def problem_of(gait: str) -> type[GaitProblem]:
    """Class of the objective for a gait."""
    return LeggedProblem if gait in LEGGED else GaitProblem


def experiment(robot: str, changes: dict[str, Any] | None = None) -> Any:
    """Experiment in which a robot walks with its trunk controller and without learning."""
    return load(OPEN_LOOP, {"robot": robot, **(changes or {})})
