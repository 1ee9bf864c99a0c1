# SPDX-License-Identifier: Apache-2.0
"""Base class of plant nodes, which control the sequence of ticks.

A plant node publishes the state of tick k, waits for the commands of tick k, steps one control
period and publishes the state of tick k+1. Hardware drivers are plant nodes, too: clocks,
limits, time-outs and the emergency stop are the same.
"""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Callable
from typing import Any, ClassVar

from std_msgs.msg import UInt64

from loco_control.exceptions import GraphError
from loco_control.pacing import Deadlines
from loco_control.ros.endpoints import strangers
from loco_control.ros.join import TickJoin, loco_tick
from loco_control.ros.messages.topics import LOST_TICK
from loco_control.ros.node import LocoNode
from loco_control.ros.parameters import declare
from loco_control.types import MotionCommand, RobotState, TrunkTorque
from loco_msgs.msg import Event, RecorderStatus

from ..params import CLOCKS, TickParams
from ..plant.fallback import Fallback, FallbackParams
from ..plant.safety import Safety, SafetyParams
from ..plant.simulation import Simulation
from .estop import EmergencyStop, Heartbeat

__all__ = ["CLOCKS", "PlantNode", "TickParams"]

FIRST = 2  # first ticks of clock realtime, which wait for commands while kernels are loaded
START_TIMEOUT = 1.0  # longest wait of the first ticks [s]
GRACE = 1.0  # time for a valid command after an unreadable one, perhaps of another graph [s]
CHECK_PERIOD = 1.0  # period of checks for other writers, which may displace messages [s]
GRACE_PERIOD = 10.0  # time after the end of another writer in which ticks may be lost [s]
SAFE_STEP_PERIOD = 0.1  # wall time between steps in the safe state while a controller restarts [s]


