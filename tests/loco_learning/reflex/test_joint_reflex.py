# SPDX-License-Identifier: Apache-2.0
"""Closed loop of joint robots: schedule, scaling, learning, weight files, the loop itself."""

from types import SimpleNamespace

import numpy as np
import pytest

from loco_control.exceptions import MissingFileError, NameUnknownError, ParameterError
from loco_control.orientation import quaternion
from loco_control.types import MotionCommand
from loco_learning import archive
from loco_learning.params import INPUTS, PHASES, JointLearnerParams, LearnerParams
from loco_learning.reflex.joint_sensors import sensor_kinds, sensor_vector
from loco_learning.reflex.network import ReflexNetwork
from loco_learning.reflex.senses import BodySensors, FootForces

DT = 0.01
SHORT = {"neurons": 60, "memory": 40, "stand": 0.5, "train": 8.0, "closing": 4.0, "test": 4.0}
SENSORS = ("joint",) * 4 + ("gyro",) * 3 + ("tilt",) * 2
ROBOT = SimpleNamespace(joints=tuple("abcdefgh"), driven=np.array([0, 2, 4, 6]))


def network(seed=0, sensors=SENSORS, **changes):
    params = JointLearnerParams(
        **{"enabled": True, "tilt_scale": 0.1, "regularisation": 1.0, **SHORT, **changes}
    )
    return ReflexNetwork(params, BodySensors(params, sensors, 4), DT, seed)


def step(made, tick, felt):
    """What a network says at a tick: positions, velocities, prediction, phase and error."""
    target = MotionCommand(tick, tick * DT, *target_at(tick))
    command, learning = made.step(tick, tick * DT, felt, target)
    return command.q, command.dq, learning.prediction[:4], learning.phase, learning.error


def target_at(tick):
    """Sines of 1 Hz with a second harmonic, front and hind in antiphase."""
    angle = 2.0 * np.pi * tick * DT + np.array([0.0, 0.0, np.pi, np.pi])
    q = 0.4 * np.sin(angle) + 0.1 * np.cos(2.0 * angle)
    dq = 2.0 * np.pi * (0.4 * np.cos(angle) - 0.2 * np.sin(2.0 * angle))
    return q, dq


class Body:
    """Passive knees and a base that follow the hips with a lag, as springs do."""

    def __init__(self):
        self.knee, self.pitch = np.zeros(4), 0.0

    def sensors(self):
        return np.concatenate((0.8 * self.knee, [0.0, self.pitch, 0.0], [0.0, 0.1 * self.pitch]))

    def step(self, hip):
        self.knee += DT / 0.08 * (hip - self.knee)
        self.pitch += DT / 0.15 * (hip[0] - hip[2] - self.pitch)


def drive(made, start, stop, body=None):
    """Answers of a network over ticks [start, stop) around the body."""
    body, answers = body or Body(), []
    for tick in range(start, stop):
        answers.append(step(made, tick, body.sensors()))
        body.step(answers[-1][0])
    return answers


def column(answers, index):
    return np.array([answer[index] for answer in answers])


END = 1650  # ticks of SHORT


def test_sensors_are_passive_joints_gyro_roll_and_pitch():
    state = SimpleNamespace(
        q=np.arange(8.0),
        angular_velocity=np.array([0.1, 0.2, 0.3]),
        orientation=quaternion(0.05, -0.1, 2.0),
    )
    values = sensor_vector(state, ROBOT)
    np.testing.assert_allclose(values, [1, 3, 5, 7, 0.1, 0.2, 0.3, 0.05, -0.1], atol=1e-12)
    assert sensor_kinds(ROBOT) == SENSORS
    turned = SimpleNamespace(**{**vars(state), "orientation": quaternion(0.05, -0.1, -1.0)})
    np.testing.assert_allclose(sensor_vector(turned, ROBOT), values, atol=1e-12)  # no heading


