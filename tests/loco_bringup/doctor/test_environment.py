# SPDX-License-Identifier: Apache-2.0
"""Planted faults are found and named; a healthy graph has none.

Takes half a minute: faults of graphs are planted in real ones, which have to be heard.
"""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest

from loco_bringup.doctor import environment as doctor
from loco_bringup.doctor.graph import check_graph, check_plants
from loco_bringup.doctor.top import text
from loco_bringup.graph.processes import _environment
from loco_bringup.graph.view import GraphObserver, Report, View
from loco_bringup.testing import Graph

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("graph")]

GENERATOR = "loco_control.ros.target_node:TargetGeneratorNode"
LONG = {"learner.train": 600.0}


def named(found):
    return {finding.fault for finding in found}


def alone(found, *faults):
    """Each fault is found once: an onlooker may hear a node of a busy machine late."""
    return all([finding.fault for finding in found].count(fault) == 1 for fault in faults)


def the(found, fault):
    """The only finding of a fault."""
    (one,) = [finding for finding in found if finding.fault == fault]
    return one


# ---- environment


@pytest.mark.parametrize(
    ("env", "fault", "words"),
    [
        ({"ROS_DOMAIN_ID": "240"}, "domain", "'240'"),
        ({"ROS_DOMAIN_ID": "one"}, "domain", "'one'"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, "discovery range", "do not find each other"),
        ({"RMW_IMPLEMENTATION": "rmw_zenoh_cpp"}, "middleware", "rmw_zenoh_cpp"),
        ({"ROS_DISTRO": "humble"}, "environment", "humble"),
    ],
)
def test_a_wrong_environment_is_named(env, fault, words):
    (finding,) = doctor.check_environment(env)
    assert finding.fault == fault
    assert words in finding.text


