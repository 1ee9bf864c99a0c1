# SPDX-License-Identifier: Apache-2.0
"""Studies and the demo as a person starts them."""

import pytest

from loco_bringup.bag.reader import Bag
from loco_bringup.cli import demo
from loco_bringup.cli import main as cli
from loco_bringup.terminal import console, table

STUDY = """
description: Two seeds of a short run.
variants:
  short: {experiment: hyq_short, learner.train: 1.0, learner.closing: 0.5, learner.test: 0.5}
seeds: [0, 1]
metrics: [speed, nrmse]
figures: [trunk]
"""


def loco(*arguments):
    with pytest.raises(SystemExit) as end:
        cli.main([str(a) for a in arguments])
    return end.value.code


def test_a_study_leaves_table_and_figures_and_resumes(tmp_path, capsys):
    path, out = tmp_path / "two.yaml", tmp_path / "results"
    path.write_text(STUDY)
    assert loco("study", path, "--out", out, "--workers", "1", "--seeds", "1") == 0
    first = {p.name: p.stat().st_mtime_ns for p in out.glob("short_*.npz")}
    assert len(first) == 1
    assert loco("study", path, "--out", out, "--workers", "1") == 0
    assert {"table.md", "cases.csv", "trunk.png"} <= {p.name for p in out.iterdir()}
    again = {p.name: p.stat().st_mtime_ns for p in out.glob("short_*.npz")}
    assert len(again) == 2
    assert first.items() <= again.items()  # the case that was there was not run again
    printed = capsys.readouterr().out
    assert "short seed 1" in printed and "survived" in printed


def test_names_and_units_in_brackets_are_printed(capsys):
    console.print("position[knee] [deg]")
    console.print(table("t [s]", ("angle [rad]",), [("data[0]",)]))
    printed = capsys.readouterr().out
    assert all(text in printed for text in ("position[knee] [deg]", "[s]", "[rad]", "data[0]"))


@pytest.mark.parametrize(("option", "value"), [("--workers", "0"), ("--seeds", "-1")])
def test_studies_refuse_no_workers_and_no_seeds(option, value, capsys):
    assert loco("study", "open_loop", option, value) == 2
    assert "at least 1" in capsys.readouterr().err


@pytest.mark.ros
def test_demo_runs_records_replays_and_reports(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(demo, "EXPERIMENT", "hyq_short")
    folder = tmp_path / "demo"
    assert loco("demo", "--out", folder) == 0
    printed = capfd.readouterr().out
    assert "messages of" in printed and "report.html" in printed
    assert (folder / "report.html").is_file() and (folder / "gait.gif").is_file()
    assert Bag(folder).metadata["dropped"] == "0"


@pytest.mark.ros
@pytest.mark.xdist_group("graph")  # the runs it shares
def test_replay_sends_the_recorded_bytes(outcomes):
    """What a subscriber gets is what the bag holds, in order."""
    import threading
    import time

    import rclpy
    from rclpy.experimental import EventsExecutor
    from std_msgs.msg import String

    from loco_bringup.record.replayer import CONTROL, replay_bag
    from loco_control.ros.messages.topics import topic

    folder = outcomes["composed"].folder
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node("listener", context=context)
    got = []
    row = topic("motion_command")
    node.create_subscription(row.type, row.name, got.append, row.qos.tap(True), raw=True)
    control = node.create_publisher(String, CONTROL, 10)
    executor = EventsExecutor(context=context)
    executor.add_node(node)
    stop = threading.Event()

    def spin():
        while not stop.is_set():
            executor.spin_once(timeout_sec=0.05)
            if not got and node.count_publishers(row.name) and control.get_subscription_count():
                control.publish(String(data="resume"))

    thread = threading.Thread(target=spin)
    thread.start()
    assert replay_bag(folder, speed=1.0, topics=["motion_command"], pause=True) == 0
    recorded = Bag(folder).raw("motion_command")[1]
    end = time.monotonic() + 10.0
    while (not got or got[-1] != recorded[-1]) and time.monotonic() < end:
        time.sleep(0.05)
    stop.set()
    thread.join()
    node.destroy_node()
    context.try_shutdown()
    # The first messages may go out before the listener is matched; none is lost after.
    assert got == recorded[-len(got) :]
    assert len(got) > len(recorded) // 2
