# SPDX-License-Identifier: Apache-2.0
"""The laws of a plant's tick: when it begins, which command it uses, where the run ends.

What the node says is heard at its door: outputs are lists here, the wall clock is a number.
Over DDS the same node is in the tests of plant node, clock and emergency stop.
"""

import math
import signal
import time

import pytest
from rclpy.clock import Clock, ClockType
from std_msgs.msg import UInt64

from loco_control.exceptions import GraphError
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_control.ros.messages.topics import LOST_TICK
from loco_control.types import MotionCommand
from loco_msgs.msg import Event, RecorderStatus
from loco_sim.ros import plant_node
from loco_sim.ros.joint_sim_node import JointSimNode
from loco_sim.ros.plant_node import FIRST, GRACE, SAFE_STEP_PERIOD, START_TIMEOUT, PlantNode

pytestmark = pytest.mark.ros

RATE = 100.0  # of the plant [Hz]


class Wall:
    """The wall clock, which only goes on when it is told to."""

    def __init__(self):
        self.now, self.slept = 50.0, []

    def perf_counter(self):
        return self.now

    monotonic = perf_counter

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.now += seconds


class Plant:
    """A plant node that is called, not heard."""

    def __init__(self, bench, begin=True, **parameters):
        self.b = bench(JointSimNode, JOINT_TOPICS, robot="servo_pendulum", **parameters)
        self.node = self.b.node
        self.events, self.sent, self.used, self.told = events, sent, used, told = [], [], [], []
        advance = self.node.advance
        # They hold no plant: a node that holds its test would stay until the next collection.
        self.node.event = lambda kind, text="", tick=0, t=0.0: events.append((kind, text, tick, t))
        self.node.send = lambda state: sent.append(state.tick)
        self.node.publish_diagnostics = lambda: told.append(True)
        self.node.advance = lambda *order: (used.append(order), advance(*order))[1]
        if begin:
            self.begin()

    def begin(self):
        for name in sorted(self.node._waiting_for):
            self.ready(name)

    def ready(self, name, kind="ready"):
        self.node._on_event(Event(node=name, kind=kind))

    def command(self, tick, offset=0.0):
        q = self.node.sim.robot.standing + offset
        made = MotionCommand(tick, tick / RATE, q, 0.0 * q)
        self.node._on_commands(made, None)
        return made

    def lost(self, *ticks):
        for tick in ticks:
            self.node._on_lost(UInt64(data=tick))

    def said(self, *kinds):
        return [event for event in self.events if event[0] in kinds]

    @property
    def tick(self):
        return self.node.state.tick

    @property
    def damped(self):
        """Whether the newest step was of the safe state."""
        command, trunk = self.used[-1]
        return trunk is not None and command.tick == self.tick - 1


@pytest.fixture
def clock(monkeypatch):
    made = Wall()
    monkeypatch.setattr(plant_node, "time", made)
    return made


# ---- the start


@pytest.mark.parametrize("recorded", [True, False])
def test_the_first_tick_waits_until_all_are_ready(bench, recorded):
    plant = Plant(bench, begin=False, recorded=recorded)
    others = {*JointSimNode.controllers, *(["recorder"] if recorded else [])}
    assert plant.node.diagnose() == {"waiting for nodes": ", ".join(sorted(others))}
    plant.lost(0)
    for name in others:
        plant.ready(name, "started")
    plant.ready("somebody else")
    for name in sorted(others):
        assert not plant.node.started and plant.sent == plant.events == []
        assert plant.node.newest() == PlantNode.newest(plant.node) == -1
        assert plant.node.stamp() == (0, 0.0)
        plant.ready(name)
    assert plant.node.started and plant.sent == [0]
    assert plant.events == [("started", "clock lockstep", 0, 0.0)]
    assert plant.node.diagnose()["tick"] == 0
    plant.command(0)
    assert plant.node.stamp() == (1, plant.node.state.t)
    assert PlantNode.newest(plant.node) == 1
    plant.ready("somebody else")
    assert not plant.said("resumed") and plant.sent == [0, 1]