def test_a_right_environment_is_not_blamed():
    good = {"ROS_DOMAIN_ID": "7", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_DISTRO": "jazzy"}
    assert doctor.check_environment(good) == []
    assert doctor.check_environment({}) == []


def test_the_command_says_it_in_json_and_by_its_exit_code():
    env = {**_environment(), "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}
    command = [sys.executable, "-m", "loco_bringup.cli.main", "doctor", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, env=env, timeout=60)
    assert done.returncode == 1, done.stderr
    assert named(doctor.Finding(**row) for row in json.loads(done.stdout)) == {"discovery range"}


# ---- message packages


def test_messages_that_are_not_built_are_named(tmp_path):
    found = doctor.check_messages(path=[str(tmp_path)])
    assert named(found) == {"messages not built"}
    assert "loco_msgs" in found[0].text


def test_messages_of_other_definitions_are_named(tmp_path):
    source, built = tmp_path / "src/loco_msgs/msg", tmp_path / "share/loco_msgs/msg"
    for folder, line in ((source, "float64 a\n"), (built, "float64 b\n")):
        folder.mkdir(parents=True)
        (folder / "Event.msg").write_text(line)
    finding = the(doctor.check_messages(tmp_path / "src", tmp_path), "messages mismatched")
    assert "Event.msg" in finding.text


# ---- shared memory


def test_what_killed_processes_left_is_noted(tmp_path):
    (tmp_path / "fastrtps_0123456789abcdef_el").touch()
    finding = the(doctor.check_shared_memory(tmp_path), "shared memory left")
    assert not finding.grave


# ---- a graph without its plant, a clash, a wrong type and a wrong QoS


PLANTED = {"missing endpoint", "domain clash", "type", "QoS"}


@pytest.fixture(scope="module")
def planted():
    """Findings of a graph with four faults, what another domain sees of it, and its processes.

    A reader would refuse the second writer and end, so these graphs are generators alone.
    """
    import rclpy
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from std_msgs.msg import Float64

    command = [sys.executable, "-m", "loco_bringup.graph.composed"]
    runs = [subprocess.Popen([*command, GENERATOR], env=_environment()) for _ in range(2)]
    top = [sys.executable, "-m", "loco_bringup.cli.main", "top"]
    runs.append(subprocess.Popen(top, env=_environment(), stdout=subprocess.DEVNULL))
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    user = rclpy.create_node("user", context=context)
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    user.create_publisher(Float64, "gait_frequency", best_effort)
    user.create_publisher(Float64, "cmd_vel", 1)
    try:
        with GraphObserver() as onlooker:
            end, found = time.monotonic() + 40.0, []
            while time.monotonic() < end and not PLANTED <= named(found):
                view = onlooker.listen(1.0)
                known = all(e.named for e in view.endpoints)
                watched = any(e.node.startswith("onlooker_") for e in view.endpoints)
                found = check_graph(view) if known and watched else []
            ours = os.environ["ROS_DOMAIN_ID"]
            other = {"ROS_DOMAIN_ID": "100" if ours == "101" else "101"}
            return found, doctor.check_elsewhere(other), [run.pid for run in runs[:2]]
    finally:
        user.destroy_node()
        context.try_shutdown()
        for run in runs:
            run.kill()
            run.wait()


def test_a_missing_node_is_named_with_its_topics(planted):
    texts = [f.text for f in planted[0] if f.fault == "missing endpoint"]
    assert any(
        "robot_sim is missing: nobody writes robot_state" in t.replace("/", "") for t in texts
    )


def test_an_open_top_is_not_blamed(planted):
    assert not [f.text for f in planted[0] if "onlooker" in f.text]


def test_a_second_graph_on_the_domain_is_named_with_its_processes(planted):
    found, _, pids = planted
    finding = the(found, "domain clash")
    assert "gait_target has 2 writers" in finding.text
    assert all(str(pid) in finding.text for pid in pids)


def test_a_type_that_does_not_match_is_named(planted):
    finding = the(planted[0], "type")
    assert "/cmd_vel has 2 types" in finding.text
    assert "user" in finding.text


def test_a_qos_that_does_not_match_is_named(planted):
    finding = the(planted[0], "QoS")
    assert "/gait_frequency: target_generator wants user to be reliable" in finding.text


def test_a_graph_on_another_domain_is_pointed_at(planted):
    found = [f for f in planted[1] if f"domain {os.environ['ROS_DOMAIN_ID']}" in f.text]
    assert named(found) == {"other domain"}
    assert all(str(pid) in found[0].text for pid in planted[2])


# ---- a graph that stands still


def look(seconds, until):
    """Findings, and what they were read from, once they fit or after what a busy machine needs."""
    end = time.monotonic() + 90.0
    with GraphObserver() as onlooker:
        view = onlooker.listen(seconds)
        while not until(check_graph(view)) and time.monotonic() < end:
            view = onlooker.listen(1.0)
    return check_graph(view), view


def test_a_stopped_node_is_named_as_the_one_that_owes_the_tick(tmp_path):
    with Graph("hyq_short", tmp_path / "g", LONG, layout="processes") as graph:
        found, view = look(3.0, until=lambda found: not any(f.grave for f in found))
        assert not any(f.grave for f in found), found
        shown = text(view)
        assert "x real time, clock lockstep, phase" in shown
        assert all(name in shown for name in ("robot_sim", "stance_controller", "recorder"))
        pid = graph.pid("stance_controller")
        os.kill(pid, signal.SIGSTOP)
        found, _ = look(4.0, until=lambda found: alone(found, "ticks", "node silent"))
        owes = the(found, "ticks").text
        assert "trunk_torque does not come from stance_controller" in owes
        assert "is stopped (SIGSTOP)" in owes
        assert f"kill -CONT {pid}" in the(found, "node silent").remedy
        os.kill(pid, signal.SIGCONT)
        graph.expect_event("phase")
    assert set(graph.exit_codes.values()) == {0}


def test_late_commands_are_named_as_time_outs(tmp_path):
    changes = {"duration": 60.0}
    options = {"layout": "processes", "clock": "realtime"}
    with Graph("servo_pendulum_sine", tmp_path / "g", changes, **options) as graph:
        pid = graph.pid("reflex_network")
        os.kill(pid, signal.SIGSTOP)
        found, _ = look(3.0, until=lambda found: "time-out" in named(found))
        os.kill(pid, signal.SIGCONT)
    assert "robot_sim got no fresh command in" in the(found, "time-out").text


# ---- reports alone


def plant(**values):
    values = {"clock": "realtime", "real_time_factor": "1.0", **values}
    return View(reports={"robot_sim": Report(0, "running", values, 0.1)})


def test_a_clock_that_is_not_met_and_an_emergency_stop_are_named():
    assert not list(check_plants(plant()))
    assert named(check_plants(plant(real_time_factor="0.5"))) == {"real-time factor"}
    assert not list(check_plants(plant(real_time_factor="0.5", clock="lockstep")))
    assert named(check_plants(plant(estop="topic estop"))) == {"emergency stop"}


def test_an_empty_domain_is_told():
    assert named(check_graph(View())) == {"no graph"}


def test_warnings_of_nodes_are_passed_on():
    report = Report(1, "rejected 3 reaches 1", {}, 0.1)
    found = check_graph(View(reports={"a/robot_sim": report}))
    assert the(found, "warning").text == "a/robot_sim: rejected 3 reaches 1"
    silent = replace(report, age=9.0)
    assert named(check_graph(View(reports={"x": silent}))) == {"node silent"}


def test_top_says_when_nobody_speaks():
    assert "no node speaks" in text(View())