class PlantNode(LocoNode):
    """Base of plant nodes, which create `sim`, publish states and receive commands.

    Attributes:
        controllers: Nodes that must be ready before the first tick, this one included.
        margins: Default margins of `plant.safety`.
        sim: The plant.
        state: Last measurement.
        started: Whether the first tick has been published.
    """

    controllers: ClassVar[tuple[str, ...]] = ()
    margins: ClassVar[SafetyParams] = SafetyParams()
    sim: Simulation
    state: RobotState
    _join: TickJoin

    def __init__(self, rate: float) -> None:
        super().__init__("robot_sim")
        self.rate = self.declare_parameter("control_rate", rate).value
        self.tick = declare(self, TickParams())
        self.timed = self.tick.clock == "realtime"
        self._limits = declare(self, self.margins, "safety.")
        self._stages = declare(self, FallbackParams(), "fallback.")

    def _connect(self) -> None:
        """Subscribe to events and recorder; to be called after creating all outputs."""
        self._last = round(self.tick.duration * self.rate) if self.tick.duration else None
        self._waiting_for = set(self.controllers) | ({"recorder"} if self.recorded else set())
        if self.faulted:
            self._waiting_for.add(LOST_TICK.writer)
            receive = self.reader(LOST_TICK.name, LOST_TICK.type, self._on_lost)
            self.create_subscription(
                LOST_TICK.type, LOST_TICK.name, receive, LOST_TICK.qos.reader(), raw=True
            )
        self._recorder_tick = -1
        self._held: RobotState | None = None
        self.started = self._has_ended = False
        self._safe_timer: Any = None  # timer, while a controller restarts
        self._reported = (0, 0, 0)  # ticks, late ticks, refused commands at the last report
        self._late, self._published, self._began = 0, -1, time.perf_counter()
        self._deadlines: Deadlines | None = None  # used by clock realtime
        self._is_silent = False
        self._looked_at, self._other_writer_at = -1, -math.inf  # tick of last check; time [s]
        self._unreadable = -1, ""  # tick and error of an unreadable command
        self._grace: Any = None  # timer, while a valid one may still arrive
        self._commands: tuple[MotionCommand, TrunkTorque | None] | None = None  # newest commands
        self._estop = EmergencyStop(self, self._on_estop)
        self._heartbeat = Heartbeat(self, self.tick.heartbeat, self._estop.engage)
        self._make_safety()
        self.input("events", self._on_event)
        self.input("recorder_status", self._on_recorder)
        self.create_timer(CHECK_PERIOD, self._look_beside)

    def _make_safety(self) -> None:
        """Create the limits and the safe state of the current robot."""
        robot = getattr(self.sim, "robot", None)
        is_limited = robot is not None and self._limits.enabled
        self._safety = Safety(robot, self._limits, 1.0 / self.rate) if is_limited else None
        self._fallback = Fallback(robot, self._stages, 1.0 / self.rate)

    def send(self, state: RobotState) -> None:
        """Publish the state of a tick and the accompanying messages."""
        raise NotImplementedError

    def advance(self, command: MotionCommand, trunk: TrunkTorque | None) -> RobotState:
        """Advance the plant by one control period."""
        return self.sim.step(command, trunk)

    def listen(
        self, readers: dict[str, Any], step: Callable, tick_of: Callable = loco_tick
    ) -> None:
        """Subscribe to commands; stale and invalid ones are counted.

        Args:
            readers: Readers, as in `join_by`.
            step: Step, as in `join_by`.
            tick_of: Tick of a message, as in `join_by`; `newest` has the same unit.
        """
        self._join = self.join_by(readers, step, tick_of, self.newest, self._reject)

    def newest(self) -> int:
        """Newest published tick, which a command may answer; -1 before the first."""
        return self.state.tick if self.started else -1

    # ---- start

    def _on_event(self, event: Event) -> None:
        if event.kind != "ready":
            return
        if self.started and event.node in self.controllers:
            self._resume(event.node)
        if not self._waiting_for:
            return
        self._waiting_for.discard(event.node)
        if not self._waiting_for:
            self._start()

    def _start(self) -> None:
        self.state, self.started = self.sim.reset(), True
        self._began = self._paced_at = time.perf_counter()
        self.event("started", f"clock {self.tick.clock}", 0, 0.0)
        self._patient_until = time.monotonic() + START_TIMEOUT
        self._heartbeat.start()
        self._publish(self.state)

    def _resume(self, node: str) -> None:
        """Resume after the restart of a controller, which has not received the current tick.

        Ticks are stepped in the safe state at intervals, in which endpoints are matched, until
        commands arrive.
        """
        self.event("resumed", f"{node} is back", self.state.tick, self.state.t)
        if not self.timed and self._safe_timer is None:
            self._stuck_at = self.state.tick
            self._safe_timer = self.create_timer(SAFE_STEP_PERIOD, self._step_safely)

    def _step_safely(self) -> None:
        if self._has_ended or self.state.tick > self._stuck_at + 1:
            self._safe_timer.cancel()
            self._safe_timer = None
        elif self._held is None:
            self._stuck_at = self.state.tick
            self._arrive(self.advance(*self._safe()))

    # ---- one tick

    def _on_commands(self, command: MotionCommand, trunk: TrunkTorque | None) -> None:
        if self._deadlines:
            self._commands = (command, trunk)
        elif self.timed and command.tick >= FIRST:
            self._commands = (command, trunk)
            self._start_run()
        elif not self._has_ended and command.tick == self.state.tick:
            self._commands = (command, trunk)
            self._step(command.tick)

    def _reject(self, reason: str) -> None:
        """Treat an invalid command as missing; `reason` is "" unless its form is wrong."""
        if not reason and self._join.done == self.newest():
            self._on_lost(UInt64(data=self.state.tick))
        elif reason and self._grace is None and self.started:
            self._unreadable = self.state.tick, reason
            self._grace = self.create_timer(GRACE, self._judge_unreadable)

    def _judge_unreadable(self) -> None:
        """End the run if no valid command replaced an unreadable one.

        Raises:
            GraphError: The controller sends unreadable commands.
        """
        self._grace.cancel()
        self._grace = None
        tick, reason = self._unreadable
        replaced = self._commands is not None and self._commands[0].tick >= tick
        if not (replaced or self._has_ended or self._strangers()):
            self.event("error", reason, *self.stamp())
            raise GraphError(reason)

    def _on_lost(self, lost: UInt64) -> None:
        """Handle a lost tick, which gets no command: step now, except with clock realtime."""
        if self.started and not self.timed and not self._has_ended:
            self._step(lost.data)

    def _look_beside(self) -> None:
        """Step a tick whose messages were displaced by another writer from queues of length one.

        Otherwise lockstep would wait forever. A controller may take any time to answer, so this
        is done only if there is, or recently was, another writer.
        """
        if any(self._has_stranger(row.name) for row in self.table.values() if row.paced):
            self._other_writer_at = time.monotonic()
        waited = self.started and self._looked_at == self.state.tick
        if waited and not self.timed and time.monotonic() - self._other_writer_at < GRACE_PERIOD:
            self._on_lost(UInt64(data=self.state.tick))
        self._looked_at = self.stamp()[0]

    def _has_stranger(self, name: str) -> bool:
        name = self.resolve_topic_name(name)
        return self.count_publishers(name) > 1 and bool(strangers(self, name, self._host()))

    def stamp(self) -> tuple[int, float]:
        """Tick and simulated time [s]."""
        return (self.state.tick, self.state.t) if self.started else (0, 0.0)

    @property
    def deadline(self) -> float:
        """Time at which the next tick is due in clock realtime [s]."""
        if not self.timed or not self.started or self._has_ended:
            return math.inf
        return self._deadlines.next if self._deadlines else self._patient_until

    def on_deadline(self) -> None:
        """Step the due ticks in clock realtime, with the newest commands."""
        if self._deadlines is None:
            self._start_run()
        for _ in range(self._deadlines.due()):
            if not self._has_ended:
                self._step(self.state.tick)

    def _start_run(self) -> None:
        self._began = time.perf_counter() - self.state.t
        self._deadlines = Deadlines(self.rate, self.tick.catch_up)

    def _step(self, tick: int) -> None:
        """Step the current tick; does nothing for other ticks."""
        if tick == self.state.tick and self._held is None:
            self._arrive(self.advance(*self._order()))

    def _order(self) -> tuple[Any, Any]:
        """Arguments of `advance`: the newest commands, or the safe state if they are too old.

        To be called once in each tick.
        """
        tick = self.state.tick
        last = self._commands[0].tick if self._commands else -1
        self._late += last < tick
        is_silent = (tick - last) / self.rate > self.tick.command_timeout
        if is_silent and self._commands and self.tick.late == "safe-stop":
            self._estop.engage(f"no command since tick {last}")
        if is_silent != self._is_silent and self._commands:
            text = "no command since tick" if is_silent else "commands are back at tick"
            self.event("timeout", f"{text} {last}", *self.stamp())
        self._is_silent = is_silent
        if self._estop.reason or is_silent or not self._commands:
            return self._safe()
        self._fallback.reset()
        command, trunk = self._commands
        return self._safety.limit(command, trunk) if self._safety else (command, trunk)

    def _safe(self) -> tuple[Any, Any]:
        """Arguments of `advance` in the safe state; also limits the rate of the next command."""
        if self._safety:
            self._safety.resume(self.state)
        return self.safe_command()

    def safe_command(self) -> tuple[Any, Any]:
        """Arguments of `advance` in the safe state."""
        return self._fallback.command(self.state)

    def _on_estop(self, kind: str, text: str) -> None:
        self.event(kind, text, *self.stamp())

    def _arrive(self, state: RobotState) -> None:
        """Handle the new state after a tick: check it, and publish it or end the run."""
        self.state = state
        if self._safety and (reason := self._safety.trip(self.state)):
            self._estop.engage(reason)
        if self._over():
            return
        if self.recorded and self.tick.clock == "lockstep" and self._lags(self.state):
            self._held = self.state  # published when the recorder has caught up
            return
        self._publish(self.state)

    def _over(self) -> bool:
        """Whether the run ends; the last state is not published, since it is not answered."""
        s, fall_reason = self.state, self.sim.fallen
        if fall_reason and self.tick.stop_on_fall:
            self.event("fall", fall_reason, s.tick, s.t)
            self._end_run(f"fell at {s.t:.2f} s: {fall_reason}")
        elif self._last is not None and s.tick >= self._last:
            self._end_run(self.end_text())
        return self._has_ended

    def end_text(self) -> str:
        """Message at the end of the run."""
        return f"{self.state.t:.1f} s simulated"

    def _lags(self, state: RobotState) -> bool:
        return state.tick - self._recorder_tick > self.tick.flow_window

    def _on_recorder(self, status: RecorderStatus) -> None:
        if status.tick > self.stamp()[0]:
            self.refuse("recorder_status", f"tick {status.tick} has not come yet")
            return
        # A recorder never goes back: a lower tick comes from another publisher, directly or through
        # the recorder. A plant that is held would send no tick by which the recorder could mend it.
        self._recorder_tick = max(self._recorder_tick, status.tick)
        if self._held is not None and not self._lags(self._held):
            state, self._held = self._held, None
            self._publish(state)

    def _publish(self, state: RobotState) -> None:
        self._pace()
        self._published = state.tick
        self.send(state)

    def _pace(self) -> None:
        if self.tick.clock != "lockstep" or not self.tick.speed:
            return
        self._paced_at += 1.0 / (self.rate * self.tick.speed)
        time.sleep(max(0.0, self._paced_at - time.perf_counter()))

    def _end_run(self, text: str) -> None:
        self._has_ended = True
        self.publish_diagnostics()
        self.event("finished", text, self._published, self.state.t)
        if self.tick.leave:  # other nodes receive the end before the process exits
            self.create_timer(1.0, lambda: signal.raise_signal(signal.SIGINT))

    # ---- reports

    def diagnose(self) -> dict[str, Any]:
        """Simulated time, real-time factor, late ticks and rejected commands."""
        if not self.started:  # a driver that approaches its standing posture waits for no command
            waits = ", ".join(sorted(self._waiting_for))
            return {"waiting for nodes": waits} if waits else {"silence": 0.0}
        wall = time.perf_counter() - self._began
        n_rejected = self._join.refused + self.sim.rejected
        counts = (self.state.tick, self._late, n_rejected)
        ticks, late, rejected = (a - b for a, b in zip(counts, self._reported, strict=True))
        self._reported = counts
        values: dict[str, Any] = {"silence": 0.0} if self._has_ended else {}
        if self._estop.reason:
            values["estop"] = self._estop.reason
        if self._safety:
            values |= {f"limited_{kind}": n for kind, n in self._safety.limited.items()}
        return values | {
            "tick": self.state.tick,
            "sim_time": self.state.t,
            "real_time_factor": self.state.t / wall if wall > 0 else 0.0,
            "late_ticks": self._late,
            "stale_commands": self._join.stale,
            "rejected_commands": n_rejected,
            "late_share": late / ticks if ticks else 0.0,
            "rejected": rejected,
            "clock": self.tick.clock,
            **(self._deadlines.report() if self._deadlines else {}),
        }

    def close(self) -> None:
        """Release the engine."""
        self.sim.close()