def test_a_plant_that_begins_later_than_the_others_are_ready_reports_until_then(bench, monkeypatch):
    monkeypatch.setattr(JointSimNode, "_start", lambda node: None)  # as a driver on its way
    plant = Plant(bench)
    assert not plant.node._waiting_for and not plant.node.started
    assert plant.node.diagnose() == {"silence": 0.0}
    monkeypatch.undo()
    plant.node._start()
    assert plant.node.diagnose()["tick"] == 0


def test_where_faults_stand_between_the_plant_waits_for_them_and_hears_what_is_lost(bench):
    plant = Plant(bench, False, faulted="['joint_command']", allow_faults=True)
    assert "faults" in plant.node.diagnose()["waiting for nodes"]
    plant.begin()
    qos = LOST_TICK.qos.writer()
    lost = plant.b.tester.create_publisher(LOST_TICK.type, LOST_TICK.name, qos)
    plant.b.wait(lost.get_subscription_count)
    lost.publish(UInt64(data=5))
    lost.publish(UInt64(data=0))
    plant.b.wait(lambda: plant.sent == [0, 1])


def test_without_faults_nobody_can_say_that_a_tick_is_lost(bench):
    plant = Plant(bench)
    assert LOST_TICK.name not in {s.topic_name.strip("/") for s in plant.node.subscriptions}


# ---- commands


def test_only_the_command_of_the_newest_tick_is_stepped(bench):
    plant = Plant(bench)
    for tick, sent in ((1, [0]), (0, [0, 1]), (0, [0, 1]), (2, [0, 1]), (1, [0, 1, 2])):
        plant.command(tick)
        assert plant.sent == sent
    assert not any(trunk for _, trunk in plant.used)
    plant.lost(1, 3)
    assert plant.sent == [0, 1, 2]
    plant.lost(2)
    assert plant.sent == [0, 1, 2, 3]


def test_a_command_of_another_tick_is_never_used(bench):
    plant = Plant(bench)
    plant.command(5)  # one of the future is no command for the tick that is due
    plant.lost(0)
    assert plant.damped
    held = plant.command(1)
    for other in (0, 9):
        plant.command(other)
    plant.lost(2)
    assert plant.used[-1][0] is held


def test_a_command_is_held_until_it_is_too_old_and_counts_again_when_a_new_one_comes(bench):
    plant = Plant(bench, **{"fallback.hold": 0.02})
    held = plant.command(0)
    plant.lost(*range(1, 7))  # 0.06 s is not older than 0.06 s
    assert [used is held for used, _ in plant.used] == 7 * [True]
    assert plant.node._fallback.stage == "hold"
    plant.lost(7, 8, 9)
    assert plant.damped and plant.node._fallback.stage == "damp"
    assert plant.said("timeout") == [("timeout", "no command since tick 0", 7, 0.07)]
    assert plant.node.diagnose()["late_ticks"] == 9
    assert plant.node.diagnose()["late_share"] == 0.0  # nothing since the report before
    plant.command(10)
    assert not plant.damped and plant.node._fallback.stage == "hold"
    assert plant.said("timeout")[1:] == [("timeout", "commands are back at tick 10", 10, 0.1)]
    plant.lost(11)
    report = plant.node.diagnose()
    assert report["late_ticks"] == 10 and report["late_share"] == pytest.approx(1 / 2)
    assert not plant.said("estop", "error")


def test_every_silence_of_a_run_is_noticed_and_told(bench):
    plant = Plant(bench)
    for silences in range(1, 4):
        plant.command(plant.tick)
        assert not plant.damped
        for late in range(9):  # 0.06 s, six ticks, are held
            plant.lost(plant.tick)
            assert plant.damped == (late >= 6)
        told = [text for _, text, _, _ in plant.said("timeout")]
        assert sum(text.startswith("no command since") for text in told) == silences
        assert sum(text.startswith("commands are back") for text in told) == silences - 1


