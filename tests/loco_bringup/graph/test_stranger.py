# SPDX-License-Identifier: Apache-2.0
"""A stranger of the same ROS domain sends 612 random messages: no node dies, no run ends.

Before the start the plant does not move, during a run it goes on to its end. The messages have the
right types, by a seed, with values that nobody would send: not finite, huge, of wrong lengths, of
names of nodes and kinds of events that exist, with old and future stamps.
"""

import threading
import time

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.signals import SignalHandlerOptions

from loco_bringup.bag.reader import Bag
from loco_bringup.graph import run as runner
from loco_bringup.graph.watch import Watch
from loco_bringup.record.recorder import _Robot
from loco_control.exceptions import GraphError
from loco_control.ros.messages.joint_topics import TABLES
from loco_control.ros.messages.topics import to_stamp
from loco_learning.runs.experiment import load
from loco_msgs.msg import Event, RecorderStatus

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("graph")]

MESSAGES = 612  # of one stranger
FLOATS = (0.0, -1.0, 1e-300, 1e30, 1e308, -1.7e308, np.inf, -np.inf, np.nan)
WHOLE = (0, 1, 40, 10**6, 2**31 - 1, 2**32 - 1, 2**63 - 1, 2**64 - 1, -1, -(2**31))
WORDS = (
    "", "\n", "x" * 20_000, "../../etc/passwd", "nan", "1e999", "ready", "started", "finished", "error",
    "fall", "phase", "timeout", "resumed", "sim_time", "real_time_factor", "waiting for", "stranger",
    "lf_hip", "é\ud800".encode("utf-8", "replace").decode(), "a: [" * 500, "pse",
)  # fmt: skip
NODES = ("robot_sim", "supervisor", "recorder", "nobody", "")
# What only forged names of our own nodes would do is stated in SECURITY.md.
FORGED = {("robot_sim", "started"), ("robot_sim", "fall")}


def wild(kind, rng, depth=0):
    """A message of a class whose fields have values that nobody would send."""
    message = kind()
    for name, spec in kind.get_fields_and_field_types().items():
        old = getattr(message, name)
        try:
            setattr(message, name, _value(old, spec, rng, depth))
        except (AssertionError, TypeError, OverflowError, ValueError):
            continue  # rclpy itself refuses it
    return message


def _value(old, spec, rng, depth):
    if hasattr(old, "get_fields_and_field_types"):
        return wild(type(old), rng, depth + 1)
    if isinstance(old, bool):
        return bool(rng.integers(2))
    if isinstance(old, str):
        return WORDS[rng.integers(len(WORDS))]
    if isinstance(old, float):
        return FLOATS[rng.integers(len(FLOATS))]
    if isinstance(old, int):
        bits = int(spec.removeprefix("u").removeprefix("int"))
        low, high = (
            (0, 2**bits - 1) if spec[0] == "u" else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        )
        return min(max(WHOLE[rng.integers(len(WHOLE))], low), high)
    length = int((0, 1, 12, 13, 5000)[rng.integers(5)])
    if isinstance(old, np.ndarray):  # of a fixed length
        return rng.choice(FLOATS, len(old)).astype(old.dtype)
    if "double" in spec or "float" in spec:
        return rng.choice(FLOATS, length).tolist()
    if "string" in spec:
        return [WORDS[i] for i in rng.integers(len(WORDS), size=length)]
    return old


class Stranger:
    """Writers of all topics of a table, in a context of their own.

    Args:
        table: The topic table.
        seed: Seed of all values.
        without: Names of topics that are left alone.
    """

    def __init__(self, table, seed, without=()):
        self._rng, self._context = np.random.default_rng(seed), rclpy.Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("stranger", context=self._context)
        self._rows = [row for row in table.values() if row.name not in without]
        self._writers = [
            self.node.create_publisher(row.type, row.name, row.qos.writer()) for row in self._rows
        ]
        self.sent = 0

    def send(self, count):
        """Send so many more, of each topic in turn."""
        for _ in range(count):
            at = self.sent % len(self._rows)
            message = wild(self._rows[at].type, self._rng)
            if self._rows[at].name == "events":
                message.node = NODES[self._rng.integers(len(NODES))]
                if (message.node, message.kind) in FORGED:
                    message.node = "nobody"
            if self._rows[at].name == "/diagnostics":
                message.status = [_report(type(message), self._rng)]
            if self._rows[at].name == "estop":
                message.data = False  # a stop is what everybody may do
            self._writers[at].publish(message)
            self.sent += 1

    def close(self):
        self.node.destroy_node()
        self._context.try_shutdown()


