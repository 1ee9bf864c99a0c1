# SPDX-License-Identifier: Apache-2.0
"""Nodes that die are restarted or end the run; nothing is left behind, whoever is killed."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.signals import SignalHandlerOptions

from loco_bringup.bag.reader import Bag
from loco_bringup.graph import node_set, shm
from loco_bringup.graph import run as runner
from loco_bringup.graph.process_info import start_of
from loco_bringup.graph.processes import Guard, Process, Restart, stop_all
from loco_bringup.graph.watch import Watch
from loco_bringup.outcome import LIMIT
from loco_control.exceptions import GraphError, ParameterError
from loco_control.ros.parameters import sealed_node
from loco_learning.runs.experiment import load
from loco_workshop.stress.traces import opened_by

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("graph")]

LONG = {"learner.train": 600.0}
STUBBORN = (
    "import signal, sys, time\n"
    "signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
    "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
    "time.sleep(600)\n"
)


def wait(condition, timeout=60.0):
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, "timed out"
        time.sleep(0.02)


def processes_with(text):
    """Pid and command of the processes whose command line has a text."""
    found = {}
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            command = path.read_text()
        except OSError:
            continue
        if text in command and int(path.parent.name) != os.getpid():
            found[int(path.parent.name)] = command
    return found


# ---- restart policy


def test_a_policy_counts_the_restarts_of_the_last_minute():
    policy = Restart(2)
    assert policy.allows(-9, [], 0.0)
    assert policy.allows(1, [0.0], 10.0)
    assert not policy.allows(1, [0.0, 5.0], 10.0)
    assert policy.allows(1, [0.0, 5.0], 61.0)
    assert not policy.allows(0, [], 0.0)
    assert not Restart().allows(-9, [], 0.0)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"restart": "always"}, "restart of robot_sim must be never or on_failure, got 'always'"),
        ({"restart": "on_failure", "restarts_per_minute": 0}, r"whole number in \[1, 60\], got 0"),
    ],
)
def test_a_wrong_policy_is_one_clear_line(tmp_path, more, message):
    content = {"nodes": [{"name": "robot_sim", "class": "a:B", **more}]}
    (tmp_path / "set.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(ParameterError, match=message):
        node_set.load(str(tmp_path / "set.yaml"))


def set_with_restarts(folder, *names, per_minute=2):
    """The node set of HyQ in which some nodes start again."""
    source = Path(node_set.__file__).parent.parent / "node_sets" / "hyq.yaml"
    content = yaml.safe_load(source.read_text())
    for row in content["nodes"]:
        if row["name"] in names:
            row |= {"restart": "on_failure", "restarts_per_minute": per_minute}
    path = folder / "set.yaml"
    path.write_text(yaml.safe_dump(content))
    return str(path)


class Killer:
    """Kills a node of a run, each time after it has ticked on for a while."""

    def __init__(self, folder, cls, times, after=0.3):
        self._text, self._cls, self._left, self._after = str(folder), cls, times, after
        self._next, self.killed, self._heard = after, [], 0

    def __call__(self, progress):
        if not self._left:  # done when the last one is back
            return any(event.kind == "resumed" for _, event in list(progress.events)[self._heard :])
        if progress.sim_time < self._next:
            return False
        for pid, command in processes_with(self._text).items():
            if self._cls in command and pid not in self.killed:
                os.kill(pid, signal.SIGKILL)
                self.killed.append(pid)
                self._left -= 1
                self._next = progress.sim_time + self._after
                self._heard = len(progress.events)
        return False


@pytest.mark.parametrize("cls", ["TargetGeneratorNode", "ReflexNetwork"])
def test_a_killed_controller_starts_again_and_the_run_goes_on(tmp_path, cls):
    nodes = set_with_restarts(
        tmp_path, "target_generator", "stance_controller", "reflex_network", per_minute=1
    )
    folder = tmp_path / "bag"
    killer = Killer(folder, cls, times=1)
    outcome = runner.run(
        load("hyq_short", LONG), folder, "processes", nodes=nodes, on_progress=killer
    )
    assert list(outcome.restarts.values()) == [1]
    assert outcome.exit_codes == dict.fromkeys(outcome.exit_codes, 0)
    events = Bag(folder).messages("events")
    assert [e.text for e in events if e.kind == "resumed"] == [
        f"{next(iter(outcome.restarts))} is back"
    ]


def test_too_many_restarts_end_the_run(tmp_path):
    nodes = set_with_restarts(tmp_path, "target_generator", per_minute=1)
    folder = tmp_path / "bag"
    with pytest.raises(GraphError, match="died with exit code -9 after 1 restart;"):
        runner.run(
            load("hyq_short", LONG), folder, "processes", nodes=nodes,
            on_progress=Killer(folder, "TargetGeneratorNode", times=2),
        )  # fmt: skip
    assert processes_with(str(folder)) == {}


# ---- no orphans


def start_run(folder):
    """`loco run` in processes, ticking; with the pids of its nodes."""
    command = ["run", "hyq_trot_long", "--layout", "processes", "--out", str(folder)]
    supervisor = subprocess.Popen([sys.executable, "-m", "loco_bringup.cli.main", *command])
    wait(lambda: sum(p.stat().st_size for p in folder.glob("*.mcap")) > 2e5)
    found = processes_with("loco_bringup.graph.composed")
    return supervisor, [pid for pid, command in found.items() if str(folder) in command]


def test_a_killed_supervisor_leaves_nothing(tmp_path):
    supervisor, pids = start_run(tmp_path / "bag")
    starts = {pid: start_of(pid) for pid in pids}
    segments = opened_by(pids)
    assert len(pids) == 5
    assert len(segments) >= 5
    stopped = pids[0]  # it can answer no signal while it is stopped
    os.kill(stopped, signal.SIGSTOP)
    supervisor.kill()
    assert supervisor.wait() == -9
    wait(lambda: not any(start_of(pid) == start for pid, start in starts.items()))
    left = segments
    end = time.monotonic() + 10.0
    while left and time.monotonic() < end:
        left = {s for s in segments if Path(s).exists() and Path(s) in shm.leftovers()}
    assert left == set()
    assert Bag(tmp_path / "bag").topics["/robot_state"].count > 10  # closed in good order


def test_the_guard_ends_a_process_that_heeds_nothing(tmp_path, monkeypatch):
    """The supervisor dies with a child that ignores every signal but the last."""
    script = (
        "import os, sys\n"
        "from pathlib import Path\n"
        "import loco_bringup.graph.processes as p\n"
        "guard = p.Guard(0.05)\n"
        f"child = p.Process('stubborn', ['-c', {STUBBORN!r}], Path(sys.argv[1]), guard=guard)\n"
        "import time; time.sleep(0.5)\n"
        "sys.stdout.write(f'{child.pid} {guard._popen.pid}\\n'); sys.stdout.flush()\n"
        "os.kill(os.getpid(), 9)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "log")], stdout=subprocess.PIPE, text=True
    )
    child, guard = map(int, done.stdout.split())
    wait(lambda: not start_of(child), 20.0)  # it ignored the kernel's signal
    wait(lambda: not start_of(guard), 5.0)


def test_the_guard_leaves_with_the_run(tmp_path):
    guard = Guard()
    process = Process("quick", ["-c", "raise SystemExit(4)"], tmp_path / "log", guard=guard)
    wait(lambda: process.code is not None)
    assert stop_all([process], guard) == {"quick": 4}
    assert guard._popen.returncode == 0


# ---- shared memory


def test_leftovers_of_the_dead_are_removed_and_the_living_keep_theirs():
    code = "import rclpy; rclpy.init(); n = rclpy.create_node('a'); input()"
    pair = [
        subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, env=environment())
        for _ in range(2)
    ]
    try:
        wait(lambda: all(len(opened_by([p.pid])) >= 3 for p in pair))
        living, dead = (opened_by([p.pid]) for p in pair)
        # Ports are open in all that write to them, the living one too.
        living, dead = ({s for s in each if "port" not in s} for each in (living, dead))
        pair[1].kill()
        pair[1].wait()
        found = {str(path) for path in shm.leftovers()}
        assert dead <= found
        assert not {name for name in found if any(name.startswith(stem) for stem in living)}
        files, size = shm.clean()
        assert files >= len(dead)
        assert size > 0
        assert not any(Path(name).exists() for name in dead)
        assert all(Path(name).exists() for name in living)
    finally:
        for each in pair:
            each.kill()
            each.wait()
        shm.clean()


def test_a_free_semaphore_and_foreign_names_are_left_alone(tmp_path):
    for name in ("sem.fastrtps_port7411_mutex", "fastrtps_notes", "other", "fastrtps_port7413_el"):
        (tmp_path / name).touch()
    assert shm.leftovers(tmp_path) == [tmp_path / "fastrtps_port7413_el"]


def test_a_locked_segment_is_not_a_leftover(tmp_path):
    import fcntl

    lock = tmp_path / "fastrtps_0123456789abcdef_el"
    with open(lock, "w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert shm.leftovers(tmp_path) == []
    assert shm.leftovers(tmp_path) == [lock]


def environment():
    env = dict(os.environ)
    env.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    return env


def test_a_supervisor_keeps_the_newest_events_only(tmp_path):
    """Each time-out of a busy machine is an event: a run of an hour had thousands."""
    watch = Watch([], tmp_path, 1.0, lambda progress: None, {"": "hyq"})
    for tick in range(LIMIT + 5):
        watch.on_event("", SimpleNamespace(kind="timeout", tick=tick, text="", node="robot_sim"))
    ticks = [event.tick for _, event in watch._progress.events]
    assert ticks == list(range(5, LIMIT + 5))


def test_ctrl_c_within_a_message_ends_the_run_after_it(tmp_path):
    """A KeyboardInterrupt within a message became a RuntimeError in the executor's C++."""
    watch = Watch([], tmp_path, 1.0, lambda progress: None, {"": "hyq"})
    calls, done, handler = [], threading.Event(), signal.getsignal(signal.SIGINT)

    def on_diagnostics(array):
        calls.append("begins")
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(1000):
            pass  # the signal is delivered here
        calls.append("ends")

    watch.on_diagnostics = on_diagnostics
    context = rclpy.Context()
    rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = sealed_node("speaker", context=context)
    publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def speak():
        while not done.wait(0.05):
            publisher.publish(DiagnosticArray())

    thread = threading.Thread(target=speak)
    thread.start()
    try:
        outcome = watch.run()
    finally:
        done.set()
        thread.join()
        node.destroy_node()
        context.try_shutdown()
    assert outcome.interrupted and calls[:2] == ["begins", "ends"]
    assert signal.getsignal(signal.SIGINT) is handler