def test_a_stop_for_late_commands_stays_when_they_are_back(bench):
    plant = Plant(bench, late="safe-stop")
    plant.command(0)
    plant.lost(*range(1, 7))
    assert not plant.said("estop") and "estop" not in plant.node.diagnose()
    plant.lost(7)
    assert plant.said("estop") == [("estop", "no command since tick 0", 7, 0.07)]
    plant.command(8)
    assert plant.damped and plant.node.diagnose()["estop"] == "no command since tick 0"


def test_before_the_first_command_it_is_damped_and_nobody_is_late(bench):
    plant = Plant(bench, late="safe-stop")
    for tick in range(12):
        plant.lost(tick)
        assert plant.damped
    assert not plant.said("timeout", "estop")


def test_a_controller_that_cannot_be_read_ends_the_run_with_its_first_fault(bench):
    plant = Plant(bench)
    plant.command(0)
    plant.node._reject("two positions, expected one")
    plant.node._reject("three positions, expected one")
    assert plant.node._grace.timer_period_ns == GRACE * 1e9
    with pytest.raises(GraphError, match="two positions, expected one"):
        plant.node._judge_unreadable()
    assert plant.said("error") == [("error", "two positions, expected one", 1, 0.01)]
    assert plant.sent == [0, 1]


def test_a_command_that_cannot_be_read_beside_one_that_can_ends_nothing(bench):
    """A stranger sent it: the right one of the same tick came, or there are two writers."""
    plant = Plant(bench)
    plant.command(0)
    plant.node._reject("two positions, expected one")
    plant.command(1)
    plant.node._judge_unreadable()
    plant.node._reject("two positions, expected one")
    plant.node._strangers = lambda: "joint_command has 2 writers"
    plant.node._judge_unreadable()
    assert not plant.said("error") and plant.node._grace is None


def test_a_plant_that_has_not_begun_is_ended_by_no_command(bench):
    plant = Plant(bench)
    plant.node.started = False
    plant.node._reject("two positions, expected one")
    assert plant.node._grace is None


@pytest.mark.parametrize("tick", [3, 2**63, 2**64 - 1])
def test_a_recorder_cannot_be_ahead_of_the_plant(bench, tick):
    plant = Plant(bench, recorded=True, flow_window=2)
    plant.node._on_recorder(RecorderStatus(tick=tick))
    assert plant.node._n_refused["recorder_status"] == 1 and plant.node._recorder_tick < tick


def test_a_command_that_is_not_finite_ends_its_tick_and_no_other(bench):
    plant = Plant(bench)
    plant.node._reject("")  # nobody has answered the newest tick
    assert plant.sent == [0]
    plant.node._join.done = plant.node.newest()
    plant.node._reject("")
    assert plant.sent == [0, 1] and not plant.said("error")


# ---- limits


def test_limits_and_stages_count_in_control_periods(bench):
    plant = Plant(bench, **{"safety.rate": 0.5, "fallback.hold": 0.5})
    assert plant.node._safety._dt == 1.0 / RATE
    assert plant.node._fallback._hold == 50
    plant.command(0)
    far = plant.command(1, 2.0)
    assert plant.used[-1][0] is not far
    assert plant.node.diagnose()["limited_rate"] == 1


def test_limits_that_are_switched_off_let_everything_through(bench):
    plant = Plant(bench, **{"safety.enabled": False, "safety.rate": 0.5})
    plant.command(0)
    far = plant.command(1, 2.0)
    assert plant.used[-1][0] is far
    assert not [key for key in plant.node.diagnose() if key.startswith("limited")]
    plant.node._estop.engage("a finger")
    plant.command(2)
    assert plant.damped


