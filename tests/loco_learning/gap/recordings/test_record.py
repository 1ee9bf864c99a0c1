# SPDX-License-Identifier: Apache-2.0
"""Records: shapes, columns by robot, parts in time."""

import pickle

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_learning.gap.recordings.record import HELD_OUT, Record
from loco_sim.robot import robot as robots

ROBOT = robots.load("tigrillo")
DRIVEN = tuple(ROBOT.joints[i] for i in ROBOT.driven)
COUNT, RATE = 50, 100.0


def record(**changes) -> Record:
    """Joints in the reverse of the robot's order; every value says its joint and row."""
    rows = np.arange(COUNT)[:, None]
    joints, driven = ROBOT.joints[::-1], DRIVEN[::-1]
    values = {
        "name": "made",
        "t": np.arange(COUNT) / RATE,
        "command": {"position": rows + 1000.0 * index(driven)},
        "driven": driven,
        "signals": {"q": rows + 1000.0 * index(joints), "gyro": np.zeros((COUNT, 3))},
        "joints": joints,
    }
    return Record(**(values | changes))


def index(names) -> np.ndarray:
    return np.array([ROBOT.joints.index(name) for name in names])


def test_columns_follow_the_robot():
    found = record().command_of(ROBOT, "position")
    assert np.array_equal(found[3], 3 + 1000.0 * ROBOT.driven)
    assert np.array_equal(
        record().joints_of(ROBOT, "q")[7], 7 + 1000.0 * np.arange(len(ROBOT.joints))
    )


def test_what_was_not_measured_is_nan():
    part = record(signals={"q": np.ones((COUNT, 1))}, joints=(ROBOT.joints[2],))
    found = part.joints_of(ROBOT, "q")
    assert np.all(found[:, 2] == 1.0) and np.isnan(found).sum() == COUNT * (len(ROBOT.joints) - 1)
    assert np.all(np.isnan(part.joints_of(ROBOT, "dq")))
    assert part.has("q") and not part.has("dq")
    part = record(signals={"grf": np.ones((COUNT, 1))}, feet=("left",))
    assert np.array_equal(part.feet_of(["right", "left"])[0], [np.nan, 1.0], equal_nan=True)


def test_a_part_keeps_values_and_starts_at_zero():
    part = record(inputs={"supply": np.arange(COUNT) / 10.0}).between(0.1, 0.2)
    assert part.t[0] == 0.0 and len(part.t) == 11 and part.dt == pytest.approx(1.0 / RATE)
    assert part.duration == pytest.approx(0.1) and part.inputs["supply"][0] == 1.0
    assert np.array_equal(part.signals["q"], record().signals["q"][10:21])
    assert part.rows(2, 5, "p").name == "p"


def test_a_record_travels_between_processes():
    copy = pickle.loads(pickle.dumps(record(role=HELD_OUT)))
    assert copy.role == HELD_OUT and np.array_equal(copy.t, record().t)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"t": np.zeros(1)}, "two samples"),
        ({"t": np.arange(COUNT) ** 2.0}, "even"),
        ({"t": 1.0 + np.arange(COUNT)}, "start at 0"),
        ({"command": {"position": np.zeros((COUNT, 9))}}, r"command position .*\(50, 9\)"),
        ({"signals": {"q": np.zeros((COUNT, 1))}}, r"q has the shape \(50, 1\)"),
        ({"inputs": {"supply": np.zeros((COUNT, 1))}}, "input supply"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(changes, said):
    with pytest.raises(ParameterError, match=said):
        record(**changes)


def test_unknown_names_list_the_known():
    with pytest.raises(NameUnknownError, match="available: acceleration"):
        record(signals={"speed": np.zeros((COUNT, 8))})
    with pytest.raises(NameUnknownError, match="ramp .* available: position"):
        record(ramps=("torque",))
    with pytest.raises(NameUnknownError, match="position, torque, velocity"):
        record(command={"force": np.zeros((COUNT, 4))})


def test_a_missing_joint_or_command_is_named():
    lacking = record(driven=("wheel",), command={"position": np.zeros((COUNT, 1))})
    with pytest.raises(ParameterError, match="no commands of .*it has wheel"):
        lacking.command_of(ROBOT, "position")
    with pytest.raises(ParameterError, match="no torque command; it has position"):
        record().command_of(ROBOT, "torque")
    with pytest.raises(ParameterError, match="no two"):
        record().rows(5, 6)


def test_a_rest_before_a_record_holds_its_first_command_and_positions():
    joints, rows = ROBOT.joints, np.arange(COUNT)[:, None]
    signals = {"q": rows + np.zeros(len(joints)), "dq": np.ones((COUNT, len(joints)))}
    signals["tau"] = np.ones((COUNT, len(joints)))
    part = record(joints=joints, signals=signals).rested(0.2)
    assert len(part.t) == COUNT + 20 and part.dt == pytest.approx(1.0 / RATE)
    assert np.all(part.command["position"][:21] == part.command["position"][20])
    assert np.all(part.signals["q"][:21] == 0.0) and np.all(part.signals["q"][21] == 1.0)
    assert np.all(part.signals["dq"][:20] == 0.0) and np.all(part.signals["dq"][20:] == 1.0)
    assert np.all(np.isnan(part.signals["tau"][:20]))
    for signal in ("q", "dq", "tau"):  # the rest is for the model alone
        read = np.isfinite(part.read_of(ROBOT, signal))
        assert not read[:20].any() and read[20:].all()
    assert np.all(signals["q"] == rows) and record().rested(0.0).t[-1] == record().t[-1]
