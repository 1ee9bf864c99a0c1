# SPDX-License-Identifier: Apache-2.0
"""The plant keeps time, senses what happens, repeats itself and protects itself."""

import logging
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import loco_control
import loco_sim
from loco_control.exceptions import DivergedError, ParameterError
from loco_control.gait.generator import GaitParams, TargetGenerator
from loco_control.stance.controller import StanceController, StanceParams
from loco_control.stance.trunk import TrunkParams
from loco_control.types import MotionCommand, TrunkTorque
from loco_sim.effects import from_list
from loco_sim.engines import installed
from loco_sim.params import SimParams
from loco_sim.plant.simulation import Simulation, periods
from loco_sim.robot import robot as robots

BENCH = """<robot name="bench"><link name="stand"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pivot" type="revolute"><parent link="stand"/><child link="rod"/>
<origin xyz="0 0 2"/><axis xyz="0 -1 0"/>
<limit effort="50" velocity="9" lower="-3" upper="3"/></joint></robot>"""
MASS, GRAVITY = 84.756, 9.81
STIFF = {"drives.*.kp": 400, "drives.*.kd": 10, "drives.*.swing_kd": 10}


def test_ticks_and_time_advance_together(plant, run):
    states = run(plant(), 3)
    assert [s.tick for s in states] == [0, 1, 2, 3]
    assert [s.t for s in states] == [0.0, 0.004, 0.008, 0.012]


def test_the_first_state_is_the_standing_pose_at_rest(plant, hyq):
    sim = plant()
    state = sim.reset()
    np.testing.assert_allclose(state.q, hyq.standing)
    np.testing.assert_array_equal(state.dq, np.zeros(12))
    np.testing.assert_allclose(state.linear_acceleration, [0, 0, GRAVITY], atol=1e-9)
    np.testing.assert_allclose(state.orientation, [0, 0, 0, 1], atol=1e-12)
    truth = sim.ground_truth()
    assert truth.position[2] == pytest.approx(0.6 + 0.02175, abs=1e-5)


def test_it_can_start_in_another_pose(plant, hyq):
    higher = hyq.standing * 0.8
    assert plant(standing=higher).reset().q == pytest.approx(higher)


def test_states_handed_out_are_not_changed_later(plant, commands, as_bytes):
    sim = plant()
    state = sim.reset()
    before = as_bytes([state])
    for k in range(5):
        sim.step(*commands(k))
    assert as_bytes([state]) == before


def standing_still(sim, hyq, seconds=2.0):
    hold = MotionCommand(0, 0.0, hyq.standing, np.zeros(12))
    trunk = TrunkTorque(0, 0.0, np.zeros(12), np.zeros(6), np.ones(4, bool))
    state = sim.reset()
    for _ in range(round(seconds * 250)):
        state = sim.step(hold, trunk)
    return state


def test_standing_still_the_sensors_agree_with_statics(plant, hyq):
    sim = plant(overrides=STIFF)
    state = standing_still(sim, hyq)
    np.testing.assert_allclose(state.grf.sum(axis=0), [0, 0, MASS * GRAVITY], atol=3.0)
    assert np.linalg.norm(state.linear_acceleration) == pytest.approx(GRAVITY, abs=0.05)
    assert state.contact.all()
    # Held still, the measured torque is the impedance law at the measured state.
    law = 400.0 * (hyq.standing - state.q) - 10.0 * state.dq
    np.testing.assert_allclose(state.tau, law, atol=0.1)


def test_the_ground_force_is_the_mean_over_the_period_or_its_last_step(plant, run):
    mean, last = run(plant(), 40), run(plant(grf="last"), 40)
    np.testing.assert_array_equal(mean[-1].q, last[-1].q)  # only the sensor differs
    assert np.abs(mean[-1].grf - last[-1].grf).max() > 1e-6
    one_step = run(plant(physics_rate=250.0, max_substeps=1, damping_limit=1.9), 5)
    last_step = run(plant(physics_rate=250.0, max_substeps=1, damping_limit=1.9, grf="last"), 5)
    np.testing.assert_array_equal(one_step[-1].grf, last_step[-1].grf)


def test_the_stance_flags_choose_the_gains(plant, commands):
    ends = []
    for stance in (True, False):
        sim = plant(overrides={"drives.*.swing_kp": 20})
        sim.reset()
        for k in range(20):
            state = sim.step(*commands(k, stance=stance))
        ends.append(state.q)
    assert np.abs(ends[0] - ends[1]).max() > 1e-3


