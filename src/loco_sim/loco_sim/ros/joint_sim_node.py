# SPDX-License-Identifier: Apache-2.0
"""Node `robot_sim` of joint robots: joint_command in, joint_states and imu/data out.

A ``model.yaml`` as text on the topic `model` replaces the plant at the next tick:
ticks and time go on, the robot starts anew at the origin with the joints as they were.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from std_msgs.msg import Float64MultiArray, String

from loco_control.exceptions import LocoError, ParameterError
from loco_control.params import from_dict, to_dict
from loco_control.ros.codec import Codec
from loco_control.ros.joint_codec import JointCodec, Joints, stamp_ns, tick_of
from loco_control.ros.joint_topics import JOINT_NODES, JOINT_TOPICS
from loco_control.ros.spin import run_nodes
from loco_control.types import GroundTruth, MotionCommand, RobotState, TrunkTorque
from loco_sim import model as models
from loco_sim.joint_commands import JointCommands
from loco_sim.params import SimParams
from loco_sim.ros.plant_node import PlantNode
from loco_sim.ros.tools import encoders
from loco_sim.simulation import Simulation

EACH_TICK = ("joint_states", "imu/data", "ground_truth/odom")  # others wait for the first two
ALONE = ("/tf", "/clock")  # would meet those of other robots


class JointSimNode(PlantNode):
    """PyBullet plant behind standard messages, for any robot that `loco_sim.robot` reads."""

    table = JOINT_TOPICS
    controllers = JOINT_NODES

    def __init__(self) -> None:
        super().__init__(100.0)
        self._seed = self.declare_parameter("seed", 0).value
        robot = self.declare_parameter("robot", "tigrillo").value
        overrides = json.loads(self.declare_parameter("overrides", "{}").value)
        effects = json.loads(self.declare_parameter("effects", "[]").value)
        self._sim_changes = json.loads(self.declare_parameter("sim", "{}").value)
        base = models.load_any(robot)
        model = models.Model(base.robot, {**base.overrides, **overrides}, [*base.effects, *effects])
        self.sim = self._make_sim(model)
        self._from = 0  # tick at the last change of the plant
        self._travelled = self._x = 0.0  # before the last swap, since then [m]
        self._make_outputs()
        self._connect()
        self.input("model", self._on_model)
        self._hear()
        self.announce_ready()

    def _make_sim(self, model: models.Model, standing: Any = None) -> Simulation:
        robot = model.make_robot()
        params = from_dict(SimParams, {**to_dict(robot.sim), **self._sim_changes}, "sim")
        self._commands_of = JointCommands(robot)
        return Simulation(
            params, None, model.make_effects(), self._seed, 1.0 / self.rate, robot, standing
        )

    def _make_outputs(self) -> None:
        joints = self.sim.robot.joints
        names = [*EACH_TICK, *(ALONE if self.get_namespace() == "/" else ())]
        made = encoders(joints)
        self._rows = [(self.raw_output(name), made[name]) for name in names]
        self._description = self.output("robot_description")
        self._description.publish(String(data=self.sim.robot_description))
        counts = self.sim.adc()
        self._adc = self.raw_output("knee_adc") if len(counts) else None
        if self._adc:
            codec = Codec(Float64MultiArray(data=[0.0] * len(counts)))
            self._adc_record = codec.record()

    def _hear(self) -> None:
        robot = self.sim.robot
        driven = [robot.joints[i] for i in robot.driven]
        codec = JointCodec(driven, "joint_command", ("position", "velocity"))
        self.listen({"joint_command": codec}, self._on_joints, stamp_ns)

    # ---- commands

    def _on_joints(self, command: Joints) -> None:
        tick = tick_of(command.time, self.rate)
        self._on_commands(*self._commands_of(tick, tick * self.sim.dt, command.q, command.dq))

    def newest(self) -> int:
        """Stamp of the newest state [ns]."""
        return round(self.state.t * 1e9) if self.started else -1

    # ---- the plant

    def advance(self, command: MotionCommand, trunk: TrunkTorque | None) -> RobotState:
        """One control period; ticks count from the start of the run."""
        state = self.sim.step(command, trunk)
        if self._from:
            tick = state.tick + self._from
            state = dataclasses.replace(state, tick=tick, t=tick * self.sim.dt)
        return state

    def _on_model(self, message: String) -> None:
        """Between two ticks: the next one is that of the new plant."""
        old = self.sim
        try:
            model = model_of(message.data)
            robot = model.make_robot()
            if robot.joints != old.robot.joints or robot.driven.tolist() != (
                old.robot.driven.tolist()
            ):
                raise ParameterError(
                    f"the model is of {robot.name} with joints {', '.join(robot.joints)}; "
                    f"this plant is of {old.robot.name} with {', '.join(old.robot.joints)}"
                )
            self.sim = self._make_sim(model, old.true_q if self.started else None)
        except LocoError as error:
            self.event("model refused", str(error), *self.now())
            return
        self._make_safety()
        self._from = self.now()[0]
        self._travelled, self._x = self._travelled + self._x, 0.0
        old.close()
        self._description.publish(String(data=self.sim.robot_description))
        self.event("model loaded", _words(model), *self.now())

    def send(self, state: RobotState) -> None:
        """Publish sensors and ground truth, all with one stamp."""
        truth: GroundTruth = self.sim.ground_truth()
        self._x = truth.position[0]
        for publish, encode in self._rows:
            publish(encode(state, truth))
        if self._adc:
            self._adc_record["data"] = self.sim.adc()
            self._adc(self._adc_record.tobytes())

    def ending(self) -> str:
        """What a run that came to its end says of itself."""
        fixed = self.sim.robot.fixed_base
        return ending(self.state.t, None if fixed else self._travelled + self._x)


def model_of(text: str) -> models.Model:
    """Model of the text of a ``model.yaml``, or of its path.

    Raises:
        LocoError: As `model.load`.
    """
    if "\n" not in text.strip() and text.strip().endswith((".yaml", ".yml")):
        return models.load(text.strip())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.yaml"
        path.write_text(text, encoding="utf-8")
        return models.load(path)


def _words(model: models.Model) -> str:
    changes = [
        f"{key} {value:.6g}" if isinstance(value, float) else f"{key} {value}"
        for key, value in model.overrides.items()
    ]
    effects = [str(effect.get("name")) for effect in model.effects]
    return ", ".join([model.robot, *changes, *effects])


def ending(t: float, distance: float | None) -> str:
    """Words for a run of t [s] over a distance [m], None for a bench, that came to its end."""
    if distance is None:
        return f"{t:.1f} s simulated"
    return f"{t:.1f} s simulated, {distance:.2f} m forward, no fall"


def main(args: list[str] | None = None) -> None:
    """Entry point of ``ros2 run loco_sim joint_sim``."""
    sys.exit(run_nodes([JointSimNode], args))


if __name__ == "__main__":
    main()
