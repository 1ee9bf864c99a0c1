# SPDX-License-Identifier: Apache-2.0
"""Forward runs: what the model itself did is predicted to the last bit."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.gap.prediction import running
from loco_learning.gap.prediction.forward import Forward, ForwardParams, shifted
from loco_learning.gap.recordings.record import Record
from loco_learning.params import JointLearnerParams
from loco_learning.runs.experiment import Experiment
from loco_learning.runs.rollout import rollout
from loco_sim.plant.model import Model
from loco_sim.robot.robot import ASSETS

EXACT = {"sensors.exact": True}
AIR = {"fixed_base": True, "height": 1.0}
CLOSE = 1e-6  # 9 digits of pi in the URDF of HyQ make most of it
FRICTION = {"name": "coulomb_friction", "torque": 0.1}


def recorded(robot: str, overrides: dict, effects: tuple = (), duration: float = 1.0) -> Record:
    """What `rollout` measures on a robot, as a record."""
    experiment = Experiment(
        robot=robot,
        duration=duration,
        overrides=overrides,
        effects=effects,
        learner=JointLearnerParams(enabled=False),
    )
    log, plant = rollout(experiment), experiment.plant
    signals = {
        "q": log.q,
        "dq": log.dq,
        "tau": log.tau,
        "gyro": log.gyro,  # a real IMU speaks on a stand as well
        "acceleration": log.acceleration,
        "orientation": log.imu_orientation,
        "base_position": log.position,
        "base_orientation": log.orientation,
    }
    said = {"position": log.command, "velocity": log.command_dq}
    if robot == "pendulum":
        said = {"torque": log.command}
    driven = tuple(plant.joints[i] for i in plant.driven)
    known = {key: value for key, value in overrides.items() if key in AIR}
    about = {"overrides": known, "joint_torque": True}
    return Record(robot, log.t, said, driven, signals, plant.joints, **about)


@pytest.mark.pybullet
@pytest.mark.parametrize(
    ("robot", "overrides"),
    [
        ("servo_pendulum", EXACT),
        ("pendulum", {}),
        ("hyq_leg", {}),
        ("tigrillo", EXACT),
        ("tigrillo", EXACT | AIR),
    ],
)
def test_a_run_of_the_model_leaves_no_residual(robot, overrides):
    record = recorded(robot, overrides)
    forward = Forward(Model(robot), [record])
    np.testing.assert_allclose(forward()[0], forward.measured[0], rtol=0.0, atol=CLOSE)
    assert forward.measured[0].shape == (len(record.t), len(forward.channels))


@pytest.mark.pybullet
def test_a_hidden_effect_leaves_one_that_naming_it_closes():
    record = recorded("servo_pendulum", EXACT, (FRICTION,))
    forward = Forward(Model("servo_pendulum"), [record])
    before, after = forward()[0], forward([FRICTION])[0]
    assert np.max(np.abs(before - forward.measured[0])) > 10.0 * forward.numeric.min()
    np.testing.assert_allclose(after, forward.measured[0], rtol=0.0, atol=CLOSE)


@pytest.mark.pybullet
def test_overrides_of_a_call_win_over_those_of_model_and_record():
    record = recorded("servo_pendulum", EXACT | {"drives.pivot.kp": 9.0})
    forward = Forward(Model("servo_pendulum", {"drives.pivot.kp": 5.0}), [record])
    found = forward(overrides={"drives.pivot.kp": 9.0})[0]
    np.testing.assert_allclose(found, forward.measured[0], rtol=0.0, atol=CLOSE)
    assert np.max(np.abs(forward()[0] - found)) > 0.01


def test_noise_and_rounding_of_sensors_are_not_predicted():
    record = recorded("tigrillo", AIR)
    noisy = Model("tigrillo", {}, [{"name": "sensor_noise", "q": 0.1}])
    assert np.array_equal(Forward(noisy, [record])()[0], Forward(Model("tigrillo"), [record])()[0])


def test_a_sliding_robot_speaks_in_metres_and_a_bolted_one_of_its_joints_only():
    record = recorded("linear_axis", {})
    units = {str(c): c.unit for c in Forward(Model("linear_axis"), [record]).channels}
    assert set(units.values()) == {"m", "m/s", "N"}
    assert {c.signal for c in Forward(Model("tigrillo"), [recorded("tigrillo", AIR)]).channels} == {
        "q", "dq", "tau",
    }  # fmt: skip


@pytest.mark.pybullet
def test_recordings_in_the_air_and_on_the_ground_go_together():
    air, ground = recorded("tigrillo", EXACT | AIR), recorded("tigrillo", EXACT)
    assert "gyro" in air.signals
    forward = Forward(Model("tigrillo"), [air, ground])
    for said, wanted in zip(forward(), forward.measured, strict=True):
        np.testing.assert_allclose(said, wanted, rtol=0.0, atol=CLOSE)
    base = [c.signal not in ("q", "dq", "tau") for c in forward.channels]
    assert any(base)
    assert np.all(np.isnan(forward.measured[0][:, base]))
    assert np.any(np.isfinite(forward.measured[1][:, base]))
    assert forward.channels == Forward(Model("tigrillo"), [ground]).channels


@pytest.mark.pybullet
def test_pieces_in_the_air_begin_anew_and_those_on_the_ground_err_alike():
    records = [recorded("tigrillo", EXACT | AIR), recorded("tigrillo", EXACT)]
    forward = Forward(Model("tigrillo"), records, ForwardParams(window=0.2))
    assert min(len(starts) for starts in forward.starts) > 1
    assert forward.begun() == [[s.row for s in forward.starts[0][1:]], []]


def test_the_numerical_error_is_small_and_of_the_model_alone():
    record = recorded("servo_pendulum", EXACT)
    forward = Forward(Model("servo_pendulum"), [record])
    spread = np.nanstd(forward.measured[0], axis=0)
    assert np.all(forward.numeric > 0.0)
    assert np.all(forward.numeric < 0.2 * spread)


def test_a_later_start_is_taken_from_the_measurements_and_its_transient_is_not_weighed():
    record = recorded("servo_pendulum", EXACT, duration=2.0).rows(100, 200)
    forward = Forward(Model("servo_pendulum"), [record])
    error = forward()[0] - forward.measured[0]
    assert np.isnan(error[0]).all() and np.isfinite(error[50:]).all()
    assert np.nanmax(np.abs(error[:, 0])) < 0.1 * np.nanstd(forward.measured[0][:, 0])


def test_a_robot_that_is_told_to_stay_has_come_to_rest_and_a_model_has_still_to():
    """A spring pulls at the carriage: in the measurement for ever, in the model from now on."""
    t = np.arange(500) / 250.0
    wanted = np.where(t < 1.0, 0.0, 0.05)[:, None]
    empty = Record("r", t, {"position": wanted}, ("slide",), {"q": wanted}, ("slide",))
    pull = {"name": "added_stiffness", "stiffness": 5.0, "rest": 0.5}
    (said,) = Forward(Model("linear_axis"), [empty])([pull])
    rested = empty.rows(200, 500)  # told to stay for 0.2 s more, there already
    forward = Forward(Model("linear_axis"), [replace(rested, signals={"q": said[200:]})])
    error = forward([pull])[0] - forward.measured[0]
    assert np.isnan(error[:49]).all()
    assert np.abs(error[50:]).max() < 0.05 * np.abs(forward([pull])[0][0] - said[200])


def test_the_torque_of_a_motor_has_no_spring_beside_it_in_it_unless_loco_recorded_it():
    t = np.arange(250) / 250.0
    wanted = (0.05 * np.sin(6.0 * t))[:, None]
    signals = {"q": wanted, "tau": wanted}
    motor = Record("r", t, {"position": wanted}, ("slide",), signals, ("slide",))
    spring = [{"name": "added_stiffness", "stiffness": 40.0}]
    (alone,), (both,) = (
        Forward(Model("linear_axis"), [record])(spring)
        for record in (motor, replace(motor, joint_torque=True))
    )
    (q, by_motor), (same, by_joint) = alone[1:].T, both[1:].T
    np.testing.assert_array_equal(q, same)
    assert by_joint - by_motor == pytest.approx(-40.0 * q, abs=0.05)  # means of a period
    assert np.abs(by_joint - by_motor).max() > 1.0


def test_a_bolted_leg_that_has_sagged_begins_where_it_hangs():
    """Its weight turns the joints by 10 mrad from the pose in which the model is put up."""
    robot, t = Model("hyq", AIR).make_robot(), np.arange(500) / 250.0
    stay = np.tile(robot.standing, (500, 1))
    empty = Record("r", t, {"position": stay}, robot.joints, {"q": stay}, robot.joints)
    (q,) = Forward(Model("hyq", AIR), [empty])()
    noisy = {"q": q[250:] + 4e-5 * np.random.default_rng(1).standard_normal((250, 12))}
    sag = np.abs(noisy["q"][0] - robot.standing).max()
    assert 0.005 < sag < 0.02
    forward = Forward(Model("hyq", AIR), [replace(empty.rows(250, 500), signals=noisy)])
    error = (forward()[0] - forward.measured[0])[50:60]  # the first that are weighed
    assert np.abs(error.mean(axis=0)).max() < 0.01 * sag


@pytest.mark.parametrize(
    ("effect", "values"),
    [("sensor_bias", {"q": 0.004}), ("sensor_gain", {"q": 0.1}),
     ("sensor_nonlinearity", {"quadratic": 1.0, "cubic": -4.0}),
     ("sensor_latency", {"delay": 0.004})],
)  # fmt: skip
def test_a_robot_that_moves_begins_where_it_is_and_not_where_bent_or_late_sensors_say(
    effect, values
):
    t = np.arange(500) / 250.0
    wanted = (0.1 * np.sin(9.0 * t))[:, None]
    empty = Record("r", t, {"position": wanted}, ("slide",), {"q": wanted}, ("slide",))
    spec = {"name": effect, **values}
    (said,) = Forward(Model("linear_axis"), [empty])([spec])
    cut = replace(empty.rows(188, 500), signals={"q": said[188:]})
    forward = Forward(Model("linear_axis"), [cut])
    assert abs(forward.starts[0][0].dq[0]) > 0.7
    (none,), (right,) = forward(), forward([spec])
    wrong = np.abs(none - said[188:])[1:].max()  # before the first nobody knows what was
    assert np.abs(right - said[188:])[1:].max() < 0.05 * wrong  # its speed is late, too


def test_a_shift_of_whole_samples_moves_rows():
    wave = np.sin(np.arange(60) * 0.2)[:, None]
    assert shifted(wave, 2.0)[10:-10] == pytest.approx(wave[8:-12], abs=1e-4)
    assert shifted(wave, 0.5)[10:-10, 0] == pytest.approx(
        np.sin((np.arange(60) - 0.5) * 0.2)[10:-10], abs=1e-3
    )


def test_a_shift_leaves_what_is_missing_and_does_not_ring_there():
    wave = 5.0 + np.sin(np.arange(60) * 0.2)[:, None]
    wave[40:] = np.nan
    moved = shifted(wave, 0.5)
    assert np.isnan(moved[40:]).all()
    assert np.max(np.abs(moved[:40] - wave[:40])) < 0.15


def test_a_pickled_one_says_the_same():
    forward = Forward(Model("servo_pendulum"), [recorded("servo_pendulum", EXACT)])
    assert np.array_equal(pickle.loads(pickle.dumps(forward))()[0], forward()[0])


def test_a_model_is_simulated_once_but_anew_from_other_initial_states(monkeypatch):
    runs = []
    run = running.run
    monkeypatch.setattr(running, "run", lambda *inputs: runs.append(inputs) or run(*inputs))
    record = recorded("servo_pendulum", EXACT)
    forward = Forward(Model("servo_pendulum"), [record], ForwardParams(window=0.2))
    runs.clear()
    (first,), (again,) = forward([FRICTION]), forward([FRICTION])
    assert len(runs) == 1 and np.array_equal(first, again, equal_nan=True)
    with pytest.raises(ValueError, match="read-only"):
        again[0] = 0.0
    others = forward([{**FRICTION, "torque": 0.2}]), forward([FRICTION], {"sim.gravity": 9.0})
    others += forward([FRICTION], step=0.5), forward.nudged(0.5)([FRICTION])
    assert len(runs) == 5
    assert not any(np.array_equal(first, other, equal_nan=True) for (other,) in others)


def test_records_alike_have_one_robot_and_others_their_own():
    record = recorded("servo_pendulum", EXACT)
    slow = replace(record, t=1.37 * record.t)
    light = replace(record, overrides={"sim.gravity": 1.6})
    forward = Forward(Model("servo_pendulum"), [record, replace(record, name="b"), slow, light])
    first, second, third, fourth = (forward.robot(i) for i in range(4))
    assert first is second and first.sim != third.sim and fourth.sim.gravity == 1.6
    (heavy,) = forward((), {"sim.gravity": 20.0}, only=[0])
    assert not np.array_equal(heavy, forward((), only=[0])[0])


def test_a_robot_without_drives_is_refused():
    record = recorded("servo_pendulum", EXACT)
    with pytest.raises(ParameterError, match="lists no drives"):
        Forward(Model("spring_mass"), [record])


def test_the_physics_fits_any_rate_of_samples():
    record = recorded("servo_pendulum", EXACT)
    uneven = Record(
        "r", record.t * 0.0053 / 0.01, record.command, record.driven, record.signals, record.joints
    )
    forward = Forward(Model("servo_pendulum"), [uneven])
    assert np.isfinite(forward()[0]).all()
    rate = forward.robot().sim.physics_rate
    assert rate >= 999.0 and rate * uneven.dt == pytest.approx(6.0, abs=1e-3)


def test_supply_and_switch_of_a_record_reach_the_servo():
    record = recorded("servo_pendulum", EXACT)
    half = np.full(len(record.t), 0.5)
    weak = replace(record, inputs={"supply": half})
    off = replace(record, inputs={"enable": 0.0 * half})
    full, weak, off = Forward(Model("servo_pendulum"), [record, weak, off])()
    assert np.std(full[:, 0]) > np.std(weak[:, 0]) > np.std(off[:, 0]) == 0.0


def test_late_sensors_say_what_was_true_a_while_ago():
    forward = Forward(Model("servo_pendulum", EXACT), [recorded("servo_pendulum", EXACT)])
    now, late = forward()[0], forward([{"name": "sensor_latency", "delay": 0.02}])[0]
    np.testing.assert_allclose(late[10:], now[8:-2], atol=1e-9)
    half = forward([{"name": "sensor_latency", "delay": 0.025}])[0]
    linear = 0.5 * (now[7:-3] + now[8:-2])
    assert np.max(np.abs(half[10:] - linear)) < 5e-3 * np.ptp(now)


def test_one_sensor_may_be_late_alone():
    forward = Forward(Model("servo_pendulum", EXACT), [recorded("servo_pendulum", EXACT)])
    assert [c.signal for c in forward.channels] == ["q", "dq", "tau"]
    latency = {"name": "sensor_latency", "delay": 0.02}
    now, every = forward()[0], forward([latency])[0]
    late = forward([{**latency, "channel": "dq"}])[0]
    np.testing.assert_array_equal(late[:, [0, 2]], now[:, [0, 2]])
    np.testing.assert_array_equal(late[:, 1], every[:, 1])


SPRING = "springs:\n  pivot: {kind: linear, stiffness: 3.0, damping: 0.1, rest: 0.2}\n"


@pytest.mark.pybullet
@pytest.mark.parametrize("spring", ["", SPRING])
def test_the_torque_of_a_drive_is_its_command_without_the_spring_beside_it(tmp_path, spring):
    for file in (ASSETS / "pendulum").glob("*.*"):
        text = file.read_text() + (spring if file.suffix == ".yaml" else "")
        (tmp_path / file.name).write_text(text)
    record, model = recorded("pendulum", {}), Model(str(tmp_path))
    pair = record, replace(record, joint_torque=False)
    (torque, speed), by_motor = (Forward(model, [each]).drives() for each in pair)
    told = np.clip(record.command["torque"], -2.0, 2.0)
    assert np.abs(speed).max() > 0.1
    np.testing.assert_allclose(torque[1:], told[:-1], atol=1e-9)
    np.testing.assert_array_equal((torque, speed), by_motor)


@pytest.mark.pybullet
@pytest.mark.parametrize("first", [False, True], ids=["of the drive first", "of the joint first"])
def test_records_with_torques_of_drives_and_of_joints_are_told_apart(first):
    pull = [{"name": "added_stiffness", "stiffness": 3.0}]
    pair = [replace(recorded("pendulum", {}), joint_torque=b) for b in (first, not first)]
    together = Forward(Model("pendulum"), pair)(pull)
    apart = [Forward(Model("pendulum"), [record])(pull)[0] for record in pair]
    np.testing.assert_array_equal(together, apart)
    assert not np.array_equal(*together)


def test_the_torque_of_a_geared_motor_is_not_that_of_its_joint():
    torque, _ = Forward(Model("servo_pendulum"), [recorded("servo_pendulum", EXACT)]).drives()
    assert np.isinf(torque).all()


def test_in_the_persistence_forecast_each_signal_keeps_its_first_value_in_a_piece():
    forward = Forward(Model("servo_pendulum"), [recorded("servo_pendulum", EXACT)])
    (y,), (whole,) = forward.measured, forward.persistence()
    seen = np.isfinite(y[:, 0])
    assert set(whole[seen, 0]) == {y[seen, 0][0]}
    cut = Forward(
        Model("servo_pendulum"), forward.records, params=ForwardParams(window=0.25, settling=0.0)
    )
    (y,), (parts,) = cut.measured, cut.persistence()
    for piece in cut.starts[0]:
        rows = slice(piece.row, piece.stop)
        seen = np.isfinite(y[rows, 0])
        assert set(parts[rows][seen, 0]) == {y[rows][seen, 0][0]}
    assert len(cut.starts[0]) > 2 and len(set(parts[np.isfinite(parts)])) > 2