def test_a_plant_without_a_robot_has_no_limits_and_is_damped(bench):
    plant = Plant(bench)
    sim, plant.node.sim = plant.node.sim, object()
    plant.node._make_safety()
    plant.node.sim = sim
    far = plant.command(0, 2.0)
    assert plant.used[-1][0] is far
    plant.node._estop.engage("a finger")
    plant.command(1)
    assert plant.damped


def test_a_measurement_beyond_its_limit_stops_the_robot(bench):
    plant = Plant(bench)
    plant.command(0)
    assert not plant.said("estop")
    plant.node._safety.trip = lambda state: f"too fast at {state.tick}"
    plant.command(1)
    assert plant.said("estop") == [("estop", "too fast at 2", 2, 0.02)]
    assert not plant.damped
    plant.command(2)
    assert plant.damped


@pytest.mark.parametrize("when", ["at first", "late", "before any command", "at the end"])
def test_a_measurement_beyond_its_limit_stops_the_robot_at_any_time(bench, when):
    plant = Plant(bench, duration=0.1)
    if when != "before any command":
        plant.command(0)
    plant.lost(*range(plant.tick, {"late": 8, "at the end": 9}.get(when, plant.tick)))
    plant.node._safety.trip = lambda state: "too fast"
    now = plant.tick
    plant.lost(now)
    assert [event[:3] for event in plant.said("estop")] == [("estop", "too fast", now + 1)]
    assert bool(plant.said("finished")) == (when == "at the end")


# ---- the recorder


def test_the_plant_waits_for_a_recorder_that_lags_and_no_longer(bench):
    plant = Plant(bench, recorded=True, flow_window=2)
    plant.command(0)
    plant.command(1)
    assert plant.sent == [0, 1] and plant.tick == 2  # nothing recorded yet: three ticks behind
    plant.command(2)
    plant.lost(2)
    assert plant.tick == 2
    status = plant.b.publisher("recorder_status")
    status.publish(RecorderStatus(tick=0))
    plant.b.wait(lambda: plant.sent == [0, 1, 2])
    plant.command(2)
    plant.node._on_recorder(RecorderStatus(tick=0))
    assert plant.sent == [0, 1, 2] and plant.tick == 3
    plant.node._on_recorder(RecorderStatus(tick=1))
    plant.node._on_recorder(RecorderStatus(tick=1))  # released once
    assert plant.sent == [0, 1, 2, 3]
    plant.node._on_recorder(RecorderStatus(tick=2))
    plant.command(3)
    assert plant.sent == [0, 1, 2, 3, 4]


def test_a_status_that_goes_back_holds_no_plant(bench):
    plant = Plant(bench, recorded=True, flow_window=2)
    for tick in range(4):
        plant.node._on_recorder(RecorderStatus(tick=tick))
        plant.node._on_recorder(RecorderStatus(tick=0))  # of a stranger
        plant.command(tick)
    assert plant.sent == [0, 1, 2, 3, 4]
    plant.command(4)
    plant.command(5)
    assert plant.tick == 6 and plant.sent[-1] == 5  # held
    plant.node._on_recorder(RecorderStatus(tick=4))
    assert plant.sent[-1] == 6


@pytest.mark.parametrize("parameters", [{"recorded": True, "clock": "asap"}, {"recorded": False}])
def test_nobody_waits_for_a_recorder_without_need(bench, parameters):
    plant = Plant(bench, flow_window=2, **parameters)
    for tick in range(6):
        plant.command(tick)
    assert plant.sent == list(range(7))


# ---- a controller that comes back