def test_hyq_can_start_in_any_state(plant, hyq, commands):
    sim = plant()
    rng = np.random.default_rng(4)
    q, dq = hyq.standing + rng.uniform(-0.1, 0.1, 12), rng.uniform(-1.0, 1.0, 12)
    base = ((0.1, -0.2, 0.9), (0.0, 0.0, 0.0, 1.0), (0.3, 0.0, 0.1), (0.0, 0.0, 0.2))
    state = sim.place(q, dq, base)
    np.testing.assert_allclose(state.q, q)
    np.testing.assert_allclose(state.dq, dq)
    np.testing.assert_allclose(sim.ground_truth().position, base[0], atol=1e-9)
    after = sim.step(*commands(0)).q
    np.testing.assert_array_equal(after, (sim.place(q, dq, base), sim.step(*commands(0)))[1].q)


def test_reset_repeats_the_run_bit_for_bit(plant, run, as_bytes):
    sim = plant()
    assert as_bytes(run(sim)) == as_bytes(run(sim))


def test_a_second_plant_repeats_the_run_bit_for_bit(plant, run, as_bytes):
    first, second = plant(), plant()
    first.reset()
    assert as_bytes(run(second)) == as_bytes(run(first))


@pytest.mark.parametrize(
    ("damping", "builds"), [(None, 1), (32.0, 2)], ids=["as it was built", "with implicit damping"]
)
def test_a_plant_is_built_once_and_moves_as_after_a_reset(
    plant, commands, as_bytes, engine, damping, builds, monkeypatch
):
    """Two builds only if the first shows that damping must be left to the steps."""
    made, build = [], Simulation._build
    monkeypatch.setattr(Simulation, "_build", lambda sim: (made.append(1), build(sim))[1])
    sim = plant(
        from_list([{"name": "payload", "link": "base_link", "mass": 5.0}]), engine=engine,
        overrides={"drives.*_kfe_joint.swing_kd": damping} if damping else None,
    )  # fmt: skip
    assert len(made) == builds
    first = [sim.step(*commands(k)) for k in range(20)]
    sim.reset()
    assert len(made) == builds + 1
    assert as_bytes(first) == as_bytes([sim.step(*commands(k)) for k in range(20)])


PROGRAM = """
import hashlib, numpy as np
from dataclasses import fields
from loco_control.types import MotionCommand, TrunkTorque
from loco_sim.effects import from_list
from loco_sim.effects import from_list
from loco_sim.params import SimParams
from loco_sim.plant.simulation import Simulation
effects = from_list([{"name": "sensor_noise", "q": 0.01}, {"name": "push", "random": 30.0}])
sim = Simulation(SimParams(), effects, seed=5)
state, digest = sim.reset(), hashlib.sha256()
for k in range(60):
    q = sim.robot.standing + 0.05 * np.sin(0.1 * k)
    stance = np.array([k % 9 < 4, True, True, k % 9 < 4])
    trunk = TrunkTorque(k, 0.0, np.full(12, 2.0), np.zeros(6), stance)
    state = sim.step(MotionCommand(k, 0.0, q, np.zeros(12)), trunk)
    for f in fields(state):
        digest.update(np.asarray(getattr(state, f.name)).tobytes())
print("digest", digest.hexdigest())
"""


@pytest.mark.parametrize("engine", installed())
def test_fresh_processes_give_the_same_bytes(engine):
    sources = [str(Path(m.__file__).parent.parent) for m in (loco_control, loco_sim)]
    paths = os.pathsep.join(sources)
    environment = {**os.environ, "PYTHONPATH": paths, "LOCO_ENGINE": engine}

    def digest(threads):
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM],
            env={**environment, "OMP_NUM_THREADS": threads, "PYTHONHASHSEED": threads},
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.split("digest")[1]

    assert digest("1") == digest("2")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_bad_command_is_counted_and_the_last_good_one_kept(plant, commands, caplog, value):
    sim, twin = plant(), plant()
    sim.reset(), twin.reset()
    good = commands(3)
    bad_command, trunk = commands(4)
    bad_command.q[2] = value
    for each in (sim, twin):
        each.step(*good)
    with caplog.at_level(logging.WARNING):
        state = sim.step(bad_command, trunk)
    np.testing.assert_array_equal(state.q, twin.step(*good).q)
    assert (sim.rejected, twin.rejected) == (1, 0)
    assert "not finite" in caplog.text
    sim.reset()
    assert sim.rejected == 0


def test_without_safety_a_bad_command_raises(plant, commands):
    sim = plant(safety=False)
    sim.reset()
    command, trunk = commands(0)
    command.dq[0] = np.nan
    with pytest.raises(DivergedError, match="command"):
        sim.step(command, trunk)


def test_a_diverged_simulation_raises(plant, commands):
    from loco_sim import effects

    class Blowup(effects.Effect, name="test_blowup"):
        def on_torque(self, tau, q, dq, dt, t):
            return tau * np.nan

    try:
        sim = plant(effects=[effects.make("test_blowup")])
        sim.reset()
        with pytest.raises(DivergedError, match="not finite|diverged"):
            sim.step(*commands(0))
    finally:
        del effects.EFFECTS["test_blowup"]


