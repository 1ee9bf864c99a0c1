# SPDX-License-Identifier: Apache-2.0
"""Each effect does what its name says."""

from collections import deque

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.orientation import roll_pitch_yaw
from loco_control.types import MotionCommand, TrunkTorque
from loco_sim import effects
from loco_sim.effects.catalogue.delay import delayed
from loco_sim.effects.catalogue.faults import stuck
from loco_sim.effects.catalogue.noise import rotate
from loco_sim.geometry import rotation_matrix
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot
from loco_sim.robot.description import Description


class Recorder:
    """A world that only remembers pushes."""

    dt = 0.001

    def __init__(self):
        self.forces = []

    def push(self, force, link=None, point=(0, 0, 0)):
        self.forces.append(force)


@pytest.mark.parametrize("steps", [0, 1, 5])
def test_a_delay_shifts_a_signal_and_holds_its_first_value(steps):
    pending, signal = deque(), list(range(20))
    late = [delayed(pending, x, steps) for x in signal]
    assert late == [0] * steps + signal[: 20 - steps]


def test_a_late_command_is_the_command_of_before(plant, commands):
    late = plant(effects.from_list([{"name": "command_delay", "delay": 0.008}]))
    timely = plant()
    late.reset(), timely.reset()
    for k in range(30):
        a = late.step(*commands(k))
        # The same plant, given by hand the command of two ticks ago.
        command, trunk = commands(max(0, k - 2))
        b = timely.step(command, trunk)
    np.testing.assert_array_equal(a.q, b.q)


def test_a_limited_setpoint_is_a_ramp_to_each_step_however_it_is_computed(plant):
    """A step of s rad takes s / speed; a ramp that is slower is followed as it is."""
    wanted = np.concatenate([np.zeros(3), np.full(30, 0.2), 0.2 + 0.004 * np.arange(20)])
    speed, made = 0.01 / 0.001, effects.make("command_rate_limit", slowness=0.1)
    sim = plant([made])
    n, made._dt = len(sim.robot.joints), 0.001
    made.reset(None)
    targets = np.zeros((len(wanted), 4, n))
    targets[:, 0], targets[:, 1] = wanted[:, None], 99.0
    steps, which = made.on_sequence(targets, np.arange(len(wanted)))
    one = [made.on_command(row[0], row[1], 0.0) for row in targets]
    np.testing.assert_array_equal(steps[which][:, :2], np.array(one))
    np.testing.assert_allclose(np.diff(steps[2:22, 0, 0]), 0.01, atol=1e-12)
    np.testing.assert_array_equal(steps[23:, 0, 0], wanted[23:])
    assert np.all(steps[:, 1] == speed)


def test_a_drive_whose_setpoint_is_limited_is_one_with_the_effect(plant, commands):
    speed = {"drives.*_hfe_joint.setpoint_speed": 0.8}
    listed = {"name": "command_rate_limit", "slowness": 1.25, "joint": "*_hfe_joint"}
    own, other = plant(overrides=speed), plant(effects.from_list([listed]))
    own.reset(), other.reset()
    for k in range(10):
        a, b = own.step(*commands(k)), other.step(*commands(k))
    np.testing.assert_array_equal(a.q, b.q)


def test_one_sensor_is_late_and_the_others_are_not(plant, commands):
    latency = {"name": "sensor_latency", "delay": 0.008}
    sims = [plant(effects.from_list(e)) for e in ([], [latency], [{**latency, "channel": "q"}])]
    for sim in sims:
        sim.reset()
    for k in range(10):
        timely, late, one = (sim.step(*commands(k)) for sim in sims)
    np.testing.assert_array_equal(one.q, late.q)
    assert not np.array_equal(one.q, timely.q)
    for name in ("dq", "tau", "grf", "orientation", "angular_velocity", "linear_acceleration"):
        np.testing.assert_array_equal(getattr(one, name), getattr(timely, name))


