# SPDX-License-Identifier: Apache-2.0
"""A run on servos: the driver stands where the plant stands, with its limits and stops."""

import numpy as np
import pytest

pytest.importorskip("dynamixel_sdk")

from loco_bringup.bag.reader import Bag  # noqa: E402
from loco_bringup.cli import main as cli  # noqa: E402
from loco_bringup.graph import run as runner  # noqa: E402
from loco_bringup.testing import servo_bus  # noqa: E402
from loco_control.exceptions import ParameterError  # noqa: E402
from loco_learning.runs.experiment import load  # noqa: E402

pytestmark = pytest.mark.ros
QUICK = {"duration": 3.0}


@pytest.fixture
def bus(tmp_path):
    with servo_bus() as bus:
        text = bus.file.read_text().replace("bus:", "bus:\n  missing: 200", 1)
        bus.file = tmp_path / "servos.yaml"
        bus.file.write_text(text)
        yield bus


def run(bus, folder, **options):
    """A run of the sine on the bus; its bag."""
    experiment = load("servo_pendulum_sine", QUICK)
    outcome = runner.run(
        experiment, folder, "processes", "realtime", hardware=str(bus.file), **options
    )
    assert not any(outcome.exit_codes.values()), outcome
    return Bag(folder)


def kinds(bag):
    return [event.kind for event in bag.messages("/events")]


def test_servos_follow_a_sine_and_are_limp_at_the_end(bus, tmp_path):
    bag = run(bus, tmp_path / "run")
    assert kinds(bag).count("approach") == 1 and "finished" in kinds(bag)
    states = bag.records("/joint_states")
    q = np.array([s[0] for s in states["position"]])
    assert np.ptp(q) > 0.8  # of 1.2 rad
    assert bag.metadata["hardware"] == bus.file.read_text()
    assert not any(bus.torques.values())


def test_a_hot_servo_stops_the_robot(bus, tmp_path):
    def heat(progress):
        if progress.sim_time > 1.0:
            bus.overheat(1)

    bag = run(bus, tmp_path / "run", on_progress=heat)
    (stop,) = [e for e in bag.messages("/events") if e.kind == "estop"]
    assert "servo 1 (pivot)" in stop.text
    assert not any(bus.torques.values())


def test_what_cannot_be_sent_to_servos_is_refused_before_anything_moves(bus, tmp_path):
    effects = load("servo_pendulum_sine", {"effects": [{"name": "coulomb_friction"}]})
    with pytest.raises(ParameterError, match="hardware brings its own"):
        runner.run(effects, tmp_path / "run", clock="realtime", hardware=str(bus.file))
    with pytest.raises(ParameterError, match="node set joint"):
        runner.run(load("hyq_short"), tmp_path / "run", clock="realtime", hardware=str(bus.file))
    assert not (tmp_path / "run").exists()
    assert not any(bus.torques.values())


def test_the_command_shows_the_servos(bus, capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(["hardware", "servo_pendulum", str(bus.file)])
    assert end.value.code == 0
    assert "pivot: " in capsys.readouterr().out
    bus.silence(1)
    with pytest.raises(SystemExit) as end:
        cli.main(["hardware", "servo_pendulum", str(bus.file)])
    assert end.value.code == 1
    assert "does not answer" in capsys.readouterr().err