def _report(kind, rng):
    """Diagnostics in the name of the plant, of numbers that are none."""
    keys = ("sim_time", "real_time_factor", "waiting for", "lateness_p50_ms", "realtime")
    values = [KeyValue(key=k, value=WORDS[rng.integers(len(WORDS))]) for k in keys]
    return DiagnosticStatus(name="robot_sim", values=values)


ROBOTS = {"joint": ("tigrillo_sine", {"duration": 3.0}), "hyq": ("hyq_short", {
    "learner.train": 1.5, "learner.closing": 0.5, "learner.test": 0.5})}  # fmt: skip


@pytest.mark.parametrize("layout", runner.LAYOUTS)
@pytest.mark.parametrize("table", ROBOTS)
def test_a_run_goes_on_to_its_end_whatever_a_stranger_sends(tmp_path, table, layout):
    experiment = load(*ROBOTS[table])
    strangers = []

    def send(progress):
        began = any((e.node, e.kind) == ("robot_sim", "started") for _, e in progress.events)
        if began and progress.sim_time > 0.2 and not strangers:  # a run is refused beside one
            strangers.append(Stranger(TABLES[table], seed=7, without={"model"}))
            strangers[0].send(MESSAGES)

    try:
        outcome = runner.run(
            experiment, tmp_path / "bag", layout, on_progress=send, speed=0.5, stop_on_fall=False
        )
    finally:
        sent = sum(stranger.sent for stranger in strangers)
        for stranger in strangers:
            stranger.close()
    assert sent == MESSAGES, outcome
    assert outcome.exit_code == 0
    assert set(outcome.exit_codes.values()) == {0}
    duration = runner.duration_of(experiment)
    assert f"{duration:.1f} s simulated" in outcome.text
    finished = [e for e in Bag(tmp_path / "bag").messages("events") if e.kind == "finished"]
    assert ("robot_sim", experiment.ticks - 1) in [(e.node, e.tick) for e in finished]


@pytest.mark.parametrize("layout", runner.LAYOUTS)
def test_before_the_start_no_plant_moves_and_the_run_begins_when_the_stranger_has_gone(
    tmp_path, layout
):
    """While a stranger writes what a tick waits for, a graph refuses to begin, in one line."""
    experiment = load(*ROBOTS["joint"])
    stranger = Stranger(TABLES["joint"], seed=11)
    stranger.send(MESSAGES)
    stop = threading.Event()

    def on():
        while not stop.is_set():
            stranger.send(16)
            time.sleep(0.02)

    thread = threading.Thread(target=on)
    thread.start()
    try:
        with pytest.raises(GraphError) as raised:
            runner.run(experiment, tmp_path / "refused", layout)
    finally:
        stop.set()
        thread.join()
        stranger.close()
    assert "stranger" in str(raised.value) and "writers" in str(raised.value)
    assert "another graph runs" in str(raised.value)
    assert not list((tmp_path / "refused").glob("*.mcap"))
    outcome = runner.run(experiment, tmp_path / "after", layout)
    assert outcome.exit_code == 0 and "3.0 s simulated" in outcome.text


# ---- what a supervisor and a recorder believe


@pytest.fixture
def watch(tmp_path):
    made = Watch([], tmp_path, 5.0, lambda progress: None, {"": "joint"})
    made._graphs[""].started = True
    made.on_recorder("", RecorderStatus(tick=499))
    return made


def said(watch, kind, node="robot_sim", tick=499, t=4.99):
    watch.on_event("", Event(node=node, kind=kind, tick=tick, text="text", stamp=to_stamp(t)))