def test_switched_off_it_hands_the_target_through_and_holds_nothing():
    made = network(enabled=False)
    for tick in (0, 700, 1500, 5000):
        answer = step(made, tick, None)
        np.testing.assert_array_equal(answer[:2], target_at(tick))
        assert not answer[2].any()
        assert (PHASES[answer[3]], answer[4]) == ("train", 0.0)
    assert made.parts() == {}
    made.reset()


def test_target_drives_until_closing_then_the_readout_does():
    answers = drive(network(), 0, END)
    np.testing.assert_array_equal(np.flatnonzero(np.diff(column(answers, 3))) + 1, [50, 850, 1250])
    target = np.array([target_at(tick) for tick in range(END)])
    np.testing.assert_array_equal(column(answers, 0)[:850], target[:850, 0])
    np.testing.assert_array_equal(column(answers, 1)[:850], target[:850, 1])
    np.testing.assert_array_equal(column(answers, 0)[850:], column(answers, 2)[850:])
    rms = np.sqrt(np.mean((column(answers, 2) - target[:, 0]) ** 2, axis=1))
    np.testing.assert_allclose(column(answers, 4), rms, atol=1e-12)


def test_the_loop_keeps_the_rhythm_alone():
    made, body = network(), Body()
    answers, norm = drive(made, 0, END, body), made.norm
    answers += drive(made, END, END + 1000, body)  # ten more strides than were asked for
    assert made.norm == norm  # nothing learns in test
    q = column(answers, 0)[END:, 0]
    assert np.ptp(q) == pytest.approx(np.ptp([target_at(k)[0][0] for k in range(100)]), rel=0.1)
    crossings = np.flatnonzero((q[:-1] < 0) & (q[1:] >= 0))
    assert np.mean(np.diff(crossings)) * DT == pytest.approx(1.0, rel=0.02)
    untrained = drive(network(train=0.0, closing=0.0), 0, 900)[-1]
    assert not untrained[0].any()


def test_what_it_says_depends_on_what_it_feels():
    made = network()
    drive(made, 0, 1300)
    numb = [step(made, k, np.zeros(9))[0] for k in range(1300, 1500)]
    assert np.ptp(numb[-50:], axis=0).max() < 1e-9  # constant senses, constant answer


def test_wild_sensors_are_clipped():
    made, other = network(), network()
    for tick in range(60):
        a = step(made, tick, np.full(9, 1e9))
        b = step(other, tick, np.full(9, 1e6))
        np.testing.assert_array_equal(a[2], b[2])
    assert np.isfinite(a[2]).all()


@pytest.mark.parametrize("inputs", INPUTS)
def test_only_the_chosen_sensors_count(inputs):
    made, other = network(inputs=inputs), network(inputs=inputs)
    felt = np.isin(SENSORS, INPUTS[inputs])
    rng = np.random.default_rng(0)
    for tick in range(120):
        values = rng.normal(size=9)
        changed = np.where(felt, values, rng.normal(size=9))
        a = step(made, tick, values)
        b = step(other, tick, changed)
        np.testing.assert_array_equal(a[2], b[2])


def test_same_seed_same_bits_and_reset_starts_again():
    first = network(3)
    before = column(drive(first, 0, 1000), 2)
    first.reset()
    np.testing.assert_array_equal(column(drive(first, 0, 1000), 2), before)
    np.testing.assert_array_equal(column(drive(network(3), 0, 1000), 2), before)
    assert not np.array_equal(column(drive(network(4), 0, 1000), 2), before)


@pytest.mark.parametrize("tick", [0, 400, 1000, 1400])
def test_a_saved_network_goes_on_bit_by_bit(tmp_path, tick):
    made, body, other = network(5, window=3), Body(), Body()
    drive(made, 0, tick, body)
    other.knee, other.pitch = body.knee.copy(), body.pitch
    made.save(tmp_path / "net.npz")
    loaded = ReflexNetwork.load(tmp_path / "net.npz")
    assert loaded.params == made.params
    assert loaded.senses.sensors == made.senses.sensors
    expected, got = drive(made, tick, END, body), drive(loaded, tick, END, other)
    np.testing.assert_array_equal(column(expected, 0), column(got, 0))


