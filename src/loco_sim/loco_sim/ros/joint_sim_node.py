# SPDX-License-Identifier: Apache-2.0
"""Node `robot_sim` of joint robots: joint_command in, joint_states and imu/data out.

The text of a ``model.yaml`` on the topic `model` replaces the plant at the next tick: ticks and
time continue, and the robot restarts at the origin with its current joint positions.
"""

from __future__ import annotations

import dataclasses
import json
import traceback
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from std_msgs.msg import String

from loco_control.exceptions import LocoError, ParameterError
from loco_control.params import from_dict, to_dict
from loco_control.reading import FOLDERS, allowed, parse_yaml
from loco_control.ros.executor import entry
from loco_control.types import MotionCommand, RobotState, TrunkTorque

from ..params import SimParams
from ..plant import model as models
from ..plant.simulation import Simulation, end_text
from ..robot import robot as robots
from .joint_plant_node import JointPlantNode

MOST_MODEL = 100_000  # longest text of a model on the topic [characters]


class JointSimNode(JointPlantNode):
    """Node of the simulated plant, for any robot of `loco_sim.robot.robot`."""

    def __init__(self) -> None:
        super().__init__(100.0)
        self._seed = self.declare_parameter("seed", 0).value
        robot = self.declare_parameter("robot", "tigrillo").value
        self._folders = self.declare_parameter("folders", list(FOLDERS)).value
        overrides = json.loads(self.declare_parameter("overrides", "{}").value)
        effects = json.loads(self.declare_parameter("effects", "[]").value)
        self._sim_changes = json.loads(self.declare_parameter("sim", "{}").value)
        base = models.load_any(robot)
        self._own_files = {Path(name).resolve() for name in (robot, base.robot)}
        model = models.Model(base.robot, {**base.overrides, **overrides}, [*base.effects, *effects])
        self.sim = self._make_sim(model)
        self._from = 0  # tick at the last change of the plant
        self._travelled = self._x = 0.0  # distance before the last change, x since then [m]
        self._open()

    def _make_sim(self, model: models.Model, standing: Any = None) -> Simulation:
        robot = model.make_robot()
        params = from_dict(SimParams, {**to_dict(robot.sim), **self._sim_changes}, "sim")
        return Simulation(
            params, model.make_effects(), self._seed, 1.0 / self.rate, robot, standing
        )

    def _hear(self) -> None:
        self.input("model", self._on_model)
        super()._hear()

    # ---- the plant

    def advance(self, command: MotionCommand, trunk: TrunkTorque | None) -> RobotState:
        """One control period; ticks count from the start of the run."""
        state = self.sim.step(command, trunk)
        if self._from:
            tick = state.tick + self._from
            state = dataclasses.replace(state, tick=tick, t=tick * self.sim.dt)
        return state

    def _on_model(self, message: String) -> None:
        """Replace the plant between two ticks."""
        old = self.sim
        try:
            model = model_of(message.data, self._own_files, self._folders)
            robot = model.make_robot()
            if robot.joints != old.robot.joints or robot.driven.tolist() != (
                old.robot.driven.tolist()
            ):
                raise ParameterError(
                    f"the model is of {robot.name} with joints {', '.join(robot.joints)}; "
                    f"this plant is of {old.robot.name} with {', '.join(old.robot.joints)}"
                )
            self.sim = self._make_sim(model, old.true_q if self.started else None)
        except Exception as error:  # no received text may stop the plant
            if not isinstance(error, LocoError):
                self.get_logger().error(traceback.format_exc())
            reason = str(error) if isinstance(error, LocoError) else f"{type(error).__name__}"
            self.refuse("model", reason)
            self.event("model refused", reason, *self.stamp())
            return
        self._make_safety()
        self._encode()
        self._from = self.stamp()[0]
        self._travelled, self._x = self._travelled + self._x, 0.0
        old.close()
        self._description.publish(String(data=self.sim.robot_description))
        self.event("model loaded", _summary(model), *self.stamp())

    def send(self, state: RobotState) -> None:
        """Publish sensor readings and ground truth with the same stamp."""
        truth = self.sim.ground_truth()
        self._x = truth.position[0]
        self._publish_rows(state, truth)

    def end_text(self) -> str:
        """Message at the end of the run."""
        fixed = self.sim.robot.fixed_base
        return end_text(self.state.t, None if fixed else self._travelled + self._x)


def model_of(text: str, permitted: Collection[Path], folders: Sequence[str]) -> models.Model:
    """Model from the text or path of a ``model.yaml`` received over the network.

    Args:
        text: The text, or one line that ends in ``.yaml``.
        permitted: Robot files given by the operator, to which a model may refer.
        folders: Folders below which other robot and model files must lie.

    Raises:
        LocoError: The model cannot be read, or a path is not below `folders`.
    """
    if "\n" not in text.strip() and text.strip().endswith((".yaml", ".yml")):
        return models.load(allowed(text.strip(), folders, "model"))
    values = parse_yaml(text, "the model", max_size=MOST_MODEL)
    if isinstance(values, dict):
        named = str(values.get("robot"))
        if named not in robots.names() and not _is_one_of(named, permitted):
            values["robot"] = str(allowed(named, folders, "robot"))
        overrides = values.get("overrides")
        for key, value in overrides.items() if isinstance(overrides, dict) else ():
            if isinstance(value, str):  # e.g. the path of a URDF
                raise ParameterError(f"a model on a topic cannot set {key} to the text {value!r}")
    return models.from_values(values, Path("model.yaml"))


def _is_one_of(name: str, permitted: Collection[Path]) -> bool:
    try:
        return Path(name).resolve() in permitted
    except (OSError, ValueError, RuntimeError):  # not a path
        return False


def _summary(model: models.Model) -> str:
    changes = [
        f"{key} {value:.6g}" if isinstance(value, float) else f"{key} {value}"
        for key, value in model.overrides.items()
    ]
    effects = [str(effect.get("name")) for effect in model.effects]
    return ", ".join([model.robot, *changes, *effects])


main = entry(JointSimNode)  # ``ros2 run loco_sim joint_sim``

if __name__ == "__main__":
    main()
