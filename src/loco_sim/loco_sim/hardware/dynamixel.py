# SPDX-License-Identifier: Apache-2.0
"""Driver of a robot with Dynamixel X-series servos on one bus, as a replacement of `Simulation`.

Angles are sent as goal positions with a current limit (operating mode 5), torques as goal
currents (mode 0); one sync read returns current, speed, position and temperature of all servos.
"""

from __future__ import annotations

import contextlib
import termios
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from dynamixel_sdk import COMM_SUCCESS, PacketHandler, PortHandler
from dynamixel_sdk.protocol2_packet_handler import PKT_ERROR, PKT_ID, PKT_PARAMETER0

from loco_control.exceptions import GraphError
from loco_control.types import GroundTruth, RobotState

from ..robot.equipment import GRAVITY
from ..robot.robot import Robot
from ..robot.servo import TorqueDrive
from . import packets as p
from .packets import Register
from .wiring import COUNTS, TURN, BusParams, Wiring

_TRY = 0.2  # time-out of a setting [s]
_FIRST = 3.0  # time-out of the first settings, before any motion [s]
_NAP = 0.0005  # longest wait of the port for bytes between checks of the clock [s]
_LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


class _Port(PortHandler):
    """The SDK's port with its own time-out, which waits for bytes without using processor time."""

    def __init__(self, bus: BusParams, clock: Callable[[], float]):
        super().__init__(bus.port)
        self.baudrate, self._latency = bus.baud, bus.latency
        self._clock, self._overdue = clock, False
        try:
            self.openPort()
            self.ser.exclusive = True
            self.ser.timeout = _NAP
        except (OSError, ValueError) as error:  # includes the errors of pyserial
            raise GraphError(
                f"bus {bus.port} cannot be opened: {error}; check bus.port, its rights, and that "
                "no other program uses it"
            ) from None

    def setPacketTimeout(self, packet_length: int) -> None:
        """Start the time-out for the answer to a packet of a length [bytes]."""
        self.setPacketTimeoutMillis(self.tx_time_per_byte * packet_length + 1e3 * self._latency)

    def getCurrentTime(self) -> float:
        """Time [ms] of a clock that nobody can set."""
        return 1e3 * self._clock()

    def isPacketTimeout(self) -> bool:
        """Whether the time-out had passed before the last read began."""
        return self._overdue

    def readPort(self, length: int) -> bytes:
        """Received bytes, at most `length`; they count however late they are read."""
        self._overdue = super().isPacketTimeout()
        return self._responds(self.ser.read, length)

    def writePort(self, packet: list[int]) -> int:
        """Send bytes; returns their number."""
        return self._responds(self.ser.write, packet)

    def clearPort(self) -> None:
        """Discard received bytes."""
        self._responds(self.ser.reset_input_buffer)

    def _responds(self, function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except (OSError, termios.error) as error:
            self.is_using = False  # or no later packet would be sent, torque off included
            raise GraphError(f"bus {self.port_name} is gone: {error}") from None


class ServoRobot:
    """A robot of servos, with the interface of `Simulation` that plant nodes need.

    The torque is off until the first `drive`.

    Args:
        wiring: Bus and servos.
        robot: Robot driven by the servos.
        clock: Clock of all time-outs [s].

    Attributes:
        robot: The robot.
        fallen: Always None: servos cannot detect a fall.
        rejected: Number of commands refused because they were not finite.
        fault: Reason of the newest reading to stop the robot, or of a failure to switch the torque
            on since the reading before; "" if there is none.
        lost: Number of missing or damaged answers.
        clipped: Number of commands beyond one turn of a servo.

    Raises:
        GraphError: The port cannot be opened, or a servo does not answer or refuses a setting.
    """

    fallen = None

    def __init__(self, wiring: Wiring, robot: Robot, clock: Callable[[], float] = time.monotonic):
        self.robot, self._bus, self._clock = robot, wiring.bus, clock
        self._ids = [s.id for s in wiring.servos]
        self._sign, self._zero, max_current, unit, per_ampere = np.array(
            [
                (s.sign, s.zero, s.current, s.current_unit, s.torque_per_ampere)
                for s in wiring.servos
            ]
        ).T
        self._torque_unit = self._sign * unit * per_ampere  # torque of one count of current [N·m]
        max_current = np.minimum(max_current, np.array(robot.effort) / per_ampere)
        self._max_tries = np.maximum(np.floor(max_current / unit), 1.0)  # counts of current
        self._pure = np.array([isinstance(robot.drives[j], TorqueDrive) for j in robot.joints])
        self.rejected = self.lost = self.clipped = 0
        self.fault, self._failed, self._on = "", "", False
        self._watchdog = max(1, int(self._bus.watchdog / p.WATCHDOG_UNIT))  # counts
        self._last_answer = np.zeros(len(self._ids))  # time of the last answer of each servo [s]
        self._missed = np.ones(len(self._ids), dtype=int)
        self._counts = np.zeros((3, len(self._ids)))  # current, velocity, position
        self._handler = PacketHandler(2.0)
        self._port = _Port(wiring.bus, clock)
        try:
            self._prepare()
        except BaseException:
            self._port.closePort()
            raise

    @property
    def robot_description(self) -> str:
        """URDF of the robot."""
        return self.robot.urdf

    def adc(self) -> Sequence[int]:
        """No raw counts of Hall sensors."""
        return ()

    def ground_truth(self) -> GroundTruth:
        """State of the base, known because it is fixed."""
        place = np.array([0.0, 0.0, self.robot.height])
        return GroundTruth(0, 0.0, place, _LEVEL, np.zeros(3), np.zeros(3))

    def reset(self) -> RobotState:
        """State at tick 0."""
        return self.measure(0, 0.0)

    # ---- once

    def _prepare(self) -> None:
        """Torque off and modes set; every servo has to answer."""
        for servo, pure in zip(self._ids, self._pure, strict=True):
            self._set(servo, p.BUS_WATCHDOG, 0, _FIRST)
            self._set(servo, p.TORQUE_ENABLE, 0, _FIRST)
            mode = p.CURRENT_MODE if pure else p.POSITION_MODE
            self._set(servo, p.OPERATING_MODE, mode, _FIRST)
        end = self._clock() + _FIRST
        while self._missed.any() and self._clock() < end:
            self.measure(0, 0.0)
        if self._missed.any():
            first = self._ids[int(np.argmax(self._missed))]
            raise GraphError(f"{self._name(first)} takes settings but cannot be read")

    def _set(self, servo: int, register: Register, value: int, timeout: float = _TRY) -> None:
        """Write a register and wait for the acknowledgement, at most `timeout` [s]."""
        write = getattr(self._handler, f"write{register.size}ByteTxRx")
        end = self._clock() + timeout
        while True:
            result, error = write(self._port, servo, register.address, value)
            if result == COMM_SUCCESS and not error & ~p.ALERT:
                return
            if self._clock() > end:
                break
        name = self._name(servo)
        if result == COMM_SUCCESS:
            raise GraphError(f"{name} refuses {value} at address {register.address}")
        raise GraphError(
            f"{name} does not answer at {self._bus.port} and {self._bus.baud} bit/s; check its "
            "supply, its cable and its id"
        )

    def _name(self, servo: int) -> str:
        return f"servo {servo} ({self.robot.joints[self._ids.index(servo)]})"

    # ---- each tick

    def measure(self, tick: int, t: float) -> RobotState:
        """Read the servos; a servo that does not answer keeps its last reading.

        Args:
            tick: Tick of the state.
            t: Time of the state [s].

        Returns:
            The state; forces and attitude are those of a fixed base at rest.
        """
        self.fault, self._failed = self._failed, ""
        began, responses = self._clock(), self._responses()
        for i, servo in enumerate(self._ids):
            self._missed[i] = 0 if servo in responses else self._missed[i] + 1
            if servo in responses:
                self._on = self._on and not self._expired(i)
                self._last_answer[i] = began
                self._take(i, *responses[servo])
            else:
                self.lost += 1
                if self._missed[i] >= self._bus.missing:
                    self.fault = f"{self._name(servo)} does not answer"
        q = self._sign * (self._counts[2] - self._zero) * TURN
        dq = self._sign * self._counts[1] * p.VELOCITY_UNIT
        tau, feet = self._torque_unit * self._counts[0], len(self.robot.feet)
        rest = np.zeros(3), np.array([0.0, 0.0, GRAVITY]), np.zeros(feet, dtype=bool)
        return RobotState(tick, t, q, dq, tau, np.zeros((feet, 3)), _LEVEL, *rest)

    def _responses(self) -> dict[int, tuple[bytes, int]]:
        """Data and error by servo number of all that answer one sync read, in any order."""
        size, responses = p.PRESENT.size, {}
        self._handler.syncReadTx(self._port, *p.PRESENT, self._ids, len(self._ids), False)
        while len(responses) < len(self._ids):
            packet, result = self._handler.rxPacket(self._port, False)
            data = bytes(packet[PKT_PARAMETER0 + 1 :][:size])
            if result == COMM_SUCCESS and len(data) == size:
                responses[packet[PKT_ID]] = data, packet[PKT_ERROR]
            elif self._port.isPacketTimeout():
                break
        return responses

    def _expired(self, i: int) -> bool:
        """Whether the watchdog of a servo may have expired, so that it ignores goals."""
        return bool(self._clock() - self._last_answer[i] > self._watchdog * p.WATCHDOG_UNIT)

    def _take(self, i: int, data: bytes, error: int) -> None:
        """Store the answer of one servo."""
        start = p.PRESENT.address
        for row, register in enumerate((p.PRESENT_CURRENT, p.PRESENT_VELOCITY, p.PRESENT_POSITION)):
            value = data[register.address - start :][: register.size]
            self._counts[row, i] = int.from_bytes(value, "little", signed=True)
        temperature, name = data[p.PRESENT_TEMPERATURE.address - start], self._name(self._ids[i])
        if error & p.ALERT:
            self.fault = f"{name} reports {self._alarm(self._ids[i])}"
        elif temperature > self._bus.temperature:
            self.fault = f"{name} is at {temperature} degC, more than {self._bus.temperature:g}"

    def _alarm(self, servo: int) -> str:
        value, result, _ = self._handler.read1ByteTxRx(self._port, servo, p.HARDWARE_ERROR.address)
        errors = [text for bit, text in p.ERRORS.items() if value & bit]
        return " and ".join(errors) if result == COMM_SUCCESS and errors else "a hardware error"

    def drive(self, q: np.ndarray, tau: np.ndarray | None = None) -> None:
        """Send angles, and torques to torque drives; enables the torque.

        Args:
            q: Desired joint positions [rad], (n,).
            tau: Desired torques [N·m], (n,); None for zero.
        """
        tau = np.zeros(len(q)) if tau is None else tau
        if not (np.isfinite(q).all() and np.isfinite(tau).all()):
            self.rejected += 1
            return
        if not self._on:
            self._enable()
        counts = np.round(self._zero + self._sign * q / TURN)
        inside = np.clip(counts, 0, COUNTS - 1)
        self.clipped += bool(np.any((inside != counts) & ~self._pure))
        current = np.clip(np.round(tau / self._torque_unit), -self._max_tries, self._max_tries)
        self._send(p.GOAL_POSITION, inside, ~self._pure)
        self._send(p.GOAL_CURRENT, current, self._pure)

    def _enable(self) -> None:
        """Torque on, at rest; clears expired watchdogs."""
        try:
            for servo, max_counts, pure in zip(self._ids, self._max_tries, self._pure, strict=True):
                self._set(servo, p.BUS_WATCHDOG, 0)
                self._set(servo, p.GOAL_CURRENT, 0 if pure else int(max_counts))
                self._set(servo, p.TORQUE_ENABLE, 1)
                began = self._clock()
                self._set(servo, p.BUS_WATCHDOG, self._watchdog)
        except GraphError as error:
            self.limp()
            self.fault = self._failed = str(error)
        else:
            self._on, self._last_answer[:] = True, began  # a packet reaches every servo

    def limp(self) -> None:
        """Torque off; sent at every call, since it is not acknowledged."""
        self._on = False
        self._send(p.TORQUE_ENABLE, np.zeros(len(self._ids)), np.ones(len(self._ids), dtype=bool))

    def _send(self, register: Register, values: np.ndarray, which: np.ndarray) -> None:
        """Sync write of values to some servos."""
        payload: list[int] = []
        for servo, value in zip(np.array(self._ids)[which], values[which], strict=True):
            payload += [int(servo), *int(value).to_bytes(register.size, "little", signed=True)]
        if payload:
            self._handler.syncWriteTxOnly(self._port, *register, payload, len(payload))

    def close(self) -> None:
        """Torque off, then free the port; calling again does nothing."""
        if not self._port.is_open:
            return
        with contextlib.suppress(GraphError):  # the bus may be disconnected
            self.limp()  # all at once, so that a silent servo does not delay others
        for servo in self._ids:
            for register in (p.TORQUE_ENABLE, p.BUS_WATCHDOG):
                try:
                    self._set(servo, register, 0)
                except GraphError:
                    break  # the next servo may still receive it
        self._port.closePort()
