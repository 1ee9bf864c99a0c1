# SPDX-License-Identifier: Apache-2.0
"""Floors of channels, and predictions between two steps."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction import floors, horizon, running
from loco_learning.gap.prediction.forward import Forward, ForwardParams
from loco_learning.gap.proposals.following import following
from loco_learning.gap.recordings.record import Record, coarsest
from loco_learning.runs import experiment
from loco_learning.runs.rollout import rollout
from loco_sim.plant.model import Model
from loco_sim.plant.simulation import Simulation

T = np.arange(300) / 100.0
STEP = 0.00506  # of the servo's encoder [rad]


def servo(resolution):
    """A servo that jumps twice, as a forward model and its record."""
    wanted = np.where(T < 1.0, 0.0, np.where(T < 2.0, 0.4, -0.3))[:, None]
    empty = Record("jumps", T, {"position": wanted}, ("pivot",), {"q": 0.0 * wanted}, ("pivot",))
    model = Model("servo_pendulum", {"drives.pivot.resolution": resolution})
    (q,) = Forward(model, [empty])()
    noise = 0.001 * np.random.default_rng(1).standard_normal(q.shape)
    record = replace(empty, signals={"q": q + noise})
    return Forward(model, [record]), record


def test_each_joint_has_its_own_quantisation_step(slide):
    (record, *_), _ = slide.records()
    steps = {("q", "hip"): 0.005, ("q", "knee"): 0.001}
    both = [replace(record, resolution=steps), replace(record, resolution={("q", "hip"): 0.004})]
    assert coarsest(both, "q", "hip") == 0.005
    assert coarsest(both, "q", "knee") == 0.001
    assert coarsest(both, "q", "one that hardly moves") == 0.005  # the signal's largest
    assert coarsest(both, "tau", "hip") == 0.0


def test_what_hangs_on_the_phase_of_hunting_is_no_gap():
    forward, record = servo(STEP)
    case = cases.prepare(forward, [record], [])
    step = case.fine
    for speed in (-0.15, 0.1):
        (other,), (same,) = forward.nudged(speed)((), {}, step=step), forward((), {}, step=step)
        apart = (other - same) / case.floors[0]
        assert np.abs(other - same).max() > 0.2 * STEP  # there is something to forgive
        assert np.sqrt(np.mean(apart**2)) < 1.0


@pytest.mark.parametrize("whose", ["simulated", "stepped"])
def test_the_steps_of_a_simulation_that_was_recorded_are_no_gap(whose):
    """What a plant in steps of 1 ms does is off the model's limit by what its floor says."""
    wanted = (0.4 * np.sin(3.0 * T))[:, None]
    empty = Record("sine", T, {"position": wanted}, ("pivot",), {"q": 0.0 * wanted}, ("pivot",))
    model = Model("servo_pendulum", {"drives.pivot.resolution": 0.0, "sim.physics_rate": 1000})
    (q,) = Forward(model, [empty])()
    noise = 1e-6 * np.random.default_rng(1).standard_normal(q.shape)
    rms = {}
    for step in (0.0, 1e-3):
        record = replace(empty, signals={"q": q + noise}, **{whose: step})
        case = cases.prepare(Forward(model, [record]), [record], [])
        (residual,) = case.bare(())  # refitted delays of the drive would close a part
        rms[step] = float(np.sqrt(np.nanmean(residual**2)))
    assert rms[0.0] > 3.0 and 0.3 < rms[1e-3] < 1.25


def test_steps_of_a_simulation_that_solved_its_damping_are_no_gap():
    """The model divides its steps for damping that the simulation solved with whole ones."""
    model = Model("hyq_leg", {"drives.lf_kfe_joint.kd": 60.0})
    robot, t = model.make_robot(), np.arange(250) / 250.0
    q = robot.standing + 0.2 * np.sin(8.0 * t)[:, None]
    told = {"position": q, "velocity": np.gradient(q, t, axis=0)}
    empty = Record("damped", t, told, robot.joints, {"q": 0.0 * q}, robot.joints, simulated=1e-3)
    with Simulation(robot=robot, dt=0.004) as plant:
        assert plant.physics_dt == pytest.approx(1e-3)
        seen = np.array([state.q for state in plant.follow(running.sequence(empty, robot))])
    seen += 1e-6 * np.random.default_rng(1).standard_normal(seen.shape)
    record = replace(empty, signals={"q": seen})
    forward = Forward(model, [record])
    assert running.step(forward.robot(), 0.004) < 0.5e-3
    (residual,) = cases.prepare(forward, [record], []).whitened(())
    assert 0.1 < float(np.sqrt(np.nanmean(residual**2))) < 1.25


def test_a_drive_that_does_not_round_does_not_hunt():
    forward, _ = servo(0.0)
    (apart,) = floors.limit_cycle_errors(forward, 0.25)
    assert not apart.any()


def test_a_nudge_changes_the_speed_at_the_start_and_nothing_else():
    forward, _ = servo(0.0)
    (still,), (moved,) = forward(), forward.nudged(0.5)()
    assert moved[1, 0] - still[1, 0] == pytest.approx(0.005, rel=0.7)
    assert np.array_equal(forward.nudged(0.0)()[0], still)
    assert np.array_equal(forward()[0], still)


