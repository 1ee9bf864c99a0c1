# SPDX-License-Identifier: Apache-2.0
"""A simulated bus of Dynamixel servos on a pseudo terminal, in real time.

The servos act on the simulated robot with the requested effects, so that a driver and its
controllers can be tested without hardware. Transmission takes no time, and temperature rises only
as a fault.

The bus has its own clock. It follows the wall clock as far as the processor allows, and advances by
at most a few milliseconds between two reads of the line.
"""

from __future__ import annotations

import os
import pty
import select
import time
import tty
from collections.abc import Callable, Sequence

import numpy as np

from loco_control.types import MotionCommand, TrunkTorque

from ..effects.base import Effect
from ..plant.simulation import Simulation
from ..robot.robot import Robot
from ..robot.servo import TorqueDrive
from . import packets as p
from .packets import Packet, Register
from .wiring import TURN, JointServo, Wiring

_MEMORY = 256  # memory of a servo [bytes]
_EEPROM = 64  # registers below are locked while the torque is on
_CHECK_PERIOD = 0.005  # most time of the bus between two reads of the line [s]
_LAG = 0.1  # a longer standstill of the host is not made up [s]
_WARM, _HOT = 35, 85  # [degC]
_OVERHEATING = 0x04


class _Servo:
    """Memory of one servo."""

    def __init__(self, wired: JointServo):
        self.wired, self.memory, self.muted = wired, bytearray(_MEMORY), False
        self.put(p.OPERATING_MODE, 3)
        self.put(p.PRESENT_TEMPERATURE, _WARM)

    def put(self, register: Register, value: int) -> None:
        data = (value % (1 << 8 * register.size)).to_bytes(register.size, "little")
        self.memory[register.address : register.address + register.size] = data

    def get(self, register: Register) -> int:
        data = self.memory[register.address : register.address + register.size]
        return int.from_bytes(data, "little", signed=register.size > 1)

    def sense(self, q: float, dq: float, tau: float) -> None:
        """Store the state of the joint in the registers [rad, rad/s, N·m]."""
        w = self.wired
        self.put(p.PRESENT_POSITION, round(w.zero + w.sign * q / TURN))
        self.put(p.PRESENT_VELOCITY, round(w.sign * dq / p.VELOCITY_UNIT))
        self.put(p.PRESENT_CURRENT, round(w.sign * tau / (w.torque_per_ampere * w.current_unit)))

    @property
    def alert(self) -> int:
        """Alert bit of the answers: set after a hardware error."""
        return p.ALERT if self.get(p.HARDWARE_ERROR) else 0

    @property
    def goal(self) -> float:
        """Joint angle of the goal position [rad]."""
        return self.wired.sign * (self.get(p.GOAL_POSITION) - self.wired.zero) * TURN

    @property
    def torque(self) -> float:
        """Joint torque of the goal current [N·m]."""
        w = self.wired
        return w.sign * self.get(p.GOAL_CURRENT) * w.current_unit * w.torque_per_ampere

    def write(self, address: int, data: bytes) -> int:
        """Write registers; returns the error, 0 for none."""
        on = self.get(p.TORQUE_ENABLE)
        if address < _EEPROM and on:
            return p.BAD_ACCESS
        if address >= p.GOAL_CURRENT.address and self.get(p.BUS_WATCHDOG) == p.EXPIRED:
            return p.BAD_RANGE
        if address == p.TORQUE_ENABLE.address and self.get(p.HARDWARE_ERROR) and data[0]:
            return p.BAD_ACCESS  # a servo that shut down stays off until restarted
        self.memory[address : address + len(data)] = data
        if self.get(p.TORQUE_ENABLE) and not on:
            self.put(p.GOAL_POSITION, self.get(p.PRESENT_POSITION))
        return 0

    def bark(self) -> None:
        """Expire the watchdog: hold the present position."""
        self.put(p.BUS_WATCHDOG, p.EXPIRED)
        self.put(p.GOAL_POSITION, self.get(p.PRESENT_POSITION))
        if self.get(p.OPERATING_MODE) == p.CURRENT_MODE:
            self.put(p.GOAL_CURRENT, 0)