def test_a_late_torque_takes_damping_away(plant, hyq):
    def swing(delay):
        sim = plant(effects.from_list([{"name": "actuation_delay", "delay": delay}]))
        sim.reset()
        pushed = MotionCommand(0, 0.0, hyq.standing + 0.05, np.zeros(12))
        trunk = TrunkTorque(0, 0.0, np.zeros(12), np.zeros(6), np.zeros(4, bool))
        return np.std([sim.step(pushed, trunk).dq for _ in range(100)])

    assert swing(0.006) > 1.2 * swing(0.0)


def test_noise_has_the_standard_deviation_asked_for(plant, commands):
    stds = {"q": 0.01, "dq": 0.1, "tau": 1.0, "grf": 5.0, "gyro": 0.02, "accelerometer": 0.3}
    effect = effects.make("sensor_noise", **stds, orientation=0.01)
    effect.reset(np.random.default_rng(0))
    state = plant().reset()
    drawn = [effect.on_measurement(state) for _ in range(3000)]
    named = {**{k: k for k in ("q", "dq", "tau", "grf")}}
    named |= {"gyro": "angular_velocity", "accelerometer": "linear_acceleration"}
    for channel, field in named.items():
        noise = np.array([getattr(d, field) - getattr(state, field) for d in drawn])
        assert noise.std() == pytest.approx(stds[channel], rel=0.05)
        assert abs(noise.mean()) < 0.1 * stds[channel]
    norms = [np.linalg.norm(d.orientation) for d in drawn]
    np.testing.assert_allclose(norms, 1.0, atol=1e-12)


def test_one_channels_noise_does_not_depend_on_another(plant):
    state = plant().reset()

    def noisy(**stds):
        effect = effects.make("sensor_noise", **stds)
        effect.reset(np.random.default_rng(0))
        return effect.on_measurement(state)

    np.testing.assert_array_equal(noisy(grf=1.0).grf, noisy(grf=1.0, q=0.1, gyro=1.0).grf)


def test_a_small_turn_turns_by_its_angle():
    angle = np.array([0.0, 0.0, 0.02])
    matrix = np.array(rotation_matrix(rotate(np.array([0.0, 0.0, 0.0, 1.0]), angle)))
    assert np.arctan2(matrix[3], matrix[0]) == pytest.approx(0.02, rel=1e-3)


def test_a_push_is_constant_when_not_random():
    effect, world = effects.make("push", force=(1.0, 2.0, 3.0)), Recorder()
    effect.reset(np.random.default_rng(0))
    for k in range(5):
        effect.on_step(world, k * 0.001)
    assert world.forces == [[1.0, 2.0, 3.0]] * 5


def test_a_random_push_stays_within_its_amplitude_and_changes_in_time():
    effect = effects.make("push", random=30.0, shortest=0.1, longest=1.0)
    world = Recorder()
    effect.reset(np.random.default_rng(0))
    for k in range(20000):
        effect.on_step(world, k * 0.001)
    forces = np.array(world.forces)
    assert np.abs(forces).max() <= 30.0
    assert np.abs(forces.mean(axis=0)).max() < 10.0
    changes = np.flatnonzero(np.abs(np.diff(forces, axis=0)).max(axis=1))
    waits = np.diff(changes) * 0.001
    assert waits.min() >= 0.1
    assert waits.max() <= 1.0 + 1e-9


def test_a_push_moves_the_robot_its_way(plant, run):
    shoved = plant(effects.from_list([{"name": "push", "force": [0, 150, 0], "stop": 0.1}]))
    run(shoved, 40)
    calm = plant()
    run(calm, 40)
    assert shoved.ground_truth().position[1] > calm.ground_truth().position[1] + 0.002


def test_a_payload_is_weighed_by_the_feet(plant, hyq):
    stiff = {"drives.*.kp": 400, "drives.*.kd": 10}
    hold = MotionCommand(0, 0.0, hyq.standing, np.zeros(12))
    trunk = TrunkTorque(0, 0.0, np.zeros(12), np.zeros(6), np.ones(4, bool))
    weights = []
    for mass in (0.0, 20.0):
        sim = plant(effects.from_list([{"name": "payload", "mass": mass}]), overrides=stiff)
        sim.reset()
        for _ in range(400):
            state = sim.step(hold, trunk)
        weights.append(state.grf[:, 2].sum())
        assert Description(sim.robot_description).mass() == pytest.approx(84.756 + mass)
    assert weights[1] - weights[0] == pytest.approx(20.0 * 9.81, rel=0.02)