def test_weights_from_a_file_drive_and_never_change(tmp_path):
    trained = network(5)
    drive(trained, 0, END)
    path = tmp_path / "deep" / "net.npz"
    trained.save(path)
    reuse = network(99, weights=str(path), train=2.0, closing=0.0)
    answers = drive(reuse, 0, 1250)
    assert reuse.norm == trained.norm
    assert np.ptp(column(answers, 0)[800:, 0]) > 0.7
    reuse.reset()
    np.testing.assert_array_equal(column(drive(reuse, 0, 1250), 0), column(answers, 0))


def test_a_weight_file_that_does_not_fit_is_refused(tmp_path):
    path = tmp_path / "net.npz"
    network(neurons=10).save(path)
    with pytest.raises(ParameterError, match="learner.neurons is 12.*have 10"):
        network(neurons=12, weights=str(path))
    with pytest.raises(ParameterError, match=r"shape \(400, 10\) for hidden.weights, not \(280"):
        network(neurons=10, weights=str(path), sensors=SENSORS[:6])
    with pytest.raises(MissingFileError, match="nowhere.npz"):
        network(weights=str(tmp_path / "nowhere.npz"))
    feet = LearnerParams(neurons=10, weights=str(path))
    with pytest.raises(ParameterError, match="joint_weights file of format 1; wanted is a weights"):
        ReflexNetwork(feet, FootForces(feet), DT)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"learner": {"neurons": 5000}}, "holds shape .* for hidden.weights"),
        ({"learner": {"memory": 1000}}, "holds shape .* for hidden.weights"),
        ({"learner": {"neurons": "many"}}, "neurons"),
        ({"outputs": 900}, "holds shape .* for readout.weights"),
        ({"outputs": 10**12}, "outputs must be in"),
        ({"sensors": "joint"}, "sensors must be a list"),
        ({"sensors": ["nose"] * 10}, "none is of that kind"),
        ({"dt": float("nan")}, "dt must be a finite number"),
        ({"seed": -1}, "seed must be in"),
    ],
)
def test_values_of_a_weight_file_are_checked_before_room_is_taken(tmp_path, changes, words):
    path = tmp_path / "net.npz"
    network(neurons=10).save(path)
    meta, arrays = archive.read(path, "joint_weights")
    learner = meta["learner"] | changes.pop("learner", {})
    archive.write(path, "joint_weights", {**meta, **changes, "learner": learner}, arrays)
    with pytest.raises(ParameterError, match=words) as error:
        ReflexNetwork.load(path)
    assert "net.npz" in str(error.value)


@pytest.mark.parametrize("value", [np.nan, "a"])
def test_arrays_of_a_weight_file_are_numbers(tmp_path, value):
    path = tmp_path / "net.npz"
    network(neurons=10).save(path)
    meta, arrays = archive.read(path, "joint_weights")
    arrays["readout.weights"] = np.full(arrays["readout.weights"].shape, value)
    archive.write(path, "joint_weights", meta, arrays)
    with pytest.raises(ParameterError, match="for readout.weights, with NaN or of a wrong kind"):
        ReflexNetwork.load(path)


def test_wrong_parameters_are_refused():
    with pytest.raises(ParameterError, match="longer than 0 s"):
        JointLearnerParams(stand=0.0, train=0.0, closing=0.0, test=0.0)
    with pytest.raises(NameUnknownError, match="all, imu, joints"):
        JointLearnerParams(inputs="eyes")
    with pytest.raises(ParameterError, match="'joints', but of the sensors of this robot"):
        network(inputs="joints", sensors=("gyro",) * 3)
    with pytest.raises(ParameterError, match="joint_scale must be in"):
        JointLearnerParams(joint_scale=0.0)
