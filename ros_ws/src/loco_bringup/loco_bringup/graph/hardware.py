# SPDX-License-Identifier: Apache-2.0
"""Node set of an experiment with a hardware driver in place of the simulated plant."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

from loco_control.exceptions import MissingPackageError, ParameterError
from loco_sim.hardware import wiring

from .node_set import DRIVER, NodeSpec

_SIMULATED = "loco_sim.ros.joint_sim_node:JointSimNode"


def driven(specs: Sequence[NodeSpec], experiment: Any, file: str, clock: str) -> list[NodeSpec]:
    """Nodes of a set with the driver in place of the simulated plant.

    Args:
        specs: The node set.
        experiment: Experiment to run on the robot.
        file: Wiring file; it is read to check that it matches the robot.
        clock: Clock of the run.

    Raises:
        LocoError: The file does not match the robot, or the experiment cannot run on hardware.
        MissingPackageError: The package for the communication with servos is not installed.
    """
    if _SIMULATED not in [spec.cls for spec in specs]:
        raise ParameterError(
            f"{experiment.name} has no plant of joints that a driver could replace; hardware runs "
            "experiments of the node set joint"
        )
    if clock != "realtime":
        raise ParameterError(f"hardware needs --clock realtime, got {clock}")
    if experiment.effects:
        raise ParameterError(
            f"{experiment.name} lists effects; hardware brings its own: take --set 'effects=[]'"
        )
    wiring.load(file, experiment.plant)
    if find_spec("dynamixel_sdk") is None:
        raise MissingPackageError(
            "dynamixel_sdk is not installed; it comes with `./loco install dynamixel`"
        )
    return [DRIVER if spec.cls == _SIMULATED else spec for spec in specs]
