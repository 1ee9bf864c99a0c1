# SPDX-License-Identifier: Apache-2.0
"""Node `robot_sim` for hardware: the plant node of a robot of servos.

Clock, limits, time-outs, heartbeat and emergency stop are those of every plant node. The safe
state has no torque, and a command is sent to the bus as soon as it is received.
"""

from __future__ import annotations

import json
from typing import Any, ClassVar

from loco_control.exceptions import ParameterError
from loco_control.ros.executor import entry
from loco_control.types import MotionCommand, RobotState, TrunkTorque

from ..hardware import wiring
from ..hardware.dynamixel import ServoRobot
from ..plant import model as models
from ..plant.safety import SafetyParams
from .joint_plant_node import JointPlantNode

FASTEST = 1.5  # peak speed / mean speed of a smooth step


class DriverNode(JointPlantNode):
    """Driver node of a robot of Dynamixel servos with a fixed base.

    Attributes:
        sim: The robot, with the interface of `Simulation`.
    """

    margins: ClassVar[SafetyParams] = SafetyParams(
        velocity=1.0, rate=4.0, torque=1.0, overspeed=1.5, power=1.0
    )

    def __init__(self) -> None:
        super().__init__(100.0)
        if self.tick.clock != "realtime":
            raise ParameterError(
                f"hardware has the clock realtime, got {self.tick.clock}; take --clock realtime"
            )
        self.tick = self.tick.replace(catch_up=1)  # missed ticks cannot be executed later
        overrides = json.loads(self.declare_parameter("overrides", "{}").value)
        base = models.load_any(self.declare_parameter("robot", "servo_pendulum").value)
        robot = base.make_robot(overrides)
        wired = wiring.load(self.declare_parameter("hardware", "").value, robot)
        self.sim = ServoRobot(wired, robot)
        self._speed = wired.bus.approach
        self._acted, self._limp, self._dropped = -1, True, 0
        self._approach_start: Any = None  # initial posture [rad] and ticks done
        self._limited: set[str] = set()
        self._open()

    # ---- before the first tick

    def _start(self) -> None:
        """Move slowly to the standing posture, where experiments begin; then start the ticks."""
        self.event("approach", "to the standing posture", 0, 0.0)
        self._timer = self.create_timer(1.0 / self.rate, self._approach)

    def _approach(self) -> None:
        state = self._measured(0, 0.0)
        standing = self.sim.robot.standing
        if self._estop.reason:
            self.sim.limp()
            self._approach_start = None  # restarts after a reset
            return
        start, k = self._approach_start or (state.q, 0)
        duration = FASTEST * max(abs(standing - start)) / self._speed
        share = min(1.0, (k + 1) / max(1.0, duration * self.rate))
        self.sim.drive(start + share * share * (3.0 - 2.0 * share) * (standing - start))
        self._approach_start = start, k + 1
        if share >= 1.0:
            self._timer.cancel()
            super()._start()
            if self._safety:
                self._safety.resume(self.state)

    # ---- one tick

    def _on_commands(self, command: MotionCommand, trunk: TrunkTorque | None) -> None:
        super()._on_commands(command, trunk)
        if self._deadlines and not self._has_ended and command.tick == self.state.tick:
            self._act()

    def _step(self, tick: int) -> None:
        """End a tick: send its command, if not yet sent, and measure."""
        if tick == self.state.tick:
            self._act()
            self._arrive(self._next())

    def _act(self) -> None:
        """Send the command of this tick, once."""
        if self._acted == self.state.tick:
            return
        self._acted, self._limp = self.state.tick, False
        command, trunk = self._order()
        if self._limp:
            self.sim.limp()
        else:
            self.sim.drive(command.q, None if trunk is None else trunk.tau)
            self._tell_limits()

    def safe_command(self) -> tuple[Any, Any]:
        """Arguments of `advance` in the safe state; no torque when damped or stopped."""
        self._limp = bool(self._estop.reason) or self._fallback.stage == "damp"
        return super().safe_command()

    def _next(self) -> RobotState:
        """State at the beginning of the next tick; missed ticks are skipped."""
        dropped = self._deadlines.dropped if self._deadlines else 0
        tick = self.state.tick + 1 + dropped - self._dropped
        self._dropped = dropped
        return self._measured(tick, tick / self.rate)

    def _measured(self, tick: int, t: float) -> RobotState:
        state = self.sim.measure(tick, t)
        if self.sim.fault:
            self._estop.engage(self.sim.fault)
        return state

    def _on_estop(self, kind: str, text: str) -> None:
        """Torque off at once, regardless of the command of the tick."""
        super()._on_estop(kind, text)
        if self._estop.reason:
            self.sim.limp()

    def _end_run(self, text: str) -> None:
        super()._end_run(text)
        self._limp = True
        self.sim.limp()

    def _tell_limits(self) -> None:
        """Publish an event the first time that a limit has changed a command."""
        counts = {**(self._safety.limited if self._safety else {}), "servo": self.sim.clipped}
        for kind in {k for k, n in counts.items() if n} - self._limited:
            self._limited.add(kind)
            self.event("clipped", f"command brought back to the limit of {kind}", *self.stamp())

    def diagnose(self) -> dict[str, Any]:
        """Values of every plant node, and lost answers of the bus."""
        return {**super().diagnose(), "lost_packets": self.sim.lost, "torque": not self._limp}


main = entry(DriverNode)  # ``ros2 run loco_sim driver``

if __name__ == "__main__":
    main()
