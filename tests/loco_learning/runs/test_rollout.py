# SPDX-License-Identifier: Apache-2.0
"""The loop with the real plant and controllers: it trots, repeats, and is logged whole."""

import time

import numpy as np
import pytest

from loco_control.exceptions import DivergedError, MissingFileError, ParameterError
from loco_learning.metrics import registry as metrics
from loco_learning.params import OUTPUT_JOINTS, PHASES
from loco_learning.reflex.network import ReflexNetwork
from loco_learning.runs import rollout as module
from loco_learning.runs.experiment import from_values, load
from loco_learning.runs.log import PARTS, REFLEX_TIME, Log, columns_of
from loco_learning.runs.rollout import build, rollout, run
from loco_sim.robot import robot as robots


def assert_same(one, two):
    assert one.columns.keys() == two.columns.keys()
    for name, array in one.columns.items():
        if name != REFLEX_TIME:
            np.testing.assert_array_equal(array, two.columns[name], err_msg=name)


def test_the_reflex_network_learns_to_trot_and_goes_on_alone(short_log):
    assert short_log.fall == ""
    assert short_log.complete
    test = short_log.cut(short_log.phase_of("test"))
    assert test.driving.all()
    assert not test.learning.any()
    target = test.target[:, OUTPUT_JOINTS]
    rms = np.sqrt(np.mean((test.prediction[:, :8] - target) ** 2))
    assert rms < 0.1 * np.mean(np.ptp(target, axis=0))
    x = test.position[:, 0]
    assert 0.5 < (x[-1] - x[0]) / (test.t[-1] - test.t[0]) / 0.25 < 1.5


def test_every_message_of_every_tick_is_in_the_log(short_log):
    assert len(short_log) == short_log.experiment.ticks
    assert short_log.columns.keys() == columns_of(short_log.experiment).keys() | {REFLEX_TIME}
    for name, array in short_log.columns.items():
        assert len(array) == len(short_log), name
        if array.dtype.kind == "f":
            assert np.isfinite(array).all(), name
    np.testing.assert_array_equal(short_log.ticks(), np.arange(len(short_log)))
    loop = build(short_log.experiment)
    try:
        said = [loop.step() for _ in range(300)][-1]
    finally:
        loop.close()
    for part in PARTS:
        again = short_log.message(part, 299)
        for name, value in vars(said[part]).items():
            np.testing.assert_array_equal(getattr(again, name), value, err_msg=f"{part}.{name}")
    np.testing.assert_allclose(short_log.t, np.arange(len(short_log)) * 0.004, atol=1e-9)


def test_phases_of_a_log_cover_it_without_overlap(short_log):
    slices = [short_log.phase_of(name) for name in PHASES]
    assert slices[0].start == 0
    assert slices[-1].stop == len(short_log)
    for one, two in zip(slices, slices[1:], strict=False):
        assert one.stop == two.start


def test_same_seed_same_bits_other_seed_other_bits():
    experiment = load("hyq_short", {"duration": 1.4})
    one, two = rollout(experiment), rollout(experiment)
    assert_same(one, two)
    other = rollout(experiment, seed=7)
    assert other.seed == 7
    assert not np.array_equal(one.prediction, other.prediction)


def test_reset_of_the_loop_is_a_new_loop():
    experiment = load("hyq_short", {"effects": [{"name": "sensor_noise", "grf": 5.0}]})
    loop = build(experiment)
    try:
        first = [loop.step()["state"].grf for _ in range(300)]
        loop.reset()
        np.testing.assert_array_equal([loop.step()["state"].grf for _ in range(300)], first)
    finally:
        loop.close()


def test_a_log_is_the_same_after_saving_and_loading(short_log, tmp_path):
    short_log.save(tmp_path / "deep" / "log.npz")
    loaded = Log.load(tmp_path / "deep" / "log.npz")
    assert_same(short_log, loaded)
    assert loaded.experiment == short_log.experiment
    assert (loaded.seed, loaded.fall) == (short_log.seed, short_log.fall)
    np.testing.assert_array_equal(loaded.reflex_time, short_log.reflex_time)
    assert len(loaded.cut(slice(10, 20))) == 10
    with pytest.raises(AttributeError, match="columns: t, q"):
        loaded.commands  # noqa: B018