def test_a_payload_can_be_on_any_link(plant):
    on_foot = plant(effects.from_list([{"name": "payload", "mass": 1.0, "link": "lf_lowerleg"}]))
    assert Description(on_foot.robot_description).mass() == pytest.approx(85.756)
    with pytest.raises(NameUnknownError, match="lf_toe"):
        plant(effects.from_list([{"name": "payload", "mass": 1.0, "link": "lf_toe"}]))


def test_a_stuck_sensor_repeats_itself_and_others_do_not(plant, run):
    fault = {"name": "sensor_stuck", "channel": "q", "index": 4, "start": 0.04}
    states, bare = run(plant(effects.from_list([fault])), 40), run(plant(), 40)
    q = np.array([s.q for s in states])
    assert np.ptp(q[10:, 4]) == 0.0
    others = np.delete(np.arange(12), 4)
    np.testing.assert_array_equal(q[:, others], np.array([s.q for s in bare])[:, others])
    assert q[10, 4] == bare[10].q[4]


def test_stuck_rows_and_whole_arrays():
    now, held = np.arange(6.0).reshape(3, 2), np.full((3, 2), 9.0)
    assert stuck(now, held, -1) is held
    np.testing.assert_array_equal(stuck(now, held, 1), [[0, 1], [9, 9], [4, 5]])
    np.testing.assert_array_equal(now, np.arange(6.0).reshape(3, 2))


@pytest.mark.parametrize(("channel", "index"), [("q", 12), ("grf", 4), ("angular_velocity", 3)])
def test_a_sensor_that_does_not_exist_cannot_be_stuck(plant, channel, index):
    fault = {"name": "sensor_stuck", "channel": channel, "index": index}
    with pytest.raises(ParameterError, match=f"index of {channel}"):
        plant(effects.from_list([fault]))


def test_commands_get_lost_with_the_probability_asked_for():
    effect = effects.make("command_dropout", probability=0.3)
    effect.reset(np.random.default_rng(0))
    lost = 0
    for _ in range(3000):
        q = np.zeros(12)
        for _ in range(4):  # a lost command stays lost until the next one comes
            arrived = [effect.on_command(q, q, 0.0)[0] is q for _ in range(4)]
            assert len(set(arrived)) == 1
        lost += not arrived[0]
    assert lost / 3000 == pytest.approx(0.3, abs=0.03)


def test_when_every_command_is_lost_the_first_one_is_kept():
    effect = effects.make("command_dropout", probability=1.0)
    effect.reset(np.random.default_rng(0))
    first = np.ones(12)
    effect.on_command(first, first, 0.0)
    assert effect.on_command(np.zeros(12), np.zeros(12), 0.1)[0] is first


@pytest.mark.parametrize("engine", ["pybullet", "mujoco"])
def test_higher_ground_under_the_left_feet_leans_a_robot_to_the_right(engine):
    made = robot.load("tigrillo", {"sensors.exact": True, "sim.engine": engine})
    rolls = {}
    for height in (0.0, 0.006):
        listed = effects.from_list(
            [{"name": "ground_height", "foot": f, "height": height} for f in ("lf_foot", "lh_foot")]
        )
        with Simulation(effects=listed, robot=made) as sim:
            state = sim.reset()
            for tick in range(60):
                state = sim.step(MotionCommand(tick, tick * sim.dt, made.standing, np.zeros(8)))
            rolls[height] = roll_pitch_yaw(state.orientation)[0]
    assert 0.01 < rolls[0.006] - rolls[0.0] < 0.2


def test_ground_so_low_that_no_foot_is_left_is_refused():
    listed = effects.from_list([{"name": "ground_height", "foot": "lf_foot", "height": -0.4}])
    with pytest.raises(ParameterError, match="lf_foot"):
        Simulation(effects=listed, robot="tigrillo")