def report(watch, **values):
    pairs = [KeyValue(key=k, value=v) for k, v in values.items()]
    status = DiagnosticStatus(name="robot_sim", values=pairs)
    watch.on_diagnostics(DiagnosticArray(status=[status]))


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "", "x", "1e999", "9" * 400 + "e99"])
def test_a_time_that_is_none_is_not_believed(watch, value):
    report(watch, sim_time="1.5", real_time_factor="1")
    report(watch, sim_time=value, real_time_factor="1")
    report(watch, sim_time="1.7", real_time_factor=value)
    report(watch, sim_time="1.6", real_time_factor="1", lateness_p50_ms=value)
    report(watch, sim_time="1.6")
    assert watch._graphs[""].sim_time == 1.5


@pytest.mark.parametrize(
    ("node", "t", "done"),
    [("robot_sim", 5.0, True), ("robot_sim", 0.0, False), ("robot_sim", 2.0**31, False),
     ("robot_sim", 4.5, False), ("nobody", 5.0, False), ("", 5.0, False)],
)  # fmt: skip
def test_an_end_is_believed_where_the_plant_is(watch, node, t, done):
    report(watch, sim_time="5", real_time_factor="1")
    said(watch, "finished", node, t=t)
    assert watch._graphs[""].done is done


def test_a_true_end_after_a_false_one_counts_and_alone_is_told(watch):
    said(watch, "finished", tick=2**64 - 1, t=1e9)
    report(watch, sim_time="5", real_time_factor="1")
    said(watch, "finished", t=5.0)
    assert watch._graphs[""].done and watch.outcome.text == ""


def test_a_false_end_after_the_true_one_hides_it_not(watch):
    said(watch, "finished", t=5.0)
    report(watch, sim_time="5", real_time_factor="1")
    said(watch, "finished", tick=1, t=1e9)
    graph = watch._graphs[""]
    assert graph.done and graph.end.tick == 499


def test_an_event_error_ends_nothing(watch):
    for node in ("robot_sim", "recorder", "nobody", ""):
        said(watch, "error", node)
        watch._check()


def test_progress_is_seen_after_a_time_that_was_too_large(watch):
    report(watch, sim_time="1e9", real_time_factor="1")
    watch._moved = 0.0
    report(watch, sim_time="1.25", real_time_factor="1")
    assert watch._moved > 0.0
    watch._check()


class Told:
    """The recorder's node, as its robots know it."""

    status_every = 20

    def __init__(self):
        self.ticks = []

    def robot(self):
        robot = _Robot(self, "", "calibration")
        robot.tell = lambda: (setattr(robot, "told", robot.tick), self.ticks.append(robot.tick))
        return robot


def test_ticks_that_follow_no_other_are_not_told_to_the_plant():
    told = Told()
    robot = told.robot()
    for tick in (0, 1, 10**6, 2, 0, 3, 2**40 - 1, 4):
        robot.moved(tick, tick)
    assert robot.tick == 4 and told.ticks == [0]


def test_a_plant_that_begins_again_is_followed_from_its_second_tick():
    told = Told()
    robot = told.robot()
    for tick in (*range(50), 0, 1, 2):
        robot.moved(tick, tick)
    assert robot.tick == 2 and told.ticks == [0, 20, 40, 1]


def test_after_lost_ticks_it_goes_on():
    told = Told()
    robot = told.robot()
    for tick in (0, 1, 2, 30, 31, 32):
        robot.moved(tick, tick)
    assert robot.tick == 32 and told.ticks == [0, 31]


def test_a_last_tick_behind_lost_ones_is_taken_when_none_comes_after_it():
    """A plant in real time leaves out what it missed, also just before its end."""
    told = Told()
    robot = told.robot()
    for tick in (0, 1, 2, 6):
        robot.moved(tick, tick)
    robot.settle()
    assert robot.tick == 2  # the next one may be on its way
    robot.settle()
    assert robot.tick == robot.now == 6
    robot.moved(10**6, 10**6)  # somebody else's, while the plant goes on
    robot.settle()
    robot.moved(7, 7)
    robot.settle()
    robot.settle()
    assert robot.tick == 7