def test_broken_logs_are_refused(tmp_path):
    path = tmp_path / "log.npz"
    with pytest.raises(MissingFileError, match="log.npz"):
        Log.load(path)
    path.write_text("no")
    with pytest.raises(ParameterError, match="is not a log file of loco"):
        Log.load(path)
    np.savez(path, meta='{"kind": "log", "format": 99}')
    with pytest.raises(ParameterError, match="log file of format 99"):
        Log.load(path)


def test_weights_saved_in_one_run_drive_the_legs_in_the_next(tmp_path):
    path = str(tmp_path / "net.npz")
    seen = []
    trained = rollout(load("hyq_short"), on_tick=lambda k, _: seen.append(k), save_weights=path)
    assert seen == list(range(1, len(trained) + 1))
    changes = {"learner.weights": path, "learner.closing": 0.0, "learner.train": 2.0, "seed": 5}
    again = rollout(load("hyq_short", changes))
    assert again.fall == ""
    assert not again.learning.any()
    assert again.cut(again.phase_of("test")).driving.all()
    saved = np.linalg.norm(ReflexNetwork.load(path).readout.weights)
    np.testing.assert_allclose(again.weight_norm, saved)


def test_a_fall_ends_the_run_and_says_why():
    # No stiffness, no trunk: it must collapse.
    soft = {f"impedance.{k}_kp": [1.0, 1.0, 1.0] for k in ("swing", "stance")}
    log = rollout(load("hyq_short", {**soft, "trunk.enabled": False}))
    assert log.fall
    assert not log.complete
    assert log.position[-1, 2] < 0.5


def test_a_diverged_plant_counts_as_a_fall(monkeypatch):
    def diverge(self, command, trunk):
        if command.tick == 20:
            raise DivergedError("joint position is not finite")
        return original(self, command, trunk)

    original = module.Simulation.step
    monkeypatch.setattr(module.Simulation, "step", diverge)
    log = rollout(load("hyq_short"))
    assert log.fall == "joint position is not finite"
    assert len(log) == 20


def test_open_loop_never_lets_the_network_speak():
    log = rollout(load("hyq_trot_open", {"learner.train": 2.0}))
    assert not log.driving.any()
    np.testing.assert_array_equal(log.command, log.target)
    np.testing.assert_array_equal(log.command_dq, log.target_dq)


# ---- robots of joints

HYQ = robots.load("hyq")
BRIEF = {"duration": 1.0}


@pytest.fixture(scope="module")
def walk():
    return load("tigrillo_walk", BRIEF)


@pytest.fixture(scope="module")
def walked(walk):
    return rollout(walk)


def test_equal_experiments_give_equal_logs(walk, walked):
    assert_same(rollout(walk), walked)
    loop = build(walk)
    try:
        run(loop)
        loop.reset()
        assert_same(run(loop), walked)
    finally:
        loop.close()


@pytest.mark.parametrize("robot", ["servo_pendulum", "pendulum", "linear_axis", "spring_mass"])
def test_any_robot_runs(robot):
    experiment = load("servo_pendulum_sine", {"robot": robot, "duration": 0.3})
    log = rollout(experiment)
    assert log.complete
    assert log.command.shape == (experiment.ticks, len(experiment.plant.driven))
    assert np.isfinite(log.q).all()


def test_columns_have_a_row_per_tick(walk, walked):
    assert len(walked) == walk.ticks == 100
    assert walked.complete and not walked.fall
    np.testing.assert_allclose(walked.t, np.arange(100) * walk.dt)
    n, m = len(walk.plant.joints), len(walk.plant.driven)
    assert walked.q.shape == (100, n) and walked.command.shape == (100, m)
    assert walked.contact.dtype == bool and walked.contact.shape == (100, len(walk.plant.feet))


def test_without_a_learner_the_command_is_the_target(walked):
    np.testing.assert_array_equal(walked.command, walked.target)
    assert walked.distance == walked.position[-1, 0] - walked.position[0, 0]


def test_a_push_topples_tigrillo():
    push = {"name": "push", "force": [0.0, 30.0, 0.0], "start": 0.2, "stop": 0.5}
    log = rollout(load("tigrillo_hold", {"effects": [push]}))
    assert "beyond" in log.fall or "below" in log.fall
    assert not log.complete
    assert 0.2 < log.t[-1] < 2.0