class SimulatedBus:
    """Servos of a robot on a pseudo terminal.

    Args:
        wiring: Servos of the robot.
        robot: Robot driven by the servos.
        effects: Departures from the ideal robot, such as friction.
        seed: Seed of the effects and of the faults.

    Attributes:
        port: Path of the terminal, for a driver.
        lost: Share of packets to and from the servos that are lost, 0 to 1.
        garbled: Share of answers with a wrong byte, 0 to 1.
        time: Time of the bus [s].
    """

    def __init__(self, wiring: Wiring, robot: Robot, effects: Sequence[Effect] = (), seed: int = 0):
        self._sim = Simulation(robot.sim, effects, seed, 1.0 / robot.sim.physics_rate, robot)
        self._state = self._sim.reset()
        self._effort = np.array(robot.effort, dtype=float)
        self._pure = np.array([isinstance(robot.drives.get(j), TorqueDrive) for j in robot.joints])
        self._servos = {servo.id: _Servo(servo) for servo in wiring.servos}
        self._sense()
        self._parser, self._rng = p.Parser(), np.random.default_rng(seed)
        self.lost = self.garbled = 0.0
        self.time = self._packet_at = 0.0
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)

    def silence(self, servo: int, muted: bool = True) -> None:
        """Disconnect a servo, so that it has no answers and no torque, or connect it again."""
        self._servos[servo].muted = muted
        self._servos[servo].put(p.TORQUE_ENABLE, 0)

    def overheat(self, servo: int) -> None:
        """Shut a servo down by an overheating error."""
        hot = self._servos[servo]
        hot.put(p.PRESENT_TEMPERATURE, _HOT)
        hot.put(p.HARDWARE_ERROR, _OVERHEATING)
        hot.put(p.TORQUE_ENABLE, 0)

    @property
    def torques(self) -> dict[int, bool]:
        """Whether the torque is on, by servo."""
        return {number: bool(s.get(p.TORQUE_ENABLE)) for number, s in self._servos.items()}

    @property
    def angles(self) -> np.ndarray:
        """True joint positions [rad], (n,)."""
        return self._sim.true_q

    def serve(self, is_done: Callable[[], bool]) -> None:
        """Answer and simulate in real time until `is_done` returns True.

        Args:
            is_done: Function called every few milliseconds.
        """
        zero = time.monotonic() - self.time  # wall time at bus time 0 [s]
        while not is_done():
            lag = time.monotonic() - zero - self.time
            zero += max(0.0, lag - _LAG)
            if select.select([self._master], [], [], max(0.0, _CHECK_PERIOD - lag))[0]:
                for packet in self._parser.feed(os.read(self._master, 4096)):
                    os.write(self._master, self._answer(packet))
            self.time += min(time.monotonic() - zero - self.time, _CHECK_PERIOD)
            while (self._state.tick + 1) * self._sim.dt <= self.time:
                self._step()
            self._watch()

    def close(self) -> None:
        """Free the terminal and the engine."""
        os.close(self._master)
        os.close(self._slave)
        self._sim.close()

    # ---- the robot

    def _step(self) -> None:
        servos = self._servos.values()
        on = np.array([bool(s.get(p.TORQUE_ENABLE)) for s in servos])
        tau = np.array([s.torque for s in servos])
        self._sim.limit(on * np.minimum(self._effort, np.where(self._pure, np.inf, np.abs(tau))))
        goal = np.array([s.goal for s in servos])
        stamp = self._state.tick, self._state.t
        command = MotionCommand(*stamp, goal, 0.0 * goal)
        feet = np.ones(len(self._sim.robot.feet), dtype=bool)
        trunk = TrunkTorque(*stamp, self._pure * on * tau, np.zeros(6), feet)
        self._state = self._sim.step(command, trunk)
        self._sense()

    def _sense(self) -> None:
        rows = zip(self._sim.true_q, self._sim.true_dq, self._state.tau, strict=True)
        for servo, row in zip(self._servos.values(), rows, strict=True):
            servo.sense(*row)

    def _watch(self) -> None:
        for servo in self._servos.values():
            timeout = servo.get(p.BUS_WATCHDOG)
            if 0 < timeout < p.EXPIRED and self.time - self._packet_at > timeout * p.WATCHDOG_UNIT:
                servo.bark()

    # ---- the protocol

    def _answer(self, packet: Packet) -> bytes:
        """Bytes of the answers of all servos to one packet."""
        if not packet.is_valid or self._rng.random() < self.lost:
            return b""
        self._packet_at = self.time
        responses = []
        for answer in self._execute(packet):
            if self._rng.random() < self.lost:
                continue
            if self._rng.random() < self.garbled:
                answer = answer[:-3] + bytes([answer[-3] ^ 0x10]) + answer[-2:]
            responses.append(answer)
        return b"".join(responses)

    def _execute(self, packet: Packet) -> list[bytes]:
        data, kind = packet.parameters, packet.instruction
        if kind == p.SYNC_READ:
            address, size = _bytes(data)
            return [self._read(n, address, size) for n in data[4:] if self._responds(n)]
        if kind == p.SYNC_WRITE:
            address, size = _bytes(data)
            for at in range(4, len(data), size + 1):
                if self._responds(data[at]):
                    self._servos[data[at]].write(address, data[at + 1 : at + 1 + size])
            return []
        if not self._responds(packet.id):
            return []
        if kind == p.READ:
            return [self._read(packet.id, *_bytes(data))]
        if kind == p.WRITE:
            servo = self._servos[packet.id]
            error = servo.write(int.from_bytes(data[:2], "little"), data[2:])
            return [p.status(packet.id, error | servo.alert)]
        return []

    def _responds(self, number: int) -> bool:
        return number in self._servos and not self._servos[number].muted

    def _read(self, number: int, address: int, size: int) -> bytes:
        servo = self._servos[number]
        return p.status(number, servo.alert, bytes(servo.memory[address : address + size]))


def _bytes(data: bytes) -> tuple[int, int]:
    """Address and size at the beginning of the parameters of a read instruction."""
    return int.from_bytes(data[:2], "little"), int.from_bytes(data[2:4], "little")