def test_a_tick_is_stepped_for_a_controller_that_did_not_see_it(bench):
    plant = Plant(bench)
    plant.command(0)
    timers = len(list(plant.node.timers))
    name = JointSimNode.controllers[-1]
    plant.ready(name)
    plant.ready(name)
    assert plant.said("resumed") == 2 * [("resumed", f"{name} is back", 1, 0.01)]
    assert len(list(plant.node.timers)) == timers + 1
    assert plant.node._safe_timer.timer_period_ns == SAFE_STEP_PERIOD * 1e9
    assert plant.sent == [0, 1]
    plant.node._step_safely()
    assert plant.sent == [0, 1, 2] and plant.damped
    plant.node._step_safely()
    assert plant.sent == [0, 1, 2, 3]
    timer = plant.node._safe_timer
    plant.command(3)
    plant.node._step_safely()  # it answers: the plant goes by its commands again
    assert plant.sent == [0, 1, 2, 3, 4]
    assert timer.is_canceled() and plant.node._safe_timer is None
    plant.ready(name)
    assert plant.node._safe_timer is not None


def test_no_tick_is_stepped_while_the_recorder_lags_or_after_the_end(bench):
    plant = Plant(bench, recorded=True, flow_window=2, duration=0.05)
    plant.command(0)
    plant.command(1)
    plant.ready(JointSimNode.controllers[-1])
    plant.node._step_safely()
    assert plant.tick == 2 and plant.node._safe_timer is not None
    plant.node._on_recorder(RecorderStatus(tick=2))
    plant.lost(2, 3, 4)
    plant.node._stuck_at = plant.tick
    plant.node._step_safely()
    assert plant.tick == 5 and plant.node._safe_timer is None


# ---- the end


@pytest.mark.parametrize("leave", [True, False])
def test_a_run_ends_after_its_duration_and_stays_ended(bench, leave, monkeypatch):
    raised = []
    monkeypatch.setattr(plant_node.signal, "raise_signal", raised.append)
    plant = Plant(bench, duration=0.05, leave=leave)
    timers = list(plant.node.timers)
    for tick in range(8):
        plant.command(tick)
        assert ("silence" in plant.node.diagnose()) == (tick > 3)
    plant.lost(4, 5, 6)
    assert plant.sent == [0, 1, 2, 3, 4] and plant.tick == 5 and len(plant.told) == 1
    assert plant.said("finished") == [("finished", plant.node.end_text(), 4, plant.node.state.t)]
    assert "0.1 s" in PlantNode.end_text(plant.node) and not plant.said("fall")
    assert plant.node.diagnose()["silence"] == 0.0
    assert plant.node.deadline == math.inf
    more = [timer for timer in plant.node.timers if timer not in timers]
    assert [timer.timer_period_ns for timer in more] == ([1e9] if leave else [])
    if leave:
        plant.b.wait(lambda: raised)
        assert raised[0] == signal.SIGINT


@pytest.mark.parametrize("stops", [True, False])
def test_a_fall_ends_the_run_if_it_has_to(bench, stops):
    plant = Plant(bench, stop_on_fall=stops)
    for tick in range(300):
        plant.command(tick)
    assert not plant.said("finished")  # a duration of 0 has no end
    plant.node.sim.fallen = "the base is low"
    plant.command(300)
    assert bool(plant.said("finished")) == stops
    assert plant.sent[-1] == (300 if stops else 301)
    if stops:
        assert plant.said("fall") == [("fall", "the base is low", 301, plant.node.state.t)]
        assert plant.said("finished")[0][1] == "fell at 3.01 s: the base is low"


def test_the_engine_is_closed_with_the_node(bench):
    plant = Plant(bench)
    closed, close = [], plant.node.sim.close
    plant.node.sim.close = lambda: closed.append(close())
    plant.node.close()
    assert closed == [None]


# ---- the wall clock


def test_a_wall_clock_that_is_set_back_stops_no_timer(bench):
    """Diagnostics, time-outs and the flow of a recorder count steady time."""
    plant = Plant(bench, heartbeat=0.5, leave=True, duration=0.01)
    plant.ready(JointSimNode.controllers[-1])
    plant.command(0)
    kinds = [timer.clock.clock_type for timer in plant.node.timers]
    assert len(kinds) >= 4 and set(kinds) == {ClockType.STEADY_TIME}
    own = Clock(clock_type=ClockType.SYSTEM_TIME)
    assert plant.node.create_timer(1.0, print, clock=own).clock is own
    assert plant.node.create_timer(1.0, print, None, own).clock is own