def test_divergence_keeps_what_came_before(walk):
    loop = build(walk)
    step, calls = loop.sim.step, []

    def diverge(*command):
        calls.append(command)
        if len(calls) > 10:
            raise DivergedError("the simulated state is not finite")
        return step(*command)

    loop.sim.step = diverge
    try:
        log = run(loop)
    finally:
        loop.close()
    assert log.fall == "the simulated state is not finite"
    assert len(log) == 10


def test_until_cuts_and_on_tick_sees_every_tick(walk, walked):
    seen = []
    cut = rollout(walk, on_tick=lambda k, loop: seen.append(k), until=0.3)
    assert seen == list(range(1, 31))
    assert_same(cut, walked.cut(slice(0, 30)))


def test_a_recording_can_drive(walk, walked):
    class Replay:
        def reset(self):
            pass

        def step(self, t):
            row = round(t / walk.dt)
            return walked.target[row], walked.target_dq[row]

    assert_same(rollout(walk, motion=Replay()), walked)


def test_seed_changes_the_noise_of_sensors_and_nothing_else(walk, walked):
    other = rollout(walk, seed=5)
    assert not np.array_equal(other.q, walked.q)
    np.testing.assert_array_equal(other.position, walked.position)  # open loop: nothing feels it
    np.testing.assert_array_equal(other.command, walked.command)


def test_a_control_period_must_be_whole_physics_steps():
    with pytest.raises(ParameterError, match="whole multiple"):
        build(load("tigrillo_hold", {"control_rate": 300.0}))


def test_the_loop_costs_little_beside_the_plant(walk):
    """Calibration and gait search run it thousands of times."""
    loop = build(walk)
    step, inside = loop.sim.step, [0.0]

    def timed(*command):
        before = time.perf_counter()
        state = step(*command)
        inside[0] += time.perf_counter() - before
        return state

    loop.sim.step = timed
    try:
        log = run(loop)
    finally:
        loop.close()
    assert log.wall_time - inside[0] < 0.5 * log.wall_time


@pytest.mark.parametrize(("name", "distance"), [("tigrillo_bound", 1.5), ("tigrillo_walk", 1.5)])
def test_shipped_gaits_go_forward_without_a_fall(name, distance):
    """The experiments of step one; 15 s of rollout each take a second or two."""
    log = rollout(load(name))
    assert log.complete and not log.fall
    assert log.distance > distance


def test_a_robot_with_legs_follows_oscillators_too():
    """HyQ held in the air: no gait, no trunk, the same log, loop and metrics as any robot."""
    values = {
        "robot": "hyq",
        "duration": 1.2,
        "overrides": {"fixed_base": True, "height": 1.0},
        "target": {
            "kind": "sine",
            "amplitude": [0.1],
            "offset": list(HYQ.standing),
            "phase": [0.0],
        },
    }
    log = rollout(from_values(values))
    assert log.complete
    assert log.command.shape == (len(log), 12)
    assert not log.has("stance") and not log.has("target_feet")
    assert np.abs(log.command - log.q).max() < 0.1
    found = metrics.table(log)["open loop"]
    assert {"power", "tracking_error", "step_height"} <= set(found)
    assert not {"speed", "passive_range", "nrmse"} & set(found)


@pytest.mark.parametrize(
    ("name", "together"), [("hyq_pace_open", (0, 2)), ("hyq_bound_open", (0, 1))]
)
def test_hyq_paces_and_bounds_at_the_commanded_speed(name, together):
    """Feet of a side, or of front and back, stand together, and no others do."""
    log = rollout(load(name, {"learner.train": 9.0}))
    assert not log.fall and log.complete
    x, contact = log.columns["position"][:, 0], log.columns["contact"].astype(bool)
    start = round(5.0 / log.dt)
    assert (x[-1] - x[start]) / (log.columns["t"][-1] - 5.0) == pytest.approx(0.25, rel=0.25)
    alike = {
        pair: np.mean(contact[start:, pair[0]] == contact[start:, pair[1]])
        for pair in ((0, 1), (0, 2), (0, 3))
    }
    assert alike.pop(together) > 0.9 and max(alike.values()) < 0.7