def test_experiments_are_ranked_with_delays_as_they_are(bench, slide):
    """Two delays that differ by 2 µs are the same, on whatever side of half a step they are."""
    case, _ = bench([])

    def model(name, delay):
        spec, left = {"name": "actuation_delay", "delay": delay}, [np.ones((50, 1))]
        held = SimpleNamespace(scale=np.ones(1), residuals=left)
        return SimpleNamespace(
            names=(name,), key=name, specs=[spec], parts=(), overrides={}, held=held, whole=left,
            score=SimpleNamespace(tau=np.ones((1, 1))),
        )  # fmt: skip

    def best(delay, other):
        judged = SimpleNamespace(
            base=SimpleNamespace(held=SimpleNamespace(residuals=[np.full((50, 1), 9.0)])),
            best=model("one", delay),
            rivals=[(model("other", other), 0.5)],
            probability=0.5,
            decision=SimpleNamespace(verdict="ambiguous"),
        )
        return following(slide.model, case, judged, [])[0]["odds"]

    assert best(0.001499, 0.001501) < 1.1
    assert best(0.001499, 0.004) > 100.0


def trotting(off):
    """Case of HyQ that trots, with values of its robot.yaml that are off, and what it does."""
    values = {"learner.stand": 0.4, "learner.train": 1.0, "gait.speed": 0.25}
    log = rollout(experiment.load("hyq_trot_open", {**values, "overrides": off}))
    plant, rng = log.experiment.plant, np.random.default_rng(1)
    spread = {"q": 4e-5, "dq": 4e-3, "tau": 0.2, "gyro": 2e-3, "acceleration": 0.05}
    signals = {
        name: column + spread[name] * rng.standard_normal(column.shape)
        for name, column in ((name, getattr(log, name)) for name in spread)
    }
    signals |= {"orientation": log.imu_orientation}
    said = {"position": log.command, "velocity": log.command_dq, "torque": log.trunk_tau}
    stance = dict(zip(plant.feet, log.stance.T.astype(float), strict=True))
    record = Record(
        "trot", log.t, said, plant.joints, signals, plant.joints, stance=stance, simulated=1e-3
    )  # fmt: skip
    forward = Forward(horizon.quickest(Model("hyq")), [record], ForwardParams(ground=0.3, most=4))
    return cases.prepare(forward, [record], [])


def test_a_robot_on_the_ground_that_is_a_little_off_has_no_gap():
    """Its masses, its trunk among them, and its motors are refitted, as they are in the air."""
    off = {f"bodies.{link}.mass": by for link, by in (
        ("base_link", 1.02), ("lf_lowerleg", 1.03), ("rh_upperleg", 0.97), ("lh_lowerleg", 1.03),
    )}  # fmt: skip
    case = trotting(off)
    before, after = (
        float(np.sqrt(np.nanmean(np.square(rows[0]))))
        for rows in (case.bare(()), case.whitened(()))
    )
    assert before > 1.25 > after


def test_what_engines_differ_by_moves_no_mass_of_an_exact_robot():
    case = trotting({})
    _, by = case._refitted((), None, [0])
    assert np.max(np.abs(by[0])) < 1.5
    counted = replace(case.loose, weight=np.ones(len(case.loose.weight)), grams={})
    _, far = replace(case, loose=counted)._refitted((), None, [0])
    assert np.max(np.abs(far[0])) > 2.0  # as if errors of contacts were noise


def test_a_late_torque_does_not_explain_one_that_is_held(bench):
    """Nor does a mean delay of half the period; a period that is a little off is worse, too."""
    case, _ = bench([{"name": "torque_hold", "period": 0.008}])

    def left(name, **values):
        spec = [{"name": name, **values}]
        return float(np.sqrt(np.mean(np.square(case.corrected(spec, {}).bare(spec)[0]))))

    assert left("torque_hold", period=0.008) < 1.1
    others = [left("actuation_delay", delay=d) for d in (0.003, 0.0035, 0.004, 0.0045)]
    assert min([*others, left("torque_hold", period=0.0085)]) > 3.0


def test_the_step_error_is_that_of_the_values_that_are_refitted_beside_an_effect():
    """Values that imitate a force changed the step error of a leg by more than its noise."""
    t = np.arange(500) / 250.0
    model, force = Model("hyq_leg"), [{"name": "constant_force", "force": [0.0, 60.0, 0.0]}]
    robot = model.make_robot()
    force[0]["link"] = "lf_lowerleg"
    swing = 0.2 * np.sin(np.outer(6.0 * t, [0.7, 1.0, 1.3])) * np.minimum(t, 1.0)[:, None]
    told = {"position": robot.standing + swing}, robot.joints, {"q": swing}, robot.joints
    empty = Record("swing", t, *told)
    near = cases.prepare(Forward(model, [empty]), [empty], []).loose
    off = near.values(2.2 * np.sign(np.sin(1.0 + np.arange(len(near.at)))))
    (seen,) = Forward(model, [empty])(force, off, step=1 / 8)
    noise = 2e-5 * np.random.default_rng(1).standard_normal(seen.shape)
    record = replace(empty, signals={"q": seen + noise})
    case = cases.prepare(Forward(model, [record]), [record], [])
    exact = case.corrected(force, {})
    values = case.loose.values(case._refitted(force, {}, [0], coarse=True)[1][0])
    whole, coarse, fine = (case.forward(force, values, step=k)[0] for k in (1.0, 1 / 4, 1 / 8))

    def error(case):
        left = (2.0 * fine - coarse - whole - case.correction[1.0][0]) / case.floors[0]
        return float(np.sqrt(np.nanmean(np.square(left))))

    assert error(exact) < 0.5 * error(case)