def test_a_speed_keeps_the_ticks_of_lockstep_apart(bench, clock):
    plant = Plant(bench, speed=4.0)
    assert clock.slept == [pytest.approx(0.0025)]
    clock.now += 0.0015
    plant.command(0)
    assert clock.slept[1] == pytest.approx(0.001)
    clock.now += 1.0
    plant.command(1)
    assert clock.slept[2] == 0.0  # late: it does not wait


@pytest.mark.parametrize("parameters", [{"speed": 0.0}, {"speed": 4.0, "clock": "asap"}])
def test_no_speed_is_kept_where_none_is_asked_for(bench, clock, parameters):
    plant = Plant(bench, **parameters)
    plant.command(0)
    assert clock.slept == []


def test_the_real_time_factor_is_simulated_time_by_wall_time(bench, clock):
    plant = Plant(bench)
    assert plant.node.diagnose()["real_time_factor"] == 0.0  # no wall time yet
    for tick in range(10):
        plant.command(tick)
    clock.now += 0.4
    report = plant.node.diagnose()
    assert report["real_time_factor"] == pytest.approx(0.1 / 0.4)
    assert (report["tick"], report["sim_time"], report["clock"]) == (10, 0.1, "lockstep")
    assert "missed_ticks" not in report


def test_rejected_commands_are_counted_in_all_and_since_the_last_report(bench):
    plant = Plant(bench)
    plant.node.diagnose()
    plant.node.sim.rejected, plant.node._join.refused = 3, 4
    report = plant.node.diagnose()
    assert (report["rejected_commands"], report["rejected"]) == (7, 7)
    report = plant.node.diagnose()
    assert (report["rejected_commands"], report["rejected"]) == (7, 0)


def test_realtime_begins_when_controllers_keep_up_then_commands_only_wait(bench):
    plant = Plant(bench, begin=False, clock="realtime", duration=0.2)
    assert plant.node.timed and plant.node.deadline == math.inf
    before = time.monotonic()
    plant.begin()
    assert before < plant.node.deadline - START_TIMEOUT <= time.monotonic()
    plant.lost(0)
    assert plant.sent == [0]  # the clock goes on by itself
    for tick in range(FIRST):
        plant.command(tick)
    assert plant.sent == list(range(FIRST + 1)) and plant.node._deadlines is None
    plant.command(FIRST)
    assert plant.node._deadlines is not None
    assert 0.0 < plant.node.deadline - time.monotonic() <= 1.0 / RATE
    assert 0.01 < plant.node.diagnose()["real_time_factor"] <= 1.0
    held = plant.command(FIRST + 7)
    plant.command(FIRST)
    assert plant.sent == list(range(FIRST + 1))
    plant.ready(JointSimNode.controllers[-1])
    assert plant.said("resumed") and plant.node._safe_timer is None  # the clock steps by itself
    held = plant.command(FIRST)
    time.sleep(0.03)
    plant.node.on_deadline()
    assert plant.tick > FIRST + 1 and plant.used[-1][0] is held
    assert "missed_ticks" in plant.node.diagnose()
    while not plant.said("finished"):
        time.sleep(0.03)
        plant.node.on_deadline()
    assert plant.tick == 20 and plant.node.deadline == math.inf
    time.sleep(0.02)
    plant.node.on_deadline()
    assert plant.tick == 20


def test_realtime_begins_without_controllers_when_its_patience_ends(bench):
    plant = Plant(bench, clock="realtime")
    plant.node.on_deadline()
    assert plant.sent == [0] and plant.node._deadlines is not None
    time.sleep(0.02)
    plant.node.on_deadline()
    assert plant.tick > 0 and plant.damped