def test_torques_are_clipped_to_the_effort_limit(plant, commands, hyq):
    sim = plant()
    sim.reset()
    command, trunk = commands(0)
    command.q = hyq.standing + 50.0
    assert np.abs(sim.step(command, trunk).tau).max() <= 150.0 + 1e-9


def test_a_fall_is_noticed_and_stays(plant, hyq):
    sim = plant(overrides={"drives.*.kp": 0.1, "drives.*.swing_kp": 0.1})
    standing_still(sim, hyq, 1.0)
    assert "below 0.35 m" in sim.fallen
    reason = sim.fallen
    standing_still_again = sim.step(
        MotionCommand(0, 0.0, hyq.standing, np.zeros(12)),
        TrunkTorque(0, 0.0, np.zeros(12), np.zeros(6), np.ones(4, bool)),
    )
    assert standing_still_again.tick > 0
    assert sim.fallen == reason
    sim.reset()
    assert sim.fallen is None


@pytest.mark.parametrize(("dt", "rate", "steps"), [(0.004, 1000.0, 4), (0.005, 1000.0, 5)])
def test_a_control_period_holds_whole_physics_steps(dt, rate, steps):
    assert periods(dt, rate) == steps


@pytest.mark.parametrize(("dt", "rate"), [(0.0045, 1000.0), (0.0005, 1000.0), (0.0, 1000.0)])
def test_a_control_period_that_does_not_is_refused(dt, rate):
    with pytest.raises(ParameterError, match="whole multiple"):
        Simulation(SimParams(physics_rate=rate), dt=dt)


def test_strong_damping_that_is_held_divides_the_physics_step(plant, run):
    strong = {f"drives.*_{joint}_joint.swing_kd": 32 for joint in ("hfe", "kfe")}
    sim = plant(overrides=strong, implicit_damping=False)
    assert sim.physics_dt == pytest.approx(0.001 / 4)  # kd dt / I = 1.55 at 1 kHz
    assert plant().physics_dt == 0.001
    states = run(sim, 5)
    assert states[-1].t == 0.02


def test_damping_out_of_reach_is_refused():
    with pytest.raises(ParameterError, match="sub-steps"):
        Simulation(
            SimParams(implicit_damping=False),
            robot=robots.load("hyq", {"drives.*_kfe_joint.swing_kd": 999}),
        )


def test_dividing_the_step_barely_changes_a_run_that_was_stable(plant, run):
    coarse, fine = run(plant(), 50), run(plant(physics_rate=4000.0), 50)
    assert np.abs(coarse[-1].q - fine[-1].q).max() < 0.02


def test_a_plant_can_be_used_as_a_context(hyq):
    with Simulation(robot=hyq) as sim:
        assert "hyq" in sim.robot_description
    sim.close()


def test_any_urdf_can_be_the_plant(tmp_path):
    """A bench with one joint and no feet: the same simulation, no new code."""
    (tmp_path / "bench.urdf").write_text(BENCH)
    (tmp_path / "robot.yaml").write_text(
        "urdf: bench.urdf\njoints: [pivot]\nfixed_base: true\n"
        "drives: {pivot: {kind: impedance, kp: 40.0, kd: 2.0}}\n"
    )
    noise = from_list([{"name": "sensor_noise", "q": 0.001}])
    with Simulation(SimParams(), noise, dt=0.004, robot=tmp_path) as sim:
        state = sim.reset()
        command = MotionCommand(0, 0.0, np.array([0.3]), np.zeros(1))
        trunk = TrunkTorque(0, 0.0, np.zeros(1), np.zeros(6), np.zeros(0, bool))
        for _ in range(500):
            state = sim.step(command, trunk)
    sag = 9.81 * 0.5 * np.sin(state.q[0]) / 40.0  # the spring carries the weight
    assert state.q[0] == pytest.approx(0.3 - sag, abs=0.005)
    assert state.grf.shape == (0, 3)
    assert sim.fallen is None


def test_hyq_trots():
    """Generator, stance controller and plant together: three seconds without a fall."""
    dt = 0.004
    generator = TargetGenerator(GaitParams(start_time=0.5), dt)
    controller = StanceController(StanceParams(), TrunkParams(), dt)
    with Simulation(standing=generator.standing) as sim:
        state, lifted = sim.reset(), np.zeros(4, bool)
        for _ in range(round(3.0 / dt)):
            target = generator.step(state)
            command = MotionCommand(state.tick, state.t, target.q, target.dq)
            _, trunk = controller.step(state, target, command)
            state = sim.step(command, trunk)
            lifted |= ~state.contact
        assert sim.fallen is None
        assert lifted.all()
        assert 0.3 < sim.ground_truth().position[0] < 1.0
